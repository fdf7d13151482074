"""Corners: where three planes meet, such as two walls and the ground, or two walls and a roof."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import Final

import numpy as np
from numpy.typing import NDArray

from furrowmap.core.runtime.arrays import FloatArray

CORNER_REACH_M: Final = 1.5
"""Distance from the expected corner of the returns to which planes are fitted."""
CORNER_SEARCH_M: Final = 0.5
"""Distance from it within which the corner lies."""
SIDE_TOLERANCE_M: Final = 0.04
"""Returns so near to a plane are of it."""
MIN_SIDE_RETURNS: Final = 25
MIN_THIN_SHARE: Final = 0.6
"""Share of the returns within three tolerances of a plane that are of it, at least: a third of a hedge is."""
FITS: Final = 3
MAX_SIDES: Final = 5
"""Planes that are looked for."""
TRIALS: Final = 300
"""Triples of returns that are tried for a plane: one of a plane with a quarter of the returns is missed once in 100."""
MIN_TRIPLE: Final = 0.4
"""Least volume that the normals of three planes span: 1 for right angles."""
SEED: Final = 7
"""Of the triples, which are drawn anew alike for every corner."""


@dataclass(frozen=True)
class Corner:
    """A corner.

    Attributes:
        middle_m: (3,) where its planes meet.
        sigma_m: (3,) standard deviation by the scatter of the returns about their planes.
        used: (n,) which returns are of its planes.
    """

    middle_m: FloatArray
    sigma_m: FloatArray
    used: NDArray[np.bool_]


@dataclass(frozen=True)
class _Side:
    """A plane: unit normal (3,), its product with places on it, and the returns (n,) that are of it."""

    normal: FloatArray
    level_m: float
    of_it: NDArray[np.bool_]

    def scatter_m(self, xyz_m: FloatArray) -> float:
        """Standard deviation of its returns about it."""
        above = xyz_m[self.of_it] @ self.normal - self.level_m
        return float(np.sqrt(np.sum(above**2) / max(len(above) - 3, 1)))


def find_corner(xyz_m: FloatArray) -> Corner | None:
    """The corner of the three planes with most returns that meet near the expected place; None where none do.

    The planes are found one after the other by RANSAC (Fischler and Bolles 1981, Communications of the ACM 24,
    381-395), each fitted to its returns by least squares.

    Args:
        xyz_m: (n, 3) returns relative to the expected corner.
    """
    near = np.flatnonzero(np.linalg.norm(xyz_m, axis=1) <= CORNER_REACH_M)
    found = _sides(xyz_m[near])
    best: tuple[int, tuple[_Side, ...]] | None = None
    for three in combinations(found, 3):
        returns = sum(int(side.of_it.sum()) for side in three)
        middle = _meeting(three)
        if middle is not None and np.linalg.norm(middle) <= CORNER_SEARCH_M and (best is None or returns > best[0]):
            best = returns, three
    if best is None:
        return None
    sides = _apart(xyz_m[near], best[1])
    middle = _meeting(sides) if all(side.of_it.sum() >= MIN_SIDE_RETURNS for side in sides) else None
    if middle is None:
        return None
    inverse = np.linalg.inv(np.array([side.normal for side in sides]))
    variance = np.array([_level_variance(side, xyz_m[near], middle) for side in sides])
    used = np.zeros(len(xyz_m), np.bool_)
    used[near[np.any([side.of_it for side in sides], axis=0)]] = True
    return Corner(middle, np.sqrt(inverse**2 @ variance), used)


def _meeting(sides: Sequence[_Side]) -> FloatArray | None:
    """Where three planes meet (3,); None where two of them are nearly parallel, or all to a line."""
    normals = np.array([side.normal for side in sides])
    if abs(float(np.linalg.det(normals))) < MIN_TRIPLE:
        return None
    return np.asarray(np.linalg.solve(normals, np.array([side.level_m for side in sides])), np.float64)


def _apart(xyz_m: FloatArray, sides: Sequence[_Side]) -> list[_Side]:
    """The planes, fitted to the returns that are near none of the others: near an edge returns may be of either."""
    above = np.abs(np.array([xyz_m @ side.normal - side.level_m for side in sides]))
    near = above <= 2.0 * SIDE_TOLERANCE_M
    return [_fitted(xyz_m, side.of_it & (near.sum(axis=0) == 1)) for side in sides]


def _fitted(xyz_m: FloatArray, of_it: NDArray[np.bool_]) -> _Side:
    """The plane through some returns; any plane through less than three."""
    own = xyz_m[of_it]
    if len(own) < 3:
        return _Side(np.array([0.0, 0.0, 1.0]), 0.0, of_it)
    middle = own.mean(axis=0)
    unit = np.linalg.svd(own - middle, full_matrices=False)[2][2]
    return _Side(unit, float(unit @ middle), of_it)


def _sides(xyz_m: FloatArray) -> list[_Side]:
    """Planes, those with most returns first."""
    random = np.random.default_rng(SEED)
    left = np.ones(len(xyz_m), np.bool_)
    out: list[_Side] = []
    while len(out) < MAX_SIDES and left.sum() >= MIN_SIDE_RETURNS:
        side = _best_side(xyz_m, np.flatnonzero(left), random)
        if side is None:
            break
        out.append(side)
        left &= ~side.of_it
    return out


def _best_side(xyz_m: FloatArray, left: NDArray[np.intp], random: np.random.Generator) -> _Side | None:
    """The plane with most of the returns that are left; None where it has too few."""
    triple = left[random.integers(len(left), size=(TRIALS, 3))]
    first, second, third = (xyz_m[triple[:, k]] for k in range(3))
    normal = np.cross(second - first, third - first)
    length = np.linalg.norm(normal, axis=1)
    normal = normal[length > 1e-6] / length[length > 1e-6, None]
    if not len(normal):
        return None
    level = np.einsum("ij,ij->i", normal, first[length > 1e-6])
    count = (np.abs(xyz_m[left] @ normal.T - level) <= SIDE_TOLERANCE_M).sum(axis=0)
    best = int(np.argmax(count))
    side = _Side(normal[best], float(level[best]), np.zeros(len(xyz_m), np.bool_))
    for _ in range(FITS):
        above = np.abs(xyz_m[left] @ side.normal - side.level_m)
        of_it = np.zeros(len(xyz_m), np.bool_)
        of_it[left[above <= SIDE_TOLERANCE_M]] = True
        if of_it.sum() < max(MIN_SIDE_RETURNS, MIN_THIN_SHARE * (above <= 3.0 * SIDE_TOLERANCE_M).sum()):
            return None
        side = _fitted(xyz_m, of_it)
    return side


def _level_variance(side: _Side, xyz_m: FloatArray, at_m: FloatArray) -> float:
    """Variance of a plane along its normal at a place (3,), extrapolated from its returns."""
    own = xyz_m[side.of_it]
    middle = own.mean(axis=0)
    along = np.linalg.svd(own - middle, full_matrices=False)
    reach = along[2][:2] @ (at_m - middle)
    return side.scatter_m(xyz_m) ** 2 * (1.0 / len(own) + float(np.sum((reach / along[1][:2]) ** 2)))
