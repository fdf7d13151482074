"""Yaw ambiguity: a mounting that is turned by a quarter, a half or any large angle about the upright.

A wrong yaw is invisible in a single scan, and on soil without walls in a cloud of many scans as well: the ground
comes out flat, only blurred. But as the vehicle moves, relief that several scans show is in one place under the right
angle only. The measure is that of :class:`~furrowmap.core.matching.ground_registration.Relief`: the mean product of
the heights of even and odd scans at the same place, which is the relief's variance where they agree and zero where
they do not. GNSS poses suffice, because each scan's own slope and bow are removed from its heights, and what stays in
one place of the vehicle frame: the rings of lasers whose ranges are off, which on smooth ground repeat under a
quarter turn. Where the soil is too smooth, upright returns decide, by the share of them that even and odd scans have
at the same place: first those off the vehicle's body, then all, for a standing crop all around is taken for the body.
Where nothing shows one angle that stands out from all others, the stated one is assumed.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from itertools import pairwise
from typing import Final

import numpy as np
from numpy.typing import NDArray

from furrowmap.core.adjustment.knots import Knots, State
from furrowmap.core.matching.returns import GroundReturns
from furrowmap.core.matching.walls import UprightReturns
from furrowmap.core.runtime.arrays import FloatArray
from furrowmap.core.runtime.kernels import kernel, kernel_part

Measure = Callable[[FloatArray], FloatArray]
"""What repeats in windows (n,) under each of several turns (k,) in radians, as (n, k)."""

TRIED_YAWS: Final = 24
"""Angles that are tried, evenly round."""
YAW_FINE_REACH_DEG: Final = 10.0
FINE_YAWS: Final = 11
"""So many angles are tried within this distance of the best one."""
YAW_WINDOW_WAY_M: Final = 1.0
"""A window lasts while the vehicle drives this far: an angle off by half a step of TRIED_YAWS blurs it by 13 cm, one
off by half a turn by two metres."""
MAX_YAW_WINDOW_S: Final = 12.0
MAX_YAW_WINDOWS: Final = 24
MIN_YAW_WINDOWS: Final = 8
"""Most windows that are used, spread over the recording, and fewest that suffice."""
MAX_HALVES_RANGE_M: Final = 6.0
MIN_YAW_RETURNS: Final = 500
MAX_YAW_RETURNS: Final = 10_000
"""So many returns of a window show as much as all of them."""
MIN_YAW_SCAN_RETURNS: Final = 50
HALVES_CELL_M: Final = 0.15
COUNT_GRID: Final = 256
WIDE_GRID: Final = 1024
"""Cells along a side of the grid on which returns are counted, of the ground nearby and of all that stands: a power of
two; places further apart share a cell."""
UPRIGHT_CELL_M: Final = 0.25
PLANT_CELL_M: Final = 0.1
MIN_PLANT_SHARE: Final = 0.01
"""The best angle shows so much more of plants, which are finer than walls, than half a turn away."""
MIN_YAW_UPRIGHT: Final = 300
ROUGH_M: Final = 0.03
"""Heights beyond count less when a scan's slope is found, and twice that is the most relief that counts at all."""
YAW_CERTAIN_SIGMAS: Final = 4.5
"""Standard deviations of the windows' mean by which the best angle must be better than the stated one."""
YAW_SHOWN_SIGMAS: Final = 3.0
"""Standard deviations by which it must be better than the second best one."""
YAW_UNIQUE_RATIO: Final = 1.5
"""The best angle rises above the worst one by so many times as much as any second peak above the dip beside it."""
MIN_CONFIRMING_WINDOWS: Final = 3
"""Windows that suffice to confirm the stated angle."""
MIN_RELIEF_M: Final = 0.0022
MIN_UPRIGHT_SHARE: Final = 0.03
"""The best angle shows at least this much relief, or share of upright returns, more than the middle one."""
STATIC_CELL_M: Final = 0.15
"""Cells of the vehicle frame whose mean height is removed."""
MIN_YAW_OFFSET_DEG: Final = 2.0
"""Smaller angles converge by themselves; :mod:`furrowmap.core.matching.mounting_calibration` finds them."""
QUARTER_TURN_REACH_DEG: Final = 5.0
"""An angle so near to a quarter or half turn is one: scanners are mounted so."""


@dataclass(frozen=True)
class Facing:
    """Which way the scanner faces.

    Attributes:
        offset_deg: by how much it is to be turned about the vehicle's z axis (counter-clockwise); 0 where the stated
            mounting is used.
        shown: whether relief or upright returns show that; else the stated mounting is assumed.
    """

    offset_deg: float = 0.0
    shown: bool = False


def facing(returns: GroundReturns, knots: Knots, state: State, sensor_m: FloatArray) -> Facing:
    """Which way the scanner faces, by what several scans show in one place.

    Args:
        returns: of the ground, and upright ones, in the vehicle frame by the stated mounting.
        state: poses at them, as GNSS alone has them.
        sensor_m: (3,) the sensor in the vehicle frame.
    """
    windows = _windows(knots, state)

    def parts(t_s: FloatArray) -> list[slice]:
        return [slice(int(a), int(b)) for a, b in np.searchsorted(t_s, windows)]

    def relief(turns: FloatArray) -> FloatArray:
        return _relief_in_both_halves(returns, parts(returns.t_s), knots, state, sensor_m, turns)

    def shares(upright: UprightReturns, cell_m: float, turns: FloatArray) -> FloatArray:
        """(n, turns) share of upright returns that both halves of the scans have in one place."""
        out, cells = [], _no_cells(WIDE_GRID)
        for part in parts(upright.t_s):
            vehicle, half = np.asarray(upright.xyz_m[part], np.float64), np.array(upright.half[part], np.int64)
            if len(half) >= MIN_YAW_UPRIGHT:
                where = _origins_and_arms(np.array(upright.t_s[part]), vehicle, knots, state, sensor_m)
                sums = turned_halves(*where, np.zeros(len(half)), half, turns, 1.0 / cell_m, *cells)
                out.append(2.0 * sums[:, 2] / len(half))
        return np.array(out).reshape(-1, len(turns))

    def crop(turns: FloatArray) -> FloatArray:
        """The same of all, less that half a turn away, where rows of plants and the vehicle's body are as they are."""
        both = shares(returns.standing, PLANT_CELL_M, np.concatenate([turns, turns + np.pi]))
        return both[:, : len(turns)] - both[:, len(turns) :]

    walls = partial(shares, returns.upright, UPRIGHT_CELL_M)
    for measure, least in ((relief, MIN_RELIEF_M**2), (walls, MIN_UPRIGHT_SHARE), (crop, MIN_PLANT_SHARE)):
        found = _answer(measure, least)
        if found is not None:
            return found
    return Facing()


def _answer(measure: Measure, least: float) -> Facing | None:
    """The one angle that the windows show; None where none stands out, or it is not certain enough."""
    measured = measure(np.linspace(0.0, 2.0 * np.pi, TRIED_YAWS, endpoint=False))
    if len(measured) < MIN_CONFIRMING_WINDOWS:
        return None
    mean = measured.mean(axis=0)
    best = int(np.argmax(mean))
    if mean[best] - np.median(mean) < least:
        return None
    second, rise = _second_peak(mean, best)
    if mean[best] - mean.min() < YAW_UNIQUE_RATIO * rise or (
        rise > 0.0 and not _better(measured, best, second, YAW_SHOWN_SIGMAS)
    ):
        return None
    angle, sigma = _refined(measure, 360.0 / TRIED_YAWS * best)
    near = best in (0, 1, TRIED_YAWS - 1)
    enough = len(measured) >= MIN_YAW_WINDOWS
    if abs(angle) <= max(MIN_YAW_OFFSET_DEG, YAW_SHOWN_SIGMAS * sigma) or (near and not enough):
        return Facing(0.0, shown=True)
    return Facing(angle, shown=True) if enough and (near or _better(measured, best, 0, YAW_CERTAIN_SIGMAS)) else None


def _second_peak(mean: FloatArray, best: int) -> tuple[int, float]:
    """The angle that rises most above the dip, the shallower one, that parts it from the best; and by how much."""
    there = np.roll(mean, -best)
    rise = there - np.maximum(np.minimum.accumulate(there), np.minimum.accumulate(there[::-1])[::-1])
    second = int(np.argmax(rise))
    return (best + second) % TRIED_YAWS, float(rise[second])


def _better(measured: FloatArray, best: int, other: int, sigmas: float) -> bool:
    """Whether one angle is better than another by so many standard deviations of the windows' mean."""
    better = measured[:, best] - measured[:, other]
    return bool(better.mean() > sigmas * better.std(ddof=1) / np.sqrt(len(better)))


def _refined(measure: Measure, angle_deg: float) -> tuple[float, float]:
    """The angle, −180 to 180, and its sigma, in degrees, at which most repeats, near one that is about right.

    A parabola through angles round it is fitted twice; the sigma is the jackknife's over windows (Efron 1982).
    """
    off = np.linspace(-YAW_FINE_REACH_DEG, YAW_FINE_REACH_DEG, FINE_YAWS)
    for _ in range(2):
        fitted = np.polyfit(off, measure(np.radians(angle_deg + off)).T, 2)
        curved, sloped = np.column_stack([whole := fitted.sum(axis=1), whole[:, None] - fitted])[:2]
        vertex = np.clip(-0.5 * sloped / np.minimum(curved, -1e-30), off[0], off[-1])
        angle_deg += float(vertex[0])
    sigma = float(np.sqrt((len(vertex) - 2) * vertex[1:].var()))
    quarter = 90.0 * round(angle_deg / 90.0)
    angle_deg = quarter if quarter % 360.0 and abs(angle_deg - quarter) < QUARTER_TURN_REACH_DEG else angle_deg
    return 180.0 - (180.0 - angle_deg) % 360.0, sigma


def _windows(knots: Knots, state: State) -> FloatArray:
    """(k, 2) times of the windows, evenly chosen of all."""
    found = []
    for chain in knots.chains:
        part = slice(chain.first, chain.first + chain.count)
        way = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(state.xyz_m[part, :2], axis=0).T))])
        cuts = knots.t_s[part][np.searchsorted(way, np.arange(0.0, way[-1], YAW_WINDOW_WAY_M))]
        found += [(a, b) for a, b in pairwise(cuts.tolist()) if b - a < MAX_YAW_WINDOW_S]
    chosen = np.unique(np.linspace(0, len(found) - 1, MAX_YAW_WINDOWS).astype(int)) if found else ()
    return np.array([found[k] for k in chosen]).reshape(-1, 2)


def _relief_in_both_halves(
    returns: GroundReturns, parts: list[slice], knots: Knots, state: State, sensor_m: FloatArray, turns: FloatArray
) -> FloatArray:
    """(n, turns) relief (m²) that both halves of the scans show in each window that has enough returns."""
    side = round(2.0 * MAX_HALVES_RANGE_M / STATIC_CELL_M)
    windows = []
    static = np.zeros((side * side, 2))
    for part in parts:
        part = slice(part.start, part.stop, max(1, (part.stop - part.start) // MAX_YAW_RETURNS))
        vehicle = np.asarray(returns.xyz_m[part], np.float64)
        near = np.hypot(vehicle[:, 0], vehicle[:, 1]) < MAX_HALVES_RANGE_M
        if near.sum() < MIN_YAW_RETURNS:
            continue
        vehicle = vehicle[near]
        t_s = np.array(returns.t_s[part])[near]
        half = np.array(returns.half[part], np.int64)[near]
        relief = relief_of_scans(vehicle, half)
        column, row = ((vehicle[:, :2].T + MAX_HALVES_RANGE_M) / STATIC_CELL_M).astype(np.int64)
        cell = column + side * row
        static += np.column_stack([np.bincount(cell, values, len(static)) for values in (relief, None)])
        windows.append((t_s, vehicle, half, relief, cell))
    mean = static[:, 0] / np.maximum(static[:, 1], 1.0)
    out = np.empty((len(windows), len(turns)))
    cells = _no_cells(COUNT_GRID)
    for k, (t_s, vehicle, half, relief, cell) in enumerate(windows):
        where = _origins_and_arms(t_s, vehicle, knots, state, sensor_m)
        sums = turned_halves(*where, relief - mean[cell], half, turns, 1.0 / HALVES_CELL_M, *cells)
        out[k] = sums[:, 0] / np.maximum(sums[:, 2], 1.0)
    return out


def _origins_and_arms(
    t_s: FloatArray, vehicle_m: FloatArray, knots: Knots, state: State, sensor_m: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """(n, 2) where the sensor is at each return (n,), and the way from it to the return, both on the map."""
    k, share, _ = knots.at(t_s)
    # Straight from knot to knot, as complex numbers: easting + i northing.
    plan = state.xyz_m[:, 0] + 1j * state.xyz_m[:, 1]
    forward = state.rotation[:, 0, 0] + 1j * state.rotation[:, 1, 0]
    origin, course = (v[k] + share * (v[k + 1] - v[k]) for v in (plan, forward))
    course /= np.abs(course)
    sensor = complex(sensor_m[0], sensor_m[1])
    both = origin + sensor * course, (vehicle_m[:, 0] + 1j * vehicle_m[:, 1] - sensor) * course
    return both[0].view(np.float64).reshape(-1, 2), both[1].view(np.float64).reshape(-1, 2)


def _no_cells(side: int) -> tuple[NDArray[np.int64], FloatArray]:
    """(2, side, side) counts and sums of values of both halves, all zero; cells further apart share one."""
    return np.zeros((2, side, side), np.int64), np.zeros((2, side, side))


@kernel()
def turned_halves(origin_m, arm_m, value, half, turns, per_m, count, total):  # type: ignore[no-untyped-def]
    """(k, 3) :func:`sum_of_halves` of returns (n,) at their origin plus their arm, both (n, 2), turned by angles (k,).

    `value` (n,) is summed; `count` and `total` as :func:`_no_cells`.
    """
    mask = count.shape[1] - 1
    touched = np.empty((len(half), 2), np.int64)
    out = np.empty((len(turns), 3))
    for number in range(len(turns)):
        used = 0
        cos = np.cos(turns[number])
        sin = np.sin(turns[number])
        for i in range(len(half)):
            a = int(np.floor((origin_m[i, 0] + cos * arm_m[i, 0] - sin * arm_m[i, 1]) * per_m)) & mask
            b = int(np.floor((origin_m[i, 1] + sin * arm_m[i, 0] + cos * arm_m[i, 1]) * per_m)) & mask
            used = take_into_cell(a, b, half[i], value[i], touched, used, count, total)
        out[number, 0], out[number, 1], out[number, 2] = sum_of_halves(touched, used, count, total)
    return out


@kernel_part()
def take_into_cell(a, b, half, value, touched, used, count, total):  # type: ignore[no-untyped-def]
    """Count a return of a half, and its value, in a cell; returns how many cells are `touched` (n, 2) then."""
    if count[0, a, b] == 0 and count[1, a, b] == 0:
        touched[used, 0] = a
        touched[used, 1] = b
        used += 1
    count[half, a, b] += 1
    total[half, a, b] += value
    return used


@kernel_part()
def sum_of_halves(touched, used, count, total):  # type: ignore[no-untyped-def]
    """Products of both halves' means, their mean squares, and returns of the smaller half, over `used` touched cells.

    The first two are weighted by the third. Counts and sums (2, side, side) are set back to zero.
    """
    product = squares = together = 0.0
    for i in range(used):
        a = touched[i, 0]
        b = touched[i, 1]
        both = min(count[0, a, b], count[1, a, b])
        if both > 0:
            one = total[0, a, b] / count[0, a, b]
            other = total[1, a, b] / count[1, a, b]
            product += both * one * other
            squares += 0.5 * both * (one * one + other * other)
            together += both
        for layer in range(2):
            count[layer, a, b] = 0
            total[layer, a, b] = 0.0
    return product, squares, together


def relief_of_scans(vehicle_m: FloatArray, half: NDArray[np.int64]) -> FloatArray:
    """Heights (n,) above each scan's own slope and bow, the largest ones cut; 0 in scans of few returns."""
    out = np.zeros(len(half))
    # Halves alternate from scan to scan.
    for part in np.split(np.arange(len(half)), np.flatnonzero(np.diff(half)) + 1):
        if len(part) < MIN_YAW_SCAN_RETURNS:
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
