"""The line driven: turns lead to their lanes, and can be steered."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from furrowmap.core.simulator.drive import DrivenPath, plan_path
from furrowmap.core.simulator.scenario import ScenarioDrive


def planned(drive: ScenarioDrive) -> DrivenPath:
    return plan_path(drive, np.random.default_rng(0))


@settings(max_examples=40)
@given(
    lane=st.floats(-12.0, 12.0),
    turns=st.sampled_from(["loop", "fishtail"]),
    radius=st.floats(2.0, 6.0),
    ramp=st.floats(0.5, 2.0),
)
def test_plan_path__every_turn_ends_on_its_lane(lane: float, turns: str, radius: float, ramp: float) -> None:
    drive = ScenarioDrive(turns=turns, lanes_m=(0.0, lane), radius_m=radius, ramp_m=ramp, wander_m=0.0)  # type: ignore[arg-type]
    path = planned(drive)
    second = path.distance_m >= path.passes[1][0]
    assert np.abs(path.v_m[second] - lane).max() < 1e-6
    assert np.abs(np.cos(path.yaw_rad[second]) + 1.0).max() < 1e-9
    # by the symmetry of the turn, the second pass begins beside where the first one left its lane
    left_at = drive.lead_in_m + drive.pass_m[0] + drive.run_out_m
    assert np.interp(path.passes[1][0], path.distance_m, path.u_m) == pytest.approx(left_at - drive.lead_in_m, abs=1e-6)


@pytest.mark.parametrize("turns", ["loop", "fishtail"])
def test_plan_path__steers_no_tighter_than_allowed_and_no_faster(turns: str) -> None:
    drive = ScenarioDrive(turns=turns, wander_m=0.0, lanes_m=(0.0, 1.6, 3.2, 9.0))  # type: ignore[arg-type]
    path = planned(drive)
    step = np.diff(path.distance_m)
    curvature = np.diff(path.yaw_rad) / step
    assert np.abs(curvature).max() <= 1.0 / drive.radius_m + 1e-3
    inside = (np.diff(path.gear[:-1]) == 0) & (step[1:] > 0.005) & (step[:-1] > 0.005)
    assert np.abs(np.diff(curvature)[inside] / 0.01).max() <= 1.15 / (drive.radius_m * drive.ramp_m)


@pytest.mark.parametrize("wander", [0.0, 0.03])
def test_plan_path__nose_points_along_the_way(wander: float) -> None:
    path = planned(ScenarioDrive(turns="fishtail", wander_m=wander))
    du, dv = np.diff(path.u_m) * path.gear[:-1], np.diff(path.v_m) * path.gear[:-1]
    middle = 0.5 * (path.yaw_rad[1:] + path.yaw_rad[:-1])
    across = np.abs(dv * np.cos(middle) - du * np.sin(middle)) / np.hypot(du, dv)
    assert across.max() < np.radians(0.1)


def test_plan_path__fishtail_reverses_once_a_turn_and_stands_for_it() -> None:
    drive = ScenarioDrive(turns="fishtail", passes=3, gear_s=0.7)
    path = planned(drive)
    assert np.count_nonzero(np.diff(path.gear)) == 4
    assert [stand for _, stand in path.stops] == [0.7] * 4
    assert (planned(ScenarioDrive(turns="loop")).gear > 0).all()


def test_plan_path__wanders_as_much_as_stated_on_long_passes() -> None:
    path = planned(ScenarioDrive(passes=1, pass_m=(400.0,), wander_m=0.03))
    assert path.v_m.std() == pytest.approx(0.03, rel=0.05)
