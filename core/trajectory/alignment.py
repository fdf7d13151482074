"""Attitude of a vehicle from its own motion: what the IMU integrates against the GNSS positions.

Gravity shows roll and pitch, changes of speed and direction show the heading, or, where those are too weak, a hint
(:mod:`furrowmap.core.trajectory.heading_hints`); neither a magnetometer nor a stand is needed (optimisation-based
alignment; Wu and Pan 2013, IEEE Trans. Aerospace and Electronic Systems 49, 1006-1023, with second differences of
positions instead of velocities).
"""

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from furrowmap.core.adjustment.banded import huber_weight
from furrowmap.core.adjustment.knots import KNOT_STEP_S
from furrowmap.core.adjustment.preintegration import Increments, cross_matrix
from furrowmap.core.runtime.arrays import FloatArray
from furrowmap.core.runtime.kernels import kernel
from furrowmap.core.trajectory.heading_hints import DECISIVE, ChunkMotion, HeadingHint
from furrowmap.core.values.inertial import InertialNoise

HALVES: Final = (40, 80, 160)
"""Knots of half the time over which second differences are taken, a second to four: the first that shows the heading.
The longer ones are of means over half of that time, which hold where positions scatter by more than the motion."""
STRIDE: Final = 8
"""Knots from one second difference to the next."""
CHUNK_KNOTS: Final = 2400
"""Knots that are aligned together: a minute."""
CERTAIN_RAD: Final = np.radians(5.0)
"""Standard deviation of a heading up to which it is a first guess."""
ROUGH_RAD: Final = np.radians(15.0)
"""The same by the longest second differences: the adjustment then tells whether it is known."""
MODEL_SIGMA_M: Final = 0.05
"""Error of a second difference beside the noise of the positions."""
ALIGNMENT_ROUNDS: Final = 8


@dataclass(frozen=True)
class Aligned:
    """Attitude at the begin of a chunk, and the biases in it.

    Attributes:
        rotation: (3, 3) vehicle to map.
        bias: (6,) of rate (rad/s) and force (m/s²).
        covariance: (9, 9) of the rotation vector in the map's axes and of the biases.
        misfit: RMS of the residuals over what is expected of them.
        squares: weighted squares of the residuals of the second differences.
    """

    rotation: FloatArray
    bias: FloatArray
    covariance: FloatArray
    misfit: float
    squares: float


@dataclass(frozen=True)
class Attitudes:
    """First guess of the attitudes at consecutive knots.

    Attributes:
        rotation: (n + 1, 3, 3) vehicle to map.
        bias: (n + 1, 6) of rate and force.
        misfit: largest of all chunks, see :class:`Aligned`.
    """

    rotation: FloatArray
    bias: FloatArray
    misfit: float


def averaged_knots(half: int) -> int:
    """Knots over which ways are averaged before second differences over `half` knots to both sides are taken."""
    return 1 if half == HALVES[0] else half // 2


def moving_mean(values: FloatArray, knots: int) -> FloatArray:
    """(n, k) means over a number of rows around each; nan where a value or a row is missing."""
    if knots == 1:
        return values
    out = np.full_like(values, np.nan)
    before = knots // 2
    out[before : before + len(values) - knots + 1] = np.lib.stride_tricks.sliding_window_view(values, knots, 0).mean(-1)
    return out


def attitudes(
    steps: Increments,
    antenna_m: FloatArray,
    arm_m: FloatArray,
    sigma_m: float,
    noise: InertialNoise,
    gravity: float,
    hint: HeadingHint | None,
    half: int,
) -> Attitudes | None:
    """First guess of the attitudes at consecutive knots; None where the motion does not show the heading.

    Args:
        steps: increments from each of n knots to the next, KNOT_STEP_S later.
        antenna_m: (n + 1, 3) antenna at the knots in metres on the ground, in the map's axes; nan where unknown.
            Means over :func:`averaged_knots`.
        arm_m: (3,) from the IMU to the antenna, in the vehicle's axes.
        sigma_m: of the antenna.
        hint: what shows the heading beside accelerations; None for nothing.
        half: one of HALVES.
    """
    whole = chained(steps.turn)
    n = len(whole)
    rotation = np.empty((n, 3, 3))
    bias = np.empty((n, 6))
    limit_rad = ROUGH_RAD if half == HALVES[-1] else CERTAIN_RAD
    begin = 0
    end = min(CHUNK_KNOTS, n)
    last = None
    misfit = 0.0
    while begin < n:
        motion = ChunkMotion.integrate(steps, whole, begin, end, arm_m)
        observed = _ObservedMotion.observe(motion, antenna_m, sigma_m, noise, gravity, hint, half)
        aligned = _aligned(motion, observed, noise, last)
        if last is None and (aligned is None or aligned.covariance[2, 2] > limit_rad**2):
            if end == n:
                return None
            end = min(2 * end, n)
            continue
        assert aligned is not None
        drift = Rotation.from_rotvec(-motion.swept_s @ aligned.bias[:3]).as_matrix()
        rotation[begin:end] = aligned.rotation @ drift @ motion.turned
        bias[begin:end] = aligned.bias
        length_s = len(motion.turned) * KNOT_STEP_S
        lead = np.eye(9)
        lead[:3, 3:6] = -aligned.rotation @ motion.swept_s[-1]
        spread = np.repeat([noise.rate**2, noise.rate_walk**2, noise.force_walk**2], 3) * length_s
        spread[:3] += np.radians(0.5) ** 2
        last = rotation[end - 1], aligned.bias, lead @ aligned.covariance @ lead.T + np.diag(spread)
        misfit = max(misfit, aligned.misfit)
        begin = end
        end = min(end + CHUNK_KNOTS, n)
    return Attitudes(rotation, bias, misfit)


@dataclass(frozen=True)
class _ObservedMotion:
    """Second differences (m, 3) of the antenna without gravity, about knots (m,) of a chunk, and a heading hint."""

    middle: NDArray[np.intp]
    seen: FloatArray
    weight: float
    hint: HeadingHint | None
    half: int

    @classmethod
    def observe(
        cls,
        motion: ChunkMotion,
        antenna_m: FloatArray,
        sigma_m: float,
        noise: InertialNoise,
        gravity: float,
        hint: HeadingHint | None,
        half: int,
    ) -> "_ObservedMotion":
        """Of an antenna (n, 3) at the knots of the whole chain."""
        beside = half + averaged_knots(half) // 2
        middle = np.arange(beside, len(motion.turned) - beside, STRIDE)
        seen = _second_difference(antenna_m[motion.begin : motion.begin + len(motion.turned)], middle, half)
        half_s = half * KNOT_STEP_S
        seen[:, 2] += gravity * half_s**2
        known = np.isfinite(seen).all(axis=1)
        # Of white noise of the force, and of the tilt that white noise of the rate integrates to.
        of_imu = noise.force**2 * half_s**3 / 1.5 + (gravity * noise.rate) ** 2 * half_s**5 / 10.0
        weight = STRIDE / (2 * half) / (6.0 * sigma_m**2 + MODEL_SIGMA_M**2 + of_imu)  # differences overlap
        return cls(middle[known], seen[known], weight, hint, half)

    def own(self, motion: ChunkMotion) -> FloatArray:
        """(m, 3) second differences by the IMU."""
        return _second_difference(moving_mean(motion.way_m, averaged_knots(self.half)), self.middle, self.half)


def _aligned(
    motion: ChunkMotion,
    observed: _ObservedMotion,
    noise: InertialNoise,
    prior: tuple[FloatArray, FloatArray, FloatArray] | None,
) -> Aligned | None:
    """The attitude at the begin of a chunk and the biases that fit what is observed best; None if a hint shows none.

    `prior` is rotation, bias and covariance by the chunk before. Of opposite headings that a hint leaves, the first
    one is taken unless accelerations speak clearly for the other.
    """
    if prior is not None:
        rotation, bias, covariance = prior
        known = np.asarray(np.linalg.inv(covariance), np.float64)
        return _fitted(motion, observed, rotation, bias, known)
    information = np.diag(np.concatenate([np.zeros(3), 1.0 / np.repeat([noise.rate_bias, noise.force_bias], 3) ** 2]))
    own = observed.own(motion)
    # The rotation that turns vectors `own` onto those seen best (Markley 1988, J. Astronaut. Sci. 36).
    left, _, right = np.linalg.svd(observed.seen.T @ own)
    start = left @ np.diag([1.0, 1.0, np.linalg.det(left @ right)]) @ right
    starts = [start] if observed.hint is None else observed.hint.starts(start, motion)
    found = [_fitted(motion, observed, rotation, np.zeros(6), information) for rotation in starts]
    if len(found) == 2 and found[1].squares < found[0].squares - DECISIVE:
        return found[1]
    return found[0] if found else None


def _fitted(
    motion: ChunkMotion, observed: _ObservedMotion, first: FloatArray, start: FloatArray, information: FloatArray
) -> Aligned:
    """Gauss-Newton rounds from an attitude (3, 3) and biases (6,) of an information (9, 9), zero where unknown."""
    middle = observed.middle
    seen = observed.seen
    weight = observed.weight
    own = observed.own(motion)
    sweep = motion.swept_s[middle]
    push = motion.turned[middle] * (observed.half * KNOT_STEP_S) ** 2
    normal = information
    squares = 0.0
    rotation = first
    bias = start
    unit = weight * (2 * observed.half) / STRIDE
    robust = np.ones(len(seen))
    for _ in range(ALIGNMENT_ROUNDS):
        body = own + cross_matrix(own) @ sweep @ bias[:3] - push @ bias[3:]
        computed = body @ rotation.T
        design = np.concatenate(
            [-cross_matrix(computed), rotation @ cross_matrix(own) @ sweep, -rotation @ push], axis=2
        )
        off = Rotation.from_matrix(first @ rotation.T).as_rotvec()
        normal = information + weight * np.einsum("k,kai,kaj->ij", robust, design, design)
        right = weight * np.einsum("k,kai,ka->i", robust, design, seen - computed)
        right += information @ np.concatenate([off, start - bias])
        if observed.hint is not None:
            rows = observed.hint.rows(rotation, bias, motion)
            normal = normal + np.einsum("k,ki,kj->ij", rows.weight, rows.design, rows.design)
            right += (rows.weight * rows.residual) @ rows.design
        normal[np.diag_indices(9)] += 1e-12
        own_squares = ((seen - computed) ** 2).sum(axis=1)
        squares = float(robust @ own_squares)
        # Where all of it fits badly, nothing stands out. A short last chunk has no second differences.
        normalised = np.sqrt(unit * own_squares / 3.0)
        robust = huber_weight(normalised / max(1.0, float(np.median(normalised)) if len(seen) else 0.0))
        step = np.linalg.solve(normal, right)
        rotation = Rotation.from_rotvec(step[:3]).as_matrix() @ rotation
        bias = bias + step[3:]
    misfit = float(np.sqrt(squares / max(seen.size, 1) * unit))
    covariance = np.asarray(np.linalg.inv(normal), np.float64)
    return Aligned(rotation, bias, covariance, misfit, weight * squares)


def _second_difference(values: FloatArray, middle: NDArray[np.intp], half: int) -> FloatArray:
    out: FloatArray = values[middle + half] - 2.0 * values[middle] + values[middle - half]
    return out


@kernel()
def chained(turn):  # type: ignore[no-untyped-def]
    """(n + 1, 3, 3) rotations from each knot's axes to the first one's."""
    out = np.empty((len(turn) + 1, 3, 3))
    out[0] = np.eye(3)
    for k in range(len(turn)):
        out[k + 1] = out[k] @ turn[k]
    return out
