"""Figures of parcels, against canopies whose tops are given."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.stats import norm

from furrowmap.core.crops.canopy_height import Canopy, Penetration
from furrowmap.core.crops.measure import parcel_figures
from furrowmap.core.crops.pixels import PixelReturns
from furrowmap.core.surfaces.grid import Grid

CLOSED = Penetration(1.0, 1e-9, 0.0)
"""Nothing is behind its top, and without noise."""


def canopy_of(top_m: NDArray[np.float64], seen: NDArray[np.bool_] | None = None, **others: Any) -> Canopy:
    """Tops (rows, columns) in pixels of 4 cm, of which all are net and seen by two returns."""
    seen = np.ones(top_m.shape, bool) if seen is None else seen
    count = np.where(seen, 2, 0).astype(np.int32)
    nothing = np.zeros(0)
    returns = PixelReturns(count, top_m, nothing, nothing.astype(np.int8), np.zeros(top_m.size + 1, np.int64), -1)
    grid = Grid(0.04, 0, len(top_m), top_m.shape)
    usual = {"penetration": CLOSED, "error_m": 0.0, "chance_m": 0.0}
    return Canopy(grid, np.ones(top_m.shape, bool), top_m, seen, returns, **(usual | others))


def rough(mean_m: float = 0.5, sigma_m: float = 0.03) -> NDArray[np.float64]:
    return mean_m + sigma_m * np.random.default_rng(3).standard_normal((50, 100))


def test_figures__of_tops_that_chance_does_not_spread_are_those_of_the_pixels() -> None:
    top = rough()
    found = parcel_figures("7", canopy_of(top), 8.0, 0.01)
    quantiles = (found.p50_m, found.p90_m, found.p95_m, found.p99_m)
    assert quantiles == pytest.approx(np.quantile(top, [0.5, 0.9, 0.95, 0.99]))
    assert (found.id, found.points, found.points_m2, found.area_m2) == ("7", 10_000, 1250.0, 8.0)
    assert (found.mean_height_m, found.volume_m3) == pytest.approx((top.mean(), 8.0 * top.mean()))
    assert found.height_cv == pytest.approx(top.std() / top.mean())
    assert (found.filled, found.cover, found.lodging) == (0.0, 1.0, False)


@pytest.mark.parametrize(("height_m", "stands"), [(0.099, False), (0.101, True)])
def test_cover__is_of_pixels_from_10_cm_on(height_m: float, stands: bool) -> None:
    top = np.full((50, 100), height_m)
    top[:10] = 0.0
    assert parcel_figures("1", canopy_of(top), 8.0, 0.0).cover == pytest.approx(0.8 * stands)


@pytest.mark.parametrize(("low_m", "share", "lodged"), [(0.29, 0.5, True), (0.31, 0.5, False)])
@pytest.mark.parametrize("height_m", [0.5, 1.0])
def test_lodging__is_below_six_tenths_of_the_upper_tenth(
    low_m: float, share: float, lodged: bool, height_m: float
) -> None:
    top = np.full((50, 100), height_m)
    top[:, : round(100 * share)] = 2.0 * low_m * height_m
    assert parcel_figures("1", canopy_of(top), 8.0, 0.0).lodging is lodged


@pytest.mark.parametrize(("rows", "lodged"), [(9, False), (13, True)])
def test_lodging__is_of_a_tenth_of_the_parcel(rows: int, lodged: bool) -> None:
    """Beside what stands, squares of 0.2 m are half high: of those a few rows count less than the others."""
    top = np.full((100, 50), 0.6)
    top[:rows] = 0.1
    assert parcel_figures("1", canopy_of(top), 8.0, 0.0).lodging is lodged


def test_roughness__is_about_squares_of_20_cm() -> None:
    """Stripes one pixel wide are rough, half a metre of slope is not; squares have five pixels a side."""
    column = np.arange(100)
    stripes = np.broadcast_to(0.5 + 0.02 * (-1.0) ** column, (50, 100))
    around = np.convolve(np.full(100, 1.0), np.ones(5), "same")
    off = stripes[0] - np.convolve(stripes[0], np.ones(5), "same") / around
    found = parcel_figures("1", canopy_of(stripes.copy()), 8.0, 0.0).roughness_m
    assert found == pytest.approx(off.std(), rel=1e-6)
    slope = np.broadcast_to(0.3 + 0.005 * column, (50, 100)).copy()
    assert parcel_figures("1", canopy_of(slope), 8.0, 0.0).roughness_m < 0.002


def test_chance__is_taken_out_of_what_varies() -> None:
    top = rough()
    chance_m = 0.02
    found, bare = (parcel_figures("1", canopy_of(top, chance_m=one), 8.0, 0.0) for one in (chance_m, 0.0))
    left = math.sqrt(top.var() - chance_m**2)
    assert found.height_cv == pytest.approx(left / top.mean(), rel=1e-6)
    assert found.p90_m - found.p50_m == pytest.approx((bare.p90_m - bare.p50_m) * left / top.std(), rel=1e-6)
    assert found.roughness_m == pytest.approx(math.sqrt(bare.roughness_m**2 - chance_m**2), rel=1e-6)
    # At most three quarters of the variance are chance.
    assert parcel_figures("1", canopy_of(top, chance_m=1.0), 8.0, 0.0).height_cv == pytest.approx(0.5 * bare.height_cv)


@pytest.mark.parametrize(
    ("others", "soil_m", "sigma_m"),
    [
        ({}, 0.007, 0.007),
        ({"error_m": 0.7}, 0.0, 0.7 / math.sqrt(5000)),
        ({"extrapolated_m": -0.01}, 0.0, 0.005),
        ({"sharpened_m": -0.01}, 0.0, 0.005),
        ({"penetration": Penetration(1.0, 0.2, 0.0)}, 0.0, 0.05 * 0.2),
        ({"penetration": Penetration(1.0, 1e-9, 0.02)}, 0.0, 0.15 * 0.02),
    ],
)
def test_sigma__of_an_even_canopy_is_that_of_what_alone_is_uncertain(
    others: dict[str, Any], soil_m: float, sigma_m: float
) -> None:
    found = parcel_figures("1", canopy_of(np.full((50, 100), 0.5), **others), 8.0, soil_m)
    assert found.height_sigma_m == pytest.approx(sigma_m, rel=1e-6)
    assert found.volume_sigma_m3 == pytest.approx(8.0 * sigma_m, rel=1e-6)
    assert found.common_sigma_m == pytest.approx(0.0 if soil_m or "error_m" in others else sigma_m, abs=1e-7)


def test_sigma__of_what_is_filled_is_that_of_the_lowest_pixels() -> None:
    """Nine pixels vary together; a third of the square of the mean of a normal distribution's lower tail."""
    top, seen = rough(), np.ones((50, 100), bool)
    seen[:10] = False
    found = parcel_figures("1", canopy_of(top, seen), 8.0, 0.0)
    tail = norm.pdf(norm.ppf(0.2))  # times its share: how far all of it moves the mean
    expected = top.std() * math.hypot(3.0 / math.sqrt(4000), tail / math.sqrt(3.0))
    assert found.height_sigma_m == pytest.approx(expected, rel=1e-6)
    assert found.filled == pytest.approx(0.2)
    assert found.points == 8000
