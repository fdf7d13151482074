"""A walk with fixed positions and an IMU behind a filter: the IMU is at fault, and positions that are right stay so."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from furrowmap.core.runtime.arrays import FloatArray
from furrowmap.core.trajectory.from_inertial import InertialTrajectory, trajectory_from_inertial
from furrowmap.core.trajectory.inertial_start import MountedImu
from furrowmap.core.values.inertial import inertial_noise
from tests.core.trajectory.flights import BEGIN_S, LEVER_M, MOUNTING, Flight, frame
from tests.core.trajectory.walks import Walk, filtered

WALK = Walk(50.0, 1, 1.3)
CONSUMER_BIAS = (0.01, 0.2)
"""Standard deviations, rad/s and m/s²."""


@cache
def walked(cut_off_hz: float, kind: str, swing_m: float = 0.0) -> InertialTrajectory:
    """Heights may swing about the truth, in ten seconds."""
    exact = WALK.noisy_track(0.006, 0.004)
    swing = swing_m * np.sin(0.2 * np.pi * (exact.t_s - BEGIN_S))
    track = replace(exact, height_m=exact.height_m + swing)
    mounted = MountedImu(
        filtered(WALK.imu(100.0), cut_off_hz, seed=1, bias=CONSUMER_BIAS), MOUNTING, inertial_noise(kind)
    )
    return trajectory_from_inertial(track, mounted, frame(), LEVER_M, None)


def off_m(found: InertialTrajectory) -> FloatArray:
    """(3,) RMS of the errors of the vehicle's places."""
    trajectory = found.trajectory
    error_m = trajectory.xyz_m - WALK.xyz_m(trajectory.t_s - BEGIN_S)
    return np.asarray(np.sqrt((error_m**2).mean(axis=0)))


@pytest.mark.parametrize(("cut_off_hz", "kind"), [(1.5, "industrial"), (5.0, "consumer"), (5.0, "tactical")])
def test_right_positions__are_not_blamed_for_a_filtered_imu(cut_off_hz: float, kind: str) -> None:
    found = walked(cut_off_hz, kind)
    assert "contradiction.positions-err" not in {notice.key for notice in found.notices}
    assert off_m(found)[2] < 0.025
    assert (off_m(found) < np.maximum(0.02, 3.0 * np.median(found.trajectory.sigma[:, :3], axis=0))).all()


def test_imu_that_misses_the_steps__is_named() -> None:
    keys = {notice.key for notice in walked(1.5, "industrial").notices}
    assert keys & {"imu-misses-motion", "imu-noisier", "contradiction.force-scatters"}


@pytest.mark.parametrize(
    ("swing_hz", "white_m", "key"), [(1.6, 0.006, "imu-misses-motion"), (0.0, 0.03, "contradiction.scatter")]
)
def test_positions_that_scatter__are_told_from_motion_that_the_imu_does_not_show(
    swing_hz: float, white_m: float, key: str
) -> None:
    """A pole that gives swings the antenna; positions that are worse than stated differ from one to the next."""
    flight = Flight(40.0, 3)
    exact = flight.noisy_track(0.006, 0.004)
    swing_m = 0.04 * np.sin(2.0 * np.pi * swing_hz * (exact.t_s - BEGIN_S))
    noisy = np.random.default_rng(4).normal(0.0, white_m, len(exact))
    track = replace(exact, height_m=exact.height_m + swing_m + noisy)
    mounted = MountedImu(flight.noisy_imu(rate_hz=100.0), MOUNTING, inertial_noise("industrial"))
    assert key in {notice.key for notice in trajectory_from_inertial(track, mounted, frame(), LEVER_M, None).notices}


def test_heights_that_swing__are_named_beside_a_filtered_imu() -> None:
    assert "contradiction.positions-err" in {notice.key for notice in walked(5.0, "consumer", swing_m=0.3).notices}
