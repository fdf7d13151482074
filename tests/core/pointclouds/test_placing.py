"""Points placed by their own times, against interpolation written out with scipy."""

from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation, Slerp

from furrowmap.core.pointclouds.placed_scans import PlacedScan, Placer, place_scans
from furrowmap.core.values.rotation import Mounting
from furrowmap.core.values.scan import Scan
from furrowmap.core.values.trajectory import Motion, trajectory_from_attitude

T0 = 1_781_141_020.0


def scan_of(t_s: np.ndarray, xyz_m: np.ndarray, number: int = 0) -> Scan:
    n = len(t_s)
    one = np.ones(n, np.uint8)
    return Scan(number, t_s, xyz_m.astype(np.float32), one, one, np.zeros(n, np.uint16), one, one)


@settings(max_examples=30)
@given(st.integers(2, 30), st.integers(0, 2**32 - 1), st.floats(0.1, 80.0))
def test_every_point_has_the_pose_of_its_own_time(knots: int, seed: int, turn_deg: float) -> None:
    rng = np.random.default_rng(seed)
    t = T0 + np.cumsum(rng.uniform(0.05, 0.3, knots))
    xyz = np.cumsum(rng.normal(0, 0.3, (knots, 3)), axis=0) + np.array([16_655.0, 96_555.0, 271.0])
    roll, pitch = rng.normal(0, 5, (2, knots))
    heading = np.cumsum(rng.uniform(-turn_deg, turn_deg, knots)) + 350.0
    trajectory = trajectory_from_attitude(t, xyz, roll, pitch, heading, max_gap_s=1.0)
    mounting = Mounting((-0.6, 0.04, 2.4), (0.8, 40.6, 179.3))
    points = rng.normal(0, 10, (200, 3)).astype(np.float32)
    t_s = np.sort(rng.uniform(t[0] - 0.2, t[-1] + 0.2, 200))
    origin = (16_000.0, 96_000.0, 200.0)

    found, known = Placer(trajectory, mounting, origin).place(scan_of(t_s, points))

    inside = (t_s + 0.25 - 0.25 >= t[0]) & (t_s + 0.25 - 0.25 <= t[-1])
    np.testing.assert_array_equal(known, inside)
    assert np.isnan(found[~inside]).all()
    if not inside.any():
        return
    attitude = Rotation.from_euler("ZYX", np.column_stack([90 - heading, -pitch, roll]), degrees=True)
    moment = t_s[inside] + 0.25 - 0.25
    turned = Slerp(t, attitude)(moment)
    sensor = Rotation.from_euler("ZYX", [179.3, 40.6, 0.8], degrees=True).apply(points[inside].astype(float))
    place = np.column_stack([np.interp(moment, t, xyz[:, k]) for k in range(3)])
    expected = place + turned.apply(sensor + np.array([-0.6, 0.04, 2.4])) - origin
    np.testing.assert_allclose(found[inside], expected, atol=1e-6)


@given(st.floats(0.9, 1.1))
def test_scale__stretches_eastings_and_northings_of_ranges_alone(scale: float) -> None:
    rng = np.random.default_rng(4)
    t = T0 + np.arange(0.0, 5.0, 0.1)
    trajectory = trajectory_from_attitude(t, rng.normal(0, 5, (50, 3)), 3.0, -2.0, 60.0, max_gap_s=1.0)
    t_s = np.sort(rng.uniform(t[0], t[-1], 100))
    scan = scan_of(t_s, rng.normal(0, 30, (100, 3)))
    mounting, origin = Mounting((0.1, 0.2, -0.3), (0.8, 40.6, 179.3)), (0.0, 0.0, 0.0)
    plain, _ = Placer(trajectory, mounting, origin).place(scan)
    found, _ = Placer(trajectory, mounting, origin, scale=scale).place(scan)
    place = trajectory.at(t_s).xyz_m
    np.testing.assert_allclose(found - place, (plain - place) * (scale, scale, 1.0), atol=1e-9)


def test_gaps_place_nothing_and_are_counted() -> None:
    t = T0 + np.concatenate([np.arange(0, 2.01, 0.1), np.arange(5, 7.01, 0.1)])
    n = len(t)
    xyz = np.column_stack([t - T0, np.zeros(n), np.zeros(n)])
    motion = np.where(t - T0 > 6, Motion.STANDING, Motion.FORWARD).astype(np.int8)
    trajectory = trajectory_from_attitude(t, xyz, 0.0, 0.0, 90.0, max_gap_s=1.0, motion=motion)
    placer = Placer(trajectory, Mounting(), (0.0, 0.0, 0.0))
    scans = []
    for number in range(8):
        moment = T0 + number + np.linspace(0.0, 0.999, 50)
        scans.append(scan_of(moment, np.zeros((50, 3)), number))
    seen: list[PlacedScan] = []

    placement = place_scans(scans, placer, standing=False, sink=seen.append)

    assert (placement.scans, placement.points_read) == (8, 400)
    assert placement.scans_without_pose == 2  # 3 and 4; one point of scan 2 lies on the last knot before the gap
    assert placement.scans_standing == 2
    assert placement.points + placement.points_without_pose + placement.points_standing == placement.points_read
    assert [np.unique(p.number).tolist() for p in seen] == [[0, 1, 2], [5]]  # 5 begins more than TOGETHER_S after 0
    assert placement.poses.scan.tolist() == [0, 1, 2, 5, 6, 7]
    for placed in seen:
        np.testing.assert_allclose(placed.xyz_m[:, 0], placed.scan.t_s - T0, atol=1e-6)
    assert sum(len(p.scan) for p in seen) == placement.points == int(placement.poses.points.sum())


def test_the_local_origin_is_only_a_shift() -> None:
    rng = np.random.default_rng(3)
    t = T0 + np.arange(10) * 0.1
    trajectory = trajectory_from_attitude(t, rng.normal(0, 1, (10, 3)) + 5e5, 1.0, 2.0, 10.0, max_gap_s=1.0)
    scan = scan_of(np.linspace(t[0], t[-1], 40), rng.normal(0, 5, (40, 3)))
    mounting = Mounting((1.0, 2.0, 3.0), (4.0, 5.0, 6.0))
    near, _ = Placer(trajectory, mounting, (5e5, 5e5, 5e5)).place(scan)
    far, _ = Placer(trajectory, mounting, (0.0, 0.0, 0.0)).place(scan)
    np.testing.assert_allclose(near + 5e5, far, atol=1e-8)


def test_a_trajectory_of_one_pose__places_nothing() -> None:
    t = T0 + np.arange(3.0)
    one = trajectory_from_attitude(t[:1], np.zeros((1, 3)), 0.0, 0.0, 90.0, max_gap_s=1.0)
    found, known = Placer(one, Mounting(), (0.0, 0.0, 0.0)).place(scan_of(t, np.ones((3, 3))))
    assert np.isnan(found).all()
    assert (found.shape, known.tolist()) == ((3, 3), [False] * 3)
