"""Why positions and inertial measurements contradict each other: hypotheses, compared by their likelihood.

Where the squared residuals of the adjustment are larger than expected, or another place of the antenna would take much
of them away, the adjustment is done anew under one hypothesis at a time: the antenna is elsewhere, the positions err
more than stated, the specific force scatters more than stated. The restricted likelihood of the observations says which
of them explains the residuals best. An offset of the clocks was found and taken off before.
"""

from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import cache
from typing import Final

import numpy as np

from furrowmap.core.runtime.arrays import FloatArray
from furrowmap.core.runtime.errors import Notice
from furrowmap.core.trajectory.inertial_adjustment import Fitted, InertialAdjustment, adjust, fitted, with_constant
from furrowmap.core.trajectory.inertial_checks import densities
from furrowmap.core.trajectory.position_drift import likeliest, with_shown_drift
from furrowmap.core.values.inertial import InertialTrack
from furrowmap.core.values.margins import margin

MAX_VARIANCE_FACTOR: Final = 1.3
"""Squared residuals over their expected ones; with more, something is not as stated."""
MIN_DOUBTED_S: Final = 1.0
MAX_DOUBTED_SHARE: Final = 0.02
"""Outliers come one by one. Positions that lie outside of their noise for longer, in sum for so much of the time, have
errors that their standard deviations do not hold: the trajectory bends from one to the other side of a step."""
TRIAL_ROUNDS: Final = 3
"""Of the adjustment under a hypothesis."""
MAX_NOISE_FACTOR: Final = 1.5
"""White noise that is larger than what the spectrum of the measurements shows, by this factor, is none of the IMU."""


@dataclass(frozen=True)
class Explained:
    """An adjustment that is explained.

    Attributes:
        cause: "" where it agrees with what is stated; else "lever-arm", "positions" or "noise".
        times: standard deviations of what is blamed, over the stated ones; 0 where these are not blamed.
        lever_off_m: (3,) lever arm that was used, minus the stated one.
    """

    cause: str
    adjusted: InertialAdjustment
    times: float = 0.0
    lever_off_m: FloatArray = field(default_factory=lambda: np.zeros(3))

    def notice(self, measured: InertialTrack) -> Notice | None:
        """What it contradicts, None for nothing; `measured` is by the IMU."""
        if self.cause == "lever-arm":
            place = ", ".join(f"{value:.3f}" for value in self.adjusted.problem.lever_m.tolist())
            margins = ", ".join(margin(sigma, " m") for sigma in self.adjusted.constants.lever.sigma)
            off_m = float(np.linalg.norm(self.lever_off_m))
            return Notice("contradiction.lever-arm", off_m=off_m, place=place, margins=margins)
        if self.cause == "positions":
            return Notice("contradiction.positions", times=self.times)
        if self.cause == "noise":
            force = self.adjusted.problem.links.noise.force
            unseen = force > MAX_NOISE_FACTOR * densities(measured)[1] and self.times > MAX_NOISE_FACTOR
            return Notice("contradiction.unknown" if unseen else "imu-noisier", times=self.times)
        return None


def agrees(adjusted: InertialAdjustment) -> bool:
    """Whether the residuals of an adjustment are as large as expected, and outliers come one by one."""
    t_s = adjusted.problem.positions.t_s
    lasting_s = sum(float(t_s[last] - t_s[first]) for first, last in _doubted(adjusted))
    return adjusted.variance_factor <= MAX_VARIANCE_FACTOR and lasting_s <= MAX_DOUBTED_SHARE * float(np.ptp(t_s))


def _doubted(adjusted: InertialAdjustment) -> list[tuple[int, int]]:
    """First and last of positions in a row that are doubted for more than MIN_DOUBTED_S."""
    t_s, doubted = adjusted.problem.positions.t_s, adjusted.observed.weight < 1.0
    edges = np.flatnonzero(np.diff(doubted, prepend=False, append=False)).reshape(-1, 2)
    return [(first, end - 1) for first, end in edges.tolist() if t_s[end - 1] - t_s[first] > MIN_DOUBTED_S]


def explained(adjusted: InertialAdjustment, *, by_noise_alone: bool) -> Explained:
    """An adjustment under the hypothesis that explains its residuals best; itself where it agrees.

    On wheels another lever arm and steps are not looked for: a wheel that slips looks alike.
    """
    tried: list[tuple[str, Fitted, float]] = []
    in_air = not (by_noise_alone or adjusted.problem.hints.on_wheels)
    if in_air and adjusted.constants.lever_off:
        moved = with_constant(adjusted, "lever", lambda p, step: replace(p, lever_m=p.lever_m + step))[0]
        if agrees(moved):
            return _of_lever(adjusted, moved)
        tried = [("lever-arm", moved, 0.0)]
    contradicts = not agrees(adjusted)
    for cause, hypothesis, possible in (
        ("positions", with_slower_errors, not by_noise_alone),
        ("positions", with_jumps, in_air and contradicts),
        ("noise", with_noisier_imu, contradicts),
    ):
        with suppress(np.linalg.LinAlgError):
            tried += [(cause, fit, times) for fit, times in hypothesis(adjusted)] if possible else []
    if not tried:
        return Explained("", adjusted)
    cause, best, times = min(tried, key=lambda one: one[1].deviance)
    if isinstance(best, InertialAdjustment):
        return _of_lever(adjusted, best)
    return Explained(cause, adjust(best.problem, best.state), times)


def _of_lever(stated: InertialAdjustment, moved: InertialAdjustment) -> Explained:
    return Explained("lever-arm", moved, lever_off_m=moved.problem.lever_m - stated.problem.lever_m)


def with_jumps(adjusted: InertialAdjustment) -> list[tuple[Fitted, float]]:
    """Steps between positions where the trajectory bends from one side to the other; each side may be off."""
    positions, doubted = adjusted.problem.positions, _doubted(adjusted)
    if not doubted:
        return []
    residual_m = np.nan_to_num(np.abs(adjusted.observed.residuals_m(adjusted.problem.knots, adjusted.state)))
    begins = np.zeros(len(positions.t_s), np.bool_)
    step_m = np.zeros(3)
    for k, (first, last) in enumerate(doubted):
        # The rows before a step and after it have residuals of either sign, and an undoubted one between them.
        near = k > 0 and positions.t_s[first] - positions.t_s[doubted[k - 1][1]] < MIN_DOUBTED_S
        begins[first if near else (first + last) // 2] = True
        if near:
            begins[sum(doubted[k - 1]) // 2] = False
        step_m = np.maximum(step_m, 2.0 * residual_m[first : last + 1].max(axis=0))
    run = positions.run + np.cumsum(begins)
    starts = np.flatnonzero(np.diff(run, prepend=-1))
    drift = positions.drift_m.copy()
    drift[starts] = np.hypot(drift[starts], step_m)
    with_steps = replace(positions, run=run, drift_m=drift)
    times = float(np.linalg.norm(step_m) / np.median(np.linalg.norm(positions.drift_m, axis=1)))
    return [(fitted(replace(adjusted.problem, positions=with_steps), adjusted.state, TRIAL_ROUNDS), times)]


def with_slower_errors(adjusted: InertialAdjustment) -> list[tuple[Fitted, float]]:
    """Slow errors of the positions as large as they are likeliest."""
    problem, times = with_shown_drift(adjusted)
    return [(fitted(problem, adjusted.state, TRIAL_ROUNDS), times)] if times > 1.0 else []


def with_noisier_imu(adjusted: InertialAdjustment) -> list[tuple[Fitted, float]]:
    """A noise of the specific force that is as large as it is likeliest."""
    problem, links = adjusted.problem, adjusted.problem.links

    @cache
    def noisier(times: float) -> Fitted:
        noise = replace(links.noise, force=times * links.noise.force)
        return fitted(replace(problem, links=replace(links, noise=noise)), adjusted.state, TRIAL_ROUNDS)

    times = likeliest(lambda times: noisier(times).deviance, 0.0)
    return [(noisier(times), times)] if times > 1.0 else []
