"""An IMU on a machine whose scanner sees the ground: turns between knots, and attitudes at some times.

Ground and walls place such a machine better than accelerometers do, and poses need no velocity among their states.
What the IMU adds are turns, which hold where the ground is smooth, and the direction of gravity. Its mounting need not
be exact: its own rotation against the vehicle, and the scale of its gyroscopes, are states.
"""

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from furrowmap.core.adjustment.banded import NormalEquations
from furrowmap.core.adjustment.knots import (
    GNSS_DRIFT,
    KNOT_STEP_S,
    POSE,
    ROTATION,
    Knots,
    Observation,
    State,
    StateBlock,
    StateLayout,
)
from furrowmap.core.adjustment.position_observations import without_repeats
from furrowmap.core.adjustment.preintegration import RATE_BIAS, Site, add_walk, cross_matrix, increments
from furrowmap.core.runtime import arrays
from furrowmap.core.runtime.arrays import FloatArray
from furrowmap.core.values.inertial import InertialNoise, InertialTrack
from furrowmap.core.values.trajectory import Trajectory

IntArray = NDArray[np.intp]

MISALIGNMENT: Final = StateBlock("imu_misalignment_rad", 3)
"""Rotation vector about the vehicle's axes, from the stated mounting of the IMU to the true one."""
GYRO_SCALE: Final = StateBlock("gyro_scale", 1)
"""Share by which the gyroscopes measure too much."""
AIDED: Final = StateLayout((GNSS_DRIFT, RATE_BIAS, MISALIGNMENT, GYRO_SCALE))
"""Of a vehicle with GNSS, LiDAR and an IMU."""
MISALIGNMENT_SIGMA: Final = np.radians(1.0)
SCALE_SIGMA: Final = 0.01
"""What a mounting stated by hand and an uncalibrated gyroscope may be off."""
CONSTANT_WALK: Final = 1e-5
"""Random walk of what does not change, per square root of a second: less would spoil the condition of the equations."""
MAX_IMU_PAUSE_S: Final = 0.2
"""Where the IMU pauses for longer, it says nothing of the turn."""


@dataclass(frozen=True)
class Gyroscopes(Observation):
    """Rotation from each knot to the next, with bias, misalignment and scale of the gyroscopes.

    Attributes:
        t_s: (m,) knots after which a turn was measured, increasing.
        turn_rad: (m, 3) rotation vectors to the next knot, in the vehicle's axes by the stated mounting.
    """

    t_s: FloatArray
    turn_rad: FloatArray
    noise: InertialNoise
    site: Site

    @classmethod
    def from_track(cls, track: InertialTrack, noise: InertialNoise, site: Site, knots: Knots) -> "Gyroscopes":
        """The turns between knots that the measurements `track`, in the axes of the vehicle, cover."""
        begin_s = knots.t_s[knots.linked]
        after = np.searchsorted(track.t_s, begin_s, side="right")
        last = np.searchsorted(track.t_s, begin_s + KNOT_STEP_S)
        covered = (after > 0) & (last < len(track))
        gap_s = np.concatenate([[np.inf], np.diff(track.t_s), [np.inf]])
        widest_s = np.maximum(gap_s[after], gap_s[np.minimum(last, len(track))])
        begin_s = begin_s[covered & (widest_s <= MAX_IMU_PAUSE_S)]
        steps = increments(track.t_s, track.rate_radps, track.force_mps2, begin_s, begin_s + KNOT_STEP_S)
        return cls(begin_s, Rotation.from_matrix(steps.turn).as_rotvec(), noise, site)

    def add(self, equations: NormalEquations, knots: Knots, state: State) -> None:
        """Three equations for each measured turn, and what is known of bias, misalignment and scale."""
        linked = knots.linked
        for part in arrays.parts(len(linked)):
            self._add_turns(equations, knots, state, linked[part])
        add_walk(equations, knots, state, RATE_BIAS, self.noise.rate_walk, self.noise.rate_bias)
        add_walk(equations, knots, state, MISALIGNMENT, CONSTANT_WALK, MISALIGNMENT_SIGMA)
        add_walk(equations, knots, state, GYRO_SCALE, CONSTANT_WALK, SCALE_SIGMA)

    def _add_turns(self, equations: NormalEquations, knots: Knots, state: State, linked: NDArray[np.int64]) -> None:
        """Three equations for each measured turn from one of the knots (k,) to the next."""
        size = state.layout.size
        nearest = np.clip(np.searchsorted(self.t_s, knots.t_s[linked] - 0.5 * KNOT_STEP_S), 0, len(self.t_s) - 1)
        measured = np.abs(self.t_s[nearest] - knots.t_s[linked]) < 0.1 * KNOT_STEP_S
        linked = linked[measured]
        turn = self.turn_rad[nearest[measured]]
        bias = state[RATE_BIAS][linked]
        tilt = state[MISALIGNMENT][linked]
        scale = state[GYRO_SCALE][linked]
        true = turn - KNOT_STEP_S * bias + np.cross(tilt, turn) - scale * turn
        here = state.rotation[linked]
        earth = Rotation.from_rotvec(-KNOT_STEP_S * self.site.earth_rate_radps).as_matrix()
        computed = earth @ here @ Rotation.from_rotvec(true).as_matrix()
        residual = Rotation.from_matrix(state.rotation[linked + 1] @ computed.transpose(0, 2, 1)).as_rotvec()
        design = np.zeros((len(linked), 3, size + POSE))
        design[:, :, ROTATION:POSE] = -np.eye(3)
        design[:, :, size + ROTATION :] = np.eye(3)
        for block, rows in (
            (RATE_BIAS, KNOT_STEP_S * here),
            (MISALIGNMENT, here @ cross_matrix(turn)),
            (GYRO_SCALE, here @ turn[:, :, None]),
        ):
            first = state.layout.column(block)
            design[:, :, first : first + block.size] = rows
        sigma = np.full(len(linked), self.noise.rate * np.sqrt(KNOT_STEP_S))
        for axis in range(3):
            equations.add(linked * size, design[:, axis], -residual[:, axis], sigma)


@dataclass(frozen=True)
class InertialAttitudes(Observation):
    """Attitudes by GNSS and IMU, at knots so far apart that their errors are independent.

    Attributes:
        rotation: (m, 3, 3) vehicle to map, by the stated mounting of the IMU.
        sigma_rad: (m, 3) about the map's axes; infinite where an axis takes no part.
    """

    t_s: FloatArray
    rotation: FloatArray
    sigma_rad: FloatArray

    @classmethod
    def from_trajectory(cls, trajectory: Trajectory, noise: InertialNoise, knots: Knots) -> "InertialAttitudes":
        """Of a trajectory by GNSS and IMU: roll and pitch often, headings seldom, as gyroscopes lose them."""
        at = np.flatnonzero((knots.t_s >= trajectory.span_s[0]) & (knots.t_s <= trajectory.span_s[1]))
        before, _, inside = trajectory.interval(knots.t_s[at])
        at = at[inside]
        sigma_deg = trajectory.sigma[before[inside], 3:]
        sigma = np.radians(np.column_stack([sigma_deg[:, :2].max(axis=1)] * 2 + [sigma_deg[:, 2]]))
        parts = []
        for first, end in ((0, 2), (2, 3)):
            chosen = _apart(knots.t_s[at], float(np.median(sigma[:, first])), noise) if len(at) else at
            of_axes = np.full((len(chosen), 3), np.inf)
            of_axes[:, first:end] = sigma[chosen, first:end]
            parts.append((chosen, of_axes))
        chosen, of_axes = (np.concatenate(arrays) for arrays in zip(*parts, strict=True))
        order = np.argsort(chosen, kind="stable")
        t_s = knots.t_s[at[chosen[order]]]
        rotation = Rotation.from_quat(trajectory.at(t_s).quaternion, scalar_first=True).as_matrix()
        return cls(t_s, rotation, of_axes[order])

    def add(self, equations: NormalEquations, knots: Knots, state: State) -> None:
        """An equation for each known angle."""
        nearest = np.clip(np.searchsorted(knots.t_s, self.t_s - 0.5 * KNOT_STEP_S), 0, len(knots) - 1)
        inside = np.abs(knots.t_s[nearest] - self.t_s) < 0.1 * KNOT_STEP_S
        k = nearest[inside]
        size = state.layout.size
        tilt = state.layout.column(MISALIGNMENT)
        turned = Rotation.from_rotvec(state[MISALIGNMENT][k]).as_matrix()
        off = Rotation.from_matrix(state.rotation[k] @ turned @ self.rotation[inside].transpose(0, 2, 1)).as_rotvec()
        design = np.zeros((len(k), 3, size))
        design[:, :, ROTATION:POSE] = np.eye(3)
        design[:, :, tilt : tilt + 3] = state.rotation[k]
        sigma = self.sigma_rad[inside]
        for chosen in without_repeats(k):
            for axis in range(3):
                known = chosen[np.isfinite(sigma[chosen, axis])]
                equations.add(k[known] * size, design[known, axis], -off[known, axis], sigma[known, axis])


def _apart(t_s: FloatArray, sigma: float, noise: InertialNoise) -> IntArray:
    """Indices of times so far apart that gyroscopes alone lose an angle of this standard deviation in between."""
    period_s = np.geomspace(0.1, 1e5, 200)
    lost = noise.rate**2 * period_s + noise.rate_walk**2 * period_s**3 / 3.0
    apart_s = 2.0 * float(np.interp(sigma, np.sqrt(lost), period_s))
    count = max(1, int((t_s[-1] - t_s[0]) / apart_s))
    wanted = t_s[0] + (np.arange(count) + 0.5) * (t_s[-1] - t_s[0]) / count
    return np.asarray(np.searchsorted(t_s, wanted), np.intp)


@dataclass(frozen=True)
class Aid:
    """What an IMU adds to the adjustment of a machine on the ground.

    Attributes:
        track: its measurements, in the axes of the vehicle by the stated mounting.
        trajectory: by GNSS and IMU; None where nothing showed the heading.
    """

    track: InertialTrack
    noise: InertialNoise
    site: Site
    trajectory: Trajectory | None

    def observations(self, knots: Knots) -> tuple[Observation, ...]:
        """Those of the turns between knots, and of attitudes at some."""
        turns = Gyroscopes.from_track(self.track, self.noise, self.site, knots)
        if self.trajectory is None:
            return (turns,)
        return (turns, InertialAttitudes.from_trajectory(self.trajectory, self.noise, knots))
