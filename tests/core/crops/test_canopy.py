"""The default method on canopies drawn by chance: the same height for every density, and its figures."""

from __future__ import annotations

import numpy as np
import pytest
import shapely
from scipy.ndimage import gaussian_filter

from furrowmap.core.crops.canopy_height import Canopy, canopy_top
from furrowmap.core.crops.measure import parcel_figures
from furrowmap.core.surfaces.grid import Grid

NOISE_M = 0.012
NET = shapely.box(0.0, 0.0, 4.0, 2.0)


def flown(points_m2: float, seed: int = 0, lodged: bool = False, height_m: float = 0.5) -> tuple[Canopy, np.ndarray]:
    """A canopy with 3 cm from pixel to pixel, seen from above by pulses that the soil stops; and its true top."""
    rng = np.random.default_rng(seed)
    grid = Grid.of_bounds(0.04, NET.bounds)
    top = height_m + 0.03 * rng.standard_normal(grid.shape)
    if lodged:
        top[:, : grid.columns // 3] -= 0.3
    easting, northing = np.meshgrid(*grid.centres_m())
    net = shapely.contains_xy(NET, easting, northing)
    xy = rng.uniform((0, 0), (4, 2), (int(points_m2 * NET.area), 2))
    column = np.floor(xy[:, 0] / 0.04).astype(int) - grid.west
    row = grid.north - 1 - np.floor(xy[:, 1] / 0.04).astype(int)
    depth = 0.08 * rng.weibull(1.3, len(xy))
    height = np.maximum(top[row, column] - depth, 0.0) + NOISE_M * rng.standard_normal(len(xy))
    return canopy_top(xy, height, grid, net, NOISE_M), top[net]


@pytest.mark.parametrize("points_m2", [1_000, 3_000, 10_000, 30_000])
def test_canopy_top__does_not_depend_on_density(points_m2: float) -> None:
    canopy, true = flown(points_m2)
    figures = parcel_figures("1", canopy, NET.area, 0.0)
    assert figures.mean_height_m == pytest.approx(true.mean(), abs=0.004)
    assert abs(figures.mean_height_m - true.mean()) < 2.5 * figures.height_sigma_m
    assert figures.volume_m3 == pytest.approx(true.mean() * NET.area, rel=0.01)
    assert figures.points_m2 == pytest.approx(points_m2, rel=0.02)


@pytest.mark.parametrize("height_m", [0.16, 0.2])
def test_canopy_top__of_crop_so_low_that_pulses_reach_the_soil(height_m: float) -> None:
    canopy, true = flown(5_000, height_m=height_m)
    assert canopy.top_m[canopy.net].mean() == pytest.approx(true.mean(), abs=0.006)


def test_canopy_top__does_not_depend_on_returns_outside_nor_on_their_order() -> None:
    """Of a crop so low that pulses reach the soil, whose depths below it are drawn as well."""
    rng = np.random.default_rng(4)
    grid = Grid.of_bounds(0.04, NET.bounds)
    net = np.ones(grid.shape, bool)
    xy = rng.uniform((-0.5, -0.5), (4.5, 2.5), (100_000, 2))
    height = np.maximum(0.18 - 0.08 * rng.weibull(1.3, len(xy)), 0.0) + NOISE_M * rng.standard_normal(len(xy))
    inside = np.flatnonzero(np.all((xy > -0.1) & (xy < [4.1, 2.1]), axis=1))[::-1]
    every, some = canopy_top(xy, height, grid, net, NOISE_M), canopy_top(xy[inside], height[inside], grid, net, NOISE_M)
    assert every.top_m.tobytes() == some.top_m.tobytes()
    assert every.extrapolated_m == some.extrapolated_m != 0.0


def test_canopy_top__of_returns_with_horizontal_noise_is_drawn_to_that_without() -> None:
    """Plants of 1 cm with gaps between them, which returns of plants beside them hide."""
    rng = np.random.default_rng(0)
    top = 0.5 + 0.2 * gaussian_filter(rng.standard_normal((240, 440)), 2.0)
    gaps = gaussian_filter(rng.standard_normal(top.shape), 4.0)
    top[gaps > np.quantile(gaps, 0.97)] = 0.0
    xy = rng.uniform((0.0, 0.0), (4.4, 2.4), (100_000, 2))
    row, column = np.floor(xy.T[::-1] / 0.01).astype(int)
    height = np.maximum(top[row, column] - 0.08 * rng.weibull(1.3, len(xy)), 0.0)
    height += NOISE_M * rng.standard_normal(len(xy))
    grid = Grid.of_bounds(0.04, (0.2, 0.2, 4.2, 2.2))
    noisy = xy + NOISE_M * rng.standard_normal(xy.shape)
    net = np.ones(grid.shape, bool)
    true, blurred = (canopy_top(places, height, grid, net, NOISE_M).top_m.mean() for places in (xy, noisy))
    found = canopy_top(noisy, height, grid, net, NOISE_M, NOISE_M)
    assert blurred - true > 0.006
    assert 0.0 < found.top_m.mean() - true < 0.7 * (blurred - true)
    assert found.sharpened_m == pytest.approx(found.top_m.mean() - blurred, abs=1e-4)


def test_parcel_figures__of_a_dense_canopy() -> None:
    canopy, true = flown(20_000)
    figures = parcel_figures("1", canopy, NET.area, 0.003)
    assert figures.p50_m == pytest.approx(np.quantile(true, 0.5), abs=0.005)
    assert figures.p95_m == pytest.approx(np.quantile(true, 0.95), abs=0.01)
    assert figures.height_cv == pytest.approx(true.std() / true.mean(), abs=0.015)
    assert figures.roughness_m == pytest.approx(true.std(), abs=0.006)
    assert figures.cover == 1.0
    assert figures.filled < 0.001
    assert figures.area_m2 == pytest.approx(NET.area)
    assert not figures.lodging
    assert figures.height_sigma_m > figures.soil_sigma_m == 0.003
    assert figures.penetration_m == pytest.approx(0.08 * 0.924, rel=0.08)


def test_parcel_figures__mark_a_parcel_of_which_a_third_lies_down() -> None:
    assert parcel_figures("1", flown(10_000, lodged=True)[0], NET.area, 0.0).lodging


def test_parcel_figures__without_points_are_unknown() -> None:
    grid = Grid.of_bounds(0.04, NET.bounds)
    canopy = canopy_top(np.zeros((0, 2)), np.zeros(0), grid, np.ones(grid.shape, bool), NOISE_M)
    figures = parcel_figures("1", canopy, NET.area, float("nan"))
    assert np.isnan([figures.mean_height_m, figures.p95_m, figures.volume_m3, figures.height_sigma_m]).all()
    assert figures.points == 0
    assert figures.filled == 1.0


def test_canopy_top__bare_soil_has_no_height() -> None:
    rng = np.random.default_rng(2)
    grid = Grid.of_bounds(0.04, NET.bounds)
    xy = rng.uniform((0, 0), (4, 2), (40_000, 2))
    canopy = canopy_top(xy, NOISE_M * rng.standard_normal(len(xy)), grid, np.ones(grid.shape, bool), NOISE_M)
    assert canopy.penetration is None
    assert np.nanmean(canopy.top_m) < 2.0 * NOISE_M
    assert parcel_figures("1", canopy, NET.area, 0.003).cover == 0.0
