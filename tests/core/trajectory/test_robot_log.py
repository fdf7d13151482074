"""A real robot on wheels with positions of a metre: the log of robot_localization's first test (Clearpath Husky).

The mounting of its IMU is that of the launch file of that test. The odometry of its wheels, which takes no part, is an
independent truth of its speed.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from rosbags.rosbag1 import Reader as Rosbags1
from rosbags.typesys import Stores, get_typestore

from furrowmap.core.geodesy.projection import map_frame
from furrowmap.core.readers.reader import ReadOptions
from furrowmap.core.readers.rosbag.bags import RosBag1
from furrowmap.core.trajectory.from_inertial import InertialTrajectory, trajectory_from_inertial
from furrowmap.core.trajectory.inertial_start import Hints, MountedImu
from furrowmap.core.trajectory.used_positions import climb_notices
from furrowmap.core.values.gnss import GnssTrack
from furrowmap.core.values.inertial import inertial_noise
from furrowmap.core.values.rotation import Mounting, wrap_deg
from furrowmap.core.values.session import Crs
from furrowmap.core.values.trajectory import Motion

BAG = "rosbag/husky_imu_odom_fix.bag"
FRAME = map_frame(Crs(map="EPSG:32619"))
PART_S = (80.0, 260.0)
"""Of the drive; it stands for ten seconds in it."""
STAND_S = (236.6, 245.5)
"""By the odometry of its wheels."""


@pytest.fixture(scope="module")
def whole(shared_data: Path) -> GnssTrack:
    return RosBag1([shared_data / BAG], ReadOptions()).track()


@pytest.fixture(scope="module")
def robot(whole: GnssTrack, shared_data: Path) -> tuple[GnssTrack, MountedImu]:
    track, imu = whole, RosBag1([shared_data / BAG], ReadOptions())
    measured = imu.inertial()
    first, end = np.searchsorted(measured.t_s, track.t_s[0] + np.array(PART_S)).tolist()
    part = measured.part(slice(first, end))
    mounting = Mounting((0.0, -0.3, 0.52), (90.0, 0.0, -90.0))
    since_s = track.t_s - track.t_s[0]
    return track[(since_s > PART_S[0]) & (since_s < PART_S[1])], MountedImu(
        part, mounting, inertial_noise("industrial")
    )


@pytest.fixture(scope="module")
def half(robot: tuple[GnssTrack, MountedImu]) -> InertialTrajectory:
    """By one in two of the positions."""
    track, imu = robot
    return trajectory_from_inertial(track[::2], imu, FRAME, (0.0, 0.0, 0.0), None, Hints(on_wheels=True))


def test_without_wheels__the_heading_is_as_good_as_stated(
    robot: tuple[GnssTrack, MountedImu], half: InertialTrajectory
) -> None:
    """Accelerations alone show it to some degrees, the course on wheels to two."""
    alone = trajectory_from_inertial(*robot, FRAME, (0.0, 0.0, 0.0), None).trajectory
    t_s = half.trajectory.t_s[::40]
    t_s = t_s[(t_s > alone.t_s[0]) & (t_s < alone.t_s[-1])]
    off_deg = wrap_deg(alone.at(t_s).attitude_deg()[2] - half.trajectory.at(t_s).attitude_deg()[2])
    sigma_deg = float(np.median(alone.sigma[:, 5]))
    assert 4.0 < sigma_deg < 10.0
    assert float(np.sqrt((off_deg**2).mean())) < 2.0 * sigma_deg


def test_positions_left_out__are_met_within_their_sigmas(
    robot: tuple[GnssTrack, MountedImu], half: InertialTrajectory
) -> None:
    left, poses = robot[0][1::2], half.trajectory
    left = left[(left.t_s > poses.t_s[0]) & (left.t_s < poses.t_s[-1])]
    seen = np.column_stack([*FRAME.project(left.lon_deg, left.lat_deg), left.height_m])
    computed, sigma = (
        np.column_stack([np.interp(left.t_s, poses.t_s, values[:, k]) for k in range(3)])
        for values in (poses.xyz_m, poses.sigma)
    )
    ratio = (seen - computed) / sigma
    assert len(ratio) > 215
    assert (np.sqrt((ratio**2).mean(axis=0)) < 1.2).all()
    assert (np.abs(ratio) < 2.0).mean() > 0.95


def test_residuals__are_correlated_where_the_receiver_filters(half: InertialTrajectory) -> None:
    """This receiver filters its positions: what one is off, the next is off too."""
    figures = half.figures
    assert max(figures.residual_noise_m[:2]) < 1.1 * max(figures.assumed_noise_m[:2])
    assert 0.2 < max(figures.residual_correlation) < 0.7
    assert "imu-shaken" in {notice.code for notice in half.notices}


def test_speed__is_that_of_the_wheels(shared_data: Path, half: InertialTrajectory) -> None:
    store = get_typestore(Stores.ROS1_NOETIC)
    with Rosbags1(shared_data / BAG) as bag:
        chosen = [c for c in bag.connections if c.topic.endswith("/odom")]
        odometry = [store.deserialize_ros1(raw, c.msgtype) for c, _, raw in bag.messages(chosen)]
    t_s = np.array([m.header.stamp.sec + 1e-9 * m.header.stamp.nanosec for m in odometry])
    wheels = np.array([m.twist.twist.linear.x for m in odometry])
    every_s = np.arange(half.trajectory.t_s[0] + 5.0, half.trajectory.t_s[-1] - 5.0, 2.0)
    driven = np.interp(every_s, t_s, np.cumsum(wheels * np.gradient(t_s)))
    speed = half.trajectory.speed_mps
    ours = np.interp(every_s, half.trajectory.t_s, np.cumsum(speed * np.gradient(half.trajectory.t_s)))
    assert np.sqrt((((np.diff(ours) - np.diff(driven)) / 2.0) ** 2).mean()) < 0.25


def test_stand__is_one(robot: tuple[GnssTrack, MountedImu], half: InertialTrajectory) -> None:
    begin_s = robot[0].t_s[0] - PART_S[0]
    poses = half.trajectory
    inside = (poses.t_s > begin_s + STAND_S[0]) & (poses.t_s < begin_s + STAND_S[1])
    assert (poses.motion[inside] == Motion.STANDING).mean() > 0.95
    assert (poses.motion[~inside] == Motion.STANDING).mean() < 0.05


def test_heights__that_fall_by_25_m_in_half_a_minute_are_told(whole: GnssTrack) -> None:
    (notice,) = climb_notices(whole, np.column_stack(FRAME.project(whole.lon_deg, whole.lat_deg)))
    assert notice.code == "gnss-heights"
    assert "heights change by -25.0 m within 35.4 m of way" in notice.text
