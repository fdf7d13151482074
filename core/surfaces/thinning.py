"""Fewer points for a purpose that needs no more."""

from __future__ import annotations

from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

Which = Literal["first", "lowest", "highest"]


def every_nth(points: int, step: int) -> NDArray[np.bool_]:
    """(points,) every `step`-th one kept, beginning with the first."""
    if step < 1:
        raise ValueError(f"every {step}th point")
    kept = np.zeros(points, bool)
    kept[::step] = True
    return kept


def one_a_voxel(xyz_m: ArrayLike, voxel_m: float) -> NDArray[np.bool_]:
    """(n,) the first point of every cube of this side kept; cubes begin at the CRS's 0, 0, 0.

    Args:
        xyz_m: (n, 3) finite coordinates.
        voxel_m: side of a cube.
    """
    return _kept(np.asarray(xyz_m, np.float64).reshape(-1, 3), voxel_m, None)


def one_a_cell(xyz_m: ArrayLike, cell_m: float, which: Which = "lowest") -> NDArray[np.bool_]:
    """(n,) one point of every square cell kept; cells are those of a grid of this cell.

    Args:
        xyz_m: (n, 3) finite coordinates.
        cell_m: side of a cell.
        which: of the points in a cell; the first of equals.
    """
    xyz = np.asarray(xyz_m, np.float64).reshape(-1, 3)
    rank = None if which == "first" else xyz[:, 2] if which == "lowest" else -xyz[:, 2]
    return _kept(xyz[:, :2], cell_m, rank)


def _kept(place_m: NDArray[np.float64], size_m: float, rank: NDArray[np.float64] | None) -> NDArray[np.bool_]:
    """Of the points in each cell the one with the least rank, the first of equals."""
    if not size_m > 0.0:
        raise ValueError(f"cells of {size_m} m")
    cell = np.zeros(len(place_m), np.intp)
    for axis in place_m.T:
        levels, number = np.unique(np.floor(axis / size_m), return_inverse=True)
        _, cell = np.unique(cell * len(levels) + number, return_inverse=True)
    order = np.arange(len(cell)) if rank is None else np.argsort(rank, kind="stable")
    kept = np.zeros(len(cell), bool)
    kept[order[np.unique(cell[order], return_index=True)[1]]] = True
    return kept
