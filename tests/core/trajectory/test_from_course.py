"""Trajectories from positions a second apart, against drives in closed form."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from furrowmap.core.geodesy.projection import map_frame
from furrowmap.core.runtime.errors import InputError
from furrowmap.core.trajectory.from_course import MAX_COURSE_GAP_S, trajectory_from_course
from furrowmap.core.values.gnss import GnssTrack
from furrowmap.core.values.session import Crs
from furrowmap.core.values.trajectory import Motion

FRAME = map_frame(Crs(map="EPSG:32632"))
ORIGIN_M = np.array([600_000.0, 5_540_000.0])
RADIUS_M, SPEED_MPS = 12.0, 2.0


def track(t_s: NDArray[np.float64], en_m: NDArray[np.float64]) -> GnssTrack:
    lon, lat = FRAME.to_lon_lat(*(en_m + ORIGIN_M).T)
    return GnssTrack.build(1.6e9 + t_s, lon_deg=lon, lat_deg=lat, fix=np.full(len(t_s), 4), source="log")


def circle(t_s: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Place (n, 2) and heading (n,) of a drive clockwise around a circle."""
    angle = SPEED_MPS / RADIUS_M * t_s
    return RADIUS_M * np.column_stack([np.sin(angle), np.cos(angle)]), np.degrees(angle) + 90.0


def test_circle__heading_and_speed_are_those_of_the_curve() -> None:
    t_s = np.arange(0.0, 60.0)
    place, heading = circle(t_s)
    found = trajectory_from_course(track(t_s, place), FRAME)
    off = (found.trajectory.attitude_deg()[2] - heading + 180.0) % 360.0 - 180.0
    assert np.abs(off[3:-3]).max() < 0.2
    assert found.trajectory.speed_mps[3:-3] == pytest.approx(SPEED_MPS, rel=0.005)
    assert found.trajectory.xyz_m[:, :2] - ORIGIN_M == pytest.approx(place, abs=1e-3)
    assert np.all(found.trajectory.motion == Motion.FORWARD)
    assert found.notices == ()


def test_lever__is_taken_off_along_the_heading() -> None:
    t_s = np.arange(0.0, 60.0)
    place, heading = circle(t_s)
    ahead = np.column_stack([np.sin(np.radians(heading)), np.cos(np.radians(heading))])
    left = np.column_stack([-ahead[:, 1], ahead[:, 0]])
    found = trajectory_from_course(track(t_s, place), FRAME, (0.0, 1.5, 0.0))
    assert found.trajectory.xyz_m[3:-3, :2] - ORIGIN_M == pytest.approx((place - 1.5 * left)[3:-3], abs=0.01)


def test_stand__keeps_the_heading_and_gaps_stay_gaps() -> None:
    north = np.concatenate([np.arange(0.0, 40.0, 2.0), np.full(20, 38.0), np.arange(40.0, 80.0, 2.0)])
    t_s = np.arange(float(len(north)))
    t_s[45:] += MAX_COURSE_GAP_S + 1.0
    found = trajectory_from_course(track(t_s, np.column_stack([np.zeros(len(north)), north])), FRAME).trajectory
    turned = (found.attitude_deg()[2] + 180.0) % 360.0 - 180.0
    assert np.abs(turned).max() < 1.0
    assert np.all(found.motion[25:35] == Motion.STANDING)
    assert len(found.gaps_s) == 1


def test_positions_elsewhere__are_left_out_and_told() -> None:
    t_s = np.arange(0.0, 60.0)
    place, _ = circle(t_s)
    some = track(t_s, place)
    lon = some.lon_deg.copy()
    lon[[0, 30]] = -93.8
    found = trajectory_from_course(GnssTrack.build(some.t_s, lon_deg=lon, lat_deg=some.lat_deg, fix=some.fix), FRAME)
    assert np.flatnonzero(~found.used).tolist() == [0, 30]
    assert [notice.code for notice in found.notices] == ["positions-elsewhere"]


def test_too_few_positions__make_no_way() -> None:
    with pytest.raises(InputError) as error:
        trajectory_from_course(track(np.zeros(1), np.zeros((1, 2))), FRAME)
    assert error.value.code == "gnss-no-positions"


def test_two_positions__are_a_line_and_one_is_refused() -> None:
    pair = track(np.array([0.0, 2.0]), np.array([[0.0, 0.0], [3.0, 4.0]]))
    found = trajectory_from_course(pair, FRAME).trajectory
    assert found.speed_mps == pytest.approx(2.5, abs=1e-3)
    assert found.attitude_deg()[2] == pytest.approx(np.degrees(np.arctan2(3.0, 4.0)), abs=0.01)
    with pytest.raises(InputError, match="1 of its 1 position can") as refused:
        trajectory_from_course(pair[:1], FRAME)
    assert refused.value.code == "gnss-no-positions"
