"""A large raster in squares, each with what lies round it, so that memory does not grow with the land."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

import numpy as np
from rasterio.windows import Window

from furrowmap.core.surfaces.grid import Grid

WINDOW: Final = 1024
"""Cells a side of the squares."""


def windows(grid: Grid, margin: int) -> Iterator[tuple[Grid, Grid]]:
    """Squares of a grid, and the same with a margin as far as the grid reaches; north first, then west."""
    for row in range(0, grid.rows, WINDOW):
        for column in range(0, grid.columns, WINDOW):
            rows, columns = min(WINDOW, grid.rows - row), min(WINDOW, grid.columns - column)
            top, left = max(0, row - margin), max(0, column - margin)
            bottom, right = min(grid.rows, row + rows + margin), min(grid.columns, column + columns + margin)
            inner = Grid(grid.cell_m, grid.west + column, grid.north - row, (rows, columns))
            yield inner, Grid(grid.cell_m, grid.west + left, grid.north - top, (bottom - top, right - left))


def window(part: Grid, whole: Grid) -> Window:
    """Where a part of a grid lies in its raster."""
    return Window(part.west - whole.west, whole.north - part.north, part.columns, part.rows)


def share(inner: Grid, whole: Grid) -> float:
    """How much of the work is done after a window (0 to 1)."""
    return (whole.north - inner.north + inner.rows) / whole.rows


def is_last(inner: Grid, whole: Grid) -> tuple[bool, bool]:
    """Whether a window is the southernmost, and whether the easternmost."""
    south = inner.north - inner.rows == whole.north - whole.rows
    return south, inner.west + inner.columns == whole.west + whole.columns


def plots_of(inner: Grid, plots: Grid, last: tuple[bool, bool]) -> Grid | None:
    """The plots whose north-west corner lies in a window, so that each is one window's; None where there are none."""
    cell = inner.cell_m / plots.cell_m
    west, east = np.floor(inner.west * cell), np.floor((inner.west + inner.columns) * cell)
    north, south = np.ceil(inner.north * cell), np.ceil((inner.north - inner.rows) * cell)
    west, north = max(int(west), plots.west), min(int(north), plots.north)
    east = plots.west + plots.columns if last[1] else int(east)
    south = plots.north - plots.rows if last[0] else int(south)
    return Grid(plots.cell_m, west, north, (north - south, east - west)) if north > south and east > west else None


def common(own: Grid, there: Grid) -> tuple[tuple[slice, slice], tuple[slice, slice]]:
    """Rows, and columns, that two grids have in common, in the first and in the second."""
    top, bottom = min(own.north, there.north), max(own.north - own.rows, there.north - there.rows)
    left, right = max(own.west, there.west), min(own.west + own.columns, there.west + there.columns)
    rows = slice(own.north - top, own.north - bottom), slice(there.north - top, there.north - bottom)
    return rows, (slice(left - own.west, right - own.west), slice(left - there.west, right - there.west))
