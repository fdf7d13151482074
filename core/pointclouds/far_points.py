"""Single points far from all others: errors of a scanner or damage, for which no grid or octree is spanned."""

from typing import Final

import numpy as np
from numpy.typing import NDArray

from furrowmap.core.pointclouds.clouds import Clouds
from furrowmap.core.readers.las.cloud import Box
from furrowmap.core.runtime.errors import Notice
from furrowmap.core.runtime.progress import Progress, silent

FAR_GAP_M: Final = 1000.0
"""Gap to the others, along either axis."""
MAX_FAR_SHARE: Final = 0.001
"""Largest share of points that are left out."""
SPARSE_PER_M2: Final = 0.01
"""Only clouds with fewer points on the rectangle of their header are searched."""
_SIDE_M: Final = 100.0


def near_box(clouds: Clouds, progress: Progress = silent) -> tuple[Box | None, tuple[Notice, ...]]:
    """The box of all points but a few that lie far off, and a warning; None where there are none.

    Raises InputError if a file is damaged.
    """
    sides = [np.subtract(file.header.high[:2], file.header.low[:2]) for file in clouds.files if file.points]
    sparse = [
        file.points < SPARSE_PER_M2 * float(np.prod(side)) and float(np.max(side)) > FAR_GAP_M
        for file, side in zip((file for file in clouds.files if file.points), sides, strict=True)
    ]
    if not any(sparse):
        return None, ()
    total = max(clouds.points, 1)
    squares, counts = np.empty((0, 2)), np.empty(0, np.int64)
    for batch in clouds.batches(read=lambda done: progress("looking for far points", done / total)):
        found, number = np.unique(np.floor(batch.xyz_m[:, :2] / _SIDE_M), axis=0, return_counts=True)
        squares, inverse = np.unique(np.concatenate([squares, found]), axis=0, return_inverse=True)
        counts = np.bincount(inverse.ravel(), np.concatenate([counts, number]), len(squares)).astype(np.int64)
    near = _near(squares[:, 0], counts) & _near(squares[:, 1], counts) if len(squares) else np.ones(0, bool)
    far = int(counts[~near].sum())
    if not 0 < far <= MAX_FAR_SHARE * counts.sum():
        return None, ()
    west, south = (squares[near].min(axis=0) * _SIDE_M).tolist()
    east, north = ((squares[near].max(axis=0) + 1.0) * _SIDE_M).tolist()
    return (west, south, east, north), (
        Notice(
            "points-far",
            far=far,
            counts=int(counts.sum()),
            far_m=FAR_GAP_M,
            west=west,
            south=south,
            east=east,
            north=north,
        ),
    )


def _near(place: NDArray[np.float64], counts: NDArray[np.int64]) -> NDArray[np.bool_]:
    """Which squares are of a group with many points; groups are divided by gaps along an axis."""
    order = np.argsort(place, kind="stable")
    group = np.empty(len(place), np.int64)
    group[order] = np.cumsum(np.diff(place[order], prepend=place[order[0]]) > FAR_GAP_M / _SIDE_M)
    held = np.bincount(group, counts)
    kept: NDArray[np.bool_] = (held > MAX_FAR_SHARE * counts.sum())[group]
    return kept
