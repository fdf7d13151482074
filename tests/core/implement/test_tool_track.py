"""The tool's own way and the events along it."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
import shapely

from furrowmap.core.coverage.field_work import events, tool_at, tool_paths
from furrowmap.core.coverage.sweep import pass_times
from furrowmap.core.values.session import Implement
from furrowmap.core.values.time_span import interval_numbers
from furrowmap.core.values.tool_states import ToolState, ToolStates
from tests.core.implement.drives_with_tool import PLACE_M, sample, states_of, trajectory_of
from tests.core.trajectory.drives import Drive, drive

TILLER = Implement(width_m=1.7, xy_m=(-1.5, 0.3))
THERE_AND_BACK = drive((20.0, 1.2, 0.0), (4.0, 0.0, 0.0), (10.0, -1.0, 0.0), (4.0, 0.0, 0.0), (10.0, 1.2, 0.0))


def test_tool_at__is_behind_and_to_the_left_of_the_axle() -> None:
    truth = drive((20.0, 1.2, 6.0), yaw_deg=50.0)
    place = tool_at(trajectory_of(truth), TILLER, truth.t_s)
    c, s = np.cos(truth.yaw_rad), np.sin(truth.yaw_rad)
    expected = truth.en_m + PLACE_M + np.column_stack([-1.5 * c - 0.3 * s, -1.5 * s + 0.3 * c])
    assert place[:, :2] == pytest.approx(expected, abs=1e-6)
    assert place[:, 2] == pytest.approx(250.0)


def test_tool_paths__join_end_to_end_and_are_as_long_as_the_way() -> None:
    trajectory = trajectory_of(THERE_AND_BACK)
    states = states_of(trajectory, (2.0, 18.0), (40.0, 46.0), unknown_s=(18.0, 22.0))
    paths = tool_paths(trajectory, states, TILLER)
    labels = [(p.state.label, p.pass_number) for p in paths]
    assert labels == [("up", None), ("down", 1), ("unknown", None), ("up", None), ("down", 2), ("up", None)]
    for one, following in pairwise(paths):
        assert one.end_s == following.begin_s
        assert one.line.coords[-1] == pytest.approx(following.line.coords[0])
    assert all(p.line.has_z and p.line.is_valid for p in paths)
    way = np.trapezoid(np.abs(THERE_AND_BACK.speed_mps), THERE_AND_BACK.t_s)
    assert sum(p.length_m for p in paths) == pytest.approx(way, rel=5e-3)


def test_tool_paths__break_at_gaps_and_where_nothing_is_said_are_unknown() -> None:
    truth = drive((40.0, 1.2, 0.0))
    t = truth.t_s - truth.t_s[0]
    kept = (t < 15.0) | (t > 20.0)
    trajectory = trajectory_of(Drive(truth.t_s[kept], truth.en_m[kept], truth.yaw_rad[kept], truth.speed_mps[kept]))
    begin, end = truth.t_s[0] + np.array([[5.0], [30.0]])
    one = np.ones(1)
    paths = tool_paths(trajectory, ToolStates(begin, end, one.astype(np.int8), one, 0 * one, 0 * one), TILLER)
    assert [p.state for p in paths] == [ToolState.UNKNOWN, ToolState.DOWN, ToolState.DOWN, ToolState.UNKNOWN]
    assert max(np.diff(np.array(p.line.coords)[:, 0]).sum() for p in paths) < 15.0


def test_events__tell_transitions_with_sigma_stops_reversing_and_gaps() -> None:
    trajectory = trajectory_of(THERE_AND_BACK)
    states = states_of(trajectory, (2.0, 18.0), sigma_s=0.07)
    found = events(trajectory, states, TILLER)
    t0 = trajectory.t_s[0]
    assert [e.kind for e in found] == ["start", "down", "up", "stop", "reverse", "stop", "start"]
    down, up = (e for e in found if e.kind in {"down", "up"})
    assert (down.t_s - t0, down.sigma_s, down.pass_number) == (pytest.approx(2.0, abs=1e-6), 0.07, 1)
    assert (up.t_s - t0, up.sigma_s, up.pass_number) == (pytest.approx(18.0, abs=1e-6), 0.07, 1)
    reverse = next(e for e in found if e.kind == "reverse")
    assert reverse.t_s - t0 == pytest.approx(24.0, abs=0.3)
    assert reverse.pass_number is None
    times = [e.t_s for e in found]
    assert times == sorted(times)


def test_events__unknown_between_equal_states_is_no_transition() -> None:
    trajectory = trajectory_of(drive((40.0, 1.2, 0.0)))
    states = states_of(trajectory, (5.0, 15.0), (20.0, 35.0), unknown_s=(15.0, 20.0))
    assert [e.kind for e in events(trajectory, states, TILLER) if e.kind in {"down", "up"}] == ["down", "up"]


def test_events__a_gap_is_told_where_positions_end() -> None:
    truth = drive((40.0, 1.2, 0.0))
    t = truth.t_s - truth.t_s[0]
    kept = (t < 15.0) | (t > 20.0)
    trajectory = trajectory_of(Drive(truth.t_s[kept], truth.en_m[kept], truth.yaw_rad[kept], truth.speed_mps[kept]))
    (gap,) = (e for e in events(trajectory, states_of(trajectory), TILLER) if e.kind == "gap")
    assert gap.t_s - trajectory.t_s[0] == pytest.approx(14.9, abs=0.11)
    assert np.isfinite(gap.xyz_m).all()


@pytest.mark.parametrize("name", ["tractor_loop", "tractor_fishtail"])
def test_sample__the_tools_way_lies_in_the_middle_of_the_true_passes(shared_data: Path, name: str) -> None:
    truth = sample(shared_data / name)
    paths = tool_paths(truth.trajectory, truth.states, truth.session.implement)
    down = [p for p in paths if p.state is ToolState.DOWN]
    half = 0.5 * truth.session.implement.width_m
    for path, polygon in zip(down, truth.passes.geometry, strict=True):
        inner = shapely.line_interpolate_point(path.line, [0.3, 0.5, 0.7], normalized=True)
        assert shapely.distance(inner, polygon.boundary) == pytest.approx(half, abs=0.02)


def test_interval_numbers__count_from_one_and_are_none_between_passes() -> None:
    trajectory = trajectory_of(drive((40.0, 1.2, 0.0)))
    passes = pass_times(states_of(trajectory, (5.0, 15.0), (20.0, 35.0)))
    times = trajectory.t_s[0] + np.array([0.0, 5.0, 10.0, 15.0, 17.0, 20.0, 35.0, 36.0])
    assert interval_numbers(passes, times).tolist() == [0, 1, 1, 1, 0, 2, 2, 0]
    assert interval_numbers([], times).tolist() == [0] * 8
