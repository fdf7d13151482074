"""How densely, and by which strips of a flight, the ground was covered."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from furrowmap.core.runtime.kernels import kernel
from furrowmap.core.surfaces.grid import Grid
from furrowmap.core.surfaces.spool import TilePoints
from furrowmap.core.values.time_span import Interval

COVERAGE_BLOCK: Final = 8
"""Cells a side of the blocks that are counted: with fewer points each, densities are noise."""
MIN_STRIP_POINTS: Final = 3
"""Of a strip in a block that it covers."""


@dataclass(frozen=True)
class Coverage:
    """Points of a tile by blocks of COVERAGE_BLOCK cells a side; arrays (rows, columns) of the blocks, north up.

    Attributes:
        points: (rows, columns) number of points, those of turns included.
        number: (k,) numbers of the strips in the tile.
        by_strip: (k, rows, columns) number of points of each.
    """

    grid: Grid
    points: NDArray[np.int64]
    number: NDArray[np.int64]
    by_strip: NDArray[np.int64]

    @property
    def density_m2(self) -> NDArray[np.float32]:
        """Points a square metre; nan without points."""
        density = self.points / self.grid.cell_area_m2
        return np.where(self.points > 0, density, np.nan).astype(np.float32)

    @property
    def covered(self) -> NDArray[np.bool_]:
        """(k, rows, columns) which blocks each strip covers."""
        out: NDArray[np.bool_] = self.by_strip >= MIN_STRIP_POINTS
        return out

    @property
    def strips(self) -> NDArray[np.float32]:
        """Number of strips that cover a block; nan without points."""
        return np.where(self.points > 0, self.covered.sum(axis=0), np.nan).astype(np.float32)


def coverage(points: TilePoints, strips: Sequence[Interval]) -> Coverage:
    """Points of a tile of whole blocks (COVERAGE_BLOCK cells a side) by blocks and strips, in the order of time."""
    grid = points.grid.coarser(COVERAGE_BLOCK)
    ends_s = np.array([(strip.begin_s, strip.end_s) for strip in strips], np.float64).reshape(-1, 2) - points.begin_s
    blocks = grid.rows * grid.columns
    counts = count_blocks(points.cell, points.t_s, ends_s, points.grid.columns, blocks, COVERAGE_BLOCK)
    counts = counts.reshape(len(strips) + 1, *grid.shape)
    there = np.flatnonzero(counts[1:].any(axis=(1, 2)))
    return Coverage(grid, counts.sum(axis=0), there + 1, counts[1:][there])


@kernel()
def count_blocks(cell, t_s, ends_s, columns, blocks, block):  # type: ignore[no-untyped-def]
    """Points (1 + strips, blocks): row 0 those of no strip, row k those of strip k."""
    counts = np.zeros((len(ends_s) + 1, blocks), np.int64)
    across = columns // block
    k = 0
    for i in range(len(cell)):
        t = t_s[i]
        while k < len(ends_s) and t > ends_s[k, 1]:  # points come nearly in order of time
            k += 1
        while k and t <= ends_s[k - 1, 1]:
            k -= 1
        row, column = cell[i] // columns, cell[i] % columns
        number = k + 1 if k < len(ends_s) and t >= ends_s[k, 0] else 0
        counts[number, row // block * across + column // block] += 1
    return counts
