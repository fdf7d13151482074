"""How deep pulses enter a canopy before they return, estimated from the parcel itself.

A pulse that enters the canopy returns from depth d below the top with probability 1 − exp(−(d / s)^a): the law of Beer
and Lambert with an optical depth that grows as a power of the depth (a = 1: leaves as dense at the tips as below;
a > 1: less dense there). The height of a return within a pixel is the height of the top, less this depth, plus noise.

Shape a and scale s follow from the second and third L-moment of the heights within pixels (J. R. M. Hosking (1990),
L-moments: analysis and estimation of distributions using linear combinations of order statistics, J. R. Statist. Soc.
B 52, 105-124). Their sample values are unbiased for any number of points, and so the estimate does not depend on
density. With both known, the distance from the highest of n returns to the top is known for every n, noise included.
"""

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import Final

import numpy as np
from numpy.typing import ArrayLike

from furrowmap.core.crops.pixels import MAX_RANK
from furrowmap.core.runtime.arrays import FloatArray

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

    Args:
        second_m: second L-moment, half the mean distance of two returns.
        third_m: third L-moment; negative where the deep returns lie farther from the others.
    """
    table, noise = penetration_table(), max(noise_m, 1e-4)
    wanted, skewness = math.log(max(second_m / noise, 1e-6)), third_m / second_m
    # By shape: the second L-moment over the noise falls with the noise, and the skewness grows with the shape.
    ratios = [np.interp(-wanted, -second, table.noises) for second in table.second]
    found = [np.interp(*at, of) for at, of in zip(((r, table.noises) for r in ratios), table.skewness, strict=True)]
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
        (i, u), (j, v) = _place(self.shapes, shape), _place(self.noises, noise)
        low = (1.0 - v) * values[i, j] + v * values[i, j + 1]
        high = (1.0 - v) * values[i + 1, j] + v * values[i + 1, j + 1]
        out: FloatArray = (1.0 - u) * low + u * high
        return out


def _place(grid: FloatArray, value: float) -> tuple[int, float]:
    """Index of the interval of a grid that holds a value, and the share of it below the value."""
    i = int(np.clip(np.searchsorted(grid, value, side="right") - 1, 0, len(grid) - 2))
    return i, float(np.clip((value - grid[i]) / (grid[i + 1] - grid[i]), 0.0, 1.0))


@lru_cache(maxsize=1)
def penetration_table() -> _Table:
    """The table, which takes 0.3 s; threads that need it first at the same time would each calculate it."""
    from scipy.special import gammainc, ndtr

    shapes, noises = np.geomspace(*SHAPES, _STEPS[0]), np.geomspace(0.02, 1.0, _STEPS[1])
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
