"""Returns of a moving scanner with the poses at their times."""

from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from furrowmap.core.runtime.arrays import Float32Array, FloatArray
from furrowmap.core.runtime.kernels import kernel
from furrowmap.core.values.scan import Scan
from furrowmap.core.values.trajectory import Trajectory

STRIP_CELL_M: Final = 0.25
MIN_STRIP_RANGE_M: Final = 1.0
"""Nearer returns are of the vehicle itself."""
MAX_STRIP_RETURNS: Final = 1_600_000
LASER_GROUPS: Final = 16
"""Groups of lasers with a range constant each."""


@dataclass(frozen=True)
class StripReturns:
    """Returns with the poses at their times, in single precision: a tenth of a millimetre at 2 km.

    Attributes:
        t_s: (n,) times, in their order.
        sensor_m: (n, 3) in the frame of the scanner.
        laser: (n,) group of the laser.
        origin_m: (n, 3) of the vehicle frame, against a local origin.
        rotation: (n, 4) quaternions (w, x, y, z), vehicle to map.
        velocity_mps: (n, 3) of the vehicle.
        rate_radps: (n, 3) angular rate in the map's axes.
        local_m: (3,) the local origin, a corner of a cell.
        beam: (n,) number of the laser, the lowest first; empty where it is not known.
    """

    t_s: FloatArray
    sensor_m: Float32Array
    laser: NDArray[np.int64]
    origin_m: Float32Array
    rotation: Float32Array
    velocity_mps: Float32Array
    rate_radps: Float32Array
    local_m: FloatArray
    beam: NDArray[np.uint8] = field(default_factory=lambda: np.zeros(0, np.uint8))

    def __len__(self) -> int:
        return len(self.t_s)


@dataclass(frozen=True)
class ThinnedReturns:
    """Returns of a recording without poses.

    Attributes:
        t_s: (n,) times, in their order.
        sensor_m: (n, 3) float32 in the frame of the scanner.
        laser: (n,) group of the laser.
        beam: (n,) number of the laser, the lowest first; empty where it is not known.
    """

    t_s: FloatArray
    sensor_m: Float32Array
    laser: NDArray[np.int64]
    beam: NDArray[np.uint8] = field(default_factory=lambda: np.zeros(0, np.uint8))

    def posed(self, trajectory: Trajectory) -> StripReturns:
        """With the poses at their times; those without a pose are left out.

        Args:
            trajectory: of the frame that carries the scanner.
        """
        t_s = self.t_s
        sensor_m = self.sensor_m
        laser = self.laser
        beam = self.beam
        knot, share, inside = trajectory.interval(t_s)
        if not inside.all():
            t_s = t_s[inside]
            sensor_m = sensor_m[inside]
            laser = laser[inside]
            knot = knot[inside]
            share = share[inside]
            beam = beam[inside] if len(beam) else beam
        steps_s = np.diff(trajectory.t_s)[:, None]
        attitude = Rotation.from_quat(trajectory.quaternion[:-1], scalar_first=True) if len(steps_s) else None
        rate = attitude.apply(trajectory.turn_rad / steps_s) if attitude is not None else np.zeros((0, 3))
        middle = np.median(trajectory.xyz_m[knot[0] : knot[-1] + 1], axis=0) if len(t_s) else np.zeros(3)
        local = np.round(middle / STRIP_CELL_M) * STRIP_CELL_M
        origin, rotation, velocity, turning = _poses(
            knot,
            share,
            np.ascontiguousarray(trajectory.xyz_m - local),
            np.ascontiguousarray(trajectory.quaternion),
            np.ascontiguousarray(trajectory.turn_rad),
            np.ascontiguousarray(np.diff(trajectory.xyz_m, axis=0) / steps_s),
            np.ascontiguousarray(rate),
        )
        return StripReturns(t_s, sensor_m, laser, origin, rotation, velocity, turning, local, beam)


def thinned_returns(scans: Iterable[Scan], span_s: tuple[float, float]) -> ThinnedReturns:
    """Returns of all scans, without those of the vehicle, thinned evenly to MAX_STRIP_RETURNS in a span of time."""
    per_second = MAX_STRIP_RETURNS / max(span_s[1] - span_s[0], 1.0)
    times = [np.zeros(0)]
    places = [np.zeros((0, 3), np.float32)]
    lasers = [np.zeros(0, np.uint8)]
    for scan in scans:
        if len(scan) < 2:
            continue
        wanted = per_second * max(float(scan.t_s[-1] - scan.t_s[0]), 0.01)
        chosen = slice(None, None, max(1, int(len(scan) / wanted)))
        # Copies: views would keep all returns of the recording in memory.
        times.append(scan.t_s[chosen].copy())
        places.append(scan.xyz_m[chosen].copy())
        lasers.append(scan.laser[chosen].copy())
    t_s = np.concatenate(times)
    sensor = np.concatenate(places)
    laser = np.concatenate(lasers)
    group = laser.astype(np.int64) * LASER_GROUPS // (int(laser.max(initial=0)) + 1)
    order = np.flatnonzero(np.einsum("ij,ij->i", sensor, sensor) > MIN_STRIP_RANGE_M**2)
    if (np.diff(t_s[order]) < 0.0).any():
        order = order[np.argsort(t_s[order], kind="stable")]
    return ThinnedReturns(t_s[order], sensor[order], group[order], laser[order])


def strip_returns(scans: Iterable[Scan], trajectory: Trajectory) -> StripReturns:
    """Returns of all scans, evenly thinned to MAX_STRIP_RETURNS, with their poses."""
    return thinned_returns(scans, trajectory.span_s).posed(trajectory)


def at_shifted_times(returns: StripReturns, trajectory: Trajectory, offset_s: float) -> StripReturns:
    """The returns with the poses at times later by an offset; those without a pose there are left out.

    Args:
        trajectory: of the frame that carries it.
        offset_s: time by which the scanner's clock is behind.
    """
    return ThinnedReturns(returns.t_s + offset_s, returns.sensor_m, returns.laser, returns.beam).posed(trajectory)


@kernel()
def _poses(knot, share, knot_m, knot_rotation, turn_rad, velocity, rate):  # type: ignore[no-untyped-def]
    """Poses and their rates (n, 3), (n, 4), (n, 3), (n, 3): straight between knots, turning at a constant rate."""
    n = len(knot)
    origin = np.empty((n, 3), np.float32)
    rotation = np.empty((n, 4), np.float32)
    moving = np.empty((n, 3), np.float32)
    turning = np.empty((n, 3), np.float32)
    for i in range(n):
        k = knot[i]
        s = share[i]
        for j in range(3):
            origin[i, j] = knot_m[k, j] + s * (knot_m[k + 1, j] - knot_m[k, j])
            moving[i, j] = velocity[k, j]
            turning[i, j] = rate[k, j]
        x = 0.5 * s * turn_rad[k, 0]
        y = 0.5 * s * turn_rad[k, 1]
        z = 0.5 * s * turn_rad[k, 2]
        half = np.sqrt(x * x + y * y + z * z)
        w = np.cos(half)
        sinc = np.sin(half) / half if half > 1e-9 else 1.0
        x = sinc * x
        y = sinc * y
        z = sinc * z
        a = knot_rotation[k, 0]
        b = knot_rotation[k, 1]
        c = knot_rotation[k, 2]
        d = knot_rotation[k, 3]
        rotation[i, 0] = a * w - b * x - c * y - d * z
        rotation[i, 1] = a * x + b * w + c * z - d * y
        rotation[i, 2] = a * y - b * z + c * w + d * x
        rotation[i, 3] = a * z + b * y - c * x + d * w
    return origin, rotation, moving, turning
