"""Angular rate and specific force integrated from knot to knot (Forster et al. 2017, IEEE Trans. Robotics 33, 1-21)."""

from __future__ import annotations

from dataclasses import dataclass

import numba
import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]


@dataclass(frozen=True)
class Increments:
    """Motion of an IMU from each of k times to the next, in the axes at the earlier time, without gravity.

    Attributes:
        turn: (k, 3, 3) rotation matrix from the later axes to the earlier.
        velocity_mps: (k, 3) change of velocity.
        way_m: (k, 3) way beyond that of the velocity at the beginning.
    """

    turn: FloatArray
    velocity_mps: FloatArray
    way_m: FloatArray


def increments(
    t_s: FloatArray, rate_radps: FloatArray, force_mps2: FloatArray, begin_s: FloatArray, end_s: FloatArray
) -> Increments:
    """Integrate samples, between which rate and force are linear, over intervals.

    Args:
        t_s: (n,) times of the samples, increasing.
        rate_radps: (n, 3) angular rate.
        force_mps2: (n, 3) specific force.
        begin_s: (k,) begins of the intervals, increasing, within the times.
        end_s: (k,) their ends.
    """
    first = np.searchsorted(t_s, begin_s, side="right").astype(np.int64)
    arrays = (np.ascontiguousarray(a, np.float64) for a in (t_s, rate_radps, force_mps2, begin_s, end_s))
    return Increments(*_increments(*arrays, first))


@numba.njit(cache=True, nogil=True)
def _value(t_s, values, k, at_s, out):  # type: ignore[no-untyped-def]
    """The value at a time between samples k − 1 and k."""
    share = (at_s - t_s[k - 1]) / (t_s[k] - t_s[k - 1])
    for a in range(3):
        out[a] = values[k - 1, a] + share * (values[k, a] - values[k - 1, a])


@numba.njit(cache=True, nogil=True)
def exponential(x, y, z):  # type: ignore[no-untyped-def]
    """Rotation matrix (3, 3) of a rotation vector (Rodrigues)."""
    angle2 = x * x + y * y + z * z
    if angle2 < 1e-12:
        a, b = 1.0 - angle2 / 6.0, 0.5 - angle2 / 24.0
    else:
        angle = np.sqrt(angle2)
        a, b = np.sin(angle) / angle, (1.0 - np.cos(angle)) / angle2
    out = np.empty((3, 3))
    out[0, 0], out[1, 1], out[2, 2] = 1.0 - b * (y * y + z * z), 1.0 - b * (x * x + z * z), 1.0 - b * (x * x + y * y)
    out[0, 1], out[1, 0] = b * x * y - a * z, b * x * y + a * z
    out[0, 2], out[2, 0] = b * x * z + a * y, b * x * z - a * y
    out[1, 2], out[2, 1] = b * y * z - a * x, b * y * z + a * x
    return out


@numba.njit(cache=True, nogil=True)
def _increments(t_s, rate, force, begin_s, end_s, first):  # type: ignore[no-untyped-def]
    count, n = len(begin_s), len(t_s)
    turn, velocity, way = np.empty((count, 3, 3)), np.zeros((count, 3)), np.zeros((count, 3))
    w0, w1, f0, f1 = np.empty(3), np.empty(3), np.empty(3), np.empty(3)
    for i in range(count):
        k = min(max(first[i], 1), n - 1)
        now = begin_s[i]
        _value(t_s, rate, k, now, w0)
        _value(t_s, force, k, now, f0)
        turned = np.eye(3)
        while now < end_s[i]:
            then = min(t_s[k], end_s[i]) if k < n - 1 else end_s[i]
            _value(t_s, rate, k, then, w1)
            _value(t_s, force, k, then, f1)
            dt = then - now
            half = 0.25 * dt  # of the mean of both rates
            x, y, z = half * (w0[0] + w1[0]), half * (w0[1] + w1[1]), half * (w0[2] + w1[2])
            middle = turned @ exponential(x, y, z)
            pushed = middle @ (0.5 * (f0 + f1))
            for a in range(3):
                way[i, a] += velocity[i, a] * dt + 0.5 * pushed[a] * dt * dt
                velocity[i, a] += pushed[a] * dt
            turned = middle @ exponential(x, y, z)
            w0[:], f0[:] = w1, f1
            now = then
            if k < n - 1:
                k += 1
        turn[i] = turned
    return turn, velocity, way
