"""The adjustment of a session: a schedule of named stages, each a function iterate → iterate.

First short windows of time are each matched to their own ground, on wide cells: an error over a longer time cannot blur
a window, so that a heading off by degrees converges. Then the ground is that of the whole session, on fine cells:
neighbouring passes and turns see the same soil.
"""

from collections.abc import Callable
from dataclasses import replace
from functools import cache
from itertools import pairwise
from typing import Final

import numpy as np
from scipy.ndimage import uniform_filter1d
from scipy.spatial.transform import Rotation

from furrowmap.core.adjustment.coarse import coarse_equations
from furrowmap.core.adjustment.knots import GNSS_DRIFT, State, normal_equations
from furrowmap.core.adjustment.position_observations import GnssDrift
from furrowmap.core.adjustment.relaxation import Relaxation
from furrowmap.core.adjustment.vehicle import with_positions
from furrowmap.core.matching.bridging import bridge_gaps, gaps_between
from furrowmap.core.matching.consistency import LEVEL_GROUND, MAX_SLIP, check_consistency
from furrowmap.core.matching.gauss_newton import session_step, window_step
from furrowmap.core.matching.height_trend import height_trend
from furrowmap.core.matching.laser_ranges import laser_ranges
from furrowmap.core.matching.mounting_calibration import MIN_TURN_DEG, mounting_calibration
from furrowmap.core.matching.placing import GUARD_S
from furrowmap.core.matching.portions import blocks
from furrowmap.core.matching.problem import Adjusted, Iterate, Problem, SlowErrors
from furrowmap.core.matching.session_registration import session_surface
from furrowmap.core.matching.yaw_ambiguity import facing
from furrowmap.core.runtime import arrays
from furrowmap.core.runtime.arrays import FloatArray
from furrowmap.core.trajectory.position_steps import with_steps
from furrowmap.core.trajectory.shown_errors import (
    MIN_GAIN,
    MIN_GAIN_TOO,
    SETTLED_TIMES,
    UNKNOWN_CORRELATION_S,
    likeliest,
)
from furrowmap.core.values.gnss import DRIFT_CORRELATION_S

WINDOW_ROUNDS: Final = (2, 14)
"""Fewest and most rounds of windows; they end when no heading turns by more than SETTLED_TURN_RAD."""
WINDOW_THIN: Final = (8, 4)
"""How many returns to one that is matched: before the last of the fewest rounds, and from it on."""
SETTLED_TURN_RAD: Final = np.radians(0.4)
SESSION_ROUNDS: Final = ((0.15, 3), (0.1, 2), (0.1, 1))
"""Cells in metres, and how many returns to one that is matched."""
SETTLED_TILT_RAD: Final = np.radians(0.15)
MAX_REPEATS: Final = 5
"""A round in which tilts still move by more than SETTLED_TILT_RAD (RMS) is repeated, at most MAX_REPEATS times: a long
chain of poses, each of which sees little more than its neighbours' ground, converges slowly."""
MAX_REMOUNTS: Final = 2
"""A mounting that is off is corrected at most this many times, each followed by REMOUNT_ROUNDS as SESSION_ROUNDS."""
REMOUNT_ROUNDS: Final = ((0.1, 2), (0.1, 1))
STANCE_CELL_M: Final = 0.1
MAX_SLOW_SEARCHES: Final = 2
"""So often slow errors of the positions are looked for, each time at the poses that follow those found before."""
LEAST_TIMES: Final = 1.5
"""Of a slow error that is larger than stated."""
SHOWN_M: Final = 0.2
"""A slow error on the map that scans should show."""


def solve(problem: Problem, first: Iterate, progress: Callable[[float], None]) -> Adjusted:
    """The poses at which ground, GNSS and wheels agree best.

    Where scans show that slow errors of the positions are larger than stated, the whole session is matched again with
    larger ones.

    Args:
        first: iterate, see :func:`resolve_yaw_ambiguity`.
        progress: gets the share done, 0 to 1.

    Raises:
        LinAlgError: if the observations do not determine a part of the trajectory.
    """
    steps = _Steps(progress, 1 + 2 * WINDOW_ROUNDS[0] + 2 * len(SESSION_ROUNDS))
    it = first
    gaps = gaps_between(problem.outages_s, problem.knots)
    if gaps:
        steps.expect(1 + 2 * WINDOW_ROUNDS[0])
        it = match_windows(problem, replace(it, unused=gaps), steps)
        it = bridge_gaps(problem, it)
    begin = match_windows(problem, it, steps)
    adjusted = match_rounds(problem, begin, steps)
    stepped, notices = with_steps(problem.positions, adjusted.antenna.errors_m(problem.knots, adjusted.state))
    if notices:
        observations = with_positions(problem.observations, stepped)
        followed = replace(problem, positions=stepped, observations=observations, notices=notices)
        steps.expect(2 * len(SESSION_ROUNDS))
        freed = match_rounds(followed, replace(begin, observations=observations), steps)
        again = check_consistency(freed, LEVEL_GROUND)
        # What a wrong lever arm or clock does in turns still contradicts.
        if not (again.constants.off or again.sway.off or again.slip > MAX_SLIP):
            problem = followed
            begin = replace(begin, observations=observations)
            adjusted = freed
    seen = check_consistency(adjusted, LEVEL_GROUND)
    # A wrong lever arm or clock looks like slow errors, but not in heights.
    times = (1.0, 1.0)
    otherwise = seen.constants.off or seen.slip > MAX_SLIP
    known = seen.sway.off or any(one.key == "gnss-steps.either" for one in problem.notices)
    for _ in range(MAX_SLOW_SEARCHES if problem.lever_m.any() and not known else 0):
        before = times
        shown = shown_slow_errors(problem, adjusted)
        if otherwise and shown.times[1] == 1.0:
            shown = replace(shown, times=(1.0, 1.0))
        adjusted = replace(adjusted, slow_errors=shown)
        times = shown.times
        if np.allclose(times, before, rtol=SETTLED_TIMES):
            break
        followed = with_slow_errors(problem, times)
        steps.expect(2 * len(SESSION_ROUNDS))
        adjusted = match_rounds(followed, replace(begin, observations=followed.observations), steps)
        adjusted = replace(adjusted, slow_errors=shown)
    progress(1.0)
    return adjusted


def match_rounds(problem: Problem, it: Iterate, steps: "_Steps") -> Adjusted:
    """Rounds of the whole session, and more with the mounting that they show where that is off.

    Each goes from wide to fine cells; the constants of the lasers are found before the first one with all returns.
    """
    for remounts in range(MAX_REMOUNTS + 1):
        rounds = REMOUNT_ROUNDS if remounts else SESSION_ROUNDS
        for cell_m, thin in rounds:
            if thin == 1 and it.sensor.ranges is None:
                ranges = laser_ranges(it.placing(problem), problem.sensor_axis)
                it = replace(it, sensor=replace(it.sensor, ranges=ranges))
            for repeat in range(MAX_REPEATS + 1):
                it, tilted = session_step(problem, it, cell_m, thin, free=True)
                steps.done()
                it, _ = session_step(problem, it, cell_m, thin, free=False)
                steps.done()
                if tilted < SETTLED_TILT_RAD or repeat == MAX_REPEATS:
                    break
                steps.expect(2)
        it = calibrate_mounting(problem, it)
        turn_deg = it.calibration.turn_deg if it.calibration is not None else np.zeros(3)
        if np.abs(turn_deg).max() < MIN_TURN_DEG or remounts == MAX_REMOUNTS:
            break
        steps.expect(2 * len(REMOUNT_ROUNDS))
        it = it.turned(turn_deg)
    return Adjusted.from_iterate(problem, it)


def resolve_yaw_ambiguity(problem: Problem, it: Iterate) -> Iterate:
    """Turn the scanner to the yaw at which the relief repeats, if that is far from the stated one."""
    found = facing(problem.returns, problem.knots, it.state, problem.sensor_m)
    turn = Rotation.from_euler("z", found.offset_deg, degrees=True).as_matrix() if found.offset_deg else it.sensor.turn
    return replace(it, facing=found, sensor=replace(it.sensor, turn=turn))


def match_windows(problem: Problem, it: Iterate, steps: "_Steps") -> Iterate:
    """Rounds of short windows, until headings no longer turn."""
    least, most = WINDOW_ROUNDS
    thin, thin_at_last = WINDOW_THIN
    it, _ = window_step(problem, it, None, thin)
    steps.done()
    relaxation = Relaxation()
    for number in range(1, most + 1):
        thin = thin if number < least else thin_at_last
        it, turned = window_step(problem, it, relaxation, thin)
        steps.done()
        it, _ = window_step(problem, it, None, thin)
        steps.done()
        if number >= least:
            if turned < SETTLED_TURN_RAD:
                break
            steps.expect(2)
    return it


def calibrate_mounting(problem: Problem, it: Iterate) -> Iterate:
    """How the vehicle stands and travels in its own frame, by the ground under its wheels."""
    placing = it.placing(problem)
    surface = session_surface(placing, blocks(problem.returns.t_s, problem.knots, 1, it.unused), STANCE_CELL_M)
    # Headings that no relief shows say nothing of the yaw.
    crab_rad = it.crab_rad if it.facing.shown else (0.0, np.inf)
    found = mounting_calibration(problem.knots, it.state, surface, placing.passage, GUARD_S, crab_rad)
    stated = Rotation.from_euler("z", it.facing.offset_deg, degrees=True)
    turned = Rotation.from_matrix(it.sensor.turn) * stated.inv()
    yaw, pitch, roll = turned.as_euler("ZYX", degrees=True).tolist()
    found = replace(found, corrected_deg=(roll, -pitch, yaw), yaw_off=bool(it.facing.offset_deg))
    return replace(it, calibration=found)


def with_slow_errors(stated: Problem, times: tuple[float, float]) -> Problem:
    """The problem with slow errors so many times the stated ones, of the map's axes and of heights."""
    if times == (1.0, 1.0):
        return stated
    positions = stated.positions
    longer = np.sqrt(UNKNOWN_CORRELATION_S / DRIFT_CORRELATION_S)
    larger = replace(positions, drift_m=positions.drift_m * longer * (times[0], times[0], times[1]))
    observations = tuple(
        replace(one, correlation_s=UNKNOWN_CORRELATION_S) if isinstance(one, GnssDrift) else one
        for one in with_positions(stated.observations, larger)
    )
    return replace(stated, positions=larger, observations=observations, slow=True)


def shown_slow_errors(stated: Problem, adjusted: Adjusted) -> SlowErrors:
    """The slow errors of the positions that are likeliest by the way that scans show, and by ground seen again.

    All other unknowns are eliminated (Schur complement) from the last equations with free references.

    Args:
        stated: the problem with slow errors as stated.
        adjusted: with them, or with others.
    """
    last = adjusted.last
    knots = stated.knots
    state = adjusted.last.state
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

    used, used_right, _ = alone(next(one for one in adjusted.problem.observations if isinstance(one, GnssDrift)), state)
    all_normal = np.linalg.inv(last.covariance[np.ix_(chosen, chosen)])
    others = all_normal - used
    others_right = all_normal @ last.solution.values[chosen] - used_right

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
    checked = adjusted.facing.shown and expected > MIN_GAIN
    horizontal = likeliest(lambda times: deviance(times, 1.0), MIN_GAIN)
    # Both are by the same satellites: where one errs, less must show the other, and what nothing shows errs alike.
    vertical = likeliest(lambda times: deviance(horizontal, times), MIN_GAIN if horizontal == 1.0 else MIN_GAIN_TOO)
    if horizontal == 1.0 < vertical:
        horizontal = likeliest(lambda times: deviance(times, vertical), MIN_GAIN_TOO)
        horizontal = vertical if horizontal == 1.0 and not checked else horizontal
    gain = deviance(1.0, 1.0) - deviance(horizontal, vertical)
    trend = height_trend((others, others_right), drift_of(1.0, 1.0)[:2], last.coarse.times_s(knots))
    if trend.shown:
        # A creeping error is as far from its mean, half of the time in either direction.
        crept_m = 0.5 * abs(trend.rate_mps) * float(np.ptp(knots.t_s))
        longer = np.sqrt(UNKNOWN_CORRELATION_S / DRIFT_CORRELATION_S)
        vertical = max(vertical, crept_m / (longer * float(np.median(positions.drift_m[:, 2]))), LEAST_TIMES)
    return SlowErrors((horizontal, vertical), checked, max(gain, trend.gain), trend)


class _Steps:
    """Reports the share of the steps that are done; the number expected may grow, the share never falls."""

    def __init__(self, progress: Callable[[float], None], expected: int) -> None:
        self._progress = progress
        self._expected = expected
        self._done = 0
        self._share = 0.0

    def expect(self, more: int) -> None:
        """So many more steps follow."""
        self._expected += more

    def done(self) -> None:
        """One step is done."""
        arrays.release()
        self._done += 1
        self._share = max(self._share, min(1.0, self._done / self._expected))
        self._progress(self._share)
