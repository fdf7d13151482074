"""Time in the field by activity, of a drive whose every second is known."""

from __future__ import annotations

import numpy as np
import pytest

from furrowmap.core.coverage.worked_ground import Hours, hours
from furrowmap.core.values.tool_states import ToolState, ToolStates
from furrowmap.core.values.trajectory import Motion, Trajectory, trajectory_from_attitude

MOTIONS = ((Motion.STANDING, 3), (Motion.FORWARD, 40), (Motion.REVERSE, 7), (Motion.STANDING, 5), (Motion.FORWARD, 45))


def trajectory(gap_s: float = 0.0) -> Trajectory:
    """A hundred seconds, of which the last forward ones may have a gap from 70 s on."""
    t_s = np.arange(0.0, 101.0)
    motion = np.append(np.repeat([int(kind) for kind, _ in MOTIONS], [count for _, count in MOTIONS]), 1)
    kept = (t_s <= 70.0) | (t_s >= 70.0 + gap_s)
    xyz = np.zeros((len(t_s), 3))
    return trajectory_from_attitude(
        t_s[kept], xyz[kept], 0.0, 0.0, 0.0, max_gap_s=1.5, motion=motion[kept].astype(np.int8)
    )


def states(*spans: tuple[float, float, ToolState]) -> ToolStates:
    begin, end, state = (np.array(column, np.float64) for column in zip(*spans, strict=True))
    one = np.ones(len(spans))
    return ToolStates(begin, end, state.astype(np.int8), one, 0.0 * one, 0.0 * one)


DOWN, UP, UNKNOWN = ToolState.DOWN, ToolState.UP, ToolState.UNKNOWN
ALL = states((0.0, 10.5, UP), (10.5, 40.25, DOWN), (40.25, 60.0, UP), (60.0, 65.0, UNKNOWN), (65.0, 100.0, DOWN))


@pytest.mark.parametrize(
    ("begin_s", "end_s", "expected"),
    [
        # Forward 3 to 43 and 55 to 100 s, backwards 43 to 50 s.
        (0.0, 100.0, Hours(100.0, 29.75 + 35.0, 7.5 + 2.75 + 5.0 + 7.0, 8.0, 5.0, 0.0)),
        (10.5, 40.25, Hours(29.75, 29.75, 0.0, 0.0, 0.0, 0.0)),
        (38.0, 57.5, Hours(19.5, 2.25, 2.75 + 7.0 + 2.5, 5.0, 0.0, 0.0)),
    ],
)
def test_hours__are_those_of_motion_and_tool(begin_s: float, end_s: float, expected: Hours) -> None:
    assert hours(trajectory(), ALL, begin_s, end_s) == expected


def test_hours__in_a_gap_of_the_positions_are_unplaced() -> None:
    found = hours(trajectory(gap_s=12.0), ALL, 0.0, 100.0)
    assert found == Hours(100.0, 29.75 + 23.0, 22.25, 8.0, 5.0, 12.0)


def test_hours__backwards_and_standing_do_not_depend_on_the_tool() -> None:
    for state in (DOWN, UP, UNKNOWN):
        found = hours(trajectory(), states((0.0, 100.0, state)), 0.0, 100.0)
        forward = {DOWN: found.working_s, UP: found.turning_s - 7.0, UNKNOWN: found.unknown_s}
        assert forward == {one: 85.0 if one == state else (-7.0 + 7.0) for one in forward}
        assert (found.idle_s, found.unplaced_s) == (8.0, 0.0)
