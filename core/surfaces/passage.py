"""Times at which a moving line first and last passed each cell, and in which pass."""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from furrowmap.core.runtime.arrays import FloatArray
from furrowmap.core.runtime.kernels import kernel
from furrowmap.core.surfaces.grid import Grid

STEPS_A_CHUNK: Final = 32
"""Steps per block of the spatial index: some metres of path."""


@dataclass(frozen=True)
class LineTrack:
    """Successive positions of a line without a gap: pass from 1, UTC (n,), middle (n, 2), from it to the left end."""

    number: int
    t_s: FloatArray
    middle_m: FloatArray
    half_m: FloatArray


@dataclass(frozen=True)
class LinePassage:
    """UTC of the first and last passage of a line over cells, ±inf without, and the pass of the last or 0, by cell.

    `across_m` is how far to the left of the line's middle a cell lay in that pass; nan without.
    """

    grid: Grid
    first_s: FloatArray
    last_s: FloatArray
    number: NDArray[np.int32]
    across_m: NDArray[np.float32]

    @property
    def passed(self) -> NDArray[np.bool_]:
        """Where the line passed."""
        passed: NDArray[np.bool_] = self.number > 0
        return passed


class Passages:
    """Spatial index of the steps of lines, from tracks in any order."""

    def __init__(self, tracks: Iterable[LineTrack]) -> None:
        # one row a step: times, middles and half lines at its two ends, number of the pass
        rows = [np.zeros((0, 11))]
        for track in tracks:
            ends = [np.column_stack([a[:-1], a[1:]]) for a in (track.t_s, track.middle_m, track.half_m)]
            rows.append(np.column_stack([*ends, np.full(len(track.t_s) - 1, float(track.number))]))
        self._steps = np.concatenate(rows)
        starts = np.arange(0, len(self._steps), STEPS_A_CHUNK)
        reach = np.hypot(self._steps[:, 6:10:2], self._steps[:, 7:10:2]).max(axis=1, initial=0.0)[:, None]
        low = np.minimum(self._steps[:, 2:4], self._steps[:, 4:6]) - reach
        high = np.maximum(self._steps[:, 2:4], self._steps[:, 4:6]) + reach
        self._low = np.minimum.reduceat(low, starts) if len(starts) else np.zeros((0, 2))
        self._high = np.maximum.reduceat(high, starts) if len(starts) else np.zeros((0, 2))

    def __bool__(self) -> bool:
        return bool(len(self._steps))

    def reach(self, grid: Grid, beside_m: float = 0.0) -> bool:
        """Whether the line, extended by `beside_m` at both ends, may pass over a grid."""
        return bool(self._near(grid, beside_m).any())

    def _near(self, grid: Grid, beside_m: float) -> NDArray[np.bool_]:
        """Which chunks of steps may pass over a grid."""
        west, south, east, north = grid.bounds_m
        begins = self._low <= (east + beside_m, north + beside_m)
        ends = self._high >= (west - beside_m, south - beside_m)
        near: NDArray[np.bool_] = np.all(begins & ends, axis=1)
        return near

    def over(self, grid: Grid, beside_m: float = 0.0) -> LinePassage:
        """Passages over the cells of a grid of the line extended by `beside_m` at both ends."""
        first = np.full(grid.shape, np.inf)
        last = np.full(grid.shape, -np.inf)
        number = np.zeros(grid.shape, np.int32)
        across = np.full(grid.shape, np.nan, np.float32)
        for k in np.flatnonzero(self._near(grid, beside_m)).tolist():
            steps = self._steps[k * STEPS_A_CHUNK : (k + 1) * STEPS_A_CHUNK]
            pass_over(steps, beside_m, grid.cell_m, grid.west, grid.north, first, last, number, across)
        return LinePassage(grid, first, last, number, across)


@kernel()
def pass_over(steps, beside_m, cell_m, west, north, first_s, last_s, number, across_m):  # type: ignore[no-untyped-def]
    """Kernel of :meth:`Passages.over`.

    Within a step the middle M and the half line H change linearly with s from 0 to 1. The line passes P where
    ``(P - M(s)) x H(s) = 0``, a quadratic in s, and reaches it where P is no further from M(s) than H is long.
    """
    rows, columns = first_s.shape
    for k in range(len(steps)):
        t0, t1, mx, my, mx1, my1, hx, hy, hx1, hy1 = steps[k, :10]
        long0 = np.hypot(hx, hy)
        long1 = np.hypot(hx1, hy1)
        if long0 == 0.0 or long1 == 0.0:
            continue
        f0 = 1.0 + beside_m / long0
        f1 = 1.0 + beside_m / long1
        wide0 = f0 * abs(hx)
        high0 = f0 * abs(hy)
        wide1 = f1 * abs(hx1)
        high1 = f1 * abs(hy1)
        a = max(0, int(np.floor(min(mx - wide0, mx1 - wide1) / cell_m)) - west)
        b = min(columns - 1, int(np.floor(max(mx + wide0, mx1 + wide1) / cell_m)) - west)
        c = max(0, north - 1 - int(np.floor(max(my + high0, my1 + high1) / cell_m)))
        d = min(rows - 1, north - 1 - int(np.floor(min(my - high0, my1 - high1) / cell_m)))
        dmx = mx1 - mx
        dmy = my1 - my
        dhx = hx1 - hx
        dhy = hy1 - hy
        square = dmy * dhx - dmx * dhy
        for row in range(c, d + 1):
            py = (north - 0.5 - row) * cell_m - my
            for column in range(a, b + 1):
                px = (west + 0.5 + column) * cell_m - mx
                level = px * hy - py * hx
                slope = px * dhy - py * dhx - (dmx * hy - dmy * hx)
                s = -level / slope if slope != 0.0 else -1.0
                for _ in range(3):  # Newton's method; steps are short, so the quadratic is almost linear
                    rise = slope + 2.0 * square * s
                    if rise != 0.0:
                        s -= (level + (slope + square * s) * s) / rise
                if not -1e-9 <= s <= 1.0 + 1e-9:
                    continue
                lx = hx + s * dhx
                ly = hy + s * dhy
                along = (px - s * dmx) * lx + (py - s * dmy) * ly
                length = np.hypot(lx, ly)
                if abs(along) > length * (length + beside_m):
                    continue
                t = t0 + s * (t1 - t0)
                first_s[row, column] = min(first_s[row, column], t)
                if t >= last_s[row, column]:
                    last_s[row, column] = t
                    number[row, column] = int(steps[k, 10])
                    across_m[row, column] = along / length
