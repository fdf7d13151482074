"""The search for a large offset of an IMU's clock: on wheels at walking pace, by a drive in closed form."""

from __future__ import annotations

import numpy as np
import pytest

from furrowmap.core.runtime.arrays import FloatArray
from furrowmap.core.trajectory.imu_clock import search_imu_clock
from furrowmap.core.values.gnss import Positions
from furrowmap.core.values.inertial import InertialTrack

SPEED_MPS = 0.5
AT_THE_IMU = np.zeros(3)


def drive(
    off_s: float, white_m: float, arm_m: FloatArray = AT_THE_IMU, shaken_mps2: float = 0.3
) -> tuple[InertialTrack, Positions, FloatArray]:
    """200 s of turns to both sides by an IMU whose clock is ahead, and positions five times a second; and the arm."""
    random = np.random.default_rng(7)
    t_s = np.arange(0.0, 200.0, 0.02)
    turning = 0.25 * np.sin(0.3 * t_s) + 0.15 * np.sin(0.171 * t_s + 1.0)
    yaw = np.cumsum(turning) * 0.02
    zero = np.zeros_like(t_s)
    rate = np.column_stack([zero, zero, turning + 0.005]) + random.normal(0.0, 0.002, (len(t_s), 3))
    force = np.column_stack([zero, SPEED_MPS * turning, zero + 9.81]) + random.normal(0.0, shaken_mps2, (len(t_s), 3))
    place = np.cumsum(SPEED_MPS * np.column_stack([np.cos(yaw), np.sin(yaw), zero]), axis=0) * 0.02
    place += np.column_stack([np.cos(yaw), np.sin(yaw), zero]) * arm_m[0]
    at = slice(None, None, 10)
    n = len(t_s[at])
    sigma = np.full((n, 3), white_m)
    seen = place[at] + random.normal(0.0, white_m, (n, 3))
    run, fix = np.zeros(n, np.intp), np.full(n, 4, np.int8)
    positions = Positions(t_s[at], seen, sigma, sigma, run, fix, np.full(n, np.nan))
    return InertialTrack(t_s + off_s, rate, force), positions, arm_m


def test_offset__is_found_by_the_direction_of_the_nose() -> None:
    for off_s in (-4.0, 18.0):
        assert abs(search_imu_clock(*drive(off_s, 0.15), on_wheels=True) - off_s) < 0.3


def test_offset_without_wheels__is_found_by_the_nose_where_positions_hide_accelerations() -> None:
    assert search_imu_clock(*drive(-4.0, 0.5), on_wheels=False) == pytest.approx(-4.0, abs=0.3)
    assert search_imu_clock(*drive(1.5, 0.5), on_wheels=False) == 0.0  # the nose of an aircraft may lag


def test_right_clock_and_hidden_motion__are_left_alone() -> None:
    assert search_imu_clock(*drive(0.0, 0.15), on_wheels=True) == 0.0
    assert search_imu_clock(*drive(5.0, 50.0), on_wheels=True) == 0.0


def test_antenna_ahead__is_no_offset_of_clocks() -> None:
    """Its accelerations come earlier than those of the IMU, here by 0.8 s."""
    imu, positions, arm_m = drive(0.0, 0.003, np.array([0.4, 0.0, 0.0]), 0.02)
    assert search_imu_clock(imu, positions, AT_THE_IMU, on_wheels=False) == pytest.approx(0.8, abs=0.2)
    assert search_imu_clock(imu, positions, arm_m, on_wheels=False) == 0.0


def test_accelerations_that_agree__are_believed_before_the_nose() -> None:
    """A machine whose nose lies where it travels 15 s later, at 5 m/s."""
    random, speed_mps = np.random.default_rng(3), 5.0
    t_s = np.arange(0.0, 200.0, 0.02)

    def course(at_s: np.ndarray) -> np.ndarray:
        return 1.2 * np.sin(0.3 * at_s) + 0.9 * np.sin(0.171 * at_s + 1.0)

    nose, zero = course(t_s + 15.0), np.zeros_like(t_s)
    pushed = speed_mps * np.gradient(course(t_s), t_s)
    across = course(t_s) + 0.5 * np.pi - nose
    rate = np.column_stack([zero, zero, np.gradient(nose, t_s)])
    force = np.column_stack([pushed * np.cos(across), pushed * np.sin(across), zero + 9.81])
    way = np.cumsum(speed_mps * np.column_stack([np.cos(course(t_s)), np.sin(course(t_s)), zero]), axis=0) * 0.02
    seen = way[::10] + random.normal(0.0, 0.01, (len(t_s[::10]), 3))
    n = len(seen)
    sigma, none = np.full((n, 3), 0.01), np.full(n, np.nan)
    positions = Positions(t_s[::10], seen, sigma, sigma, np.zeros(n, np.intp), np.full(n, 4, np.int8), none)
    assert search_imu_clock(InertialTrack(t_s, rate, force), positions, AT_THE_IMU, on_wheels=True) == 0.0
