"""From heights to states: when the tool went into the ground and when it left it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import expit, ndtr

from furrowmap.core.implement.heights import ToolHeights
from furrowmap.core.implement.levels import SHORTEST_S
from furrowmap.core.implement.model import Implement
from furrowmap.core.values.errors import Notice
from furrowmap.core.values.tool_states import ToolState, ToolStates

FloatArray = NDArray[np.float64]

_GAP_S: Final = 1.5
"""A tool that is out of sight for longer may have been lifted and lowered again."""
_MOVE_S: Final = 1.0
"""No longer than this is it on its way from where it was last seen."""
_STEP_M: Final = 0.12
"""A height that differs by so much from those before and behind it is that of something else."""
_LEVEL_M: Final = 0.004
"""How well the working position itself is known."""
_LEVEL_REACH: Final = 2.5
"""Heights that differ from it by more standard deviations are those of a tool on its way."""
_LEVEL_ROUNDS: Final = 8
_WORTH: Final = 0.05
"""Share of the points' log-likelihood that counts, as neighbouring points err together."""
_BLINK_S: Final = 0.45
"""A tool out of view for less has been covered, not lowered."""
_JITTER_S: Final = 0.2
"""Between turns so far apart a tool's own movement at work, of some hertz, is not seen; what is missed
grows as the square of the time (as a sine over a chord)."""
_LIFT_SIGMA_M: Final = 0.12
"""How well a working position is known that is never in view."""
_USUAL_MPS: Final = 0.4
"""A lift takes about a second."""
_UNSEEN: Final = 0.9
"""Confidence of the state in which the tool is out of view."""
_COVERED: Final = 0.5
"""Share of an interval's confidence that remains where the tool was covered for a while."""
_UNCLEAR: Final = Notice(
    "implement-unclear",
    "What the scanner sees of the implement changes too often to be a tool that is lifted and lowered: whether it "
    "works is unknown throughout.",
)


@dataclass(frozen=True)
class ToolHistory:
    """The tool over a recording.

    Attributes:
        scan: (n,) int64 number of each scan with returns.
        t_s: (n,) UTC of the middle of each.
        tool_height_m: (n,) above the working position; nan where unknown.
        soil_height_m: (n,) of the soil beside the tool, above the plane on which the vehicle stands; nan where unknown.
        state: (n,) int8, values of :class:`ToolState`.
        confidence: (n,) 0 to 1, that `state` is true.
        states: the same as intervals, with the transitions' times.
        threshold_m: the height above the working position below which the tool is down.
        lifted_m: height of the lifted tool.
        notices: for the report.
    """

    scan: NDArray[np.int64]
    t_s: FloatArray
    tool_height_m: FloatArray
    soil_height_m: FloatArray
    state: NDArray[np.int8]
    confidence: FloatArray
    states: ToolStates
    threshold_m: float
    lifted_m: float
    notices: tuple[Notice, ...]


def tool_history(heights: ToolHeights, implement: Implement, working_depth_m: float | None) -> ToolHistory:
    """States and transitions of the tool from its heights.

    A transition is the moment at which the height passes the threshold, interpolated between turns. It counts if the
    tool then moves on by a margin, so that noise and a tool that dances at the threshold change nothing; the time is
    still that of the passage.

    Args:
        heights: of all turns.
        implement: as it was learned.
        working_depth_m: as the session states it.
    """
    threshold = implement.threshold_m(working_depth_m)
    height = _without_strays(heights.height_m, heights.whole)
    level = _working_level(height[height < threshold]) if implement.levels.hidden != ToolState.DOWN else 0.0
    height = height - level
    confidence = _confidence(heights, height, threshold, implement)
    states = _states(heights, height, confidence, threshold, implement)
    notices: tuple[Notice, ...] = ()
    if len(states) > 3 and float((states.end_s - states.begin_s).mean()) < SHORTEST_S:
        states, notices = _tool_states([]), (_UNCLEAR,)
    t = 0.5 * (heights.scan_begin_s + heights.scan_end_s)
    state, sure = states.at(t)
    reach_s = 4.0 * implement.region.turn_s
    now = _interpolated(t, heights.t_s, np.where(confidence > 0.0, confidence, np.nan), reach_s)
    return ToolHistory(
        scan=heights.scan,
        t_s=t,
        tool_height_m=_interpolated(t, heights.t_s, height, reach_s),
        soil_height_m=_interpolated(t, heights.t_s, heights.soil_m, reach_s),
        state=state,
        confidence=np.where(np.isfinite(now), np.minimum(sure, now), _COVERED * sure),
        states=states,
        threshold_m=threshold,
        lifted_m=implement.lifted_m - level,
        notices=notices,
    )


def _working_level(down: FloatArray) -> float:
    """The working position in the heights (n,) of a tool that is down: the median of those at work.

    Heights of a tool on its way lie above it only; as a share of a short pass they would draw the median upwards.
    """
    level, reach = 0.0, np.inf
    for _ in range(_LEVEL_ROUNDS):
        near = down[np.abs(down - level) <= reach]
        if not len(near):
            break
        level = float(np.median(near))
        below = level - near[near <= level]
        reach = max(_LEVEL_REACH * 1.4826 * float(np.median(below)), _LEVEL_M)
    return level


def _without_strays(height: FloatArray, whole: NDArray[np.bool_]) -> FloatArray:
    """Heights without those that differ from both their neighbours while these agree.

    A turn that was cut short shows a part of the tool only: there one neighbour is enough.
    """
    known = np.flatnonzero(np.isfinite(height))
    out = height.copy()
    if len(known):
        step = np.abs(np.diff(height[known]))
        off = np.minimum(np.append(np.inf, step), np.append(step, np.inf))
        agree = np.zeros(len(known), bool)
        agree[1:-1] = np.abs(height[known[2:]] - height[known[:-2]]) < off[1:-1]
        out[known[(off > _STEP_M) & (agree | ~whole[known])]] = np.nan
    return out


def _confidence(heights: ToolHeights, height: FloatArray, threshold: float, implement: Implement) -> FloatArray:
    """(n,) that the tool is on the side of the threshold on which it was measured; 0 where it was not seen."""
    sigma = np.hypot(implement.levels.jitter_m, _LEVEL_M)
    sure = ndtr(np.abs(height - threshold) / sigma) * expit(_WORTH * heights.contrast)
    unseen: FloatArray = np.zeros(len(height))
    if implement.levels.hidden != ToolState.UNKNOWN:
        unseen = np.where(heights.whole, _UNSEEN, 0.0) * np.clip(1.0 - 4.0 * heights.seen, 0.0, 1.0)
    return np.where(np.isfinite(height), sure, unseen)


def _states(
    heights: ToolHeights, height: FloatArray, confidence: FloatArray, threshold: float, implement: Implement
) -> ToolStates:
    """Intervals of one state, with the times at which the tool passed the threshold."""
    lower = min(0.25 * threshold, 3.0 * implement.levels.jitter_m)
    upper = min(0.25 * (implement.lifted_m - threshold), 3.0 * implement.levels.jitter_m)
    beyond = np.full(len(height), ToolState.UNKNOWN, np.int8)
    beyond[height < threshold - lower] = ToolState.DOWN
    beyond[height > threshold + upper] = ToolState.UP
    if implement.levels.hidden != ToolState.UNKNOWN:
        away = np.isnan(height) & (confidence > 0.5 * _UNSEEN)
        beyond[_lasting(heights.t_s, away, _BLINK_S)] = implement.levels.hidden
    known = np.flatnonzero(beyond != ToolState.UNKNOWN)
    if not len(known):
        return _tool_states([])
    t = heights.t_s
    begin = _End(float(heights.scan_begin_s[0]), 0.0)
    if t[known[0]] - begin.t_s > _GAP_S:
        begin = _End(float(t[known[0]]), float("nan"))
    rows: list[_Interval] = []
    first = int(known[0])
    for a, b in pairwise(known.tolist()):
        lost = _longest_gap(t, height, beyond, a, b) > _GAP_S
        if beyond[a] == beyond[b] and not lost:
            continue
        passage = None if lost else _passage(t, height, a, b, threshold, implement)
        worth = float(np.median(confidence[known[(known >= first) & (known <= a)]]))
        rows.append(_Interval(begin, passage or _End(float(t[a]), float("nan")), int(beyond[a]), worth))
        begin = passage or _End(float(t[b]), float("nan"))
        first = b
    last = int(known[-1])
    end = _End(float(heights.scan_end_s[-1]), 0.0)
    if end.t_s - t[last] > _GAP_S:
        end = _End(float(t[last]), float("nan"))
    rows.append(_Interval(begin, end, int(beyond[last]), float(np.median(confidence[known[known >= first]]))))
    return _tool_states(rows)


def _lasting(t_s: FloatArray, true: NDArray[np.bool_], least_s: float) -> NDArray[np.bool_]:
    """(n,) `true` without those runs of it between whose neighbours on both sides less than `least_s` passes."""
    edges = np.flatnonzero(np.diff(true.astype(np.int8), prepend=0, append=0)).reshape(-1, 2)
    out = np.zeros(len(true), bool)
    for first, behind in edges:
        if first == 0 or behind == len(true) or t_s[behind] - t_s[first - 1] > least_s:
            out[first:behind] = True
    return out


class _End(NamedTuple):
    """Where an interval begins or ends: UTC and its standard deviation."""

    t_s: float
    sigma_s: float


class _Interval(NamedTuple):
    """A time of one state."""

    begin: _End
    end: _End
    state: int
    confidence: float


def _tool_states(intervals: Sequence[_Interval]) -> ToolStates:
    some = [interval for interval in intervals if interval.end.t_s > interval.begin.t_s]
    return ToolStates(
        begin_s=np.array([interval.begin.t_s for interval in some], np.float64),
        end_s=np.array([interval.end.t_s for interval in some], np.float64),
        state=np.array([interval.state for interval in some], np.int8),
        confidence=np.array([interval.confidence for interval in some], np.float64),
        begin_sigma_s=np.array([interval.begin.sigma_s for interval in some], np.float64),
        end_sigma_s=np.array([interval.end.sigma_s for interval in some], np.float64),
        common_share=1.0,  # nearly all of it is that of the working position
    )


def _longest_gap(t: FloatArray, height: FloatArray, beyond: NDArray[np.int8], a: int, b: int) -> float:
    """The longest time between turns a and b in which nothing is known."""
    inner = np.arange(a, b + 1)
    known = inner[np.isfinite(height[a : b + 1]) | (beyond[a : b + 1] != ToolState.UNKNOWN)]
    return float(np.diff(t[known]).max())


def _passage(t: FloatArray, height: FloatArray, a: int, b: int, threshold: float, implement: Implement) -> _End:
    """When the tool passed the threshold between the turns a and b, and the standard deviation of that.

    Where it is out of view on one side, it passed between the last turn that saw it and the next.
    """
    if np.isnan(height[a]) or np.isnan(height[b]):
        return _passage_out_of_view(t, height, a, b, threshold)
    seen = a + np.flatnonzero(np.isfinite(height[a : b + 1]))
    above = height[seen] >= threshold
    # the last passage in the direction of the change
    k = int(np.flatnonzero(above[1:] != above[:-1])[-1])
    i, j = seen[k], seen[k + 1]
    slope = (height[j] - height[i]) / (t[j] - t[i])
    at = _crossing(t[i - 1 : j + 2], height[i - 1 : j + 2], threshold) if j == i + 1 else None
    if at is None:
        at = float(t[i] + (threshold - height[i]) / slope)
    level_m = _LIFT_SIGMA_M if implement.levels.hidden == ToolState.DOWN else _LEVEL_M
    between_m = implement.levels.jitter_m * min(1.0, float(t[j] - t[i]) / _JITTER_S) ** 2
    return _End(at, math.hypot(implement.levels.sigma_m, level_m, between_m) / abs(float(slope)))


def _crossing(t: FloatArray, height: FloatArray, threshold: float) -> float | None:
    """When the cubic through four successive heights passes the threshold between the middle two.

    A lift speeds up and slows down, and its tool jitters: a straight line between turns 0.2 s apart would be late. None
    where not all four are known, or where they do not go one way.
    """
    step = np.diff(height)
    if len(t) < 4 or not ((step > 0.0).all() or (step < 0.0).all()):
        return None
    since = t - t[1]
    roots = np.roots(np.polyfit(since, height - threshold, 3))
    real = roots.real[np.abs(roots.imag) < 1e-9]
    between = real[(real >= 0.0) & (real <= since[2])]
    return float(t[1] + between[0]) if len(between) == 1 else None


def _passage_out_of_view(t: FloatArray, height: FloatArray, a: int, b: int, threshold: float) -> _End:
    """When the tool passed the threshold where it is out of view at the turn a or b.

    It leaves or enters the view between two turns; if the threshold lies beyond, it moves on as fast as it was seen.
    """
    leaves = bool(np.isnan(height[b]))
    seen = np.flatnonzero(np.isfinite(height))
    seen = seen[seen < b][::-1] if leaves else seen[seen > a]
    near = seen[np.abs(t[seen] - t[seen[0]]) < _MOVE_S]
    edge = near[0]
    border_s = 0.5 * float(t[edge] + t[edge + 1 if leaves else edge - 1])
    half_turn_s = abs(border_s - float(t[edge]))
    travel = height[near] - height[edge]
    seen_mps = float(np.max(np.abs(travel[1:] / (t[near[1:]] - t[edge])), initial=0.0))
    speed = max(seen_mps, _USUAL_MPS)  # near the end of its way, where it may be seen only, it is slow
    beyond_m = abs(height[edge] - threshold) - speed * half_turn_s
    after_s = float(np.clip(beyond_m / speed, 0.0, _MOVE_S))
    at = border_s + (after_s if leaves else -after_s)
    return _End(at, float(np.hypot(_LIFT_SIGMA_M / speed, half_turn_s)))


def _interpolated(t_s: FloatArray, known_s: FloatArray, values: FloatArray, reach_s: float) -> FloatArray:
    """`values` at times `t_s`; nan where the known ones before and behind are further apart than `reach_s`."""
    known = np.isfinite(values)
    if not known.any():
        return np.full(len(t_s), np.nan)
    at, value = known_s[known], values[known]
    after = np.clip(np.searchsorted(at, t_s), 0, len(at) - 1)
    before = np.maximum(np.searchsorted(at, t_s, side="right") - 1, 0)
    near = np.abs(at[after] - t_s) + np.abs(t_s - at[before]) < reach_s
    return np.where(near, np.interp(t_s, at, value), np.nan)
