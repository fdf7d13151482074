"""How large the slow error of positions is, by what inertial measurements show of it.

Within seconds, a first-order Gauss-Markov process of variance σ² and correlation time τ is a random walk of density
2σ²/τ. Inertial measurements show this density only: the likelihood hardly changes where σ and √τ grow alike. Where the
density is larger than stated, σ is that of a correlation time in the middle of those that receivers have.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache
from typing import Final

import numpy as np

from furrowmap.core.trajectory.inertial_adjustment import InertialAdjustment, adjust
from furrowmap.core.trajectory.inertial_start import InertialProblem

UNKNOWN_CORRELATION_S: Final = 135.0
"""Of positions that err more than stated. Errors of PPP and DGNSS last for 60 to 300 s; σ is then right within 1.5."""
MIN_GAIN: Final = 50.0
"""By how much −2 log likelihood falls with a larger error that is shown. With errors as stated it falls by up to 3,
where the motion is not quite that of the model by 30."""
MAX_DOUBLINGS: Final = 7
TRIAL_ROUNDS: Final = 2


def with_shown_drift(adjusted: InertialAdjustment) -> tuple[InertialAdjustment, float]:
    """The adjustment with slow errors of the positions as large as shown, of the map's axes and of heights.

    Returns:
        the adjustment, and its largest standard deviation of these errors over the stated one; 1 where it is as stated.
    """
    problem = adjusted.problem

    def with_times(horizontal: float, vertical: float) -> InertialProblem:
        drift_m = problem.positions.drift_m * (horizontal, horizontal, vertical)
        return replace(problem, positions=replace(problem.positions, drift_m=drift_m))

    @cache
    def deviance(horizontal: float, vertical: float) -> float:
        return adjust(with_times(horizontal, vertical), adjusted.state, TRIAL_ROUNDS).deviance

    horizontal = _likeliest(lambda times: deviance(times, 1.0))
    vertical = _likeliest(lambda times: deviance(horizontal, times))
    if horizontal == vertical == 1.0:
        return adjusted, 1.0
    longer = float(np.sqrt(UNKNOWN_CORRELATION_S / problem.drift_s))
    slow = replace(with_times(longer * horizontal, longer * vertical), drift_s=UNKNOWN_CORRELATION_S)
    return adjust(slow, adjusted.state), longer * max(horizontal, vertical)


def _likeliest(deviance: Callable[[float], float]) -> float:
    """Times the stated error at which −2 log likelihood is least; 1 where it is hardly larger there."""
    tried = [deviance(1.0)]
    while len(tried) <= MAX_DOUBLINGS:
        tried.append(deviance(2.0 ** len(tried)))
        if tried[-1] > tried[-2]:
            break
    best = int(np.argmin(tried))
    if tried[0] - tried[best] < MIN_GAIN:
        return 1.0
    vertex = 0.0
    if best + 1 < len(tried):
        before, here, after = tried[best - 1 : best + 2]
        vertex = 0.5 * (before - after) / (before - 2.0 * here + after)
    return float(2.0 ** (best + vertex))
