"""Ground classification of a cloud, square by square: simple morphological filter, or cloth simulation filter."""

import math
import os
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from importlib.util import find_spec
from typing import Final, Literal, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.ndimage import distance_transform_edt, grey_opening, map_coordinates

from furrowmap.core.runtime.arrays import FloatArray
from furrowmap.core.runtime.errors import InputError, MissingExtraError
from furrowmap.core.runtime.languages.texts import Text
from furrowmap.core.surfaces.breaklines import point_spacing_m, with_breaklines
from furrowmap.core.surfaces.gaps import filled

_SHORT: Final = 1 << 16
_BESIDE: Final = [(i, j) for i in (-1.0, 0.0, 1.0) for j in (-1.0, 0.0, 1.0) if i or j]


@dataclass(frozen=True)
class PointTile:
    """A square of the map: the indices of its points (m,), and these followed by those in the margin (k,)."""

    own: NDArray[np.intp]
    members: NDArray[np.intp]


def tiles(
    xyz_m: NDArray[np.float64], tile_m: float, margin_m: float, asked: NDArray[np.bool_] | None = None
) -> Iterator[PointTile]:
    """The squares that hold finite points (n, 2 or 3), each with the points in a margin of at most its side.

    With `asked` (n,) only those that hold such a point.
    """
    if not 0.0 <= margin_m <= tile_m:
        raise ValueError(f"a margin of {margin_m} m round squares of {tile_m} m")
    if not len(xyz_m):
        return
    (columns, column), (rows, row) = (_number_values(np.floor(axis / tile_m)) for axis in xyz_m[:, :2].T)
    key = column * len(rows) + row
    if len(columns) * len(rows) <= _SHORT:
        key = key.astype(np.uint16)  # numpy sorts short numbers by their digits, several times as fast
    order = np.argsort(key, kind="stable")
    keys, first = np.unique(key[order], return_index=True)
    squares = [(float(columns[k // len(rows)]), float(rows[k % len(rows)])) for k in keys.tolist()]
    parts = dict(zip(squares, np.split(order, first[1:]), strict=True))
    for (x, y), own in parts.items():
        if asked is not None and not asked[own].any():
            continue
        beside = [parts[x + i, y + j] for i, j in _BESIDE if (x + i, y + j) in parts]
        around = np.concatenate(beside) if beside else np.zeros(0, np.intp)
        low = np.array([x, y]) * tile_m - margin_m
        within = np.all((xyz_m[around, :2] >= low) & (xyz_m[around, :2] < low + tile_m + 2.0 * margin_m), axis=1)
        yield PointTile(own, np.concatenate([own, around[within]]))


def _number_values(place: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.intp]]:
    """Sorted unique values, and the index (n,) of each value among them."""
    low = place.min()
    if place.max() - low < _SHORT:
        step = (place - low).astype(np.intp)
        there = np.bincount(step) > 0
        return np.flatnonzero(there) + low, (np.cumsum(there) - 1)[step]
    levels, number = np.unique(place, return_inverse=True)
    return levels, number


GroundMethod = Literal["smrf", "csf"]

FILTER_TILE_M: Final = 128.0
PIT_SLOPE: Final = 5.0
"""A cell below its neighbours by more than this slope is an error (Pingel: 500 %)."""
PIT_SPACINGS: Final = 3
"""Errors form clusters up to twice as many spacings wide."""
REACH_PART: Final = 8
"""Windows grow by this part of themselves, or by a cell."""
CLOTH_RELIEF_M: Final = 500.0
"""Points farther than this from the median height are not ground and are not passed to the library."""
CLOTH_M: Final = 0.5
"""Cloth resolution: follows furrows and ditches, but not a tractor."""
CLOTH_THRESHOLD_M: Final = 0.15
MAX_CLOTH_EXTENT_M: Final = 2_000.0
_ONE_AT_A_TIME: Final = threading.Lock()


@dataclass(frozen=True)
class Smrf:
    """Parameters of the simple morphological filter (SMRF), named as in section 2 of the paper.

    T. J. Pingel, K. C. Clarke, W. A. McBride (2013), An improved simple morphological filter for the terrain
    classification of airborne LIDAR data, ISPRS Journal of Photogrammetry and Remote Sensing 77, 21-30, with square
    windows instead of disks (separable, so at constant cost), gaps filled by harmonic interpolation instead of springs,
    and :func:`with_breaklines` after it.

    Attributes:
        cell_m: of the surface of lowest heights.
        slope: steepest slope of the ground, as a ratio.
        window_m: half the width of the widest object.
        threshold_m: greatest distance of ground points from the surface.
        scale: added to that, times the slope of the surface.
    """

    cell_m: float = 0.5
    slope: float = 0.15
    window_m: float = 25.0
    threshold_m: float = 0.15
    scale: float = 1.25

    def __post_init__(self) -> None:
        if not all(math.isfinite(value) and value > 0.0 for value in (self.cell_m, self.slope, self.window_m)):
            raise ValueError(f"SMRF needs a cell, a slope and a window above zero: {self}")


def classify_ground(
    xyz_m: ArrayLike, method: GroundMethod = "smrf", smrf: Smrf | None = None, asked: NDArray[np.bool_] | None = None
) -> NDArray[np.bool_]:
    """Which points (n,) are ground, computed in overlapping squares of 128 m.

    Args:
        xyz_m: (n, 3) easting, northing, height; points that are not finite are not ground.
        method: "smrf", the simple morphological filter of Pingel et al. (2013); "csf", the cloth simulation filter of
            Zhang et al. (2016), which requires the extra `csf`.
        asked: (n,) the points to classify, None for all; squares without any are skipped.

    Raises:
        InputError: if the method is unknown, or its library not installed.
    """
    if method not in get_args(GroundMethod):
        raise InputError("bad-ground-method", method=method, groundmethod=", ".join(get_args(GroundMethod)))
    xyz = np.asarray(xyz_m, np.float64)
    if xyz.ndim != 2 or xyz.shape[1] != 3:
        raise ValueError(f"points of shape {xyz.shape}, not (n, 3)")
    known = np.flatnonzero(np.isfinite(xyz).all(axis=1))
    ground = np.zeros(len(xyz), bool)
    filter_ = smrf if smrf is not None else Smrf()
    if method == "csf":
        require_cloth()
    finite = xyz if len(known) == len(xyz) else xyz[known]
    wanted = asked[known] if asked is not None else None
    for tile in tiles(finite, FILTER_TILE_M, min(2.0 * filter_.window_m, FILTER_TILE_M), wanted):
        part = finite[tile.members]
        found = smrf_ground(part, filter_) if method == "smrf" else cloth_ground(part)
        ground[known[tile.own]] = found[: len(tile.own)]
    return ground


def smrf_ground(xyz_m: FloatArray, filter_: Smrf) -> NDArray[np.bool_]:
    """Which points (n, 3), at least one, of one square are ground."""
    corner = np.floor(xyz_m[:, :2].min(axis=0) / filter_.cell_m) * filter_.cell_m
    place = (xyz_m[:, :2] - corner) / filter_.cell_m
    cell = np.floor(place).astype(np.intp)
    shape = cell.max(axis=0) + 1
    lowest = np.full(shape.prod(), np.inf)
    np.minimum.at(lowest, cell[:, 0] * shape[1] + cell[:, 1], xyz_m[:, 2])
    lowest = np.where(np.isinf(lowest), np.nan, lowest).reshape(shape)
    ground = ground_cells(lowest, filter_)
    if not ground.any():
        return np.zeros(len(xyz_m), bool)
    surface = filled(np.where(ground, lowest, np.nan))
    steps = [np.gradient(surface, filter_.cell_m, axis=k) if surface.shape[k] > 1 else 0.0 * surface for k in (0, 1)]
    at = place.T - 0.5
    height = map_coordinates(surface, at, order=1, mode="nearest")
    slope = map_coordinates(np.hypot(*steps), at, order=1, mode="nearest")
    near: NDArray[np.bool_] = np.abs(xyz_m[:, 2] - height) <= filter_.threshold_m + filter_.scale * slope
    return near


def ground_cells(lowest_m: FloatArray, filter_: Smrf) -> NDArray[np.bool_]:
    """Which cells (rows, columns) are ground by their lowest heights `lowest_m`; False where these are nan."""
    seen = np.isfinite(lowest_m)
    if not seen.any():
        return seen
    spacing_m = max(point_spacing_m(seen, filter_.cell_m), filter_.cell_m)
    pits = seen & _pits(lowest_m, spacing_m, filter_.cell_m)
    if pits.all():
        return seen & ~pits
    standing = np.zeros(lowest_m.shape, bool)
    last = from_nearest(np.where(pits, np.nan, lowest_m))
    for reach in _reaches(math.ceil(filter_.window_m / filter_.cell_m)):
        opened = _opened(last, reach)
        standing |= last - opened > filter_.slope * reach * filter_.cell_m
        last = opened
    return with_breaklines(lowest_m, seen & ~pits & ~standing, filter_.cell_m)


def _reaches(most: int) -> list[int]:
    """Increasing reaches of windows in cells."""
    reaches = [1]
    while reaches[-1] < most:
        reaches.append(min(reaches[-1] + max(1, reaches[-1] // REACH_PART), most))
    return reaches


def _pits(lowest_m: FloatArray, spacing_m: float, cell_m: float) -> NDArray[np.bool_]:
    """Cells far below all around: single points and clusters up to some spacings of the points wide."""
    upside_down = -from_nearest(lowest_m)
    pits = np.zeros(lowest_m.shape, bool)
    for spacings in range(1, PIT_SPACINGS + 1):
        reach = round(spacings * spacing_m / cell_m)
        pits |= upside_down - _opened(upside_down, reach) > PIT_SLOPE * reach * cell_m
    return pits


def from_nearest(height_m: FloatArray) -> FloatArray:
    """Heights with gaps filled from the nearest cell; at least one is finite."""
    gaps = np.isnan(height_m)
    if not gaps.any():
        return height_m
    nearest = distance_transform_edt(gaps, return_distances=False, return_indices=True)
    taken: FloatArray = height_m[tuple(nearest)]
    return taken


def _opened(surface_m: FloatArray, reach: int) -> FloatArray:
    """Morphological opening with a square that reaches this many cells to each side."""
    opened: FloatArray = grey_opening(surface_m, size=(2 * reach + 1,) * 2, mode="nearest")
    return opened


def require_cloth() -> None:
    """Raises InputError if the library is not installed."""
    if find_spec("CSF") is None:
        raise MissingExtraError(
            "cloth-simulation-filter",
            "csf",
            Text("Ground by 'csf' is classified by it."),
            otherwise=Text("use the method 'smrf'"),
        )


def cloth_ground(xyz_m: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Which points (n, 3), all finite and within 2 km, are ground; none with fewer than 10 points.

    By the cloth simulation filter (CSF): W. Zhang, J. Qi, P. Wan, H. Wang, D. Xie, X. Wang, G. Yan (2016), An
    easy-to-use airborne LiDAR data filtering method based on cloth simulation, Remote Sensing 8 (6), 501. The authors'
    library prints to standard output and aborts the process on nan and on distant points, so its input is checked and
    its output redirected. Points more than 500 m from the median height are not ground.
    """
    ground = np.zeros(len(xyz_m), bool)
    if not len(xyz_m):
        return ground
    if not np.isfinite(xyz_m).all() or np.any(np.ptp(xyz_m[:, :2], axis=0) > MAX_CLOTH_EXTENT_M):
        raise ValueError(f"points that are not finite, or further apart than {MAX_CLOTH_EXTENT_M} m")
    within = np.flatnonzero(np.abs(xyz_m[:, 2] - np.median(xyz_m[:, 2])) < CLOTH_RELIEF_M)
    if len(within) < 10:
        return ground
    import CSF

    cloth = CSF.CSF()
    cloth.params.bSloopSmooth = False
    cloth.params.cloth_resolution = CLOTH_M
    cloth.params.class_threshold = CLOTH_THRESHOLD_M
    cloth.params.rigidness = 2
    points = xyz_m[within]
    cloth.setPointCloud(points - points.mean(axis=0))
    found = CSF.VecInt()
    rest = CSF.VecInt()
    with _ONE_AT_A_TIME, _output_to_stderr():
        cloth.do_filtering(found, rest, exportCloth=False)
    ground[within[np.array(found, np.intp)]] = True
    return ground


@contextmanager
def _output_to_stderr() -> Iterator[None]:
    """Redirect file descriptor 1 to standard error, for output of native code."""
    sys.stdout.flush()
    kept = os.dup(1)
    try:
        os.dup2(2, 1)
        yield
    finally:
        os.dup2(kept, 1)
        os.close(kept)
