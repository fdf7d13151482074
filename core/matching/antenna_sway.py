"""Lever arm of the antenna, and offset of the clocks, from the sway of the vehicle.

Scans show roll, pitch and height on any ground, also where it has no relief. An antenna ahead of the origin rises with
the vehicle's nose, one to its left with its left side, and one that is high moves aside as the vehicle rolls. So what
its positions do within a second shows where it stands, and when: a lever arm that is off leaves residuals in proportion
to the vehicle's axes, and clocks that are apart shift the sway in time.
"""

from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import uniform_filter1d

from furrowmap.core.adjustment.banded import NormalEquations
from furrowmap.core.adjustment.knots import Knots, State
from furrowmap.core.adjustment.position_observations import AntennaPositions
from furrowmap.core.runtime.arrays import FloatArray, three
from furrowmap.core.trajectory.held_positions import measured_heights

SWAY_S: Final = 1.1
"""What is slower than this, as drift and the way itself, is removed."""
MAX_SWAY_STEP_S: Final = 0.21
"""Positions that come less often do not show a sway of 1 to 3 Hz."""
MIN_SWAY_POSITIONS: Final = 40
"""Positions that suffice."""
MAX_SWAY_DEVIATIONS: Final = 6.0
"""Residuals of so many median deviations are no sway."""
SWAY_BATCH_S: Final = 1.0
"""Errors of the sway are independent from one such time to the next."""
LEVEL_LEVER_SHARE: Final = 0.1
UP_LEVER_SHARE: Final = 0.05
"""Share of a lever arm, forward and to the left, and up, that is uncertain: the motion prior smooths the sway, and the
poses follow the positions."""
SWAY_FLOOR_M: Final = (0.06, 0.06, 0.03)
"""No lever arm is known better."""
LEVER_CERTAIN_SIGMAS: Final = 4.0
"""Standard deviations from which on the lever arm is off."""
MAX_KNOWN_LEVER_SIGMA_M: Final = 0.5
"""Largest standard deviation, forward and to the left, with which the sway shows the lever arm."""
MAX_SWAY_CLOCK_S: Final = 30.0
SWAY_CLOCK_STEP_S: Final = 0.05
"""Offsets of the clocks that are tried, and their steps."""
SWAY_CLOCK_SIGMA_S: Final = 0.01
"""Standard deviation of an offset by the sway."""
SWAY_CLEAR_RATIO: Final = 1.5
"""The clocks are the cause if they leave so many times less of the heights' squares than a lever arm does."""
UNRELATED_SIGMAS: Final = 2.0
"""An antenna that sways as if it stood this near to the origin, in standard deviations, does not sway along."""
MIN_COMMON_SHARE: Final = 0.3
"""Share of the positions that both clocks must have in common."""


@dataclass(frozen=True)
class AntennaSway:
    """What the sway shows of the antenna.

    Attributes:
        lever_m: what is to be added to the lever arm: forward, to the left, up.
        sigma_m: standard deviations; inf where the sway does not show it.
        clock_s: time by which the scanner's clock is ahead of the positions', if that explains the heights much better
            than a lever arm does; else 0.
        unrelated: whether the antenna does not sway with the vehicle at all: the clocks may be apart by more than the
            recordings show.
    """

    lever_m: tuple[float, float, float] = (0.0, 0.0, 0.0)
    sigma_m: tuple[float, float, float] = (np.inf, np.inf, np.inf)
    clock_s: float = 0.0
    unrelated: bool = False

    @property
    def certainty(self) -> float:
        """The largest error of the lever arm in standard deviations."""
        return max(abs(off) / sigma for off, sigma in zip(self.lever_m, self.sigma_m, strict=True))

    @property
    def off(self) -> bool:
        """Whether the lever arm, or the clocks, are off."""
        return self.certainty > LEVER_CERTAIN_SIGMAS

    def plain(self) -> dict[str, list[float]] | None:
        """For `report.json`; None where the sway shows nothing."""
        if not np.isfinite(self.sigma_m).all():
            return None
        values = zip("xyz", self.lever_m, self.sigma_m, strict=True)
        return {axis: [round(off, 3), round(sigma, 3)] for axis, off, sigma in values}

    def refutes(self, lever_m: tuple[float, float], sigma_m: tuple[float, float]) -> bool:
        """Whether what is to be added to the lever arm, forward and to the left, is none by the sway."""
        rows = zip(lever_m, self.lever_m[:2], sigma_m, self.sigma_m[:2], strict=True)
        return any(abs(one - other) > LEVER_CERTAIN_SIGMAS * np.hypot(a, b) for one, other, a, b in rows)

    @property
    def known(self) -> bool:
        """Whether the sway shows where the antenna stands, forward and to the left."""
        return max(self.sigma_m[:2]) < MAX_KNOWN_LEVER_SIGMA_M


def antenna_sway(knots: Knots, state: State, antenna: AntennaPositions, held: NormalEquations) -> AntennaSway:
    """The lever arm by the residuals of the positions within a second.

    Forward and to the left it follows from heights, which scans determine as well; up from horizontal residuals, of
    which the poses take a part.

    Args:
        held: equations of all knots with fixed references.
    """
    inside = knots.at(antenna.positions.t_s)[2]
    t_s = antenna.positions.t_s[inside]
    run = antenna.positions.run[inside]
    sways = measured_heights(antenna.positions)[inside]
    if len(t_s) < MIN_SWAY_POSITIONS or float(np.median(np.diff(t_s))) > MAX_SWAY_STEP_S:
        return AntennaSway()
    k, design, residual, sigma = antenna.linearised(knots, state)
    # Stretches of positions without a gap or a change of quality.
    step = np.diff(t_s)
    cuts = np.flatnonzero((step > 1.5 * np.median(step)) | (np.diff(run) != 0)) + 1
    segments = [slice(a, b) for a, b in pairwise([0, *cuts.tolist(), len(t_s)])]
    # By how much horizontal residuals change with the antenna's height once the poses have followed.
    own = state.rotation[k, :, 2]
    size = state.layout.size
    rows = np.einsum("mas,ma->ms", design, own / sigma**2)
    right = np.zeros((len(state.xyz_m), size))
    np.add.at(right, k, rows[:, :size])
    np.add.at(right, k + 1, rows[:, size:])
    follows = held.solve().by(right.ravel()).reshape(right.shape)
    moved = np.einsum("mas,ms->ma", design, np.concatenate([follows[k], follows[k + 1]], axis=1))
    left: FloatArray = (own - moved)[:, :2]
    residual = _swaying(residual, segments)
    left = _swaying(left, segments)
    axes = _swaying(state.rotation[k, 2, :2], segments)
    batch = np.floor((t_s - t_s[0]) / SWAY_BATCH_S).astype(np.int64)
    swaying = np.flatnonzero(sways)
    level, level_sigma, used = _fitted(axes[swaying], residual[swaying, 2], batch[swaying])
    used = swaying[used]
    up, up_sigma, _ = _fitted(left.reshape(-1, 1), residual[:, :2].ravel(), np.repeat(batch, 2))
    shares = np.array([LEVEL_LEVER_SHARE, LEVEL_LEVER_SHARE, UP_LEVER_SHARE])
    sigmas = np.sqrt(np.append(level_sigma, up_sigma) ** 2 + (shares * antenna.lever_m) ** 2 + np.square(SWAY_FLOOR_M))
    found = AntennaSway(three(np.append(level, up)), three(sigmas))
    if not (found.off and len(used)):
        return found
    rest = (residual[:, 2] - axes @ level)[used]
    away = np.hypot(*(antenna.lever_m[:2] + level)) < UNRELATED_SIGMAS * np.hypot(*sigmas[:2])
    found = replace(found, unrelated=bool(away))
    return replace(found, clock_s=_clock_s(knots, state, antenna, segments, used, float(rest.var())))


def _swaying(values: FloatArray, segments: list[slice]) -> FloatArray:
    """What changes within SWAY_S of values (n, …) that are a tenth of a second or so apart."""
    out = np.empty_like(values)
    for part in segments:
        over = max(3, round(SWAY_S / 0.1))
        out[part] = values[part] - uniform_filter1d(values[part], over, axis=0, mode="nearest")
    return out


def _fitted(
    design: FloatArray, residual: FloatArray, batch: NDArray[np.int64]
) -> tuple[FloatArray, FloatArray, NDArray[np.intp]]:
    """Least squares, standard deviations by the scatter of batches (sandwich; White 1980), and rows that took part."""
    if len(residual) < MIN_SWAY_POSITIONS:
        return np.zeros(design.shape[1]), np.full(design.shape[1], np.inf), np.zeros(0, np.intp)
    used = np.flatnonzero(
        np.abs(residual) < MAX_SWAY_DEVIATIONS * 1.4826 * max(float(np.median(np.abs(residual))), 1e-6)
    )
    design = design[used]
    residual = residual[used]
    batch = batch[used]
    normal = design.T @ design
    if len(used) < MIN_SWAY_POSITIONS or np.linalg.eigvalsh(normal)[0] < 1e-9:
        return np.zeros(design.shape[1]), np.full(design.shape[1], np.inf), used
    found = np.asarray(np.linalg.solve(normal, design.T @ residual), np.float64)
    left = residual - design @ found
    scores = np.column_stack([np.bincount(batch, column * left) for column in design.T])
    inverse = np.linalg.inv(normal)
    batched = np.diag(inverse @ (scores.T @ scores) @ inverse)
    sigma: FloatArray = np.sqrt(np.maximum(batched, np.diag(inverse) * left.var()))
    return found, sigma, used


def _clock_s(
    knots: Knots, state: State, antenna: AntennaPositions, segments: list[slice], used: NDArray[np.intp], left_m2: float
) -> float:
    """The offset of the clocks at which the stated lever arm explains the antenna's heights; 0 where none does."""
    inside = knots.at(antenna.positions.t_s)[2]
    t_s = antenna.positions.t_s[inside]
    seen = _swaying(antenna.positions.xyz_m[inside, 2], segments)[used]
    height = state.xyz_m[:, 2] + state.rotation[:, 2] @ antenna.lever_m
    steps = round(MAX_SWAY_CLOCK_S / SWAY_CLOCK_STEP_S)
    lags = SWAY_CLOCK_STEP_S * np.arange(-steps, steps + 1)
    squares = np.full(len(lags), np.inf)
    for number, lag in enumerate(lags):
        common = ((t_s + lag > knots.t_s[0]) & (t_s + lag < knots.t_s[-1]))[used]
        if common.sum() > max(MIN_SWAY_POSITIONS, MIN_COMMON_SHARE * len(used)):
            apart = seen - _swaying(np.interp(t_s + lag, knots.t_s, height), segments)[used]
            squares[number] = float((apart[common] ** 2).mean())
    best = int(np.argmin(squares))
    if squares[best] * SWAY_CLEAR_RATIO > left_m2:
        return 0.0
    left, middle, right = squares[np.clip(best, 1, len(lags) - 2) + np.array([-1, 0, 1])]
    curve = left - 2.0 * middle + right if np.isfinite(left + right) else 0.0
    # What the vehicle does at a scanner's time t + lag is what the positions show at t.
    return float(lags[best] + (0.5 * SWAY_CLOCK_STEP_S * (left - right) / curve if curve > 0.0 else 0.0))
