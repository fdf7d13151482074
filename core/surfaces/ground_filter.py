"""The ground of a window of the map: simple morphological filter, or cloth simulation filter."""

import math
import os
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from importlib.util import find_spec
from typing import Final, Literal

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import distance_transform_edt, grey_opening

from furrowmap.core.runtime.arrays import BoolArray, FloatArray
from furrowmap.core.runtime.errors import MissingExtraError
from furrowmap.core.runtime.kernels import kernel
from furrowmap.core.runtime.languages.texts import Text
from furrowmap.core.surfaces.breaklines import point_spacing_m, with_breaklines
from furrowmap.core.surfaces.gaps import filled

GroundMethod = Literal["smrf", "csf"]

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


SMRF: Final = Smrf()


@dataclass(frozen=True)
class GroundRaster:
    """The ground of a window of the map, in square cells from the origin of the CRS.

    Attributes:
        cell_m: side of a cell.
        corner: column and row of the first cell.
        seen: (rows, columns), southernmost first; the cells in which the ground was found.
        height_m: (rows, columns) of the ground, gaps filled.
        limit_m: (rows, columns) greatest distance of ground points from it.
    """

    cell_m: float
    corner: tuple[int, int]
    seen: BoolArray
    height_m: FloatArray
    limit_m: FloatArray

    def has(self, xyz_m: FloatArray) -> BoolArray:
        """Which points (n, 3) are ground, by the heights and limits between the centres of cells."""
        near: BoolArray = _near(np.ascontiguousarray(xyz_m), self.cell_m, self.corner, self.height_m, self.limit_m)
        return near


def classify_ground(xyz_m: FloatArray, method: GroundMethod = "smrf", smrf: Smrf = SMRF) -> BoolArray:
    """Which points (n, 3) of a window of the map are ground, all at once; :func:`ground_of_points` says the rest.

    Example:
        >>> grid = np.stack(np.meshgrid(np.arange(20.0), np.arange(20.0)), axis=-1).reshape(-1, 2)
        >>> bush = np.hypot(*(grid - 9.0).T) < 3.0
        >>> bool(np.array_equal(classify_ground(np.column_stack([grid, 2.0 * bush])), ~bush))
        True
    """
    ground = ground_of_points(xyz_m, method, smrf)
    return ground.has(xyz_m) if ground is not None else np.zeros(len(xyz_m), np.bool_)


def ground_of_points(xyz_m: FloatArray, method: GroundMethod = "smrf", smrf: Smrf = SMRF) -> GroundRaster | None:
    """The ground under points (n, 3) of a window of the map; None where there is none.

    Args:
        xyz_m: easting, northing, height; points that are not finite are not ground. Memory is that of the cells of
            their bounding box.
        method: "smrf", the simple morphological filter of Pingel et al. (2013); "csf", the cloth simulation filter of
            Zhang et al. (2016), which requires the extra `csf`.
        smrf: its cells serve both methods.

    Raises:
        InputError: if the library of the method is not installed.
    """
    if method == "csf":
        require_cloth()
    known = xyz_m[np.isfinite(xyz_m).all(axis=1)]
    if not len(known):
        return None
    cells = np.floor(known[:, :2] / smrf.cell_m).astype(np.int64)
    corner = cells.min(axis=0)
    columns, rows = cells.max(axis=0) - corner + 1
    lowest_m = np.full((rows, columns), np.inf)
    column, row = (cells - corner).T
    np.minimum.at(lowest_m.reshape(-1), row * columns + column, known[:, 2])
    lowest_m[np.isinf(lowest_m)] = np.nan
    return ground_of_cells(lowest_m, (int(corner[0]), int(corner[1])), method, smrf)


def ground_of_cells(
    lowest_m: FloatArray, corner: tuple[int, int], method: GroundMethod | Literal["class"], smrf: Smrf
) -> GroundRaster | None:
    """The same by the lowest heights (rows, columns) of cells, nan without points; by "class", all of them are ground.

    Raises InputError as :func:`ground_of_points`.
    """
    seen = np.isfinite(lowest_m)
    if method == "smrf":
        seen = ground_cells(lowest_m, smrf)
    elif method == "csf":
        row, column = np.nonzero(seen)
        found = cloth_ground(np.column_stack([column * smrf.cell_m, row * smrf.cell_m, lowest_m[seen]]))
        seen[row, column] = found
    if not seen.any():
        return None
    height_m = filled(np.where(seen, lowest_m, np.nan))
    slopes = [
        np.gradient(height_m, smrf.cell_m, axis=axis) if height_m.shape[axis] > 1 else np.zeros(height_m.shape)
        for axis in (0, 1)
    ]
    limit_m = smrf.threshold_m + smrf.scale * np.hypot(*slopes)
    return GroundRaster(smrf.cell_m, corner, seen, height_m, limit_m)


@kernel()
def _near(xyz_m, cell_m, corner, height_m, limit_m):  # type: ignore[no-untyped-def]
    """Kernel of :meth:`GroundRaster.has`: bilinear between cell centres, constant beyond the outermost."""
    out = np.zeros(len(xyz_m), np.bool_)
    rows, columns = height_m.shape
    for k in range(len(xyz_m)):
        if not np.isfinite(xyz_m[k, 0] + xyz_m[k, 1] + xyz_m[k, 2]):
            continue
        v = min(max(xyz_m[k, 0] / cell_m - corner[0] - 0.5, 0.0), columns - 1.0)
        u = min(max(xyz_m[k, 1] / cell_m - corner[1] - 0.5, 0.0), rows - 1.0)
        i = int(u)
        j = int(v)
        p = u - i
        q = v - j
        below = min(i + 1, rows - 1)
        right = min(j + 1, columns - 1)
        height = (1.0 - p) * ((1.0 - q) * height_m[i, j] + q * height_m[i, right]) + p * (
            (1.0 - q) * height_m[below, j] + q * height_m[below, right]
        )
        limit = (1.0 - p) * ((1.0 - q) * limit_m[i, j] + q * limit_m[i, right]) + p * (
            (1.0 - q) * limit_m[below, j] + q * limit_m[below, right]
        )
        out[k] = abs(xyz_m[k, 2] - height) <= limit
    return out


def ground_cells(lowest_m: FloatArray, filter_: Smrf) -> BoolArray:
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


def _pits(lowest_m: FloatArray, spacing_m: float, cell_m: float) -> BoolArray:
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


def cloth_ground(xyz_m: NDArray[np.float64]) -> BoolArray:
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
