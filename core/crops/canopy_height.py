"""Height of the canopy's top in the pixels of a parcel, without a bias by density, noise or penetration."""

import math
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Final

import numpy as np
from numpy.typing import ArrayLike

from furrowmap.core.crops.pixels import MAX_RANK, PixelReturns, pixel_halves, pixel_returns
from furrowmap.core.crops.published import fill_pixels
from furrowmap.core.runtime.arrays import BoolArray, FloatArray
from furrowmap.core.runtime.kernels import kernel
from furrowmap.core.surfaces.grid import Grid

SHAPES: Final = (0.8, 4.0)
"""Range of the shape: from leaves denser at the tips than below to nearly a closed surface."""
MODEL_SHARE: Final = 0.05
"""Standard deviation of the mean depth by the form of the law, as a share: what a gamma law and elements of equal
density with scattered tops give from the same L-moments differs by that."""
_STEPS: Final = (25, 31)
_QUANTILES: Final = 100


@dataclass(frozen=True)
class Penetration:
    """Penetration of a canopy.

    Attributes:
        shape: exponent a of the law; 1 is Beer and Lambert's with constant density.
        scale_m: depth s at which 1/e of the pulses are left.
        noise_m: standard deviation of the heights of returns from one place.
    """

    shape: float
    scale_m: float
    noise_m: float

    @property
    def mean_depth_m(self) -> float:
        """Mean depth of a return below the top."""
        return self.scale_m * math.gamma(1.0 + 1.0 / self.shape)

    def top_above_highest_m(self) -> FloatArray:
        """(MAX_RANK + 1,) mean height of the top above the highest of n returns, for each n; nan for none."""
        highest = penetration_table().at(penetration_table().highest, self.shape, self.noise_m / self.scale_m)
        return np.append(np.nan, -self.scale_m * highest)

    def spread_of_highest_m(self) -> FloatArray:
        """(MAX_RANK + 1,) standard deviation of the highest of n returns, for each n; nan for none."""
        variance = penetration_table().at(penetration_table().variance, self.shape, self.noise_m / self.scale_m)
        return np.append(np.nan, self.scale_m * np.sqrt(np.maximum(variance, 0.0)))


def estimate_penetration(second_m: float, third_m: float, noise_m: float) -> Penetration:
    """The penetration of a canopy from L-moments of heights within pixels.

    Where the heights scatter no more than the noise, the canopy is closed: the scale is the smallest in the table.
    `second_m` is half the mean distance of two returns; `third_m` is negative where the deep returns lie farther from
    the others.
    """
    table = penetration_table()
    noise = max(noise_m, 1e-4)
    wanted = math.log(max(second_m / noise, 1e-6))
    skewness = third_m / second_m
    # By shape: the second L-moment over the noise falls with the noise, and the skewness grows with the shape.
    after = np.clip((table.second > wanted).sum(axis=1), 1, len(table.noises) - 1)
    sides = np.arange(len(after)), np.array([after - 1, after])
    low, high = table.second[sides]
    share = np.clip((low - wanted) / (low - high), 0.0, 1.0)
    ratios, found = ((1.0 - share) * of[0] + share * of[1] for of in (table.noises[sides[1]], table.skewness[sides]))
    shape = np.interp(skewness, found, table.shapes)
    ratio = np.interp(shape, table.shapes, ratios)
    return Penetration(float(shape), noise / float(ratio), noise_m)


@dataclass(frozen=True)
class _Table:
    """Moments of the law with scale 1, by shape and noise."""

    shapes: FloatArray  # (k,)
    noises: FloatArray  # (m,)
    highest: FloatArray  # (k, m, MAX_RANK) mean of the highest of n returns; the top is at 0
    variance: FloatArray  # (k, m, MAX_RANK) of the same
    second: FloatArray  # (k, m) logarithm of the second L-moment over the noise
    skewness: FloatArray  # (k, m) third L-moment over the second

    def at(self, values: FloatArray, shape: float, noise: float) -> FloatArray:
        """Values (k, m, n) of the table at a shape and a noise, bilinear."""
        i, u = _place(self.shapes, shape)
        j, v = _place(self.noises, noise)
        low = (1.0 - v) * values[i, j] + v * values[i, j + 1]
        high = (1.0 - v) * values[i + 1, j] + v * values[i + 1, j + 1]
        out: FloatArray = (1.0 - u) * low + u * high
        return out


def _place(grid: FloatArray, value: float) -> tuple[int, float]:
    """Index of the interval of a grid that holds a value, and the share of it below the value."""
    i = min(max(int(np.searchsorted(grid, value, side="right")) - 1, 0), len(grid) - 2)
    return i, min(max(float((value - grid[i]) / (grid[i + 1] - grid[i])), 0.0), 1.0)


@lru_cache(maxsize=1)
def penetration_table() -> _Table:
    """The table, which takes 0.3 s; threads that need it first at the same time would each calculate it."""
    from scipy.special import gammainc, ndtr

    shapes = np.geomspace(*SHAPES, _STEPS[0])
    noises = np.geomspace(0.02, 1.0, _STEPS[1])
    thickness = -np.log1p(-np.arange(_QUANTILES) / _QUANTILES)  # optical, where equal shares of the pulses return
    number = np.arange(1, MAX_RANK + 1)[:, None]
    highest, variance = np.empty((2, *_STEPS, MAX_RANK))
    for i, shape in enumerate(shapes):
        order = 1.0 + 1.0 / shape
        depth = _QUANTILES * math.gamma(order) * np.diff(gammainc(order, thickness), append=1.0)  # mean of each share
        for j, noise in enumerate(noises):
            x = np.linspace(-depth[-1] - 5.0 * noise, 5.0 * noise, 201)
            below = ndtr((x[:, None] + depth) / noise).mean(axis=1) ** number
            highest[i, j] = x[-1] - np.trapezoid(below, x, axis=1)
            square = x[-1] ** 2 - 2.0 * np.trapezoid(x * below, x, axis=1)
            variance[i, j] = square - highest[i, j] ** 2
    _, second, third = l_moments_of(*(highest[..., n] for n in range(3)))
    return _Table(shapes, noises, highest, variance, np.log(second / noises), third / second)


def l_moments_of(one: ArrayLike, two: ArrayLike, three: ArrayLike) -> tuple[FloatArray, FloatArray, FloatArray]:
    """The first three L-moments from the means of one value, of the higher of two, of the highest of three."""
    a, b, c = (np.asarray(values, np.float64) for values in (one, two, three))
    return a, b - a, 2.0 * c - 3.0 * b + a


CROP_PIXEL_M: Final = 0.04
BARE_SIGMAS: Final = 4.0
"""Pixels whose highest return lies no more than this many standard deviations of the noise above the soil are bare."""
CHANCE_SHARE: Final = 0.5
"""Of the variance within pixels: the rest is that of the plants in a pixel, which its highest return shows rightly."""
MIN_SOIL_SHARE: Final = 0.01
"""Share of the returns that meet soil below crop above which the penetration accounts for them."""
SOIL_ROUNDS: Final = 6
"""In which the penetration and how deep those returns would be are estimated in turn."""
MIN_CROP_PIXELS: Final = 200
"""With three returns or more, that the penetration is estimated from."""


@dataclass(frozen=True)
class Canopy:
    """The canopy of one parcel.

    Attributes:
        net: (rows, columns) pixels whose middle lies in the net parcel.
        top_m: (rows, columns) height of the top above the soil; nan outside, and where nothing is known.
        seen: (rows, columns) net pixels with returns; the others are filled.
        error_m: standard deviation of the top of one pixel by the model, on average.
        chance_m: how much wider than those of well-seen pixels chance spreads the tops.
        extrapolated_m: change of the mean height by extrapolation to many returns.
        sharpened_m: change of the mean height by extrapolation to returns without horizontal noise.
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
    sharpened_m: float = 0.0


def canopy_top(
    xy_m: FloatArray, height_m: FloatArray, grid: Grid, net: BoolArray, noise_m: float, blur_m: float = 0.0
) -> Canopy:
    """The top of a canopy: the highest return of each pixel, raised by what the penetration of the parcel says.

    What is left of the influence of density (low pixels are hit less often, and are missing) falls with the number of
    returns: it is taken from the difference to the same estimate with half of the returns (M. H. Quenouille (1956),
    Notes on bias in estimation, Biometrika 43, 353-360).

    Horizontal noise moves returns of tall plants into the pixels of low ones and of gaps, whose highest returns they
    become. This bias grows with the variance of that noise: it is taken from the change that as much noise makes once
    more (J. R. Cook, L. A. Stefanski (1994), Simulation-extrapolation estimation in parametric measurement error
    models, J. Am. Stat. Assoc. 89, 1314-1328).

    Args:
        xy_m: (n, 2) easting and northing of returns.
        height_m: (n,) their heights above the soil.
        net: (rows, columns) the pixels that count.
        noise_m: standard deviation of heights of returns from one place.
        blur_m: standard deviation of their places on each horizontal axis.
    """
    column = xy_m[:, 0] / grid.cell_m - grid.west
    row = grid.north - xy_m[:, 1] / grid.cell_m
    first = _drawn(xy_m, 0) < 0.5
    returns = pixel_returns(column, row, height_m, grid, first)
    whole = _estimate_top(returns, grid, net, noise_m)
    bare_m = BARE_SIGMAS * noise_m
    soil = np.zeros(len(height_m), np.bool_)
    low = np.flatnonzero(height_m <= bare_m)
    i, j = (np.floor(place[low]).astype(np.int64) for place in (row, column))
    inside = (i >= 0) & (j >= 0) & (i < whole.grid.shape[0]) & (j < whole.grid.shape[1])
    i = i[inside]
    j = j[inside]
    low = low[inside]
    soil[low] = whole.net[i, j] & (whole.returns.highest_m[i, j] > bare_m)
    chance = -np.log1p(-_drawn(xy_m[soil], 1))
    for _ in range(SOIL_ROUNDS if len(chance) > MIN_SOIL_SHARE * returns.count[net].sum() else 0):
        if whole.penetration is None:
            break
        height_m = _extend_below(whole, height_m, soil, bare_m, chance)
        returns = pixel_returns(column, row, height_m, grid, first)
        whole = _estimate_top(returns, grid, net, noise_m)
    if whole.penetration is None:
        return whole
    halves = [_estimate_top(part, grid, net, noise_m) for part in pixel_halves(returns)]
    if any(half.penetration is None for half in halves):
        return whole
    mean = float(whole.top_m[net].mean())
    extrapolated = mean - float(np.mean([half.top_m[net].mean() for half in halves]))
    sharpened = 0.0
    if blur_m > 0.0:
        away = blur_m / grid.cell_m * np.sqrt(-2.0 * np.log1p(-_drawn(xy_m, 2)))
        turn = 2.0 * math.pi * _drawn(xy_m, 3)
        east = away * np.cos(turn)
        south = away * np.sin(turn)
        # of both signs, by which the change scatters less
        moved = [pixel_returns(column + sign * east, row + sign * south, height_m, grid) for sign in (1.0, -1.0)]
        sharpened = mean - float(np.mean([_estimate_top(part, grid, net, noise_m).top_m[net].mean() for part in moved]))
    crop = net & (whole.top_m > bare_m)
    raised = (extrapolated + sharpened) * net.sum() / max(int(crop.sum()), 1)
    top = np.where(net, np.maximum(whole.top_m + np.where(crop, raised, 0.0), 0.0), np.nan)
    return replace(whole, top_m=top, extrapolated_m=extrapolated, sharpened_m=sharpened)


def _drawn(xy_m: FloatArray, draw: int) -> FloatArray:
    """Numbers (n,) from 0 to 1 drawn by the places (n, 2) of returns, so that other returns do not change them.

    Each is a hash of both coordinates: the generator SplitMix64 of G. L. Steele, D. Lea, C. H. Flood (2014), Fast
    splittable pseudorandom number generators, OOPSLA, 453-472. Another `draw` gives independent numbers.
    """
    mixed = np.full(len(xy_m), draw, np.uint64)
    for bits in np.ascontiguousarray(xy_m.T, np.float64).view(np.uint64):
        mixed = (mixed ^ bits) + np.uint64(0x9E3779B97F4A7C15)
        for shift, factor in ((30, 0xBF58476D1CE4E5B9), (27, 0x94D049BB133111EB)):
            mixed = (mixed ^ (mixed >> np.uint64(shift))) * np.uint64(factor)
        mixed ^= mixed >> np.uint64(31)
    out: FloatArray = (mixed >> np.uint64(11)).astype(np.float64) * 2.0**-53
    return out


def _extend_below(
    canopy: Canopy, height_m: FloatArray, soil: BoolArray, bare_m: float, chance: FloatArray
) -> FloatArray:
    """Heights (n,) in which the k pulses that met soil go on as through a crop without end, deeper by `chance` (k,)."""
    # The law of the penetration knows no soil: of a low crop it would be too steep, with the top too high.
    found = canopy.penetration
    assert found is not None
    top = canopy.top_m[canopy.net]
    mean = float(top[top > bare_m].mean())
    optical = (max(mean - bare_m, 0.0) / found.scale_m) ** found.shape + chance
    out = height_m.copy()
    out[soil] = mean - found.scale_m * optical ** (1.0 / found.shape)
    return out


def _estimate_top(returns: PixelReturns, grid: Grid, net: BoolArray, noise_m: float) -> Canopy:
    """The top from some returns, without extrapolation."""
    seen = net & (returns.count > 0)
    bare_m = BARE_SIGMAS * noise_m
    means = returns.means_m(seen & (returns.highest_m > bare_m))
    found = None
    if len(means) >= MIN_CROP_PIXELS:
        _, second, third = l_moments_of(*means.mean(axis=0))
        found = estimate_penetration(float(second), float(third), noise_m)
    raise_m = found.top_above_highest_m() if found is not None else np.zeros(MAX_RANK + 1)
    variance = found.spread_of_highest_m() ** 2 if found is not None else np.zeros(MAX_RANK + 1)
    top = np.empty(grid.shape)
    number = _raise_tops(returns.count, returns.highest_m, net, bare_m, raise_m, top)
    top = fill_pixels(top)
    _fill_with_mean(top, net)
    error = chance = 0.0
    if found is not None:
        share = number[1:] / number.sum()
        error = math.sqrt(float(share @ variance[1:]))
        excess = float(share @ np.maximum(variance[1:] - variance[MAX_RANK], 0.0))
        chance = math.sqrt(CHANCE_SHARE * excess)
    return Canopy(grid, net, top, seen, returns, found, error, chance)


@kernel()
def _raise_tops(count, highest, net, bare, by, top):  # type: ignore[no-untyped-def]
    """Tops of net pixels with returns, those of crop raised; number of these by returns, the last has more."""
    most = len(by) - 1
    number = np.zeros(most + 1)
    for i in range(count.shape[0]):
        for j in range(count.shape[1]):
            top[i, j] = np.nan
            if net[i, j] and count[i, j]:
                top[i, j] = max(highest[i, j], 0.0)
                if highest[i, j] > bare:
                    n = min(count[i, j], most)
                    top[i, j] += by[n]
                    number[n] += 1.0
    return number


@kernel()
def _fill_with_mean(top, net):  # type: ignore[no-untyped-def]
    """Set unknown net pixels to the mean of the known ones, and all others to nan."""
    total = 0.0
    known = 0
    for i in range(top.shape[0]):
        for j in range(top.shape[1]):
            if not net[i, j]:
                top[i, j] = np.nan
            elif not np.isnan(top[i, j]):
                total += top[i, j]
                known += 1
    for i in range(top.shape[0]):
        for j in range(top.shape[1]):
            if known and net[i, j] and np.isnan(top[i, j]):
                top[i, j] = total / known
