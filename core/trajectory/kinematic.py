"""A wheeled vehicle's path and heading from the positions of one antenna.

The rear axle does not slip sideways: it moves along the vehicle's heading. The antenna stands off the axle, so its own
course is not the heading in a turn. Axle position, heading and the slowly varying error of GNSS are one chain of
unknowns (:class:`~furrowmap.core.adjustment.banded.NormalEquations`), solved by Gauss-Newton over the whole
recording at once; looking back as well as forward is what makes the heading stable in reverse too.
"""

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from furrowmap.core.adjustment.banded import HUBER_SIGMAS, NormalEquations, huber_weight
from furrowmap.core.adjustment.vehicle import SLIP
from furrowmap.core.runtime.arrays import BoolArray, FloatArray
from furrowmap.core.values.gnss import DRIFT_CORRELATION_S

IntArray = NDArray[np.intp]

PATH_SLIP_FLOOR_M: Final = 0.001
ACCELERATION_MPS2: Final = 1.0
YAW_RATE_RADPS: Final = np.radians(200.0)
"""Links headings where nothing else does; weak enough not to shorten turns."""
CURVATURE_RATE: Final = 0.1
"""How fast the steering changes the path's curvature, in 1/(m s): from straight to a circle of 3 m in some seconds."""
CURVATURE_FLOOR_RAD: Final = 0.0005
CLIMB_ACCELERATION_MPS2: Final = 0.15
CLIMB_MPS: Final = 0.05
"""How much a vehicle's height changes in a second across a stop or a turn of direction, where nothing else links it."""
LARGEST_CLIMB_M: Final = 1000.0
STAND_STEP_M: Final = 0.0005
STAND_STEP_RAD: Final = np.radians(0.005)
PATH_ROUNDS: Final = 12
CONVERGED_RAD: Final = 1e-5
POSITION_OUTLIER_SIGMAS: Final = 6.0
"""Standard deviations beyond which a position is counted as one that does not fit. Of normal noise in two axes 1.1 %
are beyond three, and on ploughed ground the antenna sways by up to five of its noise."""
MAX_SCATTER: Final = 3.0
"""Most by which the own scatter of positions widens that limit: on heavy soil antennas sway by two to three times the
stated noise; what scatters more does not fit the vehicle."""
USUAL: Final = 1.1774
"""Median of the distance by normal noise in two axes, in standard deviations of one (Rayleigh's distribution)."""

_STATE_SIZE: Final = 5  # easting, northing, yaw, error in easting, error in northing


@dataclass(frozen=True)
class EpochMeasurements:
    """GNSS measurements at each epoch of a chain, and their standard deviations.

    Attributes:
        en_m: (n, 2) easting and northing; nan at epochs between positions.
        height_m: (n,) nan likewise.
        white_m: (n,) noise from position to position, sway of the antenna included.
        white_h_m: (n,) the same of heights.
        drift_m: (n,) standard deviation of the slowly varying error, each of easting and northing.
        drift_h_m: (n,) the same of heights.
        drift_run: (n,) counts the runs in which the slowly varying error is continuous.
        yaw_rad: (n,) yaw that two antennas showed; nan elsewhere.
        sigma_yaw_rad: of `yaw_rad`.
        lever_m: the antenna in the vehicle frame: x, y, z.
    """

    en_m: FloatArray
    height_m: FloatArray
    white_m: FloatArray
    white_h_m: FloatArray
    drift_m: FloatArray
    drift_h_m: FloatArray
    drift_run: IntArray
    yaw_rad: FloatArray
    sigma_yaw_rad: float
    lever_m: tuple[float, float, float]


@dataclass(frozen=True)
class PathEpochs:
    """The epochs of a chain and how neighbours are linked.

    Attributes:
        t_s: (n,) strictly increasing.
        standing: (n − 1,) the vehicle stands from each epoch to the next.
        gap: (n − 1,) nothing is known in between.
        stretch: (n,) counts the stretches of equal motion; no smoothing reaches from one into another.
    """

    t_s: FloatArray
    standing: BoolArray
    gap: BoolArray
    stretch: IntArray


@dataclass(frozen=True)
class Path:
    """The solution.

    Attributes:
        xyz_m: (n, 3) of the point of the vehicle frame's origin.
        yaw_rad: (n,) about the map's up axis, counter-clockwise from east, without jumps.
        sigma: (n, 4) standard deviations of easting, northing, height in metres and of yaw in radians.
        outlier: (n,) positions that do not fit, see :func:`outliers`.
    """

    xyz_m: FloatArray
    yaw_rad: FloatArray
    sigma: FloatArray
    outlier: BoolArray


def solve_path(
    chain: PathEpochs, antenna: EpochMeasurements, start_en_m: FloatArray, start_yaw_rad: FloatArray
) -> Path:
    """Axle positions, heights and yaw that fit the antenna's positions and a wheeled vehicle.

    Args:
        start_en_m: (n, 2) approximate positions of the antenna at all epochs.
        start_yaw_rad: (n,) approximate yaw, unwrapped; within about 60° suffices.
    """
    n = len(chain.t_s)
    origin = start_en_m[0].copy()
    state = np.zeros((n, _STATE_SIZE))
    state[:, :2] = start_en_m - origin - _turned(start_yaw_rad, antenna.lever_m)
    state[:, 2] = start_yaw_rad
    weight = np.ones(n)
    for _ in range(PATH_ROUNDS):
        equations = NormalEquations(n * _STATE_SIZE, 2 * _STATE_SIZE + 1)
        _add_positions(equations, antenna, state, origin, weight)
        _add_drift(equations, chain, antenna.drift_m, antenna.drift_run, state, first=3, axes=2)
        _add_wheels(equations, chain, state)
        # Within a stretch of motion, velocity and the path's curvature change as slowly as a heavy vehicle's do.
        # Curvature and not yaw rate: a vehicle that drives off with its wheels turned starts to turn at once.
        middle, before, after = _triples(chain)
        span = 0.5 * (before + after)
        design = _second_difference(before, after, _STATE_SIZE)
        for column in range(2):
            value = state[:, column]
            change = (value[middle + 1] - value[middle]) / after - (value[middle] - value[middle - 1]) / before
            equations.add((middle - 1) * _STATE_SIZE + column, design, -change, ACCELERATION_MPS2 * span)

        way = np.hypot(*np.diff(state[:, :2], axis=0).T)
        behind = way[middle - 1]
        ahead = way[middle]
        mean = 0.5 * (behind + ahead) + CURVATURE_FLOOR_RAD
        # turn ahead · way behind = turn behind · way ahead
        a = behind / mean
        b = ahead / mean
        design = np.zeros((len(middle), 2 * _STATE_SIZE + 1))
        design[:, 0] = b
        design[:, _STATE_SIZE] = -a - b
        design[:, 2 * _STATE_SIZE] = a
        turn = np.diff(state[:, 2])
        sigma = CURVATURE_RATE * span * behind * ahead / mean + CURVATURE_FLOOR_RAD
        equations.add((middle - 1) * _STATE_SIZE + 2, design, b * turn[middle - 1] - a * turn[middle], sigma)
        solution = equations.solve()
        step = solution.values.reshape(n, _STATE_SIZE)
        state += step
        residual = _position_residual(antenna, state, origin)
        normed = np.hypot(residual[:, 0], residual[:, 1]) / antenna.white_m
        weight = huber_weight(normed)
        if float(np.abs(step[:, 2]).max()) < CONVERGED_RAD:
            break
    height, sigma_h = _solve_height(chain, antenna)
    spread = solution.sigma().reshape(n, _STATE_SIZE)
    return Path(
        xyz_m=np.column_stack([state[:, :2] + origin, height - antenna.lever_m[2]]),
        yaw_rad=state[:, 2],
        sigma=np.column_stack([spread[:, :2], sigma_h, spread[:, 2]]),
        outlier=outliers(normed),
    )


def outliers(normed: FloatArray) -> BoolArray:
    """Residuals (n,), each over its standard deviation, that stand out from the others; nan is none.

    Where all scatter more than stated, as where a tractor sways on heavy soil, they are judged by their own scatter.
    """
    known = normed[np.isfinite(normed)]
    scatter = float(np.clip(np.median(known) / USUAL, 1.0, MAX_SCATTER)) if len(known) else 1.0
    return np.asarray(np.nan_to_num(normed) > POSITION_OUTLIER_SIGMAS * scatter)


def _turned(yaw_rad: FloatArray, lever_m: tuple[float, float, float]) -> FloatArray:
    """The lever arm's horizontal part in the map frame, (n, 2)."""
    c = np.cos(yaw_rad)
    s = np.sin(yaw_rad)
    return np.column_stack([c * lever_m[0] - s * lever_m[1], s * lever_m[0] + c * lever_m[1]])


def _position_residual(antenna: EpochMeasurements, state: FloatArray, origin: FloatArray) -> FloatArray:
    """Observed minus computed positions, (n, 2)."""
    computed = state[:, :2] + _turned(state[:, 2], antenna.lever_m) + state[:, 3:5]
    return antenna.en_m - origin - computed


def _add_positions(
    equations: NormalEquations, antenna: EpochMeasurements, state: FloatArray, origin: FloatArray, weight: FloatArray
) -> None:
    """Positions of the antenna, and yaw where two antennas show it."""
    known = np.flatnonzero(np.isfinite(antenna.en_m[:, 0]))
    residual = _position_residual(antenna, state, origin)[known]
    lever = _turned(state[known, 2], antenna.lever_m)
    by_yaw = np.column_stack([-lever[:, 1], lever[:, 0]])
    sigma = antenna.white_m[known] / np.sqrt(weight[known])
    for axis in range(2):
        design = np.zeros((len(known), _STATE_SIZE))
        design[:, axis] = 1.0
        design[:, 2] = by_yaw[:, axis]
        design[:, 3 + axis] = 1.0
        equations.add(known * _STATE_SIZE, design, residual[:, axis], sigma)
    shown = np.flatnonzero(np.isfinite(antenna.yaw_rad))
    if len(shown):
        off = antenna.yaw_rad[shown] - state[shown, 2]
        off = (off + np.pi) % (2 * np.pi) - np.pi
        sigma = antenna.sigma_yaw_rad * np.maximum(1.0, np.abs(off) / (HUBER_SIGMAS * antenna.sigma_yaw_rad)) ** 0.5
        equations.add(shown * _STATE_SIZE + 2, np.ones((len(shown), 1)), off, sigma)


def _add_drift(
    equations: NormalEquations,
    chain: PathEpochs,
    drift_m: FloatArray,
    run: IntArray,
    state: FloatArray,
    *,
    first: int,
    axes: int,
) -> None:
    """The slowly varying error of GNSS: a Gauss-Markov process that begins anew with each run."""
    size = state.shape[1]
    begins = np.flatnonzero(np.diff(run, prepend=run[:1] - 1) != 0)
    goes_on = np.flatnonzero(run[1:] == run[:-1])
    kept = np.exp(-np.diff(chain.t_s)[goes_on] / DRIFT_CORRELATION_S)
    for column in range(first, first + axes):
        equations.add(begins * size + column, np.ones((len(begins), 1)), -state[begins, column], drift_m[begins])
        design = np.zeros((len(goes_on), size + 1))
        design[:, 0] = -kept
        design[:, size] = 1.0
        residual = kept * state[goes_on, column] - state[goes_on + 1, column]
        sigma = drift_m[goes_on] * np.sqrt(1.0 - kept**2)
        equations.add(goes_on * size + column, design, residual, sigma)


def _add_wheels(equations: NormalEquations, chain: PathEpochs, state: FloatArray) -> None:
    """From epoch to epoch: no sideways movement of the axle, no movement at all at a stand, a bounded yaw rate."""
    dt = np.diff(chain.t_s)
    step = np.diff(state[:, :3], axis=0)

    moving = np.flatnonzero(~chain.standing & ~chain.gap)
    middle = 0.5 * (state[moving, 2] + state[moving + 1, 2])
    c = np.cos(middle)
    s = np.sin(middle)
    sideways = -s * step[moving, 0] + c * step[moving, 1]
    along = c * step[moving, 0] + s * step[moving, 1]
    design = np.zeros((len(moving), _STATE_SIZE + 3))
    design[:, 0] = s
    design[:, 1] = -c
    design[:, 2] = -0.5 * along
    design[:, 5] = -s
    design[:, 6] = c
    design[:, 7] = -0.5 * along
    equations.add(moving * _STATE_SIZE, design, -sideways, np.hypot(SLIP * along, PATH_SLIP_FLOOR_M))

    still = np.flatnonzero(chain.standing & ~chain.gap)
    # Over a long gap nothing is known of the yaw; a weaker link than that makes the equations singular.
    turning = np.where(chain.standing, STAND_STEP_RAD, np.minimum(YAW_RATE_RADPS * dt, np.pi))
    pair = np.zeros((len(dt), _STATE_SIZE + 1))
    pair[:, 0] = -1.0
    pair[:, _STATE_SIZE] = 1.0
    for column in range(2):
        equations.add(
            still * _STATE_SIZE + column, pair[still], -step[still, column], np.full(len(still), STAND_STEP_M)
        )
    every = np.arange(len(dt))
    equations.add(every * _STATE_SIZE + 2, pair, -step[:, 2], turning)


def _solve_height(chain: PathEpochs, antenna: EpochMeasurements) -> tuple[FloatArray, FloatArray]:
    """Heights of the antenna (n,) and their standard deviations (n,)."""
    n = len(chain.t_s)
    size = 2
    known = np.flatnonzero(np.isfinite(antenna.height_m))
    base = float(np.median(antenna.height_m[known]))
    state = np.zeros((n, size))
    equations = NormalEquations(n * size, 2 * size + 1)
    equations.add(known * size, np.ones((len(known), size)), antenna.height_m[known] - base, antenna.white_h_m[known])
    _add_drift(equations, chain, antenna.drift_h_m, antenna.drift_run, state, first=1, axes=1)
    middle, before, after = _triples(chain)
    bound = CLIMB_ACCELERATION_MPS2 * 0.5 * (before + after)
    zero = np.zeros(len(middle))
    equations.add((middle - 1) * size, _second_difference(before, after, size), zero, bound)
    dt = np.diff(chain.t_s)
    pair = np.zeros((n - 1, size + 1))
    pair[:, 0] = -1.0
    pair[:, size] = 1.0
    sigma = np.where(chain.standing, STAND_STEP_M, np.minimum(CLIMB_MPS * dt, LARGEST_CLIMB_M))
    weak = np.where(chain.stretch[1:] == chain.stretch[:-1], 10.0 * sigma, sigma)
    sigma = np.where(chain.standing, sigma, weak)
    equations.add(np.arange(n - 1) * size, pair, np.zeros(n - 1), sigma)
    solution = equations.solve()
    return solution.values.reshape(n, size)[:, 0] + base, solution.sigma().reshape(n, size)[:, 0]


def _triples(chain: PathEpochs) -> tuple[IntArray, FloatArray, FloatArray]:
    """Epochs inside a moving stretch, and the times to their neighbours before and after."""
    dt = np.diff(chain.t_s)
    linked = ~chain.gap & ~chain.standing & (chain.stretch[1:] == chain.stretch[:-1])
    middle = np.flatnonzero(linked[1:] & linked[:-1]) + 1
    return middle, dt[middle - 1], dt[middle]


def _second_difference(before: FloatArray, after: FloatArray, size: int) -> FloatArray:
    """Rows (m, 2·size + 1) that form the change of a rate from three neighbours."""
    design = np.zeros((len(before), 2 * size + 1))
    design[:, 0] = 1 / before
    design[:, size] = -1 / before - 1 / after
    design[:, 2 * size] = 1 / after
    return design
