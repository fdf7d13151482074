"""Slope, shade and roughness against planes and noise whose figures are known."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from furrowmap.core.surfaces.grid import Grid, Surface
from furrowmap.core.surfaces.terrain import gradient, hillshade, random_roughness, slope_deg

RISES = st.floats(-1.5, 1.5)


def surface_of(grid: Grid, height_m: NDArray[np.float64]) -> Surface:
    """Heights, each told by one return."""
    nothing = np.full(grid.shape, np.nan, np.float32)
    count = np.isfinite(height_m).astype(np.uint32)
    return Surface(grid, height_m.astype(np.float32), count, nothing, nothing)


def plane(east: float, north: float, cell_m: float) -> NDArray[np.float64]:
    row, column = np.indices((6, 8))
    return cell_m * (east * column - north * row)


@given(RISES, RISES, st.sampled_from([0.05, 0.5, 2.0]))
def test_slope__of_a_plane_is_its_own(east: float, north: float, cell_m: float) -> None:
    height = plane(east, north, cell_m)
    for found, true in zip(gradient(height, cell_m), (east, north), strict=True):
        np.testing.assert_allclose(found[1:-1, 1:-1], true, atol=1e-9)
        assert np.isnan(found[[0, -1]]).all()
    steepness = math.degrees(math.atan(math.hypot(east, north)))
    np.testing.assert_allclose(slope_deg(height, cell_m)[1:-1, 1:-1], steepness, atol=1e-3)


@given(RISES, RISES, st.floats(0.0, 360.0), st.floats(5.0, 90.0))
def test_hillshade__of_a_plane_is_the_cosine_between_lamp_and_normal(
    east: float, north: float, azimuth_deg: float, altitude_deg: float
) -> None:
    azimuth, altitude = math.radians(azimuth_deg), math.radians(altitude_deg)
    lamp = np.array(
        [math.cos(altitude) * math.sin(azimuth), math.cos(altitude) * math.cos(azimuth), math.sin(altitude)]
    )
    normal = np.array([-east, -north, 1.0]) / math.sqrt(1.0 + east**2 + north**2)
    expected = 1.0 + 254.0 * max(0.0, float(lamp @ normal))
    shade = hillshade(plane(east, north, 0.5), 0.5, azimuth_deg, altitude_deg)
    assert np.abs(shade[1:-1, 1:-1] - expected).max() <= 0.5 + 1e-6
    assert (shade[[0, -1]] == 0).all()


def test_gradient__has_none_beside_a_gap_or_on_a_strip() -> None:
    height = plane(0.1, 0.2, 1.0)
    height[2, 3] = np.nan
    around = np.zeros(height.shape, bool)
    around[1:4, 2:5] = True
    east, _ = gradient(height, 1.0)
    assert np.array_equal(np.isnan(east[1:-1, 1:-1]), around[1:-1, 1:-1])
    assert np.isnan(gradient(height[:2], 1.0)).all()


@pytest.mark.parametrize("heading_deg", [None, 0.0, 90.0, 37.0])
def test_random_roughness__is_that_of_the_soil_without_slope_and_furrows(heading_deg: float | None) -> None:
    grid = Grid(0.05, 332_000, -1_930_000, (160, 160))
    rng = np.random.default_rng(9)
    east, north = np.meshgrid(*grid.centres_m())
    height = 271.0 + 0.08 * (east - 16_600.0) - 0.05 * (north + 96_500.0) + rng.normal(0.0, 0.015, grid.shape)
    if heading_deg is not None:
        heading = math.radians(heading_deg)
        across = east * math.cos(heading) - north * math.sin(heading)
        height += 0.04 * np.sin(2.0 * np.pi * across / 0.35)
    plots, roughness = random_roughness(surface_of(grid, height), 1.0, heading_deg)
    assert plots.shape == (8, 8)
    # Strips as wide as a cell hold a part of the furrow's rise where they lie askew.
    assert np.sqrt(np.mean(roughness.astype(np.float64) ** 2)) == pytest.approx(
        0.015, rel=0.03 if heading_deg in {None, 0.0, 90.0} else 0.25
    )


def test_random_roughness__leaves_plots_open_that_are_hardly_seen() -> None:
    grid = Grid(0.1, 0, 20, (20, 20))
    height = np.random.default_rng(1).normal(0.0, 0.01, grid.shape)
    height[:10, :6] = np.nan
    plots, roughness = random_roughness(surface_of(grid, height))
    assert plots.shape == (2, 2)
    assert np.array_equal(np.isnan(roughness), [[True, False], [False, False]])
