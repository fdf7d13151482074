"""How large the slow error of positions is, by what scans show of it.

Scans show the way from place to place, and that ground is the same from pass to pass. The coarse knots' equations hold
both, with free references. The likelihood of all observations says which size of slow errors is likeliest.
"""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from itertools import pairwise
from typing import Final

import numpy as np
from scipy.ndimage import uniform_filter1d

from furrowmap.core.adjustment.problem import Iterate, Problem, SlowErrors
from furrowmap.core.estimation.coarse import coarse_equations
from furrowmap.core.estimation.knots import GNSS_DRIFT, State, normal_equations
from furrowmap.core.estimation.positions import GnssDrift
from furrowmap.core.estimation.vehicle import with_positions
from furrowmap.core.runtime.arrays import FloatArray
from furrowmap.core.trajectory.position_drift import MIN_GAIN_TOO, UNKNOWN_CORRELATION_S, likeliest
from furrowmap.core.values.gnss import DRIFT_CORRELATION_S

SHOWN_M: Final = 0.2
"""A slow error on the map that scans should show."""


def with_slow_errors(stated: Problem, times: tuple[float, float]) -> Problem:
    """The problem with slow errors so many times the stated ones, of the map's axes and of heights."""
    if times == (1.0, 1.0):
        return stated
    positions = stated.positions
    longer = np.sqrt(UNKNOWN_CORRELATION_S / DRIFT_CORRELATION_S)
    drift_m = positions.drift_m * longer * (times[0], times[0], times[1])
    larger = replace(positions, drift_m=drift_m)
    observations = tuple(
        replace(one, correlation_s=UNKNOWN_CORRELATION_S) if isinstance(one, GnssDrift) else one
        for one in with_positions(stated.observations, larger)
    )
    return replace(stated, positions=larger, observations=observations, slow=True)


def shown_slow_errors(stated: Problem, it: Iterate, min_gain: float) -> SlowErrors:
    """The slow errors of the positions that are likeliest.

    All other unknowns are eliminated (Schur complement) from the last equations with free references.

    Args:
        stated: the problem with slow errors as stated.
        it: the iterate, perhaps with others.
        min_gain: by how much −2 log likelihood must fall.
    """
    assert it.last is not None
    last, knots, state = it.last, stated.knots, it.last.state
    first = state.layout.column(GNSS_DRIFT)
    chosen = (np.arange(last.coarse.count)[:, None] * state.layout.size + first + np.arange(3)).ravel()

    # What is quicker than coarse knots can follow takes no part; a run's begin is a step.
    positions = stated.positions
    nearest = np.clip(np.searchsorted(positions.t_s, knots.t_s), 0, len(positions.t_s) - 1)
    begins = np.flatnonzero(np.diff(positions.run[nearest], prepend=-1))
    begins = np.union1d(begins, [chain.first for chain in knots.chains])
    smooth = state.added.copy()
    for begin, end in pairwise([*begins.tolist(), len(knots)]):
        smooth[begin:end] = uniform_filter1d(smooth[begin:end], last.coarse.grids[0].every, axis=0, mode="nearest")

    def alone(drift: GnssDrift, at: State) -> tuple[FloatArray, FloatArray, float]:
        fine = normal_equations((drift,), knots, at)
        equations = coarse_equations(fine, last.coarse, last.centre_m, state, 1)
        return equations.dense()[np.ix_(chosen, chosen)], equations.right[chosen], fine.squares

    used, used_right, _ = alone(next(one for one in it.observations if isinstance(one, GnssDrift)), state)
    covariance = last.free.inverse()
    all_normal = np.linalg.inv(covariance[np.ix_(chosen, chosen)])
    others, others_right = all_normal - used, all_normal @ covariance[chosen] @ last.free.right - used_right

    @cache
    def drift_of(horizontal: float, vertical: float) -> tuple[FloatArray, FloatArray, float]:
        drift_m = positions.drift_m * (horizontal, horizontal, vertical)
        return alone(GnssDrift(replace(positions, drift_m=drift_m)), replace(state, added=smooth))

    @cache
    def deviance(horizontal: float, vertical: float) -> float:
        own, own_right, squares = drift_of(horizontal, vertical)
        right = others_right + own_right
        (_, known), (_, before) = np.linalg.slogdet(others + own), np.linalg.slogdet(own)
        return float(squares - right @ np.linalg.solve(others + own, right) + known - before)

    # By how much −2 log likelihood would fall on average, were the errors as large as those that must show.
    large = max(1.0, SHOWN_M / float(np.median(positions.drift_m[:, 0])))
    stated_fit, large_fit = (np.eye(len(chosen)) + others @ np.linalg.inv(drift_of(t, 1.0)[0]) for t in (1.0, large))
    ratio = np.linalg.solve(stated_fit, large_fit)
    expected = float(np.trace(ratio) - len(ratio) - np.linalg.slogdet(ratio)[1])
    checked = it.facing.shown and expected > min_gain
    horizontal = likeliest(lambda times: deviance(times, 1.0), min_gain)
    # Both are by the same satellites: where one errs, less must show the other, and what nothing shows errs alike.
    vertical = likeliest(lambda times: deviance(horizontal, times), min_gain if horizontal == 1.0 else MIN_GAIN_TOO)
    if horizontal == 1.0 < vertical:
        horizontal = likeliest(lambda times: deviance(times, vertical), MIN_GAIN_TOO)
        horizontal = vertical if horizontal == 1.0 and not checked else horizontal
    return SlowErrors((horizontal, vertical), checked)
