"""Heights of the returns in the pixels of a parcel: how many, the highest, and how they scatter."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numba import njit
from numpy.typing import NDArray

from furrowmap.core.crops.penetration import MOST_RETURNS
from furrowmap.core.surfaces.grid import Grid

FloatArray = NDArray[np.float64]

_FEW: Final = 48
"""Heights of a pixel that are sorted by insertion, which is faster for few."""


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
    heights, part, starts = _sorted_by_pixel(column, row, height_m, np.zeros(0, np.bool_), *grid.shape)
    return _of_part(heights, part, starts, -1, grid)


def pixel_halves(
    column: FloatArray, row: FloatArray, height_m: FloatArray, first: NDArray[np.bool_], grid: Grid
) -> tuple[PixelReturns, PixelReturns, PixelReturns]:
    """Returns by pixel: of all, of those marked by `first` (n,), and of the others; see :func:`pixel_returns`."""
    heights, part, starts = _sorted_by_pixel(column, row, height_m, first, *grid.shape)
    whole, half, other = (_of_part(heights, part, starts, which, grid) for which in (-1, 1, 0))
    return whole, half, other


def _of_part(
    heights: FloatArray, part: NDArray[np.int8], starts: NDArray[np.int64], which: int, grid: Grid
) -> PixelReturns:
    count = np.empty(grid.shape, np.int32)
    highest, means = np.empty(grid.shape), np.empty((*grid.shape, 3))
    _by_pixel(heights, part, starts, which, count, highest, means, MOST_RETURNS)
    return PixelReturns(count, highest, means)


@njit(cache=True, nogil=True)
def _highest_of(heights, end, chosen):  # type: ignore[no-untyped-def]
    """Mean of the highest of `chosen` of the first `end` sorted heights, over all choices."""
    # share of choices whose highest has rank r (1 is lowest): C(r - 1, chosen - 1) / C(end, chosen)
    share = chosen / end
    total = share * heights[end - 1]
    for rank in range(end - 1, chosen - 1, -1):
        share *= (rank + 1 - chosen) / rank
        total += share * heights[rank - 1]
    return total


@njit(cache=True, nogil=True)
def _sorted_by_pixel(column, row, height, first, rows, columns):  # type: ignore[no-untyped-def]
    """Heights by pixel, sorted within each; whether `first` marks them; and the first height of each pixel."""
    n = len(height)
    pixel = np.empty(n, np.int32)
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
    ordered, part = np.empty(starts[-1]), np.zeros(starts[-1], np.int8)
    for k in range(n):
        if pixel[k] >= 0:
            at = place[pixel[k]]
            ordered[at] = height[k]
            if len(first) and first[k]:
                part[at] = 1
            place[pixel[k]] += 1
    for p in range(rows * columns):
        begin, end = starts[p], starts[p + 1]
        if end - begin > _FEW:
            order = np.argsort(ordered[begin:end])
            ordered[begin:end], part[begin:end] = ordered[begin:end][order], part[begin:end][order]
            continue
        for k in range(begin + 1, end):
            value, mark, at = ordered[k], part[k], k
            while at > begin and ordered[at - 1] > value:
                ordered[at], part[at] = ordered[at - 1], part[at - 1]
                at -= 1
            ordered[at], part[at] = value, mark
    return ordered, part, starts


@njit(cache=True, nogil=True)
def _by_pixel(ordered, part, starts, which, count, highest, means, most):  # type: ignore[no-untyped-def]
    """Figures of the heights of one part, or of all where `which` is -1."""
    rows, columns = count.shape
    most_here = 1
    for p in range(rows * columns):
        most_here = max(most_here, starts[p + 1] - starts[p])
    heights = np.empty(most_here)
    for p in range(rows * columns):
        here = 0
        for k in range(starts[p], starts[p + 1]):
            if which < 0 or part[k] == which:
                heights[here] = ordered[k]
                here += 1
        i, j = p // columns, p % columns
        count[i, j] = here
        highest[i, j] = _highest_of(heights, here, min(here, most)) if here else np.nan
        for chosen in range(3):
            means[i, j, chosen] = _highest_of(heights, here, chosen + 1) if here >= 3 else np.nan
