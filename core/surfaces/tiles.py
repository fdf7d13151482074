"""Points square by square, each with the points in a margin."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

_SHORT: Final = 1 << 16
_BESIDE: Final = [(i, j) for i in (-1.0, 0.0, 1.0) for j in (-1.0, 0.0, 1.0) if i or j]


@dataclass(frozen=True)
class PointTile:
    """A square of the map: the indices of its points (m,), and these followed by those in the margin (k,)."""

    own: NDArray[np.intp]
    members: NDArray[np.intp]


def tiles(xyz_m: NDArray[np.float64], tile_m: float, margin_m: float) -> Iterator[PointTile]:
    """The squares that hold finite points (n, 2 or 3), each with the points in a margin of at most its side."""
    if not 0.0 <= margin_m <= tile_m:
        raise ValueError(f"a margin of {margin_m} m round squares of {tile_m} m")
    if not len(xyz_m):
        return
    (columns, column), (rows, row) = (_number_values(np.floor(axis / tile_m)) for axis in xyz_m[:, :2].T)
    key = column * len(rows) + row
    if len(columns) * len(rows) <= _SHORT:
        key = key.astype(np.uint16)  # numpy sorts short numbers by their digits, several times as fast
    order = np.argsort(key, kind="stable")
    keys, first = np.unique(key[order], return_index=True)
    squares = [(float(columns[k // len(rows)]), float(rows[k % len(rows)])) for k in keys.tolist()]
    parts = dict(zip(squares, np.split(order, first[1:]), strict=True))
    for (x, y), own in parts.items():
        beside = [parts[x + i, y + j] for i, j in _BESIDE if (x + i, y + j) in parts]
        around = np.concatenate(beside) if beside else np.zeros(0, np.intp)
        low = np.array([x, y]) * tile_m - margin_m
        within = np.all((xyz_m[around, :2] >= low) & (xyz_m[around, :2] < low + tile_m + 2.0 * margin_m), axis=1)
        yield PointTile(own, np.concatenate([own, around[within]]))


def _number_values(place: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.intp]]:
    """Sorted unique values, and the index (n,) of each value among them."""
    low = place.min()
    if place.max() - low < _SHORT:
        step = (place - low).astype(np.intp)
        there = np.bincount(step) > 0
        return np.flatnonzero(there) + low, (np.cumsum(there) - 1)[step]
    levels, number = np.unique(place, return_inverse=True)
    return levels, number
