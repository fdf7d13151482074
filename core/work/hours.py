"""Time in the field by activity."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from furrowmap.core.values.tool_states import ToolState, ToolStates
from furrowmap.core.values.trajectory import Motion, Trajectory


@dataclass(frozen=True)
class Hours:
    """Seconds between the beginning of the first pass and the end of the last; the parts add up to the whole.

    Attributes:
        field_s: the whole.
        working_s: forward, the tool down.
        turning_s: moving with the tool up, or backwards.
        idle_s: standing.
        unknown_s: moving forward, the tool's state unknown.
        unplaced_s: without a position.
    """

    field_s: float
    working_s: float
    turning_s: float
    idle_s: float
    unknown_s: float
    unplaced_s: float


def hours(trajectory: Trajectory, states: ToolStates, begin_s: float, end_s: float) -> Hours:
    """How the time from `begin_s` to `end_s` was spent."""
    cuts = np.concatenate([trajectory.t_s, states.begin_s, states.end_s, [begin_s, end_s]])
    t = np.unique(np.clip(cuts, begin_s, end_s))
    length, middle = np.diff(t), 0.5 * (t[1:] + t[:-1])
    knot, _, placed = trajectory.interval(middle)
    motion, state = trajectory.motion[knot], states.at(middle)[0]
    standing = placed & (motion == Motion.STANDING)
    forward, back = placed & (motion == Motion.FORWARD), placed & (motion == Motion.REVERSE)
    spent = [
        forward & (state == ToolState.DOWN),
        forward & (state == ToolState.UP) | back,
        standing,
        forward & (state == ToolState.UNKNOWN),
        ~placed,
    ]
    return Hours(float(end_s - begin_s), *(float(length[part].sum()) for part in spent))
