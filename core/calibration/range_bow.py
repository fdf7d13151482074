"""What a scanner's own bow does to the sigmas: ground that looks like a bowl bends the whole trajectory.

A laser's elevation is off by a little, and what comes back from a beam that grazes the ground is not its middle. So
flat ground comes out as a shallow bowl, or a hill: its heights are off by k r² at the distance r. Nothing in the scans
shows that, because ground and poses bent into a paraboloid of that shape fit them as well as level ground fits a
scanner without fault: poses that are lifted by k s² over the way s, and tilted by its slope, see the same ground. Only
heights of GNSS speak against it, over a long way. The bow is therefore not sought, but counts among what is not known
(a 'considered' parameter: Schmidt 1966, Application of state-space methods to navigation problems).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from furrowmap.core.estimation.banded import NormalEquations
from furrowmap.core.matching.coarse import SIZE
from furrowmap.core.matching.returns import GroundReturns

FloatArray = NDArray[np.float64]

ELEVATION_SIGMA: Final = np.radians(0.1)
"""Of the elevation at which a laser sees the ground, independent of the others': half of its beam, 0.18° wide."""
MOST_RETURNS: Final = 20_000
"""So many returns show how the lasers lie on the ground."""


@dataclass(frozen=True)
class Bow:
    """Poses and ground bent by one standard deviation.

    Attributes:
        mode: (count · 9,) how the coarse knots move.
        held: (count · 9,) the right-hand side by which GNSS, wheels and inertia hold against that.
    """

    mode: FloatArray
    held: FloatArray


def bow_sigma(returns: GroundReturns, sensor_m: FloatArray, axis: FloatArray) -> float:
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


def bow_of(sigma_per_m: float, blind: NormalEquations, centre_m: FloatArray) -> Bow:
    """What a bow of one standard deviation does to the coarse knots.

    Args:
        sigma_per_m: see :func:`bow_sigma`.
        blind: equations of the coarse knots without what the scans see.
        centre_m: (count, 3) see :meth:`~furrowmap.core.matching.coarse.CoarseKnots.centres`.
    """
    plan = centre_m[:, :2] - centre_m[:, :2].mean(axis=0)
    mode = np.zeros((len(centre_m), SIZE))
    mode[:, 2] = sigma_per_m * (plan**2).sum(axis=1)
    mode[:, 3], mode[:, 4] = 2.0 * sigma_per_m * plan[:, 1], -2.0 * sigma_per_m * plan[:, 0]
    band, flat = blind.band, mode.ravel()
    held = band[0] * flat
    for k in range(1, len(band)):
        held[k:] += band[k, :-k] * flat[:-k]
        held[:-k] += band[k, :-k] * flat[k:]
    return Bow(flat, held)
