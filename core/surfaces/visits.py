"""How well the heights agree with which the same ground was seen at different times: a check that needs no survey."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final

import numba
import numpy as np
from numpy.typing import NDArray

from furrowmap.core.surfaces.grid import Grid
from furrowmap.core.surfaces.spool import TilePoints

APART_S: Final = 20.0
"""Ground that was not seen for so long is seen anew: another swath, with errors of its own."""
FEWEST_RETURNS: Final = 3
"""Of a cell in a swath, below which it has no height there."""
BLOCK: Final = 8
"""Cells a side of the blocks whose mean difference counts: the noise of single returns is averaged out in them."""
FEWEST_CELLS: Final = 4
"""Of a block with two heights, below which it does not count."""
BIN_M: Final = 0.002
BINS: Final = 50
"""Width and number of the histogram's bins on each side of zero; what differs by more counts in the outermost."""


@dataclass(frozen=True)
class SwathDifferences:
    """Differences in height of one swath and the next over the same ground.

    Attributes:
        blocks: of ground that were compared.
        area_m2: of these.
        mean_m, rms_m: mean and root mean square of the differences, later less earlier. Few blocks at the feet of walls
            and plants make most of the latter.
        histogram: (2 · BINS,) counts of blocks by difference, from −BINS · BIN_M on.
    """

    blocks: int
    area_m2: float
    mean_m: float
    rms_m: float
    histogram: NDArray[np.int64]

    def within_m(self, share: float) -> float:
        """What this share of the blocks stays within, to half a bin; BINS · BIN_M where it is beyond."""
        folded = self.histogram[BINS:] + self.histogram[:BINS][::-1]
        below = np.concatenate([[0.0], np.cumsum(folded)]) / max(self.blocks, 1)
        return float(np.interp(share, below, BIN_M * np.arange(BINS + 1)))

    def plain(self) -> dict[str, Any]:
        """As `report.json` has it."""
        return {
            "blocks": self.blocks,
            "area_m2": round(self.area_m2, 1),
            "mean_m": round(self.mean_m, 4),
            "rms_m": round(self.rms_m, 4),
            "half_within_m": round(self.within_m(0.5), 4),
            "p95_within_m": round(self.within_m(0.95), 4),
            "histogram_from_m": -BINS * BIN_M,
            "histogram_bin_m": BIN_M,
            "histogram": self.histogram.tolist(),
        }


class SwathSums:
    """Sums up differences over tiles; memory does not grow with the land."""

    def __init__(self) -> None:
        self._count, self._sum, self._square, self._area_m2 = 0, 0.0, 0.0, 0.0
        self._histogram = np.zeros(2 * BINS, np.int64)

    def add(self, difference_m: NDArray[np.float32], block_m2: float) -> None:
        """Take the blocks of a tile into account, see :func:`block_differences`."""
        known = difference_m[np.isfinite(difference_m)].astype(np.float64)
        bins = np.clip(np.floor(known / BIN_M).astype(np.intp) + BINS, 0, 2 * BINS - 1)
        self._histogram += np.bincount(bins, minlength=2 * BINS)
        self._count += len(known)
        self._sum += float(known.sum())
        self._square += float(known @ known)
        self._area_m2 += len(known) * block_m2

    def differences(self) -> SwathDifferences | None:
        """What the differences say; None where no ground was seen twice."""
        if not self._count:
            return None
        rms_m = float(np.sqrt(self._square / self._count))
        return SwathDifferences(self._count, self._area_m2, self._sum / self._count, rms_m, self._histogram.copy())


def block_grid(grid: Grid) -> Grid:
    """The least grid of blocks that covers cells; the blocks of a tile are its own."""
    west, north = grid.west // BLOCK, -(-grid.north // BLOCK)
    south, east = (grid.north - grid.rows) // BLOCK, -(-(grid.west + grid.columns) // BLOCK)
    return Grid(BLOCK * grid.cell_m, west, north, (north - south, east - west))


def block_differences(points: TilePoints) -> NDArray[np.float32]:
    """Mean difference in height, later less earlier, of swaths over each block (rows, columns); nan where unknown.

    A cell's returns that follow each other without a pause of `APART_S` are of one swath. Differences are taken cell by
    cell, so that the relief between cells, of which two swaths see other parts, is not in them.

    Args:
        points: of ground that did not change between its first and last return, in the order of time.
    """
    grid = points.grid
    rows, columns = -(-grid.rows // BLOCK), -(-grid.columns // BLOCK)
    total, cells = _differences(points.cell, points.t_s, points.height_m, grid.rows * grid.columns)
    whole = np.zeros((2, rows * BLOCK, columns * BLOCK))
    whole[0, : grid.rows, : grid.columns] = total.reshape(grid.shape)
    whole[1, : grid.rows, : grid.columns] = cells.reshape(grid.shape)
    sums, counts = whole.reshape(2, rows, BLOCK, columns, BLOCK).sum(axis=(2, 4))
    enough = counts >= FEWEST_CELLS
    return np.where(enough, sums / np.maximum(counts, 1), np.nan).astype(np.float32)


@numba.njit(cache=True, nogil=True)
def _close(k, count, total, before, sums, number):  # type: ignore[no-untyped-def]
    """End a cell's swath: compare its height with the last one's."""
    if count[k] >= FEWEST_RETURNS:
        mean = total[k] / count[k]
        if np.isfinite(before[k]):
            sums[k] += mean - before[k]
            number[k] += 1
        before[k] = mean
    count[k], total[k] = 0, 0.0


@numba.njit("Tuple((float64[::1], int64[::1]))(uint16[::1], float32[::1], float32[::1], int64)", cache=True, nogil=True)
def _differences(cell, t_s, height_m, cells):  # type: ignore[no-untyped-def]
    """Sum and number (cells,) of the differences of each swath's mean height from the one before it."""
    seen_s = np.full(cells, -np.inf, np.float32)
    count, total = np.zeros(cells, np.int64), np.zeros(cells)
    before = np.full(cells, np.nan)
    sums, number = np.zeros(cells), np.zeros(cells, np.int64)
    for i in range(len(cell)):
        k = cell[i]
        if t_s[i] - seen_s[k] > APART_S:
            _close(k, count, total, before, sums, number)
        seen_s[k] = t_s[i]
        count[k] += 1
        total[k] += height_m[i]
    for k in range(cells):
        _close(k, count, total, before, sums, number)
    return sums, number
