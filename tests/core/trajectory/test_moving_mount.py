"""A mount that turns against the vehicle: Honma's equations, and ground as thin as with a rigid mount."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from furrowmap.core.pipeline.notices import refuse_empty
from furrowmap.core.pointclouds.placed_scans import Placement, Placer
from furrowmap.core.readers.mount_csv import read_mount
from furrowmap.core.runtime.errors import InputError
from furrowmap.core.trajectory.located import Located
from furrowmap.core.trajectory.moving_mount import carrier_of, mount_trajectory
from furrowmap.core.values.pose_track import MountMotion
from furrowmap.core.values.rotation import Mounting
from furrowmap.core.values.scan import Scan
from furrowmap.core.values.session import Crs, Mount, Recording, Session
from furrowmap.core.values.trajectory import Trajectory, trajectory_from_attitude

FloatArray = NDArray[np.float64]
T0 = 1_779_529_272.0


def scan_of(t_s: FloatArray, xyz_m: FloatArray) -> Scan:
    one = np.ones(len(t_s), np.uint8)
    return Scan(0, t_s, xyz_m.astype(np.float32), one, one, np.zeros(len(t_s), np.uint16), one, one)


def motion_of(t_s: FloatArray, rpy_deg: FloatArray) -> MountMotion:
    turned = Rotation.from_euler("ZYX", rpy_deg[:, ::-1], degrees=True)
    return MountMotion(t_s, turned.as_quat(scalar_first=True))


def honma(theta: FloatArray, omega: float, phi: float, kappa: float, *, mended: bool) -> FloatArray:
    """The direction of a beam by equation (2), as printed or mended, angles in radians."""
    last = np.sin(kappa) if mended else np.cos(kappa)
    side, down = np.cos(theta + phi), np.sin(theta + phi)
    return np.column_stack(
        [
            down * np.sin(omega) * np.sin(kappa) + side * np.cos(kappa),
            down * np.sin(omega) * np.cos(kappa) - side * last,
            -down * np.cos(omega),
        ]
    )


def test_honma__mended_is_a_unit_vector_and_what_is_placed() -> None:
    """Its axes: x to the right, y forward, z up; ω pitch nose up, φ roll right side down, κ heading clockwise."""
    theta = np.linspace(0.0, np.pi, 50)
    random = np.random.default_rng(5)
    for omega, phi, kappa in np.radians(random.uniform((-20.0, -20.0, 0.0), (20.0, 20.0, 360.0), (20, 3))):
        mended = honma(theta, omega, phi, kappa, mended=True)
        np.testing.assert_allclose(np.linalg.norm(mended, axis=1), 1.0, atol=1e-12)
        printed = honma(theta, omega, phi, kappa, mended=False)
        assert np.abs(np.linalg.norm(printed, axis=1) - 1.0).max() > 0.01

        t = T0 + np.linspace(0.1, 0.9, 50)
        beams = 20.0 * np.column_stack([np.zeros(50), -np.cos(theta), -np.sin(theta)])
        place = np.array([500.0, 600.0, 30.0])
        knots = T0 + np.array([0.0, 1.0])
        roll, pitch, heading = np.degrees([phi, omega, kappa])
        # The vehicle has the attitude …
        vehicle = trajectory_from_attitude(knots, np.tile(place, (2, 1)), roll, pitch, heading, max_gap_s=2.0)
        placed, _ = Placer(vehicle, Mounting(), (0.0, 0.0, 0.0)).place(scan_of(t, beams))
        np.testing.assert_allclose(placed, place + 20.0 * mended, atol=1e-5)
        # … or the mount has it, of a vehicle that hovers level towards north.
        level = trajectory_from_attitude(knots, np.tile(place, (2, 1)), 0.0, 0.0, 0.0, max_gap_s=2.0)
        motion = motion_of(knots, np.tile([roll, -pitch, -heading], (2, 1)))
        carrier = mount_trajectory(level, motion, (0.0, 0.0, 0.0))
        placed, _ = Placer(level, Mounting(), (0.0, 0.0, 0.0), carrier).place(scan_of(t, beams))
        np.testing.assert_allclose(placed, place + 20.0 * mended, atol=1e-5)


def swaying(t_s: FloatArray) -> FloatArray:
    """Roll, pitch and yaw (n, 3) of 2° at 0.3 Hz."""
    return 2.0 * np.sin(2.0 * np.pi * 0.3 * t_s[:, None] + np.array([0.0, 1.0, 2.0]))


def flown() -> Trajectory:
    t = np.arange(0.0, 20.0, 0.005)
    xyz = np.column_stack([2.0 * t, 0.1 * np.sin(t), 6.0 + 0.05 * np.sin(2.0 * t)])
    roll, pitch = 4.0 * np.sin(3.0 * t), 3.0 * np.sin(4.0 * t + 1.0)
    return trajectory_from_attitude(T0 + t, xyz, roll, pitch, 90.0 + 3.0 * np.sin(0.5 * t), max_gap_s=0.5)


LEVER_M = (0.0, 0.013, -0.304)


def thickness_m(sways: bool, rate_hz: float, known: bool = True) -> float:
    """Spread of level ground about its mean, measured from the air with 12 mm of range noise."""
    random = np.random.default_rng(2)
    n = 100_000
    trajectory, mounting = flown(), Mounting(LEVER_M, (0.0, 0.0, 0.0))
    at_s = np.sort(random.uniform(0.5, 19.0, n))
    t = T0 + at_s
    poses = trajectory.at(t)
    turned = Rotation.from_quat(poses.quaternion, scalar_first=True)
    place = poses.xyz_m + turned.apply(LEVER_M)
    if sways:
        turned = turned * Rotation.from_euler("ZYX", swaying(at_s)[:, ::-1], degrees=True)
    across, along = np.radians(random.uniform(-50.0, 50.0, n)), np.radians(random.uniform(-15.0, 15.0, n))
    beam = np.column_stack([np.sin(along), np.cos(along) * np.sin(across), -np.cos(along) * np.cos(across)])
    reach = -place[:, 2] / turned.apply(beam)[:, 2]
    scan = scan_of(t, beam * (reach + random.normal(0.0, 0.012, n))[:, None])
    sample_s = np.arange(-1.0, 21.0, 1.0 / rate_hz)
    motion = motion_of(T0 + sample_s, swaying(sample_s))
    carrier = mount_trajectory(trajectory, motion, LEVER_M) if sways and known else None
    placed, _ = Placer(trajectory, mounting, (0.0, 0.0, 0.0), carrier).place(scan)
    return float(np.std(placed[:, 2]))


def test_ground__is_as_thin_as_with_a_rigid_mount() -> None:
    rigid = thickness_m(sways=False, rate_hz=100.0)
    assert 0.008 < rigid < 0.012
    assert thickness_m(sways=True, rate_hz=100.0) < 1.01 * rigid
    assert thickness_m(sways=True, rate_hz=10.0) < 1.01 * rigid
    assert thickness_m(sways=True, rate_hz=100.0, known=False) > 5.0 * rigid


def test_pivot__is_the_point_that_stays() -> None:
    trajectory, pivot = flown(), (0.2, -0.1, -0.3)
    t = np.arange(-1.0, 21.0, 0.01)
    carrier = mount_trajectory(trajectory, motion_of(T0 + t, swaying(t)), pivot)
    at = T0 + np.linspace(1.0, 18.0, 300)
    ends = [
        poses.xyz_m + Rotation.from_quat(poses.quaternion, scalar_first=True).apply(pivot)
        for poses in (trajectory.at(at), carrier.at(at))
    ]
    np.testing.assert_allclose(ends[1], ends[0], atol=2e-5)


def test_times_without_the_mount__have_no_pose() -> None:
    t = np.concatenate([np.arange(2.0, 8.0, 0.01), np.arange(12.0, 15.0, 0.01)])
    carrier = mount_trajectory(flown(), motion_of(T0 + t, swaying(t)), LEVER_M)
    known = np.isfinite(carrier.at(T0 + np.array([1.0, 5.0, 10.0, 13.0, 16.0])).xyz_m[:, 0])
    assert known.tolist() == [False, True, False, True, False]
    with pytest.raises(InputError) as refused:
        mount_trajectory(flown(), motion_of(T0 + 100.0 + t, swaying(t)), LEVER_M)
    assert refused.value.code == "no-common-time"


def test_gaps_of_the_mount__name_its_file(tmp_path: Path) -> None:
    t = np.concatenate([np.arange(2.0, 8.0, 0.01), np.arange(12.0, 15.0, 0.01)])
    rows = [f"{T0 + time:.2f},0,0,0" for time in t]
    (tmp_path / "mount.csv").write_text("\n".join(["time_unix_s,yaw_deg,roll_deg,pitch_deg", *rows, ""]))
    crs = Crs(map="EPSG:25832")
    session = Session(furrowmap=1, recording=Recording(), crs=crs, mount=Mount(attitude="mount.csv"))
    located = Located(flown(), "file", {}, ())
    _, (notice,) = carrier_of(located, session, tmp_path / "mount.csv")
    assert notice.code == "mount-gaps"
    assert "mount.csv" in notice.text
    assert "3 gaps, the longest of " in notice.text
    whole = np.arange(flown().span_s[0] - 1.0, flown().span_s[1] + 1.0, 0.01)
    rows = [f"{time:.2f},0,0,0" for time in whole]
    (tmp_path / "mount.csv").write_text("\n".join(["time_unix_s,yaw_deg,roll_deg,pitch_deg", *rows, ""]))
    assert carrier_of(located, session, tmp_path / "mount.csv")[1] == []


def test_scans_in_a_gap_of_the_mount__name_its_file() -> None:
    crs = Crs(map="EPSG:25832")
    session = Session(furrowmap=1, recording=Recording(), crs=crs, mount=Mount(attitude="mount.csv"))
    lost = replace(Placement.without_scans(flown()), points_read=10, first_s=T0 + 9.0, last_s=T0 + 11.0)
    with pytest.raises(InputError, match=r"mount\.csv: no attitude") as caught:
        refuse_empty(lost, flown(), session)
    assert caught.value.code == "no-common-time"


HEAD = "time_gps_s,yaw_deg,roll_deg,pitch_deg\n"


def test_file__is_read_by_its_columns(tmp_path: Path) -> None:
    file = tmp_path / "mount.csv"
    file.write_text(HEAD + "466490.0,3.0,1.0,2.0\n466490.1,,1.0,2.0\n466490.2,-3.0,-1.0,-2.0\n", encoding="utf-8")
    motion, notices = read_mount(file, 1_779_529_272.0)
    assert [notice.code for notice in notices] == ["rows-incomplete"]
    np.testing.assert_allclose(np.diff(motion.t_s), [0.2], atol=1e-6)
    assert abs(motion.t_s[0] - 1_779_529_272.0) < 7 * 86_400.0
    np.testing.assert_allclose(
        Rotation.from_quat(motion.quaternion, scalar_first=True).as_matrix()[0],
        Mounting(rpy_deg=(1.0, 2.0, 3.0)).rotation,
    )


@pytest.mark.parametrize(
    ("text", "code"),
    [
        ("time_unix_s,roll_deg,pitch_deg\n1,2,3\n", "missing-column"),
        (HEAD + "1,0,0,0\n1,0,0,0\n", "time-disorder"),
        (HEAD.replace("unix", "gps") + "0,0,0,0\n1e-320,0,0,0\n", "time-disorder"),
        (HEAD.replace("unix", "gps"), "time-disorder"),
        (HEAD + "1,0,0,0\n2,x,0,0\n", "not-a-number"),
        (HEAD + "1,0,0,0\n2,9000,0,0\n", "value-out-of-range"),
    ],
)
def test_file__that_is_no_attitude_is_refused(tmp_path: Path, text: str, code: str) -> None:
    file = tmp_path / "mount.csv"
    file.write_text(text, encoding="utf-8")
    with pytest.raises(InputError) as refused:
        read_mount(file, T0)
    assert refused.value.code == code
