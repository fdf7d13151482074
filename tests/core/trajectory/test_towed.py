"""Implements behind a vehicle, against closed forms of straight lines and circles."""

from __future__ import annotations

import numpy as np
import pytest

from furrowmap.core.trajectory.towed import towed
from furrowmap.core.values.sections import Link
from furrowmap.core.values.trajectory import Trajectory, trajectory_from_attitude

SPEED_MPS = 2.0


def circle(radius_m: float, every_s: float = 0.1, seconds: float = 120.0) -> Trajectory:
    """A drive to the left about the origin."""
    t_s = np.arange(0.0, seconds, every_s)
    angle = SPEED_MPS / radius_m * t_s
    place = radius_m * np.column_stack([np.cos(angle), np.sin(angle), 0.0 * angle])
    return trajectory_from_attitude(t_s, place, 0.0, 0.0, -np.degrees(angle), max_gap_s=15.0)


def radius_and_yaw(trajectory: Trajectory) -> tuple[np.ndarray, np.ndarray]:
    yaw = np.radians(90.0 - trajectory.attitude_deg()[2])
    return np.hypot(*trajectory.xyz_m[:, :2].T), yaw


def test_no_links__is_the_vehicle() -> None:
    vehicle = circle(20.0)
    assert towed(vehicle, ()) is vehicle


def test_rigid__keeps_its_place_on_the_vehicle() -> None:
    body = towed(circle(20.0), (Link((-3.0, 4.0), 0.0),))
    radius_m, yaw = radius_and_yaw(body)
    assert radius_m == pytest.approx(np.hypot(20.0 - 4.0, 3.0), abs=1e-9)
    np.testing.assert_allclose(np.cos(yaw - radius_and_yaw(circle(20.0))[1]), 1.0)


@pytest.mark.parametrize("every_s", [0.1, 1.0])
@pytest.mark.parametrize("drawbar_m", [1.5, 5.0, 12.0])
def test_drawn__runs_on_the_smaller_circle(every_s: float, drawbar_m: float) -> None:
    """In the steady state the drawbar is a tangent to the circle of the axle: r² = R² − L²."""
    body = towed(circle(20.0, every_s), (Link((0.0, 0.0), drawbar_m),))
    radius_m, _ = radius_and_yaw(body)
    settled = body.t_s > 0.5 * body.t_s[-1]
    assert radius_m[settled] == pytest.approx(np.sqrt(400.0 - drawbar_m**2), abs=0.01 if every_s < 1.0 else 0.05)


def test_train__of_two_joints() -> None:
    body = towed(circle(20.0, seconds=240.0), (Link((-1.0, 0.0), 4.0), Link((-2.0, 0.0), 5.0)))
    first = 400.0 + 1.0 - 16.0
    assert radius_and_yaw(body)[0][-1] == pytest.approx(np.sqrt(first + 4.0 - 25.0), abs=0.02)


def test_straight__it_comes_in_line_with_the_tractrix() -> None:
    """After a rectangular turn the angle behind goes as tan(φ/2) = tan(45°) exp(−s/L)."""
    t_s = np.arange(0.0, 10.0, 0.1)
    place = np.column_stack([np.maximum(t_s - 0.1, 0.0), 0.0 * t_s, 0.0 * t_s])
    heading = np.where(t_s < 0.1, 0.0, 90.0)
    vehicle = trajectory_from_attitude(t_s, place, 0.0, 0.0, heading, max_gap_s=15.0)
    yaw = radius_and_yaw(towed(vehicle, (Link((0.0, 0.0), 3.0),)))[1]
    np.testing.assert_allclose(np.tan(0.5 * yaw), np.exp(-place[:, 0] / 3.0), atol=1e-9)


def test_gap__it_stands_behind_the_vehicle_again() -> None:
    vehicle = circle(20.0)
    late = np.where(np.arange(len(vehicle)) < 600, 0.0, 100.0)
    parted = trajectory_from_attitude(
        vehicle.t_s + late, vehicle.xyz_m, 0.0, 0.0, vehicle.attitude_deg()[2], max_gap_s=15.0
    )
    body = towed(parted, (Link((0.0, 0.0), 5.0),))
    assert np.cos(radius_and_yaw(body)[1] - radius_and_yaw(vehicle)[1])[[0, 600]] == pytest.approx(1.0)
