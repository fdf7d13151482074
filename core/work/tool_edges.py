"""Where the soil changes across the line of a tool: whether its place and its width are as the session states.

Ground that a scanner sees before and after a pass is lower, higher or of another relief where the tool worked, and as
it was beside it. So the mean square of the change falls at both ends of the working width. Each pass is compared with
the ground as the passes before it left it, until the next one comes.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, Self

import numpy as np
from numpy.typing import NDArray

from furrowmap.core.runtime.arrays import FloatArray
from furrowmap.core.runtime.errors import Notice
from furrowmap.core.runtime.kernels import kernel
from furrowmap.core.surfaces.passage import LineTrack, Passages
from furrowmap.core.surfaces.spool import TilePoints
from furrowmap.core.values.session import Implement
from furrowmap.core.values.trajectory import Trajectory
from furrowmap.core.work.field_work import FieldWork
from furrowmap.core.work.sweep import sweeps

SEARCHED_BESIDE_M: Final = 0.8
"""Width beside the stated line in which its ends are looked for."""
ACROSS_BIN_M: Final = 0.05
SETTLE_S: Final = 0.2
"""Time around a passage in which soil is still moving."""
MIN_CELL_RETURNS: Final = 2
MAX_CHANGE_M: Final = 0.3
"""A change of more is a machine or dust."""
MIN_BIN_CELLS: Final = 25
INSIDE_BINS: Final = 6
BESIDE_BINS: Final = 4
"""Bins on either side of an end that are compared; 0.3 m are a row and a tyre."""
EVEN_BINS: Final = 6
CORRELATED_CELLS: Final = 10.0
"""Cells of a clod, or of a return's error, count as one."""
MIN_CONTRAST: Final = 3.0
"""Mean square of the change where the tool worked, over that beside it."""
MIN_CHANGED_SHARE: Final = 0.4
"""Of the same, over every 0.3 m where the tool worked: wheels alone leave the ground between them as it was."""
MIN_END_GAIN: Final = 15.0
"""By how much −2 log likelihood falls at an end of the width."""
MIN_OFF_M: Final = 0.13
"""Soil is thrown, and left lying, by as much beside a tool."""


@dataclass(frozen=True)
class ToolEnds:
    """How far to the left and to the right of the middle of the stated line the soil changes; nan where not shown."""

    left_m: float
    right_m: float

    def notice(self, implement: Implement) -> Notice | None:
        """The notice that the tool is elsewhere, or wider or narrower; None where the soil does not show that."""
        half_m = 0.5 * implement.width_m
        off_m = np.array([self.left_m, self.right_m]) - half_m
        if not (np.abs(off_m) > MIN_OFF_M).any():
            return None
        shown = [None if np.isnan(end_m) else float(end_m) for end_m in (self.left_m, self.right_m)]
        return Notice("tool-apart", left_m=shown[0], right_m=shown[1], half_m=half_m, tool=implement.name)


class ToolEdges:
    """Sums up changes of the ground across the tool's line over tiles; tiles may come from several threads."""

    def __init__(self, passes: Sequence[Passages], half_m: float) -> None:
        self.half_m, self._passes = half_m, passes

    @classmethod
    def of_work(cls, trajectory: Trajectory, work: FieldWork, implement: Implement) -> Self:
        """Those of all passes of a tool."""
        runs = [sweeps(trajectory, when, implement) for when in work.passes]
        tracks = [
            [LineTrack(number, one.t_s, one.middle_m[:, :2], one.half_m) for one in run]
            for number, run in enumerate(runs, start=1)
        ]
        return cls([Passages(one) for one in tracks], 0.5 * implement.width_m)

    def changes(self, points: TilePoints, low: NDArray[np.bool_]) -> FloatArray:
        """(bins, 3) of a tile: number of cells, sum and sum of squares of their changes, by place across the line.

        Args:
            low: (n,) which points are not high above the soil.
        """
        bins = 2 * round((self.half_m + SEARCHED_BESIDE_M) / ACROSS_BIN_M)
        sums = np.zeros((bins, 3))
        grid = points.grid
        wide = [
            passages.over(grid, SEARCHED_BESIDE_M)
            for passages in self._passes
            if passages.reach(grid, SEARCHED_BESIDE_M)
        ]
        wide = [passage for passage in wide if passage.passed.any()]
        wide.sort(key=lambda passage: float(passage.first_s.min()))
        never_s = np.full(grid.shape, np.inf)
        for k, passage in enumerate(wide):
            before_s = np.max([-never_s, *(one.last_s for one in wide[:k])], axis=0)
            after_s = np.min([never_s, *(one.first_s for one in wide[k + 1 :])], axis=0)
            limits = [
                (limit_s - points.begin_s).ravel().astype(np.float32)
                for limit_s in (before_s, passage.first_s, passage.last_s, after_s)
            ]
            heights = np.zeros((grid.rows * grid.columns, 4))
            _before_and_after(points.cell, points.t_s, points.height_m, low, *limits, np.float32(SETTLE_S), heights)
            seen = passage.passed.ravel() & (heights[:, 0] >= MIN_CELL_RETURNS) & (heights[:, 2] >= MIN_CELL_RETURNS)
            change_m = heights[seen, 3] / heights[seen, 2] - heights[seen, 1] / heights[seen, 0]
            at = np.floor(passage.across_m.ravel()[seen] / ACROSS_BIN_M).astype(np.intp) + bins // 2
            used = (np.abs(change_m) < MAX_CHANGE_M) & (at >= 0) & (at < bins)
            for column, values in enumerate((np.ones(len(change_m)), change_m, change_m**2)):
                sums[:, column] += np.bincount(at[used], values[used], minlength=bins)
        return sums


def tool_ends(sums: FloatArray, half_m: float) -> ToolEnds:
    """Where the soil changes, by sums (bins, 3) from the right to the left end."""
    middle = len(sums) // 2
    return ToolEnds(_end_m(sums[middle:], half_m), _end_m(sums[:middle][::-1], half_m))


def _end_m(outward: FloatArray, half_m: float) -> float:
    """The end of the working width by sums (k, 3) from the middle of the line outward; nan where it is not shown.

    It is where the mean square of the change in the bins inside exceeds that in those beside most clearly, of places up
    to which all the ground has changed.
    """
    count, total, squares = outward.T
    if (count[: INSIDE_BINS + BESIDE_BINS] < MIN_BIN_CELLS).any():
        return float("nan")
    known = int(np.argmax(np.append(count < MIN_BIN_CELLS, True)))
    number, mean_square = count[:known] / CORRELATED_CELLS, squares[:known] / count[:known]
    best, best_gain = 0, MIN_END_GAIN
    for end in range(INSIDE_BINS, known - BESIDE_BINS + 1):
        inside, beside = slice(end - INSIDE_BINS, end), slice(end, end + BESIDE_BINS)
        worked = _mean(mean_square[:end], number[:end])
        smooth = np.convolve(mean_square[:end], np.full(EVEN_BINS, 1.0 / EVEN_BINS), "valid")
        if smooth.min() < MIN_CHANGED_SHARE * worked:
            break
        if _mean(mean_square[inside], number[inside]) < MIN_CONTRAST * _mean(mean_square[beside], number[beside]):
            continue
        gain = _gain(mean_square, number, inside, beside)
        if gain > best_gain:
            best, best_gain = end, gain
    stated = round(half_m / ACROSS_BIN_M)
    if not best:
        return float("nan")
    if best * ACROSS_BIN_M - half_m > MIN_OFF_M and not _like_inside(total[:known] / count[:known], stated, best):
        return float("nan")
    return best * ACROSS_BIN_M


def _mean(values: FloatArray, weight: FloatArray) -> float:
    return float(values @ weight / weight.sum())


def _gain(mean_square: FloatArray, number: FloatArray, inside: slice, beside: slice) -> float:
    """By how much −2 log likelihood falls if changes inside and beside have variances of their own."""
    parts = inside, beside, slice(inside.start, beside.stop)
    one, other, both = (number[k].sum() * np.log(_mean(mean_square[k], number[k])) for k in parts)
    return float(both - one - other)


def _like_inside(mean_m: FloatArray, stated: int, end: int) -> bool:
    """Whether ground beyond the stated end changed as that inside: wheels outside of the tool leave ruts."""
    usual_m, extra_m = float(np.median(mean_m[:stated])), float(np.median(mean_m[stated:end]))
    return usual_m * extra_m > 0.0 and abs(extra_m) > 0.5 * abs(usual_m)


@kernel()
def _before_and_after(cell, t_s, height_m, low, begin_s, first_s, last_s, end_s, settle_s, heights):  # type: ignore[no-untyped-def]
    """Add number and sum of heights of each cell before a passage, and of those after it, to `heights` (cells, 4)."""
    for i in range(len(cell)):
        if not low[i]:
            continue
        k = cell[i]
        if begin_s[k] + settle_s < t_s[i] < first_s[k] - settle_s:
            heights[k, 0] += 1.0
            heights[k, 1] += height_m[i]
        elif last_s[k] + settle_s < t_s[i] < end_s[k] - settle_s:
            heights[k, 2] += 1.0
            heights[k, 3] += height_m[i]
