"""A tie of two dates: by how much the second one's surface is off the first one's, by the ground that both saw."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from furrowmap.core.crops.soil import OUTLIER_SIGMAS, HeightCovariance, SoilCells, likely_covariances, plane_design
from furrowmap.core.dates.ground_pair import DifferencePatches, GroundPair, smooth_pair, sum_differences
from furrowmap.core.dates.upright import UprightTie
from furrowmap.core.runtime.arrays import FloatArray

MOVE_NAMES: Final = ("east_m", "north_m", "height_m", "tilt_east", "tilt_north", "turn_rad")
"""What moves a surface: east, north and up; its rise per metre east and north; counter-clockwise turn."""
LEVEL_TERMS: Final = np.array([2, 3, 4])
PLACE_TERMS: Final = np.array([0, 1, 5])
MIN_TIE_PATCHES: Final = 12
TREND_PATCHES: Final = 600
RELIEF_PATCHES: Final = 300
SMOOTHING_CELLS: Final = (7, 5, 3, *8 * (1,))
"""Sides of the squares over which heights are averaged, one estimate after the other: a shift may exceed a clod."""
CONVERGED_M: Final = 1e-4
"""Step of the shift below which the iteration ends."""
MIN_SHIFT_SIGMA_M: Final = 0.001
"""Standard deviation of a shift in place at least: heights of cells as large as clods are no exact picture of them."""
MIN_RELIEF_RATIO: Final = 3.0
"""The relief that both dates saw determines a shift if its sum over patches is so many times that of chance."""
MAX_CONTRADICTION: Final = 3.0
"""Difference from the place that relief shows, in standard deviations, above which walls do not count."""
MIN_PROBABILITY: Final = 0.01
"""Covariances that are less probable do not count."""
MAX_DIFFERENCE_M: Final = 0.30


@dataclass(frozen=True)
class PairTie:
    """What moves the second date's surface onto that of the first.

    Attributes:
        move: (6,) in the order of :data:`MOVE_NAMES`, about the middle of the field.
        information: (6, 6) inverse of its covariance; with zeros where the ground shows nothing.
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
    departure: HeightCovariance
    scatter_m: float
    upright: UprightTie | None = None


def tie_pair(
    pairs: Sequence[GroundPair], middle_m: FloatArray, place_sigma: FloatArray, upright: UprightTie | None = None
) -> PairTie | None:
    """Tie two dates; None if they have too little ground in common.

    The shift in place is estimated from the relief within patches by least squares, each patch by itself a witness
    (sandwich covariance). Offset and tilt are those of a plane through the means of patches. What these
    depart from it is correlated from patch to patch, as they show themselves (restricted likelihood): the slow
    errors of receivers bend a surface, and many cells of one neighbourhood say little about the next. The covariance
    of the plane is that of least squares under that correlation, averaged over those that are likely. Walls and posts
    add what they show of the place, unless they contradict the relief: then they moved, or are others.

    Args:
        place_sigma: (3,) standard deviations of the shift east and north (m) and of the turn (rad) before; the place is
            looked for within them where the ground shows little.
        upright: what walls and posts show of the place.
    """
    here = [p for p in pairs if np.isfinite(p.one).any() and np.isfinite(p.other).any()]
    apart = [(pair.other - pair.one)[::3, ::3] for pair in here]
    known = np.concatenate([np.zeros(0), *[a[np.isfinite(a)] for a in apart]])
    place: FloatArray = np.zeros(3)
    trend: FloatArray = np.array([float(np.median(known)) if len(known) else 0.0, 0.0, 0.0])
    shown, found, limit_m = place, None, MAX_DIFFERENCE_M
    reach_m = max((math.dist((p.west_m, p.north_m), middle_m) for p in here), default=1.0)
    before, aimed = np.diag(1.0 / place_sigma**2), np.zeros(3)
    if upright is not None:
        before, aimed = before + upright.information, upright.information @ upright.place
    for cells in SMOOTHING_CELLS:
        smooth = [smooth_pair(pair, cells) for pair in here]
        found = sum_differences(smooth, middle_m, place, trend, limit_m)
        if len(found) < MIN_TIE_PATCHES:
            return None
        trend = _fit_plane(found, middle_m)
        # of the differences of cells from the plane, little moved by patches that changed
        off = found.difference_m - plane_design(found.xy_m, middle_m) @ trend
        within = math.sqrt(float(np.median(found.variance_m2)))
        scatter = math.hypot(1.4826 * float(np.median(np.abs(off))), within)
        limit_m = min(limit_m, max(OUTLIER_SIGMAS * scatter, 0.005))
        step, information = _solve_place(found, middle_m)
        shown = place + step
        step = np.asarray(np.linalg.solve(information + before, information @ step + aimed - before @ place))
        place += step
        if cells == 1 and np.abs(step * [1.0, 1.0, reach_m]).max() < CONVERGED_M:
            break
    assert found is not None
    if upright is not None:
        if _contradiction(shown, information, upright) > MAX_CONTRADICTION:
            without = tie_pair(pairs, middle_m, place_sigma)
            return None if without is None else replace(without, upright=upright.all_moved())
        information = information + upright.information
    return replace(_complete_tie(found, middle_m, place, information), upright=upright)


def _contradiction(shown: FloatArray, information: FloatArray, upright: UprightTie) -> float:
    """Difference of the places that relief and walls show, where both do, over its standard deviation (RMS)."""
    both = information @ np.linalg.pinv(information + upright.information, hermitian=True) @ upright.information
    seen = int(np.linalg.matrix_rank(information, hermitian=True))
    apart = upright.place - shown
    return math.sqrt(max(float(apart @ both @ apart), 0.0) / max(seen, 1))


def _fit_plane(found: DifferencePatches, middle_m: FloatArray) -> FloatArray:
    """A plane through the differences, least absolute ones by reweighting."""
    design = plane_design(found.xy_m, middle_m)
    weight = np.sqrt(found.count)
    for _ in range(8):
        trend = np.linalg.lstsq(design * weight[:, None], found.difference_m * weight)[0]
        off = np.abs(found.difference_m - design @ trend)
        weight = np.sqrt(found.count / np.maximum(off, 0.001))
    return np.asarray(trend, np.float64)


def _solve_place(found: DifferencePatches, middle_m: FloatArray) -> tuple[FloatArray, FloatArray]:
    """The shift and turn that is left (3,), and its information (3, 3) by the scatter among patches."""
    x, y = (found.xy_m - middle_m).T
    one, none = np.ones(len(found)), np.zeros(len(found))
    turn = np.stack([np.stack([one, none, -y], -1), np.stack([none, one, x], -1)], -2)
    normal = np.einsum("pki,pkl,plj->pij", turn, found.relief, turn)
    right = np.einsum("pki,pk->pi", turn, found.seen_m)
    calm = found.variance_m2 <= OUTLIER_SIGMAS**2 * np.median(found.variance_m2)
    # turns in units that move the farthest patch by a metre, so that all three are alike
    scale = np.array([1.0, 1.0, 1.0 / max(float(np.hypot(x, y).max()), 1.0)])
    normal, right = normal * np.outer(scale, scale), right * scale
    total = normal[calm].sum(axis=0)
    value, axis = np.linalg.eigh(total)
    by_patch = np.einsum("ik,pij,jk->pk", axis, normal[calm], axis)
    clear = value > MIN_RELIEF_RATIO * np.sqrt((by_patch**2).sum(axis=0))
    inverse = (axis[:, clear] / value[clear]) @ axis[:, clear].T
    shown = axis[:, clear] @ axis[:, clear].T
    step = inverse @ right[calm].sum(axis=0)
    score = right[calm] - normal[calm] @ step
    count = np.count_nonzero(calm)
    covariance = inverse @ (score.T @ score) @ inverse * count / max(count - 3, 1) + np.eye(3) * MIN_SHIFT_SIGMA_M**2
    information = shown @ np.linalg.inv(covariance) @ shown / np.outer(scale, scale)
    return step * scale, information


def _complete_tie(found: DifferencePatches, middle_m: FloatArray, place: FloatArray, of_place: FloatArray) -> PairTie:
    """Offset and tilt, and all together."""
    noise = np.sqrt(found.variance_m2 / found.count)
    cells = SoilCells(found.xy_m, found.difference_m, noise)
    off = found.difference_m - plane_design(found.xy_m, middle_m) @ _fit_plane(found, middle_m)
    even = np.abs(off) <= max(OUTLIER_SIGMAS * 1.4826 * float(np.median(np.abs(off))), 1e-4)
    cells = cells.at(even).thinned(TREND_PATCHES)
    likely = likely_covariances([cells.thinned(RELIEF_PATCHES)])
    design = plane_design(cells.xy_m, middle_m)
    inverse = np.linalg.pinv(design)
    trend = inverse @ cells.height_m
    covariance = np.zeros((3, 3))
    for probability, departure in likely:
        if probability > MIN_PROBABILITY:
            lower, _ = departure.factor(cells)
            spread = inverse @ np.tril(lower)
            covariance += probability * spread @ spread.T
    departures = SoilCells(cells.xy_m, cells.height_m - design @ trend, cells.sigma_m)
    move, information = np.zeros(6), np.zeros((6, 6))
    move[LEVEL_TERMS], move[PLACE_TERMS] = -trend, place
    information[np.ix_(LEVEL_TERMS, LEVEL_TERMS)] = np.linalg.inv(covariance)
    information[np.ix_(PLACE_TERMS, PLACE_TERMS)] = of_place
    scatter = math.sqrt(float(np.median(found.variance_m2)))
    return PairTie(move, information, int(found.count.sum()), len(found), departures, likely[0][1], scatter)


def tie_points(xy_m: FloatArray, above_m: FloatArray, sigma_m: FloatArray, middle_m: FloatArray) -> PairTie | None:
    """Tie a surface to surveyed points (n, 2), in height and, by three or more that do not lie in a row, in tilt.

    Args:
        above_m: (n,) height of the surface less that of the point.
        sigma_m: (n,) standard deviations of these.

    Returns:
        What moves the surface onto the points; None without points.
    """
    if not len(above_m):
        return None
    design = plane_design(xy_m, middle_m)
    weight = 1.0 / np.maximum(sigma_m, 1e-4) ** 2
    normal = design.T @ (design * weight[:, None])
    scale = np.sqrt(np.maximum(np.diag(normal), 1e-12))
    inverse = np.linalg.pinv(normal / np.outer(scale, scale), rcond=1e-9, hermitian=True)
    trend = inverse @ (design.T @ (weight * above_m) / scale) / scale
    move, information = np.zeros(6), np.zeros((6, 6))
    move[LEVEL_TERMS] = -trend
    information[np.ix_(LEVEL_TERMS, LEVEL_TERMS)] = normal
    departures = SoilCells(xy_m, above_m - design @ trend, sigma_m)
    none, sigma = HeightCovariance(0.0, 1.0, 0.0), float(np.median(sigma_m))
    return PairTie(move, information, len(above_m), len(above_m), departures, none, sigma)
