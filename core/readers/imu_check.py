"""What measurements of an IMU show about themselves: gravity, units, axes, times.

An IMU that turns sees gravity turn the other way: the change of the specific force over a second is what the angular
rate says, but for accelerations, which come and go. That compares units, signs and axes of both sensors.
"""

from __future__ import annotations

from itertools import permutations, product
from typing import Final

import numpy as np

from furrowmap.core.runtime.arrays import FloatArray
from furrowmap.core.runtime.errors import Notice
from furrowmap.core.values.inertial import STANDARD_GRAVITY_MPS2, InertialTrack

MAX_GRAVITY_DEVIATION: Final = 0.05
"""Share by which the mean specific force may differ from gravity: biases are below 30 mg, slow motion adds little."""
MAX_WITHOUT_GRAVITY_MPS2: Final = 5.0
RESAMPLED_STEP_S: Final = 0.1
TURN_STEPS: Final = 10
"""Steps over which turns are compared: a second."""
MAX_CHECKED_S: Final = 1200.0
"""More than this is not needed."""
MIN_TURN_RAD: Final = 0.02
"""RMS turn of gravity in a window from which units and axes show."""
MAX_RESIDUAL_RATIO: Final = 0.6
"""Residuals by which other axes must be better than those stated."""
MIN_EXPLAINED_SHARE: Final = 0.5
"""Share of gravity's turn that must be explained for an answer to be named."""
MAX_JITTER: Final = 0.3
"""Scatter of the intervals, in shares of one, from which times are those of arrival."""
MIN_PAUSE_INTERVALS: Final = 10.0
"""Intervals of so many usual ones are pauses, not bursts."""
BURST_INTERVALS: Final = 20
_DEGREE: Final = float(np.pi / 180.0)


def imu_notices(track: InertialTrack) -> list[Notice]:
    """What is wrong with measurements, and what to write in the session or in the file."""
    name = track.source or "The IMU"
    return [*_gravity(track, name), *_axes(track, name), *_times(track, name)]


def _gravity(track: InertialTrack, name: str) -> list[Notice]:
    """Whether the specific force at rest or in slow motion is gravity."""
    size = float(np.median(np.linalg.norm(_resampled(track)[1], axis=1))) if len(track) > 1 else 0.0
    share = size / STANDARD_GRAVITY_MPS2
    if abs(share - 1.0) < MAX_GRAVITY_DEVIATION:
        return []
    if abs(size - 1.0) < MAX_GRAVITY_DEVIATION:
        cause = "g"
    elif abs(share / STANDARD_GRAVITY_MPS2 - 1.0) < MAX_GRAVITY_DEVIATION:
        cause = "mps2"
    elif size < MAX_WITHOUT_GRAVITY_MPS2:
        cause = "removed"
    else:
        return [Notice("imu-gravity.scale", name=name, size=size, gravity=STANDARD_GRAVITY_MPS2, share=share)]
    return [Notice(f"imu-gravity.{cause}", name=name, size=size, gravity=STANDARD_GRAVITY_MPS2)]


def _axes(track: InertialTrack, name: str) -> list[Notice]:
    """Whether angular rate and specific force have the same axes, and the rate its unit."""
    turn, force = _resampled(track)
    if len(force) < 3 * TURN_STEPS:
        return []
    size = np.linalg.norm(force, axis=1, keepdims=True)
    up = force / np.where(size > 0.0, size, 1.0)
    swept = np.cumsum(turn, axis=0)
    swept = swept[TURN_STEPS:] - swept[:-TURN_STEPS]
    middle, seen = 0.5 * (up[TURN_STEPS:] + up[:-TURN_STEPS]), up[TURN_STEPS:] - up[:-TURN_STEPS]
    whole = float((seen**2).sum())
    if whole < MIN_TURN_RAD**2 * len(seen):
        return []
    stated = _misfit(middle, seen, swept)
    choices = {words: _misfit(middle, seen, factor * swept @ matrix.T) for words, factor, matrix in _alternatives()}
    best = min(choices, key=lambda words: choices[words])
    if choices[best] > MAX_RESIDUAL_RATIO * stated or choices[best] > (1.0 - MIN_EXPLAINED_SHARE) * whole:
        return []
    return [
        Notice("imu-axes", name=name, value=max(0.0, 1 - stated / whole), choices=1 - choices[best] / whole, best=best)
    ]


def _misfit(middle: FloatArray, seen: FloatArray, swept: FloatArray) -> float:
    """Squares of gravity's turns (n, 3) that turns of the IMU (n, 3) leave unexplained."""
    return float(((seen + np.cross(swept, middle)) ** 2).sum())


def _alternatives() -> list[tuple[str, float, FloatArray]]:
    """What may be wrong with the rates: in words, and the factor and matrix that mend it; the simplest first."""
    same = np.eye(3)
    out = [
        ("they were in degrees per second instead of radians", _DEGREE, same),
        ("they were in radians per second instead of degrees", 1.0 / _DEGREE, same),
        ("they had the other sign", -1.0, same),
    ]
    for order, signs in product(permutations(range(3)), product((1, -1), repeat=3)):
        matrix = np.zeros((3, 3))
        matrix[range(3), order] = signs
        if not (np.array_equal(matrix, same) or np.array_equal(matrix, -same)):
            axes = ", ".join(f"{'−' if sign < 0 else ''}{'xyz'[k]}" for sign, k in zip(signs, order, strict=True))
            out.append((f"their x, y, z were {axes}", 1.0, matrix))
    return out


def _times(track: InertialTrack, name: str) -> list[Notice]:
    """Times of arrival, and pauses."""
    step = np.diff(track.t_s)
    if len(step) < 3 * BURST_INTERVALS:
        return []
    mean = float(np.median(track.t_s[BURST_INTERVALS:] - track.t_s[:-BURST_INTERVALS])) / BURST_INTERVALS
    scatter = float(np.mean(np.abs(step[step < MIN_PAUSE_INTERVALS * mean] - mean)))
    notices = []
    if scatter > MAX_JITTER * mean:
        notices.append(Notice("imu-times-of-arrival", name=name, scatter=1e3 * scatter, mean=1e3 * mean))
    pauses = step[step >= MIN_PAUSE_INTERVALS * mean]
    if len(pauses):
        notices.append(
            Notice("imu-pauses", name=name, pauses=len(pauses), pauses_sum=pauses.sum(), pauses_max=pauses.max())
        )
    return notices


def _resampled(track: InertialTrack) -> tuple[FloatArray, FloatArray]:
    """Turn (n, 3) within each step of the first minutes, and mean specific force (n, 3); empty steps are left out."""
    part = track.t_s < track.t_s[0] + MAX_CHECKED_S
    cell = ((track.t_s[part] - track.t_s[0]) / RESAMPLED_STEP_S).astype(np.int64)
    _, first, count = np.unique(cell, return_index=True, return_counts=True)
    rate, force = (np.add.reduceat(v[part], first) / count[:, None] for v in (track.rate_radps, track.force_mps2))
    return RESAMPLED_STEP_S * rate, force
