"""Standard deviations of the poses: marginal covariances of what is slow and what is quick, added up."""

from __future__ import annotations

from dataclasses import dataclass

import numba
import numpy as np
from numpy.typing import NDArray

from furrowmap.core.estimation.banded import NormalEquations
from furrowmap.core.estimation.coarse import CoarseKnots
from furrowmap.core.estimation.states import POSE, State
from furrowmap.core.runtime import scratch

FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class Considered:
    """A parameter that is not estimated, but whose uncertainty counts.

    Schmidt 1966, Application of state-space methods to navigation problems.

    Attributes:
        mode: (count · size,) movement of the coarse knots by one standard deviation of it.
        right: (count · size,) right-hand side by which absolute observations resist that movement.
    """

    mode: FloatArray
    right: FloatArray


def slow_covariance(free: NormalEquations, considered: Considered) -> FloatArray:
    """(count · size, count · size) covariance of the coarse knots with free references, with a considered parameter."""
    slow = free.inverse()
    left = considered.mode - slow @ considered.right
    slow += np.outer(left, left)
    return slow


def quick_variances(held: NormalEquations, size: int) -> FloatArray:
    """(n, 6) variances of the poses with fixed references."""
    sigma = held.solve().sigma().reshape(-1, size)[:, :POSE]
    out: FloatArray = np.square(sigma, out=scratch.zeros(sigma.shape))
    return out


def pose_sigmas(
    state: State, coarse: CoarseKnots, centre_m: FloatArray, slow: FloatArray, quick: FloatArray
) -> FloatArray:
    """Standard deviations (n, 6) of easting, northing, height (m), roll, pitch, heading (degrees) at the knots.

    Args:
        state: the solution.
        coarse: the coarse knots.
        centre_m: see :meth:`CoarseKnots.centres`.
        slow: see :func:`slow_covariance`.
        quick: (n, 6) see :func:`quick_variances`.
    """
    variance: FloatArray = scratch.zeros(quick.shape)
    _variances(
        state.layout.size,
        np.ascontiguousarray(state.xyz_m),
        np.ascontiguousarray(state.rotation),
        coarse.before,
        coarse.share,
        centre_m,
        np.ascontiguousarray(slow),
        quick,
        variance,
    )
    out: FloatArray = np.maximum(variance, 0.0, out=variance)
    np.sqrt(out, out=out)
    np.degrees(out[:, 3:], out=out[:, 3:])
    return out


@numba.njit(cache=True, nogil=True)
def _variances(size, xyz_m, rotation, before, share, centre_m, slow, quick, out):  # type: ignore[no-untyped-def]
    n = len(xyz_m)
    count = len(centre_m)
    design = np.zeros((6, 12))
    block = np.empty((12, 12))
    for j in range(n):
        for e in range(2):
            c = min(before[j] + e, count - 1)
            w = share[j] if e else 1.0 - share[j]
            dx, dy, dz = xyz_m[j, 0] - centre_m[c, 0], xyz_m[j, 1] - centre_m[c, 1], xyz_m[j, 2] - centre_m[c, 2]
            o = 6 * e
            for a in range(6):
                design[a, o + a] = w
            design[0, o + 4], design[0, o + 5] = w * dz, -w * dy
            design[1, o + 3], design[1, o + 5] = -w * dz, w * dx
            design[2, o + 3], design[2, o + 4] = w * dy, -w * dx
            for f in range(2):
                d = min(before[j] + f, count - 1)
                for a in range(6):
                    for b in range(6):
                        block[o + a, 6 * f + b] = slow[c * size + a, d * size + b]
        covariance = design @ block @ design.T
        for a in range(6):
            covariance[a, a] += quick[j, a]
        for a in range(3):
            out[j, a] = covariance[a, a]
        turn = covariance[3:, 3:].copy()
        for axis in range(2):
            along = rotation[j, :, axis].copy()
            out[j, 3 + axis] = along @ (turn @ along)
        out[j, 5] = turn[2, 2]
