"""Differences that stay the same all along: a frame, an antenna or a geoid makes them rather than a receiver."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from furrowmap.core.values.compass import compass_word
from furrowmap.core.values.errors import Notice

FloatArray = NDArray[np.float64]

ELSEWHERE_M: Final = 100.0
"""A median distance beyond this says that the two do not mean the same place."""
LEAST_M: Final = 0.05
SIGMAS: Final = 3.0
"""A mean that is this many times the scatter about it is constant."""
GEOID_M: Final = 5.0
"""A greater constant difference in height is that of a geoid."""


def offset_notices(error_m: FloatArray, test: str, reference: str) -> list[Notice]:
    """What is to be said of constant parts of differences (n, 3) east, north and up; heights may be nan."""
    horizontal = error_m[:, :2]
    distance = float(np.median(np.hypot(*horizontal.T)))
    if distance > ELSEWHERE_M:
        text = (
            f"{test} lies {distance:,.0f} m from {reference} in the median: they do not mean the same place, or one of "
            "them is not where it says."
        )
        return [Notice("not-the-same-place", text)]
    if not error_m[np.isfinite(error_m)].any():
        return [Notice("same-positions", f"{test} and {reference} hold the same positions: they judge nothing.")]
    notices = []
    east, north = horizontal.mean(axis=0)
    length, scatter = float(np.hypot(east, north)), float(np.hypot(*horizontal.std(axis=0)))
    if length > max(LEAST_M, SIGMAS * scatter):
        way = compass_word(float(east), float(north))
        constant = (
            f"{test} lies {length:.3f} m to the {way} of {reference} all along, and scatters by {scatter:.3f} m about "
            "that: another frame or epoch (CLAS, MADOCA and PPP give coordinates of the day), or another antenna "
            "(--antenna-offset), rather than an error of the receiver."
        )
        notices.append(Notice("constant-offset", constant))
    up = error_m[np.isfinite(error_m[:, 2]), 2]
    if len(up) and abs(up.mean()) > max(GEOID_M, SIGMAS * up.std()):
        high = (
            f"The heights of {test} and {reference} differ by {up.mean():+.2f} m all along: one of them counts from "
            "the ellipsoid and the other from the sea."
        )
        notices.append(Notice("heights-apart", high))
    return notices
