"""A mounting that is stated with a wrong sign, order or axis of its angles: others that it may be, by the ground.

Angles that are some degrees off come out of the adjustment of the boresight. Those that are tens of degrees off do not:
it ends somewhere, with ground that does not coincide. Mistakes of such a size are no errors of measurement, so that the
mountings that may be meant can be listed. Of these the right one puts the ground at one height.
"""

from collections.abc import Iterable
from itertools import permutations, product
from typing import Final

import numpy as np
from scipy.spatial.transform import Rotation

from furrowmap.core.runtime.arrays import FloatArray
from furrowmap.core.strips.strips import StripReturns
from furrowmap.core.values.rotation import Mounting

LEVELLED_RETURNS: Final = 20_000
"""Returns by which the height of the ground is looked at."""
NEARLY_AS_LEVEL: Final = 1.5
LEVEL_M: Final = 0.2
"""Mountings count whose ground is as level as that of the best, by this factor and more."""
MOST_TRIED: Final = 8
SAME_DEG: Final = 1.0
_QUARTERS: Final = Rotation.create_group("O")
"""The 24 turns by quarters about the axes."""


def turned_mountings(stated: Mounting) -> list[FloatArray]:
    """(3, 3) rotations, scanner to vehicle, that may be meant by a mounting; without the stated one.

    Another sign or order of its angles, another order of their axes, the inverse, and quarter turns about the axes of
    the vehicle and of the scanner.
    """
    own = Rotation.from_matrix(stated.rotation)
    angles = np.asarray(stated.rpy_deg)
    listed = [
        Mounting(stated.xyz_m, (roll, pitch, yaw)).rotation
        for order in permutations(angles.tolist())
        for roll, pitch, yaw in (np.array(signs) * order for signs in product((1.0, -1.0), repeat=3))
    ]
    listed.append(Rotation.from_euler("XYZ", angles, degrees=True).as_matrix())
    listed.append(own.inv().as_matrix())
    listed += [turned.as_matrix() for turn in _QUARTERS for turned in (turn * own, own * turn)]
    return _different([own.as_matrix(), *listed])[1:]


def level_mountings(returns: StripReturns, rotations: Iterable[FloatArray], place_m: FloatArray) -> list[FloatArray]:
    """Those of rotations (3, 3) with which the ground is level and below the vehicle, the levelest first."""
    step = max(1, len(returns) // LEVELLED_RETURNS)
    sensor_m = returns.sensor_m[::step].astype(np.float64)
    up = Rotation.from_quat(returns.rotation[::step].astype(np.float64), scalar_first=True).as_matrix()[:, 2]
    found: list[tuple[float, FloatArray]] = []
    for rotation in rotations:
        below_m = np.einsum("ki,ki->k", up, sensor_m @ rotation.T + place_m)
        low, middle, high = np.quantile(returns.origin_m[::step, 2] + below_m, (0.2, 0.5, 0.8)).tolist()
        if middle < float(np.median(returns.origin_m[::step, 2])):
            found.append((high - low, rotation))
    if not found:
        return []
    limit_m = NEARLY_AS_LEVEL * min(spread for spread, _ in found) + LEVEL_M
    return [rotation for spread, rotation in sorted(found, key=lambda one: one[0]) if spread < limit_m][:MOST_TRIED]


def _different(rotations: list[FloatArray]) -> list[FloatArray]:
    """Rotations that differ from those before them."""
    kept: list[FloatArray] = []
    least_trace = 1.0 + 2.0 * np.cos(np.radians(SAME_DEG))
    for rotation in rotations:
        if all(float(np.sum(rotation * other)) < least_trace for other in kept):
            kept.append(rotation)
    return kept
