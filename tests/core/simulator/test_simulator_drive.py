"""Speeds, stands and the tool."""

from __future__ import annotations

import msgspec
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from furrowmap.core.simulator.drive import DRIVE_RATE_HZ, LEAD_IN_S, SimulatedTrack, drive_path, plan_path
from furrowmap.core.simulator.scenario import ScenarioDrive, ScenarioImplement

STARTED = {"start_xy_m": (10.0, 20.0), "wander_m": 0.0}


def driven(drive: ScenarioDrive, implement: ScenarioImplement | None = None) -> SimulatedTrack:
    rng = np.random.default_rng(1)
    return drive_path(plan_path(drive, rng), drive, implement or ScenarioImplement(), rng)


@settings(max_examples=25)
@given(
    work=st.floats(0.4, 3.0),
    turn=st.floats(0.4, 3.0),
    accel=st.floats(0.3, 2.0),
    turns=st.sampled_from(["loop", "fishtail"]),
)
def test_drive_path__keeps_its_limits(work: float, turn: float, accel: float, turns: str) -> None:
    drive = ScenarioDrive(
        speed_work_mps=work, speed_turn_mps=turn, accel_mps2=accel, turns=turns, passes=2, **STARTED  # type: ignore[arg-type]
    )  # fmt: skip
    track = driven(drive)
    assert np.abs(track.speed_mps).max() <= max(work, turn) + 1e-6
    assert np.abs(np.diff(track.speed_mps)).max() * DRIVE_RATE_HZ <= accel * 1.01 + 1e-6
    assert track.speed_mps[0] == track.speed_mps[-1] == 0.0
    assert ((track.speed_mps < -0.01).any()) == (turns == "fishtail")


def test_drive_path__speed_is_the_way_in_time() -> None:
    track = driven(ScenarioDrive(turns="fishtail", **STARTED))  # type: ignore[arg-type]
    c, s = np.cos(track.yaw_rad), np.sin(track.yaw_rad)
    along = np.gradient(track.e_m, track.t_s) * c + np.gradient(track.n_m, track.t_s) * s
    assert np.abs(along - track.speed_mps).max() < 0.02


def test_drive_path__starts_where_and_whither_it_should() -> None:
    track = driven(ScenarioDrive(lane_heading_deg=128.0, **STARTED))  # type: ignore[arg-type]
    assert (track.e_m[0], track.n_m[0]) == (10.0, 20.0)
    assert np.degrees(track.yaw_rad[0]) == pytest.approx(90.0 - 128.0)
    assert track.t_s[0] == -LEAD_IN_S


def test_drive_path__stands_as_long_as_stated() -> None:
    drive = ScenarioDrive(passes=1, stops=((0, 3.0, 4.0),), stand_start_s=2.0, stand_end_s=1.5, **STARTED)  # type: ignore[arg-type]
    without = msgspec.structs.replace(drive, stops=())
    track = driven(drive)
    still = np.abs(track.speed_mps) < 1e-9
    u = (track.e_m - 10.0) * np.cos(track.yaw_rad[0]) + (track.n_m - 20.0) * np.sin(track.yaw_rad[0])
    at_stop = still & (np.abs(u - (drive.lead_in_m + 3.0)) < 0.02)
    assert at_stop.sum() / DRIVE_RATE_HZ == pytest.approx(4.0, abs=0.02)
    assert (still & (u < 0.01)).sum() / DRIVE_RATE_HZ == pytest.approx(2.0 + LEAD_IN_S, abs=0.02)
    # braking and starting again costs v/a more than the stand
    lost = track.duration_s - driven(without).duration_s
    assert lost == pytest.approx(4.0 + drive.speed_work_mps / drive.accel_mps2, abs=0.1)


def test_drive_path__tool_goes_down_and_up_once_a_pass() -> None:
    drive, implement = ScenarioDrive(passes=3, **STARTED), ScenarioImplement(jitter_m=0.01)  # type: ignore[arg-type]
    track = driven(drive, implement)
    assert np.count_nonzero(np.diff(track.down.astype(int))) == 6
    assert track.tool_m[~track.down].max() == pytest.approx(implement.lift_m)
    working = track.down & (track.tool_m < 0.06)
    assert abs(track.tool_m[working].mean()) < 0.005
    assert 0.005 < track.tool_m[working].std() < 0.015
    assert (track.speed_mps[track.down] >= 0.0).all()


def test_drive_path__an_hour_of_long_passes() -> None:
    track = driven(ScenarioDrive(passes=35, pass_m=(100.0,), **STARTED))  # type: ignore[arg-type]
    assert track.duration_s > 3600.0
    assert np.isfinite(track.e_m).all()
    assert np.hypot(np.diff(track.e_m), np.diff(track.n_m)).max() < 1.2 / DRIVE_RATE_HZ
