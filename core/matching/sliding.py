"""The equations of a window of knots that slides along in time, and of how all it sees lies in the map.

The window's knots are sought in a local frame in which the ground lies still. How that frame lies in the map is six
unknowns more, a twist, which only the positions know of: they move poses and ground together. Knots that leave are
marginalised (Schur complement; Sibley, Matthies and Sukhatme 2010, Sliding window filter with application to planetary
landing, Journal of Field Robotics 27): what they know goes over to the first two knots that remain and to the twist.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
import scipy.linalg
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from furrowmap.core.estimation.banded import NormalEquations
from furrowmap.core.estimation.knots import STEP_S, Knots, State
from furrowmap.core.matching.coarse import SIZE
from furrowmap.core.matching.equations import Headings, Seen
from furrowmap.core.trajectory.positions import Positions

FloatArray = NDArray[np.float64]

PAIR: Final = 2 * SIZE
"""Unknowns of the two knots that what has left the window says something about."""
WANDER: Final = np.array([0.003, 0.003, 0.002, *np.radians([0.02, 0.02, 0.03])])
"""By how much ground that is added to ground drifts off the map, in metres and radians per square root of a second."""
START_SIGMA: Final = np.array([0.05, 0.05, 0.05, *np.radians([1.5, 1.5, 3.0])])
SHARPEST_M: Final = 2.5
"""Radius of the sharpest turn that wheels make."""
STEERING_LASTS_S: Final = 1.0
STILL_TURN: Final = 1e-5
"""Turn from one knot to the next that a vehicle at a stand may make, in radians."""
WAY_KNOTS: Final = 8
"""The way from knot to knot is taken over so many to either side."""


@dataclass(frozen=True)
class Alignment:
    """How the local frame lies in the map, whose coordinates count from the local origin.

    Attributes:
        rotation: (3, 3) local to map.
        shift_m: (3,) of the local frame's origin.
    """

    rotation: FloatArray
    shift_m: FloatArray

    @property
    def yaw_rad(self) -> float:
        """By how much the local frame is turned in the map, counter-clockwise."""
        return float(np.arctan2(self.rotation[1, 0], self.rotation[0, 0]))

    def to_map(self, local_m: FloatArray) -> FloatArray:
        """(..., 3) in the map."""
        out: FloatArray = local_m @ self.rotation.T + self.shift_m
        return out

    def to_local(self, map_m: FloatArray) -> FloatArray:
        """(..., 3) in the local frame."""
        out: FloatArray = (map_m - self.shift_m) @ self.rotation
        return out

    def moved(self, twist: FloatArray, centre_m: FloatArray) -> Alignment:
        """After a twist (6,), translation and rotation vector, of the local frame about a place in it."""
        turn = Rotation.from_rotvec(twist[3:]).as_matrix()
        return Alignment(self.rotation @ turn, self.shift_m + self.rotation @ (twist[:3] + centre_m - turn @ centre_m))


@dataclass(frozen=True)
class Prior:
    """What is known from what has left the window.

    Attributes:
        state: of the first two knots, about which the rest is stated.
        normal: (24, 24) normal matrix of the two knots and the twist.
        right: (24,) right-hand side.
    """

    state: State
    normal: FloatArray
    right: FloatArray

    @classmethod
    def of_start(cls, state: State) -> Prior:
        """At the start: the twist is roughly known, the knots are not."""
        normal = np.zeros((PAIR + 6, PAIR + 6))
        normal[PAIR:, PAIR:] = np.diag(START_SIGMA**-2)
        return cls(part_of(state, 0, 2), normal, np.zeros(PAIR + 6))

    def at(self, state: State, twist: FloatArray) -> FloatArray:
        """(24,) right-hand side at another state of the two knots and after a twist (6,)."""
        turn = Rotation.from_matrix(state.rotation[:2]) * Rotation.from_matrix(self.state.rotation).inv()
        moved = np.column_stack(
            [state.xyz_m[:2] - self.state.xyz_m, turn.as_rotvec(), state.drift_m[:2] - self.state.drift_m]
        )
        out: FloatArray = self.right - self.normal @ np.concatenate([moved.ravel(), twist])
        return out


@dataclass(frozen=True)
class Bordered:
    """Equations of knots, and of the twist that moves the local frame with all that lies in it.

    Attributes:
        knots: their banded equations.
        border: (knots · 9, 6) between the knots and the twist.
        corner: (6, 6) of the twist.
        right: (6,) of the twist.
    """

    knots: NormalEquations
    border: FloatArray
    corner: FloatArray
    right: FloatArray

    @classmethod
    def of(
        cls,
        held: NormalEquations,
        knots: Knots,
        state: State,
        positions: Positions,
        origin_m: FloatArray,
        lever_m: FloatArray,
        trust: FloatArray,
        centre_m: FloatArray,
    ) -> Bordered:
        """What :func:`~furrowmap.core.matching.equations.hold` says of the knots, and its positions of the twist.

        Args:
            held: of the knots, with the same arguments.
            knots: see `hold`, as the following.
            state: in the local frame.
            positions: in the local frame.
            origin_m: local origin.
            lever_m: (3,).
            trust: (m,).
            centre_m: (3,) place in the local frame about which the twist turns.
        """
        out = cls(held, np.zeros((len(knots) * SIZE, 6)), np.zeros((6, 6)), np.zeros(6))
        seen = Seen.of(knots, state, positions, origin_m, lever_m)
        k = seen.knot
        if not len(k):
            return out
        weight = (trust[seen.inside, None] / positions.white_m[seen.inside] ** 2)[:, :, None]
        whole = np.broadcast_to(np.eye(3), (len(k), 3, 3))
        design = np.concatenate([whole, -cross_matrix(seen.arm_m), whole], axis=2)
        twist = np.concatenate([whole, -cross_matrix(seen.antenna_m - centre_m)], axis=2)
        part = np.einsum("nia,nib->nab", design, weight * twist)
        for i, (a, late) in enumerate(zip((k * SIZE).tolist(), seen.share.tolist(), strict=True)):
            out.border[a : a + SIZE] += (1.0 - late) * part[i]
            out.border[a + SIZE : a + 2 * SIZE] += late * part[i]
        out.corner[:] = np.einsum("nia,nib->ab", twist, weight * twist)
        out.right[:] = np.einsum("nia,ni->a", twist, weight[:, :, 0] * seen.residual_m)
        headings = Headings.of(seen, state, positions)
        sharp = headings.sigma_rad**-2
        np.add.at(out.border[:, 5], headings.knot * SIZE + 5, sharp)
        out.corner[5, 5] += sharp * len(headings.knot)
        out.right[5] += sharp * float(headings.off_rad.sum())
        return out

    def add_prior(self, prior: Prior, state: State, twist: FloatArray) -> None:
        """Add what is known from what has left the window, after a twist (6,) since."""
        right = prior.at(state, twist)
        for j in range(PAIR):
            self.knots.band[: PAIR - j, j] += prior.normal[j:PAIR, j]
        self.knots.right[:PAIR] += right[:PAIR]
        self.border[:PAIR] += prior.normal[:PAIR, PAIR:]
        self.corner[:] += prior.normal[PAIR:, PAIR:]
        self.right[:] += right[PAIR:]

    def without_drift_start(self, state: State, t_s: float, positions: Positions) -> None:
        """Take out what `hold` says about the drift at the first knot of a chain, which is at `t_s`."""
        nearest = min(int(np.searchsorted(positions.t_s, t_s)), len(positions.t_s) - 1)
        weight = 1.0 / positions.drift_m[nearest] ** 2
        self.knots.band[0, 6:9] -= weight
        self.knots.right[6:9] += weight * state.drift_m[0]

    def solve(self, of_knots: FloatArray, of_twist: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """The step of the knots and the twist, and how well something that follows from them is known.

        Args:
            of_knots: (knots · 9, p) derivatives of p quantities by the knots.
            of_twist: (6, p) by the twist.

        Returns:
            (step of the knots, twist (6,), (p, p) covariance of the quantities).

        Raises:
            LinAlgError: if the knots' equations are not positive definite.
        """
        factor = scipy.linalg.cholesky_banded(self.knots.band, lower=True)
        sides = np.column_stack([self.border, self.knots.right, of_knots])
        solved = scipy.linalg.cho_solve_banded((factor, True), sides)
        border, right, quantity = solved[:, :6], solved[:, 6], solved[:, 7:]
        left = self.corner - self.border.T @ border
        twist: FloatArray = np.linalg.solve(left, self.right - self.border.T @ right).astype(np.float64)
        direct = of_twist - border.T @ of_knots
        covariance: FloatArray = of_knots.T @ quantity + direct.T @ np.linalg.solve(left, direct)
        return right - border @ twist, twist, covariance

    def dense(self) -> tuple[FloatArray, FloatArray]:
        """The whole normal matrix, twist last, and right-hand side."""
        n = len(self.border)
        out = np.zeros((n + 6, n + 6))
        out[:n, :n], out[n:, n:] = self.knots.dense(), self.corner
        out[:n, n:], out[n:, :n] = self.border, self.border.T
        return out, np.concatenate([self.knots.right, self.right])


def marginalised(whole: Bordered, rest: Bordered, remaining: State, way_m: FloatArray, elapsed_s: float) -> Prior:
    """What leaving knots know about the two that follow, and about the twist.

    Args:
        whole: of the leaving knots and the two that follow.
        rest: of these two alone, as far as it is part of `whole` too, without a prior.
        remaining: state of the two.
        way_m: (3,) from the place about which the twist turns to that about which it will turn.
        elapsed_s: for which the local frame wanders.
    """
    normal, right = whole.dense()
    inner = len(right) - PAIR - 6
    minus, minus_right = rest.dense()
    normal[inner:-6, inner:-6] -= minus[:-6, :-6]
    right[inner:-6] -= minus_right[:-6]
    left, known = _eliminated(normal, right, inner)
    back = np.eye(PAIR + 6)
    back[PAIR : PAIR + 3, PAIR + 3 :] = cross_matrix(way_m)
    left, known = back.T @ left @ back, back.T @ known
    firm = np.diag(1.0 / (WANDER**2 * elapsed_s))
    # The twist so far is eliminated from equations between it and what it wanders to, which take its place.
    chained = np.zeros((PAIR + 12, PAIR + 12))
    chained[:6, :6], chained[:6, 6:-6], chained[6:-6, :6] = left[PAIR:, PAIR:], left[PAIR:, :PAIR], left[:PAIR, PAIR:]
    chained[6:-6, 6:-6] = left[:PAIR, :PAIR]
    chained[:6, :6] += firm
    chained[:6, -6:], chained[-6:, :6], chained[-6:, -6:] = -firm, -firm, firm
    left, known = _eliminated(chained, np.concatenate([known[PAIR:], known[:PAIR], np.zeros(6)]), 6)
    return Prior(remaining, left, known)


def _eliminated(normal: FloatArray, right: FloatArray, count: int) -> tuple[FloatArray, FloatArray]:
    """Normal equations without their first unknowns (Schur complement)."""
    solved = np.linalg.solve(normal[:count, :count], np.column_stack([normal[:count, count:], right[:count]]))
    link = normal[count:, :count]
    left = normal[count:, count:] - link @ solved[:, :-1]
    return 0.5 * (left + left.T), right[count:] - link @ solved[:, -1]


def part_of(state: State, first: int, last: int) -> State:
    """The state of some of the knots."""
    return State(state.xyz_m[first:last], state.rotation[first:last], state.drift_m[first:last])


def ways_m(state: State) -> FloatArray:
    """(n − 1,) way from each knot to the next, over a short time to either side."""
    n = len(state.xyz_m)
    link = np.arange(n - 1)
    back, ahead = np.maximum(link - WAY_KNOTS, 0), np.minimum(link + WAY_KNOTS + 1, n - 1)
    way: FloatArray = np.hypot(*(state.xyz_m[ahead] - state.xyz_m[back])[:, :2].T) / (ahead - back)
    return way


def add_steering(equations: NormalEquations, knots: Knots, state: State, way_m: FloatArray) -> None:
    """A vehicle on wheels turns no faster than it drives, and keeps its heading at a stand.

    Args:
        equations: of the knots; added to.
        knots: of one chain.
        state: of the knots.
        way_m: (n − 1,) see :func:`ways_m`.
    """
    linked = knots.linked
    forward = state.rotation[:, :2, 0]
    before, after = forward[linked], forward[linked + 1]
    turned = np.arctan2(before[:, 0] * after[:, 1] - before[:, 1] * after[:, 0], np.einsum("ij,ij->i", before, after))
    design = np.zeros((len(linked), SIZE + 1))
    design[:, 0], design[:, SIZE] = -1.0, 1.0
    sigma = np.hypot(way_m / SHARPEST_M * np.sqrt(STEERING_LASTS_S / STEP_S), STILL_TURN)
    equations.add(linked * SIZE + 5, design, -turned, sigma)


def cross_matrix(v: FloatArray) -> FloatArray:
    """(..., 3, 3) matrices of the cross products with vectors (..., 3)."""
    out = np.zeros((*v.shape, 3))
    out[..., 0, 1], out[..., 0, 2], out[..., 1, 2] = -v[..., 2], v[..., 1], -v[..., 0]
    out[..., 1, 0], out[..., 2, 0], out[..., 2, 1] = v[..., 2], -v[..., 1], v[..., 0]
    return out
