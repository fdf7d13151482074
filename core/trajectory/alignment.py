"""Attitude of a vehicle from its own motion: what the IMU integrates against the GNSS positions.

Gravity shows roll and pitch, changes of speed and direction show the heading; neither a magnetometer nor a stand is
needed (optimisation-based alignment; Wu and Pan 2013, IEEE Trans. Aerospace and Electronic Systems 49, 1006-1023,
with second differences of positions instead of velocities).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numba
import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from furrowmap.core.estimation.inertial import cross_matrix
from furrowmap.core.estimation.knots import STEP_S
from furrowmap.core.estimation.preintegration import Increments
from furrowmap.core.values.inertial import InertialNoise

FloatArray = NDArray[np.float64]

HALF: Final = 40
"""Knots of half the time over which second differences are taken: a second."""
STRIDE: Final = 8
"""Knots from one second difference to the next."""
CHUNK: Final = 2400
"""Knots that are aligned together: a minute."""
CERTAIN_RAD: Final = np.radians(5.0)
"""Standard deviation of a heading up to which it is a first guess."""
MODEL_M: Final = 0.05
"""Error of a second difference beside the noise of the positions."""
ITERATIONS: Final = 8


@dataclass(frozen=True)
class Aligned:
    """Attitude at the begin of a chunk, and the biases in it.

    Attributes:
        rotation: (3, 3) vehicle to map.
        bias: (6,) of rate (rad/s) and force (m/s²).
        covariance: (9, 9) of the rotation vector in the map's axes and of the biases.
        misfit: RMS of the residuals over what is expected of them.
    """

    rotation: FloatArray
    bias: FloatArray
    covariance: FloatArray
    misfit: float

    @property
    def certain(self) -> bool:
        """Whether the heading is good enough to start from."""
        return bool(self.covariance[2, 2] < CERTAIN_RAD**2)


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


def attitudes(
    steps: Increments, antenna_m: FloatArray, arm_m: FloatArray, sigma_m: float, noise: InertialNoise, gravity: float
) -> Attitudes | None:
    """First guess of the attitudes at consecutive knots; None where the motion does not show the heading.

    Args:
        steps: increments from each of n knots to the next, STEP_S later.
        antenna_m: (n + 1, 3) antenna at the knots in metres on the ground, in the map's axes; nan where unknown.
        arm_m: (3,) from the IMU to the antenna, in the vehicle's axes.
        sigma_m: standard deviation of an antenna's position.
        noise: of the IMU.
        gravity: m/s².
    """
    whole = chained(steps.turn)
    n = len(whole)
    rotation, bias = np.empty((n, 3, 3)), np.empty((n, 6))
    begin, end, last, misfit = 0, min(CHUNK, n), None, 0.0
    while begin < n:
        motion = _Chunk.of(steps, whole, begin, end, arm_m)
        aligned = motion.aligned(antenna_m, sigma_m, noise, gravity, last)
        if last is None and not aligned.certain:
            if end == n:
                return None
            end = min(2 * end, n)
            continue
        rotation[begin:end], bias[begin:end] = motion.rotations(aligned), aligned.bias
        last, misfit = motion.carried(aligned, noise), max(misfit, aligned.misfit)
        begin, end = end, min(end + CHUNK, n)
    return Attitudes(rotation, bias, misfit)


@dataclass(frozen=True)
class _Chunk:
    """Motion by the IMU in the axes of the vehicle at the begin of a chunk.

    Attributes:
        begin: first knot.
        turned: (m, 3, 3) rotation of each knot's axes to the first one's.
        swept_s: (m, 3, 3) integral of it over time: the turn by a constant rate, per rad/s.
        way_m: (m, 3) of the antenna, but for gravity and the velocity at the begin.
    """

    begin: int
    turned: FloatArray
    swept_s: FloatArray
    way_m: FloatArray

    @classmethod
    def of(cls, steps: Increments, whole: FloatArray, begin: int, end: int, arm_m: FloatArray) -> _Chunk:
        """Of the knots from `begin` to before `end`."""
        turned = whole[begin].T @ whole[begin:end]
        swept = np.cumsum(turned, axis=0) * STEP_S
        inner = slice(begin, end - 1)
        pushed = np.einsum("kij,kj->ki", turned[:-1], steps.velocity_mps[inner])
        velocity = np.cumsum(pushed, axis=0) - pushed
        way = np.cumsum(velocity * STEP_S + np.einsum("kij,kj->ki", turned[:-1], steps.way_m[inner]), axis=0)
        return cls(begin, turned, swept, np.concatenate([np.zeros((1, 3)), way]) + turned @ arm_m)

    def aligned(
        self,
        antenna_m: FloatArray,
        sigma_m: float,
        noise: InertialNoise,
        gravity: float,
        prior: tuple[FloatArray, FloatArray, FloatArray] | None,
    ) -> Aligned:
        """The attitude at the begin and the biases that fit the antenna's second differences best.

        `prior` is rotation, bias and covariance by the chunk before.
        """
        middle = np.arange(HALF, len(self.turned) - HALF, STRIDE)
        seen = _second_difference(antenna_m[self.begin : self.begin + len(self.turned)], middle)
        seen[:, 2] += gravity * (HALF * STEP_S) ** 2
        known = np.isfinite(seen).all(axis=1)
        middle, seen = middle[known], seen[known]
        own = _second_difference(self.way_m, middle)
        sweep, push = self.swept_s[middle], self.turned[middle] * (HALF * STEP_S) ** 2
        weight = STRIDE / (2 * HALF) / (6.0 * sigma_m**2 + MODEL_M**2)  # differences overlap
        spread = np.repeat([noise.rate_bias, noise.force_bias], 3)
        if prior is None:
            information = np.diag(np.concatenate([np.zeros(3), 1.0 / spread**2]))
            rotation, bias = _wahba(seen, own), np.zeros(6)
        else:
            rotation, bias, covariance = prior
            information = np.linalg.inv(covariance)
        first, start = rotation, bias
        normal, squares = information, 0.0
        for _ in range(ITERATIONS):
            body = own + cross_matrix(own) @ sweep @ bias[:3] - push @ bias[3:]
            computed = body @ rotation.T
            design = np.concatenate(
                [-cross_matrix(computed), rotation @ cross_matrix(own) @ sweep, -rotation @ push], axis=2
            )
            normal = information + weight * np.einsum("kai,kaj->ij", design, design)
            right = weight * np.einsum("kai,ka->i", design, seen - computed)
            if prior is not None:
                off = Rotation.from_matrix(first @ rotation.T).as_rotvec()
                right = right + information @ np.concatenate([off, start - bias])
            else:
                right = right - information @ np.concatenate([np.zeros(3), bias])
            normal[np.diag_indices(9)] += 1e-12
            squares = float(((seen - computed) ** 2).mean()) if len(seen) else 0.0
            step = np.linalg.solve(normal, right)
            rotation, bias = Rotation.from_rotvec(step[:3]).as_matrix() @ rotation, bias + step[3:]
        misfit = float(np.sqrt(squares / (6.0 * sigma_m**2 + MODEL_M**2)))
        return Aligned(rotation, bias, np.linalg.inv(normal), misfit)

    def rotations(self, aligned: Aligned) -> FloatArray:
        """(m, 3, 3) vehicle to map at the knots."""
        drift = Rotation.from_rotvec(-self.swept_s @ aligned.bias[:3]).as_matrix()
        out: FloatArray = aligned.rotation @ drift @ self.turned
        return out

    def carried(self, aligned: Aligned, noise: InertialNoise) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Rotation, bias and covariance at the begin of the next chunk."""
        length_s = len(self.turned) * STEP_S
        lead = np.eye(9)
        lead[:3, 3:6] = -aligned.rotation @ self.swept_s[-1]
        spread = np.repeat([noise.rate**2, noise.rate_walk**2, noise.force_walk**2], 3) * length_s
        spread[:3] += np.radians(0.5) ** 2
        return self.rotations(aligned)[-1], aligned.bias, lead @ aligned.covariance @ lead.T + np.diag(spread)


def _second_difference(values: FloatArray, middle: NDArray[np.intp]) -> FloatArray:
    out: FloatArray = values[middle + HALF] - 2.0 * values[middle] + values[middle - HALF]
    return out


def _wahba(seen: FloatArray, own: FloatArray) -> FloatArray:
    """The rotation (3, 3) that turns vectors (m, 3) `own` onto `seen` best (Markley 1988, J. Astronaut. Sci. 36)."""
    left, _, right = np.linalg.svd(seen.T @ own)
    out: FloatArray = left @ np.diag([1.0, 1.0, np.linalg.det(left @ right)]) @ right
    return out


@numba.njit(cache=True, nogil=True)
def chained(turn):  # type: ignore[no-untyped-def]
    """(n + 1, 3, 3) rotations from each knot's axes to the first one's."""
    out = np.empty((len(turn) + 1, 3, 3))
    out[0] = np.eye(3)
    for k in range(len(turn)):
        out[k + 1] = out[k] @ turn[k]
    return out
