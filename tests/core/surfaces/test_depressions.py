"""Low spots against closed forms and another way of filling them."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from numpy.typing import NDArray

from furrowmap.core.surfaces.grid import Grid
from furrowmap.core.surfaces.terrain import find_depressions, flooded


def drained(height: NDArray[np.float64]) -> NDArray[np.float64]:
    """Filled heights by Planchon and Darboux (2001, Catena 46, 159-176): flooded to the sky, then let off."""
    rows, columns = height.shape
    wall = np.pad(height, 1, constant_values=np.nan)
    outside = np.isnan(wall)
    level = np.where(outside, -np.inf, np.inf)
    steps = [(i, j) for i in (-1, 0, 1) for j in (-1, 0, 1)]
    while True:
        least = np.min([np.roll(level, step, (0, 1)) for step in steps], axis=0)
        new = np.where(outside, -np.inf, np.maximum(wall, np.minimum(least, level)))
        if np.array_equal(new, level):
            return np.where(outside, np.nan, level)[1 : rows + 1, 1 : columns + 1]
        level = new


@given(
    arrays(np.float64, st.tuples(st.integers(1, 9), st.integers(1, 9)), elements=st.sampled_from([0.0, 1.0, 2.0, 3.5])),
    st.data(),
)
def test_flooded__is_what_another_algorithm_finds(height: NDArray[np.float64], data: st.DataObject) -> None:
    gaps = data.draw(arrays(np.bool_, height.shape, elements=st.sampled_from([False, False, False, True])))
    height = np.where(gaps, np.nan, height)
    np.testing.assert_array_equal(flooded(height), drained(height))


def test_find_depressions__a_bowl_holds_what_its_formula_says() -> None:
    grid = Grid(0.05, 1000, 2000, (200, 240))
    east, north = np.meshgrid(*grid.centres_m())
    distance = np.hypot(east - 56.0, north - 95.0)
    # A paraboloid 0.3 m deep and 2 m in radius, in a field that falls towards no side.
    height = np.minimum(0.3 * (distance / 2.0) ** 2, 0.3)
    found = find_depressions(height, grid)
    assert len(found) == 1
    assert found.area_m2[0] == pytest.approx(math.pi * 2.0**2, rel=0.01)
    assert found.volume_m3[0] == pytest.approx(0.5 * math.pi * 2.0**2 * 0.3, rel=0.005)
    assert found.greatest_depth_m[0] == pytest.approx(0.3, abs=0.001)
    assert found.level_m[0] == pytest.approx(0.3, abs=1e-9)
    assert np.hypot(*(found.deepest_m[0] - (56.0, 95.0))) < 0.05
    (outline,) = found.polygons()
    assert outline.area == pytest.approx(found.area_m2[0])
    assert np.hypot(outline.centroid.x - 56.0, outline.centroid.y - 95.0) < 0.01


def test_find_depressions__parts_neighbours_and_leaves_out_what_is_small() -> None:
    grid = Grid(1.0, 0, 9, (9, 16))
    height = np.full(grid.shape, 5.0)
    height[2:5, 2:5] = 4.0
    height[2:5, 6:9] = 3.0
    height[2:5, 5] = 4.5  # the first spills into the second, and that over the edge
    height[6, 12] = 4.99
    both = find_depressions(height, grid, least_depth_m=0.02)
    assert len(both) == 1
    assert both.level_m.tolist() == [5.0]
    assert both.volume_m3[0] == pytest.approx(9 * 1.0 + 9 * 2.0 + 3 * 0.5)
    height[2:5, 9:] = 4.2  # a way out for the second
    two = find_depressions(height, grid, least_depth_m=0.02)
    assert sorted(two.level_m.tolist()) == [4.2, 4.5]
    assert sorted(two.volume_m3.tolist()) == pytest.approx([9 * 0.5, 9 * 1.2])
    assert np.array_equal(two.depth_m > 0, two.label > 0)
    assert len(find_depressions(height, grid, least_area_m2=20.0)) == 0


def test_find_depressions__holds_no_water_beside_the_unknown() -> None:
    height = np.ones((7, 7))
    height[3, 3] = 0.0
    grid = Grid(1.0, 0, 7, (7, 7))
    assert len(find_depressions(height, grid)) == 1
    height[2, 2] = np.nan
    found = find_depressions(height, grid)
    assert len(found) == 0
    assert found.polygons() == []
    assert np.isnan(found.depth_m[2, 2])
