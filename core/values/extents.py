"""Extent of points, and the cells of a grid that hold any."""

from typing import Final, TypeVar

import numpy as np
from numpy.typing import NDArray

from furrowmap.core.runtime.arrays import FloatArray
from furrowmap.core.runtime.kernels import kernel
from furrowmap.core.runtime.record_spool import square_keys

Number = TypeVar("Number", np.float64, np.int32)
MAX_RASTER_CELLS: Final = 1 << 24
"""Cells of a raster of the extent; beyond, keys are sorted."""


def bounds(place_m: NDArray[Number]) -> tuple[NDArray[Number], NDArray[Number]]:
    """Least and greatest coordinates (k,) of points (n, k), finite, at least one; in one pass."""
    if not len(place_m):
        raise ValueError("no points have no bounds")
    low, high = _bounds(np.ascontiguousarray(place_m))
    return low, high


def cells_with_points(place_m: FloatArray, cell_m: float) -> NDArray[np.int64]:
    """Keys of the square cells, of a side, in which points (n, 2 or 3) lie, increasing.

    They are those of :func:`~furrowmap.core.runtime.record_spool.square_keys`.
    """
    if not len(place_m):
        return np.zeros(0, np.int64)
    low, high = (np.floor(end[:2] / cell_m).astype(np.int64) for end in bounds(place_m))
    columns, rows = (high - low + 1).tolist()
    if columns * rows > MAX_RASTER_CELLS:
        return np.unique(square_keys(*np.floor(place_m[:, :2].T / cell_m)))
    column, row = np.nonzero(_filled(np.ascontiguousarray(place_m), cell_m, low, np.zeros((columns, rows), np.bool_)))
    return square_keys(column + low[0], row + low[1])


@kernel()
def _bounds(place_m):  # type: ignore[no-untyped-def]
    low = place_m[0].copy()
    high = place_m[0].copy()
    for k in range(place_m.shape[1]):
        least = low[k]
        most = high[k]
        for i in range(len(place_m)):
            least = min(least, place_m[i, k])
            most = max(most, place_m[i, k])
        low[k] = least
        high[k] = most
    return low, high


@kernel()
def _filled(place_m, cell_m, low, filled):  # type: ignore[no-untyped-def]
    for i in range(len(place_m)):
        filled[int(np.floor(place_m[i, 0] / cell_m)) - low[0], int(np.floor(place_m[i, 1] / cell_m)) - low[1]] = True
    return filled
