"""Height differences between swaths over the same ground: an accuracy check without a survey."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import NDArray

from furrowmap.core.runtime.kernels import kernel

if TYPE_CHECKING:
    from furrowmap.core.surfaces.spool import TilePoints

SWATH_PAUSE_S: Final = 20.0
"""A pause this long separates swaths."""
MIN_SWATH_RETURNS: Final = 3
"""Of a cell in a swath."""
SWATH_BLOCK: Final = 8
"""Cells a side of the blocks over which differences are averaged, to reduce the noise of returns."""
MIN_BLOCK_CELLS: Final = 4
"""With a difference, in a block."""
BIN_M: Final = 0.002
BINS: Final = 50
"""Width and number of histogram bins on each side of zero; the outermost include all beyond."""


@dataclass(frozen=True)
class SwathDifferences:
    """Height differences of successive swaths over the same ground.

    Attributes:
        blocks: number compared.
        mean_m, rms_m: of the differences, later less earlier; a few blocks at walls and plants dominate the RMS.
        histogram: (2 · BINS,) counts of blocks by difference, from −BINS · BIN_M on.
    """

    blocks: int
    area_m2: float
    mean_m: float
    rms_m: float
    histogram: NDArray[np.int64]

    def within_m(self, share: float) -> float:
        """Quantile of the absolute differences, to half a bin and at most BINS · BIN_M."""
        folded = self.histogram[BINS:] + self.histogram[:BINS][::-1]
        below = np.concatenate([[0.0], np.cumsum(folded)]) / max(self.blocks, 1)
        return float(np.interp(share, below, BIN_M * np.arange(BINS + 1)))

    def plain(self) -> dict[str, Any]:
        """For `report.json`."""
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
    """Accumulates differences over tiles."""

    def __init__(self) -> None:
        self._count = 0
        self._sum = 0.0
        self._square = 0.0
        self._area_m2 = 0.0
        self._histogram = np.zeros(2 * BINS, np.int64)

    def add(self, difference_m: NDArray[np.float32], block_m2: float) -> None:
        """Add the blocks of a tile, see :func:`block_differences`."""
        known = difference_m[np.isfinite(difference_m)].astype(np.float64)
        bins = np.clip(np.floor(known / BIN_M).astype(np.intp) + BINS, 0, 2 * BINS - 1)
        self._histogram += np.bincount(bins, minlength=2 * BINS)
        self._count += len(known)
        self._sum += float(known.sum())
        self._square += float(known @ known)
        self._area_m2 += len(known) * block_m2

    def differences(self) -> SwathDifferences | None:
        """All differences; None where no ground was covered twice."""
        if not self._count:
            return None
        rms_m = float(np.sqrt(self._square / self._count))
        return SwathDifferences(self._count, self._area_m2, self._sum / self._count, rms_m, self._histogram.copy())


def block_differences(points: TilePoints, kept: NDArray[np.bool_] | None = None) -> NDArray[np.float32]:
    """Mean height difference of swaths, later less earlier, in each block (rows, columns); nan where unknown.

    The points, or those kept (n,), in order of time, are of unchanged ground; cells are compared one by one, so that
    relief is excluded.
    """
    grid = points.grid
    kept = np.ones(len(points.cell), np.bool_) if kept is None else kept
    rows = -(-grid.rows // SWATH_BLOCK)
    columns = -(-grid.columns // SWATH_BLOCK)
    total, cells = _differences(points.cell, points.t_s, points.height_m, kept, grid.rows * grid.columns)
    whole = np.zeros((2, rows * SWATH_BLOCK, columns * SWATH_BLOCK))
    whole[0, : grid.rows, : grid.columns] = total.reshape(grid.shape)
    whole[1, : grid.rows, : grid.columns] = cells.reshape(grid.shape)
    sums, counts = whole.reshape(2, rows, SWATH_BLOCK, columns, SWATH_BLOCK).sum(axis=(2, 4))
    enough = counts >= MIN_BLOCK_CELLS
    return np.where(enough, sums / np.maximum(counts, 1), np.nan).astype(np.float32)


@kernel()
def _close(k, count, total, before, sums, number):  # type: ignore[no-untyped-def]
    """End the swath of a cell: compare its height with that of the swath before."""
    if count[k] >= MIN_SWATH_RETURNS:
        mean = total[k] / count[k]
        if np.isfinite(before[k]):
            sums[k] += mean - before[k]
            number[k] += 1
        before[k] = mean
    count[k] = 0
    total[k] = 0.0


@kernel()
def _differences(cell, t_s, height_m, kept, cells):  # type: ignore[no-untyped-def]
    """Sum and number (cells,) of the differences of each swath from the one before."""
    seen_s = np.full(cells, -np.inf, np.float32)
    count = np.zeros(cells, np.int64)
    total = np.zeros(cells)
    before = np.full(cells, np.nan)
    sums = np.zeros(cells)
    number = np.zeros(cells, np.int64)
    for i in range(len(cell)):
        if not kept[i]:
            continue
        k = np.int64(cell[i])
        if t_s[i] - seen_s[k] > SWATH_PAUSE_S:
            _close(k, count, total, before, sums, number)
        seen_s[k] = t_s[i]
        count[k] += 1
        total[k] += height_m[i]
    for last in range(cells):
        _close(last, count, total, before, sums, number)
    return sums, number
