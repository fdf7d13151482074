"""A tie of two dates: by how much the second one's surface is off the first one's, by the ground that both saw."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from furrowmap.core.crops.soil import Relief, covariance_factor, fewer, relief_of
from furrowmap.core.crops.soil_cells import SoilCells
from furrowmap.core.dates.ground_pair import GroundPair, Patches, patches, smoothed
from furrowmap.core.dates.upright_tie import UprightTie

FloatArray = NDArray[np.float64]

NAMES: Final = ("east_m", "north_m", "height_m", "tilt_east", "tilt_north", "turn_rad")
"""What moves a surface: east, north and up; its rise per metre east and north; counter-clockwise turn."""
LEVEL: Final = np.array([2, 3, 4])
PLACE: Final = np.array([0, 1, 5])
FEWEST_PATCHES: Final = 12
TREND_PATCHES: Final = 600
RELIEF_PATCHES: Final = 300
REJECTED: Final = 3.0
"""Differences of so many robust standard deviations do not count."""
SMOOTHED: Final = (7, 5, 3, *8 * (1,))
"""Cells a side of the means whose shift is estimated, one after the other: a shift may be longer than a clod."""
STILL_M: Final = 1e-4
"""Step of the shift below which it is found."""
FLOOR_M: Final = 0.001
"""Standard deviation of a shift in place at least: heights of cells as large as clods are no exact picture of them."""
SHOWN: Final = 3.0
"""The relief that both dates saw shows a shift if its sum over patches is so many times that of chance."""
CONTRADICTED: Final = 3.0
"""Difference from the place that relief shows, over its standard deviation, from which on walls do not count."""
_WIDEST_M: Final = 0.30


@dataclass(frozen=True)
class PairTie:
    """What moves the second date's surface onto that of the first.

    Attributes:
        move: (6,) in the order of :data:`NAMES`, about the middle of the field.
        information: (6, 6) inverse of its covariance; with zeros where the ground shows nothing.
        cells: number of common cells.
        patches: number of patches of a square metre.
        departures: what the differences of patches depart from the move.
        departure: how they vary with distance.
        scatter_m: standard deviation of the differences of cells within patches.
        upright: what walls and posts show of the place; None if the dates have none in common.
    """

    move: FloatArray
    information: FloatArray
    cells: int
    patches: int
    departures: SoilCells
    departure: Relief
    scatter_m: float
    upright: UprightTie | None = None


def pair_tie(
    pairs: Sequence[GroundPair], middle_m: FloatArray, place_sigma: FloatArray, upright: UprightTie | None = None
) -> PairTie | None:
    """Tie two dates; None if they have too little ground in common.

    The shift in place is estimated from the relief within patches by least squares, each patch by itself a witness
    (sandwich covariance). Offset and tilt are those of a plane through the means of patches. What these
    depart from it is correlated from patch to patch, as they show themselves (restricted maximum likelihood): the slow
    errors of receivers bend a surface, and many cells of one neighbourhood say little about the next. The standard
    deviations of the plane are those of least squares under that correlation. Walls and posts add what they show of
    the place, unless they contradict the relief: then they moved, or are others.

    Args:
        pairs: pieces of the ground.
        middle_m: (2,) of the field.
        place_sigma: (3,) standard deviations of the shift east and north (m) and of the turn (rad) before; the place is
            looked for within them where the ground shows little.
        upright: what walls and posts show of the place.
    """
    place: FloatArray = np.zeros(3)
    trend: FloatArray = np.zeros(3)
    shown, found, limit_m, here = (
        place,
        None,
        _WIDEST_M,
        [p for p in pairs if np.isfinite(p.one).any() and np.isfinite(p.other).any()],
    )
    trend[0] = _middle(here)
    reach_m = max((math.dist((p.west_m, p.north_m), middle_m) for p in here), default=1.0)
    before, aimed = np.diag(1.0 / place_sigma**2), np.zeros(3)
    if upright is not None:
        before, aimed = before + upright.information, upright.information @ upright.place
    for cells in SMOOTHED:
        smooth = [smoothed(pair, cells) for pair in here]
        found = patches(smooth, middle_m, place, trend, limit_m)
        if len(found) < FEWEST_PATCHES:
            return None
        trend = _plane(found, middle_m)
        limit_m = min(limit_m, max(REJECTED * _scatter(found, middle_m, trend), 0.005))
        step, information = _place(found, middle_m)
        shown = place + step
        step = np.asarray(
            np.linalg.solve(information + before, information @ step + aimed - before @ place), np.float64
        )
        place += step
        if cells == 1 and np.abs(step * [1.0, 1.0, reach_m]).max() < STILL_M:
            break
    assert found is not None
    if upright is not None:
        if _contradiction(shown, information, upright) > CONTRADICTED:
            without = pair_tie(pairs, middle_m, place_sigma)
            return None if without is None else replace(without, upright=upright.disbelieved())
        information = information + upright.information
    return replace(_tie(found, middle_m, place, information), upright=upright)


def _contradiction(shown: FloatArray, information: FloatArray, upright: UprightTie) -> float:
    """Difference of the places that relief and walls show, where both do, over its standard deviation (RMS)."""
    both = information @ np.linalg.pinv(information + upright.information, hermitian=True) @ upright.information
    seen = int(np.linalg.matrix_rank(information, hermitian=True))
    apart = upright.place - shown
    return math.sqrt(max(float(apart @ both @ apart), 0.0) / max(seen, 1))


def _middle(pairs: Sequence[GroundPair]) -> float:
    """Median difference."""
    apart = [(pair.other - pair.one)[::3, ::3] for pair in pairs]
    known = np.concatenate([np.zeros(0), *[a[np.isfinite(a)] for a in apart]])
    return float(np.median(known)) if len(known) else 0.0


def _design(xy_m: FloatArray, middle_m: FloatArray) -> FloatArray:
    return np.column_stack([np.ones(len(xy_m)), xy_m - middle_m])


def _plane(found: Patches, middle_m: FloatArray) -> FloatArray:
    """A plane through the differences, least absolute ones by reweighting."""
    design = _design(found.xy_m, middle_m)
    weight = np.sqrt(found.count)
    for _ in range(8):
        trend = np.linalg.lstsq(design * weight[:, None], found.difference_m * weight)[0]
        off = np.abs(found.difference_m - design @ trend)
        weight = np.sqrt(found.count / np.maximum(off, 0.001))
    return np.asarray(trend, np.float64)


def _scatter(found: Patches, middle_m: FloatArray, trend: FloatArray) -> float:
    """Standard deviation of the differences of cells from a plane, little moved by patches that changed."""
    off = found.difference_m - _design(found.xy_m, middle_m) @ trend
    return math.hypot(1.4826 * float(np.median(np.abs(off))), math.sqrt(float(np.median(found.variance_m2))))


def _place(found: Patches, middle_m: FloatArray) -> tuple[FloatArray, FloatArray]:
    """The shift and turn that is left (3,), and its information (3, 3) by the scatter among patches."""
    x, y = (found.xy_m - middle_m).T
    one, none = np.ones(len(found)), np.zeros(len(found))
    turn = np.stack([np.stack([one, none, -y], -1), np.stack([none, one, x], -1)], -2)
    normal = np.einsum("pki,pkl,plj->pij", turn, found.relief, turn)
    right = np.einsum("pki,pk->pi", turn, found.seen_m)
    calm = found.variance_m2 <= REJECTED**2 * np.median(found.variance_m2)
    # turns in units that move the farthest patch by a metre, so that all three are alike
    scale = np.array([1.0, 1.0, 1.0 / max(float(np.hypot(x, y).max()), 1.0)])
    normal, right = normal * np.outer(scale, scale), right * scale
    total = normal[calm].sum(axis=0)
    value, axis = np.linalg.eigh(total)
    by_patch = np.einsum("ik,pij,jk->pk", axis, normal[calm], axis)
    clear = value > SHOWN * np.sqrt((by_patch**2).sum(axis=0))
    inverse = (axis[:, clear] / value[clear]) @ axis[:, clear].T
    shown = axis[:, clear] @ axis[:, clear].T
    step = inverse @ right[calm].sum(axis=0)
    score = right[calm] - normal[calm] @ step
    count = np.count_nonzero(calm)
    covariance = inverse @ (score.T @ score) @ inverse * count / max(count - 3, 1) + np.eye(3) * FLOOR_M**2
    information = shown @ np.linalg.inv(covariance) @ shown / np.outer(scale, scale)
    return step * scale, information


def _tie(found: Patches, middle_m: FloatArray, place: FloatArray, of_place: FloatArray) -> PairTie:
    """Offset and tilt, and all together."""
    noise = np.sqrt(found.variance_m2 / found.count)
    cells = SoilCells(found.xy_m, found.difference_m, noise)
    off = found.difference_m - _design(found.xy_m, middle_m) @ _plane(found, middle_m)
    even = np.abs(off) <= max(REJECTED * 1.4826 * float(np.median(np.abs(off))), 1e-4)
    cells = fewer(cells.at(even), TREND_PATCHES)
    departure = relief_of([fewer(cells, RELIEF_PATCHES)])
    design = _design(cells.xy_m, middle_m)
    inverse = np.linalg.pinv(design)
    trend = inverse @ cells.height_m
    lower, _ = covariance_factor(cells, departure)
    spread = inverse @ np.tril(lower)
    covariance = spread @ spread.T
    departures = SoilCells(cells.xy_m, cells.height_m - design @ trend, cells.sigma_m)
    move, information = np.zeros(6), np.zeros((6, 6))
    move[LEVEL], move[PLACE] = -trend, place
    information[np.ix_(LEVEL, LEVEL)] = np.linalg.inv(covariance)
    information[np.ix_(PLACE, PLACE)] = of_place
    scatter = math.sqrt(float(np.median(found.variance_m2)))
    return PairTie(move, information, int(found.count.sum()), len(found), departures, departure, scatter)


def points_tie(xy_m: FloatArray, above_m: FloatArray, sigma_m: FloatArray, middle_m: FloatArray) -> PairTie | None:
    """Tie a surface to surveyed points, in height and, by three or more that do not lie in a row, in tilt.

    Args:
        xy_m: (n, 2) of the points.
        above_m: (n,) height of the surface less that of the point.
        sigma_m: (n,) standard deviations of these.
        middle_m: (2,) of the field.

    Returns:
        What moves the surface onto the points; None without points.
    """
    if not len(above_m):
        return None
    design = _design(xy_m, middle_m)
    weight = 1.0 / np.maximum(sigma_m, 1e-4) ** 2
    normal = design.T @ (design * weight[:, None])
    scale = np.sqrt(np.maximum(np.diag(normal), 1e-12))
    trend = (
        np.linalg.pinv(normal / np.outer(scale, scale), rcond=1e-9, hermitian=True)
        @ (design.T @ (weight * above_m) / scale)
        / scale
    )
    move, information = np.zeros(6), np.zeros((6, 6))
    move[LEVEL] = -trend
    information[np.ix_(LEVEL, LEVEL)] = normal
    departures = SoilCells(xy_m, above_m - design @ trend, sigma_m)
    return PairTie(
        move, information, len(above_m), len(above_m), departures, Relief(0.0, 1.0, 0.0), float(np.median(sigma_m))
    )
