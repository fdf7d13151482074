"""Range constants of the lasers, from their residuals on the common ground.

Every laser of a spinning scanner has a range constant of its own, a few millimetres within the maker's tolerance. All
of them see the same ground, each from somewhere else in turn, so that the residuals of each show its own constant. A
constant common to all is the vehicle's height; one that grows evenly with elevation looks like its pitch, and like the
tops of clods that hide what is behind them. Neither can be separated from these, so both are left out.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numba
import numpy as np
from numpy.typing import NDArray

from furrowmap.core.matching.ground import CORRELATED, GROUND_GATE, LEAST_WEIGHT, MATCHING_HUBER, NOISE_M, PlacedReturns
from furrowmap.core.matching.ground_registration import session_surface
from furrowmap.core.matching.placing import Placing
from furrowmap.core.matching.portions import Portion, blocks, in_threads
from furrowmap.core.matching.surface import TILE_BITS, TILE_NODES, HeightGrid
from furrowmap.core.runtime.arrays import FloatArray
from furrowmap.core.values.scan import MAX_LASERS, LaserRanges

CELL_M: Final = 0.15
THIN: Final = 3
"""Cells, and how many returns to one, from which the constants are estimated."""
USUAL_M: Final = 0.003
"""Standard deviation of the constants before anything was seen; the maker allows 3 cm."""
LEAST_RETURNS: Final = 1000
"""A laser with fewer returns of the ground keeps the ranges it has."""
LEAST_LASERS: Final = 4
"""Of fewer nothing is left when height and pitch are taken out."""


@dataclass(frozen=True)
class LaserSums:
    """Sums over returns, for each laser by itself.

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
        return cls(*np.zeros((4, MAX_LASERS)))

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
        offset, sigma = np.zeros(MAX_LASERS), np.full(MAX_LASERS, np.nan)
        offset[seen] = (found - line @ slow) * weight / information
        sigma[seen] = 1.0 / np.sqrt(information)
        return LaserRanges(offset, sigma)


def laser_ranges(placing: Placing, axis: FloatArray) -> LaserRanges | None:
    """The constants by the ground of a session; None where the recording does not number its lasers.

    Args:
        placing: of the iterate.
        axis: (3,) unit vector along the sensor's axis, upwards, in the vehicle frame.
    """
    returns, knots, state, sensor = placing.returns, placing.knots, placing.state, placing.sensor
    if len(returns.laser) != len(returns):
        return None
    portions = blocks(returns.t_s, knots, THIN, placing.unused)
    surface = session_surface(placing, portions, CELL_M)
    sensor_m, axes = state.xyz_m + state.rotation @ sensor.xyz_m, state.rotation @ (sensor.turn @ axis)

    def work(share: Sequence[Portion]) -> LaserSums:
        sums = LaserSums.none()
        for c, part in share:
            placed = placing.ground(c, part)
            k = knots.at(placed.t_s)[0]
            sums = sums.plus(laser_sums(placed, np.array(returns.laser[part]), surface, sensor_m[k], axes[k]))
        return sums

    sums = LaserSums.none()
    for part in in_threads(work, portions):
        sums = sums.plus(part)
    return sums.ranges()


def laser_sums(
    placed: PlacedReturns, laser: NDArray[np.uint8], surface: HeightGrid, sensor_m: FloatArray, axis: FloatArray
) -> LaserSums:
    """Sums over placed returns, each against the other half's surface.

    Args:
        placed: (n,) returns.
        laser: (n,) which laser measured them.
        surface: of these and other returns.
        sensor_m: (n, 3) where the sensor was.
        axis: (n, 3) unit vectors along its axis.
    """
    sums, tiles = LaserSums.none(), surface.tiles
    _sum(
        placed.xyz_m, placed.layer, placed.half, laser, tiles.cell_m, tiles.west, tiles.south, tiles.number,
        surface.height_m, surface.weight, sensor_m, axis, sums.normal, sums.right, sums.elevation, sums.count,
    )  # fmt: skip
    return sums


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
            tile, p, q = number[row, column], p & TILE_NODES - 1, q & TILE_NODES - 1
            least = min(least, weight[tile, other, p, q])
            ground += (s if c // 2 else 1.0 - s) * (u if c % 2 else 1.0 - u) * height[tile, other, p, q]
        if least < LEAST_WEIGHT:
            continue
        residual = xyz_m[i, 2] - ground
        variance = NOISE_M * NOISE_M * (1.0 + 1.0 / least)
        normalised = abs(residual) / np.sqrt(variance)
        if normalised > GROUND_GATE:
            continue
        w = min(1.0, MATCHING_HUBER / max(normalised, 1e-9)) / variance
        dx, dy, dz = xyz_m[i, 0] - sensor_m[i, 0], xyz_m[i, 1] - sensor_m[i, 1], xyz_m[i, 2] - sensor_m[i, 2]
        distance = np.sqrt(dx * dx + dy * dy + dz * dz)
        a = dz / distance
        k = laser[i]
        normal[k] += w * a * a
        right[k] += w * a * residual
        elevation[k] += (dx * axis[i, 0] + dy * axis[i, 1] + dz * axis[i, 2]) / distance
        count[k] += 1.0
