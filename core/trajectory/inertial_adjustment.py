"""The adjustment of positions and inertial measurements: Gauss-Newton rounds over all knots at once."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from furrowmap.core.adjustment.banded import HUBER_SIGMAS, BandedSolution
from furrowmap.core.adjustment.imu_constants import CERTAIN_SIGMAS, SETTLED_SIGMAS, ImuConstants, imu_constants
from furrowmap.core.adjustment.knots import POSE, ROTATION, Observation, State, normal_equations
from furrowmap.core.adjustment.position_observations import AntennaPositions, GnssDrift
from furrowmap.core.adjustment.vehicle import TRAVEL_YAW, TRAVEL_YAW_SIGMA, UNKNOWN_TRAVEL_YAW
from furrowmap.core.runtime.arrays import FloatArray
from furrowmap.core.trajectory.inertial_start import InertialProblem

MAX_ROUNDS: Final = 10
TRIAL_ROUNDS: Final = 3
SETTLED_M: Final = 1e-4
SETTLED_RAD: Final = 1e-6
"""The adjustment ends when no pose moves by more; with positions noisier than SETTLED_NOISE_M, by that much more."""
SETTLED_NOISE_M: Final = 0.02
CONSTANT_ROUNDS: Final = 8


@dataclass(frozen=True)
class Fitted:
    """States that fit the observations, and how well.

    Attributes:
        variance_factor: squared residuals over their expected ones; 1 where standard deviations are right.
        deviance: −2 log of the restricted likelihood (Patterson and Thompson 1971, Biometrika 58, 545-554), but for a
            constant: which of several standard deviations or parameters explains the observations best.
    """

    problem: InertialProblem
    state: State
    observed: AntennaPositions
    rounds: int
    variance_factor: float
    deviance: float


@dataclass(frozen=True)
class InertialAdjustment(Fitted):
    """Result of the adjustment.

    Attributes:
        sigma: (n, size) standard deviations of the states; of the rotation vector in the map's axes.
        constants: what the residuals show of clock and lever arm.
        by_clock: see :func:`~furrowmap.core.adjustment.imu_constants.imu_constants`.
        clock_sigma_s: standard deviation of the offset of the IMU's clock.
    """

    sigma: FloatArray
    constants: ImuConstants
    by_clock: FloatArray
    clock_sigma_s: float = 0.0

    def with_clock_sigma(self, clock_sigma_s: float) -> "InertialAdjustment":
        """With the uncertainty of the clock in the standard deviations."""
        sigma = np.hypot(self.sigma, clock_sigma_s * self.by_clock)
        return replace(self, sigma=sigma, clock_sigma_s=clock_sigma_s)


def adjust(problem: InertialProblem, state: State) -> InertialAdjustment:
    """Gauss-Newton rounds until no pose moves, or :data:`MAX_ROUNDS`."""
    fit, solution = _fit(problem, state, MAX_ROUNDS)
    knots = problem.knots
    constants, by_clock = imu_constants(fit.observed, problem.links, knots, fit.state, solution, fit.variance_factor)
    sigma = solution.sigma().reshape(len(knots), -1)
    return InertialAdjustment(**vars(fit), sigma=sigma, constants=constants, by_clock=by_clock)


def fitted(problem: InertialProblem, state: State) -> Fitted:
    """A few rounds under a hypothesis, without standard deviations, which take as long as two rounds."""
    return _fit(problem, state, TRIAL_ROUNDS)[0]


def _fit(problem: InertialProblem, state: State, rounds: int) -> tuple[Fitted, BandedSolution]:
    knots = problem.knots
    antenna = AntennaPositions.unweighted(problem.positions, problem.origin_m, problem.lever_m)
    coarser = max(1.0, float(np.median(problem.positions.white_m[:, :2])) / SETTLED_NOISE_M)
    for number in range(1, rounds + 1):
        equations = normal_equations((antenna, *beside_positions(problem)), knots, state)
        solution = equations.solve()
        step = solution.values.reshape(len(knots), -1)
        state = state.moved(step)
        before = antenna.weight
        antenna = antenna.reweighted(knots, state)
        moved = np.abs(step[:, :ROTATION]).max()
        turned = np.abs(step[:, ROTATION:POSE]).max()
        settled = max(moved / SETTLED_M, turned / SETTLED_RAD) < coarser
        settled &= np.abs(before - antenna.weight).max() < 0.05
        if settled or number == rounds:
            break
    # An outlier counts as a position at the limit of what is trusted, not by its distance.
    normalised = antenna.normalised(knots, state)
    lost = HUBER_SIGMAS * float(np.maximum(np.nan_to_num(normalised) - HUBER_SIGMAS, 0.0).sum())
    factor = (equations.squares - lost) / max(equations.redundancy, 1)
    # Robust weights are no standard deviations: with those of the positions as stated, an outlier has Huber's loss.
    logs = equations.log_sigmas + 1.5 * float(np.log(before[np.isfinite(normalised)]).sum())
    deviance = equations.squares + lost + 2.0 * logs + solution.log_determinant
    return Fitted(problem, state, antenna, number, factor, deviance), solution


def with_travel(adjusted: InertialAdjustment) -> InertialAdjustment:
    """The adjustment of a vehicle on wheels with any direction of travel, where that along the nose does not fit."""
    if not adjusted.problem.hints.on_wheels:
        return adjusted
    yaw_rad = float(np.median(adjusted.state[TRAVEL_YAW]))
    if abs(yaw_rad) < UNKNOWN_TRAVEL_YAW * TRAVEL_YAW_SIGMA:
        return adjusted
    return adjust(replace(adjusted.problem, hints=replace(adjusted.problem.hints, any_travel=True)), adjusted.state)


def with_clock(adjusted: InertialAdjustment, used_s: float) -> tuple[InertialAdjustment, float]:
    """The adjustment with the offset of the IMU's clock that it shows, if it is certain, and the whole offset used.

    Args:
        adjusted: with the offset `used_s` that was found before.
    """
    if not (used_s or adjusted.constants.clock_off):
        return adjusted, used_s
    now, found_s = with_constant(adjusted, "clock", lambda problem, step: problem.with_imu_earlier(float(step[0])))
    offset_s = used_s + float(found_s[0])
    certain = abs(offset_s) > CERTAIN_SIGMAS * now.constants.clock.sigma[0]
    return (now, offset_s) if certain and now is not adjusted else (adjusted, used_s)


def with_constant(
    adjusted: InertialAdjustment, name: str, mended: Callable[[InertialProblem, FloatArray], InertialProblem]
) -> tuple[InertialAdjustment, FloatArray]:
    """The adjustment without what a constant is off, and this (k,); itself where it fits no better.

    Args:
        name: of the constant in :class:`ImuConstants`.
        mended: a problem in which the constant is off by so much less.
    """
    now = adjusted
    off = np.zeros(len(getattr(adjusted.constants, name).value))
    for _ in range(CONSTANT_ROUNDS):
        shown = getattr(now.constants, name)
        step = np.array(shown.value)
        if (np.abs(step) < SETTLED_SIGMAS * np.array(shown.sigma)).all():
            break
        now = adjust(mended(now.problem, step), now.state)
        off = off + step
    return (now, off) if now.variance_factor < adjusted.variance_factor else (adjusted, 0.0 * off)


def beside_positions(problem: InertialProblem) -> tuple[Observation, ...]:
    """The observations beside the positions."""
    hints = problem.hints.observations(problem.links.track, problem.positions)
    return GnssDrift(problem.positions, problem.drift_s), problem.links, *hints
