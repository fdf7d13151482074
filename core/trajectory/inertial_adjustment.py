"""The adjustment of positions and inertial measurements: Gauss-Newton rounds over all knots at once."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from furrowmap.core.estimation.banded import HUBER_SIGMAS
from furrowmap.core.estimation.knots import POSE, ROTATION, Observation, State, normal_equations
from furrowmap.core.estimation.positions import AntennaPositions, GnssDrift
from furrowmap.core.runtime.arrays import FloatArray
from furrowmap.core.trajectory.inertial_start import InertialProblem

MAX_ROUNDS: Final = 10
SETTLED_M: Final = 1e-4
SETTLED_RAD: Final = 1e-6
"""The adjustment ends when no pose moves by more."""


@dataclass(frozen=True)
class InertialAdjustment:
    """Result of the adjustment.

    Attributes:
        sigma: (n, size) standard deviations of the states; of the rotation vector in the map's axes.
        variance_factor: squared residuals over their expected ones; 1 where standard deviations are right.
        deviance: −2 log of the restricted likelihood (Patterson and Thompson 1971, Biometrika 58, 545-554), but for a
            constant: which of several standard deviations or parameters explains the observations best.
    """

    problem: InertialProblem
    state: State
    sigma: FloatArray
    observed: AntennaPositions
    rounds: int
    variance_factor: float
    deviance: float


def adjust(problem: InertialProblem, state: State) -> InertialAdjustment:
    """Gauss-Newton rounds until no pose moves."""
    knots = problem.knots
    antenna = AntennaPositions.unweighted(problem.positions, problem.origin_m, problem.lever_m)
    for number in range(1, MAX_ROUNDS + 1):
        equations = normal_equations((antenna, *beside_positions(problem)), knots, state)
        solution = equations.solve()
        step = solution.values.reshape(len(knots), -1)
        state = state.moved(step)
        before, antenna = antenna.weight, antenna.reweighted(knots, state)
        moved, turned = np.abs(step[:, :ROTATION]).max(), np.abs(step[:, ROTATION:POSE]).max()
        settled = moved < SETTLED_M and turned < SETTLED_RAD and np.abs(before - antenna.weight).max() < 0.05
        if settled or number == MAX_ROUNDS:
            break
    # An outlier counts as a position at the limit of what is trusted, not by its distance.
    normalised = antenna.normalised(knots, state)
    beyond = normalised[normalised > HUBER_SIGMAS]
    factor = (equations.squares - HUBER_SIGMAS * float((beyond - HUBER_SIGMAS).sum())) / max(equations.redundancy, 1)
    # Robust weights are no standard deviations: with those of the positions as stated, an outlier has Huber's loss.
    inside = np.isfinite(normalised)
    logs = equations.log_sigmas + 1.5 * float(np.log(before[inside]).sum())
    squares = equations.squares + HUBER_SIGMAS * float((beyond - HUBER_SIGMAS).sum())
    deviance = squares + 2.0 * logs + solution.log_determinant
    sigma = solution.sigma().reshape(len(knots), -1)
    return InertialAdjustment(problem, state, sigma, antenna, number, factor, deviance)


def beside_positions(problem: InertialProblem) -> tuple[Observation, ...]:
    """The observations beside the positions."""
    hints = problem.hints.observations(problem.links.track, problem.positions)
    return GnssDrift(problem.positions), problem.links, *hints
