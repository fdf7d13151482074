"""Ranges of the lasers: a constant of each, from its residuals on the common ground, and the uncertainty of their bow.

Every laser of a spinning scanner has a range constant of its own, a few millimetres within the maker's tolerance. All
of them see the same ground, each from somewhere else in turn, so that the residuals of each show its own constant. A
constant common to all is the vehicle's height; one that grows evenly with elevation looks like its pitch, and like the
tops of clods that hide what is behind them. Neither can be separated from these, so both are left out.

The range bow (doming) is an uncertainty. A laser's elevation is off by a little, and a beam that grazes the ground
returns from more than its middle. So flat ground comes out as a shallow bowl or hill: its heights are off by k r² at
the distance r. Scans alone cannot show that: ground and poses bent into a paraboloid of that shape (poses lifted by
k s² over the path length s, and tilted by its slope) fit them as well. Only GNSS heights over a long path oppose it.
The bow is therefore not estimated but considered (:class:`~furrowmap.core.adjustment.covariance.Considered`).
"""

from collections.abc import Iterable
from concurrent.futures import ThreadPoolExecutor
from typing import Final

import numpy as np

from furrowmap.core.adjustment.banded import NormalEquations
from furrowmap.core.adjustment.covariance import Considered
from furrowmap.core.matching.ground_registration import (
    CORRELATED,
    GROUND_GATE,
    MATCHING_HUBER,
    MIN_NODE_RETURNS,
    residual_variance,
)
from furrowmap.core.matching.height_grid import cell_at, node_at
from furrowmap.core.matching.placing import Placing
from furrowmap.core.matching.portions import THREADS, Portion, blocks, shares
from furrowmap.core.matching.returns import GroundReturns
from furrowmap.core.matching.session_registration import session_surface
from furrowmap.core.runtime.arrays import FloatArray
from furrowmap.core.runtime.kernels import kernel_part
from furrowmap.core.values.scan import MAX_LASERS, LaserRanges

LASER_CELL_M: Final = 0.15
LASER_THIN: Final = 3
"""Cells, and how many returns to one, from which the constants are estimated."""
LASER_PRIOR_M: Final = 0.003
"""Standard deviation of the constants before anything was seen; the maker allows 3 cm."""
MIN_LASER_RETURNS: Final = 1000
"""A laser with fewer returns of the ground keeps the ranges it has."""
MIN_LASERS: Final = 4
"""Of fewer nothing is left when height and pitch are taken out."""
ELEVATION_SIGMA: Final = np.radians(0.1)
"""Of the elevation at which a laser sees the ground, independent of the others': half of its beam, 0.18° wide."""
MAX_BOW_RETURNS: Final = 20_000
"""So many returns show how the lasers lie on the ground."""


def laser_ranges(placing: Placing, axis: FloatArray) -> LaserRanges | None:
    """The constants by the ground of a session; None where the recording does not number its lasers.

    Args:
        axis: (3,) unit vector along the sensor's axis, upwards, in the vehicle frame.
    """
    returns = placing.returns
    knots = placing.knots
    state = placing.state
    sensor = placing.sensor
    if len(returns.laser) != len(returns):
        return None
    portions = blocks(returns.t_s, knots, LASER_THIN, placing.unused)
    surface = session_surface(placing, portions, LASER_CELL_M)
    sensor_m = state.xyz_m + state.rotation @ sensor.xyz_m
    axes = state.rotation @ (sensor.turn @ axis)

    def work(share: Iterable[Portion]) -> FloatArray:
        sums = np.zeros((4, MAX_LASERS))
        for c, part in share:
            placed = placing.ground(c, part)
            k = knots.at(placed.t_s)[0]
            more = np.zeros((4, MAX_LASERS))
            _sum(placed, np.array(returns.laser[part]), surface, sensor_m[k], axes[k], more)
            sums += more
        return sums

    with ThreadPoolExecutor(THREADS) as pool:
        found = list(pool.map(work, shares(portions)))
    return ranges_of(np.sum(found, axis=0))


def ranges_of(sums: FloatArray) -> LaserRanges | None:
    """The constants that follow, shrunk by what is usual; None where too few lasers see the ground.

    Args:
        sums: (4, MAX_LASERS) of each laser: Σ w a², with a = ∂ residual / ∂ range, which is the height of the ray's
            direction; Σ w a r; Σ of the sines of the rays' elevations in the sensor's frame; number of returns.
    """
    seen = sums[3] >= MIN_LASER_RETURNS
    if seen.sum() < MIN_LASERS:
        return None
    normal, right, elevation, count = sums[:, seen]
    weight = normal / CORRELATED
    found = right / normal
    line = np.column_stack([np.ones(len(found)), elevation / count])
    root = np.sqrt(weight)
    slow = np.linalg.lstsq(line * root[:, None], found * root, rcond=None)[0]
    information = weight + 1.0 / LASER_PRIOR_M**2
    offset = np.zeros(MAX_LASERS)
    sigma = np.full(MAX_LASERS, np.nan)
    offset[seen] = (found - line @ slow) * weight / information
    sigma[seen] = 1.0 / np.sqrt(information)
    return LaserRanges(offset, sigma)


@kernel_part()
def _sum(placed, laser, surface, sensor_m, axis, sums):  # type: ignore[no-untyped-def]
    """Add placed returns to the sums (4, MAX_LASERS) of their lasers, each against the other half's surface."""
    xyz_m = placed.xyz_m
    cell_m = surface.tiles.cell_m
    for i in range(len(xyz_m)):
        if placed.layer[i] < 0:
            continue
        x, y, u, s = cell_at(xyz_m[i, 0] / cell_m, xyz_m[i, 1] / cell_m)
        other = 2 * placed.layer[i] + 1 - placed.half[i]
        ground = 0.0
        least = np.inf
        for c in range(4):
            tile, p, q = node_at(surface.tiles, x + c % 2, y + c // 2)
            if tile < 0:
                least = 0.0
                break
            least = min(least, surface.weight[tile, other, p, q])
            ground += (s if c // 2 else 1.0 - s) * (u if c % 2 else 1.0 - u) * surface.height_m[tile, other, p, q]
        if least < MIN_NODE_RETURNS:
            continue
        residual = xyz_m[i, 2] - ground
        variance = residual_variance(least)
        normalised = abs(residual) / np.sqrt(variance)
        if normalised > GROUND_GATE:
            continue
        w = min(1.0, MATCHING_HUBER / max(normalised, 1e-9)) / variance
        dx = xyz_m[i, 0] - sensor_m[i, 0]
        dy = xyz_m[i, 1] - sensor_m[i, 1]
        dz = xyz_m[i, 2] - sensor_m[i, 2]
        distance = np.sqrt(dx * dx + dy * dy + dz * dz)
        a = dz / distance
        k = laser[i]
        sums[0, k] += w * a * a
        sums[1, k] += w * a * residual
        sums[2, k] += (dx * axis[i, 0] + dy * axis[i, 1] + dz * axis[i, 2]) / distance
        sums[3, k] += 1.0


def range_bow_sigma(returns: GroundReturns, sensor_m: FloatArray, axis: FloatArray) -> float:
    """Standard deviation of k in 1/m, by where the lasers see the ground; 0 where it is not known which laser saw what.

    The errors of the lasers' elevations are fitted by what a vehicle's height and tilt do, and by k r².

    Args:
        returns: of the ground.
        sensor_m: (3,) the sensor in the vehicle frame.
        axis: (3,) unit vector along its axis, upwards.
    """
    if not len(returns.laser):
        return 0.0
    every = slice(None, None, -(-len(returns) // MAX_BOW_RETURNS))
    arm = np.asarray(returns.xyz_m[every], np.float64) - sensor_m
    distance = np.linalg.norm(arm, axis=1)
    along = arm @ axis / distance
    # A turn of the ray about the sensor, upwards by its elevation: by how much that lifts the return.
    lift = (axis[2] * distance - along * arm[:, 2]) / np.sqrt(np.maximum(1.0 - along**2, 1e-6))
    x, y, _ = arm.T
    design = np.column_stack([np.ones(len(arm)), x, y, x * x + y * y])
    fit = np.linalg.lstsq(design.T @ design, design.T, rcond=None)[0][3]
    by_laser = np.bincount(np.asarray(returns.laser[every]), fit * lift)
    return float(ELEVATION_SIGMA * np.linalg.norm(by_laser))


def range_bow(sigma_per_m: float, prior: NormalEquations, centre_m: FloatArray) -> Considered:
    """The bow as a considered parameter of the coarse knots.

    Args:
        sigma_per_m: see :func:`range_bow_sigma`.
        prior: equations of the coarse knots without LiDAR.
        centre_m: (count, 3) see :meth:`~furrowmap.core.adjustment.coarse.CoarseKnots.centres`.
    """
    plan = centre_m[:, :2] - centre_m[:, :2].mean(axis=0)
    mode = np.zeros((len(centre_m), len(prior.right) // len(centre_m)))
    mode[:, 2] = sigma_per_m * (plan**2).sum(axis=1)
    mode[:, 3] = 2.0 * sigma_per_m * plan[:, 1]
    mode[:, 4] = -2.0 * sigma_per_m * plan[:, 0]
    band = prior.band
    flat = mode.ravel()
    right = band[0] * flat
    for k in range(1, len(band)):
        right[k:] += band[k, :-k] * flat[:-k]
        right[:-k] += band[k, :-k] * flat[k:]
    return Considered(flat, right)
