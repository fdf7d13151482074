"""Planes by region growing over voxels.

After T. Rabbani, F. A. van den Heuvel, G. Vosselman (2006), Segmentation of point clouds using smoothness constraint,
ISPRS Archives XXXVI-5, 248-253, with the fit of the whole region as the second constraint.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from furrowmap.core.features.eigenfeatures import Eigenfeatures, eigen
from furrowmap.core.features.neighbours import PointColumns, first_above, sort_into_columns
from furrowmap.core.runtime.arrays import FloatArray, IntArray
from furrowmap.core.runtime.kernels import kernel
from furrowmap.core.surfaces.statistic import sort_in_place
from furrowmap.core.values.extents import bounds

MAX_NORMAL_DEG: Final = 25.0
"""Between the normal of a neighbourhood and that of its region."""
MAX_SEED_CURVATURE: Final = 0.06
"""A region begins where the least eigenvalue is at most this share of their sum."""
MIN_PLANE_VOXELS: Final = 12
"""Voxels of a region."""
SLAB_M: Final = 0.3
"""To both sides of a plane: what lies there, but not on it, speaks against the plane."""
MIN_PLANE_PURITY: Final = 0.8
"""Share of the voxels within the slab that lie on the plane."""
MIN_FILL: Final = 0.55
"""Least share of the cells around each cell of a plane that hold voxels as well: less between the wires of a fence."""
HORIZONTAL_NORMAL: Final = 0.7071
"""Least height of the unit normal of a horizontal plane: roofs up to 45 degrees."""
MIN_PLANE_AREA_M2: Final = 0.25
MIN_PLANE_WIDTH_M: Final = 0.25
RIM: Final = 2
"""Cells beyond a region in which voxels on its plane belong to it: at edges, normals are those of no plane."""
MAX_MEASURED: Final = 2000


@dataclass(frozen=True)
class Plane:
    """A plane.

    Attributes:
        members: indices of its voxels.
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
        away = xyz_m - self.centre_m
        return away @ np.column_stack(axes_of(self.normal)), away @ self.normal


def axes_of(normal: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Unit axes of a plane: the first level, the second at right angles to it, upwards."""
    level = math.hypot(normal[0], normal[1])
    first = np.array([-normal[1], normal[0], 0.0]) / level if level > 1e-9 else np.array([1.0, 0.0, 0.0])
    second = np.array([-normal[2] * first[1], normal[2] * first[0], normal[0] * first[1] - normal[1] * first[0]])
    return first, second if second[2] >= 0.0 else -second


def find_planes(
    xyz_m: FloatArray,
    shape: Eigenfeatures,
    cell_m: float,
    tolerance_m: float,
    reach_m: float,
    fill: tuple[float, float] = (MIN_FILL, math.inf),
) -> list[Plane]:
    """Planes in voxels (n, 3), none of them ground, with the shapes of their neighbourhoods; largest first.

    Voxels of a plane lie within `tolerance_m` of it, neighbours within `reach_m`; `fill` limits the share of the cells
    around each cell of a plane that hold voxels as well.
    """
    if len(xyz_m) < MIN_PLANE_VOXELS:
        return []
    near = sort_into_columns(xyz_m, reach_m)
    curvature = shape.eigenvalue_m2[:, 2] / shape.eigenvalue_m2.sum(axis=1)
    curvature = np.where(np.isfinite(curvature), curvature, np.inf)
    flat = (shape.planarity > 0.3) & (curvature < MAX_SEED_CURVATURE)
    seeds = np.argsort(np.where(flat, curvature, np.inf)[near.order], kind="stable")[: np.count_nonzero(flat)]
    region = _grow(
        near,
        shape.normal.astype(np.float64)[near.order],
        seeds,
        tolerance_m,
        math.cos(math.radians(MAX_NORMAL_DEG)),
        MIN_PLANE_VOXELS,
    )
    fits = _fit_regions(near.xyz_m + near.corner_m, region)
    found = [_measure_plane(near, members, fit, (cell_m, tolerance_m), fill) for members, fit in fits]
    return sorted((plane for plane in found if plane is not None), key=lambda plane: -plane.area_m2)


class PlaneCells(NamedTuple):
    """The cells of a plane.

    Attributes:
        centre: (3,) of the plane.
        axes: (3, 3) two in the plane and its normal.
        corner: (2,) of the first cell, in the plane.
        side: of the cells.
        tolerance: distance within which points are on the plane.
        filled: (columns, rows) which hold some, with :data:`RIM` cells around them.
    """

    centre: FloatArray
    axes: FloatArray
    corner: FloatArray
    side: float
    tolerance: float
    filled: NDArray[np.bool_]


_PlaneFit = tuple[FloatArray, FloatArray, float]
"""Centre, normal, and RMS distance of the voxels."""


def _fit_regions(sorted_m: FloatArray, region: IntArray) -> Iterator[tuple[IntArray, _PlaneFit]]:
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
    for k in np.flatnonzero(np.sqrt(12.0 * np.maximum(value[:, 1], 0.0)) >= MIN_PLANE_WIDTH_M).tolist():
        normal = vector[k, :, 0] * (1.0 if vector[k, 2, 0] >= 0.0 else -1.0)
        rms = math.sqrt(max(float(value[k, 0]), 0.0))
        yield order[begin[k] : begin[k] + count[k]], (centre[k], normal, rms)


def _measure_plane(
    sorted_m: PointColumns, region: IntArray, fit: _PlaneFit, scale_m: tuple[float, float], fill: tuple[float, float]
) -> Plane | None:
    """The plane of a region of sorted voxels of a size, with a tolerance; None if small, too open or filled."""
    cell_m, tolerance_m = scale_m
    centre_m, normal, rms_m = fit
    axes = np.stack([*axes_of(normal), normal])
    centre = centre_m - sorted_m.corner_m
    own = sorted_m.xyz_m[region]
    flat = (own - centre) @ axes[:2].T
    corner, end = bounds(flat)
    side, filled, share = _raster(flat, corner, end, cell_m)
    area = float(np.count_nonzero(filled)) * side * side
    if area < MIN_PLANE_AREA_M2 or not fill[0] <= share < fill[1]:
        return None
    low, high = bounds(own)
    cells = PlaneCells(centre, axes, corner, side, tolerance_m, np.pad(filled, RIM))
    around, number, on = _in_slab(sorted_m, low - SLAB_M, high + SLAB_M, cells)
    members = np.sort(sorted_m.order[around])
    return Plane(members, centre + sorted_m.corner_m, normal, rms_m, on / max(number, 1), area)


@kernel()
def _raster(flat, corner, end, cell_m):  # type: ignore[no-untyped-def]
    """Side of the cells of a plane between two corners, which of them are filled, and the share of filled ones around.

    The side, with which those of a plane are nearly all filled, is one and a half of the distance to the fourth
    neighbour, but two voxels at least and three at most.
    """
    n = len(flat)
    reach = 2.0 * cell_m
    columns = int((end[0] - corner[0]) / reach) + 1
    rows = int((end[1] - corner[1]) / reach) + 1
    number = np.empty(n, np.int64)
    order = np.empty(n, np.int64)
    starts = np.zeros(columns * rows + 1, np.int64)
    for i in range(n):
        number[i] = int((flat[i, 0] - corner[0]) / reach) * rows + int((flat[i, 1] - corner[1]) / reach)
        starts[number[i] + 1] += 1
    for k in range(columns * rows):
        starts[k + 1] += starts[k]
    place = starts[:-1].copy()
    for i in range(n):
        order[place[number[i]]] = i
        place[number[i]] += 1
    every = 1 if n <= MAX_MEASURED else n // MAX_MEASURED
    fourth = np.empty((n + every - 1) // every)
    best = np.empty(5)
    for m in range(len(fourth)):
        i = m * every
        best[:] = reach * reach
        column = number[i] // rows
        row = number[i] % rows
        for beside in range(max(column - 1, 0), min(column + 2, columns)):
            # The rows of a column lie one after another.
            for k in range(starts[beside * rows + max(row - 1, 0)], starts[beside * rows + min(row + 2, rows)]):
                a = flat[order[k], 0] - flat[i, 0]
                b = flat[order[k], 1] - flat[i, 1]
                away = a * a + b * b
                if away < best[4]:
                    at = 4
                    while at > 0 and best[at - 1] > away:
                        best[at] = best[at - 1]
                        at -= 1
                    best[at] = away
        fourth[m] = np.sqrt(best[4])
    sort_in_place(fourth)
    middle = 0.5 * (fourth[(len(fourth) - 1) // 2] + fourth[len(fourth) // 2])
    side = min(max(1.5 * middle, 2.0 * cell_m), 3.0 * cell_m)
    columns = int((end[0] - corner[0]) / side) + 1
    rows = int((end[1] - corner[1]) / side) + 1
    filled = np.zeros((columns, rows), np.bool_)
    for i in range(n):
        filled[int((flat[i, 0] - corner[0]) / side), int((flat[i, 1] - corner[1]) / side)] = True
    own = 0
    around = 0
    for column in range(columns):
        for row in range(rows):
            if filled[column, row]:
                own += 1
                for c in range(max(column - 1, 0), min(column + 2, columns)):
                    for r in range(max(row - 1, 0), min(row + 2, rows)):
                        around += filled[c, r]
    return side, filled, (around / own - 1.0) / 8.0


@kernel()
def _in_slab(points, low, high, cells):  # type: ignore[no-untyped-def]
    """The sorted points in a box that are on a plane, over its cells or their rim, and two numbers.

    These are of the points over its cells within :data:`SLAB_M`, and of those among them that are on it.
    """
    # Arrays are taken out of the tuples before the loop: numba counts a reference each time that it takes one.
    xyz = points.xyz_m
    starts = points.starts
    reach = points.side_m
    across, rows = points.across
    centre = cells.centre
    axes = cells.axes
    corner = cells.corner
    side = cells.side
    tolerance = cells.tolerance
    filled = cells.filled
    near = np.zeros_like(filled)
    columns, lines = filled.shape
    for column in range(columns):
        for row in range(lines):
            if filled[column, row]:
                for c in range(max(column - RIM, 0), min(column + RIM + 1, columns)):
                    wide = RIM - abs(c - column)
                    for r in range(max(row - wide, 0), min(row + wide + 1, lines)):
                        near[c, r] = True
    out = np.empty(1024, np.int64)
    held = 0
    number = 0
    on = 0
    first = max(int(low[0] // reach), 0)
    last = min(int(high[0] // reach), across - 1)
    least = max(int(low[1] // reach), 0)
    most = min(int(high[1] // reach), rows - 1)
    for beside in range(first, last + 1):
        for along in range(least, most + 1):
            begin = starts[beside * rows + along]
            end = starts[beside * rows + along + 1]
            for j in range(first_above(xyz, begin, end, low[2]), end):
                if xyz[j, 2] > high[2]:
                    break
                if xyz[j, 0] < low[0] or xyz[j, 0] > high[0] or xyz[j, 1] < low[1] or xyz[j, 1] > high[1]:
                    continue
                x = xyz[j, 0] - centre[0]
                y = xyz[j, 1] - centre[1]
                z = xyz[j, 2] - centre[2]
                away = abs(x * axes[2, 0] + y * axes[2, 1] + z * axes[2, 2])
                if away > SLAB_M:
                    continue
                u = (x * axes[0, 0] + y * axes[0, 1] + z * axes[0, 2] - corner[0]) / side
                v = (x * axes[1, 0] + y * axes[1, 1] + z * axes[1, 2] - corner[1]) / side
                column = int(np.floor(u)) + RIM
                row = int(np.floor(v)) + RIM
                if not (0 <= column < columns and 0 <= row < lines):
                    continue
                if filled[column, row]:
                    number += 1
                    on += away <= tolerance
                if away <= tolerance and near[column, row]:
                    if held == len(out):
                        more = np.empty(2 * held, np.int64)
                        more[:held] = out
                        out = more
                    out[held] = j
                    held += 1
    return out[:held].copy(), number, on


@kernel()
def _grow(points, normal, seeds, tolerance, least_cosine, fewest):  # type: ignore[no-untyped-def]
    """Region of each sorted point, numbered from 0; -1 for none."""
    xyz = points.xyz_m
    starts = points.starts
    reach = points.side_m
    across, rows = points.across
    n = len(xyz)
    region = np.full(n, -1, np.int64)
    stack = np.empty(n, np.int64)
    members = np.empty(n, np.int64)
    moments = np.empty(9)
    out = np.zeros(9, np.float32)
    found = 0
    for seed in seeds:
        if region[seed] != -1:
            continue
        nx = normal[seed, 0]
        ny = normal[seed, 1]
        nz = normal[seed, 2]
        ox = xyz[seed, 0]
        oy = xyz[seed, 1]
        oz = xyz[seed, 2]
        cx = ox
        cy = oy
        cz = oz
        k = 0
        sx = 0.0
        sy = 0.0
        sz = 0.0
        xx = 0.0
        yy = 0.0
        zz = 0.0
        xy = 0.0
        xz = 0.0
        yz = 0.0
        region[seed] = found
        stack[0] = seed
        held = 1
        count = 0
        refit = 16
        while held > 0:
            held -= 1
            i = stack[held]
            if abs((xyz[i, 0] - cx) * nx + (xyz[i, 1] - cy) * ny + (xyz[i, 2] - cz) * nz) > tolerance:
                region[i] = -1  # the fit has moved away since
                continue
            members[count] = i
            count += 1
            a = xyz[i, 0] - ox
            b = xyz[i, 1] - oy
            c = xyz[i, 2] - oz
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
                moments[0] = xx - sx * sx / k
                moments[1] = yy - sy * sy / k
                moments[2] = zz - sz * sz / k
                moments[3] = xy - sx * sy / k
                moments[4] = xz - sx * sz / k
                moments[5] = yz - sy * sz / k
                eigen(moments, float(k), out)
                if out[1] > 4.0 * out[2]:
                    nx = float(out[3])
                    ny = float(out[4])
                    nz = float(out[5])
                    cx = ox + sx / k
                    cy = oy + sy / k
                    cz = oz + sz / k
            column = int(xyz[i, 0] // reach)
            row = int(xyz[i, 1] // reach)
            for beside in range(max(column - 1, 0), min(column + 2, across)):
                for near in range(max(row - 1, 0), min(row + 2, rows)):
                    begin = starts[beside * rows + near]
                    end = starts[beside * rows + near + 1]
                    for j in range(first_above(xyz, begin, end, xyz[i, 2] - reach), end):
                        if xyz[j, 2] - xyz[i, 2] > reach:
                            break
                        if region[j] != -1:
                            continue
                        a = xyz[j, 0] - xyz[i, 0]
                        b = xyz[j, 1] - xyz[i, 1]
                        c = xyz[j, 2] - xyz[i, 2]
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
