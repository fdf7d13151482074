"""Robust weights: Huber's function (Huber 1964, Robust estimation of a location parameter)."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

HUBER: Final = 3.0
"""Standard deviations from which on residuals of positions lose weight."""


def huber_weight(normalised: FloatArray, limit: float = HUBER) -> FloatArray:
    """Weights (n,) of residuals (n,) in standard deviations, none of them negative; 1 for nan."""
    known = np.nan_to_num(normalised)
    return np.where(known > limit, limit / np.maximum(known, limit), 1.0)
