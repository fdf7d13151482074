"""Positions of a GNSS antenna in the map frame, and how good they are."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

DRIFT_CORRELATION_S: Final = 60.0
"""Time over which the slowly varying error of GNSS changes (one to two minutes for PPP-RTK and RTK)."""


@dataclass(frozen=True)
class Positions:
    """The antenna's positions that are used, and how good they are.

    Attributes:
        t_s: (m,) UTC, increasing.
        xyz_m: (m, 3) easting, northing, height.
        white_m: (m, 3) noise from position to position.
        drift_m: (m, 3) standard deviation of the slowly varying error.
        run: (m,) counts the runs of equal quality, in which the slowly varying error is continuous.
        fix: (m,) int8 quality.
        yaw_rad: (m,) yaw that two antennas showed; nan elsewhere.
    """

    t_s: FloatArray
    xyz_m: FloatArray
    white_m: FloatArray
    drift_m: FloatArray
    run: NDArray[np.intp]
    fix: NDArray[np.int8]
    yaw_rad: FloatArray
