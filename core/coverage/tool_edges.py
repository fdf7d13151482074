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

from furrowmap.core.coverage.field_work import FieldWork
from furrowmap.core.coverage.sweep import PassTimes, sweeps
from furrowmap.core.runtime.arrays import FloatArray
from furrowmap.core.runtime.errors import Notice
from furrowmap.core.runtime.kernels import kernel
from furrowmap.core.surfaces.passage import LinePassage, LineTrack, Passages
from furrowmap.core.surfaces.spool import TilePoints
from furrowmap.core.values.session import Implement
from furrowmap.core.values.trajectory import Trajectory

SEARCHED_BESIDE_M: Final = 2.0
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
MIN_CHANGED_SHARE: Final = 0.4
"""Of the same, over every 0.3 m where the tool worked: wheels alone leave the ground between them as it was."""
MAX_CHANGED_TIMES: Final = 5.0
"""Ground that changed by so many times more is no soil: walls, and plants that move."""
AROUND_TRANSITION_S: Final = 3.0
"""Time around a transition in which the tool's line is followed."""
ALONG_M: Final = 1.2
"""Way to either side of a begin or an end of a pass that is looked at."""
WELL_INSIDE: Final = 0.8
"""Share of the width that shows begins and ends."""
MIN_AHEAD_M: Final = 0.3
"""A tool leaves the soil, and enters it, over some decimetres."""
MIN_OFF_M: Final = 0.13
"""Soil is thrown, and left lying, by as much beside a tool."""
MIN_SEEN_WIDTH: Final = 0.6
MAX_SEEN_WIDTH: Final = 1.25
"""Ground that changed on one side of the line alone is a tool's work if it is that wide, as shares of the width stated:
wheels and windrows are narrower. Its far end may be beyond what is looked at."""


@dataclass(frozen=True)
class Clear:
    """How clearly an end must show.

    Attributes:
        contrast: mean square of the change where the tool worked, over that beside it, at least.
        gain: by how much −2 log likelihood falls at an end, at least.
    """

    contrast: float
    gain: float


ACROSS: Final = Clear(3.0, 15.0)
ALONG: Final = Clear(2.5, 6.0)
"""Soil is thrown ahead of a begin; and begin and end must agree, as the width's ends need not."""


@dataclass(frozen=True)
class ToolEnds:
    """Where the soil changes by what the tool did; nan where that is not shown.

    Attributes:
        left_m: how far to the left of the middle of the stated line.
        right_m: how far to its right.
        ahead_m: how far ahead of the stated line the tool works, by begins and ends of passes.
        aside_m: how far to the left of the middle, or to its right if negative, the soil begins to change, where it
            has not changed in the middle.
    """

    left_m: float
    right_m: float
    ahead_m: float = np.nan
    aside_m: float = np.nan

    def notices(self, implement: Implement) -> tuple[Notice, ...]:
        """That the tool is elsewhere, or wider or narrower; none where the soil does not show that."""
        half_m = 0.5 * implement.width_m
        told = []
        off_m = np.array([self.left_m, self.right_m]) - half_m
        if (np.abs(off_m) > MIN_OFF_M).any():
            left_m, right_m = (None if np.isnan(end_m) else float(end_m) for end_m in (self.left_m, self.right_m))
            told.append(Notice("tool-apart", left_m=left_m, right_m=right_m, half_m=half_m, tool=implement.name))
        if not np.isnan(self.aside_m):
            near_m = abs(self.aside_m)
            told.append(Notice("tool-apart.aside", near_m=near_m, is_left=self.aside_m > 0.0, tool=implement.name))
        if abs(self.ahead_m) > MIN_AHEAD_M:
            off = abs(self.ahead_m)
            told.append(Notice("tool-apart.along-track", off_m=off, is_ahead=self.ahead_m > 0.0, tool=implement.name))
        return tuple(told)


@dataclass(frozen=True)
class Transition:
    """The tool's line around the time at which it is lowered or lifted.

    Attributes:
        number: of the pass.
        lowered: whether the pass begins there, rather than ends.
        track: of the line, also where the tool is lifted.
        inside_m: (n,) way from the transition into the pass, at the times of the track.
    """

    number: int
    lowered: bool
    track: LineTrack
    inside_m: FloatArray

    @classmethod
    def of_pass(
        cls, trajectory: Trajectory, number: int, when: PassTimes, implement: Implement, *, lowered: bool
    ) -> Self | None:
        """That at the begin or the end of a pass; None where the vehicle does not go forward there."""
        at_s = when.begin_s if lowered else when.end_s
        around = PassTimes(at_s - AROUND_TRANSITION_S, at_s + AROUND_TRANSITION_S, 0.0, 0.0)
        for one in sweeps(trajectory, around, implement):
            if one.t_s[0] < at_s < one.t_s[-1]:
                since_m = one.distance_m - np.interp(at_s, one.t_s, one.distance_m)
                track = LineTrack(number, one.t_s, one.middle_m[:, :2], one.half_m)
                return cls(number, lowered, track, since_m if lowered else -since_m)
        return None


class ToolEdges:
    """Sums up changes of the ground across and along the tool's way; tiles may come from several threads."""

    def __init__(self, passes: Sequence[Passages], half_m: float, transitions: Sequence[Transition] = ()) -> None:
        self.half_m = half_m
        self._passes = passes
        self._transitions = [(one, Passages([one.track])) for one in transitions]
        self.bins = 2 * round((half_m + SEARCHED_BESIDE_M) / ACROSS_BIN_M)
        self.along_bins = 2 * round(ALONG_M / ACROSS_BIN_M)

    @classmethod
    def of_work(cls, trajectory: Trajectory, work: FieldWork, implement: Implement) -> Self:
        """Those of all passes of a tool."""
        runs = [sweeps(trajectory, when, implement) for when in work.passes]
        tracks = [
            [LineTrack(number, one.t_s, one.middle_m[:, :2], one.half_m) for one in run]
            for number, run in enumerate(runs, start=1)
        ]
        found = [
            Transition.of_pass(trajectory, number, when, implement, lowered=lowered)
            for number, when in enumerate(work.passes, start=1)
            for lowered in (True, False)
        ]
        passes = [Passages(one) for one in tracks]
        return cls(passes, 0.5 * implement.width_m, [one for one in found if one is not None])

    def changes(self, points: TilePoints, low: NDArray[np.bool_]) -> FloatArray:
        """(bins + 2 · along_bins, 3) of a tile: number of cells, sum and sum of squares of their changes.

        By place across the line, from the right; then by way into the pass at begins, and at ends.

        Args:
            low: (n,) which points are not high above the soil.
        """
        grid = points.grid
        reaching = [passages for passages in self._passes if passages.reach(grid, SEARCHED_BESIDE_M)]
        wide = [(int(one.number.max()), one) for one in (p.over(grid, SEARCHED_BESIDE_M) for p in reaching)]
        wide = [(number, passage) for number, passage in wide if number]
        sums = np.zeros((self.bins + 2 * self.along_bins, 3))
        for number, passage in wide:
            seen, change_m = self._change(points, low, passage, number, wide)
            at = np.floor(passage.across_m.ravel()[seen] / ACROSS_BIN_M) + self.bins // 2
            _count(sums[: self.bins], at, change_m)
        for transition, passages in self._transitions:
            if not passages.reach(grid):
                continue
            passage = passages.over(grid)
            seen, change_m = self._change(points, low, passage, transition.number, wide)
            inside_m = np.interp(passage.first_s.ravel()[seen], transition.track.t_s, transition.inside_m)
            at = np.floor(inside_m / ACROSS_BIN_M) + self.along_bins // 2
            first = self.bins + (0 if transition.lowered else self.along_bins)
            well_inside = np.abs(passage.across_m.ravel()[seen]) < WELL_INSIDE * self.half_m
            _count(sums[first : first + self.along_bins], at[well_inside], change_m[well_inside])
        return sums

    def _change(
        self,
        points: TilePoints,
        low: NDArray[np.bool_],
        passage: LinePassage,
        number: int,
        others: Sequence[tuple[int, LinePassage]],
    ) -> tuple[NDArray[np.intp], FloatArray]:
        """Cells (m,) that are seen before and after a passage, with no other passage between, and their changes."""
        never_s = np.full(points.grid.shape, np.inf)
        before_s = np.max([-never_s, *(one.last_s for other, one in others if other < number)], axis=0)
        after_s = np.min([never_s, *(one.first_s for other, one in others if other > number)], axis=0)
        limits = [
            (limit_s - points.begin_s).ravel().astype(np.float32)
            for limit_s in (before_s, passage.first_s, passage.last_s, after_s)
        ]
        heights = np.zeros((points.grid.rows * points.grid.columns, 4))
        _before_and_after(points.cell, points.t_s, points.height_m, low, *limits, np.float32(SETTLE_S), heights)
        both = (heights[:, 0] >= MIN_CELL_RETURNS) & (heights[:, 2] >= MIN_CELL_RETURNS)
        seen = np.flatnonzero(passage.passed.ravel() & both)
        change_m = heights[seen, 3] / heights[seen, 2] - heights[seen, 1] / heights[seen, 0]
        ground = np.abs(change_m) < MAX_CHANGE_M
        return seen[ground], change_m[ground]

    def ends(self, sums: FloatArray) -> ToolEnds:
        """Where the soil changes, by the sums of all tiles."""
        across = sums[: self.bins]
        middle = self.bins // 2
        begins, ends = np.split(sums[self.bins :], 2)
        left_m, right_m = (_end_m(side, self.half_m) for side in (across[middle:], across[:middle][::-1]))
        # Work that is shifted back begins earlier than stated, and ends earlier.
        earlier_m, later_m = (_end_m(way[::-1], ALONG_M, ALONG) - ALONG_M for way in (begins, ends))
        aside_m = np.nan
        if np.isnan(left_m) and np.isnan(right_m):
            to_right_m, to_left_m = (_near_end_m(side, self.half_m) for side in (across, across[::-1]))
            aside_m = to_left_m if np.isnan(to_right_m) else -to_right_m
        return ToolEnds(left_m, right_m, 0.5 * (later_m - earlier_m), aside_m)


def _count(sums: FloatArray, at: FloatArray, change_m: FloatArray) -> None:
    """Add changes (m,) to the sums (bins, 3) of their bins (m,), which may lie outside."""
    inside = (at >= 0) & (at < len(sums))
    number = at[inside].astype(np.intp)
    values = change_m[inside]
    for column, power in enumerate((np.ones(len(values)), values, values**2)):
        sums[:, column] += np.bincount(number, power, minlength=len(sums))


def _end_m(outward: FloatArray, half_m: float, clear: Clear = ACROSS) -> float:
    """The end of the working width by sums (k, 3) from the middle of the line outward; nan where it is not shown.

    It is where the mean square of the change in the bins inside exceeds that in those beside most clearly, of places up
    to which all the ground has changed.
    """
    count, total, squares = outward.T
    if (count[: INSIDE_BINS + BESIDE_BINS] < MIN_BIN_CELLS).any():
        return float("nan")
    known = int(np.argmax(np.append(count < MIN_BIN_CELLS, True)))
    number = count[:known] / CORRELATED_CELLS
    mean_square = squares[:known] / count[:known]
    best = 0
    best_gain = clear.gain
    for end in range(INSIDE_BINS, known - BESIDE_BINS + 1):
        inside = slice(end - INSIDE_BINS, end)
        beside = slice(end, end + BESIDE_BINS)
        worked = _mean(mean_square[:end], number[:end])
        smooth = np.convolve(mean_square[:end], np.full(EVEN_BINS, 1.0 / EVEN_BINS), "valid")
        if smooth.min() < MIN_CHANGED_SHARE * worked:
            break
        if _mean(mean_square[inside], number[inside]) < clear.contrast * _mean(mean_square[beside], number[beside]):
            continue
        gain = _gain(mean_square, number, inside, beside)
        if gain > best_gain:
            best = end
            best_gain = gain
    stated = round(half_m / ACROSS_BIN_M)
    if not best:
        return float("nan")
    if best * ACROSS_BIN_M - half_m > MIN_OFF_M and not _like_inside(total[:known] / count[:known], stated, best):
        return float("nan")
    # Cells on the end are in the last bin.
    return (best - 0.5) * ACROSS_BIN_M


def _near_end_m(towards: FloatArray, half_m: float) -> float:
    """How far beside the middle of the line work begins that is on one side of it; nan where there is none.

    Args:
        towards: (bins, 3) sums across the line, from the outside of that side to the other side.
    """
    middle = len(towards) // 2
    reach_m = len(towards) * ACROSS_BIN_M
    mean_square = towards[:, 2] / np.maximum(towards[:, 0], MIN_BIN_CELLS)
    for start in range(0, middle, INSIDE_BINS):
        end_m = start * ACROSS_BIN_M + _end_m(towards[start : middle + BESIDE_BINS], reach_m)
        if np.isnan(end_m):
            continue
        end = round(end_m / ACROSS_BIN_M + 0.5)
        unchanged = mean_square[end : end + BESIDE_BINS].mean()
        smooth = np.convolve(mean_square[:end][::-1], np.full(EVEN_BINS, 1.0 / EVEN_BINS), "valid")
        is_work = (smooth > ACROSS.contrast * unchanged) & (smooth < MAX_CHANGED_TIMES * smooth[0])
        bins = int(np.argmin(np.append(is_work, False)))
        if MIN_SEEN_WIDTH < 0.5 * bins * ACROSS_BIN_M / half_m < MAX_SEEN_WIDTH:
            return max(middle * ACROSS_BIN_M - end_m, 0.0)
    return float("nan")


def _mean(values: FloatArray, weight: FloatArray) -> float:
    return float(values @ weight / weight.sum())


def _gain(mean_square: FloatArray, number: FloatArray, inside: slice, beside: slice) -> float:
    """By how much −2 log likelihood falls if changes inside and beside have variances of their own."""
    parts = inside, beside, slice(inside.start, beside.stop)
    one, other, both = (number[k].sum() * np.log(_mean(mean_square[k], number[k])) for k in parts)
    return float(both - one - other)


def _like_inside(mean_m: FloatArray, stated: int, end: int) -> bool:
    """Whether ground beyond the stated end changed as that inside: wheels outside of the tool leave ruts."""
    usual_m = float(np.median(mean_m[:stated]))
    extra_m = float(np.median(mean_m[stated:end]))
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
