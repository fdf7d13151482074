"""From an approximate trajectory to the one that makes the ground agree with itself.

Two stages. In the first, short windows of time are each matched to their own ground, on wide cells: whatever is wrong
over a longer time cannot blur a window, so that a heading off by degrees comes right. In the second, the ground is
that of the whole session, on fine cells: neighbouring passes and turns see the same soil. In either, steps that move
the poses against held ground (:mod:`equations`) alternate with steps that move poses and ground together
(:mod:`coarse`).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from itertools import pairwise
from typing import Final, TypeVar

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import uniform_filter1d
from scipy.spatial.transform import Rotation

from furrowmap.core.adjustment.bridging import (
    AHEAD_S,
    ALIKE_S,
    HOLD_S,
    LEAD_S,
    LOST,
    STEP_IN_S,
    Gap,
    apart,
    continued,
    gaps_between,
    in_gaps,
    joined_in_gap,
    outside,
    part_of,
    with_carried,
)
from furrowmap.core.adjustment.relaxation import Relaxation
from furrowmap.core.calibration.laser_ranges import LaserRanges, LaserSums, laser_sums, shortened
from furrowmap.core.calibration.mounting_calibration import Stance, stance
from furrowmap.core.calibration.yaw_ambiguity import facing_deg
from furrowmap.core.estimation.banded import NormalEquations, Solution
from furrowmap.core.estimation.knots import STEP_S, Chain, Knots, State, knots_over, place, start_from, turns
from furrowmap.core.matching.agreement import CoarseGrid, Patches, Relief, Sums, agree
from furrowmap.core.matching.coarse import SIZE, CoarseKnots, coarse_equations, coarse_pull, fine_step, free_patches
from furrowmap.core.matching.equations import Aslant, Held, add_slices, hold_blind, position_trust
from furrowmap.core.matching.returns import REACH_M, GroundReturns
from furrowmap.core.matching.surface import (
    Passage,
    Surface,
    add_returns,
    empty_surface,
    joined,
    layers,
    passage_of,
    tiles_over,
)
from furrowmap.core.matching.wall_steps import (
    LEAST_UPRIGHT,
    PlacedUpright,
    WallSums,
    wall_columns,
    wall_session,
    wall_windows,
)
from furrowmap.core.matching.walls import WALL_PATCH_M, Scatter, UprightReturns
from furrowmap.core.trajectory.positions import Positions
from furrowmap.core.values.mounting import Mounting
from furrowmap.core.values.trajectory import Trajectory

FloatArray = NDArray[np.float64]
Found = TypeVar("Found")

WINDOW_S: Final = 3.0
WINDOW_CELL_M: Final = 0.3
WINDOW_THIN: Final = 4
"""Windows are matched with every fourth return."""
WALL_WINDOW_THIN: Final = 3
"""What stands is matched in windows with every third return."""
WINDOW_ROUNDS: Final = (2, 14)
"""At least and at most so many rounds of windows; they end when no heading turns by more than TURNED."""
TURNED: Final = np.radians(0.4)
CARRY_CELL_M: Final = 0.2
CARRY_THIN: Final = 2
CARRY_STEPS: Final = 2
"""Cells, how many returns to one, and how many steps, with which poses are carried into a gap between positions."""
SESSION_ROUNDS: Final = ((0.15, 3), (0.1, 2), (0.1, 1))
"""Cells in metres, and how many returns to one that is matched."""
SETTLED: Final = np.radians(0.15)
SETTLING: Final = 5
"""A round in which tilts still move by more than SETTLED (RMS) is repeated, so many times at most: a long chain of
poses, each of which sees little more than its neighbours' ground, comes to rest slowly."""
COARSE_EVERY: Final = 40
"""Knots from one coarse knot to the next: a second."""
COARSE_MOST: Final = 300
"""Coarse knots of a whole session; in a longer one they lie further apart."""
WINDOW_PATCH_M: Final = 1.0
SESSION_PATCH_M: Final = 2.0
BLOCK_S: Final = 20.0
STANCE_THIN: Final = 1
RANGES_ROUND: Final = (0.15, 3)
"""Cells in metres, and how many returns to one, from which the lasers' constants are taken."""
REMOUNTS: Final = 2
"""A mounting that is off is corrected so many times at most, each followed by REMOUNT_ROUNDS as SESSION_ROUNDS."""
REMOUNT_ROUNDS: Final = ((0.1, 2), (0.1, 1))
GUARD_S: Final = 0.3
TOOL_MARGIN_M: Final = 0.15
"""Soil to either side of the implement that moves with it."""
TOOL_CELL_M: Final = 0.1
THREADS: Final = 2
DAMPINGS: Final = (1e-9, 1e-8, 1e-7, 1e-6, 1e-5, 1e-4, 1e-3, 1e-2)
"""Shares of what holds an unknown, or of LEAST_HOLD (per square metre or radian) where that is more."""
LEAST_HOLD: Final = 1.0


@dataclass(frozen=True)
class Tool:
    """The line at which an implement changes the soil.

    Attributes:
        xy_m: its middle in the vehicle frame.
        half_width_m: half of its width.
    """

    xy_m: tuple[float, float]
    half_width_m: float


@dataclass
class Problem:
    """Everything that matching works on, and where it stands.

    Attributes:
        returns: of the ground.
        positions: of the antenna.
        lever_m: (3,) the antenna in the vehicle frame.
        tool: None where no implement is known.
        knots: whose poses are sought.
        origin_m: (3,) local origin.
        state: the poses as they are now.
        withheld: gaps between positions, whose scans take no part as yet.
        trust: (n,) uint8 weights of the returns in the surface, 255 for a whole one; set by rounds that match them all.
        position_trust: (m,) weights of the positions.
        sensor_m: (3,) the sensor in the vehicle frame.
        sensor_axis: (3,) unit vector along its axis, upwards, in the vehicle frame.
        mounting_turn: (3, 3) what the returns are turned by about the sensor, because the mounting is off.
        faces_deg: of that, by how much the scanner faces another way than stated, counter-clockwise; 0 if it does not.
        ranges: the lasers' constants; None before the last round, and where the ground does not show them.
        aslant_rad: by how much the vehicle goes to the left of where it looks, and its standard deviation.
        stance: how the vehicle stands on the ground at the end; None before.
        relief: what the surface's slopes are worth.
        sums: of the ground's returns in the last step; None before the first.
        walls: the same of what stands; None where too little does.
        last: the last equations, for the sigmas; None before those of the whole session.
    """

    returns: GroundReturns
    positions: Positions
    lever_m: FloatArray
    tool: Tool | None
    knots: Knots
    origin_m: FloatArray
    state: State
    trust: NDArray[np.uint8]
    position_trust: FloatArray
    sensor_m: FloatArray
    sensor_axis: FloatArray
    withheld: tuple[Gap, ...] = ()
    mounting_turn: FloatArray = field(default_factory=lambda: np.eye(3))
    faces_deg: float = 0.0
    ranges: LaserRanges | None = None
    aslant_rad: tuple[float, float] = (0.0, np.inf)
    stance: Stance | None = None
    relief: Relief = field(default_factory=Relief)
    sums: Sums | None = None
    walls: WallSums | None = None
    last: Last | None = None

    @property
    def loose(self) -> NDArray[np.bool_]:
        """(knots,) those of chains in which there is no position."""
        knot, _, inside = self.knots.at(self.positions.t_s)
        with_position = np.bincount(knot[inside], minlength=len(self.knots)) > 0
        return np.concatenate(
            [np.full(c.count, not with_position[c.first : c.first + c.count].any()) for c in self.knots.chains]
        )

    @property
    def walls_correlated(self) -> float:
        """How many returns of a wall share an error, by the last step."""
        return (self.walls.scatter if self.walls is not None else Scatter()).correlated


@dataclass(frozen=True)
class Last:
    """Equations at the end of :func:`solve`.

    Attributes:
        held: with the ground held.
        coarse: the coarse knots.
        centre_m: see :meth:`CoarseKnots.centres`.
        together: with the ground free.
        blind: of the coarse knots as well, without what the scans see.
    """

    held: Held
    coarse: CoarseKnots
    centre_m: FloatArray
    together: NormalEquations
    blind: NormalEquations


def problem_of(
    returns: GroundReturns,
    trajectory: Trajectory,
    positions: Positions,
    lever_m: tuple[float, float, float],
    mounting: Mounting,
    tool: Tool | None,
) -> Problem:
    """The problem at its start."""
    knots = knots_over(returns.t_s)
    origin = np.round(np.median(trajectory.xyz_m, axis=0))
    return Problem(
        returns,
        positions,
        np.asarray(lever_m, np.float64),
        tool,
        knots,
        origin,
        start_from(trajectory, knots, origin),
        np.full(len(returns), 255, np.uint8),
        np.ones(len(positions.t_s)),
        np.asarray(mounting.xyz_m, np.float64),
        np.ascontiguousarray(mounting.rotation[:, 2]),
    )


def solve(problem: Problem, progress: Callable[[float], None]) -> None:
    """Bring the problem's state to where ground, GNSS and wheels agree best."""
    least, most = WINDOW_ROUNDS
    steps = 1 + 2 * least + 2 * len(SESSION_ROUNDS)
    done, told = 0, 0.0

    def step_done() -> None:
        nonlocal done, told
        done += 1
        told = max(told, min(1.0, done / steps))
        progress(told)

    def window_rounds() -> None:
        nonlocal steps
        _window_step(problem, None)
        step_done()
        relaxation = Relaxation()
        for number in range(most):
            turned = _window_step(problem, relaxation)
            step_done()
            _window_step(problem, None)
            step_done()
            if number + 1 >= least:
                if turned < TURNED:
                    break
                steps += 2

    _face(problem)
    problem.withheld = gaps_between(problem.positions.t_s, problem.knots)
    if problem.withheld:
        steps += 1 + 2 * least
        window_rounds()
        problem.withheld = _bridge(problem, problem.withheld)
    window_rounds()
    rounds: tuple[tuple[float, int], ...] = SESSION_ROUNDS
    for remount in range(REMOUNTS + 1):
        for cell_m, thin in rounds:
            if thin == 1 and problem.ranges is None:
                problem.ranges = _laser_ranges(problem)
            for repeat in range(SETTLING + 1):
                tilted = _session_step(problem, cell_m, thin, together=True)
                step_done()
                _session_step(problem, cell_m, thin, together=False)
                step_done()
                if tilted < SETTLED or repeat == SETTLING:
                    break
                steps += 2
        problem.stance = _stance(problem)
        turn = problem.stance.turn
        if turn is None or remount == REMOUNTS:
            break
        _remount(problem, turn)
        rounds = REMOUNT_ROUNDS
        steps += 2 * len(rounds)
    progress(1.0)


def _face(problem: Problem) -> None:
    """Turn the scanner to where it faces, if that is another way than stated; the vehicle stays as it is."""
    angle = facing_deg(problem.returns, problem.knots, problem.state, problem.sensor_m)
    if angle is not None:
        problem.faces_deg = angle
        problem.mounting_turn = Rotation.from_euler("z", angle, degrees=True).as_matrix()


def _bridge(problem: Problem, gaps: Sequence[Gap]) -> tuple[Gap, ...]:
    """Take the poses in gaps from both of their ends; returns those in which that fails, whose scans say nothing."""
    lost = []
    for gap in gaps:
        inside = np.flatnonzero(in_gaps(problem.knots.t_s, [gap]))
        meet = int(inside[len(inside) // 2])
        before, after = (_carried(problem, gap, gap.middle_s, forward=forward) for forward in (True, False))
        if apart(before, after)[meet] > 1.0:
            before, after = (
                _carried(problem, gap, end_s, forward=forward)
                for end_s, forward in ((gap.end_s, True), (gap.begin_s, False))
            )
            meet = int(inside[np.argmin(apart(before, after)[inside])])
        if apart(before, after)[meet] > LOST:
            lost.append(gap)
        else:
            problem.state = joined_in_gap(problem.knots, problem.state, gap, before, after, meet)
    return tuple(lost)


def _carried(problem: Problem, gap: Gap, to_s: float, *, forward: bool) -> State:
    """The state with poses carried into a gap from its begin, or from its end, to a time in it and somewhat beyond."""
    p, state = problem, problem.state
    way_s = to_s - gap.begin_s if forward else gap.end_s - to_s
    for number in range(1, int(np.ceil(way_s / STEP_IN_S)) + 2):
        reach_s = number * STEP_IN_S
        if forward:
            begin_s, end_s = gap.begin_s + reach_s - LEAD_S, gap.begin_s + reach_s
            part, knots = part_of(p.knots, gap.chain, begin_s, end_s + AHEAD_S)
            rest = gap.begin_s, end_s - HOLD_S
        else:
            begin_s, end_s = gap.end_s - reach_s, gap.end_s - reach_s + LEAD_S
            part, knots = part_of(p.knots, gap.chain, begin_s - AHEAD_S, end_s)
            rest = begin_s + HOLD_S, gap.end_s
        ends = np.clip((begin_s, end_s), knots.t_s[0], knots.t_s[-1])
        within = slice(*np.searchsorted(p.returns.t_s, ends).tolist())
        positions = with_carried(p.positions, p.knots, state, p.origin_m, p.lever_m, *rest)
        small = replace(
            p,
            returns=p.returns.part(within),
            positions=positions,
            knots=knots,
            withheld=(),
            state=state.part(part),
            trust=p.trust[within].copy(),
            position_trust=np.ones(len(positions.t_s)),
        )
        for _ in range(CARRY_STEPS):
            _session_step(small, CARRY_CELL_M, CARRY_THIN, together=False)
        state = state.put(part, small.state)
    border = (gap.begin_s - ALIKE_S, gap.begin_s) if forward else (gap.end_s, gap.end_s + ALIKE_S)
    return continued(p.knots, p.state, state, *border)


def _laser_ranges(problem: Problem) -> LaserRanges | None:
    """What the lasers measure too long, by the ground as it is now."""
    if len(problem.returns.laser) != len(problem.returns):
        return None
    placing, knots, state = _Placing.of(problem), problem.knots, problem.state
    cell_m, thin = RANGES_ROUND
    blocks = _blocks(problem, thin)
    surface = _session_surface(placing, blocks, cell_m)
    turned = problem.mounting_turn @ problem.sensor_axis
    sensor_m, axis = state.xyz_m + state.rotation @ problem.sensor_m, state.rotation @ turned

    def work(share: Sequence[tuple[int, slice]]) -> LaserSums:
        sums = LaserSums.none()
        for c, part in share:
            placed = placing.returns(c, part)
            k = knots.at(placed.t_s)[0]
            laser = np.array(problem.returns.laser[part])
            sums = sums.plus(laser_sums(placed.xyz_m, placed.layer, placed.half, laser, surface, sensor_m[k], axis[k]))
        return sums

    sums = LaserSums.none()
    for part in _in_threads(work, blocks):
        sums = sums.plus(part)
    return sums.ranges()


def _stance(problem: Problem) -> Stance:
    """How the vehicle stands on the session's ground."""
    placing = _Placing.of(problem)
    cell_m, _ = SESSION_ROUNDS[-1]
    surface = _session_surface(placing, _blocks(problem, STANCE_THIN), cell_m)
    return stance(problem.knots, problem.state, surface, placing.passage, GUARD_S, problem.aslant_rad)


def _remount(problem: Problem, turn: FloatArray) -> None:
    """Turn the sensor on the vehicle; it stays where it is in the map, the vehicle turns under it."""
    rotation = problem.state.rotation @ turn.T
    xyz = problem.state.xyz_m + (problem.state.rotation - rotation) @ problem.sensor_m
    problem.state = State(xyz, rotation, problem.state.drift_m)
    problem.mounting_turn = turn @ problem.mounting_turn


def _window_step(problem: Problem, relaxation: Relaxation | None) -> float:
    """One step with the ground of short windows, which overlap by half; returns the largest turn of a heading.

    With a relaxation poses and ground move together, by a step that it lengthens; without one the ground is held.
    """
    coarse = CoarseKnots.over(problem.knots, COARSE_EVERY, WINDOW_PATCH_M) if relaxation is not None else None
    centre = coarse.centres(problem.knots, problem.state) if coarse is not None else np.zeros((0, 3))
    reach = int(WINDOW_S / (COARSE_EVERY * STEP_S)) + 2
    width = min(reach + 2, len(centre)) * SIZE
    placing = _Placing.of(problem)
    windows = [
        (c, part)
        for c, chain in enumerate(problem.knots.chains)
        for part in _windows(problem.returns.t_s, chain, WINDOW_S, 0.5 * WINDOW_S, WINDOW_THIN, problem.withheld)
    ]

    def work(share: Sequence[tuple[int, slice]]) -> tuple[Sums, NormalEquations]:
        sums = Sums.of(len(problem.knots))
        freed = NormalEquations(len(centre) * SIZE, max(width, 1))
        for c, part in share:
            returns = placing.returns(c, part)
            surface = empty_surface(tiles_over(returns.xyz_m, WINDOW_CELL_M))
            add_returns(surface, returns.xyz_m, returns.layer, returns.half, returns.trust)
            patches = _agree(problem, c, returns, surface, 0.5, sums, coarse)
            if coarse is not None:
                free_patches(freed, [patches], WINDOW_PATCH_M, centre)
        return sums, freed

    with ThreadPoolExecutor(1) as pool:
        beside = pool.submit(lambda: (_hold_blind(problem), _window_walls(problem, placing, coarse)))
        found = _in_threads(work, windows)
        held, walls = beside.result()
    _add_seen(problem, held, [sums for sums, _ in found], walls, together=relaxation is not None)
    if coarse is None or relaxation is None:
        return _move(problem, held, _solved(held.equations, problem.loose).values.reshape(-1, SIZE))
    equations = coarse_equations(held.equations, coarse, centre, problem.state, reach)
    for _, freed in found:
        equations.band[: len(freed.band)] += freed.band
        equations.right += freed.right
    for patches in walls.patches:
        free_patches(equations, patches, WALL_PATCH_M, centre)
    step = _solved(equations, coarse.touched(problem.loose)).values
    step = fine_step(coarse, centre, problem.state, step)
    return _move(problem, held, relaxation.lengthened(step, problem.knots))


def _session_step(problem: Problem, cell_m: float, thin: int, *, together: bool) -> float:
    """One step with the ground of the whole session; returns the RMS of its tilts."""
    every = max(COARSE_EVERY, -(-len(problem.knots) // COARSE_MOST))
    coarse = CoarseKnots.over(problem.knots, every, SESSION_PATCH_M) if together else None
    placing = _Placing.of(problem)
    blocks = _blocks(problem, thin)

    def work(share: Sequence[tuple[int, slice]]) -> tuple[Sums, list[Patches]]:
        sums = Sums.of(len(problem.knots))
        patches = [_agree(problem, c, placing.returns(c, part), surface, 1.0, sums, coarse) for c, part in share]
        return sums, patches

    with ThreadPoolExecutor(1) as pool:
        beside = pool.submit(lambda: (_hold_blind(problem), _session_walls(problem, placing, thin, coarse)))
        surface = _session_surface(placing, blocks, cell_m)
        found = _in_threads(work, blocks)
        held, walls = beside.result()
    centre = coarse.centres(problem.knots, problem.state) if coarse is not None else np.zeros((0, 3))
    blind = coarse_equations(held.equations, coarse, centre, problem.state, 1) if coarse is not None else None
    _add_seen(problem, held, [sums for sums, _ in found], walls, together=together)
    if coarse is None or blind is None:
        if problem.last is not None:
            problem.last = replace(problem.last, held=held)
        step = _solved(held.equations, problem.loose).values.reshape(-1, SIZE)
        _move(problem, held, step)
        return _tilted(step)
    equations = coarse_equations(held.equations, coarse, centre, problem.state, coarse.count)
    free_patches(equations, [p for _, patches in found for p in patches], SESSION_PATCH_M, centre)
    for patches in walls.patches:
        free_patches(equations, patches, WALL_PATCH_M, centre)
    problem.last = Last(held, coarse, centre, equations, blind)
    solution = _solved(equations, coarse.touched(problem.loose))
    problem.aslant_rad = _aslant(problem, coarse, centre, solution)
    step = fine_step(coarse, centre, problem.state, solution.values)
    _move(problem, held, step)
    return _tilted(step)


def _tilted(step: FloatArray) -> float:
    """The RMS of the tilts of a step (n, 9)."""
    return float(np.sqrt(np.mean((step[:, 3:5] ** 2).sum(axis=1))))


def _aslant(problem: Problem, coarse: CoarseKnots, centre_m: FloatArray, solution: Solution) -> tuple[float, float]:
    """By how much the vehicle goes to the left of where it looks, and its standard deviation.

    As one unknown more in the equations of the coarse knots: without it the wheels turn the poses a part of the way.
    """
    aslant = Aslant.of(problem.knots, problem.state)
    link = coarse_pull(coarse, centre_m, problem.state, aslant.link)
    information = float(aslant.own - link @ solution.by(link))
    if information <= 0.0:
        return 0.0, np.inf
    return float((aslant.right - link @ solution.values) / information), float(1.0 / np.sqrt(information))


def _window_walls(problem: Problem, placing: _Placing, coarse: CoarseKnots | None) -> WallSums:
    """What the walls of short windows say, which overlap by half as those of the ground."""
    upright = problem.returns.upright
    windows = [
        (c, part)
        for c, chain in enumerate(problem.knots.chains)
        for part in _windows(upright.t_s, chain, WINDOW_S, 0.5 * WINDOW_S, WALL_WINDOW_THIN, problem.withheld)
        if len(upright) >= LEAST_UPRIGHT
    ]

    def work(share: Sequence[tuple[int, slice]]) -> WallSums:
        return wall_windows(share, placing.upright, problem.knots, problem.state, problem.walls_correlated, 0.5, coarse)

    return _walls_together(problem, _in_threads(work, windows))


def _session_walls(problem: Problem, placing: _Placing, thin: int, coarse: CoarseKnots | None) -> WallSums:
    """What the walls of the whole session say."""
    upright = problem.returns.upright
    blocks = [
        (c, part)
        for c, chain in enumerate(problem.knots.chains)
        for part in _windows(upright.t_s, chain, BLOCK_S, BLOCK_S, thin, problem.withheld)
        if len(upright) >= LEAST_UPRIGHT
    ]
    if not blocks:
        return _walls_together(problem, [])
    walls = wall_columns(blocks, placing.upright, problem.state)

    def work(share: Sequence[tuple[int, slice]]) -> WallSums:
        return wall_session(
            walls, share, placing.upright, problem.knots, problem.state, problem.walls_correlated, coarse
        )

    return _walls_together(problem, _in_threads(work, blocks))


def _walls_together(problem: Problem, parts: Sequence[WallSums]) -> WallSums:
    """What the threads have summed up, which the problem keeps."""
    whole = WallSums(Sums.of(len(problem.knots)))
    for part in parts:
        whole = whole.plus(part)
    problem.walls = whole
    return whole


def _blocks(problem: Problem, thin: int) -> list[tuple[int, slice]]:
    """All returns, or every `thin`-th, in parts that fit into memory, each with the number of its chain."""
    return [
        (c, part)
        for c, chain in enumerate(problem.knots.chains)
        for part in _windows(problem.returns.t_s, chain, BLOCK_S, BLOCK_S, thin, problem.withheld)
    ]


def _session_surface(placing: _Placing, blocks: list[tuple[int, slice]], cell_m: float) -> Surface:
    """The ground of all blocks."""
    path = placing.problem.state.xyz_m[::20, :2]
    ring = np.arange(-REACH_M, REACH_M + 0.1, 2.0)
    aside = np.stack(np.meshgrid(ring, ring), axis=-1).reshape(-1, 2)
    around = (path[:, None] + aside[np.hypot(*aside.T) < REACH_M + 2.0]).reshape(-1, 2)
    tiles = tiles_over(around, cell_m)

    def work(share: Sequence[tuple[int, slice]]) -> Surface:
        surface = empty_surface(tiles)
        for c, part in share:
            returns = placing.returns(c, part)
            add_returns(surface, returns.xyz_m, returns.layer, returns.half, returns.trust)
        return surface

    return joined(_in_threads(work, blocks))


@dataclass(frozen=True)
class _Placed:
    """Returns of a part of a chain, placed."""

    t_s: FloatArray
    xyz_m: FloatArray
    layer: NDArray[np.int8]
    half: NDArray[np.uint8]
    trust: NDArray[np.uint8]


@dataclass(frozen=True)
class _Placing:
    """What placing takes from the state, prepared once a step."""

    problem: Problem
    position_m: FloatArray
    rotation: FloatArray
    turn: FloatArray
    passage: Passage | None

    @classmethod
    def of(cls, problem: Problem) -> _Placing:
        state = problem.state
        rotation = np.ascontiguousarray(state.rotation)
        return cls(problem, np.ascontiguousarray(state.xyz_m), rotation, turns(rotation), _passage(problem))

    def returns(self, chain: int, part: slice) -> _Placed:
        """Returns of the ground."""
        source = self.problem.returns
        t, xyz = self._placed(chain, source, part)
        layer = layers(t, xyz, self.passage, GUARD_S)
        # Of all returns a view, in which :func:`agree` leaves their weights for the next surface; else a copy.
        trust = np.ascontiguousarray(self.problem.trust[part])
        return _Placed(t, xyz, layer, np.array(source.half[part]), trust)

    def upright(self, chain: int, part: slice) -> PlacedUpright:
        """Returns of what stands."""
        source = self.problem.returns.upright
        t, xyz = self._placed(chain, source, part)
        return PlacedUpright(t, xyz, np.array(source.half[part]))

    def _placed(self, chain: int, source: GroundReturns | UprightReturns, part: slice) -> tuple[FloatArray, FloatArray]:
        """Copies of the times, and the places in the map."""
        chained, turn, sensor = self.problem.knots.chains[chain], self.problem.mounting_turn, self.problem.sensor_m
        t, vehicle, ranges = np.array(source.t_s[part]), np.array(source.xyz_m[part]), self.problem.ranges
        if ranges is not None:
            vehicle = shortened(vehicle, source.laser[part], sensor, ranges.offset_m)
        if not np.array_equal(turn, np.eye(3)):
            vehicle = (vehicle @ turn.T + (sensor - turn @ sensor)).astype(np.float32)
        return t, place(t, vehicle, chained.first, chained.begin_s, STEP_S, self.position_m, self.rotation, self.turn)


def _agree(
    problem: Problem,
    c: int,
    returns: _Placed,
    surface: Surface,
    share: float,
    sums: Sums,
    coarse: CoarseKnots | None,
) -> Patches:
    return agree(
        problem.knots.chains[c],
        returns.t_s,
        returns.xyz_m,
        returns.layer,
        returns.half,
        returns.trust,
        surface,
        np.ascontiguousarray(problem.state.xyz_m),
        problem.relief,
        share,
        sums,
        coarse.grids[c] if coarse is not None else CoarseGrid(0, 0, 1.0),
    )


def _passage(problem: Problem) -> Passage | None:
    """When the implement passed over the ground, as the poses have it now."""
    if problem.tool is None:
        return None
    every = slice(None, None, 2)
    rotation = problem.state.rotation[every]
    x, y = problem.tool.xy_m
    middle = problem.state.xyz_m[every, :2] + x * rotation[:, :2, 0] + y * rotation[:, :2, 1]
    return passage_of(
        problem.knots.t_s[every], middle, rotation[:, :2, 1], problem.tool.half_width_m + TOOL_MARGIN_M, TOOL_CELL_M
    )


def _windows(
    t_s: FloatArray, chain: Chain, length_s: float, step_s: float, thin: int, withheld: Sequence[Gap]
) -> list[slice]:
    """Every `thin`-th return of a chain in windows of time; the first begins early, so that all overlap alike."""
    begins = np.arange(chain.begin_s - length_s + step_s, chain.end_s, step_s)
    first = np.searchsorted(t_s, np.maximum(begins, chain.begin_s))
    last = np.searchsorted(t_s, np.minimum(begins + length_s, chain.end_s))
    windows = [slice(int(a), int(b), thin) for a, b in zip(first, last, strict=True) if b > a]
    return outside(windows, t_s, withheld)


def _in_threads(work: Callable[[Sequence[tuple[int, slice]]], Found], items: list[tuple[int, slice]]) -> list[Found]:
    """`work` on even shares of the items, each in a thread; the kernels release the interpreter's lock."""
    cuts = np.linspace(0, len(items), THREADS + 1).astype(int)
    shares = [items[a:b] for a, b in pairwise(cuts.tolist()) if b > a]
    with ThreadPoolExecutor(THREADS) as pool:
        return list(pool.map(work, shares))


def _hold_blind(problem: Problem) -> Held:
    """The equations of all knots without what the scans see."""
    p = problem
    return hold_blind(p.knots, p.state, p.positions, p.origin_m, p.lever_m, p.position_trust)


def _add_seen(problem: Problem, held: Held, parts: Sequence[Sums], walls: WallSums, *, together: bool) -> None:
    """Add to the equations of all knots what the threads have summed up, which the problem keeps."""
    sums = parts[0]
    for other in parts[1:]:
        sums = sums.plus(other)
    problem.sums, problem.relief = sums, sums.relief()
    seen = sums.plus(walls.sums)
    add_slices(held.equations, problem.knots, seen.normal, seen.right_all if together else seen.right)


def _solved(equations: NormalEquations, loose: NDArray[np.bool_]) -> Solution:
    """The solution, damped as little as it takes (Levenberg 1944) where a chain has no positions to hold it.

    Args:
        equations: of knots.
        loose: (knots,) which may be damped; the others are only where that is not enough.

    Raises:
        LinAlgError: if no damping makes the equations definite.
    """
    diagonal = equations.band[0].copy()
    # Of a chain of two or three knots some unknowns have no equation at all, and nothing to take a share of.
    most = np.maximum(diagonal, LEAST_HOLD)
    for damped in (np.repeat(loose, SIZE) * most, most):
        for damping in (0.0, *DAMPINGS):
            equations.band[0] = diagonal + damping * damped
            try:
                return equations.solve()
            except np.linalg.LinAlgError:
                continue
    raise np.linalg.LinAlgError("the poses' equations have no solution")


def _move(problem: Problem, held: Held, step: FloatArray) -> float:
    """Take a step; returns the largest turn of a heading, on the mean of a window, where scans take part."""
    problem.position_trust = position_trust(held.misfit)
    problem.state = problem.state.moved(step)
    turned = np.where(in_gaps(problem.knots.t_s, problem.withheld), 0.0, step[:, 5])
    # Single poses at the ends of a chain, which little holds, turn to and fro for ever.
    over = round(WINDOW_S / STEP_S)
    chains = (slice(c.first, c.first + c.count) for c in problem.knots.chains)
    return max(float(np.abs(uniform_filter1d(turned[chain], over, mode="constant")).max()) for chain in chains)
