"""What stands on a field on a date: faces of walls and fences, and posts, as places in plan.

Points well above the ground are counted into upright columns. A column whose points lie along a line in plan, over a
good part of its height, is a piece of a face; its normal is the direction in which they scatter least (as in
:mod:`furrowmap.core.matching.walls`). A small group of points with nothing around it is a post. Crowns, hedges and
crops fill their columns and are neither.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import binary_dilation, distance_transform_edt, find_objects, label

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

LOWEST_M: Final = 0.3
HIGHEST_M: Final = 2.5
"""Heights above the ground: below is straw, above are crowns."""
COLUMN_M: Final = 0.5
LEAST_POINTS: Final = 16
LEAST_HEIGHT_M: Final = 0.4
LEAST_LENGTH_M: Final = 0.06
"""Standard deviation of points along a face; half a metre of wall has 0.14 m."""
THICKEST_M: Final = 0.05
SLIMMEST: Final = 0.35
"""A face is no thicker (standard deviation) than THICKEST_M and this share of its length."""
POST_M: Final = 0.5
"""Width of a post at most."""
NOISE_M: Final = 0.008
"""Standard deviation of a piece of a face at least."""
POST_SIGMA_M: Final = 0.006
POST_SHARE: Final = 0.2
"""The middle of what is seen of a post depends on whence: by this share of the standard deviation of its points."""
ALIKE_POINTS: Final = 20.0
"""So many points of a face share an error."""
_PIXEL_M: Final = 0.1
_GROUND_M: Final = 1.0
_FAR_CELLS: Final = 5


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

    def at(self, which: NDArray[np.bool_] | IntArray) -> Upright:
        """Some of them."""
        return Upright(self.xy_m[which], self.normal[which], self.sigma_m[which])


def together(parts: Sequence[Upright]) -> Upright:
    """All of the parts."""
    none = Upright(np.zeros((0, 2)), np.zeros((0, 2)), np.zeros(0))
    every = [none, *parts]
    return Upright(
        np.concatenate([part.xy_m for part in every]),
        np.concatenate([part.normal for part in every]),
        np.concatenate([part.sigma_m for part in every]),
    )


def upright(xyz_m: FloatArray, ground: NDArray[np.bool_]) -> Upright:
    """Faces and posts among the points of a piece of a field.

    Args:
        xyz_m: (n, 3) points without those of the vehicle and its tool.
        ground: (n,) which of them are ground.
    """
    if not ground.any() or ground.all():
        return together([])
    corner = xyz_m[:, :2].min(axis=0)
    xyz = xyz_m - [*corner, 0.0]
    others = xyz[~ground]
    above = others[:, 2] - _ground_below(xyz[ground], others)
    high = others[(above > LOWEST_M) & (above < HIGHEST_M)]
    if not len(high):
        return together([])
    # columns of a second grid hold walls that lie along the edges of the first
    parts = [_faces(high, offset) for offset in (0.0, 0.5 * COLUMN_M)]
    found = together([*parts, _posts(high, together(parts))])
    return Upright(found.xy_m + corner, found.normal, found.sigma_m)


def _ground_below(ground: FloatArray, others: FloatArray) -> FloatArray:
    """Height of the ground near each of the others; nan where none is near."""
    most = np.maximum(ground[:, :2].max(axis=0), others[:, :2].max(axis=0))
    shape = tuple((most // _GROUND_M).astype(int) + 1)
    count, total = np.zeros(shape), np.zeros(shape)
    at = tuple((ground[:, :2] // _GROUND_M).astype(int).T)
    np.add.at(count, at, 1.0)
    np.add.at(total, at, ground[:, 2])
    with np.errstate(invalid="ignore", divide="ignore"):
        height = total / count
    far, nearest = distance_transform_edt(count == 0, return_indices=True)
    height = np.where(far <= _FAR_CELLS, height[tuple(nearest)], np.nan)
    out: FloatArray = height[tuple((others[:, :2] // _GROUND_M).astype(int).T)]
    return out


def _faces(high: FloatArray, offset_m: float) -> Upright:
    """A piece of a face for each column whose points lie along a line."""
    cell = np.floor((high[:, :2] + offset_m) / COLUMN_M).astype(np.int64)
    order = np.lexsort(cell.T)
    cell, point = cell[order], high[order]
    begin = np.flatnonzero(np.r_[True, (np.diff(cell, axis=0) != 0).any(axis=1)])
    count = np.diff(np.r_[begin, len(cell)]).astype(np.float64)
    middle = (cell[begin] + 0.5) * COLUMN_M - offset_m
    e, n = (point[:, :2] - np.repeat(middle, count.astype(int), axis=0)).T
    me, mn, ee, en, nn = (np.add.reduceat(v, begin) / count for v in (e, n, e * e, e * n, n * n))
    ee, en, nn = ee - me**2, en - me * mn, nn - mn**2
    half = np.hypot(0.5 * (ee - nn), en)
    along, across = 0.5 * (ee + nn) + half, np.maximum(0.5 * (ee + nn) - half, 0.0)
    tall = np.maximum.reduceat(point[:, 2], begin) - np.minimum.reduceat(point[:, 2], begin)
    direction = 0.5 * np.arctan2(2.0 * en, ee - nn)
    normal = np.column_stack([-np.sin(direction), np.cos(direction)])
    # a wall along the border of two columns is cut in half lengthwise
    reach = 3.0 * np.hypot(np.sqrt(across), NOISE_M)[:, None] * np.abs(normal)
    whole = (np.abs(np.column_stack([me, mn])) + reach <= 0.5 * COLUMN_M).all(axis=1)
    good = (count >= LEAST_POINTS) & (tall >= LEAST_HEIGHT_M) & whole
    good &= (along >= LEAST_LENGTH_M**2) & (across <= np.minimum(THICKEST_M**2, SLIMMEST**2 * along))
    sigma = np.sqrt((across + NOISE_M**2) / np.maximum(count / ALIKE_POINTS, 1.0))
    return Upright(middle + np.column_stack([me, mn]), normal, sigma).at(good)


def _posts(high: FloatArray, faces: Upright) -> Upright:
    """Small groups of points that are no pieces of faces."""
    pixel = (high[:, :2] // _PIXEL_M).astype(np.int64) + 1
    shape = pixel.max(axis=0) + 2
    there: NDArray[np.bool_] = np.zeros(shape, bool)
    there[tuple(pixel.T)] = True
    around = binary_dilation(there, np.ones((3, 3), bool))
    groups = np.asarray(label(around, np.ones((3, 3), int))[0], np.int64)
    most = POST_M / _PIXEL_M + 4  # dilated, and cut by pixels
    small = np.array([False, *[max(s.stop - s.start for s in box) <= most for box in find_objects(groups)]])
    if len(faces):
        small[groups[tuple((faces.xy_m // _PIXEL_M).astype(np.int64).T + 1)]] = False
    of_point = groups[tuple(pixel.T)]
    of_point[~small[of_point]] = 0
    order = np.argsort(of_point, kind="stable")
    order = order[np.searchsorted(of_point[order], 1) :]
    if not len(order):
        return together([])
    point = high[order]
    begin = np.flatnonzero(np.r_[True, np.diff(of_point[order]) != 0])
    points = np.diff(np.r_[begin, len(point)])
    mean = np.add.reduceat(point[:, :2], begin) / points[:, None]
    off = ((point[:, :2] - np.repeat(mean, points, axis=0)) ** 2).sum(axis=1)
    spread = np.sqrt(np.add.reduceat(off, begin) / points)
    tall = np.maximum.reduceat(point[:, 2], begin) - np.minimum.reduceat(point[:, 2], begin)
    least, greatest = np.minimum.reduceat(point[:, :2], begin), np.maximum.reduceat(point[:, :2], begin)
    good = (points >= LEAST_POINTS) & (tall >= LEAST_HEIGHT_M) & ((greatest - least) <= POST_M).all(axis=1)
    sigma = np.hypot(POST_SIGMA_M, POST_SHARE * spread)
    return Upright(mean, np.full((len(mean), 2), np.nan), sigma).at(good)
