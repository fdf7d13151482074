"""A flight that sees no ground twice: its boresight is assumed, which is said."""

from __future__ import annotations

import numpy as np
import pytest

from furrowmap.core.strips.boresight import boresight, boresight_notices
from furrowmap.core.strips.strips import strip_returns
from furrowmap.core.trajectory.from_inertial import trajectory_from_inertial
from furrowmap.core.trajectory.inertial_start import MountedImu
from furrowmap.core.values.inertial import inertial_noise
from furrowmap.core.values.rotation import Mounting
from furrowmap.core.values.scan import Scan
from tests.core.trajectory.flights import BEGIN_S, LEVER_M, MOUNTING, Flight, frame

POINTS = 2000
STATED = Mounting((0.0, 0.0, -0.1))


def over_flat_ground(flight: Flight, number: int) -> Scan:
    """One revolution at 10 Hz of a level scanner, of random ranges: a wood, no smooth ground."""
    random = np.random.default_rng(number)
    xyz = random.uniform((-20.0, -20.0, -40.0), (20.0, 20.0, -10.0), (POINTS, 3)).astype(np.float32)
    ones = np.ones(POINTS, np.uint8)
    t_s = BEGIN_S + 5.0 + 0.1 * number + np.linspace(0.0, 0.099, POINTS)
    return Scan(number, t_s, xyz, ones, ones, ones.astype(np.uint16), ones, ones)


@pytest.mark.parametrize("scans", [0, 50])
def test_boresight__without_smooth_ground_at_several_times_is_assumed(scans: int) -> None:
    flight = Flight(20.0, seed=1)
    imu = MountedImu(flight.imu(), MOUNTING, inertial_noise("industrial"))
    trajectory = trajectory_from_inertial(flight.track(), imu, frame(), LEVER_M, None).trajectory
    returns = strip_returns((over_flat_ground(flight, k) for k in range(scans)), trajectory)
    found = boresight(returns, trajectory, STATED)
    assert found is None or not found.certain
    assert [notice.code for notice in boresight_notices(found, STATED)] == ["boresight-assumed"]
