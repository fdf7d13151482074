"""What GNSS, wheels and inertia say about the poses, beside what the ground says."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numba
import numpy as np
from numpy.typing import NDArray

from furrowmap.core.estimation.banded import NormalEquations
from furrowmap.core.estimation.knots import STEP_S, Knots, State, turns
from furrowmap.core.matching.agreement import Sums
from furrowmap.core.matching.coarse import SIZE
from furrowmap.core.trajectory.kinematic import CORRELATION_S, HUBER, SLIP
from furrowmap.core.trajectory.positions import Positions

FloatArray = NDArray[np.float64]

ACCELERATION: Final = 0.5
"""Of the vehicle over ground, in m/s per square root of a second (white acceleration); heaving is a little less."""
HEAVE: Final = 0.4
SWAY: Final = np.radians(12.0)
"""Of roll and pitch, in rad/s per square root of a second: a quarter of a degree at 1 to 3 Hz has 15°/s^1.5."""
TURNING: Final = np.radians(20.0)
LEVEL_SIGMA: Final = np.radians(3.0)
LEVEL_CORRELATION_S: Final = 20.0
"""How far a field, and with it the vehicle, is off the level, and for how long by the same: holds what nothing else
does, the roll of a straight drive."""
SLIP_FLOOR_M: Final = 0.0005
SLIP_EVERY_S: Final = 0.1
"""Slip is independent from one such interval to the next."""
HEADING_CORRELATION_S: Final = 10.0
HEADING_SIGMA: Final = np.radians(0.5)
"""Of a two-antenna heading, whose error lasts for HEADING_CORRELATION_S."""


@dataclass(frozen=True)
class Held:
    """Normal equations, and how well the positions fit.

    Attributes:
        equations: of all knots.
        misfit: (m,) horizontal residuals of the positions in standard deviations; nan where none of the knots is.
    """

    equations: NormalEquations
    misfit: FloatArray


def hold(
    knots: Knots,
    state: State,
    sums: Sums,
    right: FloatArray,
    positions: Positions,
    origin_m: FloatArray,
    lever_m: FloatArray,
    trust: FloatArray,
) -> Held:
    """Normal equations of all knots from the ground, GNSS, wheels and inertia.

    Args:
        knots: whose poses are sought.
        state: where the equations are linearised.
        sums: of the returns.
        right: (n, 6) right-hand sides of the returns, one of the two in `sums`.
        positions: of the antenna.
        origin_m: local origin.
        lever_m: (3,) the antenna in the vehicle frame.
        trust: (m,) weights of the positions, 1 for a whole one.
    """
    held = hold_blind(knots, state, positions, origin_m, lever_m, trust)
    add_slices(held.equations, knots, sums.normal, right)
    return held


def hold_blind(
    knots: Knots, state: State, positions: Positions, origin_m: FloatArray, lever_m: FloatArray, trust: FloatArray
) -> Held:
    """What :func:`hold` gives without any returns: :func:`add_slices` adds them."""
    equations = NormalEquations(len(knots) * SIZE, 3 * SIZE)
    misfit = _add_positions(equations, knots, state, positions, origin_m, lever_m, trust)
    _add_drift(equations, knots, state, positions)
    _add_inertia(equations, knots, state)
    _add_wheels(equations, knots, state)
    _add_level(equations, knots, state)
    return Held(equations, misfit)


def position_trust(misfit: FloatArray) -> FloatArray:
    """(m,) weights by Huber's function of residuals in standard deviations."""
    known = np.nan_to_num(misfit)
    return np.where(known > HUBER, HUBER / np.maximum(known, HUBER), 1.0)


def add_slices(equations: NormalEquations, knots: Knots, normal: FloatArray, right: FloatArray) -> None:
    """Add what returns say of the slices between knots: a slice's pose is the mean of those of its two knots.

    Args:
        equations: of all knots; changed.
        knots: whose poses are sought.
        normal: (n, 21) see :class:`~furrowmap.core.matching.agreement.Sums`.
        right: (n, 6) one of its right-hand sides.
    """
    _add_slices(equations.band, equations.right, knots.linked, normal, np.ascontiguousarray(right))


@numba.njit(cache=True, nogil=True)
def _add_slices(band, right, linked, normal, slice_right):  # type: ignore[no-untyped-def]
    for k in linked:
        first = k * SIZE
        entry = 0
        for a in range(6):
            half = 0.5 * slice_right[k, a]
            right[first + a] += half
            right[first + SIZE + a] += half
            for b in range(a, 6):
                quarter = 0.25 * normal[k, entry]
                entry += 1
                band[b - a, first + a] += quarter
                band[b - a, first + SIZE + a] += quarter
                band[SIZE + a - b, first + b] += quarter
                if a != b:
                    band[SIZE + b - a, first + a] += quarter


def _add_positions(
    equations: NormalEquations,
    knots: Knots,
    state: State,
    positions: Positions,
    origin_m: FloatArray,
    lever_m: FloatArray,
    trust: FloatArray,
) -> FloatArray:
    """Antenna = origin + R · lever + drift. Returns the horizontal residuals in standard deviations."""
    seen = Seen.of(knots, state, positions, origin_m, lever_m)
    misfit = np.full(len(positions.t_s), np.nan)
    if not len(seen.knot):
        return misfit
    k, share, turned = seen.knot, seen.share[:, None], seen.arm_m
    white = positions.white_m[seen.inside]
    misfit[seen.inside] = np.hypot(*(seen.residual_m / white)[:, :2].T)
    sigma = white / np.sqrt(trust[seen.inside, None])
    design = np.zeros((len(k), 3, 2 * SIZE))
    for first, weight in ((0, 1.0 - share[:, 0]), (SIZE, share[:, 0])):
        for axis in range(3):
            one, two = (axis + 1) % 3, (axis + 2) % 3
            design[:, axis, first + axis] = weight
            design[:, axis, first + 3 + one] = weight * turned[:, two]
            design[:, axis, first + 3 + two] = -weight * turned[:, one]
            design[:, axis, first + 6 + axis] = weight
    for chosen in _without_repeats(k):
        for axis in range(3):
            equations.add(k[chosen] * SIZE, design[chosen, axis], seen.residual_m[chosen, axis], sigma[chosen, axis])
    headings = Headings.of(seen, state, positions)
    for chosen in _without_repeats(headings.knot) if len(headings.knot) else ():
        at, sigma_rad = headings.knot[chosen] * SIZE + 5, np.full(len(chosen), headings.sigma_rad)
        equations.add(at, np.ones((len(chosen), 1)), headings.off_rad[chosen], sigma_rad)
    return misfit


@dataclass(frozen=True)
class Seen:
    """The positions in the time of the knots, against where the state has the antenna.

    Attributes:
        inside: (m,) which of all positions they are.
        knot: (k,) the knot before each.
        share: (k,) of the way to the next knot.
        arm_m: (k, 3) from the vehicle frame's origin to the antenna.
        antenna_m: (k, 3) of the antenna against the local origin.
        residual_m: (k, 3) the position less antenna and drift.
    """

    inside: NDArray[np.bool_]
    knot: NDArray[np.int64]
    share: FloatArray
    arm_m: FloatArray
    antenna_m: FloatArray
    residual_m: FloatArray

    @classmethod
    def of(cls, knots: Knots, state: State, positions: Positions, origin_m: FloatArray, lever_m: FloatArray) -> Seen:
        """Of a state; the arguments are those of :func:`hold`."""
        k, share, inside = knots.at(positions.t_s)
        k, share = k[inside], share[inside]

        def between(values: FloatArray) -> FloatArray:
            return values[k] + share[:, None] * (values[k + 1] - values[k])

        arm = between(state.rotation @ lever_m)
        antenna = between(state.xyz_m) + arm
        residual = positions.xyz_m[inside] - origin_m - antenna - between(state.drift_m)
        return cls(inside, k, share, arm, antenna, residual)


@dataclass(frozen=True)
class Headings:
    """Headings that two antennas show, against those of the state.

    Attributes:
        knot: (k,) the knot before each.
        off_rad: (k,) by which they are further counter-clockwise than the state's.
        sigma_rad: standard deviation of each, taken as independent of the others.
    """

    knot: NDArray[np.int64]
    off_rad: FloatArray
    sigma_rad: float

    @classmethod
    def of(cls, seen: Seen, state: State, positions: Positions) -> Headings:
        """Those of the positions that have one."""
        yaw_rad, t_s = positions.yaw_rad[seen.inside], positions.t_s[seen.inside]
        shown = np.isfinite(yaw_rad)
        k, t_s = seen.knot[shown], t_s[shown]
        off = yaw_rad[shown] - np.arctan2(state.rotation[k, 1, 0], state.rotation[k, 0, 0])
        step_s = float(np.median(np.diff(t_s))) if len(t_s) > 1 else 1.0
        sigma = HEADING_SIGMA * np.sqrt(max(1.0, HEADING_CORRELATION_S / step_s))
        return cls(k, (off + np.pi) % (2 * np.pi) - np.pi, float(sigma))


def _without_repeats(k: NDArray[np.int64]) -> list[NDArray[np.intp]]:
    """Indices of `k`, which does not decrease, in groups without equal values."""
    begins = np.flatnonzero(np.diff(k, prepend=k[:1] - 1) != 0)
    rank = np.arange(len(k)) - np.repeat(begins, np.diff(np.append(begins, len(k))))
    return [np.flatnonzero(rank == r) for r in range(int(rank.max()) + 1)]


def _add_drift(equations: NormalEquations, knots: Knots, state: State, positions: Positions) -> None:
    """The slowly varying error of GNSS: a Gauss-Markov process that begins anew with each run of equal quality."""
    nearest = np.clip(np.searchsorted(positions.t_s, knots.t_s), 0, len(positions.t_s) - 1)
    spread, run = positions.drift_m[nearest], positions.run[nearest]
    linked = knots.linked
    same = linked[run[linked] == run[linked + 1]]
    starts = np.setdiff1d(np.arange(len(knots)), same + 1)
    kept = np.exp(-STEP_S / CORRELATION_S)
    design = np.zeros((len(same), SIZE + 1))
    design[:, 0], design[:, SIZE] = -kept, 1.0
    for axis in range(3):
        drift = state.drift_m[:, axis]
        column = 6 + axis
        equations.add(starts * SIZE + column, np.ones((len(starts), 1)), -drift[starts], spread[starts, axis])
        sigma = spread[same, axis] * np.sqrt(1.0 - kept**2)
        equations.add(same * SIZE + column, design, kept * drift[same] - drift[same + 1], sigma)


def _add_inertia(equations: NormalEquations, knots: Knots, state: State) -> None:
    """Velocities and rates of turn change as slowly as a heavy machine's on soil do."""
    inner = knots.inner
    design = np.zeros((len(inner), 2 * SIZE + 1))
    design[:, 0], design[:, SIZE], design[:, 2 * SIZE] = 1.0, -2.0, 1.0
    change = state.xyz_m[inner + 1] - 2.0 * state.xyz_m[inner] + state.xyz_m[inner - 1]
    turn = np.einsum("kij,kj->ki", state.rotation, turns(np.ascontiguousarray(state.rotation)))
    turned = turn[inner] - turn[inner - 1]
    scale = STEP_S**1.5
    for axis, strength in enumerate((ACCELERATION, ACCELERATION, HEAVE)):
        equations.add((inner - 1) * SIZE + axis, design, -change[:, axis], np.full(len(inner), strength * scale))
    for axis, strength in enumerate((SWAY, SWAY, TURNING)):
        equations.add((inner - 1) * SIZE + 3 + axis, design, -turned[:, axis], np.full(len(inner), strength * scale))


def _add_wheels(equations: NormalEquations, knots: Knots, state: State) -> None:
    """The rear axle does not move sideways."""
    wheels = Wheels.of(knots, state)
    equations.add(knots.linked * SIZE, wheels.design, -wheels.sideways_m, wheels.sigma_m)


@dataclass(frozen=True)
class Wheels:
    """How far the rear axle moves from knot to knot.

    Attributes:
        along_m: (k,) forward.
        sideways_m: (k,) to the left.
        sigma_m: (k,) of the way to the left, which is none.
        design: (k, 15) derivatives of the way to the left by the unknowns from the first knot's position to the second
            one's rotation.
    """

    along_m: FloatArray
    sideways_m: FloatArray
    sigma_m: FloatArray
    design: FloatArray

    @classmethod
    def of(cls, knots: Knots, state: State) -> Wheels:
        """Those of all linked knots."""
        linked = knots.linked
        step = state.xyz_m[linked + 1] - state.xyz_m[linked]
        forward, left = (0.5 * (state.rotation[linked, :, a] + state.rotation[linked + 1, :, a]) for a in range(2))
        way = np.linalg.norm(step, axis=1)
        by_turn = np.cross(left, step)
        design = np.zeros((len(linked), SIZE + 6))
        design[:, :3], design[:, SIZE : SIZE + 3] = -left, left
        design[:, 3:6] = design[:, SIZE + 3 : SIZE + 6] = 0.5 * by_turn
        sigma = np.hypot(SLIP * way * np.sqrt(SLIP_EVERY_S / STEP_S), SLIP_FLOOR_M)
        return cls(np.einsum("ij,ij->i", step, forward), np.einsum("ij,ij->i", step, left), sigma, design)


@dataclass(frozen=True)
class Aslant:
    """An unknown beside those of the knots: the angle by which the vehicle goes to the left of where it looks.

    Its equations are those of the wheels, whose way to the left is then this share of the way forward.

    Attributes:
        link: (knots, 9) the normal matrix between it and the knots' unknowns.
        own: the normal matrix of its own.
        right: its right-hand side.
    """

    link: FloatArray
    own: float
    right: float

    @classmethod
    def of(cls, knots: Knots, state: State) -> Aslant:
        """At a state in which it is zero."""
        wheels, linked = Wheels.of(knots, state), knots.linked
        weighted = wheels.along_m / wheels.sigma_m**2
        link = np.zeros((len(knots), SIZE))
        np.add.at(link, linked, -weighted[:, None] * wheels.design[:, :SIZE])
        np.add.at(link[:, :6], linked + 1, -weighted[:, None] * wheels.design[:, SIZE:])
        return cls(link, float(weighted @ wheels.along_m), float(weighted @ wheels.sideways_m))


def _add_level(equations: NormalEquations, knots: Knots, state: State) -> None:
    """The vehicle is level, roughly: its x and y axes have little height."""
    every = np.arange(len(knots)) * SIZE + 3
    sigma = np.full(len(knots), LEVEL_SIGMA * np.sqrt(LEVEL_CORRELATION_S / STEP_S))
    for axis in range(2):
        along = state.rotation[:, :, axis]
        design = np.column_stack([along[:, 1], -along[:, 0]])
        equations.add(every, design, -along[:, 2], sigma)
