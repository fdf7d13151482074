"""What the gyroscopes of an IMU measure on a true drive."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from furrowmap.core.adjustment.imu_aiding import Gyroscopes
from furrowmap.core.adjustment.knots import KNOT_STEP_S, Knots
from furrowmap.core.adjustment.preintegration import Site
from furrowmap.core.values.inertial import inertial_noise
from furrowmap.core.values.trajectory import Trajectory

FloatArray = NDArray[np.float64]

NOISE = inertial_noise("industrial")
SITE = Site(9.8, np.array([0.0, 5.9e-5, 4.3e-5]), 6.37e6, 1.0)
MISALIGNMENT = np.radians([0.6, -0.9, 0.7])
SCALE = 0.008


def gyro_on(
    truth: Trajectory, knots: Knots, bias_radps: FloatArray, seed: int, share: float = 0.0, *, noisy: bool = True
) -> Gyroscopes:
    """Turns between knots inside the drive, by an IMU with a bias.

    It is mounted askew by a share of MISALIGNMENT, and its gyroscopes measure too much by a share of SCALE.
    """
    t_s = knots.t_s[knots.linked]
    axes = Rotation.from_quat(truth.at(np.clip(knots.t_s, *truth.span_s)).quaternion, scalar_first=True)
    earth = Rotation.from_rotvec(KNOT_STEP_S * SITE.earth_rate_radps)
    true = (axes[knots.linked].inv() * earth * axes[knots.linked + 1]).as_rotvec()
    noise = noisy * NOISE.rate * np.sqrt(KNOT_STEP_S) * np.random.default_rng(seed).standard_normal(true.shape)
    askew = Rotation.from_rotvec(share * MISALIGNMENT).inv().apply(true)
    return Gyroscopes(t_s, (1.0 + share * SCALE) * askew + KNOT_STEP_S * bias_radps + noise, NOISE, SITE)
