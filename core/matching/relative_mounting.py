"""Mounting and clock of a further scanner, by the ground and the walls that the first one sees as well.

The trajectory is that of the first scanner, and so is the map: a height grid before and after the implement's passage,
and pieces of walls. Returns of the further scanner are registered to them as in matching, but all together may only
move by one turn, one shift and one delay of the scanner. What neither ground nor walls show stays as stated, by a prior
as wide as a measuring tape errs.
"""

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from typing import Any, Final, Self

import numpy as np
from scipy.spatial.transform import Rotation

from furrowmap.core.adjustment.knots import KNOT_STEP_S, Knots, knots_over, start_from
from furrowmap.core.adjustment.registered_returns import SliceSums
from furrowmap.core.matching.ground_registration import Relief
from furrowmap.core.matching.height_grid import HeightGrid, heights
from furrowmap.core.matching.laser_ranges import laser_ranges
from furrowmap.core.matching.placing import Placing, Sensor, Tool, placing_of
from furrowmap.core.matching.portions import blocks
from furrowmap.core.matching.returns import GroundReturns, ground_returns
from furrowmap.core.matching.session_match import tool_of
from furrowmap.core.matching.session_registration import (
    MIN_UPRIGHT_RETURNS,
    register_to_surface,
    register_to_walls,
    session_surface,
    session_walls,
)
from furrowmap.core.matching.walls import Scatter
from furrowmap.core.runtime import arrays
from furrowmap.core.runtime.arrays import FloatArray, three
from furrowmap.core.runtime.errors import Notice
from furrowmap.core.values.margins import margin
from furrowmap.core.values.rotation import Mounting
from furrowmap.core.values.scan import LaserRanges, Scan
from furrowmap.core.values.session import Session
from furrowmap.core.values.trajectory import Trajectory

PARAMETER_NAMES: Final = ("roll_deg", "pitch_deg", "yaw_deg", "x_m", "y_m", "z_m", "clock_s")
"""Turn of the scanner about the vehicle's axes, shift along them, and time by which its clock is ahead."""
STATED_SPREAD: Final = np.array([*np.radians([3.0, 3.0, 3.0]), 0.03, 0.03, 0.03, 0.1])
"""Standard deviations of what a session states: angles by eye, places by tape, clocks set by different sources."""
ROUNDS: Final = ((0.3, 3, 4), (0.15, 2, 3), (0.1, 1, 3))
"""Cells in metres, how many returns to one that is registered, and rounds: from wide to fine, as in matching."""
LEVEL_ROUNDS: Final = 4
LEVEL_THIN: Final = 10
"""Before them, roll, pitch and height alone by every LEVEL_THIN-th return, from wherever they are."""
MIN_RETURNS: Final = 5_000
"""Of the ground that both see; with fewer the mounting is not shown."""
BATCH_S: Final = 1.0
"""Registered returns of such a time share their errors."""
SYSTEMATIC: Final = np.array([*np.radians([0.02, 0.02, 0.01]), 0.002, 0.002, 0.002, 1e-4])
"""Standard deviations of what all returns share: lasers' constants that grow evenly with elevation, what clods hide."""
MAX_SIGMA_DEG: Final = 0.2
"""Largest standard deviation of roll and pitch with which the mounting is used."""
RELATIVE_OFF_SIGMAS: Final = 3.0
MIN_RELATIVE_OFF: Final = np.array([0.2, 0.2, 0.2, 0.03, 0.03, 0.03, 0.002])
"""A stated value is contradicted if it is off by more than RELATIVE_OFF_SIGMAS sigmas and by more than this."""


@dataclass(frozen=True)
class FirstScanner:
    """The first scanner, whose scans made the trajectory.

    Attributes:
        returns: in the vehicle frame by its mounting.
        tool: where an implement changes the soil; None if none is known.
    """

    returns: GroundReturns
    mounting: Mounting
    trajectory: Trajectory
    tool: Tool | None

    @classmethod
    def of_scans(cls, scans: Iterable[Scan], mounting: Mounting, trajectory: Trajectory, session: Session) -> Self:
        """By its scans, without errors of its lasers."""
        return cls(ground_returns(scans, mounting, trajectory), mounting, trajectory, tool_of(session))


@dataclass(frozen=True)
class RelativeMounting:
    """A further scanner's mounting and clock against the first one's.

    Attributes:
        mounting: to use: as ground and walls show it, or as stated where they do not.
        ranges: its lasers' constants; None where the ground does not show them.
        correction: (7,) from what is stated, in the order of PARAMETER_NAMES.
        sigma: (7,) standard deviations; as wide as before where nothing shows a parameter.
        scatter_m: RMS of what its returns are off the first scanner's ground, as stated and as found.
        returns: registered to the ground.
        used: whether roll and pitch are known well enough to be used, and all else with them.
    """

    mounting: Mounting
    ranges: LaserRanges | None
    correction: FloatArray
    sigma: FloatArray
    scatter_m: tuple[float, float]
    returns: int
    used: bool

    @property
    def clock_used_s(self) -> float:
        """Time by which its clock is ahead beyond what the session states, where that is corrected."""
        return float(self.correction[-1]) if self.used else 0.0

    @property
    def off(self) -> tuple[str, ...]:
        """Names of the parameters whose stated value is contradicted."""
        if not self.used:
            return ()
        off = np.abs(self.correction) > np.maximum(RELATIVE_OFF_SIGMAS * self.sigma, MIN_RELATIVE_OFF)
        return tuple(np.array(PARAMETER_NAMES)[off].tolist())

    @property
    def words(self) -> tuple[str, str]:
        """Its angles, and their margins about the vehicle's axes, for people."""
        angles = ", ".join(f"{angle:.2f}°" for angle in self.mounting.rpy_deg)
        return angles, ", ".join(margin(sigma, "°") for sigma in self.sigma[:3].tolist())

    def plain(self) -> dict[str, Any]:
        """For `report.json`."""
        known = zip(PARAMETER_NAMES, self.correction.tolist(), self.sigma.tolist(), strict=True)
        return {
            "rpy_deg": [round(angle, 4) for angle in self.mounting.rpy_deg],
            "xyz_m": [round(place, 4) for place in self.mounting.xyz_m],
            "used": self.used,
            "correction": {
                name: {"value": round(value, 6), "sigma": round(sigma, 6) if np.isfinite(sigma) else None}
                for name, value, sigma in known
            },
            "scatter_m": [round(value, 4) for value in self.scatter_m],
            "returns": self.returns,
        }

    def notices(self, stated_s: float) -> Iterator[Notice]:
        """How the scanner is mounted against the first one, where that is not as stated, or not shown.

        Args:
            stated_s: offset of its clock as the session states it.
        """
        if not self.used:
            yield Notice("scanner-mounting-assumed")
            return
        if any(name != "clock_s" for name in self.off):
            yield Notice(
                "scanner-mounting-off",
                angles=", ".join(f"{angle:.2f}" for angle in self.mounting.rpy_deg),
                angle_margins=self.words[1],
                place=", ".join(f"{place:.3f}" for place in self.mounting.xyz_m),
                place_margins=", ".join(margin(sigma, " m") for sigma in self.sigma[3:6].tolist()),
            )
        if "clock_s" in self.off:
            used_s = stated_s + self.clock_used_s
            yield Notice(
                "scanner-mounting-off.by-clock", used_s=used_s, margin=margin(float(self.sigma[6]), " ms", 1e3)
            )


@dataclass(frozen=True)
class _Iterate:
    """Turn (3, 3), shift (3,) and delay of the scanner against what is stated, and its range constants."""

    turn: FloatArray
    shift_m: FloatArray
    clock_s: float
    ranges: LaserRanges | None = None

    @property
    def values(self) -> FloatArray:
        """(7,) radians, metres and seconds."""
        return np.array([*Rotation.from_matrix(self.turn).as_rotvec(), *self.shift_m, self.clock_s])

    def moved(self, step: FloatArray) -> "_Iterate":
        """After a step (7,)."""
        turn = Rotation.from_rotvec(step[:3]).as_matrix() @ self.turn
        return replace(self, turn=turn, shift_m=self.shift_m + step[3:6], clock_s=self.clock_s + float(step[6]))


@dataclass(frozen=True)
class _Further:
    """The further scanner's returns, by its own clock, and what places them."""

    returns: GroundReturns
    knots: Knots
    trajectory: Trajectory
    sensor_m: FloatArray
    tool: Tool | None
    origin_m: FloatArray

    def placing(self, it: _Iterate) -> Placing:
        """By an iterate: the trajectory is shifted rather than the returns, of which there may be very many."""
        late = replace(self.trajectory, t_s=self.trajectory.t_s + it.clock_s)
        state = start_from(late, self.knots, self.origin_m)
        state = replace(state, xyz_m=state.xyz_m + state.rotation @ it.shift_m)
        weight = arrays.full(len(self.returns), 255, np.uint8)
        sensor = Sensor(self.sensor_m, it.turn, it.ranges)
        return placing_of(self.returns, weight, sensor, self.knots, state, (), self.tool)


def relative_mounting(
    first: FirstScanner, scans: Iterable[Scan], stated: Mounting, on_scan: Callable[[Scan], None]
) -> RelativeMounting:
    """The mounting of a further scanner.

    Args:
        scans: of the further scanner, by the clock of the positions as stated.
    """
    trajectory = first.trajectory
    tool = first.tool
    further = ground_returns(scans, stated, trajectory, on_scan)
    infinite = np.full(len(STATED_SPREAD), np.inf)
    unknown = RelativeMounting(stated, None, np.zeros(len(infinite)), infinite, (0.0, 0.0), 0, used=False)
    if min(len(first.returns), len(further)) < MIN_RETURNS:
        return unknown
    origin_m = np.round(np.median(trajectory.xyz_m, axis=0))
    knots = knots_over(first.returns.t_s)
    sensor = Sensor(np.asarray(first.mounting.xyz_m, np.float64), np.eye(3))
    weight = arrays.full(len(first.returns), 255, np.uint8)
    mapped = placing_of(first.returns, weight, sensor, knots, start_from(trajectory, knots, origin_m), (), tool)
    scanner = _Further(
        further, knots_over(further.t_s), trajectory, np.asarray(stated.xyz_m, np.float64), tool, origin_m
    )
    walls = None
    if min(len(first.returns.upright), len(further.upright)) >= MIN_UPRIGHT_RETURNS:
        walls = session_walls(mapped, blocks(first.returns.upright.t_s, knots, 1, ()))
    it = _Iterate(np.eye(3), np.zeros(3), 0.0)
    relief = Relief()
    scatter = Scatter()
    first_m = 0.0
    for cell_m, thin, rounds in ROUNDS:
        surface = session_surface(mapped, blocks(first.returns.t_s, knots, 1, ()), cell_m)
        if it.ranges is None and not it.clock_s:
            it, first_m = _level(scanner, surface, it)
        if thin == 1:
            it = replace(it, ranges=laser_ranges(scanner.placing(it), stated.rotation[:, 2]))
        for _ in range(rounds):
            placing = scanner.placing(it)
            portions = blocks(further.t_s, scanner.knots, thin, ())
            ground = register_to_surface(placing, portions, surface, relief, None)
            upright = blocks(further.upright.t_s, scanner.knots, thin, ()) if walls is not None else []
            wall = register_to_walls(placing, upright, walls, scatter.correlated, None)
            equations = _equations(placing, [ground.sums.slices, wall.observation.sums])
            it, covariance = _solved(equations, it)
            relief = ground.sums.relief()
            scatter = wall.scatter
    count, squares = ground.sums.tally[4:6].tolist()
    if count < MIN_RETURNS:
        return replace(unknown, returns=int(count))
    degrees = np.where(np.arange(len(STATED_SPREAD)) < 3, np.degrees(1.0), 1.0)
    sigma = degrees * np.sqrt(np.diag(covariance))
    used = bool((sigma[:2] < MAX_SIGMA_DEG).all())
    mounting = Mounting.from_rotation(three(scanner.sensor_m + it.shift_m), it.turn @ stated.rotation)
    return RelativeMounting(
        mounting if used else stated,
        it.ranges,
        degrees * it.values,
        sigma,
        (first_m, float(np.sqrt(squares / count))),
        int(count),
        used,
    )


def _level(scanner: _Further, surface: HeightGrid, it: _Iterate) -> tuple[_Iterate, float]:
    """Roll, pitch and height by how returns lie above a surface; also the RMS of that before, without outliers."""
    first_m = np.nan
    for _ in range(LEVEL_ROUNDS):
        placing = scanner.placing(it)
        rows = []
        above = []
        for chain, part in blocks(scanner.returns.t_s, scanner.knots, LEVEL_THIN, ()):
            placed = placing.ground(chain, part)
            x, y, _ = (placing.sensor.corrected(scanner.returns, part) - scanner.sensor_m).T
            rows.append(np.column_stack([y, -x, np.ones(len(x))]))
            above.append(placed.xyz_m[:, 2] - heights(surface, placed.xyz_m, placed.layer))
        design = np.concatenate(rows)
        residual = np.concatenate(above)
        known = np.isfinite(residual)
        if known.sum() < 3:
            break
        design = design[known]
        residual = residual[known]
        reach = 3.0 * np.median(np.abs(residual - np.median(residual)))
        kept = np.abs(residual - np.median(residual)) <= reach
        first_m = first_m if np.isfinite(first_m) else float(np.sqrt(np.mean(residual[kept] ** 2)))
        roll, pitch, up = np.linalg.lstsq(design[kept], -residual[kept], rcond=None)[0]
        it = it.moved(np.array([roll, pitch, 0.0, 0.0, 0.0, up, 0.0]))
    return it, first_m


_Equations = tuple[FloatArray, FloatArray]
"""Normal matrix (7, 7), and right-hand sides (m, 7) of each batch of time."""


def _equations(placing: Placing, sums: list[SliceSums]) -> _Equations:
    """Those of the scanner's turn, shift and delay, from those of the poses between knots.

    A point p of a pose at c moves by T + θ × (p − c). A turn ω of the scanner at s in the vehicle frame, a shift d and
    a delay τ give θ = R ω − Ω τ and T = R (d + s × ω) − V τ, with the speeds V and Ω of the vehicle.
    """
    rotation = placing.state.rotation
    s = placing.sensor.xyz_m
    cross = np.array([[0.0, -s[2], s[1]], [s[2], 0.0, -s[0]], [-s[1], s[0], 0.0]])
    design = np.zeros((len(rotation), 6, len(STATED_SPREAD)))
    design[:, :3, :3] = rotation @ cross
    design[:, :3, 3:6] = rotation
    design[:, 3:, :3] = rotation
    design[:-1, :3, 6] = -np.diff(placing.position_m, axis=0) / KNOT_STEP_S
    design[:, 3:, 6] = -np.einsum("kij,kj->ki", rotation, placing.turn) / KNOT_STEP_S
    upper = np.triu_indices(6)
    whole = np.zeros((len(rotation), 6, 6))
    whole[:, upper[0], upper[1]] = sum(one.normal for one in sums)
    whole += np.triu(whole, 1).transpose(0, 2, 1)
    normal = np.einsum("kia,kij,kjb->ab", design, whole, design)
    right = np.einsum("kia,ki->ka", design, sum(one.right for one in sums))
    batch = ((placing.knots.t_s - placing.knots.t_s[0]) / BATCH_S).astype(np.int64)
    batches = np.zeros((int(batch[-1]) + 1, len(STATED_SPREAD)))
    np.add.at(batches, batch, right)
    return normal, batches


def _solved(equations: _Equations, it: _Iterate) -> tuple[_Iterate, FloatArray]:
    """The next iterate, and the covariance (7, 7) of its values, by the scatter of batches where that is larger."""
    normal, batches = equations
    prior = np.diag(STATED_SPREAD**-2.0)
    inverse = np.linalg.inv(normal + prior)
    step = inverse @ (batches.sum(axis=0) - prior @ it.values)
    # Few batches, of which as many parameters are found, scatter less than their errors.
    active = batches[np.abs(batches).sum(axis=1) > 0.0]
    few = len(active) / max(len(active) - len(STATED_SPREAD), 1)
    scattered = inverse @ (few * np.cov(active.T, ddof=0) * len(active) + prior) @ inverse
    larger = np.sqrt(np.maximum(np.diag(scattered) / np.diag(inverse), 1.0))
    return it.moved(step), inverse * np.outer(larger, larger) + np.diag(SYSTEMATIC**2)
