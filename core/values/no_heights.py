"""Numbers that programs write where there is no height, told from heights by their distance to all others."""

import math
from collections.abc import Sequence
from typing import Final

import numpy as np

from furrowmap.core.runtime.arrays import BoolArray, FloatArray

NO_HEIGHTS: Final = (
    0.0, -999.0, 999.0, -9999.0, 9999.0, -99999.0, 99999.0, -999999.0, 999999.0, -32767.0, 32767.0, -32768.0, 32768.0,
    -65535.0, 65535.0,
)  # fmt: skip
"""Others are the ends of a type of integers, and what lies beyond :data:`NO_HEIGHT_BEYOND_M`."""
NO_HEIGHT_BEYOND_M: Final = 1e7
"""No height above or below any datum: numbers such as 1e20 or the largest of a type."""
_LEAST_GAP_M: Final = 50.0
"""Of a number that is no height from the others; more where these differ by more."""


def far_from_heights(candidates: FloatArray, low: float, high: float, unit_m: float, *, with_zero: bool) -> FloatArray:
    """Those of some numbers (n,) that are no heights beside others.

    Args:
        low, high: least and greatest of the heights, in the unit of the numbers; low > high if there are none.
        unit_m: metres in that unit.
        with_zero: whether 0 is among the numbers. Without any height, it may be one: of a plain at the sea, or a
            difference of surfaces.
    """
    if low > high:
        return candidates[(np.abs(candidates) >= 9999.0) if not with_zero else np.zeros(len(candidates), bool)]
    gap = max(high - low, _LEAST_GAP_M / abs(unit_m))
    return candidates[(candidates < low - gap) | (candidates > high + gap)]


def is_any(numbers: FloatArray, others: Sequence[float] | FloatArray, tolerance: float) -> BoolArray:
    """Which numbers (n,) are one of some others, to a tolerance."""
    found: BoolArray = (np.abs(numbers[:, None] - np.asarray(others)) <= tolerance).any(axis=1)
    return found


def are_no_heights(numbers: FloatArray, unit_m: float) -> BoolArray:
    """Which of the heights (n,) of points, in a unit of `unit_m`, are none; those that are not finite are not."""
    beyond = np.isfinite(numbers) & (np.abs(numbers * unit_m) > NO_HEIGHT_BEYOND_M)
    odd = np.isin(numbers, NO_HEIGHTS) | beyond
    heights = numbers[np.isfinite(numbers) & ~odd]
    low = float(heights.min()) if len(heights) else math.inf
    high = float(heights.max()) if len(heights) else -math.inf
    far = far_from_heights(np.array(NO_HEIGHTS), low, high, unit_m, with_zero=bool((numbers == 0.0).any()))
    found: BoolArray = np.isin(numbers, far) | beyond
    return found
