"""Gauss-Newton steps of the adjustment: iterate → iterate.

Each step registers the returns at the iterate's poses, adds the equations of all observations and moves the poses. With
fixed references all knots move, which settles what is quick; with free references the coarse knots move, and the ground
with them, which settles what is slow.
"""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from typing import Final

import numpy as np
import scipy.linalg
from numpy.typing import NDArray
from scipy.ndimage import uniform_filter1d

from furrowmap.core.adjustment.banded import BandedSolution, NormalEquations
from furrowmap.core.adjustment.coarse import CoarseKnots, coarse_equations, coarse_right, fine_step
from furrowmap.core.adjustment.knots import KNOT_STEP_S, POSE, ROTATION, Knots, State, normal_equations
from furrowmap.core.adjustment.relaxation import Relaxation
from furrowmap.core.adjustment.vehicle import AxleSteps
from furrowmap.core.matching.portions import MATCH_WINDOW_S, blocks, in_gaps
from furrowmap.core.matching.problem import Iterate, Linearised, Problem
from furrowmap.core.matching.session_registration import (
    SESSION_PATCH_M,
    WINDOW_PATCH_M,
    GroundRegistration,
    WallRegistration,
    register_to_surface,
    register_wall_session,
    register_wall_windows,
    register_windows,
    session_surface,
)
from furrowmap.core.matching.walls import Scatter
from furrowmap.core.runtime import arrays
from furrowmap.core.runtime.arrays import FloatArray

COARSE_EVERY: Final = 40
"""Knots from one coarse knot to the next: a second."""
MAX_COARSE: Final = 300
"""Coarse knots of a whole session; in a longer one they lie further apart."""


def window_step(problem: Problem, it: Iterate, relaxation: Relaxation | None, thin: int) -> tuple[Iterate, float]:
    """A step against the ground of short windows, which overlap by half; also returns the largest turn of a heading.

    Every `thin`-th return takes part. With a relaxation references are free, and the step is lengthened by it; without
    one they are fixed.
    """
    knots = problem.knots
    state = it.state
    coarse = CoarseKnots.over(knots, COARSE_EVERY, WINDOW_PATCH_M) if relaxation is not None else None
    centre = coarse.centres(knots, state) if coarse is not None else np.zeros((0, 3))
    reach = int(MATCH_WINDOW_S / (COARSE_EVERY * KNOT_STEP_S)) + 2
    width = min(reach + 2, len(centre)) * state.layout.size
    placing = it.placing(problem)
    correlated = _correlated(it)
    with ThreadPoolExecutor(1) as pool:
        prior = pool.submit(normal_equations, it.observations, knots, state)
        beside = pool.submit(register_wall_windows, placing, correlated, coarse)
        ground = register_windows(placing, it.relief, coarse, centre, width, thin)
        held = prior.result()
        walls = beside.result()
    _add_lidar(problem, it, held, ground, walls)
    if coarse is None or relaxation is None:
        step = _solved(problem, it, held)
    else:
        free = coarse_equations(held, coarse, centre, state, reach)
        _free_references(free, centre, ground, walls)
        solution = _damped(free, coarse.touched(problem.without_position), state)
        step = relaxation.lengthened(fine_step(coarse, centre, state, solution.values), knots)
    # Where scans take part, on the mean of a window: single poses at a chain's ends, little determined, oscillate.
    turned = np.where(in_gaps(knots.t_s, it.unused), 0.0, step[:, ROTATION + 2])
    over = round(MATCH_WINDOW_S / KNOT_STEP_S)
    means = (uniform_filter1d(turned[c.first : c.first + c.count], over, mode="constant") for c in knots.chains)
    return _moved(problem, it, step, ground, walls), max(float(np.abs(mean).max()) for mean in means)


def session_step(problem: Problem, it: Iterate, cell_m: float, thin: int, *, free: bool) -> tuple[Iterate, float]:
    """A step against the ground of the whole session; also returns the RMS of its tilts.

    Args:
        cell_m: of the ground.
        thin: every `thin`-th return takes part.
        free: whether references move with the poses.
    """
    knots = problem.knots
    state = it.state
    every = max(COARSE_EVERY, -(-len(knots) // MAX_COARSE))
    coarse = CoarseKnots.over(knots, every, SESSION_PATCH_M) if free else None
    centre = coarse.centres(knots, state) if coarse is not None else np.zeros((0, 3))

    def without_lidar() -> tuple[NormalEquations, NormalEquations | None]:
        held = normal_equations(it.observations, knots, state)
        return held, coarse_equations(held, coarse, centre, state, 1) if coarse is not None else None

    placing = it.placing(problem)
    portions = blocks(placing.returns.t_s, knots, thin, placing.unused)
    correlated = _correlated(it)
    with ThreadPoolExecutor(1) as pool:
        before = pool.submit(without_lidar)
        beside = pool.submit(register_wall_session, placing, correlated, coarse, thin)
        ground = register_to_surface(placing, portions, session_surface(placing, portions, cell_m), it.relief, coarse)
        held, prior = before.result()
        walls = beside.result()
    if coarse is None or prior is None:
        _add_lidar(problem, it, held, ground, walls)
        step = _solved(problem, it, held)
        last = replace(it.last, held=held) if it.last is not None else None
        return replace(_moved(problem, it, step, ground, walls), last=last), _tilt(step)
    _add_lidar(problem, it, held, ground, walls)
    equations = coarse_equations(held, coarse, centre, state, coarse.count)
    _free_references(equations, centre, ground, walls)
    if problem.slow:
        _let_all_move(equations, prior, centre)
    solution = _damped(equations, coarse.touched(problem.without_position), state)
    last = Linearised(held, coarse, centre, prior, solution, state)
    crab_rad = crab_angle_rad(knots, state, coarse, centre, solution)
    step = fine_step(coarse, centre, state, solution.values)
    return replace(_moved(problem, it, step, ground, walls), last=last, crab_rad=crab_rad), _tilt(step)


def _correlated(it: Iterate) -> float:
    """Returns of a wall that share an error, by the last step."""
    return (it.walls.scatter if it.walls is not None else Scatter()).correlated


def _add_lidar(
    problem: Problem, it: Iterate, equations: NormalEquations, ground: GroundRegistration, walls: WallRegistration
) -> None:
    for registered in (ground, walls):
        registered.observation.add(equations, problem.knots, it.state)


def _free_references(
    equations: NormalEquations, centre_m: FloatArray, ground: GroundRegistration, walls: WallRegistration
) -> None:
    for registered in (ground, walls):
        registered.observation.eliminate_references(equations, centre_m)


def _let_all_move(equations: NormalEquations, prior: NormalEquations, centre_m: FloatArray) -> None:
    """Take out of the equations what LiDAR says of a rigid motion of poses and ground, beside their prior part.

    It says nothing; but slices, straight between knots, and patches share their weight between coarse knots not quite
    alike. A hundred thousandth of it outweighs positions whose slow error may be decimetres, and steps diverge.
    """
    count = len(centre_m)
    size = len(equations.right) // len(centre_m)
    rigid = np.zeros((count, size, POSE))
    rigid[:, :POSE] = np.eye(POSE)
    rigid[:, :ROTATION, ROTATION:] = np.cross(np.eye(3), (centre_m - centre_m.mean(axis=0))[:, None]).transpose(0, 2, 1)
    motion = np.linalg.qr(rigid.reshape(-1, POSE))[0]

    def cost(of: NormalEquations) -> FloatArray:
        return np.column_stack([scipy.linalg.blas.dsbmv(len(of.band) - 1, 1.0, of.band, m, lower=1) for m in motion.T])

    costs = cost(equations) - cost(prior)
    costs -= 0.5 * motion @ (motion.T @ costs)
    for j in range(len(motion)):
        below = slice(j, j + len(equations.band))
        equations.band[: len(motion) - j, j] -= motion[below] @ costs[j] + costs[below] @ motion[j]
    equations.right -= motion @ (motion.T @ (equations.right - prior.right))


def _solved(problem: Problem, it: Iterate, held: NormalEquations) -> FloatArray:
    """The step (n, size) at all knots with fixed references."""
    return _damped(held, problem.without_position, it.state).values.reshape(len(problem.knots), -1)


def _damped(equations: NormalEquations, without_position: NDArray[np.bool_], state: State) -> BandedSolution:
    """The solution; knots of chains without a position are damped first."""
    return equations.solve_damped(np.repeat(without_position, state.layout.size))


def _moved(
    problem: Problem, it: Iterate, step: FloatArray, ground: GroundRegistration, walls: WallRegistration
) -> Iterate:
    """The iterate after a step, with weights and relief by the residuals before it."""
    return replace(
        it,
        state=it.state.moved(step),
        observations=tuple(o.reweighted(problem.knots, it.state) for o in it.observations),
        relief=ground.sums.relief(),
        ground=ground.sums,
        walls=walls.registered(),
    )


def _tilt(step: FloatArray) -> float:
    """The RMS of the tilts of a step (n, size)."""
    return float(np.sqrt(np.mean((step[:, ROTATION : ROTATION + 2] ** 2).sum(axis=1))))


def crab_equations(knots: Knots, state: State) -> tuple[FloatArray, float, float]:
    """Normal equations of the crab angle: by how much the vehicle travels to the left of its x axis; zero in the state.

    They are those of the wheels, whose movement to the left is then this share of the movement forward.

    Returns:
        The normal matrix (knots, size) between it and the knots' unknowns, its own normal matrix and right-hand side.
    """
    every = knots.linked
    size = state.layout.size
    own = 0.0
    right = 0.0
    link = arrays.zeros((len(knots), size))
    for part in arrays.parts(len(every)):
        linked = every[part]
        steps = AxleSteps.from_knots(every[part], state)
        weighted = steps.along_m / steps.sigma_m**2
        np.add.at(link, linked, -weighted[:, None] * steps.design[:, :size])
        np.add.at(link[:, :POSE], linked + 1, -weighted[:, None] * steps.design[:, size:])
        own = own + float(weighted @ steps.along_m)
        right = right + float(weighted @ steps.sideways_m)
    return link, own, right


def crab_angle_rad(
    knots: Knots, state: State, coarse: CoarseKnots, centre_m: FloatArray, solution: BandedSolution
) -> tuple[float, float]:
    """The crab angle and its standard deviation, by the solution of the coarse knots' equations.

    All other unknowns are eliminated (Schur complement): without that the wheels turn the poses part of the way.
    """
    by_knots, own, right = crab_equations(knots, state)
    link = coarse_right(coarse, centre_m, state, by_knots)
    information = float(own - link @ solution.by(link))
    if information <= 0.0:
        return 0.0, np.inf
    return float((right - link @ solution.values) / information), float(1.0 / np.sqrt(information))
