"""Headings so uncertain that a standard deviation of linear equations says nothing."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from furrowmap.core.runtime import scratch

FloatArray = NDArray[np.float64]

VAGUE_DEG: Final = 15.0
"""Beyond it positions fit several headings: one antenna that moves by decimetres may as well turn about the axle."""
ANY_DEG: Final = 180.0 / np.sqrt(3.0)
"""Of a heading that may be any."""


def with_vague_headings(sigma: FloatArray, lever_m: FloatArray) -> FloatArray:
    """Standard deviations (n, 6), of headings beyond VAGUE_DEG as of any heading, with those of the places they turn.

    Args:
        sigma: (n, 6) in the order of :data:`~furrowmap.core.values.trajectory.SIGMAS`.
        lever_m: (3,) the antenna in the vehicle frame, about which the vehicle's origin turns.
    """
    vague = sigma[:, 5] > VAGUE_DEG
    if not vague.any():
        return sigma
    out = scratch.copied(sigma)
    out[vague, 5] = np.maximum(sigma[vague, 5], ANY_DEG)
    out[vague, :2] = np.hypot(sigma[vague, :2], np.hypot(lever_m[0], lever_m[1]))
    return out
