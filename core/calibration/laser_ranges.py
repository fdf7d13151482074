"""What each laser of a scanner measures too long, from how the ground comes out at it and at the others.

Every laser of a spinning scanner has a constant of its own by which its ranges are off, a few millimetres within the
maker's tolerance. All of them see the same ground, each from somewhere else in turn, so that their residuals show what
they have of their own. What is alike in all of them is the vehicle's height, and what grows evenly with their
elevation looks like its pitch, and like the tops of clods that hide what is behind them: neither is told from that,
so both are left out.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final

import numba
import numpy as np
from numpy.typing import NDArray

from furrowmap.core.matching.agreement import CORRELATED, GATE, HUBER, LEAST_WEIGHT, NOISE_M
from furrowmap.core.matching.surface import TILE, TILE_BITS, Surface
from furrowmap.core.values.scan import Scan

FloatArray = NDArray[np.float64]

LASERS: Final = 256
"""As many as a laser's number can tell apart."""
USUAL_M: Final = 0.003
"""Standard deviation of the constants before anything was seen; the maker allows 3 cm."""
LEAST_RETURNS: Final = 1000
"""A laser with fewer returns of the ground keeps the ranges it has."""
LEAST_LASERS: Final = 4
"""Of fewer nothing is left when height and pitch are taken out."""


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


@dataclass(frozen=True)
class LaserSums:
    """What returns say about the lasers' constants, each on its own.

    Attributes:
        normal: (256,) Σ w a², with a = ∂ residual / ∂ range, which is the height of the ray's direction.
        right: (256,) Σ w a r.
        elevation: (256,) Σ of the sines of the rays' elevations in the sensor's frame.
        count: (256,) returns.
    """

    normal: FloatArray
    right: FloatArray
    elevation: FloatArray
    count: FloatArray

    @classmethod
    def none(cls) -> LaserSums:
        """Nothing yet."""
        return cls(*np.zeros((4, LASERS)))

    def plus(self, other: LaserSums) -> LaserSums:
        """Both together."""
        return LaserSums(
            self.normal + other.normal,
            self.right + other.right,
            self.elevation + other.elevation,
            self.count + other.count,
        )

    def ranges(self) -> LaserRanges | None:
        """The constants that follow, shrunk by what is usual; None where too few lasers see the ground."""
        seen = self.count >= LEAST_RETURNS
        if seen.sum() < LEAST_LASERS:
            return None
        weight = self.normal[seen] / CORRELATED
        found = self.right[seen] / self.normal[seen]
        line = np.column_stack([np.ones(len(found)), self.elevation[seen] / self.count[seen]])
        root = np.sqrt(weight)
        slow = np.linalg.lstsq(line * root[:, None], found * root, rcond=None)[0]
        information = weight + 1.0 / USUAL_M**2
        offset, sigma = np.zeros(LASERS), np.full(LASERS, np.nan)
        offset[seen] = (found - line @ slow) * weight / information
        sigma[seen] = 1.0 / np.sqrt(information)
        return LaserRanges(offset, sigma)


def laser_sums(
    xyz_m: FloatArray,
    layer: NDArray[np.int8],
    half: NDArray[np.uint8],
    laser: NDArray[np.uint8],
    surface: Surface,
    sensor_m: FloatArray,
    axis: FloatArray,
) -> LaserSums:
    """What placed returns say, each against the other half's surface.

    Args:
        xyz_m: (n, 3) against the local origin.
        layer: (n,) see :func:`~furrowmap.core.matching.surface.layers`.
        half: (n,) 0 or 1.
        laser: (n,) which laser measured them.
        surface: of these and other returns.
        sensor_m: (n, 3) where the sensor was.
        axis: (n, 3) unit vectors along its axis.
    """
    sums, tiles = LaserSums.none(), surface.tiles
    _sum(
        xyz_m, layer, half, laser, tiles.cell_m, tiles.west, tiles.south, tiles.number, surface.height_m,
        surface.weight, sensor_m, axis, sums.normal, sums.right, sums.elevation, sums.count,
    )  # fmt: skip
    return sums


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


@numba.njit(cache=True, nogil=True)
def _sum(  # type: ignore[no-untyped-def]
    xyz_m, layer, half, laser, cell_m, west, south, number, height, weight, sensor_m, axis,
    normal, right, elevation, count,
):  # fmt: skip
    rows, columns = number.shape
    for i in range(len(xyz_m)):
        if layer[i] < 0:
            continue
        u, s = xyz_m[i, 0] / cell_m, xyz_m[i, 1] / cell_m
        x, y = int(np.floor(u)), int(np.floor(s))
        u -= x
        s -= y
        other = 2 * layer[i] + 1 - half[i]
        ground, least = 0.0, np.inf
        for c in range(4):
            p, q = y + c // 2, x + c % 2
            row, column = (p >> TILE_BITS) - south, (q >> TILE_BITS) - west
            if not (0 <= row < rows and 0 <= column < columns) or number[row, column] < 0:
                least = 0.0
                break
            tile, p, q = number[row, column], p & TILE - 1, q & TILE - 1
            least = min(least, weight[tile, other, p, q])
            ground += (s if c // 2 else 1.0 - s) * (u if c % 2 else 1.0 - u) * height[tile, other, p, q]
        if least < LEAST_WEIGHT:
            continue
        residual = xyz_m[i, 2] - ground
        variance = NOISE_M * NOISE_M * (1.0 + 1.0 / least)
        normed = abs(residual) / np.sqrt(variance)
        if normed > GATE:
            continue
        w = min(1.0, HUBER / max(normed, 1e-9)) / variance
        dx, dy, dz = xyz_m[i, 0] - sensor_m[i, 0], xyz_m[i, 1] - sensor_m[i, 1], xyz_m[i, 2] - sensor_m[i, 2]
        distance = np.sqrt(dx * dx + dy * dy + dz * dz)
        a = dz / distance
        k = laser[i]
        normal[k] += w * a * a
        right[k] += w * a * residual
        elevation[k] += (dx * axis[i, 0] + dy * axis[i, 1] + dz * axis[i, 2]) / distance
        count[k] += 1.0
