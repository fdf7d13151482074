"""A smooth path through noisy positions: as smooth as a vehicle moves, and no smoother than the noise asks for."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import BSpline, make_interp_spline, make_smoothing_spline

FloatArray = NDArray[np.float64]

ACCELERATION_PSD: Final = 0.01
"""Spectral density of a working vehicle's acceleration, (m/s²)²·s, and of its turning, (rad/s²)²·s.

0.1 m/s² that last for a second; what a turn of 3 m at walking speed needs beyond it is bent by less than a millimetre.
"""
_FEWEST: Final = 5
_FOURTH_DIFFERENCE: Final = np.sqrt(70.0)
"""Standard deviation of fourth differences of white noise of 1."""


def smooth_spline(t_s: FloatArray, values: FloatArray) -> BSpline:
    """The cubic smoothing spline through `values`, a curve also between them.

    It minimises ``Σ (values − f)²/σ² + ∫ f''² / PSD`` (Reinsch, "Smoothing by spline functions", Numerische Mathematik
    10, 1967), which is also what a Kalman smoother with white acceleration finds. σ is the noise that the values show
    themselves, so that a path without noise is interpolated exactly.

    Args:
        t_s: (n,) strictly increasing, n of at least 2.
        values: (n, k) metres or radians, all columns equally noisy.
    """
    if len(t_s) < _FEWEST:
        return make_interp_spline(t_s, values, k=min(3, len(t_s) - 1))
    return make_smoothing_spline(t_s, values, lam=white_noise(values) ** 2 / ACCELERATION_PSD)


def white_noise(values: FloatArray) -> float:
    """Standard deviation of the noise from value to value, (n, k) evenly spaced, robustly from fourth differences.

    They are free of whatever a polynomial of third degree follows over five neighbours: speed, acceleration and jerk.
    """
    differences = np.diff(values, n=4, axis=0)
    return float(1.4826 * np.median(np.abs(differences)) / _FOURTH_DIFFERENCE) if len(differences) else 0.0
