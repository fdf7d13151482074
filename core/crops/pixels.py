"""Heights of the returns in the pixels of a parcel: how many, the highest, and how they scatter."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from furrowmap.core.crops.penetration import MOST_RETURNS
from furrowmap.core.surfaces.grid import Grid

FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class PixelReturns:
    """Returns by pixel; all arrays (rows, columns).

    Attributes:
        count: int32 number of returns.
        highest_m: float64 height of the highest; with more than MOST_RETURNS, the mean highest of any MOST_RETURNS of
            them. nan without returns.
        means_m: (rows, columns, 3) float64 mean height of one return, of the higher of any two, of the highest of any
            three; nan with fewer than three.
    """

    count: NDArray[np.int32]
    highest_m: FloatArray
    means_m: FloatArray


def pixel_returns(column: FloatArray, row: FloatArray, height_m: FloatArray, grid: Grid) -> PixelReturns:
    """Returns by pixel.

    Args:
        column: (n,) float64 place in pixels from the western edge of the grid.
        row: (n,) float64 likewise from its northern edge.
        height_m: (n,) float64 heights, such as above the soil.
        grid: of the pixels; returns outside are left out.
    """
    count = np.zeros(grid.shape, np.int32)
    highest, means = np.full(grid.shape, np.nan), np.full((*grid.shape, 3), np.nan)
    _by_pixel(column, row, height_m, count, highest, means, MOST_RETURNS)
    return PixelReturns(count, highest, means)


@njit(cache=True, nogil=True)
def _highest_of(heights, first, end, chosen):  # type: ignore[no-untyped-def]
    """Mean of the highest of `chosen` of the sorted heights from `first` to `end` - 1, over all choices."""
    n = end - first
    # share of choices whose highest has rank r (1 is lowest): C(r - 1, chosen - 1) / C(n, chosen)
    share = chosen / n
    total = share * heights[end - 1]
    for rank in range(n - 1, chosen - 1, -1):
        share *= (rank + 1 - chosen) / rank
        total += share * heights[first + rank - 1]
    return total


@njit(cache=True, nogil=True)
def _by_pixel(column, row, height, count, highest, means, most):  # type: ignore[no-untyped-def]
    rows, columns = count.shape
    n = len(height)
    pixel = np.empty(n, np.int64)
    starts = np.zeros(rows * columns + 1, np.int64)
    for k in range(n):
        i, j = int(np.floor(row[k])), int(np.floor(column[k]))
        if 0 <= i < rows and 0 <= j < columns:
            pixel[k] = i * columns + j
            starts[pixel[k] + 1] += 1
        else:
            pixel[k] = -1
    for p in range(rows * columns):
        starts[p + 1] += starts[p]
    place = starts[:-1].copy()
    ordered = np.empty(starts[-1])
    for k in range(n):
        if pixel[k] >= 0:
            ordered[place[pixel[k]]] = height[k]
            place[pixel[k]] += 1
    for p in range(rows * columns):
        first, end = starts[p], starts[p + 1]
        here = end - first
        i, j = p // columns, p % columns
        count[i, j] = here
        if here == 0:
            continue
        if here > 1:
            ordered[first:end].sort()
        highest[i, j] = _highest_of(ordered, first, end, min(here, most))
        if here >= 3:
            for chosen in range(3):
                means[i, j, chosen] = _highest_of(ordered, first, end, chosen + 1)
