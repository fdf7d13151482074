"""Range images: ranges by laser and azimuth (Nakagawa et al., LiDAR scan matching, figure 5)."""

from __future__ import annotations

from typing import Final

import numba
import numpy as np
from numpy.typing import NDArray

COLUMNS: Final = 720
"""Columns of half a degree in order of azimuth from 0."""


@numba.njit(cache=True, nogil=True, inline="always")
def column_of(x, y):  # type: ignore[no-untyped-def]
    """Column of a point by its coordinates in the lidar frame; azimuth grows from x to −y.

    The arc tangent is that of Abramowitz and Stegun (1964), 4.4.49, good to 1e-5 rad.
    """
    a, b = abs(x), abs(y)
    if a + b == 0.0:
        return 0
    t = min(a, b) / max(a, b)
    s = t * t
    angle = t * (0.9998660 + s * (-0.3302995 + s * (0.1801410 + s * (-0.0851330 + s * 0.0208351))))
    if b > a:
        angle = 0.5 * np.pi - angle
    if x < 0.0:
        angle = np.pi - angle
    if y > 0.0:
        angle = 2.0 * np.pi - angle
    return min(int(angle * (COLUMNS / (2.0 * np.pi))), COLUMNS - 1)


def median_image(images: NDArray[np.float32]) -> NDArray[np.float32]:
    """Median range of each pixel of range images (n, lasers, columns); nan where less than half have a return."""
    out: NDArray[np.float32] = np.full(images.shape[1:], np.nan, np.float32)
    seen = np.isfinite(images).sum(axis=0) * 2 > len(images)
    if seen.any():
        out[seen] = np.nanmedian(images[:, seen], axis=0)
    return out
