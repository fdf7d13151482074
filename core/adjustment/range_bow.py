"""Range bow (doming) of a scanner, as an uncertainty: ground that looks like a bowl bends the whole trajectory.

A laser's elevation is off by a little, and a beam that grazes the ground returns from more than its middle. So flat
ground comes out as a shallow bowl or hill: its heights are off by k r² at the distance r. Scans alone cannot show that:
ground and poses bent into a paraboloid of that shape (poses lifted by k s² over the path length s, and tilted by its
slope) fit them as well. Only GNSS heights over a long path oppose it. The bow is therefore not estimated but considered
(:class:`~furrowmap.core.estimation.covariance.Considered`).
"""

from __future__ import annotations

from typing import Final

import numpy as np

from furrowmap.core.estimation.banded import NormalEquations
from furrowmap.core.estimation.covariance import Considered
from furrowmap.core.matching.returns import GroundReturns
from furrowmap.core.runtime.arrays import FloatArray

ELEVATION_SIGMA: Final = np.radians(0.1)
"""Of the elevation at which a laser sees the ground, independent of the others': half of its beam, 0.18° wide."""
MOST_RETURNS: Final = 20_000
"""So many returns show how the lasers lie on the ground."""


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
    every = slice(None, None, -(-len(returns) // MOST_RETURNS))
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
        centre_m: (count, 3) see :meth:`~furrowmap.core.estimation.coarse.CoarseKnots.centres`.
    """
    plan = centre_m[:, :2] - centre_m[:, :2].mean(axis=0)
    mode = np.zeros((len(centre_m), len(prior.right) // len(centre_m)))
    mode[:, 2] = sigma_per_m * (plan**2).sum(axis=1)
    mode[:, 3], mode[:, 4] = 2.0 * sigma_per_m * plan[:, 1], -2.0 * sigma_per_m * plan[:, 0]
    band, flat = prior.band, mode.ravel()
    right = band[0] * flat
    for k in range(1, len(band)):
        right[k:] += band[k, :-k] * flat[:-k]
        right[:-k] += band[k, :-k] * flat[k:]
    return Considered(flat, right)
