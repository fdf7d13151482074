"""Grids anchored to the CRS, and what passes over them, against closed forms."""

from __future__ import annotations

import math

import numpy as np
import pytest
from affine import Affine
from hypothesis import given
from hypothesis import strategies as st

from furrowmap.core.runtime.errors import InputError
from furrowmap.core.surfaces.grid import Grid
from furrowmap.core.surfaces.passage import LineTrack, Passages

METRES = st.floats(-2e6, 2e6, allow_nan=False)
CELLS = st.sampled_from([0.02, 0.05, 0.1, 0.25, 0.3, 1.0])


@given(METRES, METRES, st.floats(0.0, 30.0), st.floats(0.0, 30.0), CELLS)
def test_of_bounds__covers_them_with_whole_cells_from_the_zero_of_the_crs(
    west: float, south: float, width: float, height: float, cell_m: float
) -> None:
    grid = Grid.of_bounds(cell_m, (west, south, west + width, south + height))
    for e_m, n_m in ((west, south), (west + width, south + height)):
        assert grid.cells_of(e_m, n_m)[1].all()
    left, bottom, right, top = grid.bounds_m
    assert right - left <= width + 2.001 * cell_m
    assert top - bottom <= height + 2.001 * cell_m
    assert all(math.isclose(edge / cell_m, round(edge / cell_m), abs_tol=1e-6) for edge in (left, bottom, right, top))


@given(METRES, METRES, CELLS)
def test_cells_of__is_where_the_transform_puts_the_cells(e_m: float, n_m: float, cell_m: float) -> None:
    grid = Grid.of_bounds(cell_m, (e_m - 1.0, n_m - 1.0, e_m + 1.0, n_m + 1.0))
    easting, northing = np.meshgrid(*grid.centres_m())
    index, inside = grid.cells_of(easting, northing)
    assert inside.all()
    assert np.array_equal(index.ravel(), np.arange(grid.rows * grid.columns))
    column, row = ~Affine(*grid.transform) @ (easting[0, 0], northing[0, 0])
    assert (column, row) == pytest.approx((0.5, 0.5), abs=1e-3)


def test_two_grids__overlay_where_they_share_ground() -> None:
    whole = Grid.of_bounds(0.05, (16_600.0, 96_500.0, 16_620.0, 96_520.0))
    part = Grid.of_bounds(0.05, (16_603.33, 96_507.77, 16_611.11, 96_511.11))
    rows, columns = part.window_in(whole)
    assert np.array_equal(whole.centres_m()[0][columns], part.centres_m()[0])
    assert np.array_equal(whole.centres_m()[1][rows], part.centres_m()[1])
    with pytest.raises(ValueError, match="does not lie in"):
        whole.window_in(part)


@given(st.integers(-50, 50), st.integers(-50, 50), st.integers(1, 40), st.integers(1, 40), st.integers(1, 9))
def test_coarser__is_the_least_grid_over_it_in_whole_cells_from_the_zero(
    west: int, north: int, rows: int, columns: int, factor: int
) -> None:
    fine = Grid(0.5, west, north, (rows, columns))
    coarse = fine.coarser(factor)
    assert coarse.cell_m == 0.5 * factor
    for of_fine, of_coarse, outward in zip(fine.bounds_m, coarse.bounds_m, (-1, -1, 1, 1), strict=True):
        assert 0 <= outward * (of_coarse - of_fine) < coarse.cell_m


@pytest.mark.parametrize(
    ("cell_m", "bounds", "code"),
    [
        (0.0, (0.0, 0.0, 1.0, 1.0), "bad-cell-size"),
        (math.nan, (0.0, 0.0, 1.0, 1.0), "bad-cell-size"),
        (0.05, (0.0, 0.0, -1.0, 1.0), "bad-bounds"),
        (0.05, (0.0, 0.0, math.inf, 1.0), "bad-bounds"),
        (0.05, (0.0, 0.0, 1e6, 1e6), "grid-too-large"),
    ],
)
def test_unfit_grids__are_refused(cell_m: float, bounds: tuple[float, float, float, float], code: str) -> None:
    with pytest.raises(InputError) as refused:
        Grid.of_bounds(cell_m, bounds)
    assert refused.value.code == code


def straight(number: int, begin_s: float, n_m: float) -> LineTrack:
    """A line 2 m wide driven eastward at 1 m/s from x = 0 to 10 m."""
    t = np.linspace(0.0, 10.0, 101)
    return LineTrack(number, begin_s + t, np.column_stack([t, np.full(101, n_m)]), np.tile([0.0, 1.0], (101, 1)))


def test_passages__of_straight_lines_are_at_the_time_their_line_is_there() -> None:
    grid = Grid.of_bounds(0.1, (-2.0, -3.0, 12.0, 4.0))
    passage = Passages([straight(1, 100.0, 0.0), straight(2, 200.0, 1.5)]).over(grid)
    e, n = np.meshgrid(*grid.centres_m())
    along = (e > 0.0) & (e < 10.0)
    first, second = along & (abs(n) < 1.0), along & (abs(n - 1.5) < 1.0)
    assert np.array_equal(passage.passed, first | second)
    assert np.array_equal(passage.number, np.where(second, 2, np.where(first, 1, 0)))
    assert passage.first_s[first] == pytest.approx(100.0 + e[first])
    assert passage.last_s[second] == pytest.approx(200.0 + e[second])
    assert passage.first_s[second & ~first] == pytest.approx(200.0 + e[second & ~first])


def test_passages__with_ground_beside_reach_further_but_not_on() -> None:
    grid = Grid.of_bounds(0.1, (-2.0, -3.0, 12.0, 4.0))
    wide = Passages([straight(1, 100.0, 0.0)]).over(grid, beside_m=0.5)
    e, n = np.meshgrid(*grid.centres_m())
    assert np.array_equal(wide.passed, (e > 0.0) & (e < 10.0) & (abs(n) < 1.5))


@given(st.floats(-3.0, 3.0), st.floats(3.5, 8.0))
def test_passages__round_a_bend_are_at_the_angle_of_each_cell(begin_rad: float, radius_m: float) -> None:
    angle = begin_rad + np.linspace(0.0, 2.0, 400)
    out = np.column_stack([np.cos(angle), np.sin(angle)])
    track = LineTrack(1, np.linspace(0.0, 2.0, 400), radius_m * out, -out)
    grid = Grid.of_bounds(0.25, (-9.5, -9.5, 9.5, 9.5))
    passage = Passages([track]).over(grid)
    e, n = np.meshgrid(*grid.centres_m())
    turned = (np.arctan2(n, e) - begin_rad) % (2.0 * np.pi)
    distance = np.hypot(e, n)
    inner = (abs(distance - radius_m) < 0.99) & (turned > 0.01) & (turned < 1.99)
    outer = (abs(distance - radius_m) > 1.01) | ((turned > 2.01) & (turned < 2.0 * np.pi - 0.01))
    assert passage.passed[inner].all()
    assert not passage.passed[outer].any()
    assert passage.first_s[inner] == pytest.approx(turned[inner], abs=1e-3)


def test_passages__tile_by_tile_are_those_over_the_whole() -> None:
    passages = Passages([straight(1, 100.0, 0.0), straight(2, 200.0, 1.5)])
    whole = Grid(0.1, -20, 40, (70, 140))
    told = passages.over(whole, 0.3)
    for row in (0, 35):
        part = Grid(0.1, 10, 40 - row, (35, 60))
        rows, columns = part.window_in(whole)
        assert np.array_equal(passages.over(part, 0.3).last_s, told.last_s[rows, columns])


def test_passages__of_nothing_pass_nowhere() -> None:
    nothing = Passages([])
    assert not nothing
    assert not nothing.over(Grid(0.1, 0, 10, (10, 10))).passed.any()
