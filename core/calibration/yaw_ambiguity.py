"""Yaw ambiguity: a mounting that is turned by a quarter, a half or any large angle about the upright.

A wrong yaw is invisible in a single scan, and on soil without walls in a cloud of many scans as well: the ground comes
out flat, only blurred. But as the vehicle moves, relief that several scans show is in one place under the right angle
only. The measure is that of :class:`~furrowmap.core.matching.ground.Relief`: the mean product of the heights of even
and odd scans at the same place, which is the relief's variance where they agree and zero where they do not. GNSS poses
suffice, because each scan's own slope and bow are removed from its heights. Where the soil is too smooth, upright
returns decide, by the share of them that even and odd scans have at the same place.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise
from typing import Final

import numpy as np
from numpy.typing import NDArray

from furrowmap.core.estimation.knots import Knots
from furrowmap.core.estimation.states import State
from furrowmap.core.matching.returns import GroundReturns
from furrowmap.core.matching.walls import UprightReturns

FloatArray = NDArray[np.float64]

ANGLES: Final = 24
"""Angles that are tried, evenly round."""
WAY_M: Final = 1.0
"""A window is as long as the vehicle takes for this way: an angle off by half a step of ANGLES blurs it by 13 cm, one
off by half a turn by two metres."""
LONGEST_S: Final = 12.0
WINDOWS: Final = 24
LEAST_WINDOWS: Final = 8
"""Most windows that are used, spread over the recording, and fewest that suffice."""
NEAR_M: Final = 6.0
LEAST_RETURNS: Final = 500
MOST_RETURNS: Final = 10_000
"""So many returns of a window show as much as all of them."""
LEAST_IN_SCAN: Final = 50
CELL_M: Final = 0.15
STANDING_CELL_M: Final = 0.25
LEAST_STANDING: Final = 300
ROUGH_M: Final = 0.03
"""Heights beyond count less when a scan's slope is found, and twice that is the most relief that counts at all."""
CERTAIN: Final = 4.5
"""Standard deviations of the windows' mean by which the best angle must be better than the stated one."""
TURNED_DEG: Final = 20.0
"""Smaller angles converge by themselves; :mod:`furrowmap.core.calibration.mounting_calibration` finds them."""
QUARTER_DEG: Final = 5.0
"""An angle so near to a quarter or half turn is one: scanners are mounted so, and the best angle is known to 3°."""


def yaw_offset_deg(returns: GroundReturns, knots: Knots, state: State, sensor_m: FloatArray) -> float | None:
    """By how much the scanner is to be turned about the vehicle's z axis (counter-clockwise) to face as it did.

    Args:
        returns: of the ground, and upright ones, in the vehicle frame by the stated mounting.
        knots: times.
        state: poses at them, as GNSS alone has them.
        sensor_m: (3,) the sensor in the vehicle frame.

    Returns:
        None where the stated mounting faces right, or too little shows that it does not.
    """
    windows, upright = _windows(knots, state), returns.upright
    ground = (_ground(returns, part, knots, state, sensor_m) for part in _parts(returns.t_s, windows))
    standing = (_standing(upright, part, knots, state, sensor_m) for part in _parts(upright.t_s, windows))
    for measured in (ground, standing):
        shown = np.array([row for row in measured if row is not None])
        if len(shown) < LEAST_WINDOWS:
            continue
        best = int(np.argmax(shown.mean(axis=0)))
        if best == 0:
            return None
        better = shown[:, best] - shown[:, 0]
        if better.mean() > CERTAIN * better.std(ddof=1) / np.sqrt(len(better)):
            angle = _refined(shown.mean(axis=0), best)
            return angle if abs(angle) > TURNED_DEG else None
    return None


def _refined(mean: FloatArray, best: int) -> float:
    """The angle in degrees, −180 to 180, at which the measure is best, by the parabola through three of them."""
    left, middle, right = mean[[best - 1, best, (best + 1) % ANGLES]]
    angle = 360.0 / ANGLES * (best + 0.5 * (left - right) / (left - 2.0 * middle + right))
    quarter = 90.0 * round(angle / 90.0)
    angle = quarter if abs(angle - quarter) < QUARTER_DEG else angle
    return float(180.0 - (180.0 - angle) % 360.0)


def _windows(knots: Knots, state: State) -> FloatArray:
    """(k, 2) times of the windows, evenly chosen of all."""
    found = []
    for chain in knots.chains:
        part = slice(chain.first, chain.first + chain.count)
        way = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(state.xyz_m[part, :2], axis=0).T))])
        cuts = knots.t_s[part][np.searchsorted(way, np.arange(0.0, way[-1], WAY_M))]
        found += [(a, b) for a, b in pairwise(cuts.tolist()) if b - a < LONGEST_S]
    chosen = np.unique(np.linspace(0, len(found) - 1, WINDOWS).astype(int)) if found else ()
    return np.array([found[k] for k in chosen]).reshape(-1, 2)


def _parts(t_s: FloatArray, windows: FloatArray) -> list[slice]:
    """Which of the returns are in each window."""
    return [slice(int(a), int(b)) for a, b in np.searchsorted(t_s, windows)]


def _ground(returns: GroundReturns, part: slice, knots: Knots, state: State, sensor_m: FloatArray) -> FloatArray | None:
    """(ANGLES,) relief (m²) that both halves of the scans show in a window; None where it has too few returns."""
    part = slice(part.start, part.stop, max(1, (part.stop - part.start) // MOST_RETURNS))
    vehicle = np.asarray(returns.xyz_m[part], np.float64)
    near = np.hypot(vehicle[:, 0], vehicle[:, 1]) < NEAR_M
    if near.sum() < LEAST_RETURNS:
        return None
    vehicle, t_s = vehicle[near], np.array(returns.t_s[part])[near]
    half = np.array(returns.half[part], np.int64)[near]
    relief = _relief(vehicle, half)
    out = np.empty(ANGLES)
    for number, cell in enumerate(_cells(t_s, vehicle, knots, state, sensor_m, CELL_M)):
        count = _by_half(cell, half)
        height = _by_half(cell, half, relief)
        both = np.flatnonzero(count.all(axis=1))
        weight = count[both].min(axis=1)
        product = (height[both] / count[both]).prod(axis=1)
        out[number] = (weight * product).sum() / max(weight.sum(), 1.0)
    return out


def _standing(
    returns: UprightReturns, part: slice, knots: Knots, state: State, sensor_m: FloatArray
) -> FloatArray | None:
    """(ANGLES,) share of upright returns that both halves of the scans have in one place; None for too few returns."""
    vehicle, half = np.asarray(returns.xyz_m[part], np.float64), np.array(returns.half[part], np.int64)
    if len(half) < LEAST_STANDING:
        return None
    cells = _cells(np.array(returns.t_s[part]), vehicle, knots, state, sensor_m, STANDING_CELL_M)
    return np.array([2.0 * _by_half(cell, half).min(axis=1).sum() / len(half) for cell in cells])


def _cells(
    t_s: FloatArray, vehicle_m: FloatArray, knots: Knots, state: State, sensor_m: FloatArray, cell_m: float
) -> Iterator[NDArray[np.int64]]:
    """For each angle the number of the cell on the map in which each return (n,) lies."""
    k, share, _ = knots.at(t_s)
    plan, forward = state.xyz_m[:, 0] + 1j * state.xyz_m[:, 1], state.rotation[:, 0, 0] + 1j * state.rotation[:, 1, 0]
    # Straight from knot to knot, as complex numbers: easting + i northing.
    origin, course = (v[k] + share * (v[k + 1] - v[k]) for v in (plan, forward))
    course /= np.abs(course)
    sensor = complex(sensor_m[0], sensor_m[1])
    arm = (vehicle_m[:, 0] + 1j * vehicle_m[:, 1] - sensor) * course
    origin = origin + sensor * course
    for number in range(ANGLES):
        place = origin + np.exp(2j * np.pi * number / ANGLES) * arm
        column, row = (np.floor(v / cell_m).astype(np.int64) for v in (place.real, place.imag))
        column -= column.min()
        row -= row.min()
        yield column + (int(column.max()) + 1) * row


def _by_half(cell: NDArray[np.int64], half: NDArray[np.int64], value: FloatArray | None = None) -> FloatArray:
    """(cells, 2) how many returns of either half each cell has, or the sum of their values."""
    size = int(cell.max()) + 1
    out: FloatArray = np.bincount(2 * cell + half, value, 2 * size).reshape(size, 2).astype(np.float64)
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
