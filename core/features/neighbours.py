"""Points sorted into columns for searches within a radius."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numba
import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

MOST_COLUMNS: Final = 1 << 24


@dataclass(frozen=True)
class Columns:
    """Points sorted by square columns of the plane, and by height within each.

    A search within the side of a column looks at nine columns, in each by bisection of the heights.

    Attributes:
        xyz_m: (n, 3) sorted, less `corner_m`.
        order: (n,) index of each sorted point among those given.
        starts: (columns * rows + 1,) first point of each column.
        corner_m: (3,) of the first column, and the least height.
        side_m: of a column.
        across: columns and rows.
    """

    xyz_m: FloatArray
    order: IntArray
    starts: IntArray
    corner_m: FloatArray
    side_m: float
    across: tuple[int, int]


def columns(xyz_m: FloatArray, side_m: float) -> Columns:
    """Sort points (n, 3), finite, at least one, into columns.

    Raises:
        ValueError: if they are spread over more than :data:`MOST_COLUMNS`: split them into tiles.
    """
    points = np.ascontiguousarray(xyz_m, np.float64)
    corner = points.min(axis=0)
    column, row = (int(number) + 1 for number in (points.max(axis=0)[:2] - corner[:2]) // side_m)
    if column * row > MOST_COLUMNS:
        raise ValueError(f"{column} x {row} columns of {side_m} m")
    number = _numbers(points, corner, side_m, row)
    order = np.lexsort([points[:, 2], number])
    starts = np.searchsorted(number[order], np.arange(column * row + 1))
    return Columns(points[order] - corner, order, starts, corner, side_m, (column, row))


@numba.njit(cache=True, nogil=True)
def _numbers(xyz_m, corner, side_m, rows):  # type: ignore[no-untyped-def]
    out = np.empty(len(xyz_m), np.int64)
    for i in range(len(xyz_m)):
        out[i] = int((xyz_m[i, 0] - corner[0]) // side_m) * rows + int((xyz_m[i, 1] - corner[1]) // side_m)
    return out


@numba.njit(cache=True, nogil=True, inline="always")
def first_above(xyz_m, begin, end, height_m):  # type: ignore[no-untyped-def]
    """Index of the first point between two that is not below a height."""
    while begin < end:
        middle = (begin + end) // 2
        if xyz_m[middle, 2] < height_m:
            begin = middle + 1
        else:
            end = middle
    return begin
