"""Positions that creep: what ground shows of them that a flight sees several times.

To the IMU, which knows no speed, a creep is a motion. But ground stays where it is: where it slopes, each strip over it
is higher or lower than the one before by slope and creep.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import Final

import numpy as np

from furrowmap.core.adjustment.boresight import CELL_HEIGHT_SIGMA_M
from furrowmap.core.adjustment.cell_heights import (
    ROBUST_ROUNDS,
    CellHeights,
    cell_heights,
    same_cell_pairs,
    smooth_groups,
)
from furrowmap.core.adjustment.strips import StripReturns
from furrowmap.core.estimation.banded import huber_weight
from furrowmap.core.runtime.arrays import FloatArray
from furrowmap.core.runtime.errors import Notice
from furrowmap.core.values.rotation import Mounting
from furrowmap.core.values.time_span import Interval, interval_numbers
from furrowmap.core.values.trajectory import Trajectory

MAX_CREEP_ROUNDS: Final = 12
"""Ground rises and falls within decimetres, so that differences show a part of a larger creep at once."""
MIN_CREEP_GAIN: Final = 50.0
"""By how much the sum of squared normalised differences falls with a creep that is certain."""
MIN_CREEP_PAIRS: Final = 500
MIN_CREEP_SIGMAS: Final = 3.0
"""Standard deviations of the positions by which they have moved in half of the flight at least."""


def held_against_strips(
    trajectory: Trajectory, returns: StripReturns, strips: Sequence[Interval], used: Mounting
) -> tuple[Trajectory, Notice | None]:
    """The trajectory with larger standard deviations where the ground shows that positions creep, and the notice."""
    creep_mps = positions_creep_mps(returns, strips, used)
    length_s = trajectory.span_s[1] - trajectory.span_s[0]
    stated_m = float(np.median(np.hypot(*trajectory.sigma[:, :2].T)))
    if 0.5 * length_s * float(np.hypot(*creep_mps)) < MIN_CREEP_SIGMAS * stated_m:
        return trajectory, None
    sigma = trajectory.sigma.copy()
    # Positions may have been right at the begin or at the end.
    sigma[:, :2] = np.hypot(sigma[:, :2], np.abs(creep_mps) * length_s / np.sqrt(3.0))
    east, north = 1e3 * creep_mps
    whole_m = float(np.hypot(*creep_mps)) * length_s
    return replace(trajectory, sigma=sigma), Notice("contradiction.creep", east=east, north=north, whole_m=whole_m)


def positions_creep_mps(returns: StripReturns, strips: Sequence[Interval], used: Mounting) -> FloatArray:
    """(2,) speed by easting and northing at which ground moves from strip to strip; zero where none is certain."""
    number = interval_numbers(strips, returns.t_s).astype(np.int64)
    number[number == 0] = -1
    since_s, creep_mps = returns.t_s - returns.t_s.mean(), np.zeros(2)
    for _ in range(MAX_CREEP_ROUNDS):
        origin_m = returns.origin_m.copy()
        origin_m[:, :2] -= since_s[:, None] * creep_mps
        still = replace(returns, origin_m=origin_m)
        step_mps, gain = _creep_step(still, since_s, cell_heights(still, number, used.rotation, np.array(used.xyz_m)))
        if gain < MIN_CREEP_GAIN:
            break
        creep_mps = creep_mps + step_mps
    return creep_mps


def _creep_step(returns: StripReturns, since_s: FloatArray, heights: CellHeights) -> tuple[FloatArray, float]:
    """A further creep (2,) by the differences between strips, and by how much their squares fall with it."""
    variance, chosen = smooth_groups(heights)
    first, second = same_cell_pairs(heights.cell[chosen])
    if len(first) < MIN_CREEP_PAIRS:
        return np.zeros(2), 0.0
    a, b = chosen[first], chosen[second]
    inside = heights.member >= 0
    member, groups = heights.member[inside], len(heights.cell)
    at_s = np.bincount(member, since_s[inside], groups) / np.maximum(np.bincount(member, minlength=groups), 1)
    sigma = np.sqrt(
        variance[first] / heights.count[a] + variance[second] / heights.count[b] + 2.0 * CELL_HEIGHT_SIGMA_M**2
    )
    differ = np.column_stack(
        [-heights.slope[a] * (at_s[b] - at_s[a])[:, None], heights.height_m[b] - heights.height_m[a]]
    )
    # A constant of each two strips, which their errors of height are, is eliminated.
    two = np.unique(heights.window[a] * len(returns) + heights.window[b], return_inverse=True)[1]
    robust = np.ones(len(first))
    for _ in range(ROBUST_ROUNDS):
        weight = robust / sigma**2
        mean = np.column_stack([np.bincount(two, weight * column) for column in differ.T])
        left = differ - (mean / np.bincount(two, weight)[:, None])[two]
        normal = (left * weight[:, None]).T @ left
        step_mps = np.linalg.solve(normal[:2, :2] + 1e-6 * np.eye(2), normal[:2, 2])
        residual = left[:, 2] - left[:, :2] @ step_mps
        robust = huber_weight(np.abs(residual) / sigma)
    spread = max(1.0, float(weight @ residual**2) / len(residual))
    return step_mps, float(step_mps @ normal[:2, 2]) / spread
