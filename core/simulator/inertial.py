"""The IMU: what it would measure in earth-centred, earth-fixed coordinates, and its errors.

Specific force is acceleration plus Coriolis acceleration minus normal gravity, which holds the centrifugal one (Groves
2013, Principles of GNSS, Inertial and Multisensor Integrated Navigation Systems, chapter 2); both derivatives are
differences of fourth order of the path, through which splines of fifth degree are laid.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
from scipy.interpolate import make_interp_spline
from scipy.spatial.transform import Rotation

from furrowmap.core.simulator.flight_scenario import ScenarioImu
from furrowmap.core.simulator.motion import SimulatedMotion, mount_rotation, vehicle_rotation
from furrowmap.core.simulator.noise import FloatArray, gauss_markov, random_for
from furrowmap.core.simulator.site import SimulatedSite

GRID_STEP_S: Final = 0.005
"""Of the differences."""
IMU_LEAD_IN_S: Final = 0.2
"""The log begins this long before t0."""
EARTH_RADPS: Final = 7.292115e-5
MG: Final = 9.80665e-3
GRS80: Final = (9.7803267715, 0.001931851353, 0.00669438002290)
"""Normal gravity at the equator, Somigliana's constant, square of the first eccentricity (Moritz 2000)."""
_RATE: Final = "gyro_x_dps,gyro_y_dps,gyro_z_dps"
_FORCE: Final = "force_x_mps2,force_y_mps2,force_z_mps2"


@dataclass(frozen=True)
class SimulatedImuLog:
    """What the IMU says.

    Attributes:
        t_s: (n,) local time of the measurements, true.
        rate_dps: (n, 3) angular rate, with its errors, in the axes of the IMU.
        force_mps2: (n, 3) specific force.
        bias: (n, 6) errors of rate (degrees per second) and force that change slowly, without those of scale.
    """

    t_s: FloatArray
    rate_dps: FloatArray
    force_mps2: FloatArray
    bias: FloatArray


def measure(imu: ScenarioImu, motion: SimulatedMotion, site: SimulatedSite, end_s: float, seed: int) -> SimulatedImuLog:
    """The measurements from `BEFORE_S` before t0 to `end_s`."""
    t_s = np.arange(-round(IMU_LEAD_IN_S * imu.rate_hz), int(end_s * imu.rate_hz) + 1) / imu.rate_hz
    rate, force = exact(motion, site, t_s, np.asarray(imu.xyz_m))
    mounted = mount_rotation(imu.rpy_deg)
    true = np.concatenate([np.degrees(rate @ mounted), force @ mounted], axis=1)
    rng, step_s, n = random_for(seed, "imu"), 1.0 / imu.rate_hz, len(t_s)
    columns = np.empty((n, 6))
    bias = np.empty((n, 6))
    errors = (
        (imu.gyro_noise_deg_s_rthz, imu.gyro_bias_deg_s, imu.gyro_walk_deg_s_rts, imu.gyro_instability_deg_s, 1.0),
        (imu.accel_noise_mg_rthz, imu.accel_bias_mg, imu.accel_walk_mg_rts, imu.accel_instability_mg, MG),
    )
    for column in range(6):
        density, spread, walk, instability, unit = errors[column // 3]
        scale = (imu.gyro_scale, imu.accel_scale)[column // 3] * rng.standard_normal()
        slow = spread * rng.standard_normal() + walk * np.sqrt(step_s) * np.cumsum(rng.standard_normal(n))
        slow += gauss_markov(rng, n, step_s, instability, imu.instability_s)
        bias[:, column] = unit * slow
        noise = unit * density * np.sqrt(imu.rate_hz) * rng.standard_normal(n)
        columns[:, column] = (1.0 + scale) * true[:, column] + bias[:, column] + noise
    return SimulatedImuLog(t_s, columns[:, :3], columns[:, 3:], bias)


def exact(
    motion: SimulatedMotion, site: SimulatedSite, t_s: FloatArray, arm_m: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Angular rate against inertial space (rad/s) and specific force at a point of the vehicle, in its axes."""
    angles = np.column_stack([motion.roll_rad, motion.pitch_rad, motion.yaw_rad])
    path = make_interp_spline(motion.t_s, np.column_stack([motion.xyz_m, angles]), 5)
    seconds = np.arange(np.floor(t_s[0]) - 1.0, t_s[-1] + 3.0)
    place = path(np.clip(seconds, motion.t_s[0], motion.t_s[-1]))
    map_axes = site.earth_axes(place[:, :3])
    by_axis = make_interp_spline(seconds, map_axes.reshape(-1, 9), 1)

    def earth(at_s: FloatArray) -> tuple[FloatArray, FloatArray]:
        now = path(at_s)
        axes = by_axis(at_s).reshape(-1, 3, 3) @ vehicle_rotation(now[:, 3], now[:, 4], now[:, 5])
        return site.earth_m(now[:, :3]) + axes @ arm_m, axes

    (p0, axes), *rest = (earth(t_s + k * GRID_STEP_S) for k in (0, -2, -1, 1, 2))
    p = [place - p0 for place, _ in rest]
    velocity = (p[0] - 8.0 * p[1] + 8.0 * p[2] - p[3]) / (12.0 * GRID_STEP_S)
    acceleration = (-p[0] + 16.0 * p[1] + 16.0 * p[2] - p[3]) / (12.0 * GRID_STEP_S**2)
    wide, near = (
        np.asarray(Rotation.from_matrix(rest[a][1].transpose(0, 2, 1) @ rest[b][1]).as_rotvec(), np.float64)
        for a, b in ((0, 3), (1, 2))
    )
    turning = (8.0 * near - wide) / (12.0 * GRID_STEP_S)
    spin = np.array([0.0, 0.0, EARTH_RADPS])
    up = by_axis(t_s).reshape(-1, 3, 3)[:, :, 2]
    now = path(t_s)
    _, lat = site.geographic(now[:, 0], now[:, 1])
    gravity = normal_gravity_mps2(lat, now[:, 2] + site.h0_m)
    force = acceleration + 2.0 * np.cross(spin, velocity) + gravity[:, None] * up
    back = axes.transpose(0, 2, 1)
    return turning + back @ spin, np.einsum("kij,kj->ki", back, force)


def normal_gravity_mps2(lat_deg: FloatArray, height_m: FloatArray) -> FloatArray:
    """Of GRS80: Somigliana's formula, and the usual gradient with height."""
    equator, constant, square = GRS80
    sine2 = np.sin(np.radians(lat_deg)) ** 2
    surface = equator * (1.0 + constant * sine2) / np.sqrt(1.0 - square * sine2)
    out: FloatArray = surface - (3.0877e-6 - 4.3e-9 * sine2) * height_m + 0.72e-12 * height_m**2
    return out


def write_imu(file: Path, log: SimulatedImuLog, imu: ScenarioImu, site: SimulatedSite) -> None:
    """The log as CSV, stamped with its own clock."""
    table = np.column_stack([site.t0_s + log.t_s + imu.time_offset_s, log.rate_dps, log.force_mps2])
    np.savetxt(
        file, table, fmt="%.4f" + ",%.5f" * 6, header=f"time_unix_s,{_RATE},{_FORCE}", comments="", encoding="ascii"
    )


def write_biases(file: Path, log: SimulatedImuLog, imu: ScenarioImu, site: SimulatedSite) -> None:
    """The biases at 10 Hz."""
    i = slice(None, None, max(1, imu.rate_hz // 10))
    table = np.column_stack([site.t0_s + log.t_s[i], log.bias[i]])
    np.savetxt(file, table, fmt="%.4f" + ",%.6f" * 6, header=f"time_unix_s,{_RATE},{_FORCE}", comments="")
