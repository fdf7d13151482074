"""States and transitions of the tool from its heights."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import expit, ndtr

from furrowmap.core.implement.heights import ToolHeights
from furrowmap.core.implement.levels import SHORTEST_S
from furrowmap.core.implement.seen_implement import SeenImplement
from furrowmap.core.runtime.arrays import FloatArray
from furrowmap.core.runtime.errors import Notice
from furrowmap.core.values.tool_states import ToolState, ToolStates

# Longest time out of sight without an unknown state, longest motion out of view, least absence that is not occlusion.
_GAP_S: Final = 1.5
_MOVE_S: Final = 1.0
_BLINK_S: Final = 0.45
# Outlier threshold against the neighbours in time; standard deviations of the working position, in view and never seen.
_STEP_M: Final = 0.12
_LEVEL_M: Final = 0.004
_LIFT_SIGMA_M: Final = 0.12
_LEVEL_REACH: Final = 2.5
"""Heights farther from the working position, in standard deviations, are of a moving tool."""
_LEVEL_ROUNDS: Final = 8
_WORTH: Final = 0.05
"""Weight of the log-likelihood, as errors of neighbouring points are correlated."""
_JITTER_S: Final = 0.2
"""Interval of revolutions at which jitter of some hertz is fully missed; the missed part grows as its square."""
_USUAL_MPS: Final = 0.4  # of a lift
# Confidence of a state out of view, and factor of the confidence while the tool is occluded.
_UNSEEN: Final = 0.9
_COVERED: Final = 0.5
_UNCLEAR: Final = Notice("implement-unclear")


@dataclass(frozen=True)
class ToolHistory:
    """The tool over a recording.

    Attributes:
        t_s: (n,) UTC of the middle of each scan with returns.
        tool_height_m: (n,) above the working position; nan where unknown.
        soil_height_m: (n,) of the soil beside the tool above the ground plane; nan where unknown.
        state: (n,) int8, values of :class:`ToolState`.
        confidence: (n,) of `state`, 0 to 1.
        states: the same as intervals, with times of transitions.
        threshold_m: height above the working position below which the tool is down.
    """

    t_s: FloatArray
    tool_height_m: FloatArray
    soil_height_m: FloatArray
    state: NDArray[np.int8]
    confidence: FloatArray
    states: ToolStates
    threshold_m: float
    lifted_m: float
    notices: tuple[Notice, ...]


def tool_history(heights: ToolHeights, implement: SeenImplement, working_depth_m: float | None) -> ToolHistory:
    """States and transitions of the tool from its heights.

    A transition is the interpolated time at which the height crosses the threshold. It counts only if the tool then
    moves on by a margin, so that jitter at the threshold has no effect.
    """
    threshold = implement.threshold_m(working_depth_m)
    height = _remove_strays(heights.height_m, heights.whole)
    level = _working_level(height[height < threshold]) if implement.levels.hidden != ToolState.DOWN else 0.0
    height = height - level
    confidence = _confidence(heights, height, threshold, implement)
    states = _states(heights, height, confidence, threshold, implement)
    notices: tuple[Notice, ...] = ()
    if len(states) > 3 and float((states.end_s - states.begin_s).mean()) < SHORTEST_S:
        states = _tool_states([])
        notices = (_UNCLEAR,)
    t = 0.5 * (heights.scan_begin_s + heights.scan_end_s)
    state, sure = states.at(t)
    reach_s = 4.0 * implement.region.turn_s
    now = _interpolate(t, heights.t_s, np.where(confidence > 0.0, confidence, np.nan), reach_s)
    return ToolHistory(
        t_s=t,
        tool_height_m=_interpolate(t, heights.t_s, height, reach_s),
        soil_height_m=_interpolate(t, heights.t_s, heights.soil_m, reach_s),
        state=state,
        confidence=np.where(np.isfinite(now), np.minimum(sure, now), _COVERED * sure),
        states=states,
        threshold_m=threshold,
        lifted_m=implement.lifted_m - level,
        notices=notices,
    )


def _working_level(down: FloatArray) -> float:
    """Working position from heights (n,) of the lowered tool: their median without those of the moving tool."""
    level = 0.0
    reach = np.inf
    for _ in range(_LEVEL_ROUNDS):
        near = down[np.abs(down - level) <= reach]
        if not len(near):
            break
        level = float(np.median(near))
        below = level - near[near <= level]
        reach = max(_LEVEL_REACH * 1.4826 * float(np.median(below)), _LEVEL_M)
    return level


def _remove_strays(height: FloatArray, whole: NDArray[np.bool_]) -> FloatArray:
    """Heights without those that differ from two equal neighbours; for truncated revolutions from one neighbour."""
    known = np.flatnonzero(np.isfinite(height))
    out = height.copy()
    if len(known):
        step = np.abs(np.diff(height[known]))
        off = np.minimum(np.append(np.inf, step), np.append(step, np.inf))
        agree = np.zeros(len(known), bool)
        agree[1:-1] = np.abs(height[known[2:]] - height[known[:-2]]) < off[1:-1]
        out[known[(off > _STEP_M) & (agree | ~whole[known])]] = np.nan
    return out


def _confidence(heights: ToolHeights, height: FloatArray, threshold: float, implement: SeenImplement) -> FloatArray:
    """(n,) probability that the tool is on the measured side of the threshold; 0 where not seen."""
    sigma = np.hypot(implement.levels.jitter_m, _LEVEL_M)
    sure = ndtr(np.abs(height - threshold) / sigma) * expit(_WORTH * heights.contrast)
    unseen: FloatArray = np.zeros(len(height))
    if implement.levels.hidden != ToolState.UNKNOWN:
        unseen = np.where(heights.whole, _UNSEEN, 0.0) * np.clip(1.0 - 4.0 * heights.seen, 0.0, 1.0)
    return np.where(np.isfinite(height), sure, unseen)


def _states(
    heights: ToolHeights, height: FloatArray, confidence: FloatArray, threshold: float, implement: SeenImplement
) -> ToolStates:
    """Intervals of one state, with the times of the crossings."""
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
    ends = np.flatnonzero((np.diff(beyond[known]) != 0) | (np.diff(t[known]) > _GAP_S))
    for a, b in zip(known[ends].tolist(), known[ends + 1].tolist(), strict=True):
        seen = np.isfinite(height[a : b + 1]) | (beyond[a : b + 1] != ToolState.UNKNOWN)
        lost = float(np.diff(t[a : b + 1][seen]).max()) > _GAP_S
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
    """(n,) `true` without runs whose neighbours are less than `least_s` apart."""
    edges = np.flatnonzero(np.diff(true.astype(np.int8), prepend=0, append=0)).reshape(-1, 2)
    out = np.zeros(len(true), bool)
    for first, behind in edges:
        if first == 0 or behind == len(true) or t_s[behind] - t_s[first - 1] > least_s:
            out[first:behind] = True
    return out


class _End(NamedTuple):
    """UTC of the start or end of an interval, with standard deviation."""

    t_s: float
    sigma_s: float


class _Interval(NamedTuple):
    """An interval of one state."""

    begin: _End
    end: _End
    state: int
    confidence: float


def _tool_states(intervals: Sequence[_Interval]) -> ToolStates:
    """The intervals that last: out of view for less time than the way there takes, the tool stayed where it was."""
    some: list[_Interval] = []
    for one in intervals:
        if one.end.t_s <= one.begin.t_s:
            if some:
                some[-1] = some[-1]._replace(end=one.end)
        elif some and some[-1].state == one.state and some[-1].end.t_s == one.begin.t_s:
            some[-1] = some[-1]._replace(end=one.end, confidence=min(some[-1].confidence, one.confidence))
        else:
            some.append(one if some else one._replace(begin=intervals[0].begin))
    return ToolStates(
        begin_s=np.array([interval.begin.t_s for interval in some], np.float64),
        end_s=np.array([interval.end.t_s for interval in some], np.float64),
        state=np.array([interval.state for interval in some], np.int8),
        confidence=np.array([interval.confidence for interval in some], np.float64),
        begin_sigma_s=np.array([interval.begin.sigma_s for interval in some], np.float64),
        end_sigma_s=np.array([interval.end.sigma_s for interval in some], np.float64),
        common_share=1.0,  # nearly all of it is that of the working position
    )


def _passage(t: FloatArray, height: FloatArray, a: int, b: int, threshold: float, implement: SeenImplement) -> _End:
    """Time of the crossing between revolutions a and b, with standard deviation."""
    if np.isnan(height[a]) or np.isnan(height[b]):
        return _passage_out_of_view(t, height, a, b, threshold)
    seen = a + np.flatnonzero(np.isfinite(height[a : b + 1]))
    above = height[seen] >= threshold
    # the last crossing in the direction of the change
    k = int(np.flatnonzero(above[1:] != above[:-1])[-1])
    i = seen[k]
    j = seen[k + 1]
    slope = (height[j] - height[i]) / (t[j] - t[i])
    at = _crossing(t[i - 1 : j + 2], height[i - 1 : j + 2], threshold) if j == i + 1 else None
    if at is None:
        at = float(t[i] + (threshold - height[i]) / slope)
    level_m = _LIFT_SIGMA_M if implement.levels.hidden == ToolState.DOWN else _LEVEL_M
    between_m = implement.levels.jitter_m * min(1.0, float(t[j] - t[i]) / _JITTER_S) ** 2
    return _End(at, math.hypot(implement.levels.sigma_m, level_m, between_m) / abs(float(slope)))


def _crossing(t: FloatArray, height: FloatArray, threshold: float) -> float | None:
    """Crossing of the cubic through four successive heights between the middle two; None if unknown or not monotonic.

    Linear interpolation between revolutions 0.2 s apart would be late, as a lift accelerates.
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
    """Time of the crossing where the tool is out of view at revolution a or b.

    It leaves or enters the view between two revolutions; beyond, its observed speed is extrapolated.
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
    speed = max(seen_mps, _USUAL_MPS)  # it may be visible only near the end of its travel, where it is slow
    beyond_m = abs(height[edge] - threshold) - speed * half_turn_s
    after_s = float(np.clip(beyond_m / speed, 0.0, _MOVE_S))
    at = border_s + (after_s if leaves else -after_s)
    return _End(at, float(np.hypot(_LIFT_SIGMA_M / speed, half_turn_s)))


def _interpolate(t_s: FloatArray, known_s: FloatArray, values: FloatArray, reach_s: float) -> FloatArray:
    """`values` at times `t_s`; nan where the known ones around are farther apart than `reach_s`."""
    known = np.isfinite(values)
    if not known.any():
        return np.full(len(t_s), np.nan)
    at = known_s[known]
    value = values[known]
    after = np.clip(np.searchsorted(at, t_s), 0, len(at) - 1)
    before = np.maximum(np.searchsorted(at, t_s, side="right") - 1, 0)
    near = np.abs(at[after] - t_s) + np.abs(t_s - at[before]) < reach_s
    return np.where(near, np.interp(t_s, at, value), np.nan)
