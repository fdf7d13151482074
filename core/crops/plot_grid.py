"""The plots of a trial as a grid: rows and columns of equal rectangles, numbered as trials are laid out."""

from typing import Final

import numpy as np
import shapely

from furrowmap.core.runtime.arrays import FloatArray
from furrowmap.core.runtime.errors import InputError, Notice
from furrowmap.core.values.parcel import Parcel
from furrowmap.core.values.plot_grid import PlotGrid

MAX_PLOTS: Final = 100_000
MAX_MISFIT_M: Final = 0.10
"""Corners that fit the sizes this well raise no notice."""


def plot_grid(
    grid: PlotGrid,
    corner_m: FloatArray,
    end_m: FloatArray | None = None,
    azimuth_deg: float | None = None,
    scale: float = 1.0,
) -> tuple[tuple[Parcel, ...], list[Notice]]:
    """The plots in the order of their numbers, and how well the corners fit the sizes.

    Args:
        grid: sizes, in metres on the ground, and numbering.
        corner_m: (2,) easting and northing of the outer corner of the first plot, where the base line begins.
        end_m: (2,) the other end of the base line: the outer corner of the last plot of the first row.
        azimuth_deg: instead: direction of the base line, clockwise from grid north.
        scale: of the map: metres of it per metre on the ground.

    Raises:
        InputError: if direction or length are stated neither way or both ways, or the grid is too large.
    """
    if (end_m is None) == (azimuth_deg is None):
        raise InputError("plots-grid.direction", twice=end_m is not None)
    if end_m is None and grid.length_m is None:
        raise InputError("plots-grid.length")
    if grid.by_block and grid.block is None:
        raise InputError("plots-grid.blocks")
    if grid.rows * grid.columns > MAX_PLOTS:
        raise InputError("plots-grid.many", plots=grid.rows * grid.columns, largest=MAX_PLOTS)
    gaps_m = (grid.columns - 1) * grid.alley_m
    notices: list[Notice] = []
    if end_m is not None:
        base = end_m - corner_m
        measured = float(np.hypot(*base)) / scale
        along = base / max(scale * measured, 1e-12)
        length_m = grid.length_m if grid.length_m is not None else (measured - gaps_m) / grid.columns
        if length_m <= 0.0:
            raise InputError("plots-grid.alleys", measured=measured, gaps_m=gaps_m)
        needed = grid.columns * length_m + gaps_m
        if abs(needed - measured) > MAX_MISFIT_M:
            notices.append(Notice("plots-baseline", measured=measured, needed=needed))
    else:
        assert azimuth_deg is not None
        assert grid.length_m is not None
        turn = np.radians(azimuth_deg)
        along, length_m = np.array([np.sin(turn), np.cos(turn)]), grid.length_m
    across = np.array([-along[1], along[0]]) * (1.0 if grid.side == "left" else -1.0)
    length, width = scale * length_m * along, scale * grid.width_m * across
    steps = (0.0 * along, length, length + width, width)
    counts: dict[int, int] = {}
    plots = []
    numbers_a_block = max(100, 10 ** len(str(grid.rows * grid.columns)))
    for k, (row, column) in enumerate(_order(grid)):
        start = corner_m + scale * (
            column * (length_m + grid.alley_m) * along + row * (grid.width_m + grid.path_m) * across
        )
        shape = shapely.Polygon([start + step for step in steps])
        block = _block(grid, row, column)
        counts[block] = counts.get(block, 0) + 1
        number = block * numbers_a_block + counts[block] - 1 + grid.first if grid.by_block else k + grid.first
        place = {"row": float(row + 1), "column": float(column + 1)}
        plots.append(Parcel(str(number), shape, shape, str(block) if block else None, place))
    return tuple(plots), notices


def _order(grid: PlotGrid) -> list[tuple[int, int]]:
    """(row, column) of the plots in the order of their numbers, block by block where numbers begin anew."""
    runs, steps = (grid.rows, grid.columns) if grid.along == "rows" else (grid.columns, grid.rows)
    order: list[tuple[int, int]] = []
    for run in range(runs):
        forth = range(steps)[:: -1 if grid.serpentine and run % 2 == 1 else 1]
        order += [(run, step) if grid.along == "rows" else (step, run) for step in forth]
    if grid.by_block:
        order.sort(key=lambda place: _block(grid, *place))  # stable: the order within a block stays
    return order


def _block(grid: PlotGrid, row: int, column: int) -> int:
    """Number of a block, from 1; 0 without blocks."""
    if grid.block is None:
        return 0
    return (row if grid.block == "rows" else column) // grid.block_size + 1
