"""The observations of a wheeled vehicle with GNSS, and of one with an IMU, beside what its scanner adds."""

from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import ClassVar, Final

import numpy as np
from numpy.typing import NDArray

from furrowmap.core.adjustment.banded import NormalEquations
from furrowmap.core.adjustment.imu_aiding import CONSTANT_WALK
from furrowmap.core.adjustment.knots import (
    KNOT_STEP_S,
    POSE,
    POSITION_COLUMN,
    ROTATION,
    Knots,
    Observation,
    State,
    StateBlock,
    StateLayout,
    turns,
)
from furrowmap.core.adjustment.position_observations import AntennaHeadings, AntennaPositions, GnssDrift
from furrowmap.core.adjustment.preintegration import INERTIAL, VELOCITY, add_walk
from furrowmap.core.runtime import arrays
from furrowmap.core.runtime.arrays import FloatArray
from furrowmap.core.values.gnss import CREEP_M_RTS, Positions
from furrowmap.core.values.inertial import InertialTrack

ACCELERATION: Final = 0.5
"""Of a tractor over ground, in m/s per square root of a second; heaving is a little less."""
HEAVE: Final = 0.4
SWAY: Final = np.radians(12.0)
"""Of roll and pitch, in rad/s per square root of a second: a quarter of a degree at 1 to 3 Hz has 15°/s^1.5."""
TURNING: Final = np.radians(20.0)
MEASURED_TURN_FACTOR: Final = 10.0
"""By how much the prior of turns is wider where gyroscopes measure them: otherwise it would take their scale for too
large, since less turning is likelier."""
LEVEL_SIGMA: Final = np.radians(3.0)
LEVEL_CORRELATION_S: Final = 20.0
"""Slope of a field, and how long a vehicle stays on the same slope: determines what nothing else does, the roll of a
straight drive."""

STAND_WINDOW_S: Final = 1.0
"""In which scatter is looked at."""
QUIET_SHARES: Final = (0.8, 0.25)
"""Scatter of angular rate and of specific force in a window, as shares of those while positions move, or else of
the whole recording: what drives is shaken by its wheels."""
MOVING_SIGMAS: Final = 5.0
"""How far positions move in three windows of a drive, in standard deviations of their noise."""
MIN_STAND_WINDOWS: Final = 3
"""A stand is at least so many windows."""
STILL_SIGMAS: Final = 3.0
"""How near to their mean positions of a stand are, in standard deviations of their noise, beside CREEP_M_RTS."""
STAND_SIGMA_MPS: Final = 0.02
STAND_CORRELATION_S: Final = 0.5
"""Zero velocity is a new observation after this time."""
SLIP: Final = 0.03
"""Sideways movement of the rear axle as a share of the path length (one standard deviation)."""
MIN_SLIP_SIGMA_M: Final = 0.0005
SLIP_EVERY_S: Final = 0.1
"""Slip is independent from one such interval to the next."""
TRAVEL_YAW: Final = StateBlock("travel_yaw_rad", 1)
"""Direction of travel on a straight way, to the left of the nose: the yaw of an IMU mounted by hand."""
AXLE_BEHIND: Final = StateBlock("axle_behind_m", 1)
"""How far behind the vehicle's origin the point is that does not move sideways in turns."""
ON_WHEELS: Final = StateLayout((*INERTIAL.blocks, TRAVEL_YAW, AXLE_BEHIND))
"""Of a vehicle on wheels with GNSS and an IMU."""
TRAVEL_YAW_SIGMA: Final = float(np.radians(5.0))
UNKNOWN_TRAVEL_YAW: Final = 3.0
"""Such standard deviations of the direction of travel show that the mounting is another than the stated one."""
AXLE_BEHIND_SIGMA_M: Final = 0.5
NOSE_SIDEWAYS_SHARE: Final = 0.05
"""Sideways way as a share of the way beside that: slip, as on a slope."""
AXLE_OFFSET_M: Final = 0.1
"""By how much that point moves."""
SIDEWAYS_CORRELATION_S: Final = 10.0
"""Time over which either stays the same."""
MIN_SIDEWAYS_SIGMA_M: Final = 0.001


@dataclass(frozen=True)
class AlongNose(Observation):
    """Weak observation of no sideways movement from each knot to the next.

    Attributes:
        yaw_sigma_rad: standard deviation of the direction of travel about the nose.
    """

    yaw_sigma_rad: float = TRAVEL_YAW_SIGMA

    def add(self, equations: NormalEquations, knots: Knots, state: State) -> None:
        """One equation for each two knots."""
        linked = knots.linked
        lasting = np.sqrt(SIDEWAYS_CORRELATION_S / KNOT_STEP_S)
        for part in arrays.parts(len(linked)):
            k = linked[part]
            steps = AxleSteps.from_knots(k, state, state[TRAVEL_YAW][k])
            before = state.rotation[k]
            after = state.rotation[k + 1]
            turn = np.einsum("ki,ki->k", after[:, :, 0] - before[:, :, 0], before[:, :, 1])
            sigma = np.hypot(
                lasting * np.hypot(NOSE_SIDEWAYS_SHARE * steps.along_m, AXLE_OFFSET_M * turn), MIN_SIDEWAYS_SIGMA_M
            )
            steps.design[:, state.layout.column(TRAVEL_YAW)] = -steps.along_m
            steps.design[:, state.layout.column(AXLE_BEHIND)] = -turn
            residual = state[AXLE_BEHIND][k, 0] * turn - steps.sideways_m
            equations.add(k * state.layout.size, steps.design, residual, sigma)
        add_walk(equations, knots, state, TRAVEL_YAW, CONSTANT_WALK, self.yaw_sigma_rad)
        add_walk(equations, knots, state, AXLE_BEHIND, CONSTANT_WALK, AXLE_BEHIND_SIGMA_M)


@dataclass(frozen=True)
class WheelMotion(Observation):
    """No sideways movement from each knot to the next, but for slip."""

    def add(self, equations: NormalEquations, knots: Knots, state: State) -> None:
        """One equation for each two knots."""
        linked = knots.linked
        for part in arrays.parts(len(linked)):
            steps = AxleSteps.from_knots(linked[part], state)
            equations.add(linked[part] * state.layout.size, steps.design, -steps.sideways_m, steps.sigma_m)


@dataclass(frozen=True)
class AxleSteps:
    """Movements of the rear axle from each knot to the next.

    Attributes:
        along_m: (k,) forward.
        sideways_m: (k,) to the left.
        sigma_m: (k,) of the slip.
        design: (k, layout.size + 6) derivatives of `sideways_m` by the unknowns from the first knot's position to the
            second one's rotation.
    """

    along_m: FloatArray
    sideways_m: FloatArray
    sigma_m: FloatArray
    design: FloatArray

    @classmethod
    def from_knots(cls, linked: NDArray[np.int64], state: State, yaw_rad: FloatArray | float = 0.0) -> "AxleSteps":
        """Those from the knots (k,) to the next, forward being to the left of the nose by a yaw (k, 1)."""
        size = state.layout.size
        step = state.xyz_m[linked + 1] - state.xyz_m[linked]
        forward, left = (0.5 * (state.rotation[linked, :, a] + state.rotation[linked + 1, :, a]) for a in range(2))
        cos = np.cos(yaw_rad)
        sin = np.sin(yaw_rad)
        forward, left = cos * forward + sin * left, cos * left - sin * forward
        length = np.linalg.norm(step, axis=1)
        design = np.zeros((len(linked), size + POSE))
        design[:, :ROTATION] = -left
        design[:, size : size + ROTATION] = left
        design[:, ROTATION:POSE] = design[:, size + ROTATION :] = 0.5 * np.cross(left, step)
        sigma = np.hypot(SLIP * length * np.sqrt(SLIP_EVERY_S / KNOT_STEP_S), MIN_SLIP_SIGMA_M)
        return cls(np.einsum("ij,ij->i", step, forward), np.einsum("ij,ij->i", step, left), sigma, design)


def _moving(t_s: FloatArray, positions: Positions) -> NDArray[np.bool_]:
    """(n,) whether positions move, by more than they err, in the windows that begin at times (n,)."""
    ends = (t_s - STAND_WINDOW_S, t_s + 2.0 * STAND_WINDOW_S)
    way_m = np.hypot(
        *(np.subtract(*(np.interp(end, positions.t_s, axis) for end in ends)) for axis in positions.xyz_m[:, :2].T)
    )
    noise_m = np.hypot(np.sqrt(2.0) * np.median(positions.white_m[:, 0]), CREEP_M_RTS * np.sqrt(3.0 * STAND_WINDOW_S))
    return np.asarray(way_m > MOVING_SIGMAS * noise_m)


@dataclass(frozen=True)
class Standing(Observation):
    """Zero velocity at the knots of stands."""

    begin_s: FloatArray
    end_s: FloatArray

    @classmethod
    def find(cls, track: InertialTrack, positions: Positions) -> "Standing":
        """Where the IMU is quiet, compared with the rest of the recording, and the positions do not move."""
        cell = ((track.t_s - track.t_s[0]) / STAND_WINDOW_S).astype(np.int64)
        number, first, count = np.unique(cell, return_index=True, return_counts=True)
        moving = _moving(track.t_s[first], positions)
        usual = moving if moving.sum() >= MIN_STAND_WINDOWS else np.ones(len(first), np.bool_)
        quiet = count > 3
        for values, share in zip((track.rate_radps, track.force_mps2), QUIET_SHARES, strict=True):
            mean = np.add.reduceat(values, first) / count[:, None]
            square = np.add.reduceat(values**2, first) / count[:, None]
            scatter = np.sqrt(np.maximum((square - mean**2).sum(axis=1), 0.0))
            quiet &= scatter < share * np.median(scatter[usual])
        starts = []
        ends = []
        k = 0
        while k < len(number):
            stop = k
            while stop < len(number) and quiet[stop] and number[stop] - number[k] == stop - k:
                stop += 1
            if stop - k >= MIN_STAND_WINDOWS:
                begin_s = track.t_s[0] + STAND_WINDOW_S * number[k]
                end_s = begin_s + STAND_WINDOW_S * (stop - k)
                here = (positions.t_s >= begin_s) & (positions.t_s < end_s)
                off = positions.xyz_m[here, :2] - positions.xyz_m[here, :2].mean(axis=0) if here.any() else None
                still_m = np.hypot(STILL_SIGMAS * positions.white_m[here, :2], CREEP_M_RTS * np.sqrt(end_s - begin_s))
                if off is not None and (np.abs(off) < still_m).all():
                    starts.append(begin_s)
                    ends.append(end_s)
            k = max(stop, k + 1)
        return cls(np.array(starts), np.array(ends))

    def rate_bias_radps(self, track: InertialTrack) -> FloatArray:
        """(3,) mean angular rate of an IMU in all stands; zero without any."""
        stand = np.searchsorted(self.begin_s, track.t_s, side="right") - 1
        inside = (stand >= 0) & (track.t_s < np.append(self.end_s, -np.inf)[stand])
        out: FloatArray = track.rate_radps[inside].mean(axis=0) if inside.any() else np.zeros(3)
        return out

    def add(self, equations: NormalEquations, knots: Knots, state: State) -> None:
        """Three equations for each knot of a stand."""
        if not len(self.begin_s):
            return
        stand = np.searchsorted(self.begin_s, knots.t_s, side="right") - 1
        k = np.flatnonzero((stand >= 0) & (knots.t_s < self.end_s[np.maximum(stand, 0)]))
        first = state.layout.column(VELOCITY)
        sigma = np.full(len(k), STAND_SIGMA_MPS * np.sqrt(STAND_CORRELATION_S / KNOT_STEP_S))
        for axis in range(3):
            equations.add(k * state.layout.size + first + axis, np.ones((len(k), 1)), -state[VELOCITY][k, axis], sigma)


@dataclass(frozen=True)
class Level(Observation):
    """The vehicle's x and y axes have little height."""

    def add(self, equations: NormalEquations, knots: Knots, state: State) -> None:
        """Two equations for each knot."""
        for part in arrays.parts(len(knots)):
            first = np.arange(part.start, part.stop) * state.layout.size + ROTATION
            sigma = np.full(len(first), LEVEL_SIGMA * np.sqrt(LEVEL_CORRELATION_S / KNOT_STEP_S))
            for axis in range(2):
                along = state.rotation[part, :, axis]
                equations.add(first, np.column_stack([along[:, 1], -along[:, 0]]), -along[:, 2], sigma)


@dataclass(frozen=True)
class MotionPrior(Observation):
    """Velocities and rates of turn change from one pair of knots to the next as slowly as a heavy machine's on soil.

    Attributes:
        acceleration: (3,) of easting, northing, height, in m/s per √s.
        turning: (3,) of the rotation vector in map axes, in rad/s per √s.
    """

    acceleration: tuple[float, float, float] = (ACCELERATION, ACCELERATION, HEAVE)
    turning: tuple[float, float, float] = (SWAY, SWAY, TURNING)
    linked: ClassVar[int] = 3

    def add(self, equations: NormalEquations, knots: Knots, state: State) -> None:
        """Six equations for each three knots."""
        every = knots.inner
        size = state.layout.size
        row = np.zeros(2 * size + 1)
        row[0] = 1.0
        row[size] = -2.0
        row[2 * size] = 1.0
        for part in arrays.parts(len(every)):
            inner = every[part]
            design = np.broadcast_to(row, (len(inner), len(row)))
            change = state.xyz_m[inner + 1] - 2.0 * state.xyz_m[inner] + state.xyz_m[inner - 1]
            around = slice(int(inner[0]) - 1, int(inner[-1]) + 2)
            rotation = state.rotation[around]
            turn = np.einsum("kij,kj->ki", rotation, turns(np.ascontiguousarray(rotation)))
            turned = turn[inner - around.start] - turn[inner - 1 - around.start]
            for first, values, spread in (
                (POSITION_COLUMN, change, self.acceleration),
                (ROTATION, turned, self.turning),
            ):
                for axis in range(3):
                    sigma = np.full(len(inner), spread[axis] * KNOT_STEP_S**1.5)
                    equations.add((inner - 1) * size + first + axis, design, -values[:, axis], sigma)


def wheeled_vehicle(
    positions: Positions,
    origin_m: NDArray[np.float64],
    lever_m: NDArray[np.float64],
    aiding: tuple[Observation, ...] = (),
) -> tuple[Observation, ...]:
    """Positions and headings of the antennas with their drift, the motion prior, wheels and level, and an IMU's."""
    antenna = AntennaPositions.unweighted(positions, origin_m, lever_m)
    wider = MEASURED_TURN_FACTOR if aiding else 1.0
    motion = MotionPrior(turning=(wider * SWAY, wider * SWAY, wider * TURNING))
    return (antenna, AntennaHeadings(positions), GnssDrift(positions), motion, WheelMotion(), Level(), *aiding)


def with_positions(observations: Iterable[Observation], positions: Positions) -> tuple[Observation, ...]:
    """The observations with other positions of the antenna, each of its whole weight."""

    def changed(one: Observation) -> Observation:
        if isinstance(one, AntennaPositions):
            return AntennaPositions.unweighted(positions, one.origin_m, one.lever_m)
        return replace(one, positions=positions) if isinstance(one, AntennaHeadings | GnssDrift) else one

    return tuple(changed(one) for one in observations)
