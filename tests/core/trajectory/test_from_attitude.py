"""Trajectories from GNSS and attitude logs, against flights that are known."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from furrowmap.core.geodesy.projection import map_frame
from furrowmap.core.runtime.errors import InputError
from furrowmap.core.trajectory.located import (
    AttitudeLogs,
    from_stated_north,
    of_vehicle,
    trajectory_from_attitude_logs,
)
from furrowmap.core.values.pose_track import GRID_NORTH, MAGNETIC_NORTH, TRUE_NORTH, UNSTATED_NORTH, AttitudeTrack
from furrowmap.core.values.rotation import mounting_rotation, quaternion_to_attitude, wrap_deg
from furrowmap.core.values.session import Crs
from furrowmap.core.values.trajectory import Motion, Trajectory
from tests.core.trajectory.flights import BEGIN_S, LEVER_M, Flight, frame

FloatArray = NDArray[np.float64]
FLIGHT = Flight(40.0, 3)
CONVERGENCE_DEG = float(frame().convergence_deg(np.array([11.36]), np.array([55.33]))[0])


def log(rate_hz: float = 50.0, north: str = GRID_NORTH, off_deg: float = 0.0, begin: float = 0.2) -> AttitudeTrack:
    t = np.arange(begin, FLIGHT.length_s - 0.3, 1.0 / rate_hz)
    roll, pitch, heading = FLIGHT.attitude_deg(t)
    return AttitudeTrack(BEGIN_S + t, roll, pitch, heading + off_deg, north, "log")


def found(logs: AttitudeLogs) -> Trajectory:
    return trajectory_from_attitude_logs(FLIGHT.track(), logs, frame(), LEVER_M, None).trajectory


def errors(trajectory: Trajectory) -> tuple[FloatArray, FloatArray]:
    """Of the places in metres, and of roll, pitch and heading in degrees."""
    t = trajectory.t_s - BEGIN_S
    angles = quaternion_to_attitude(trajectory.quaternion)
    off = [wrap_deg(a - b) for a, b in zip(angles, FLIGHT.attitude_deg(t), strict=True)]
    return trajectory.xyz_m - FLIGHT.xyz_m(t), np.column_stack(off)


def test_one_log__gives_the_flight() -> None:
    trajectory = found(AttitudeLogs(log(), log()))
    place, angle = errors(trajectory)
    assert np.abs(angle).max() < 1e-5
    assert np.sqrt((place**2).mean(axis=0)) == pytest.approx(0.0, abs=0.003)
    assert np.abs(place).max() < 0.02
    assert set(trajectory.heading_from) == set(trajectory.level_from) == {"attitude"}


def test_two_logs__give_roll_and_pitch_of_one_and_heading_of_the_other() -> None:
    level = replace(log(), heading_deg=log().heading_deg + 40.0)
    heading = replace(log(rate_hz=20.0), roll_deg=log(rate_hz=20.0).roll_deg + 9.0)
    _, angle = errors(found(AttitudeLogs(level, heading)))
    assert np.abs(angle[:, :2]).max() < 1e-5
    assert np.abs(angle[:, 2]).max() < 0.05


def test_true_north__is_turned_by_the_papers_equation() -> None:
    """Equation 1 of Christiansen et al.: the convergence from longitude and latitude, arctan(tan(λ − λ0) · sin φ)."""
    lon, lat = np.array([11.2, 11.36, 6.1]), np.array([55.33, 54.0, 57.0])
    paper = np.degrees(np.arctan(np.tan(np.radians(lon - 9.0)) * np.sin(np.radians(lat))))
    assert frame().convergence_deg(lon, lat) == pytest.approx(paper, abs=1e-3)
    track = FLIGHT.track()
    here = np.degrees(np.arctan(np.tan(np.radians(track.lon_deg[0] - 9.0)) * np.sin(np.radians(track.lat_deg[0]))))
    _, angle = errors(found(AttitudeLogs(log(), log(north=TRUE_NORTH, off_deg=float(here)))))
    assert here > 1.5
    assert np.abs(angle[:, 2]).max() < 0.01


def test_turned_devices__are_turned_back() -> None:
    rpy = (180.0, 0.0, 35.0)
    exact = log()
    vehicle = np.array(
        [
            mounting_rotation(r, -p, 90.0 - h)
            for r, p, h in zip(exact.roll_deg, exact.pitch_deg, exact.heading_deg, strict=True)
        ]
    )
    device = vehicle @ mounting_rotation(*rpy)
    roll = np.degrees(np.arctan2(device[:, 2, 1], device[:, 2, 2]))
    pitch = np.degrees(np.arcsin(device[:, 2, 0]))
    heading = np.degrees(np.arctan2(device[:, 0, 0], device[:, 1, 0]))
    back = of_vehicle(AttitudeTrack(exact.t_s, roll, pitch, heading, GRID_NORTH), rpy)
    assert back.roll_deg == pytest.approx(exact.roll_deg, abs=1e-9)
    assert back.pitch_deg == pytest.approx(exact.pitch_deg, abs=1e-9)
    assert wrap_deg(back.heading_deg - exact.heading_deg) == pytest.approx(0.0, abs=1e-9)
    alone = of_vehicle(AttitudeTrack(exact.t_s, roll, pitch, np.full(len(roll), np.nan), GRID_NORTH), rpy)
    assert alone.roll_deg == pytest.approx(exact.roll_deg, abs=1e-9)
    assert np.isnan(alone.heading_deg).all()


def test_declination__is_not_guessed() -> None:
    magnetic = log(north=MAGNETIC_NORTH)
    with pytest.raises(InputError) as caught:
        from_stated_north(magnetic, None, None)
    assert caught.value.code == "no-declination"
    assert "declination_deg" in caught.value.remedy
    east = from_stated_north(magnetic, None, 4.5)
    assert (east.north, float(east.heading_deg[0] - magnetic.heading_deg[0])) == (TRUE_NORTH, pytest.approx(4.5))


def test_unstated_north__is_an_error_unless_the_session_states_it() -> None:
    with pytest.raises(InputError) as caught:
        from_stated_north(log(north=UNSTATED_NORTH), None, None)
    assert caught.value.code == "north-unknown"
    assert from_stated_north(log(north=UNSTATED_NORTH), GRID_NORTH, None).north == GRID_NORTH


def test_gaps_of_a_log__are_gaps_of_the_trajectory() -> None:
    whole = log()
    t = whole.t_s - BEGIN_S
    kept = (t < 10.0) | (t > 14.0)
    cut = AttitudeTrack(*(getattr(whole, n)[kept] for n in ("t_s", "roll_deg", "pitch_deg", "heading_deg")), GRID_NORTH)
    trajectory = found(AttitudeLogs(whole, cut))
    assert trajectory.gaps_s - BEGIN_S == pytest.approx(np.array([[9.98, 14.02]]), abs=0.03)


def test_logs_of_another_day__are_an_error_with_the_spans() -> None:
    other = replace(log(), t_s=log().t_s + 86_400.0)
    with pytest.raises(InputError, match="2026-05-24") as caught:
        found(AttitudeLogs(other, log()))
    assert caught.value.code == "attitude-no-overlap"


def test_headings_across_north__are_interpolated_the_short_way() -> None:
    base = log(rate_hz=5.0)
    north = replace(base, heading_deg=np.where(np.arange(len(base)) % 2, 359.0, 1.0))
    trajectory = trajectory_from_attitude_logs(
        FLIGHT.track(), AttitudeLogs(log(), north), map_frame(Crs(map="EPSG:25832")), LEVER_M, None
    ).trajectory
    _, _, heading = quaternion_to_attitude(trajectory.quaternion)
    assert np.abs(wrap_deg(heading)).max() <= 1.0 + 1e-9


def test_sample__has_no_error_of_north(shared_data: Path) -> None:
    """`uav_wheat`: roll and pitch to 0.35° of one log, heading to 0.8° of the other, as its README says."""
    from furrowmap.core.pipeline.solution import companions
    from furrowmap.core.session.opened import open_session
    from furrowmap.core.trajectory.located import locate

    folder = shared_data / "uav_wheat"
    text = (folder / "session.toml").read_text(encoding="utf-8")
    assert "[imu]" in text
    opened = open_session(folder / "session.toml")
    attitude = {"roll_pitch": "ahrs_imu.csv", "heading": "ahrs_aircraft.csv"}
    opened = _with_attitude(opened, attitude, folder)
    located = locate(opened.positions(), opened.session, opened.frame, companions(opened))
    assert located.source == "attitude"
    truth = np.genfromtxt(folder / "truth" / "trajectory.csv", delimiter=",", names=True)
    trajectory = located.trajectory
    angles = quaternion_to_attitude(trajectory.quaternion)
    t_s = truth["time_unix_s"]
    rms = []
    for angle, name in zip(angles, ("roll_deg", "pitch_deg", "heading_deg"), strict=True):
        exact = np.interp(trajectory.t_s, t_s, np.degrees(np.unwrap(np.radians(truth[name]))))
        off = wrap_deg(angle - exact)
        rms.append(float(np.sqrt((off**2).mean())))
        assert abs(float(off.mean())) < 0.6, name  # without the convergence of 1.96° the heading's would be 2°
    assert max(rms[:2]) < 0.5
    assert rms[2] < 1.1


def _with_attitude(opened, attitude, folder):  # type: ignore[no-untyped-def]
    import msgspec

    from furrowmap.core.session.opened import Inputs
    from furrowmap.core.values.session import Attitude

    session = msgspec.structs.replace(opened.session, imu=None, attitude=Attitude(**attitude))
    return replace(opened, session=session, inputs=Inputs.find(folder / "session.toml", session))


def test_hovering__has_no_speed_at_all_though_positions_scatter() -> None:
    track, random = FLIGHT.track(), np.random.default_rng(4)
    n = len(track)
    place = {
        "lon_deg": track.lon_deg[0] + 1e-8 * random.normal(size=n),  # some millimetre
        "lat_deg": track.lat_deg[0] + 1e-8 * random.normal(size=n),
        "height_m": np.full(n, track.height_m[0]),
    }
    still = replace(
        log(), roll_deg=np.zeros(len(log())), pitch_deg=np.zeros(len(log())), heading_deg=np.zeros(len(log()))
    )
    hovering = replace(track, **place)
    trajectory = trajectory_from_attitude_logs(hovering, AttitudeLogs(still, still), frame(), LEVER_M, None).trajectory
    standing = trajectory.motion == Motion.STANDING
    assert standing.mean() > 0.9
    assert (trajectory.speed_mps[standing] == 0.0).all()
    assert (trajectory.speed_mps[~standing] != 0.0).all()
