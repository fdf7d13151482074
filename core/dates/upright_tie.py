"""The shift in place and the turn between two dates that walls and posts show."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from furrowmap.core.dates.upright import Upright

FloatArray = NDArray[np.float64]

FARTHEST_M: Final = 0.5
NEAREST_M: Final = 0.1
"""Places of one thing on two dates are matched within three standard deviations of the receivers, between these."""
ALONG_M: Final = 0.4
"""Middles of two pieces of one face, along it."""
SAME_NORMAL: Final = math.cos(math.radians(12.0))
THING_M: Final = 8.0
"""Pieces of a face within squares of this side share an error."""
SHARED_M: Final = 0.005
"""Standard deviation of that: the slow error of receivers during a session."""
FLOOR_M: Final = 0.003
"""Standard deviation of a shift in place at least, however much stands."""
REJECTED: Final = 3.0
ROUNDS: Final = 12


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

    def disbelieved(self) -> UprightTie:
        """Itself, if all of it moved."""
        moved = np.concatenate([self.used_m, self.moved_m])
        return UprightTie(np.zeros(3), np.zeros((3, 3)), np.zeros((0, 2)), moved)


def upright_tie(one: Upright, other: Upright, middle_m: FloatArray, place_sigma: FloatArray) -> UprightTie | None:
    """Match what stands on two dates, point to line, and solve for the move; None if they have nothing in common.

    Things that moved, such as parked vehicles, contradict the others, or the positions of the receivers, and count
    ever less (the weights of Geman and McClure), from three standard deviations on not at all.

    Args:
        one: what stands on the first date.
        other: on the second.
        middle_m: (2,) that turns are about.
        place_sigma: (3,) standard deviations of the move before: east, north (m), turn (rad).
    """
    place: FloatArray = np.zeros(3)
    known = np.diag(place_sigma**2)
    reach_m = min(max(REJECTED * float(np.hypot(*place_sigma[:2])), NEAREST_M), FARTHEST_M)
    found = _matches(one, other, middle_m, place, reach_m)
    for _ in range(ROUNDS):
        if found is None:
            return None
        # before anything is known, what the receivers leave open is no contradiction
        leeway = np.einsum("ij,jk,ik->i", found.design, known, found.design)
        away = (found.off_m - found.design @ place) / np.sqrt(found.alone_m2 + leeway)
        weight = 1.0 / (1.0 + (away / REJECTED) ** 2) ** 2 / found.variance_m2
        normal = found.design.T @ (found.design * weight[:, None])
        right = found.design.T @ (found.off_m * weight)
        known = np.linalg.inv(normal + np.diag(1.0 / place_sigma**2))
        place = known @ right
        found = _matches(one, other, middle_m, place, reach_m)
    return None if found is None else _solved(found, place, middle_m)


@dataclass(frozen=True)
class _Matches:
    """Equations of the move.

    Attributes:
        design: (m, 3) what east, north and turn change.
        off_m: (m,) by which the second date's things are off.
        alone_m2: (m,) variance of that.
        variance_m2: (m,) so much larger that pieces of one thing together have the error that they share.
        xy_m: (m, 2) places on the second date.
    """

    design: FloatArray
    off_m: FloatArray
    alone_m2: FloatArray
    variance_m2: FloatArray
    xy_m: FloatArray


def _solved(found: _Matches, place: FloatArray, middle_m: FloatArray) -> UprightTie:
    """The move by what agrees with `place`, and its information by how well."""
    away = (found.off_m - found.design @ place) / np.sqrt(found.alone_m2)
    kept = np.abs(away) <= REJECTED
    moved, used = np.unique(found.xy_m[~kept], axis=0), np.unique(found.xy_m[kept], axis=0)
    used = used[~(used[:, None] == moved).all(axis=2).any(axis=1)]  # a post has two equations
    # turns in units that move the farthest thing by a metre, so that all three are alike
    scale = np.array([1.0, 1.0, 1.0 / max(float(np.hypot(*(found.xy_m - middle_m).T).max()), 1.0)])
    design, weight = found.design[kept] * scale, 1.0 / found.variance_m2[kept]
    normal = design.T @ (design * weight[:, None])
    right = design.T @ (found.off_m[kept] * weight)
    place = scale * (np.linalg.pinv(normal, rcond=1e-6, hermitian=True) @ right)
    normal /= max(float(np.mean(away[kept] ** 2)) if kept.any() else 1.0, 1.0)
    # a floor under the standard deviations, though some directions may not be seen (Woodbury)
    normal -= normal @ np.linalg.inv(normal + np.eye(3) / FLOOR_M**2) @ normal
    return UprightTie(place, normal / np.outer(scale, scale), used, moved)


def _matches(one: Upright, other: Upright, middle_m: FloatArray, place: FloatArray, reach_m: float) -> _Matches | None:
    """Faces with the nearest ones of the same direction, an equation each; posts with the nearest ones, two each."""
    parts = []
    for faces in (True, False):
        a, b = (each.at(np.isfinite(each.normal[:, 0]) == faces) for each in (one, other))
        if not len(a) or not len(b):
            continue
        east, north = (b.xy_m - middle_m).T
        moved = b.xy_m + place[:2] + place[2] * np.column_stack([-north, east])
        far, found = cKDTree(a.xy_m).query(moved, distance_upper_bound=math.hypot(reach_m, ALONG_M))
        distance, nearest = np.asarray(far, np.float64), np.asarray(found, np.int64)
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
            good = (np.abs(same) >= SAME_NORMAL) & (along <= ALONG_M) & (across <= reach_m)
            variance += along**2 * (1.0 - same**2)
            directions = [normal]
        if good.any():
            parts += [_equations(a.at(good), b.at(good), d[good], variance[good], middle_m) for d in directions]
    if not parts:
        return None
    return _Matches(
        np.concatenate([part.design for part in parts]),
        np.concatenate([part.off_m for part in parts]),
        np.concatenate([part.alone_m2 for part in parts]),
        np.concatenate([part.variance_m2 for part in parts]),
        np.concatenate([part.xy_m for part in parts]),
    )


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
