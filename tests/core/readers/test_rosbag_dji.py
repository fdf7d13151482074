"""Attitudes and positions of a DJI autopilot in bags, by both generations of its node."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from furrowmap.core.readers.reader import ReadOptions
from furrowmap.core.readers.rosbag.bags import RosBag1, RosBag2
from furrowmap.core.runtime.errors import InputError
from furrowmap.core.session.opened import open_session
from furrowmap.core.values.gnss import Fix
from furrowmap.core.values.pose_track import TRUE_NORTH, UNSTATED_NORTH
from tests.core.readers.inertial_bags import dji, imu, quaternion, sentences, turning_imu
from tests.core.readers.small_bags import ROS1, T0_NS, Recorded, nav_sat_fix, write_bag1, write_bag2
from tests.fuzz.positions import nmea

ROLL_DEG, PITCH_DEG, HEADING_DEG = 3.0, -2.0, 70.0
"""Right side down, nose up, clockwise from north: the angles about forward, right and down that aeronautics uses."""
NED = Rotation.from_euler("ZYX", [HEADING_DEG, PITCH_DEG, ROLL_DEG], degrees=True)
ENU = Rotation.from_matrix([[0, 1, 0], [1, 0, 0], [0, 0, -1]]) * NED * Rotation.from_matrix(np.diag([1.0, -1.0, -1.0]))
"""As DJI's node computes it from version 3.3 on: from forward, left, up to east, north, up."""


def every(step_ns: int, topic: str, messages: list[object]) -> list[Recorded]:
    return [(topic, T0_NS + step_ns * k + 3_000_000, message) for k, message in enumerate(messages)]


def attitudes_old(count: int = 10) -> list[Recorded]:
    x, y, z, w = NED.as_quat()
    turns = [dji("AttitudeQuaternion", T0_NS + 20_000_000 * k, q0=w, q1=x, q2=y, q3=z) for k in range(count)]
    return every(20_000_000, "/dji_sdk/attitude_quaternion", turns)


def attitudes(count: int = 10, topic: str = "/dji_sdk/attitude") -> list[Recorded]:
    return every(20_000_000, topic, [quaternion(T0_NS + 20_000_000 * k, ENU.as_quat()) for k in range(count)])


@pytest.mark.parametrize("ros", [1, 2])
def test_attitude__is_that_of_both_generations_of_the_node(tmp_path: Path, ros: int) -> None:
    reader = (
        RosBag1([write_bag1(tmp_path / "a.bag", attitudes_old())], ReadOptions())
        if ros == 1
        else RosBag2([write_bag2(tmp_path / "a", attitudes())], ReadOptions())
    )
    track = reader.attitude()
    assert (len(track), track.north) == (10, TRUE_NORTH)
    assert np.diff(track.t_s) == pytest.approx(np.full(9, 0.02), abs=1e-6)
    for angles, truth in ((track.roll_deg, ROLL_DEG), (track.pitch_deg, PITCH_DEG), (track.heading_deg, HEADING_DEG)):
        assert angles == pytest.approx(np.full(10, truth), abs=1e-4)
    facts = reader.inspect().facts["attitudes"]
    assert (facts["attitudes"], facts["north"]) == (10, "true")


def test_attitude_of_other_devices__does_not_state_its_north(tmp_path: Path) -> None:
    bag = write_bag2(tmp_path / "a", attitudes(topic="/ahrs/quaternion"))
    assert RosBag2([bag], ReadOptions()).attitude().north == UNSTATED_NORTH


def test_orientation_that_is_none__is_an_error(tmp_path: Path) -> None:
    zero = every(20_000_000, "/dji_sdk/attitude", [quaternion(T0_NS + 20_000_000 * k, (0, 0, 0, 0)) for k in range(5)])
    with pytest.raises(InputError) as caught:
        RosBag2([write_bag2(tmp_path / "a", zero)], ReadOptions()).attitude()
    assert caught.value.code == "no-orientation"


def test_positions_of_the_autopilot__are_single_and_named(tmp_path: Path) -> None:
    messages = [
        dji("GlobalPosition", T0_NS + 20_000_000 * k, latitude=55.3, longitude=11.4 + 1e-7 * k, altitude=31.5, health=h)
        for k, h in enumerate([0, 5, 5, 4, 5])
    ]
    reader = RosBag1(
        [write_bag1(tmp_path / "a.bag", every(20_000_000, "/dji_sdk/global_position", messages))], ReadOptions()
    )
    track = reader.track()
    assert track.fix.tolist() == [Fix.NONE, *4 * [Fix.SINGLE]]
    assert track.lat_deg[1:] == pytest.approx(np.full(4, 55.3))
    assert track.height_m[1:] == pytest.approx(np.full(4, 31.5))
    assert np.isnan(track.sigma_e_m).all()
    assert [notice.code for notice in reader.notices] == ["positions-of-autopilot"]


def test_other_devices__come_before_the_autopilot(tmp_path: Path) -> None:
    autopilot = every(
        20_000_000, "/dji_sdk/gps_position", [nav_sat_fix(T0_NS + 20_000_000 * k, 0, None) for k in range(50)]
    )
    receiver = every(100_000_000, "/fix", [nav_sat_fix(T0_NS + 100_000_000 * k) for k in range(10)])
    own = every(2_500_000, "/dji_sdk/imu", [imu(T0_NS + 2_500_000 * k) for k in range(400)])
    bag = write_bag2(tmp_path / "a", [*autopilot, *receiver, *own, *turning_imu()])
    reader = RosBag2([bag], ReadOptions())
    assert (len(reader.track()), len(reader.inertial()), reader.attitude().north) == (10, 40, UNSTATED_NORTH)
    assert [notice.code for notice in reader.notices].count("bag-topic-chosen") == 3
    assert len(RosBag2([bag], ReadOptions(topic="/dji_sdk/gps_position")).track()) == 50


def test_session__takes_each_angle_from_its_topic(tmp_path: Path) -> None:
    level = every(20_000_000, "/vectornav/IMU", [imu(T0_NS + 20_000_000 * k, store=ROS1) for k in range(10)])
    write_bag1(tmp_path / "flight.bag", [*level, *attitudes_old(), *sentences(nmea(3), ROS1)])
    session = tmp_path / "session.toml"
    session.write_text(
        'furrowmap = 1\n[recording]\ngnss = ["flight.bag"]\ngnss_topic = "/nmea_sentence"\n[crs]\nmap = "EPSG:25832"\n'
        '[attitude]\nroll_pitch = "flight.bag"\nroll_pitch_topic = "/vectornav/IMU"\n'
        'heading = "flight.bag"\nheading_topic = "/dji_sdk/attitude_quaternion"\n',
        encoding="utf-8",
    )
    opened = open_session(session)
    roll_pitch, heading = (reader.attitude() for reader in opened.attitude(T0_NS * 1e-9))
    assert roll_pitch.roll_deg == pytest.approx(np.zeros(10), abs=1e-9)
    assert heading.heading_deg == pytest.approx(np.full(10, HEADING_DEG), abs=1e-4)
    assert len(opened.positions().track()) == 3  # type: ignore[attr-defined]
