"""Motion of the line of the tool while it is down and moves forward."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy.spatial.transform import Rotation

from furrowmap.core.runtime.arrays import FloatArray
from furrowmap.core.trajectory.smoothing import smooth_path
from furrowmap.core.values.session import Implement
from furrowmap.core.values.tool_states import ToolState, ToolStates
from furrowmap.core.values.trajectory import Motion, Trajectory

LINE_EVERY_M: Final = 0.1
MIN_SWEEP_STEP_M: Final = 0.02
"""Shortest path of work; less is vibration."""
MIN_PART_M: Final = 1e-6
"""Parts of a line that follow each other leave no ground between them: shorter is nothing but rounding."""
MARGIN_S: Final = 2.0
"""How far beyond a pass its path is smoothed, so that the pass itself has no ends of a spline in it."""
KNOT_EVERY_S: Final = 0.1
"""Knots closer together are averaged: a vehicle's path bends by no millimetre within this time."""


@dataclass(frozen=True)
class PassTimes:
    """UTC from when to when the tool kept its state, and their standard deviations; nan where unknown."""

    begin_s: float
    end_s: float
    begin_sigma_s: float
    end_sigma_s: float


@dataclass(frozen=True)
class Sweep:
    """Successive places of the tool's line: one run forward of one pass.

    Attributes:
        t_s: (n,) UTC, strictly increasing, n of at least 2.
        middle_m: (n, 3) middle of the line in the map frame.
        half_m: (n, 2) from the middle to the line's left end, as seen from above.
        distance_m: (n,) driven since the run's beginning.
        begin_slip_m: standard deviation of the first line's place along the way, from the time of the transition; 0
            where the run does not begin with one; nan where unknown.
        end_slip_m: the same of the last line.
    """

    t_s: FloatArray
    middle_m: FloatArray
    half_m: FloatArray
    distance_m: FloatArray
    moving_s: float
    begin_slip_m: float
    end_slip_m: float


def pass_times(states: ToolStates) -> list[PassTimes]:
    """The times of all passes: intervals of `down`, those that touch each other as one."""
    passes: list[PassTimes] = []
    for k in np.flatnonzero(states.state == ToolState.DOWN).tolist():
        begin = float(states.begin_s[k])
        sigma = float(states.begin_sigma_s[k])
        if passes and passes[-1].end_s == begin:
            last = passes.pop()
            begin = last.begin_s
            sigma = last.begin_sigma_s
        passes.append(PassTimes(begin, float(states.end_s[k]), sigma, float(states.end_sigma_s[k])))
    return passes


def unknown_times(states: ToolStates) -> list[PassTimes]:
    """The times between known states of which the tool's state is not known."""
    known = np.flatnonzero(states.state != ToolState.UNKNOWN)
    spans = zip(states.end_s[known[:-1]].tolist(), states.begin_s[known[1:]].tolist(), strict=True)
    return [PassTimes(begin, end, math.nan, math.nan) for begin, end in spans if begin < end]


@dataclass(frozen=True)
class LinePart:
    """A part of the tool's line that keeps its state for a time.

    Attributes:
        ahead_m: of the middle of the tool's line.
        left_m: the left end, to the left of that middle.
        right_m: the right end, to the left of that middle.
        begin_sigma_s: standard deviation of `begin_s`; nan where unknown.
    """

    begin_s: float
    end_s: float
    ahead_m: float
    left_m: float
    right_m: float
    begin_sigma_s: float
    end_sigma_s: float


def sweeps(trajectory: Trajectory, times: PassTimes, implement: Implement) -> Iterator[Sweep]:
    """The runs forward from `times.begin_s` to `times.end_s`; reversing and gaps of the trajectory part them."""
    return (whole for whole, _ in part_sweeps(trajectory, times, implement, ()))


def part_sweeps(
    trajectory: Trajectory, times: PassTimes, implement: Implement, parts: Sequence[LinePart]
) -> Iterator[tuple[Sweep, list[Sweep]]]:
    """The runs of :func:`sweeps`, each with the sweeps of the parts of the tool's line in it, in their order."""
    t = trajectory.t_s
    first = max(0, int(np.searchsorted(t, times.begin_s - MARGIN_S)) - 1)
    behind = min(len(t), int(np.searchsorted(t, times.end_s + MARGIN_S, side="right")) + 1)
    gaps = first + 1 + np.flatnonzero(np.diff(t[first:behind]) > trajectory.max_gap_s)
    for part in np.split(np.arange(first, behind), gaps - first):
        if len(part) < 2 or t[part[0]] >= times.end_s or t[part[-1]] <= times.begin_s:
            continue
        yield from _Path(trajectory, slice(int(part[0]), int(part[-1]) + 1), implement).runs(times, parts)


class _Path:
    """The smoothed path of the line of the tool over knots without a gap."""

    def __init__(self, trajectory: Trajectory, knots: slice, implement: Implement) -> None:
        t = trajectory.t_s[knots]
        middle, left = tool_line(trajectory, knots, implement)
        side = np.hypot(left[:, 0], left[:, 1])
        yaw = np.unwrap(np.arctan2(-left[:, 0], left[:, 1]))
        self._origin = middle[0]
        self._t0 = float(t[0])
        table = _average(np.column_stack([t - self._t0, middle - self._origin, yaw, side]), KNOT_EVERY_S)
        self._knots = table[:, 0]
        self._place = smooth_path(table[:, 0], table[:, 1:3])
        self._yaw = smooth_path(table[:, 0], table[:, 4:5])
        self._height = table[:, 3]
        self._side = table[:, 5]
        self._motion = trajectory.motion[knots][np.searchsorted(t, t[0] + table[:, 0], side="right") - 1]
        self._half_width_m = 0.5 * implement.width_m

    def runs(self, times: PassTimes, parts: Sequence[LinePart]) -> Iterator[tuple[Sweep, list[Sweep]]]:
        """The runs forward within a pass, with those of the parts of the line."""
        begin = max(times.begin_s - self._t0, float(self._knots[0]))
        end = min(times.end_s - self._t0, float(self._knots[-1]))
        t = np.concatenate([[begin], self._knots[(self._knots > begin) & (self._knots < end)], [end]])
        motion = self._motion[np.searchsorted(self._knots, t[:-1], side="right") - 1]
        back = np.concatenate([[True], motion == Motion.REVERSE, [True]])
        edges = np.flatnonzero(np.diff(back.astype(np.int8)))
        for i, j in zip(edges[::2], edges[1::2], strict=True):
            run = t[i : j + 1]
            moving = motion[i:j] == Motion.FORWARD
            yaw = self._yaw(run)[:, 0]
            step = np.diff(self._place(run), axis=0)
            across = 0.5 * (yaw[1:] + yaw[:-1])
            forward = np.where(moving, step[:, 0] * np.cos(across) + step[:, 1] * np.sin(across), 0.0)
            way = np.concatenate([[0.0], np.cumsum(np.maximum(forward, 0.0))])
            if way[-1] < MIN_SWEEP_STEP_M:
                continue
            from_transition = run[0] == times.begin_s - self._t0
            to_transition = run[-1] == times.end_s - self._t0
            whole = self._sweep(
                run,
                way,
                float(np.diff(run)[moving].sum()),
                times.begin_sigma_s if from_transition else 0.0,
                times.end_sigma_s if to_transition else 0.0,
            )
            found = [self._part_sweep(run, way, part) for part in parts]
            yield whole, [sweep for sweep in found if sweep is not None]

    def _part_sweep(self, run: FloatArray, way: FloatArray, part: LinePart) -> Sweep | None:
        """What a part of the line sweeps in a run; None where it does not work or move then."""
        begin = max(part.begin_s - self._t0, float(run[0]))
        end = min(part.end_s - self._t0, float(run[-1]))
        if begin >= end:
            return None
        first_m, last_m = np.interp([begin, end], run, way).tolist()
        if last_m - first_m < MIN_PART_M:
            return None
        ways = np.linspace(first_m, last_m, max(2, int(np.ceil((last_m - first_m) / LINE_EVERY_M)) + 1))
        t = np.interp(ways, way, run)
        yaw = self._yaw(t)[:, 0]
        side = np.interp(t, self._knots, self._side)[:, None]
        forward = np.column_stack([np.cos(yaw), np.sin(yaw)])
        left = side * np.column_stack([-np.sin(yaw), np.cos(yaw)])
        middle = self._place(t) + part.ahead_m * forward + 0.5 * (part.left_m + part.right_m) * left
        speed = np.hypot(*self._place(np.array([begin, end]), 1).T)
        return Sweep(
            t_s=t + self._t0,
            middle_m=np.column_stack([middle, np.interp(t, self._knots, self._height)]) + self._origin,
            half_m=0.5 * (part.left_m - part.right_m) * left,
            distance_m=ways - first_m,
            moving_s=end - begin,
            begin_slip_m=part.begin_sigma_s * float(speed[0]),
            end_slip_m=part.end_sigma_s * float(speed[1]),
        )

    def _sweep(
        self, run: FloatArray, way: FloatArray, moving_s: float, begin_sigma_s: float, end_sigma_s: float
    ) -> Sweep:
        ways = np.linspace(0.0, way[-1], max(2, int(np.ceil(way[-1] / LINE_EVERY_M)) + 1))
        t = np.interp(ways, way, run)
        yaw = self._yaw(t)[:, 0]
        half = self._half_width_m * np.interp(t, self._knots, self._side)
        height = np.interp(t, self._knots, self._height)
        speed = np.hypot(*self._place(run[[0, -1]], 1).T)
        return Sweep(
            t_s=t + self._t0,
            middle_m=np.column_stack([self._place(t), height]) + self._origin,
            half_m=half[:, None] * np.column_stack([-np.sin(yaw), np.cos(yaw)]),
            distance_m=ways,
            moving_s=moving_s,
            begin_slip_m=begin_sigma_s * float(speed[0]),
            end_slip_m=end_sigma_s * float(speed[1]),
        )


def tool_line(trajectory: Trajectory, knots: slice, implement: Implement) -> tuple[FloatArray, FloatArray]:
    """At knots of the trajectory the middle (n, 3) of the tool's line, and the vehicle's y axis (n, 3), in the map."""
    rotation = Rotation.from_quat(trajectory.quaternion[knots], scalar_first=True)
    x_m, y_m = implement.xy_m
    return trajectory.xyz_m[knots] + rotation.apply([x_m, y_m, 0.0]), rotation.apply([0.0, 1.0, 0.0])


def _average(table: FloatArray, every_s: float) -> FloatArray:
    """Means of the rows (t_s, ...) of each `every_s`, the first and last row as they are."""
    if len(table) < 3 or float(np.median(np.diff(table[:, 0]))) > 0.5 * every_s:
        return table
    inner = table[1:-1]
    starts = np.flatnonzero(np.diff(np.floor(inner[:, 0] / every_s), prepend=-1.0))
    count = np.diff(np.append(starts, len(inner)))
    means = np.add.reduceat(inner, starts, axis=0) / count[:, None]
    return np.concatenate([table[:1], means, table[-1:]])
