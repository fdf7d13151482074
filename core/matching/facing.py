"""Which way the scanner faces: a mounting that is turned by a quarter, a half or any large angle about the upright.

Whoever states no mounting, or one that is half a turn off, sees nothing wrong in a single scan, and on soil without
walls nothing in a cloud of many either: the ground comes out as flat, only blurred. But with each step of the vehicle
all that the scanner sees moves the wrong way. So relief that several scans show is in one place under the right angle
only. The measure is that of :class:`~furrowmap.core.matching.agreement.Relief`: the mean product of the heights that
even and odd scans show at the same place, which is the relief's variance where they agree and nothing where they do
not. It needs no pose better than GNSS gives: each scan's own slope and bow are taken out of its heights.
"""

from __future__ import annotations

from itertools import pairwise
from typing import Final

import numpy as np
from numpy.typing import NDArray

from furrowmap.core.matching.knots import Knots, State
from furrowmap.core.matching.returns import GroundReturns

FloatArray = NDArray[np.float64]

ANGLES: Final = 24
"""Angles that are tried, evenly round."""
WAY_M: Final = 1.0
"""A window is as long as the vehicle takes for this way: an angle off by half a step of ANGLES blurs it by 13 cm, one
off by half a turn by two metres."""
LONGEST_S: Final = 12.0
WINDOWS: Final = 24
LEAST_WINDOWS: Final = 8
"""Most windows that are looked at, spread over the recording, and fewest that say anything."""
NEAR_M: Final = 6.0
LEAST_RETURNS: Final = 500
LEAST_IN_SCAN: Final = 50
CELL_M: Final = 0.15
ROUGH_M: Final = 0.03
"""Heights beyond count less when a scan's slope is found, and twice that is the most relief that counts at all."""
CERTAIN: Final = 4.5
"""The best angle is used where it is better than the stated one by so many standard deviations of the windows' mean."""
TURNED_DEG: Final = 20.0
"""Less than that comes right by itself and is the business of :mod:`furrowmap.core.matching.stance`."""
QUARTER_DEG: Final = 5.0
"""An angle so near to a quarter or half turn is one: scanners are mounted so, and the best angle is known to 3°."""


def facing_deg(returns: GroundReturns, knots: Knots, state: State, sensor_m: FloatArray) -> float | None:
    """By how much the scanner is to be turned about the vehicle's z axis (counter-clockwise) to face as it did.

    Args:
        returns: of the ground, in the vehicle frame by the mounting as stated.
        knots: times.
        state: poses at them, as GNSS alone has them.
        sensor_m: (3,) the sensor in the vehicle frame.

    Returns:
        None where the stated mounting faces right, or too little shows that it does not.
    """
    found = [_agreement(returns, part, knots, state, sensor_m) for part in _windows(returns, knots, state)]
    shown = np.array([row for row in found if row is not None])
    if len(shown) < LEAST_WINDOWS:
        return None
    mean = shown.mean(axis=0)
    best = int(np.argmax(mean))
    better = shown[:, best] - shown[:, 0]
    if better.mean() <= CERTAIN * better.std(ddof=1) / np.sqrt(len(better)):
        return None
    left, middle, right = mean[[best - 1, best, (best + 1) % ANGLES]]
    step = 360.0 / ANGLES
    angle = step * (best + 0.5 * (left - right) / (left - 2.0 * middle + right))
    quarter = 90.0 * round(angle / 90.0)
    angle = quarter if abs(angle - quarter) < QUARTER_DEG else angle
    angle = 180.0 - (180.0 - angle) % 360.0
    return float(angle) if abs(angle) > TURNED_DEG else None


def _windows(returns: GroundReturns, knots: Knots, state: State) -> list[slice]:
    """Returns of the windows, evenly chosen of all."""
    found = []
    for chain in knots.chains:
        part = slice(chain.first, chain.first + chain.count)
        way = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(state.xyz_m[part, :2], axis=0).T))])
        cuts = knots.t_s[part][np.searchsorted(way, np.arange(0.0, way[-1], WAY_M))]
        found += [(a, b) for a, b in pairwise(cuts.tolist()) if b - a < LONGEST_S]
    chosen = np.unique(np.linspace(0, len(found) - 1, WINDOWS).astype(int)) if found else ()
    ends = np.searchsorted(returns.t_s, [found[k] for k in chosen]) if found else ()
    return [slice(int(a), int(b)) for a, b in ends]


def _agreement(
    returns: GroundReturns, part: slice, knots: Knots, state: State, sensor_m: FloatArray
) -> FloatArray | None:
    """(ANGLES,) relief (m²) that both halves of the scans show in a window; None where it has too few returns."""
    vehicle = np.asarray(returns.xyz_m[part], np.float64)
    near = np.hypot(vehicle[:, 0], vehicle[:, 1]) < NEAR_M
    vehicle, t_s = vehicle[near], np.array(returns.t_s[part])[near]
    half = np.array(returns.half[part], np.int64)[near]
    if len(t_s) < LEAST_RETURNS:
        return None
    relief = _relief(vehicle, half)
    k, share, _ = knots.at(t_s)
    plan, forward = state.xyz_m[:, 0] + 1j * state.xyz_m[:, 1], state.rotation[:, 0, 0] + 1j * state.rotation[:, 1, 0]
    # Straight from knot to knot, as complex numbers: easting + i northing.
    origin, course = (v[k] + share * (v[k + 1] - v[k]) for v in (plan, forward))
    course /= np.abs(course)
    sensor = complex(sensor_m[0], sensor_m[1])
    arm = (vehicle[:, 0] + 1j * vehicle[:, 1] - sensor) * course
    origin = origin + sensor * course
    out = np.empty(ANGLES)
    for number in range(ANGLES):
        place = origin + np.exp(2j * np.pi * number / ANGLES) * arm
        column, row = (np.floor(v / CELL_M).astype(np.int64) for v in (place.real, place.imag))
        column -= column.min()
        row -= row.min()
        cell = 2 * (column + (int(column.max()) + 1) * row) + half
        size = int(cell.max()) // 2 + 1
        count = np.bincount(cell, minlength=2 * size).reshape(size, 2)
        height = np.bincount(cell, relief, 2 * size).reshape(size, 2)
        both = np.flatnonzero(count.all(axis=1))
        weight = count[both].min(axis=1)
        product = (height[both] / count[both]).prod(axis=1)
        out[number] = float((weight * product).sum() / max(weight.sum(), 1))
    return out


def _relief(vehicle_m: FloatArray, half: NDArray[np.int64]) -> FloatArray:
    """Heights (n,) above each scan's own slope and bow, the largest ones cut; 0 in scans of few returns."""
    out = np.zeros(len(half))
    # Halves alternate from scan to scan.
    for part in np.split(np.arange(len(half)), np.flatnonzero(np.diff(half)) + 1):
        if len(part) < LEAST_IN_SCAN:
            continue
        x, y, z = vehicle_m[part].T
        design = np.column_stack([np.ones(len(part)), x, y, x * x, y * y, x * y])
        weight = np.ones(len(part))
        for _ in range(3):
            weighted = design * weight[:, None]
            above = z - design @ np.linalg.lstsq(weighted.T @ design, weighted.T @ z, rcond=None)[0]
            weight = 1.0 / np.maximum(1.0, np.abs(above) / ROUGH_M)
        out[part] = np.clip(above, -2.0 * ROUGH_M, 2.0 * ROUGH_M)
    return out
