"""Points sorted into columns for searches within a radius."""

from typing import Final, NamedTuple

import numpy as np

from furrowmap.core.runtime.arrays import FloatArray, IntArray
from furrowmap.core.runtime.kernels import kernel
from furrowmap.core.values.extents import bounds

MAX_COLUMNS: Final = 1 << 24
INSERTED: Final = 24
"""Points of a column up to which they are sorted by insertion."""


class PointColumns(NamedTuple):
    """Points sorted by square columns of the plane, and by height within each.

    A search within the side of a column looks at nine columns, in each by bisection of the heights.

    Attributes:
        xyz_m: (n, 3) sorted, less `corner_m`.
        order: (n,) index of each sorted point among those given.
        starts: (columns * rows + 1,) first point of each column.
        corner_m: (3,) of the first column, and the least height.
        across: columns and rows.
    """

    xyz_m: FloatArray
    order: IntArray
    starts: IntArray
    corner_m: FloatArray
    side_m: float
    across: tuple[int, int]


def sort_into_columns(xyz_m: FloatArray, side_m: float) -> PointColumns:
    """Sort points (n, 3), finite, at least one, into columns. Raises ValueError for more than :data:`MAX_COLUMNS`."""
    points = np.ascontiguousarray(xyz_m, np.float64)
    corner, high = bounds(points)
    column, row = (int(number) + 1 for number in (high[:2] - corner[:2]) // side_m)
    if column * row > MAX_COLUMNS:
        raise ValueError(f"{column} x {row} columns of {side_m} m")
    order, starts = _sort_columns(points, corner, side_m, column, row)
    return PointColumns(points[order] - corner, order, starts, corner, side_m, (column, row))


@kernel()
def _sort_columns(xyz_m, corner, side_m, across, rows):  # type: ignore[no-untyped-def]
    """Order by column, then height; first point of each column. Points of one height keep their order."""
    n = len(xyz_m)
    number = np.empty(n, np.int64)
    order = np.empty(n, np.int64)
    starts = np.zeros(across * rows + 1, np.int64)
    for i in range(n):
        number[i] = int((xyz_m[i, 0] - corner[0]) // side_m) * rows + int((xyz_m[i, 1] - corner[1]) // side_m)
        starts[number[i] + 1] += 1
    for k in range(across * rows):
        starts[k + 1] += starts[k]
    place = starts[:-1].copy()
    for i in range(n):
        order[place[number[i]]] = i
        place[number[i]] += 1
    height = np.empty(n)
    for k in range(n):
        height[k] = xyz_m[order[k], 2]
    for k in range(across * rows):
        begin = starts[k]
        end = starts[k + 1]
        gap = 1 if end - begin <= INSERTED else (end - begin) * 5 // 11
        while gap > 0:  # Shell's sort
            for i in range(begin + gap, end):
                z = height[i]
                one = order[i]
                j = i - gap
                while j >= begin and (height[j] > z or (height[j] == z and order[j] > one)):
                    height[j + gap] = height[j]
                    order[j + gap] = order[j]
                    j -= gap
                height[j + gap] = z
                order[j + gap] = one
            gap = 1 if gap == 2 else gap * 5 // 11
    return order, starts


@kernel(inline="always")
def first_above(xyz_m, begin, end, height_m):  # type: ignore[no-untyped-def]
    """Index of the first point between two that is not below a height."""
    while begin < end:
        middle = (begin + end) // 2
        if xyz_m[middle, 2] < height_m:
            begin = middle + 1
        else:
            end = middle
    return begin
