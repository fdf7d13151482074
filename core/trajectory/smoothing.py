"""A smooth path through noisy positions: as smooth as a vehicle moves, and no smoother than the noise asks for."""

from collections.abc import Callable
from typing import Final

import numpy as np
from scipy.linalg import solveh_banded

from furrowmap.core.runtime.arrays import FloatArray

ACCELERATION_PSD: Final = 0.01
"""Spectral density of a working vehicle's acceleration, (m/s²)²·s, and of its turning, (rad/s²)²·s.

0.1 m/s² that last for a second. With 4 mm of noise a turn of 3 m at walking speed is bent by less than a millimetre.
"""
_FOURTH_DIFFERENCE: Final = np.sqrt(70.0)
"""Standard deviation of fourth differences of white noise of 1."""


def smooth_path(t_s: FloatArray, values: FloatArray) -> Callable[..., FloatArray]:
    """The cubic smoothing spline of `values` over time: gives places (m, k) at times (m,), or with 1 velocities.

    It minimises ``Σ (values − f)² / σ² + ∫ f''² / PSD``, as a Kalman smoother with white acceleration does. σ is the
    noise that the values show themselves, so that a path without noise is interpolated.

    Args:
        t_s: (n,) strictly increasing, n of at least 2.
        values: (n, k) metres or radians, all columns equally noisy.
    """
    level, bend = smoothed(t_s, values, white_noise(values) ** 2 / ACCELERATION_PSD)
    step = np.diff(t_s)[:, None]
    jerk = np.diff(bend, axis=0) / step
    slope = np.diff(level, axis=0) / step - step * (bend[:-1] / 3.0 + bend[1:] / 6.0)

    def at(wanted_s: FloatArray, order: int = 0) -> FloatArray:
        # Not by scipy.interpolate, which takes 0.1 s to import at each start.
        i = np.clip(np.searchsorted(t_s, wanted_s, side="right") - 1, 0, len(step) - 1)
        u = (wanted_s - t_s[i])[:, None]
        if order == 1:
            return slope[i] + u * (bend[i] + u * (0.5 * jerk[i]))
        return level[i] + u * (slope[i] + u * (0.5 * bend[i] + u * (jerk[i] / 6.0)))

    return at


def smoothed(t_s: FloatArray, values: FloatArray, stiffness: float) -> tuple[FloatArray, FloatArray]:
    """The spline f that minimises ``Σ (values − f)² + stiffness · ∫ f''²``: f and f'' at the times, (n, k) as `values`.

    Reinsch's algorithm (Green and Silverman, "Nonparametric Regression and Generalized Linear Models", 1994, section
    2.3): its second derivatives γ solve ``(R + stiffness QᵀQ) γ = Qᵀ values``, of five diagonals.
    """
    curve = np.zeros_like(values)
    if len(t_s) < 3:
        return values, curve
    step = np.diff(t_s)
    before = 1.0 / step[:-1]
    after = 1.0 / step[1:]
    middle = -before - after
    bands = np.zeros((3, len(middle)))
    bands[2] = (step[:-1] + step[1:]) / 3.0 + stiffness * (before**2 + middle**2 + after**2)
    bands[1, 1:] = step[1:-1] / 6.0 + stiffness * (middle[:-1] * before[1:] + after[:-1] * middle[1:])
    bands[0, 2:] = stiffness * after[:-2] * before[2:]
    curve[1:-1] = bend = solveh_banded(bands, np.diff(np.diff(values, axis=0) / step[:, None], axis=0))
    pull = np.zeros_like(values)
    for offset, weight in enumerate((before, middle, after)):
        pull[offset : offset + len(bend)] += weight[:, None] * bend
    return values - stiffness * pull, curve


def white_noise(values: FloatArray) -> float:
    """Standard deviation of the noise from value to value, (n, k) evenly spaced, robustly from fourth differences.

    They are free of whatever a polynomial of third degree follows over five neighbours: speed, acceleration and jerk.
    """
    differences = np.diff(values, n=4, axis=0)
    return float(1.4826 * np.median(np.abs(differences)) / _FOURTH_DIFFERENCE) if len(differences) else 0.0
