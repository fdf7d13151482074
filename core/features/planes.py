"""Planes by region growing over voxels.

After T. Rabbani, F. A. van den Heuvel, G. Vosselman (2006), Segmentation of point clouds using smoothness constraint,
ISPRS Archives XXXVI-5, 248-253, with the fit of the whole region as the second constraint.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

import numba
import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import binary_dilation, uniform_filter
from scipy.spatial import cKDTree

from furrowmap.core.features.eigenfeatures import Eigenfeatures, eigen
from furrowmap.core.features.neighbours import Columns, columns, first_above

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

NORMAL_DEG: Final = 25.0
"""Greatest angle between the normal of a neighbourhood and that of its region."""
SEED_CURVATURE: Final = 0.06
"""A region begins where the least eigenvalue is at most this share of their sum."""
FEWEST: Final = 12
"""Voxels of a region."""
SLAB_M: Final = 0.3
"""To both sides of a plane: what lies there, but not on it, speaks against the plane."""
PURITY: Final = 0.8
"""Least share of the voxels within the slab that lie on the plane."""
FILL: Final = 0.55
"""Least share of the cells around each cell of a plane that hold voxels as well: less between the wires of a fence."""
LEAST_AREA_M2: Final = 0.25
LEAST_WIDTH_M: Final = 0.25
RIM: Final = 2
"""Cells beyond a region in which voxels on its plane belong to it: at edges, normals are those of no plane."""
MOST_MEASURED: Final = 2000


@dataclass(frozen=True)
class Plane:
    """A plane.

    Attributes:
        members: indices of its voxels.
        centre_m: (3,) their mean.
        normal: (3,) unit, upwards.
        rms_m: distance of the voxels from it.
        purity: share of the voxels within :data:`SLAB_M` of it that lie on it.
        area_m2: of the cells of the plane that hold voxels.
    """

    members: IntArray
    centre_m: FloatArray
    normal: FloatArray
    rms_m: float
    purity: float
    area_m2: float

    def flat(self, xyz_m: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Coordinates (n, 2) in the plane, and distance (n,) from it, of points (n, 3)."""
        return flat_in(self.centre_m, self.normal, xyz_m)


def axes_of(normal: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Unit axes of a plane: the first level, the second at right angles to it, upwards."""
    level = math.hypot(normal[0], normal[1])
    first = np.array([-normal[1], normal[0], 0.0]) / level if level > 1e-9 else np.array([1.0, 0.0, 0.0])
    second = np.array([-normal[2] * first[1], normal[2] * first[0], normal[0] * first[1] - normal[1] * first[0]])
    return first, second if second[2] >= 0.0 else -second


def flat_in(centre_m: FloatArray, normal: FloatArray, xyz_m: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Coordinates (n, 2) in a plane, and distance (n,) from it, of points (n, 3)."""
    away = xyz_m - centre_m
    return away @ np.column_stack(axes_of(normal)), away @ normal


def planes(
    xyz_m: FloatArray,
    shape: Eigenfeatures,
    cell_m: float,
    tolerance_m: float,
    reach_m: float,
    fill: tuple[float, float] = (FILL, math.inf),
) -> list[Plane]:
    """Planes in voxels (n, 3), none of them ground, with the shapes of their neighbourhoods; largest first.

    Args:
        xyz_m: (n, 3) voxels.
        shape: of their neighbourhoods.
        cell_m: of the voxels.
        tolerance_m: greatest distance from a plane of a voxel that is on it.
        reach_m: greatest distance between neighbours.
        fill: limits of the share of the cells around each cell of a plane that hold voxels as well.
    """
    if len(xyz_m) < FEWEST:
        return []
    near = columns(xyz_m, reach_m)
    curvature = shape.eigenvalue_m2[:, 2] / shape.eigenvalue_m2.sum(axis=1)
    curvature = np.where(np.isfinite(curvature), curvature, np.inf)
    flat = (shape.planarity > 0.3) & (curvature < SEED_CURVATURE)
    seeds = np.argsort(np.where(flat, curvature, np.inf)[near.order], kind="stable")[: np.count_nonzero(flat)]
    region = _grow(
        near.xyz_m,
        near.starts,
        near.side_m,
        *near.across,
        shape.normal.astype(np.float64)[near.order],
        seeds,
        tolerance_m,
        math.cos(math.radians(NORMAL_DEG)),
        FEWEST,
    )
    found = []
    for members, fit in _fits(near.xyz_m + near.corner_m, region):
        plane = _plane(xyz_m, near, members, fit, (cell_m, tolerance_m), fill)
        if plane is not None:
            found.append(plane)
    found.sort(key=lambda plane: -plane.area_m2)
    return found


@dataclass(frozen=True)
class _Fit:
    """The plane through the voxels of a region."""

    centre_m: FloatArray
    normal: FloatArray
    rms_m: float


def _fits(sorted_m: FloatArray, region: IntArray) -> Iterator[tuple[IntArray, _Fit]]:
    """Members among the sorted voxels, and fit, of each region that is wide enough for a plane."""
    order = np.argsort(region, kind="stable")
    order = order[np.searchsorted(region[order], 0) :]
    if not len(order):
        return
    begin = np.flatnonzero(np.diff(region[order], prepend=-1))
    count = np.diff(begin, append=len(order))
    own = sorted_m[order]
    centre = np.add.reduceat(own, begin) / count[:, None]
    away = own - np.repeat(centre, count, axis=0)
    products = np.stack([away[:, j] * away[:, k] for j in range(3) for k in range(3)], axis=1)
    value, vector = np.linalg.eigh((np.add.reduceat(products, begin) / count[:, None]).reshape(-1, 3, 3))
    for k in np.flatnonzero(np.sqrt(12.0 * np.maximum(value[:, 1], 0.0)) >= LEAST_WIDTH_M).tolist():
        normal = vector[k, :, 0] * (1.0 if vector[k, 2, 0] >= 0.0 else -1.0)
        rms = math.sqrt(max(float(value[k, 0]), 0.0))
        yield order[begin[k] : begin[k] + count[k]], _Fit(centre[k], normal, rms)


def _plane(
    xyz_m: FloatArray,
    sorted_m: Columns,
    region: IntArray,
    fit: _Fit,
    scale_m: tuple[float, float],
    fill: tuple[float, float],
) -> Plane | None:
    """The plane of a region of sorted voxels; None where it is small, or too open or filled.

    `scale_m` are the size of the voxels and the tolerance.
    """
    cell_m, tolerance_m = scale_m
    own = xyz_m[sorted_m.order[region]]
    centre, normal = fit.centre_m, fit.normal
    flat, _ = flat_in(centre, normal, own)
    side = _side(flat, cell_m)
    corner = flat.min(axis=0)
    cell = np.floor((flat - corner) / side).astype(np.int64)
    across = cell.max(axis=0) + 1
    filled = np.zeros(across, bool)
    filled[cell[:, 0], cell[:, 1]] = True
    number = np.count_nonzero(filled)
    area = float(number) * side * side
    share = (uniform_filter(filled.astype(np.float64), 3, mode="constant")[filled].sum() * 9.0 / number - 1.0) / 8.0
    if area < LEAST_AREA_M2 or not fill[0] <= share < fill[1]:
        return None
    low, high = own.min(axis=0) - SLAB_M, own.max(axis=0) + SLAB_M
    corner_m = sorted_m.corner_m
    in_slab = _in_slab(
        sorted_m.xyz_m, sorted_m.starts, sorted_m.side_m, *sorted_m.across,
        low - corner_m, high - corner_m, centre - corner_m, normal, SLAB_M,
    )  # fmt: skip
    around = np.sort(sorted_m.order[in_slab])
    flat, away = flat_in(centre, normal, xyz_m[around])
    on = np.abs(away) <= tolerance_m
    cell = np.clip(np.floor((flat - corner) / side).astype(np.int64) + RIM, 0, across + 2 * RIM - 1)
    filled = np.pad(filled, RIM)
    over = filled[cell[:, 0], cell[:, 1]]
    purity = int(np.count_nonzero(on & over)) / max(int(np.count_nonzero(over)), 1)
    near = binary_dilation(filled, iterations=RIM)[cell[:, 0], cell[:, 1]]
    return Plane(around[on & near], centre, normal, fit.rms_m, purity, area)


def _side(flat: FloatArray, cell_m: float) -> float:
    """Side of cells of which those of a plane are nearly all filled: two voxels, three where it is seen sparsely."""
    some = flat if len(flat) <= MOST_MEASURED else flat[:: len(flat) // MOST_MEASURED]
    fourth = np.asarray(cKDTree(flat).query(some, [min(5, len(flat))])[0], np.float64)
    return min(max(1.5 * float(np.median(fourth)), 2.0 * cell_m), 3.0 * cell_m)


@numba.njit(cache=True, nogil=True)
def _in_slab(xyz, starts, side, across, rows, low, high, centre, normal, slab_m):  # type: ignore[no-untyped-def]
    """The sorted points in a box and within a distance of a plane."""
    out = np.empty(1024, np.int64)
    held = 0
    first, last = max(int(low[0] // side), 0), min(int(high[0] // side), across - 1)
    least, most = max(int(low[1] // side), 0), min(int(high[1] // side), rows - 1)
    for column in range(first, last + 1):
        for row in range(least, most + 1):
            begin, end = starts[column * rows + row], starts[column * rows + row + 1]
            for j in range(first_above(xyz, begin, end, low[2]), end):
                x, y, z = xyz[j, 0], xyz[j, 1], xyz[j, 2]
                if z > high[2]:
                    break
                if x < low[0] or x > high[0] or y < low[1] or y > high[1]:
                    continue
                away = (x - centre[0]) * normal[0] + (y - centre[1]) * normal[1] + (z - centre[2]) * normal[2]
                if abs(away) > slab_m:
                    continue
                if held == len(out):
                    more = np.empty(2 * held, np.int64)
                    more[:held] = out
                    out = more
                out[held] = j
                held += 1
    return out[:held].copy()


@numba.njit(cache=True, nogil=True)
def _grow(xyz, starts, reach, across, rows, normal, seeds, tolerance, least_cosine, fewest):  # type: ignore[no-untyped-def]
    """Region of each sorted point, numbered from 0; -1 for none."""
    n = len(xyz)
    region = np.full(n, -1, np.int64)
    stack = np.empty(n, np.int64)
    members = np.empty(n, np.int64)
    moments, out = np.empty(9), np.zeros(9, np.float32)
    found = 0
    for seed in seeds:
        if region[seed] != -1:
            continue
        nx, ny, nz = normal[seed, 0], normal[seed, 1], normal[seed, 2]
        ox, oy, oz = xyz[seed, 0], xyz[seed, 1], xyz[seed, 2]
        cx, cy, cz = ox, oy, oz
        k, sx, sy, sz, xx, yy, zz, xy, xz, yz = 0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
        region[seed] = found
        stack[0], held, count, refit = seed, 1, 0, 16
        while held > 0:
            held -= 1
            i = stack[held]
            if abs((xyz[i, 0] - cx) * nx + (xyz[i, 1] - cy) * ny + (xyz[i, 2] - cz) * nz) > tolerance:
                region[i] = -1  # the fit has moved away since
                continue
            members[count] = i
            count += 1
            a, b, c = xyz[i, 0] - ox, xyz[i, 1] - oy, xyz[i, 2] - oz
            k += 1
            sx += a
            sy += b
            sz += c
            xx += a * a
            yy += b * b
            zz += c * c
            xy += a * b
            xz += a * c
            yz += b * c
            if k == refit:
                refit = 2 * k if k < 4096 else k + 4096
                moments[0], moments[1], moments[2] = xx - sx * sx / k, yy - sy * sy / k, zz - sz * sz / k
                moments[3], moments[4], moments[5] = xy - sx * sy / k, xz - sx * sz / k, yz - sy * sz / k
                eigen(moments, k, out)
                if out[1] > 4.0 * out[2]:
                    nx, ny, nz = float(out[3]), float(out[4]), float(out[5])
                    cx, cy, cz = ox + sx / k, oy + sy / k, oz + sz / k
            column, row = int(xyz[i, 0] // reach), int(xyz[i, 1] // reach)
            for beside in range(max(column - 1, 0), min(column + 2, across)):
                for near in range(max(row - 1, 0), min(row + 2, rows)):
                    begin, end = starts[beside * rows + near], starts[beside * rows + near + 1]
                    for j in range(first_above(xyz, begin, end, xyz[i, 2] - reach), end):
                        if xyz[j, 2] - xyz[i, 2] > reach:
                            break
                        if region[j] != -1:
                            continue
                        a, b, c = xyz[j, 0] - xyz[i, 0], xyz[j, 1] - xyz[i, 1], xyz[j, 2] - xyz[i, 2]
                        if a * a + b * b + c * c > reach * reach:
                            continue
                        if abs(normal[j, 0] * nx + normal[j, 1] * ny + normal[j, 2] * nz) < least_cosine:
                            continue
                        if abs((xyz[j, 0] - cx) * nx + (xyz[j, 1] - cy) * ny + (xyz[j, 2] - cz) * nz) > tolerance:
                            continue
                        region[j] = found
                        stack[held] = j
                        held += 1
        if count < fewest:
            for m in range(count):
                region[members[m]] = -1  # it may still join another
        else:
            found += 1
    return region
