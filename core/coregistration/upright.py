"""What stands on a field on a date (faces of walls and fences, and posts), and the shift and turn between two dates.

Points well above the ground are counted into upright columns. A column whose points lie along a line in plan, over a
good part of its height, is a piece of a face; its normal is the direction in which they scatter least (as in
:mod:`furrowmap.core.matching.walls`). A small group of points with nothing around it is a post. Crowns, hedges and
crops fill their columns and are neither.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import binary_dilation, distance_transform_edt, find_objects, label
from scipy.spatial import cKDTree

from furrowmap.core.crops.bare_soil import OUTLIER_SIGMAS
from furrowmap.core.runtime.arrays import FloatArray, IntArray

STANDING_M: Final = (0.3, 2.5)
"""Range of heights above the ground: below is straw, above are crowns."""
UPRIGHT_COLUMN_M: Final = 0.5
MIN_COLUMN_POINTS: Final = 16
MIN_FACE_HEIGHT_M: Final = 0.4
MIN_FACE_LENGTH_M: Final = 0.06
"""Standard deviation of points along a face; half a metre of wall has 0.14 m."""
MAX_FACE_THICKNESS_M: Final = 0.05
MAX_FACE_SLIMNESS: Final = 0.35
"""A face is no thicker (standard deviation) than MAX_FACE_THICKNESS_M and this share of its length."""
MAX_POST_M: Final = 0.5
"""Width of a post."""
FACE_NOISE_M: Final = 0.008
"""Standard deviation of a piece of a face at least."""
POST_SIGMA_M: Final = 0.006
POST_SHARE: Final = 0.2
"""The middle of what is seen of a post depends on the viewing direction: by this share of its points' deviation."""
ALIKE_POINTS: Final = 20.0
"""Points of a face that share an error."""
MATCHED_M: Final = (0.1, 0.5)
"""Places of one thing on two dates are matched within three standard deviations of the receivers, between these."""
MAX_ALONG_M: Final = 0.4
"""Between the middles of two pieces of one face, along it."""
MIN_NORMAL_COSINE: Final = math.cos(math.radians(12.0))
THING_M: Final = 8.0
"""Pieces of a face within squares of this side share an error."""
SHARED_M: Final = 0.005
"""Standard deviation of that: the slow error of receivers during a session."""
MIN_PLACE_SIGMA_M: Final = 0.003
"""Standard deviation of a shift in place at least, however much stands."""
_PIXEL_M: Final = 0.1


@dataclass(frozen=True)
class Upright:
    """Places of what stands.

    Attributes:
        xy_m: (n, 2) easting and northing of the middle of the points.
        normal: (n, 2) level unit normal of a face, whichever way; nan for a post.
        sigma_m: (n,) standard deviation along the normal; of a post in any direction.
    """

    xy_m: FloatArray
    normal: FloatArray
    sigma_m: FloatArray

    def __len__(self) -> int:
        return len(self.xy_m)

    def at(self, which: NDArray[np.bool_] | IntArray) -> "Upright":
        """Some of them."""
        return Upright(self.xy_m[which], self.normal[which], self.sigma_m[which])


def join_uprights(parts: Sequence[Upright]) -> Upright:
    """All of the parts."""
    every = [Upright(np.zeros((0, 2)), np.zeros((0, 2)), np.zeros(0)), *parts]
    return Upright(*(np.concatenate([getattr(part, name) for part in every]) for name in vars(every[0])))


def find_uprights(xyz_m: FloatArray, ground: NDArray[np.bool_]) -> Upright:
    """Faces and posts among the points (n, 3) of a piece of a field, without those of the vehicle and its tool."""
    if not ground.any() or ground.all():
        return join_uprights([])
    corner = xyz_m[:, :2].min(axis=0)
    xyz = xyz_m - [*corner, 0.0]
    others = xyz[~ground]
    above = others[:, 2] - _ground_below(xyz[ground], others)
    high = others[(above > STANDING_M[0]) & (above < STANDING_M[1])]
    if not len(high):
        return join_uprights([])
    # columns of a second grid hold walls that lie along the edges of the first
    parts = [_faces(high, offset) for offset in (0.0, 0.5 * UPRIGHT_COLUMN_M)]
    found = join_uprights([*parts, _posts(high, join_uprights(parts))])
    return Upright(found.xy_m + corner, found.normal, found.sigma_m)


def _ground_below(ground: FloatArray, others: FloatArray) -> FloatArray:
    """Height of the ground within 5 m of each of the others, by cells of a metre; nan where there is none."""
    most = np.maximum(ground[:, :2].max(axis=0), others[:, :2].max(axis=0))
    shape = tuple(most.astype(int) + 1)
    count = np.zeros(shape)
    total = np.zeros(shape)
    at = tuple(ground[:, :2].astype(int).T)
    np.add.at(count, at, 1.0)
    np.add.at(total, at, ground[:, 2])
    with np.errstate(invalid="ignore", divide="ignore"):
        height = total / count
    far, nearest = distance_transform_edt(count == 0, return_indices=True)
    height = np.where(far <= 5, height[tuple(nearest)], np.nan)
    out: FloatArray = height[tuple(others[:, :2].astype(int).T)]
    return out


def _faces(high: FloatArray, offset_m: float) -> Upright:
    """A piece of a face for each column whose points lie along a line."""
    cell = np.floor((high[:, :2] + offset_m) / UPRIGHT_COLUMN_M).astype(np.int64)
    order = np.lexsort(cell.T)
    cell = cell[order]
    point = high[order]
    begin = np.flatnonzero(np.r_[True, (np.diff(cell, axis=0) != 0).any(axis=1)])
    count = np.diff(np.r_[begin, len(cell)]).astype(np.float64)
    middle = (cell[begin] + 0.5) * UPRIGHT_COLUMN_M - offset_m
    e, n = (point[:, :2] - np.repeat(middle, count.astype(int), axis=0)).T
    me, mn, ee, en, nn = (np.add.reduceat(v, begin) / count for v in (e, n, e * e, e * n, n * n))
    ee = ee - me**2
    en = en - me * mn
    nn = nn - mn**2
    half = np.hypot(0.5 * (ee - nn), en)
    along = 0.5 * (ee + nn) + half
    across = np.maximum(0.5 * (ee + nn) - half, 0.0)
    tall = np.maximum.reduceat(point[:, 2], begin) - np.minimum.reduceat(point[:, 2], begin)
    direction = 0.5 * np.arctan2(2.0 * en, ee - nn)
    normal = np.column_stack([-np.sin(direction), np.cos(direction)])
    # a wall along the border of two columns is cut in half lengthwise
    reach = 3.0 * np.hypot(np.sqrt(across), FACE_NOISE_M)[:, None] * np.abs(normal)
    whole = (np.abs(np.column_stack([me, mn])) + reach <= 0.5 * UPRIGHT_COLUMN_M).all(axis=1)
    good = (count >= MIN_COLUMN_POINTS) & (tall >= MIN_FACE_HEIGHT_M) & whole
    good &= along >= MIN_FACE_LENGTH_M**2
    good &= across <= np.minimum(MAX_FACE_THICKNESS_M**2, MAX_FACE_SLIMNESS**2 * along)
    sigma = np.sqrt((across + FACE_NOISE_M**2) / np.maximum(count / ALIKE_POINTS, 1.0))
    return Upright(middle + np.column_stack([me, mn]), normal, sigma).at(good)


def _posts(high: FloatArray, faces: Upright) -> Upright:
    """Small groups of points that are no pieces of faces."""
    pixel = (high[:, :2] // _PIXEL_M).astype(np.int64) + 1
    shape = pixel.max(axis=0) + 2
    there: NDArray[np.bool_] = np.zeros(shape, bool)
    there[tuple(pixel.T)] = True
    around = binary_dilation(there, np.ones((3, 3), bool))
    groups = np.asarray(label(around, np.ones((3, 3), int))[0], np.int64)
    most = MAX_POST_M / _PIXEL_M + 4  # dilated, and cut by pixels
    small = np.array([False, *[max(s.stop - s.start for s in box) <= most for box in find_objects(groups)]])
    if len(faces):
        small[groups[tuple((faces.xy_m // _PIXEL_M).astype(np.int64).T + 1)]] = False
    of_point = groups[tuple(pixel.T)]
    of_point[~small[of_point]] = 0
    order = np.argsort(of_point, kind="stable")
    order = order[np.searchsorted(of_point[order], 1) :]
    if not len(order):
        return join_uprights([])
    point = high[order]
    begin = np.flatnonzero(np.r_[True, np.diff(of_point[order]) != 0])
    points = np.diff(np.r_[begin, len(point)])
    mean = np.add.reduceat(point[:, :2], begin) / points[:, None]
    off = ((point[:, :2] - np.repeat(mean, points, axis=0)) ** 2).sum(axis=1)
    spread = np.sqrt(np.add.reduceat(off, begin) / points)
    tall = np.maximum.reduceat(point[:, 2], begin) - np.minimum.reduceat(point[:, 2], begin)
    least = np.minimum.reduceat(point[:, :2], begin)
    greatest = np.maximum.reduceat(point[:, :2], begin)
    good = (points >= MIN_COLUMN_POINTS) & (tall >= MIN_FACE_HEIGHT_M) & ((greatest - least) <= MAX_POST_M).all(axis=1)
    sigma = np.hypot(POST_SIGMA_M, POST_SHARE * spread)
    return Upright(mean, np.full((len(mean), 2), np.nan), sigma).at(good)


@dataclass(frozen=True)
class UprightTie:
    """What moves the second date's things onto those of the first.

    Attributes:
        place: (3,) east, north (m), counter-clockwise turn about the middle of the field (rad).
        information: (3, 3) inverse of its covariance; singular where they do not show it all.
        used_m: (m, 2) places of the pieces of faces, and posts, that both dates saw.
        moved_m: (k, 2) of those that are elsewhere on the second date, and do not count.
    """

    place: FloatArray
    information: FloatArray
    used_m: FloatArray
    moved_m: FloatArray

    def all_moved(self) -> "UprightTie":
        """A tie in which all of them moved, and none counts."""
        moved = np.concatenate([self.used_m, self.moved_m])
        return UprightTie(np.zeros(3), np.zeros((3, 3)), np.zeros((0, 2)), moved)


def tie_uprights(one: Upright, other: Upright, middle_m: FloatArray, place_sigma: FloatArray) -> UprightTie | None:
    """Match what stands on two dates, point to line, and solve for the move; None if they have nothing in common.

    Things that moved, such as parked vehicles, contradict the others, or the positions of the receivers, and count ever
    less (the weights of Geman and McClure), from three standard deviations on not at all. `place_sigma` (3,) are
    standard deviations of the move before: east, north (m), turn (rad).
    """
    place: FloatArray = np.zeros(3)
    known = np.diag(place_sigma**2)
    reach_m = min(max(OUTLIER_SIGMAS * float(np.hypot(*place_sigma[:2])), MATCHED_M[0]), MATCHED_M[1])
    found = _match(one, other, middle_m, place, reach_m)
    for _ in range(12):
        if found is None:
            return None
        # before anything is known, what the receivers leave open is no contradiction
        leeway = np.einsum("ij,jk,ik->i", found.design, known, found.design)
        away = (found.off_m - found.design @ place) / np.sqrt(found.alone_m2 + leeway)
        weight = 1.0 / (1.0 + (away / OUTLIER_SIGMAS) ** 2) ** 2 / found.variance_m2
        normal = found.design.T @ (found.design * weight[:, None])
        right = found.design.T @ (found.off_m * weight)
        known = np.linalg.inv(normal + np.diag(1.0 / place_sigma**2))
        place = known @ right
        found = _match(one, other, middle_m, place, reach_m)
    return None if found is None else _solve_move(found, place, middle_m)


@dataclass(frozen=True)
class _Matches:
    """m equations of the move."""

    design: FloatArray  # (m, 3) what east, north and turn change
    off_m: FloatArray  # (m,) by which the second date's things are off
    alone_m2: FloatArray  # (m,) variance of that
    variance_m2: FloatArray  # (m,) with the error that pieces of one thing share
    xy_m: FloatArray  # (m, 2) places on the second date


def _solve_move(found: _Matches, place: FloatArray, middle_m: FloatArray) -> UprightTie:
    """The move by what agrees with `place`, and its information by how well."""
    away = (found.off_m - found.design @ place) / np.sqrt(found.alone_m2)
    kept = np.abs(away) <= OUTLIER_SIGMAS
    moved = np.unique(found.xy_m[~kept], axis=0)
    used = np.unique(found.xy_m[kept], axis=0)
    used = used[~(used[:, None] == moved).all(axis=2).any(axis=1)]  # a post has two equations
    # turns in units that move the farthest thing by a metre, so that all three are alike
    scale = np.array([1.0, 1.0, 1.0 / max(float(np.hypot(*(found.xy_m - middle_m).T).max()), 1.0)])
    design = found.design[kept] * scale
    weight = 1.0 / found.variance_m2[kept]
    normal = design.T @ (design * weight[:, None])
    right = design.T @ (found.off_m[kept] * weight)
    place = scale * (np.linalg.pinv(normal, rcond=1e-6, hermitian=True) @ right)
    normal /= max(float(np.mean(away[kept] ** 2)) if kept.any() else 1.0, 1.0)
    # a floor under the standard deviations, though some directions may not be seen (Woodbury)
    normal -= normal @ np.linalg.inv(normal + np.eye(3) / MIN_PLACE_SIGMA_M**2) @ normal
    return UprightTie(place, normal / np.outer(scale, scale), used, moved)


def _match(one: Upright, other: Upright, middle_m: FloatArray, place: FloatArray, reach_m: float) -> _Matches | None:
    """Faces with the nearest ones of the same direction, an equation each; posts with the nearest ones, two each."""
    parts = []
    for faces in (True, False):
        a, b = (each.at(np.isfinite(each.normal[:, 0]) == faces) for each in (one, other))
        if not len(a) or not len(b):
            continue
        east, north = (b.xy_m - middle_m).T
        moved = b.xy_m + place[:2] + place[2] * np.column_stack([-north, east])
        far, found = cKDTree(a.xy_m).query(moved, distance_upper_bound=math.hypot(reach_m, MAX_ALONG_M))
        distance = np.asarray(far, np.float64)
        nearest = np.asarray(found, np.int64)
        there = np.flatnonzero(np.isfinite(distance))
        a, b, left = a.at(nearest[there]), b.at(there), a.xy_m[nearest[there]] - moved[there]
        good = distance[there] <= reach_m
        variance = a.sigma_m**2 + b.sigma_m**2
        directions = [np.tile(axis, (len(there), 1)) for axis in np.eye(2)]
        if faces:
            same = np.einsum("ij,ij->i", a.normal, b.normal)
            normal = a.normal + np.sign(same)[:, None] * b.normal
            normal /= np.linalg.norm(normal, axis=1)[:, None]
            across = np.abs(np.einsum("ij,ij->i", left, normal))
            along = np.sqrt(np.maximum((left**2).sum(axis=1) - across**2, 0.0))
            good = (np.abs(same) >= MIN_NORMAL_COSINE) & (along <= MAX_ALONG_M) & (across <= reach_m)
            variance += along**2 * (1.0 - same**2)
            directions = [normal]
        if good.any():
            parts += [_equations(a.at(good), b.at(good), d[good], variance[good], middle_m) for d in directions]
    if not parts:
        return None
    return _Matches(*(np.concatenate([getattr(part, name) for part in parts]) for name in vars(parts[0])))


def _equations(
    one: Upright, other: Upright, direction: FloatArray, variance_m2: FloatArray, middle_m: FloatArray
) -> _Matches:
    """One for each of n things in a direction (n, 2); pieces of one thing share an error."""
    east, north = (other.xy_m - middle_m).T
    design = np.column_stack([direction, direction[:, 1] * east - direction[:, 0] * north])
    off = np.einsum("ij,ij->i", one.xy_m - other.xy_m, direction)
    _, thing, count = np.unique(np.floor(other.xy_m / THING_M), axis=0, return_inverse=True, return_counts=True)
    shared = count[thing.ravel()] * SHARED_M**2
    return _Matches(design, off, variance_m2 + SHARED_M**2, variance_m2 + shared, other.xy_m)
