"""Constants by which the ranges of a scanner's lasers are off."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final

import numba
import numpy as np
from numpy.typing import NDArray

from furrowmap.core.values.scan import Scan

FloatArray = NDArray[np.float64]

LASERS: Final = 256
"""Lasers that a uint8 numbers."""


@dataclass(frozen=True)
class LaserRanges:
    """Constants of the lasers.

    Attributes:
        offset_m: (256,) by which each laser's ranges are too long, 0 where the ground does not show it.
        sigma_m: (256,) standard deviations, nan where the ground does not show it.
    """

    offset_m: FloatArray
    sigma_m: FloatArray

    def corrected(self, scan: Scan) -> Scan:
        """The scan as it is without these errors."""
        return replace(scan, xyz_m=shortened(scan.xyz_m, scan.laser, np.zeros(3), self.offset_m))


def shortened(
    xyz_m: NDArray[np.float32], laser: NDArray[np.uint8], sensor_m: FloatArray, offset_m: FloatArray
) -> NDArray[np.float32]:
    """Returns (n, 3) of a sensor at `sensor_m`, nearer to it by their lasers' constants."""
    out: NDArray[np.float32] = _shortened(
        np.ascontiguousarray(xyz_m, np.float32), np.ascontiguousarray(laser), sensor_m, offset_m
    )
    return out


@numba.njit(cache=True, nogil=True)
def _shortened(xyz_m, laser, sensor_m, offset_m):  # type: ignore[no-untyped-def]
    out = np.empty_like(xyz_m)
    for i in range(len(xyz_m)):
        x, y, z = xyz_m[i, 0] - sensor_m[0], xyz_m[i, 1] - sensor_m[1], xyz_m[i, 2] - sensor_m[2]
        share = offset_m[laser[i]] / max(np.sqrt(x * x + y * y + z * z), 0.1)
        out[i, 0], out[i, 1], out[i, 2] = xyz_m[i, 0] - share * x, xyz_m[i, 1] - share * y, xyz_m[i, 2] - share * z
    return out
