"""A tie of two dates: by how much the second one's surface is off the first one's, by the ground that both saw."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from scipy.ndimage import uniform_filter

from furrowmap.core.coregistration.upright import UprightTie
from furrowmap.core.crops.bare_soil import OUTLIER_SIGMAS, HeightCovariance, SoilCells, likely_covariances, plane_design
from furrowmap.core.runtime.arrays import Float32Array, FloatArray
from furrowmap.core.runtime.kernels import kernel

TIE_PATCH_M: Final = 1.0
"""Side of the patches."""
MIN_PATCH_CELLS: Final = 60
PATCH_SUMS: Final = 14
MAX_SLOPE: Final = 1.0
"""Steeper cells are rims of things that stand."""


@dataclass(frozen=True)
class GroundPair:
    """A piece of ground on two dates: (rows, columns) float32 heights, nan where unknown or touched by a tool since."""

    west_m: float
    north_m: float
    cell_m: float
    one: Float32Array
    other: Float32Array


@dataclass(frozen=True)
class DifferencePatches:
    """Sums over the common cells of patches.

    Attributes:
        count: (p,) cells.
        xy_m: (p, 2) mean easting and northing.
        difference_m: (p,) mean height on the second date less that on the first.
        variance_m2: (p,) of the differences in a patch.
        relief: (p, 2, 2) sums of slopes on one date times slopes on the other, by easting and northing, about their
            means; its expectation is that of the relief that both saw, without their noise.
        seen_m: (p, 2) sums of mean slopes times differences, likewise.
    """

    count: FloatArray
    xy_m: FloatArray
    difference_m: FloatArray
    variance_m2: FloatArray
    relief: FloatArray
    seen_m: FloatArray

    def __len__(self) -> int:
        return len(self.count)


def smooth_pair(pair: GroundPair, cells: int) -> GroundPair:
    """A piece whose heights are means over squares of so many cells a side, of those that are known."""
    if cells == 1:
        return pair
    return GroundPair(pair.west_m, pair.north_m, pair.cell_m, _mean(pair.one, cells), _mean(pair.other, cells))


def _mean(height: Float32Array, cells: int) -> Float32Array:
    known = np.isfinite(height)
    base = np.float32(np.median(height[known])) if known.any() else np.float32(0.0)
    share = uniform_filter(known.astype(np.float32), cells, mode="constant")
    total = uniform_filter(np.where(known, height - base, np.float32(0.0)), cells, mode="constant")
    with np.errstate(invalid="ignore", divide="ignore"):
        out: Float32Array = np.where(known, total / share + base, np.float32(np.nan)).astype(np.float32)
    return out


def sum_differences(
    pairs: Sequence[GroundPair], middle_m: FloatArray, shift: FloatArray, trend: FloatArray, limit_m: float
) -> DifferencePatches:
    """Sum up differences, the second date's surface moved by a shift.

    Args:
        middle_m: (2,) easting and northing that turns are about.
        shift: (3,) by which the second date's surface is moved east and north (m), and turned counter-clockwise (rad).
        trend: (3,) differences that are expected: at the middle (m), and their change per metre east and north.
        limit_m: cells whose difference is farther from that do not count.
    """
    parts = [np.zeros((0, PATCH_SUMS))]
    for pair in pairs:
        rows, columns = pair.one.shape
        side = max(round(TIE_PATCH_M / pair.cell_m), 1)
        across = -(-columns // side)
        parts.append(np.zeros((-(-rows // side) * across, PATCH_SUMS)))
        west = pair.west_m - middle_m[0]
        north = pair.north_m - middle_m[1]
        _sum(pair.one, pair.other, west, north, pair.cell_m, shift, trend, limit_m, side, across, parts[-1])
    sums = np.concatenate(parts)
    sums = sums[sums[:, 0] >= MIN_PATCH_CELLS]
    n = sums[:, 0]
    x, y, r, square, ax, ay, bx, by = (sums[:, 1:9] / n[:, None]).T
    xx, xy, yy, rx, ry = (sums[:, 9:] / n[:, None]).T
    cross = xy - 0.5 * (ax * by + ay * bx)
    relief = np.stack([np.stack([xx - ax * bx, cross], -1), np.stack([cross, yy - ay * by], -1)], -2)
    seen = np.stack([rx - 0.5 * (ax + bx) * r, ry - 0.5 * (ay + by) * r], -1)
    return DifferencePatches(
        n,
        np.stack([x, y], -1) + middle_m,
        r,
        np.maximum(square - r**2, 0.0),
        relief * n[:, None, None],
        seen * n[:, None],
    )


@kernel()
def _sum(one, other, west, north, cell, shift, trend, limit, side, across, sums):  # type: ignore[no-untyped-def]
    """Sums: cells, east, north, difference, its square, slopes (4), their products (3), and with differences (2)."""
    rows, columns = one.shape
    for i in range(1, rows - 1):
        y = north - (i + 0.5) * cell
        for j in range(1, columns - 1):
            a = one[i, j]
            if not np.isfinite(a):
                continue
            x = west + (j + 0.5) * cell
            # the moved surface at (x, y) is that which was measured at (x, y) less the shift
            u = j - (shift[0] - shift[2] * y) / cell
            v = i + (shift[1] + shift[2] * x) / cell
            p = int(np.floor(v))
            q = int(np.floor(u))
            if p < 1 or q < 1 or p + 2 >= rows or q + 2 >= columns:
                continue
            fv = v - p
            fu = u - q
            b = gx = gy = 0.0
            for k in range(2):
                for m in range(2):
                    w = (fv if k else 1.0 - fv) * (fu if m else 1.0 - fu)
                    b += w * other[p + k, q + m]
                    gx += w * (other[p + k, q + m + 1] - other[p + k, q + m - 1])
                    gy += w * (other[p + k - 1, q + m] - other[p + k + 1, q + m])
            # products of the slopes of one date with those of the other: noise of neither biases the shift
            bx = gx / (2.0 * cell)
            by = gy / (2.0 * cell)
            ax = (one[i, j + 1] - one[i, j - 1]) / (2.0 * cell)
            ay = (one[i - 1, j] - one[i + 1, j]) / (2.0 * cell)
            gx = 0.5 * (ax + bx)
            gy = 0.5 * (ay + by)
            r = b - a
            if not (np.isfinite(r) and np.isfinite(gx) and np.isfinite(gy)) or gx * gx + gy * gy > MAX_SLOPE**2:
                continue
            if abs(r - trend[0] - trend[1] * x - trend[2] * y) > limit:
                continue
            s = sums[(i // side) * across + j // side]
            s[0] += 1.0
            s[1] += x
            s[2] += y
            s[3] += r
            s[4] += r * r
            s[5] += ax
            s[6] += ay
            s[7] += bx
            s[8] += by
            s[9] += ax * bx
            s[10] += 0.5 * (ax * by + ay * bx)
            s[11] += ay * by
            s[12] += gx * r
            s[13] += gy * r


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
    shown = place
    found = None
    limit_m = MAX_DIFFERENCE_M
    reach_m = max((math.dist((p.west_m, p.north_m), middle_m) for p in here), default=1.0)
    before = np.diag(1.0 / place_sigma**2)
    aimed = np.zeros(3)
    if upright is not None:
        before = before + upright.information
        aimed = upright.information @ upright.place
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
    one = np.ones(len(found))
    none = np.zeros(len(found))
    turn = np.stack([np.stack([one, none, -y], -1), np.stack([none, one, x], -1)], -2)
    normal = np.einsum("pki,pkl,plj->pij", turn, found.relief, turn)
    right = np.einsum("pki,pk->pi", turn, found.seen_m)
    calm = found.variance_m2 <= OUTLIER_SIGMAS**2 * np.median(found.variance_m2)
    # turns in units that move the farthest patch by a metre, so that all three are alike
    scale = np.array([1.0, 1.0, 1.0 / max(float(np.hypot(x, y).max()), 1.0)])
    normal = normal * np.outer(scale, scale)
    right = right * scale
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
    move = np.zeros(6)
    information = np.zeros((6, 6))
    move[LEVEL_TERMS] = -trend
    move[PLACE_TERMS] = place
    information[np.ix_(LEVEL_TERMS, LEVEL_TERMS)] = np.linalg.inv(covariance)
    information[np.ix_(PLACE_TERMS, PLACE_TERMS)] = of_place
    scatter = math.sqrt(float(np.median(found.variance_m2)))
    return PairTie(move, information, int(found.count.sum()), len(found), departures, likely[0][1], scatter)


def tie_points(xy_m: FloatArray, above_m: FloatArray, sigma_m: FloatArray, middle_m: FloatArray) -> PairTie | None:
    """Tie a surface to surveyed points (n, 2), in height and, by three or more that do not lie in a row, in tilt.

    `above_m` (n,) is the height of the surface less that of the point, `sigma_m` (n,) its standard deviation. Returns
    what moves the surface onto the points; None without points.
    """
    if not len(above_m):
        return None
    design = plane_design(xy_m, middle_m)
    weight = 1.0 / np.maximum(sigma_m, 1e-4) ** 2
    normal = design.T @ (design * weight[:, None])
    scale = np.sqrt(np.maximum(np.diag(normal), 1e-12))
    inverse = np.linalg.pinv(normal / np.outer(scale, scale), rcond=1e-9, hermitian=True)
    trend = inverse @ (design.T @ (weight * above_m) / scale) / scale
    move = np.zeros(6)
    information = np.zeros((6, 6))
    move[LEVEL_TERMS] = -trend
    information[np.ix_(LEVEL_TERMS, LEVEL_TERMS)] = normal
    departures = SoilCells(xy_m, above_m - design @ trend, sigma_m)
    none = HeightCovariance(0.0, 1.0, 0.0)
    sigma = float(np.median(sigma_m))
    return PairTie(move, information, len(above_m), len(above_m), departures, none, sigma)
