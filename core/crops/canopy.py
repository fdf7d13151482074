"""Height of the canopy's top in the pixels of a parcel, without a bias by density, noise or penetration."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from furrowmap.core.crops.penetration import MOST_RETURNS, Penetration, l_moments_of, penetration_of
from furrowmap.core.crops.pixels import PixelReturns, pixel_returns
from furrowmap.core.crops.published import filled
from furrowmap.core.surfaces.grid import Grid

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]

PIXEL_M: Final = 0.04
BARE_SIGMAS: Final = 4.0
"""Pixels whose highest return lies no more than this many standard deviations of the noise above the soil are bare."""
CHANCE_SHARE: Final = 0.5
"""Of the variance within pixels: the rest is that of the plants in a pixel, which its highest return shows rightly."""
FEWEST_PIXELS: Final = 200
"""With three returns or more, that the penetration is estimated from."""


@dataclass(frozen=True)
class Canopy:
    """The canopy of one parcel.

    Attributes:
        grid: of the pixels.
        net: (rows, columns) pixels whose middle lies in the net parcel.
        top_m: (rows, columns) height of the top above the soil; nan outside, and where nothing is known.
        seen: (rows, columns) net pixels with returns; the others are filled.
        returns: by pixel.
        penetration: of the canopy; None with too few pixels.
        error_m: standard deviation of the top of one pixel by the model, on average.
        chance_m: how much wider than those of well-seen pixels chance spreads the tops.
        extrapolated_m: change of the mean height by extrapolation to many returns.
    """

    grid: Grid
    net: BoolArray
    top_m: FloatArray
    seen: BoolArray
    returns: PixelReturns
    penetration: Penetration | None
    error_m: float
    chance_m: float
    extrapolated_m: float = 0.0


def canopy_top(xy_m: FloatArray, height_m: FloatArray, grid: Grid, net: BoolArray, noise_m: float) -> Canopy:
    """The top of a canopy: the highest return of each pixel, raised by what the penetration of the parcel says.

    What is left of the influence of density (low pixels are hit less often, and are missing) falls with the number of
    returns: it is taken from the difference to the same estimate with half of the returns (M. H. Quenouille (1956),
    Notes on bias in estimation, Biometrika 43, 353-360).

    Args:
        xy_m: (n, 2) easting and northing of returns.
        height_m: (n,) their heights above the soil.
        grid: of the pixels.
        net: (rows, columns) the pixels that count.
        noise_m: standard deviation of heights of returns from one place.
    """
    column, row = xy_m[:, 0] / grid.cell_m - grid.west, grid.north - xy_m[:, 1] / grid.cell_m
    whole = _once(column, row, height_m, grid, net, noise_m)
    if whole.penetration is None:
        return whole
    first = np.random.default_rng(len(xy_m)).random(len(xy_m)) < 0.5
    halves = [_once(column[part], row[part], height_m[part], grid, net, noise_m) for part in (first, ~first)]
    if any(half.penetration is None for half in halves):
        return whole
    mean = float(whole.top_m[net].mean())
    extrapolated = mean - float(np.mean([half.top_m[net].mean() for half in halves]))
    crop = net & (whole.top_m > BARE_SIGMAS * noise_m)
    top = whole.top_m + np.where(crop, extrapolated * net.sum() / max(int(crop.sum()), 1), 0.0)
    return replace(whole, top_m=np.where(net, np.maximum(top, 0.0), np.nan), extrapolated_m=extrapolated)


def _once(
    column: FloatArray, row: FloatArray, height_m: FloatArray, grid: Grid, net: BoolArray, noise_m: float
) -> Canopy:
    """The top from all of some returns, without extrapolation."""
    returns = pixel_returns(column, row, height_m, grid)
    seen = net & (returns.count > 0)
    crop = seen & (returns.highest_m > BARE_SIGMAS * noise_m)
    found = _penetration(returns, crop, noise_m)
    top = np.where(seen, np.maximum(returns.highest_m, 0.0), np.nan)
    error = chance = 0.0
    if found is not None:
        number = np.minimum(returns.count[crop], MOST_RETURNS)
        top[crop] += found.top_above_highest_m()[number]
        variance = found.spread_of_highest_m() ** 2
        error = float(np.sqrt(variance[number].mean()))
        chance = float(np.sqrt(CHANCE_SHARE * np.maximum(variance[number] - variance[MOST_RETURNS], 0.0).mean()))
    return Canopy(grid, net, _without_gaps(top, net), seen, returns, found, error, chance)


def _penetration(returns: PixelReturns, crop: BoolArray, noise_m: float) -> Penetration | None:
    """The penetration from the crop's pixels with three returns or more; None with too few."""
    enough = crop & (returns.count >= 3)
    if enough.sum() < FEWEST_PIXELS:
        return None
    one, two, three = returns.means_m[enough].mean(axis=0)
    _, second, third = l_moments_of(one, two, three)
    return penetration_of(float(second), float(third), noise_m)


def _without_gaps(top: FloatArray, net: BoolArray) -> FloatArray:
    """Net pixels without returns: the mean of their neighbours where six of eight are known, else of all."""
    whole = np.where(net, filled(top), np.nan)
    missing = net & np.isnan(whole)
    if missing.any() and not missing[net].all():
        whole[missing] = np.nanmean(whole)
    return whole
