"""Classification within a scan: machine and isolated returns."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

import numba
import numpy as np
from numpy.typing import NDArray

from furrowmap.core.pointclouds.placed import unclassified
from furrowmap.core.values.scan import PointClass, Scan
from furrowmap.core.work.machine import Machine

NEIGHBOUR_FIRINGS: Final = 2
"""Neighbours are up to this many firings earlier or later, of the same or an adjacent laser."""
NEIGHBOUR_RANGE_M: Final = 0.3
NEIGHBOUR_RANGE_SHARE: Final = 0.02
"""A neighbour supports a return if their ranges differ by less than NEIGHBOUR_RANGE_M plus this share of the range."""
MAX_ISOLATED_SHARE: Final = 1.0 / 3.0
"""With a larger share without neighbours the scan is not a range image: its lasers or firings are unknown."""


def isolated(scan: Scan) -> NDArray[np.bool_]:
    """Which returns (n,) of a scan have no neighbour at a similar range in the range image.

    Outlier removal after Rusu et al. (2008, Robotics and Autonomous Systems 56, 927-941) with neighbours by direction,
    whatever the point spacing. None where the scan is not a range image, as in bags without lasers and times.
    """
    lasers = 1 + int(scan.laser.max(initial=0))
    columns = 1 + int(scan.column.max(initial=0))
    alone: NDArray[np.bool_] = _alone(
        np.ascontiguousarray(scan.xyz_m, np.float32),
        np.ascontiguousarray(scan.laser, np.uint8),
        np.ascontiguousarray(scan.column, np.uint16),
        np.zeros((lasers, columns), np.float32),
    )
    return alone if np.count_nonzero(alone) <= MAX_ISOLATED_SHARE * len(scan) else np.zeros(len(scan), bool)


@numba.njit(cache=True, nogil=True)
def _alone(xyz_m, laser, column, image):  # type: ignore[no-untyped-def]
    """Kernel of :func:`isolated`; `image` comes empty."""
    n = len(xyz_m)
    lasers, columns = image.shape
    distance = np.empty(n, np.float32)
    out = np.empty(n, np.bool_)
    for i in range(n):
        x, y, z = xyz_m[i, 0], xyz_m[i, 1], xyz_m[i, 2]
        distance[i] = np.sqrt(x * x + y * y + z * z)
        image[laser[i], column[i]] = distance[i]
    for i in range(n):
        row, middle, own = int(laser[i]), int(column[i]), distance[i]
        near = np.float32(NEIGHBOUR_RANGE_M) + np.float32(NEIGHBOUR_RANGE_SHARE) * own
        first, last = max(middle - NEIGHBOUR_FIRINGS, 0), min(middle + NEIGHBOUR_FIRINGS, columns - 1)
        alone = True
        for k in range(first, last + 1):
            if k != middle and abs(image[row, k] - own) < near:
                alone = False
                break
        if alone:
            for other in (row - 1, row + 1):
                if 0 <= other < lasers:
                    for k in range(first, last + 1):
                        if abs(image[other, k] - own) < near:
                            alone = False
                            break
        out[i] = alone
    return out


def classifier(machine: Machine | None) -> Callable[[Scan], NDArray[np.uint8]]:
    """A function from a scan to the classes (n,) uint8 of its points: VEHICLE, IMPLEMENT, NOISE, else OTHER."""

    def classify(scan: Scan) -> NDArray[np.uint8]:
        classes = machine.classify(scan) if machine is not None else unclassified(scan)
        classes[isolated(scan) & (classes == PointClass.OTHER)] = PointClass.NOISE
        return classes

    return classify
