"""How well the poses are known after matching, and what held the heading."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Final

import numba
import numpy as np
from numpy.typing import NDArray

from furrowmap.core.calibration.range_bow import Bow
from furrowmap.core.estimation.banded import NormalEquations
from furrowmap.core.estimation.knots import STEP_S, State
from furrowmap.core.matching.agreement import CORRELATED
from furrowmap.core.matching.coarse import SIZE, CoarseKnots
from furrowmap.core.matching.equations import LEVEL_SIGMA, Held

FloatArray = NDArray[np.float64]

AROUND_S: Final = 0.5
"""What the scans hold is judged over this time to either side."""
PLACED_M: Final = 0.05
"""Without GNSS, scans that hold the place no better leave it to wheels and inertia."""


def sigmas(
    state: State,
    held: Held,
    coarse: CoarseKnots,
    centre_m: FloatArray,
    together: NormalEquations,
    bow: Bow,
    normal: FloatArray,
) -> FloatArray:
    """Standard deviations (n, 6) of easting, northing, height (m), roll, pitch, heading (degrees) at the knots.

    What is slow comes from the equations in which the ground moves along, what is quick from those in which it is
    held; a covariance of both is their sum. What neighbouring returns have wrong alike lifts and tilts a scan but does
    not turn it, as relief slopes to all sides: of the quick part of a heading, what returns hold is as good as
    independent returns make it.

    Args:
        state: the solution.
        held: equations of all knots with the ground held.
        coarse: the coarse knots.
        centre_m: see :meth:`CoarseKnots.centres`.
        together: equations of the coarse knots with the ground free.
        bow: of the scanner, which bends what is slow.
        normal: (n, 21) normal matrices of the returns between knots.
    """
    with ThreadPoolExecutor(1) as pool:
        beside = pool.submit(lambda: held.equations.solve().sigma())
        slow = together.inverse()
        bent = bow.mode - slow @ bow.held
        slow += np.outer(bent, bent)
        quick = beside.result().reshape(-1, SIZE)[:, :6] ** 2
    by_returns = np.minimum(hold_of(normal).heading * quick[:, 5], 1.0)
    quick[:, 5] *= 1.0 - by_returns * (1.0 - 1.0 / CORRELATED)
    variance = _variances(
        np.ascontiguousarray(state.xyz_m),
        np.ascontiguousarray(state.rotation),
        coarse.before,
        coarse.share,
        centre_m,
        np.ascontiguousarray(slow),
        quick,
    )
    out: FloatArray = np.sqrt(np.maximum(variance, 0.0))
    out[:, 3:] = np.degrees(out[:, 3:])
    return out


@dataclass(frozen=True)
class Hold:
    """How firmly the scans hold poses, within AROUND_S to either side.

    Attributes:
        heading: (n,) information (1 / rad²) about the heading, the other five unknowns eliminated.
        place: (n,) information (1 / m²) about the place where there is least of it, the other unknowns eliminated.
        level: (n,) whether roll and pitch are held.
    """

    heading: FloatArray
    place: FloatArray
    level: NDArray[np.bool_]


def hold_of(normal: FloatArray) -> Hold:
    """What normal matrices (n, 21) of the slices between knots hold; nothing where there is no ground in them."""
    half = round(AROUND_S / STEP_S)
    total = np.cumsum(np.pad(normal, ((half + 1, half), (0, 0))), axis=0)
    near = total[2 * half + 1 :] - total[: -2 * half - 1]
    n = len(near)
    square = np.zeros((n, 6, 6))
    row, column = np.triu_indices(6)
    square[:, row, column] = square[:, column, row] = near
    known = square[:, 2, 2] > 0
    out = Hold(np.zeros(n), np.zeros(n), np.zeros(n, np.bool_))
    if not known.any():
        return out
    m = square[known]
    m += np.eye(6) * (1e-9 * m[:, 2, 2])[:, None, None]
    out.heading[known] = _left(m, [5])[:, 0, 0]
    out.place[known] = np.linalg.eigvalsh(_left(m, [0, 1]))[:, 0]
    out.level[known] = np.linalg.eigvalsh(_left(m, [3, 4]))[:, 0] > 1.0 / LEVEL_SIGMA**2
    return out


def _left(normal: FloatArray, kept: list[int]) -> FloatArray:
    """Normal matrices (n, 6, 6) of the unknowns kept, the others eliminated (Schur complement)."""
    others = [i for i in range(6) if i not in kept]
    link = normal[:, kept][:, :, others]
    rest = np.linalg.solve(normal[:, others][:, :, others], link.transpose(0, 2, 1))
    left: FloatArray = normal[:, kept][:, :, kept] - link @ rest
    return left


@dataclass(frozen=True)
class HeldBy:
    """What held each knot's unknowns.

    Attributes:
        heading: (n,) words, as in :class:`~furrowmap.core.values.trajectory.Trajectory`.
        position: (n,) the same.
        height: (n,) the same.
        level: (n,) the same, of roll and pitch.
    """

    heading: NDArray[np.str_]
    position: NDArray[np.str_]
    height: NDArray[np.str_]
    level: NDArray[np.str_]


def held_by(
    ground: FloatArray,
    walls: FloatArray,
    heading_sigma_deg: FloatArray,
    heading_word: NDArray[np.str_],
    has_position: NDArray[np.bool_],
) -> HeldBy:
    """What held the poses: of all that did, what did so most firmly.

    Args:
        ground: (n, 21) normal matrices of the ground's returns between knots.
        walls: (n, 21) of those of what stands.
        heading_sigma_deg: (n,) of the headings before matching.
        heading_word: (n,) what held them.
        has_position: (n,) whether GNSS gave a position at the time.
    """
    relief, both = hold_of(ground), hold_of(ground + walls)
    by_walls = both.heading - relief.heading > relief.heading
    scans = np.where(by_walls, "walls", "relief")
    firmer = np.maximum(both.heading - relief.heading, relief.heading) > 1.0 / np.radians(heading_sigma_deg) ** 2
    placing = np.where(both.place - relief.place > relief.place, "walls", "relief")
    placed = np.where(both.place > 1.0 / PLACED_M**2, placing, "carried")
    return HeldBy(
        heading=np.where(firmer, scans, heading_word),
        position=np.where(has_position, "gnss", placed),
        height=np.where(has_position, "gnss", np.where(relief.level, "ground", "carried")),
        level=np.where(relief.level, "ground", "assumed"),
    )


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
        out[j, 5] = turn[2, 2]
    return out
