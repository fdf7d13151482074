"""Offset of the scanner's clock from the receiver's, by ground seen in both directions of travel."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from furrowmap.core.estimation.knots import STEP_S, Knots
from furrowmap.core.estimation.states import State
from furrowmap.core.values.positions import Positions

FloatArray = NDArray[np.float64]

BLOCK_S: Final = 8.0
LEAST_BLOCKS: Final = 5
FLOOR_S: Final = 0.003


def clock_offset(
    knots: Knots, state: State, positions: Positions, origin_m: FloatArray, lever_m: FloatArray
) -> tuple[float, float]:
    """Time by which the scanner's clock is ahead of the receiver's, beyond the offset in use, and its sigma, in s.

    Poses that come late lie behind the antenna's positions by velocity times delay, whichever way the vehicle drives;
    an error of the positions lies in one direction. Ground seen in both directions separates them. The sigma is the
    jackknife's over blocks of time (Efron 1982); it is inf where the drive does not determine the offset.

    Args:
        knots: times.
        state: poses at them.
        positions: of the antenna.
        origin_m: (3,) local origin.
        lever_m: (3,) the antenna in the vehicle frame.
    """
    k, share, inside = knots.at(positions.t_s)
    k, share = k[inside], share[inside, None]
    antenna = state.xyz_m + state.rotation @ lever_m
    off = positions.xyz_m[inside] - origin_m - (antenna[k] + share * (antenna[k + 1] - antenna[k]))
    velocity = (antenna[k + 1] - antenna[k])[:, :2] / STEP_S
    block = np.floor(positions.t_s[inside] / BLOCK_S).astype(np.int64)
    _, block = np.unique(block, return_inverse=True)
    count = int(block.max(initial=-1)) + 1
    if count < LEAST_BLOCKS:
        return 0.0, np.inf
    normal, right = np.zeros((count, 3, 3)), np.zeros((count, 3))
    for axis in range(2):
        design = np.zeros((len(k), 3))
        design[:, axis], design[:, 2] = 1.0, velocity[:, axis]
        np.add.at(normal, block, design[:, :, None] * design[:, None])
        np.add.at(right, block, design * off[:, axis, None])
    whole, pull = normal.sum(axis=0), right.sum(axis=0)
    if np.linalg.cond(whole) > 1e8:
        return 0.0, np.inf
    offset = float(np.linalg.solve(whole, pull)[2])
    without = np.array([np.linalg.solve(whole - n, pull - r)[2] for n, r in zip(normal, right, strict=True)])
    sigma = float(np.sqrt((count - 1) / count * ((without - without.mean()) ** 2).sum()))
    return offset, float(np.hypot(sigma, FLOOR_S))
