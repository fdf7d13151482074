"""Paths of the tool and events along them."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

import numpy as np
import shapely

from furrowmap.core.runtime.arrays import FloatArray
from furrowmap.core.trajectory.motion import length_m
from furrowmap.core.values.rotation import quaternion_to_matrix
from furrowmap.core.values.session import Implement
from furrowmap.core.values.time_span import interval_numbers
from furrowmap.core.values.tool_states import ToolState, ToolStates
from furrowmap.core.values.trajectory import Motion, Trajectory
from furrowmap.core.work.sweep import pass_times

MOTION_EVENTS: Final = {Motion.STANDING: "stop", Motion.FORWARD: "start", Motion.REVERSE: "reverse"}
LINE_TOLERANCE_M: Final = 0.02
"""A line that shows where the tool was has as few vertices as leave it this near to its way."""


@dataclass(frozen=True)
class ToolPath:
    """The way of the middle of the tool's line in one state, forwards or backwards, without a gap.

    Attributes:
        pass_number: 1 for the first; None unless the tool is down.
        begin_s: UTC.
        end_s: UTC.
    """

    state: ToolState
    pass_number: int | None
    begin_s: float
    end_s: float
    line: shapely.LineString
    length_m: float


@dataclass(frozen=True)
class Event:
    """Something that happened at a moment.

    Attributes:
        kind: `down` or `up` of the tool; `stop`, `start` or `reverse` of the vehicle; `gap` where positions end.
        t_s: UTC.
        pass_number: the pass that begins, goes on or ends then; None between passes.
        sigma_s: standard deviation of `t_s`; nan where unknown.
        xyz_m: middle of the tool's line; nan where no position is known.
    """

    kind: str
    t_s: float
    pass_number: int | None
    sigma_s: float
    xyz_m: tuple[float, float, float]


def tool_paths(trajectory: Trajectory, states: ToolStates, implement: Implement) -> list[ToolPath]:
    """The tool's way, a line for each state in the order of time."""
    passes = pass_times(states)
    paths = []
    for state, begin_s, end_s in _stretches(states, trajectory.span_s):
        number = int(interval_numbers(passes, 0.5 * (begin_s + end_s))[0])
        first, behind = np.searchsorted(trajectory.t_s, [begin_s, end_s], side="left").tolist()
        first += int(trajectory.t_s[first] == begin_s)
        t = np.concatenate([[begin_s], trajectory.t_s[first:behind], [end_s]])
        xyz = tool_at(trajectory, implement, t)
        known = np.isfinite(xyz[:, 0])
        breaks = 1 + np.flatnonzero((np.diff(t) > trajectory.max_gap_s) | (known[1:] != known[:-1]))
        for part in np.split(np.arange(len(t)), breaks):
            if len(part) < 2 or not known[part[0]]:
                continue
            line = shapely.simplify(shapely.LineString(xyz[part]), LINE_TOLERANCE_M, preserve_topology=False)
            distance_m = length_m(xyz[part, :2])
            paths.append(ToolPath(state, number or None, float(t[part[0]]), float(t[part[-1]]), line, distance_m))
    return paths


def events(trajectory: Trajectory, states: ToolStates, implement: Implement) -> list[Event]:
    """What happened, in the order of time."""
    found = [*_transitions(states)]
    changed = 1 + np.flatnonzero(np.diff(trajectory.motion))
    motions, changed_s = trajectory.motion[changed].tolist(), trajectory.t_s[changed].tolist()
    found += [(MOTION_EVENTS[Motion(k)], t_s, float("nan")) for k, t_s in zip(motions, changed_s, strict=True)]
    found += [("gap", float(begin_s), float("nan")) for begin_s in trajectory.gaps_s[:, 0]]
    found.sort(key=lambda event: event[1])
    times = np.array([t_s for _, t_s, _ in found])
    numbers = interval_numbers(pass_times(states), times)
    places = tool_at(trajectory, implement, times)
    return [
        Event(kind, t_s, number or None, sigma_s, (e, n, h))
        for (kind, t_s, sigma_s), number, (e, n, h) in zip(found, numbers.tolist(), places.tolist(), strict=True)
    ]


def tool_at(trajectory: Trajectory, implement: Implement, t_s: FloatArray) -> FloatArray:
    """Middle (n, 3) of the tool's line in the map at times (n,); nan where there is no pose."""
    poses = trajectory.at(t_s)
    known = np.isfinite(poses.quaternion[:, 0])
    x_m, y_m = implement.xy_m
    place = np.full((len(known), 3), np.nan)
    place[known] = poses.xyz_m[known] + quaternion_to_matrix(poses.quaternion[known]) @ np.array([x_m, y_m, 0.0])
    return place


def _stretches(states: ToolStates, span_s: tuple[float, float]) -> Iterator[tuple[ToolState, float, float]]:
    """(state, begin_s, end_s) of all the time of a trajectory, unknown where `states` say nothing."""
    at_s = span_s[0]
    for k in range(len(states)):
        begin_s, end_s = max(float(states.begin_s[k]), at_s), min(float(states.end_s[k]), span_s[1])
        if begin_s >= end_s:
            continue
        if begin_s > at_s:
            yield ToolState.UNKNOWN, at_s, begin_s
        yield ToolState(int(states.state[k])), begin_s, end_s
        at_s = end_s
    if at_s < span_s[1]:
        yield ToolState.UNKNOWN, at_s, span_s[1]


def _transitions(states: ToolStates) -> Iterator[tuple[str, float, float]]:
    """(kind, t_s, sigma_s) where the tool went down or up; from unknown to what it was before is none."""
    last = None
    for k in np.flatnonzero(states.state != ToolState.UNKNOWN).tolist():
        state = ToolState(int(states.state[k]))
        if last is not None and state is not last:
            yield state.label, float(states.begin_s[k]), float(states.begin_sigma_s[k])
        last = state
