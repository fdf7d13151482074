"""How well the poses are known after matching, and what held the heading."""

from __future__ import annotations

from typing import Final

import numba
import numpy as np
from numpy.typing import NDArray

from furrowmap.core.matching.agreement import Sums
from furrowmap.core.matching.coarse import SIZE, CoarseKnots
from furrowmap.core.matching.equations import Held
from furrowmap.core.matching.knots import STEP_S, State
from furrowmap.core.trajectory.banded import NormalEquations

FloatArray = NDArray[np.float64]

HEADING_SHARE: Final = 0.5
"""What neighbouring returns have wrong alike lifts a scan more than it turns it: the headings that halves of the lasers
show agree in half of the standard deviation (0.2 to 0.55 of it on simulated soils, 0.9 on a robot's low scanner) that
:data:`~furrowmap.core.matching.agreement.CORRELATED` makes of it."""
AROUND_S: Final = 0.5
"""The relief's hold on the heading is judged over this time to either side."""


def sigmas(
    state: State, held: Held, coarse: CoarseKnots, centre_m: FloatArray, together: NormalEquations
) -> FloatArray:
    """Standard deviations (n, 6) of easting, northing, height (m), roll, pitch, heading (degrees) at the knots.

    What is slow comes from the equations in which the ground moves along, what is quick from those in which it is
    held; a covariance of both is their sum.

    Args:
        state: the solution.
        held: equations of all knots with the ground held.
        coarse: the coarse knots.
        centre_m: see :meth:`CoarseKnots.centres`.
        together: equations of the coarse knots with the ground free.
    """
    dense = together.dense()
    scale = 1.0 / np.sqrt(np.diag(dense))
    slow = np.linalg.inv(dense * scale[:, None] * scale) * scale[:, None] * scale
    quick = held.equations.solve().sigma().reshape(-1, SIZE)[:, :6] ** 2
    variance = _variances(
        np.ascontiguousarray(state.xyz_m),
        np.ascontiguousarray(state.rotation),
        coarse.before,
        coarse.share,
        centre_m,
        slow,
        quick,
    )
    out: FloatArray = np.sqrt(np.maximum(variance, 0.0))
    out[:, 3:] = np.degrees(out[:, 3:])
    return out


def relief_heading_sigma(sums: Sums) -> FloatArray:
    """Standard deviation (n,) in degrees of the heading that the relief alone shows within a second; inf without any.

    The other five unknowns of the pose are eliminated from the returns' normal equations.
    """
    half = round(AROUND_S / STEP_S)
    total = np.cumsum(np.pad(sums.normal, ((half + 1, half), (0, 0))), axis=0)
    near = total[2 * half + 1 :] - total[: -2 * half - 1]
    n = len(near)
    square = np.zeros((n, 6, 6))
    row, column = np.triu_indices(6)
    square[:, row, column] = square[:, column, row] = near
    known = square[:, 2, 2] > 0
    out = np.full(n, np.inf)
    if known.any():
        m = square[known]
        others = m[:, :5, :5] + np.eye(5) * (1e-9 * m[:, 2, 2])[:, None, None]
        link = m[:, 5, :5]
        left = m[:, 5, 5] - np.einsum("ni,ni->n", link, np.linalg.solve(others, link[:, :, None])[:, :, 0])
        out[known] = np.degrees(1.0 / np.sqrt(np.maximum(left, 1e-12)))
    return out


@numba.njit(cache=True, nogil=True)
def _variances(xyz_m, rotation, before, share, centre_m, slow, quick):  # type: ignore[no-untyped-def]
    n = len(xyz_m)
    count = len(centre_m)
    out = np.empty((n, 6))
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
                        block[o + a, 6 * f + b] = slow[c * SIZE + a, d * SIZE + b]
        covariance = design @ block @ design.T
        for a in range(6):
            covariance[a, a] += quick[j, a]
        for a in range(3):
            out[j, a] = covariance[a, a]
        turn = covariance[3:, 3:].copy()
        for axis in range(2):
            along = rotation[j, :, axis].copy()
            out[j, 3 + axis] = along @ (turn @ along)
        out[j, 5] = turn[2, 2] * HEADING_SHARE * HEADING_SHARE
    return out
