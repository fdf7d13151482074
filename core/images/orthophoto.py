"""True orthophotos: a surface in the colours of the frames that see each of its places."""

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from furrowmap.core.images.colouring import Colours
from furrowmap.core.runtime.arrays import FloatArray
from furrowmap.core.surfaces.grid import Grid

FINER: Final = (5, 4, 2, 1)
"""Pixels of an orthophoto across a cell of the surface."""


@dataclass(frozen=True)
class Orthophoto:
    """Colours on a grid.

    Attributes:
        rgb: (3, rows, columns) uint8 red, green, blue; 0 where nothing is seen.
        seen: (rows, columns) whether a frame sees the place.
    """

    grid: Grid
    rgb: NDArray[np.uint8]
    seen: NDArray[np.bool_]


def pixels_a_cell(colours: Colours, cell_m: float) -> int:
    """The number of pixels across a cell of the surface for which pixels are not smaller than those of the frames."""
    depth = colours.visibility.depth_m
    near = [float(np.median(known)) for one in depth if len(known := one[np.isfinite(one)])]
    if not near:
        return FINER[-1]
    on_ground_m = float(np.median(near)) * colours.pixels.reduction / float(colours.visibility.view.intrinsics[0])
    return next((finer for finer in FINER if cell_m / finer >= on_ground_m), FINER[-1])


def finer_grid(grid: Grid, factor: int) -> Grid:
    """The grid with `factor` × `factor` pixels for each cell."""
    shape = (grid.rows * factor, grid.columns * factor)
    return Grid(grid.cell_m / factor, grid.west * factor, grid.north * factor, shape)


def orthophoto(
    colours: Colours, wide: Grid, height_m: NDArray[np.float32], part: Grid, factor: int, origin_m: tuple[float, ...]
) -> Orthophoto:
    """The true orthophoto of a part of a surface.

    Heights between the middles of cells are interpolated linearly; where a cell has none there is no picture. Places
    that are hidden in all frames have none either.

    Args:
        wide: the part and a margin of one cell, as far as the surface goes.
        height_m: of `wide`; nan where unknown.
        origin_m: local origin of the colours' coordinates.
    """
    grid = finer_grid(part, factor)
    rows, columns = part.window_in(wide)
    row = rows.start + (np.arange(grid.rows) + 0.5) / factor - 0.5
    column = columns.start + (np.arange(grid.columns) + 0.5) / factor - 0.5
    known = np.isfinite(height_m)
    weight, sums = (
        _between(_between(values, row).T, column).T
        for values in (known.astype(np.float64), np.where(known, height_m, 0.0).astype(np.float64))
    )
    has = np.repeat(np.repeat(known[rows, columns], factor, axis=0), factor, axis=1)
    height = np.where(has, sums / np.where(has, weight, 1.0) - origin_m[2], np.nan)
    easting, northing = grid.centres_m()
    xyz = np.empty((*grid.shape, 3))
    xyz[..., 0], xyz[..., 1], xyz[..., 2] = easting - origin_m[0], (northing - origin_m[1])[:, None], height
    rgb, seen = colours.blended(xyz.reshape(-1, 3))
    return Orthophoto(grid, np.rint(rgb).astype(np.uint8).reshape(3, *grid.shape), seen.reshape(grid.shape))


def _between(values: FloatArray, at: FloatArray) -> FloatArray:
    """Rows (r, c) of values interpolated linearly at (n,) places between rows; beyond the first and last, these."""
    before = np.clip(np.floor(at).astype(np.intp), 0, max(len(values) - 2, 0))
    share = np.clip(at - before, 0.0, 1.0)[:, None]
    out: FloatArray = (1.0 - share) * values[before] + share * values[np.minimum(before + 1, len(values) - 1)]
    return out
