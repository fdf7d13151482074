"""True orthophotos: a surface in the colours of the frames that see each of its places."""

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from furrowmap.core.images.colouring import Colours, blended_colours
from furrowmap.core.surfaces.grid import Grid

FINER: Final = (5, 4, 2, 1)
"""Pixels of an orthophoto across a cell of the surface."""


@dataclass(frozen=True)
class Orthophoto:
    """Colours on a grid: (3, rows, columns) uint8 red, green, blue, 0 for none; whether a frame sees the place."""

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

    Heights between the middles of cells are interpolated linearly; where a cell has none there is no picture. Cells
    whose middle is hidden in all frames have none either. `wide` is the part and a margin of one cell, as far as the
    surface goes, with heights or nan.
    """
    grid = finer_grid(part, factor)
    rows, columns = part.window_in(wide)
    rgb, seen = np.zeros((3, *grid.shape), np.uint8), np.zeros(grid.shape, np.bool_)
    corner = np.array([grid.bounds_m[0], grid.bounds_m[3], 0.0]) - origin_m
    begin = np.array([rows.start, columns.start])
    blended_colours(height_m, begin, factor, corner, grid.cell_m, *colours.arguments, rgb, seen)
    return Orthophoto(grid, rgb, seen)
