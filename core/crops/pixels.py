"""Heights of the returns in the pixels of a parcel: how many, the highest, and how they scatter."""

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from furrowmap.core.runtime.arrays import FloatArray
from furrowmap.core.runtime.kernels import kernel
from furrowmap.core.surfaces.grid import Grid

MAX_RANK: Final = 8
"""Of more returns in a pixel, the mean highest of any eight of them is used."""
_INSERTED: Final = 48
"""Heights of a pixel that are sorted by insertion, which is faster for few."""
_UNMARKED: Final = np.zeros(0, np.bool_)


@dataclass(frozen=True)
class PixelReturns:
    """Returns by pixel.

    Attributes:
        count: (rows, columns) int32 number of returns.
        highest_m: (rows, columns) float64 height of the highest; with more than MAX_RANK, the mean highest of any
            MAX_RANK of them. nan without returns.
        heights_m: (n,) float64 heights by pixel, row by row, those of each in order.
        part: (n,) int8 which part of the returns they belong to.
        starts: (rows * columns + 1,) int64 first height of each pixel, and n.
        which: the part that this is about; -1 for all.
    """

    count: NDArray[np.int32]
    highest_m: FloatArray
    heights_m: FloatArray
    part: NDArray[np.int8]
    starts: NDArray[np.int64]
    which: int

    def means_m(self, where: NDArray[np.bool_]) -> FloatArray:
        """Mean height (k, 3) of one return, the higher of two, the highest of three; of pixels with three or more."""
        pixels = np.flatnonzero(where & (self.count >= 3))
        out = np.empty((len(pixels), 3))
        _means(self.heights_m, self.part, self.starts, self.which, pixels, out)
        return out


def pixel_returns(
    column: FloatArray, row: FloatArray, height_m: FloatArray, grid: Grid, first: NDArray[np.bool_] = _UNMARKED
) -> PixelReturns:
    """Returns by pixel; those outside the grid are left out.

    Args:
        column: (n,) float64 place in pixels from the western edge of the grid.
        row: (n,) float64 likewise from its northern edge.
        height_m: (n,) float64 heights, such as above the soil.
        first: (n,) the returns of the first of the :func:`pixel_halves`.
    """
    heights, part, starts = _sorted_by_pixel(column, row, np.ascontiguousarray(height_m), first, *grid.shape)
    return _of_part(heights, part, starts, -1, grid.shape)


def pixel_halves(whole: PixelReturns) -> list[PixelReturns]:
    """Of all returns by pixel, those that were marked as the first part, and the others."""
    return [_of_part(whole.heights_m, whole.part, whole.starts, which, whole.count.shape) for which in (1, 0)]


def _of_part(
    heights: FloatArray, part: NDArray[np.int8], starts: NDArray[np.int64], which: int, shape: tuple[int, ...]
) -> PixelReturns:
    count = np.empty(shape, np.int32)
    highest = np.empty(shape)
    _by_pixel(heights, part, starts, which, count.ravel(), highest.ravel(), MAX_RANK)
    return PixelReturns(count, highest, heights, part, starts, which)


@kernel()
def _highest_of(heights, end, chosen):  # type: ignore[no-untyped-def]
    """Mean of the highest of `chosen` of the first `end` sorted heights, over all choices."""
    # share of choices whose highest has rank r (1 is lowest): C(r - 1, chosen - 1) / C(end, chosen)
    share = chosen / end
    total = share * heights[end - 1]
    for rank in range(end - 1, chosen - 1, -1):
        share *= (rank + 1 - chosen) / rank
        total += share * heights[rank - 1]
    return total


@kernel()
def _sorted_by_pixel(column, row, height, first, rows, columns):  # type: ignore[no-untyped-def]
    """Heights by pixel, sorted within each; whether `first` marks them; and the first height of each pixel."""
    n = len(height)
    pixel = np.empty(n, np.int32)
    starts = np.zeros(rows * columns + 1, np.int64)
    for k in range(n):
        i = int(np.floor(row[k]))
        j = int(np.floor(column[k]))
        if 0 <= i < rows and 0 <= j < columns:
            pixel[k] = i * columns + j
            starts[pixel[k] + 1] += 1
        else:
            pixel[k] = -1
    for p in range(rows * columns):
        starts[p + 1] += starts[p]
    place = starts[:-1].copy()
    ordered = np.empty(starts[-1])
    part = np.zeros(starts[-1], np.int8)
    for k in range(n):
        if pixel[k] >= 0:
            at = place[pixel[k]]
            ordered[at] = height[k]
            if len(first) and first[k]:
                part[at] = 1
            place[pixel[k]] += 1
    for p in range(rows * columns):
        begin = starts[p]
        end = starts[p + 1]
        gap = 1 if end - begin <= _INSERTED else (end - begin) * 5 // 11
        while gap > 0:  # Shell's sort
            for k in range(begin + gap, end):
                value = ordered[k]
                mark = part[k]
                at = k - gap
                while at >= begin and ordered[at] > value:
                    ordered[at + gap] = ordered[at]
                    part[at + gap] = part[at]
                    at -= gap
                ordered[at + gap] = value
                part[at + gap] = mark
            gap = 1 if gap == 2 else gap * 5 // 11
    return ordered, part, starts


@kernel()
def _taken(ordered, part, first, end, which, heights):  # type: ignore[no-untyped-def]
    """Copy the heights of one part, or all where `which` is -1; their number."""
    here = 0
    for k in range(first, end):
        if which < 0 or part[k] == which:
            heights[here] = ordered[k]
            here += 1
    return here


@kernel()
def _most_in_a_pixel(starts):  # type: ignore[no-untyped-def]
    most = 1
    for p in range(len(starts) - 1):
        most = max(most, starts[p + 1] - starts[p])
    return most


@kernel()
def _by_pixel(ordered, part, starts, which, count, highest, most):  # type: ignore[no-untyped-def]
    """Number of returns and the highest of each pixel, of one part, or of all where `which` is -1."""
    heights = np.empty(_most_in_a_pixel(starts))
    for p in range(len(starts) - 1):
        here = _taken(ordered, part, starts[p], starts[p + 1], which, heights)
        count[p] = here
        highest[p] = np.nan
        if here:
            highest[p] = heights[here - 1] if here <= most else _highest_of(heights, here, most)


@kernel()
def _means(ordered, part, starts, which, pixels, means):  # type: ignore[no-untyped-def]
    heights = np.empty(_most_in_a_pixel(starts))
    for n in range(len(pixels)):
        p = pixels[n]
        here = _taken(ordered, part, starts[p], starts[p + 1], which, heights)
        for chosen in range(3):
            means[n, chosen] = _highest_of(heights, here, chosen + 1)
