"""Input, iterate and result of the adjustment of a session."""

from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from furrowmap.core.adjustment.banded import BandedSolution, NormalEquations
from furrowmap.core.adjustment.coarse import CoarseKnots
from furrowmap.core.adjustment.imu_aiding import AIDED, Aid
from furrowmap.core.adjustment.knots import VEHICLE, Knots, Observation, State, knots_over, start_from
from furrowmap.core.adjustment.position_observations import AntennaPositions, headings_at_stands
from furrowmap.core.adjustment.vehicle import wheeled_vehicle
from furrowmap.core.matching.antenna_sway import AntennaSway, antenna_sway
from furrowmap.core.matching.clock_offset import AntennaConstants, antenna_constants
from furrowmap.core.matching.ground_registration import GroundSums, Relief
from furrowmap.core.matching.height_trend import HeightTrend
from furrowmap.core.matching.mounting_calibration import MountingCalibration
from furrowmap.core.matching.placing import Placing, Sensor, Tool, placing_of
from furrowmap.core.matching.portions import Gap
from furrowmap.core.matching.returns import GroundReturns
from furrowmap.core.matching.session_registration import WallRegistration
from furrowmap.core.matching.yaw_ambiguity import Facing
from furrowmap.core.runtime import arrays
from furrowmap.core.runtime.arrays import FloatArray
from furrowmap.core.runtime.errors import Notice
from furrowmap.core.trajectory.vehicle_motion import longest_gap_s
from furrowmap.core.values.gnss import Positions
from furrowmap.core.values.rotation import Mounting
from furrowmap.core.values.time_span import Span
from furrowmap.core.values.trajectory import Trajectory

MIN_HEADING_SPAN_S: Final = 3.0
"""Positions over a shorter time hardly show a heading, less so in a turn."""
MAX_HEADING_SIGMA_DEG: Final = 8.0
"""With a larger standard deviation a first guess of the heading may be beyond the reach of relief."""


@dataclass(frozen=True)
class Problem:
    """The input.

    Attributes:
        returns: of the ground, and upright ones.
        lever_m: (3,) the antenna in the vehicle frame.
        mounting: of the sensor, as the session states it.
        tool: None where no implement is known.
        knots: at which poses are estimated.
        origin_m: (3,) local origin.
        outages_s: times without positions, see :func:`outages`.
        slow: whether the slow errors of the positions are larger than stated.
        notices: about steps of the positions.
    """

    returns: GroundReturns
    positions: Positions
    lever_m: FloatArray
    mounting: Mounting
    tool: Tool | None
    knots: Knots
    origin_m: FloatArray
    start: State
    observations: tuple[Observation, ...]
    outages_s: tuple[Span, ...]
    slow: bool = False
    notices: tuple[Notice, ...] = ()

    @classmethod
    def from_session(
        cls,
        returns: GroundReturns,
        trajectory: Trajectory,
        positions: Positions,
        lever_m: tuple[float, float, float],
        mounting: Mounting,
        tool: Tool | None,
        aid: Aid | None = None,
    ) -> "Problem":
        """Of a wheeled vehicle with GNSS, whose trajectory is the first guess, and perhaps an IMU."""
        knots = knots_over(returns.t_s)
        lever = np.asarray(lever_m, np.float64)
        origin = np.round(np.median(trajectory.xyz_m, axis=0))
        start = start_from(trajectory, knots, origin, VEHICLE if aid is None else AIDED)
        aiding = aid.observations(knots) if aid is not None else ()
        stands = headings_at_stands(trajectory, knots, positions) if aid is None else ()
        observations = (*wheeled_vehicle(positions, origin, lever, aiding), *stands)
        away_s = outages(positions.t_s, trajectory)
        return cls(returns, positions, lever, mounting, tool, knots, origin, start, observations, away_s)

    @property
    def sensor_m(self) -> FloatArray:
        """(3,) the sensor in the vehicle frame."""
        return np.asarray(self.mounting.xyz_m, np.float64)

    @property
    def sensor_axis(self) -> FloatArray:
        """(3,) unit vector along the sensor's axis, upwards, in the vehicle frame."""
        return np.ascontiguousarray(self.mounting.rotation[:, 2])

    @property
    def without_position(self) -> NDArray[np.bool_]:
        """(knots,) those of chains in which there is no position."""
        knot, _, inside = self.knots.at(self.positions.t_s)
        with_position = np.bincount(knot[inside], minlength=len(self.knots)) > 0
        return np.concatenate(
            [np.full(c.count, not with_position[c.first : c.first + c.count].any()) for c in self.knots.chains]
        )


@dataclass(frozen=True)
class Linearised:
    """Equations of a step of the whole session.

    Attributes:
        held: of all knots, references fixed.
        centre_m: see :meth:`CoarseKnots.centres`.
        prior: of the coarse knots, without LiDAR.
        solution: of the coarse knots, references free.
        state: at which they are linearised.
    """

    held: NormalEquations
    coarse: CoarseKnots
    centre_m: FloatArray
    prior: NormalEquations
    solution: BandedSolution
    state: State

    @cached_property
    def covariance(self) -> FloatArray:
        """(count · size, count · size) of the coarse knots with free references; not to be changed."""
        return self.solution.inverse()


@dataclass(frozen=True)
class Iterate:
    """Where the adjustment stands between two steps.

    Attributes:
        return_weight: (n,) uint8 of the returns in the surface. The one array that steps change in place: there may be
            a billion of them, and only rounds with all returns set it.
        sensor: as it is mounted, and its range constants.
        unused: gaps whose scans take no part.
        facing: which way the sensor faces, and whether the scans show it.
        crab_rad: crab angle and its standard deviation.
        calibration: of the mounting; None before the session's rounds.
        relief: reliability of the surface's slopes.
        ground: sums over the ground's returns of the last step; None before the first.
        walls: registration to walls of the last step; None before the first.
        last: equations of the last step of the whole session; None before.
    """

    state: State
    observations: tuple[Observation, ...]
    return_weight: NDArray[np.uint8]
    sensor: Sensor
    unused: tuple[Gap, ...] = ()
    facing: Facing = field(default_factory=lambda: Facing(0.0, shown=False))
    crab_rad: tuple[float, float] = (0.0, np.inf)
    calibration: MountingCalibration | None = None
    relief: Relief = field(default_factory=Relief)
    ground: GroundSums | None = None
    walls: WallRegistration | None = None
    last: Linearised | None = None

    @classmethod
    def first(cls, problem: Problem) -> "Iterate":
        """Where the adjustment begins."""
        weight = arrays.full(len(problem.returns), 255, np.uint8)
        return cls(problem.start, problem.observations, weight, Sensor(problem.sensor_m, np.eye(3)))

    def placing(self, problem: Problem) -> Placing:
        """What places returns by this iterate."""
        p = problem
        return placing_of(p.returns, self.return_weight, self.sensor, p.knots, self.state, self.unused, p.tool)

    def turned(self, turn_deg: FloatArray) -> "Iterate":
        """The sensor turned on the vehicle by roll, pitch and yaw: it stays as it is, the vehicle turns under it."""
        state = self.state
        sensor = self.sensor
        roll, pitch, yaw = turn_deg.tolist()
        turn = Rotation.from_euler("ZYX", [yaw, -pitch, roll], degrees=True).as_matrix()
        rotation = state.rotation @ turn.T
        xyz = state.xyz_m + (state.rotation - rotation) @ sensor.xyz_m
        return replace(
            self, state=replace(state, xyz_m=xyz, rotation=rotation), sensor=replace(sensor, turn=turn @ sensor.turn)
        )


@dataclass(frozen=True)
class SlowErrors:
    """What scans show of the slow errors of positions.

    Attributes:
        times: of the stated ones, on the map's axes and in height.
        checked: whether scans would show errors of decimetres on the map. Where they do not show which way the scanner
            faces, what they say of the way is as likely a pattern that moves with the vehicle.
        gain: by how much −2 log likelihood falls with them, also where another cause is assumed.
        trend: the rate at which heights creep.
    """

    times: tuple[float, float] = (1.0, 1.0)
    checked: bool = False
    gain: float = 0.0
    trend: HeightTrend = field(default_factory=HeightTrend)


@dataclass(frozen=True)
class Adjusted:
    """The result.

    Attributes:
        sensor: as it is mounted, and its range constants.
        unbridged: gaps between positions whose scans took no part.
        ground: sums over the ground's returns.
        antenna: positions with their robust weights.
        constants: between antenna and scanner.
        sway: what the sway shows of the antenna.
        slow_errors: of the positions.
    """

    problem: Problem
    state: State
    sensor: Sensor
    unbridged: tuple[Gap, ...]
    facing: Facing
    calibration: MountingCalibration
    relief: Relief
    ground: GroundSums
    walls: WallRegistration
    last: Linearised
    antenna: AntennaPositions
    constants: AntennaConstants
    sway: AntennaSway
    slow_errors: SlowErrors = field(default_factory=SlowErrors)

    @classmethod
    def from_iterate(cls, problem: Problem, it: Iterate) -> "Adjusted":
        """The result where the last stage has left it."""
        assert it.calibration is not None
        assert it.ground is not None
        assert it.walls is not None
        assert it.last is not None
        antenna = next(o for o in it.observations if isinstance(o, AntennaPositions))
        # A wrong lever arm looks like a clock offset, and no antenna stands at the vehicle's origin.
        constants = AntennaConstants()
        sway = AntennaSway()
        if problem.lever_m.any():
            knots = problem.knots
            last = it.last
            constants = antenna_constants(knots, it.state, antenna, last.coarse, last.centre_m, last.solution)
            sway = antenna_sway(knots, it.state, antenna, last.held)
            if not sway.off and sway.refutes(constants.lever_m, constants.lever_sigma_m):
                constants = AntennaConstants(constants.clock_s, constants.clock_sigma_s, constants.clock_gain)
        return cls(
            problem, it.state, it.sensor, it.unused, it.facing, it.calibration, it.relief, it.ground, it.walls,
            it.last, antenna, constants, sway,
        )  # fmt: skip


def outages(t_s: FloatArray, start: Trajectory) -> tuple[Span, ...]:
    """Gaps between positions: from the last one before each to the first one after it.

    What is no longer than :func:`~furrowmap.core.trajectory.vehicle_motion.longest_gap_s` is none. Positions between
    two gaps that hardly show a heading do not part them.

    Args:
        t_s: (m,) times of the positions, which increase.
    """
    longest_s = longest_gap_s(t_s) if len(t_s) > 1 else np.inf
    out: list[Span] = []
    first = 0
    for last in np.flatnonzero(np.diff(t_s) > longest_s).tolist():
        between = float(t_s[first]), float(t_s[last])
        vague = (
            between[1] - between[0] < MIN_HEADING_SPAN_S or heading_sigma_deg(start, between) > MAX_HEADING_SIGMA_DEG
        )
        begin_s = out.pop()[0] if out and vague else between[1]
        out.append((begin_s, float(t_s[last + 1])))
        first = last + 1
    return tuple(out)


def heading_sigma_deg(start: Trajectory, span_s: Span) -> float:
    """The least standard deviation of a heading in a span of time; 0 where they are not known."""
    sigma = start.sigma[:, 5]
    if not np.isfinite(sigma).all():
        return 0.0
    inside = sigma[(start.t_s >= span_s[0]) & (start.t_s <= span_s[1])]
    return float(min(np.interp(span_s, start.t_s, sigma).min(), inside.min(initial=np.inf)))
