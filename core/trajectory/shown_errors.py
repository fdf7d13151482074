"""How large errors are that positions and inertial measurements show of each other, over the stated ones.

They are the slow error and the white noise of positions, and the noise of the specific force.

Within seconds, a first-order Gauss-Markov process of variance σ² and correlation time τ is a random walk of density
2σ²/τ. Inertial measurements show this density only: the likelihood hardly changes where σ and √τ grow alike. Where the
density is larger than stated, σ is that of a correlation time in the middle of those that receivers have.
"""

from collections.abc import Callable
from dataclasses import replace
from functools import cache
from typing import Final

import numpy as np

from furrowmap.core.adjustment.banded import NormalEquations
from furrowmap.core.adjustment.knots import Knots, Observation, State, normal_equations
from furrowmap.core.adjustment.position_observations import GnssDrift
from furrowmap.core.trajectory.inertial_adjustment import Fitted, beside_positions, fitted
from furrowmap.core.trajectory.inertial_start import InertialProblem

UNKNOWN_CORRELATION_S: Final = 135.0
"""Of positions that err more than stated. Errors of PPP and DGNSS last for 60 to 300 s; σ is then right within 1.5."""
MIN_GAIN: Final = 50.0
"""By how much −2 log likelihood falls with a larger error that is shown. With errors as stated it falls by up to 3,
where the motion is not quite that of the model by 30."""
MIN_GAIN_TOO: Final = 5.0
"""The same of heights where the map's axes are shown to err: they have the same satellites."""
UNTRUSTED: Final = 1e-9
"""Weight of positions that take no part."""
MAX_DOUBLINGS: Final = 7
SEARCHES: Final = 3
SETTLED_TIMES: Final = 0.1
"""Relative change of a standard deviation that is none."""


def with_shown_drift(adjusted: Fitted) -> tuple[InertialProblem, float]:
    """The problem with slow errors of the positions as large as shown, of the map's axes and of heights.

    Positions that lost weight take part in a second search where slow errors explain them.

    Returns:
        the problem, and its largest standard deviation of these errors over the stated one; 1 where it is as stated.
    """
    stated = adjusted.problem
    times = _shown_times(adjusted, _likeliest_times, _with_times)
    if times == (1.0, 1.0):
        return stated, 1.0
    longer = float(np.sqrt(UNKNOWN_CORRELATION_S / stated.drift_s))
    slow = _with_times(stated, (longer * times[0], longer * times[1]))
    return replace(slow, drift_s=UNKNOWN_CORRELATION_S), longer * max(times)


def _shown_times(
    adjusted: Fitted,
    likeliest_times: Callable[[InertialProblem, Fitted], tuple[float, float]],
    with_times: Callable[[InertialProblem, tuple[float, float]], InertialProblem],
) -> tuple[float, float]:
    """Times the stated errors, of the map's axes and of heights: searched at a fit, and again at the fit with them."""
    fit = adjusted
    times = (1.0, 1.0)
    for _ in range(SEARCHES):
        before = times
        times = likeliest_times(adjusted.problem, fit)
        if np.allclose(times, before, rtol=SETTLED_TIMES):
            break
        fit = fitted(with_times(adjusted.problem, times), fit.state)
    return times


def _with_times(stated: InertialProblem, times: tuple[float, float]) -> InertialProblem:
    """The problem with slow errors so many times the stated ones, of the map's axes and of heights."""
    positions = stated.positions
    return replace(stated, positions=replace(positions, drift_m=positions.drift_m * (times[0], times[0], times[1])))


def _likeliest_times(stated: InertialProblem, fit: Fitted) -> tuple[float, float]:
    """Times the stated errors, of the map's axes and of heights, linearised at a fit.

    What lost weight there takes no part: a few outliers of metres would outweigh all else.
    """
    knots = stated.knots
    state = fit.state
    trusted = replace(fit.observed, weight=np.where(fit.observed.weight < 1.0, UNTRUSTED, 1.0))
    _, *rest = beside_positions(stated)  # the slow errors come first
    same = normal_equations((trusted, *rest), knots, state)

    def drift(times: tuple[float, float]) -> Observation:
        return GnssDrift(_with_times(stated, times).positions, stated.drift_s)

    return _likeliest_pair(same, drift, knots, state, MIN_GAIN)


def with_shown_force_noise(adjusted: Fitted) -> tuple[InertialProblem, float]:
    """The problem with a noise of the specific force as large as shown, of the map's axes and of heights.

    Returns:
        the problem, and its largest noise over the stated one; 1 where it is as stated.
    """
    times = _shown_times(adjusted, _likeliest_force_times, _with_force_times)
    return _with_force_times(adjusted.problem, times), max(times)


def _with_force_times(stated: InertialProblem, times: tuple[float, float]) -> InertialProblem:
    """The problem with a noise of the specific force so many times the stated one."""
    return replace(stated, links=replace(stated.links, force_times=times))


def _likeliest_force_times(stated: InertialProblem, fit: Fitted) -> tuple[float, float]:
    """Times the stated noise, of the map's axes and of heights, linearised at a fit."""
    knots = stated.knots
    state = fit.state
    drift, _, *hints = beside_positions(stated)  # the IMU comes second
    same = normal_equations((fit.observed, drift, *hints), knots, state)

    def links(times: tuple[float, float]) -> Observation:
        return _with_force_times(stated, times).links

    return _likeliest_pair(same, links, knots, state, 0.0)


def with_shown_scatter(adjusted: Fitted) -> tuple[InertialProblem, tuple[float, float]]:
    """The problem with a white noise of the positions as large as shown, of the map's axes and of heights.

    Returns:
        the problem, and this noise over the stated one, of the map's axes and of heights; 1 where it is as stated.
    """
    times = _shown_times(adjusted, _likeliest_scatter, _with_scatter)
    return _with_scatter(adjusted.problem, times), times


def _with_scatter(stated: InertialProblem, times: tuple[float, float]) -> InertialProblem:
    """The problem with a white noise of the positions so many times the stated one."""
    positions = stated.positions
    return replace(stated, positions=replace(positions, white_m=positions.white_m * np.repeat(times, (2, 1))))


def _likeliest_scatter(stated: InertialProblem, fit: Fitted) -> tuple[float, float]:
    """Times the stated white noise, of the map's axes and of heights, linearised at a fit."""
    knots = stated.knots
    state = fit.state
    same = normal_equations(beside_positions(stated), knots, state)

    def antenna(times: tuple[float, float]) -> Observation:
        return replace(fit.observed, positions=_with_scatter(stated, times).positions)

    return _likeliest_pair(same, antenna, knots, state, MIN_GAIN)


def _likeliest_pair(
    same: NormalEquations,
    with_times: Callable[[tuple[float, float]], Observation],
    knots: Knots,
    state: State,
    min_gain: float,
) -> tuple[float, float]:
    """Factors of the standard deviations of one kind of observation, of the map's axes and of heights.

    Args:
        same: equations of all other observations.
        min_gain: of heights it is MIN_GAIN_TOO at most where the map's axes are shown to err.
    """

    @cache
    def deviance(horizontal: float, vertical: float) -> float:
        equations = same.copied()
        with_times((horizontal, vertical)).add(equations, knots, state)
        solution = equations.solve()
        squares = equations.squares - float(equations.right @ solution.values)
        return squares + 2.0 * equations.log_sigmas + solution.log_determinant

    horizontal = likeliest(lambda times: deviance(times, 1.0), min_gain)
    least = min_gain if horizontal == 1.0 else min(min_gain, MIN_GAIN_TOO)
    return horizontal, likeliest(lambda times: deviance(horizontal, times), least)


def likeliest(deviance: Callable[[float], float], min_gain: float) -> float:
    """Times a stated standard deviation at which −2 log likelihood is least; 1 where it is hardly larger there."""
    tried = [deviance(1.0)]
    while len(tried) <= MAX_DOUBLINGS:
        tried.append(deviance(2.0 ** len(tried)))
        if tried[-1] > tried[-2]:
            break
    best = int(np.argmin(tried))
    if best == 0 or tried[0] - tried[best] < min_gain:
        return 1.0
    vertex = 0.0
    if best + 1 < len(tried):
        before, here, after = tried[best - 1 : best + 2]
        vertex = 0.5 * (before - after) / (before - 2.0 * here + after)
    return float(2.0 ** (best + vertex))
