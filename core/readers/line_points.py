"""Sweeps of a line scanner: what all formats have in common."""

from __future__ import annotations

from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from furrowmap.core.runtime.arrays import FloatArray
from furrowmap.core.runtime.errors import InputError
from furrowmap.core.values.scan import Scan

MAX_RANGE_M: Final = 2000.0
"""No scanner on a machine sees as far; farther ranges are damaged or not metres."""


def sweep(
    number: int,
    t_s: FloatArray,
    angle_rad: FloatArray,
    range_m: FloatArray,
    intensity: FloatArray,
    column: NDArray[Any],
) -> Scan:
    """The returns (n,) of one sweep in the plane z = 0, angles counter-clockwise from the x axis.

    Args:
        intensity: in any unit; fractions of 1 are scaled to 255.
        column: index of the firing in the sweep.
    """
    n = len(t_s)
    known = np.nan_to_num(intensity, nan=0.0, posinf=0.0, neginf=0.0)
    if n and 0.0 < known.max() <= 1.0:
        known = 255.0 * known
    xyz = np.column_stack([range_m * np.cos(angle_rad), range_m * np.sin(angle_rad), np.zeros(n)])
    return Scan(
        number=number,
        t_s=t_s,
        xyz_m=xyz.astype(np.float32),
        intensity=np.rint(np.clip(known, 0, 65535)).astype(np.uint16),
        laser=np.zeros(n, np.uint8),
        column=column.astype(np.uint16),
        return_number=np.ones(n, np.uint8),
        returns=np.ones(n, np.uint8),
    )


def mostly_invalid(source: str, wrong: int, everything: int) -> InputError:
    """The error of ranges that are not metres."""
    return InputError(
        "points-mostly-invalid", source=source, wrong=wrong, everything=everything, farthest_m=MAX_RANGE_M
    )
