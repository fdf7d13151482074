"""Constant differences between two logs, which come from a frame, an antenna or a geoid, not from a receiver."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from furrowmap.core.runtime.errors import Notice
from furrowmap.core.values.compass import compass_direction

FloatArray = NDArray[np.float64]

ELSEWHERE_M: Final = 100.0
"""A median distance beyond this means that the two logs are of different places."""
LEAST_M: Final = 0.05
SIGMAS: Final = 3.0
"""A mean this many times its standard deviation counts as constant."""
GEOID_M: Final = 5.0
"""A larger constant difference in height is that of a geoid."""


def offset_notices(error_m: FloatArray, test: str, reference: str) -> list[Notice]:
    """Notices about constant parts of differences (n, 3) east, north and up; heights may be nan."""
    horizontal = error_m[:, :2]
    distance = float(np.median(np.hypot(*horizontal.T)))
    if distance > ELSEWHERE_M:
        return [Notice("not-the-same-place", test=test, distance=distance, reference=reference)]
    if not error_m[np.isfinite(error_m)].any():
        return [Notice("same-positions", test=test, reference=reference)]
    notices = []
    east, north = horizontal.mean(axis=0)
    length, scatter = float(np.hypot(east, north)), float(np.hypot(*horizontal.std(axis=0)))
    if length > max(LEAST_M, SIGMAS * scatter):
        way = compass_direction(float(east), float(north))
        notices.append(
            Notice("constant-offset", test=test, length=length, way=way, reference=reference, scatter=scatter)
        )
    up = error_m[np.isfinite(error_m[:, 2]), 2]
    if len(up) and abs(up.mean()) > max(GEOID_M, SIGMAS * up.std()):
        notices.append(Notice("heights-apart", test=test, reference=reference, up=up.mean()))
    return notices
