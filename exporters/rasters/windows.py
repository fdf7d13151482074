"""A large raster in square windows with margins, so that memory does not grow with the area."""

from collections.abc import Iterator, Sequence
from typing import Final

import numpy as np
from rasterio.windows import Window

from furrowmap.core.surfaces.grid import Grid

WINDOW_CELLS: Final = 1024
"""Side length of the windows in cells."""


def windows(grid: Grid, margin: int, side: int | None = None) -> Iterator[tuple[Grid, Grid]]:
    """Windows of a grid, each without and with a margin (clipped to the grid); from north to south, west to east.

    They have `side` cells a side, by default WINDOW_CELLS.
    """
    side = side or WINDOW_CELLS
    for row in range(0, grid.rows, side):
        for column in range(0, grid.columns, side):
            rows = min(side, grid.rows - row)
            columns = min(side, grid.columns - column)
            top = max(0, row - margin)
            left = max(0, column - margin)
            bottom = min(grid.rows, row + rows + margin)
            right = min(grid.columns, column + columns + margin)
            inner = Grid(grid.cell_m, grid.west + column, grid.north - row, (rows, columns))
            yield inner, Grid(grid.cell_m, grid.west + left, grid.north - top, (bottom - top, right - left))


def window(part: Grid, whole: Grid) -> Window:
    """The window of a part of a grid in the raster of the whole."""
    return Window(part.west - whole.west, whole.north - part.north, part.columns, part.rows)


def share_done(inner: Grid, whole: Grid) -> float:
    """Share of the work that is done after a window (0 to 1)."""
    return (whole.north - inner.north + inner.rows) / whole.rows


def is_last(inner: Grid, whole: Grid) -> tuple[bool, bool]:
    """Whether a window is the southernmost, and whether the easternmost."""
    south = inner.north - inner.rows == whole.north - whole.rows
    return south, inner.west + inner.columns == whole.west + whole.columns


def plots_of(inner: Grid, plots: Grid, last: tuple[bool, bool]) -> Grid | None:
    """The plots whose north-west corner lies in a window, so that each belongs to one; None for no plot."""
    cell = inner.cell_m / plots.cell_m
    west = np.floor(inner.west * cell)
    east = np.floor((inner.west + inner.columns) * cell)
    north = np.ceil(inner.north * cell)
    south = np.ceil((inner.north - inner.rows) * cell)
    west = max(int(west), plots.west)
    north = min(int(north), plots.north)
    east = plots.west + plots.columns if last[1] else int(east)
    south = plots.north - plots.rows if last[0] else int(south)
    return Grid(plots.cell_m, west, north, (north - south, east - west)) if north > south and east > west else None


def shared_cells(one: Grid, other: Grid) -> Grid | None:
    """The cells that two grids share, None for no cell; ValueError if their cells have different sizes."""
    if one.cell_m != other.cell_m:
        raise ValueError(f"cells of {one.cell_m} m and cells of {other.cell_m} m")
    west = max(one.west, other.west)
    north = min(one.north, other.north)
    east = min(one.west + one.columns, other.west + other.columns)
    south = max(one.north - one.rows, other.north - other.rows)
    return Grid(one.cell_m, west, north, (north - south, east - west)) if north > south and east > west else None


def enclosing(grids: Sequence[Grid]) -> Grid:
    """The smallest grid that covers several with cells of one size; InputError if it has too many cells."""
    west = min(grid.west for grid in grids)
    north = max(grid.north for grid in grids)
    rows = north - min(grid.north - grid.rows for grid in grids)
    return Grid(grids[0].cell_m, west, north, (rows, max(grid.west + grid.columns for grid in grids) - west))
