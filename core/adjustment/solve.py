"""The adjustment of a session: a schedule of named stages, each a function iterate → iterate.

First short windows of time are each matched to their own ground, on wide cells: an error over a longer time cannot blur
a window, so that a heading off by degrees converges. Then the ground is that of the whole session, on fine cells:
neighbouring passes and turns see the same soil.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Final

import numpy as np
from scipy.spatial.transform import Rotation

from furrowmap.core.adjustment.bridging import bridge_gaps, gaps_between
from furrowmap.core.adjustment.clock_offset import CAUSE_CLEAR_RATIO
from furrowmap.core.adjustment.laser_ranges import laser_ranges
from furrowmap.core.adjustment.mounting_calibration import mounting_calibration
from furrowmap.core.adjustment.problem import Adjusted, Iterate, Problem
from furrowmap.core.adjustment.slow_errors import shown_slow_errors, with_slow_errors
from furrowmap.core.adjustment.steps import session_step, window_step
from furrowmap.core.adjustment.yaw_ambiguity import facing
from furrowmap.core.estimation.relaxation import Relaxation
from furrowmap.core.matching.placing import GUARD_S
from furrowmap.core.matching.portions import blocks
from furrowmap.core.matching.registration import session_surface
from furrowmap.core.runtime import arrays
from furrowmap.core.trajectory.position_drift import MIN_GAIN, SETTLED_TIMES

WINDOW_ROUNDS: Final = (2, 14)
"""Fewest and most rounds of windows; they end when no heading turns by more than SETTLED_TURN_RAD."""
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

Rounds = Sequence[tuple[float, int]]


def solve(problem: Problem, first: Iterate, progress: Callable[[float], None]) -> Adjusted:
    """The poses at which ground, GNSS and wheels agree best.

    Where scans show that the slow errors of the positions are larger than stated, all is done again with larger ones.

    Args:
        problem: the input.
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
    adjusted, it = match_and_calibrate(problem, begin, steps)
    times, gain = (1.0, 1.0), MIN_GAIN
    if adjusted.constants.off:  # which slow errors may look like
        gain = max(gain, CAUSE_CLEAR_RATIO * max(adjusted.constants.clock_gain, adjusted.constants.lever_gain))
    for _ in range(MAX_SLOW_SEARCHES if problem.lever_m.any() and not adjusted.sway.off else 0):
        before, shown = times, shown_slow_errors(problem, it, gain)
        adjusted, times = replace(adjusted, slow_errors=shown), shown.times
        if np.allclose(times, before, rtol=SETTLED_TIMES):
            break
        followed = with_slow_errors(problem, times)
        steps.expect(2 * len(SESSION_ROUNDS))
        adjusted, it = match_and_calibrate(followed, replace(begin, observations=followed.observations), steps)
        adjusted = replace(adjusted, slow_errors=shown)
    progress(1.0)
    return adjusted


def match_and_calibrate(problem: Problem, it: Iterate, steps: _Steps) -> tuple[Adjusted, Iterate]:
    """Rounds of the whole session, and more with the mounting that they show where that is off; also the iterate."""
    it = match_session(problem, it, SESSION_ROUNDS, steps)
    it = calibrate_mounting(problem, it)
    for _ in range(MAX_REMOUNTS):
        turn = it.calibration.turn if it.calibration is not None else None
        if turn is None:
            break
        steps.expect(2 * len(REMOUNT_ROUNDS))
        it = match_session(problem, it.turned(turn), REMOUNT_ROUNDS, steps)
        it = calibrate_mounting(problem, it)
    return Adjusted.from_iterate(problem, it), it


def resolve_yaw_ambiguity(problem: Problem, it: Iterate) -> Iterate:
    """Turn the scanner to the yaw at which the relief repeats, if that is far from the stated one."""
    found = facing(problem.returns, problem.knots, it.state, problem.sensor_m)
    turn = Rotation.from_euler("z", found.offset_deg, degrees=True).as_matrix() if found.offset_deg else it.sensor.turn
    return replace(it, facing=found, sensor=replace(it.sensor, turn=turn))


def match_windows(problem: Problem, it: Iterate, steps: _Steps) -> Iterate:
    """Rounds of short windows, until headings no longer turn."""
    least, most = WINDOW_ROUNDS
    it, _ = window_step(problem, it, None)
    steps.done()
    relaxation = Relaxation()
    for number in range(1, most + 1):
        it, turned = window_step(problem, it, relaxation)
        steps.done()
        it, _ = window_step(problem, it, None)
        steps.done()
        if number >= least:
            if turned < SETTLED_TURN_RAD:
                break
            steps.expect(2)
    return it


def match_session(problem: Problem, it: Iterate, rounds: Rounds, steps: _Steps) -> Iterate:
    """Rounds of the whole session, from wide to fine cells; the lasers' constants before the one with all returns."""
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
    return it


def calibrate_mounting(problem: Problem, it: Iterate) -> Iterate:
    """How the vehicle stands and travels in its own frame, by the ground under its wheels."""
    placing = it.placing(problem)
    surface = session_surface(placing, blocks(problem.returns.t_s, problem.knots, 1, it.unused), STANCE_CELL_M)
    # Headings that no relief shows say nothing of the yaw.
    crab_rad = it.crab_rad if it.facing.shown else (0.0, np.inf)
    found = mounting_calibration(problem.knots, it.state, surface, placing.passage, GUARD_S, crab_rad)
    return replace(it, calibration=found)


class _Steps:
    """Reports the share of the steps that are done; the number expected may grow, the share never falls."""

    def __init__(self, progress: Callable[[float], None], expected: int) -> None:
        self._progress, self._expected, self._done, self._share = progress, expected, 0, 0.0

    def expect(self, more: int) -> None:
        """So many more steps follow."""
        self._expected += more

    def done(self) -> None:
        """One step is done."""
        arrays.release()
        self._done += 1
        self._share = max(self._share, min(1.0, self._done / self._expected))
        self._progress(self._share)
