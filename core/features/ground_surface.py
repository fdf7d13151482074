"""Height above the ground, and ground told from what touches it."""

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import distance_transform_edt, uniform_filter

from furrowmap.core.runtime.arrays import BoolArray, FloatArray
from furrowmap.core.runtime.kernels import kernel
from furrowmap.core.surfaces.gaps import filled
from furrowmap.core.surfaces.ground_filter import from_nearest
from furrowmap.core.surfaces.statistic import sort_in_place
from furrowmap.core.values.extents import bounds

MEDIAN_CELL_M: Final = 0.5
GROUND_LIMITS_M: Final = (0.05, 0.15)
"""Limits of the distance from the ground within which a point is ground: four deviations of the ground around it."""
DEVIATIONS: Final = 4.0
SLOPE_M: Final = 0.15
"""Added to that, times the slope up to 1: medians cut the edges of banks."""
LAYER_M: Final = 0.3
"""Heights above and below the ground of the filter between which returns are compared."""
COLUMN_SPACINGS: Final = 3.0
"""Side of a column in spacings of the points, at least of :data:`MIN_COLUMN_M`."""
MIN_COLUMN_M: Final = 0.15
THICKNESS_M: Final = (0.04, 0.06)
"""Limits of the standard deviation in a column above which plants hide the ground: soil has the scanner's noise, 1 to 3
cm, and crops 5 to 10 cm."""
THICK_RATIO: Final = 2.5
"""Of that to the usual one of the bare ground of the cloud."""
THIN_PERCENTILE: Final = 10.0
"""Percentile of the cells that is bare ground."""
MIN_COMPARED: Final = 8
"""Returns in a cell; with fewer, those around it are compared as well."""
MAX_HIDDEN_M: Final = 5.0
"""Distance from bare ground up to which the ground under plants is continued from there."""
MIN_SLOPE_CELLS: Final = 16
"""With fewer cells of ground the height is that of the nearest: they show no slope."""


@dataclass(frozen=True)
class GroundHeights:
    """Heights of n points above the ground.

    Attributes:
        above_m: (n,) nan without any ground.
        ground: (n,) which of the points are ground.
        hidden: (n,) which lie where plants hide the ground.
        noise_m: standard deviation of the heights of bare ground in one place; inf where that is not seen.
    """

    above_m: FloatArray
    ground: BoolArray
    hidden: BoolArray
    noise_m: float


def heights_above_ground(xyz_m: FloatArray, ground: BoolArray, cell_m: float) -> GroundHeights:
    """Height of points (n, 3), of a spacing `cell_m`, above the ground.

    The ground is the median of the points (n,) of the ground filter in cells of 0.5 m. What the filter took for ground
    and stands out of it, such as the foot of a post or low plants, is not. Soil stops all pulses in one height; a crop
    stops them at all heights, so that what the filter takes for ground in it is a layer as thick as the crop lets
    pulses in. There the ground is that of the bare cells around.
    """
    if not ground.any():
        nowhere = np.zeros(len(xyz_m), bool)
        return GroundHeights(np.full(len(xyz_m), np.nan), nowhere, nowhere, math.inf)
    xyz_m = np.ascontiguousarray(xyz_m)
    low, high = (np.floor(end[:2] / MEDIAN_CELL_M) for end in bounds(xyz_m))
    corner = low - 1.0
    shape = (high - corner + 2.0).astype(np.int64)
    cell = cells_of(xyz_m, corner, MEDIAN_CELL_M, int(shape[1]))
    known = medians(cell[ground], xyz_m[ground, 2], shape)
    hidden, noise_m = _hidden_cells(xyz_m, cell, corner, known, cell_m)
    bare = np.isfinite(known) & ~hidden
    if bare.any():
        near = distance_transform_edt(~bare) * MEDIAN_CELL_M <= MAX_HIDDEN_M
        known = np.where(hidden & near, np.nan, known)
    enough = np.count_nonzero(np.isfinite(known)) >= MIN_SLOPE_CELLS
    surface = filled(known) if enough else from_nearest(known)
    above = _above(xyz_m, corner, surface)
    slope = np.hypot(*np.gradient(surface, MEDIAN_CELL_M))
    spread = medians(cell[ground], np.abs(above[ground]), shape)
    seen = np.isfinite(spread)
    around = uniform_filter(np.where(seen, spread, 0.0), 3) / np.maximum(uniform_filter(seen.astype(float), 3), 1e-9)
    limit = np.clip(DEVIATIONS * 1.4826 * around, *GROUND_LIMITS_M) + SLOPE_M * np.minimum(slope, 1.0)
    return GroundHeights(above, _within(above, ground, cell, limit.ravel()), hidden.ravel()[cell], noise_m)


def _hidden_cells(
    xyz_m: FloatArray, cell: NDArray[np.int64], corner: FloatArray, known: FloatArray, cell_m: float
) -> tuple[BoolArray, float]:
    """Cells where returns near the ground scatter more about planes than on bare ground, and by how much they do there.

    Each plane is that of a column, which is narrower than furrows where points are dense.
    """
    parts = max(1, round(MEDIAN_CELL_M / max(COLUMN_SPACINGS * cell_m, MIN_COLUMN_M)))
    squares, count = _scatter_in_columns(xyz_m, cell, corner, known, parts)
    few = count < MIN_COMPARED
    squares = np.where(few, 9.0 * uniform_filter(squares, 3), squares)
    count = np.where(few, 9.0 * uniform_filter(count, 3), count)
    compared = count >= MIN_COMPARED
    if not compared.any():
        return compared, math.inf
    thick = np.sqrt(np.maximum(squares, 0.0) / np.maximum(count, 1.0))
    noise = float(np.percentile(thick[compared], THIN_PERCENTILE))
    hidden = compared & (thick > np.clip(THICK_RATIO * noise, *THICKNESS_M))
    return hidden | (uniform_filter(hidden.astype(float), 3) > 0.5), noise


@kernel()
def _scatter_in_columns(xyz_m, cell, corner, known, parts):  # type: ignore[no-untyped-def]
    """Sum of squared distances from the plane of each column of a cell, and degrees of freedom, by cell."""
    side = MEDIAN_CELL_M / parts
    columns, rows = known.shape
    sums = np.zeros((columns * parts, rows * parts, 10))
    for i in range(len(cell)):
        above = xyz_m[i, 2] - known[cell[i] // rows, cell[i] % rows]
        if abs(above) <= LAYER_M:
            x = xyz_m[i, 0] / side - corner[0] * parts
            y = xyz_m[i, 1] / side - corner[1] * parts
            j = int(x)
            k = int(y)
            x = x - j
            y = y - k
            z = above
            own = sums[j, k]
            own[0] += 1.0
            own[1] += x
            own[2] += y
            own[3] += z
            own[4] += x * x
            own[5] += x * y
            own[6] += y * y
            own[7] += x * z
            own[8] += y * z
            own[9] += z * z
    squares = np.zeros((columns, rows))
    count = np.zeros((columns, rows))
    for j in range(columns * parts):
        for k in range(rows * parts):
            n, x, y, z, xx, xy, yy, xz, yz, zz = sums[j, k]
            if n > 3.0:
                xx = xx - x * x / n
                xy = xy - x * y / n
                yy = yy - y * y / n
                xz = xz - x * z / n
                yz = yz - y * z / n
                zz = zz - z * z / n
                area = xx * yy - xy * xy
                if area > 1e-4 * n * n:
                    squares[j // parts, k // parts] += zz - (yy * xz * xz - 2.0 * xy * xz * yz + xx * yz * yz) / area
                    count[j // parts, k // parts] += n - 3.0
    return squares, count


@kernel()
def cells_of(xyz_m, corner, cell_m, rows):  # type: ignore[no-untyped-def]
    """Number (n,) of the cell of each point (n, 3), row by row of each column; `corner` (2,) is counted in cells."""
    out = np.empty(len(xyz_m), np.int64)
    for i in range(len(xyz_m)):
        column = np.floor(xyz_m[i, 0] / cell_m) - corner[0]
        row = np.floor(xyz_m[i, 1] / cell_m) - corner[1]
        out[i] = int(column) * rows + int(row)
    return out


@kernel()
def _above(xyz_m, corner, surface):  # type: ignore[no-untyped-def]
    """Height of points above a surface, between the middles of whose cells it is interpolated."""
    out = np.empty(len(xyz_m))
    columns, rows = surface.shape
    for i in range(len(xyz_m)):
        u = min(max(xyz_m[i, 0] / MEDIAN_CELL_M - corner[0] - 0.5, 0.0), columns - 1.0)
        v = min(max(xyz_m[i, 1] / MEDIAN_CELL_M - corner[1] - 0.5, 0.0), rows - 1.0)
        j = min(int(u), columns - 2)
        k = min(int(v), rows - 2)
        s = u - j
        t = v - k
        near = (1.0 - t) * surface[j, k] + t * surface[j, k + 1]
        far = (1.0 - t) * surface[j + 1, k] + t * surface[j + 1, k + 1]
        out[i] = xyz_m[i, 2] - ((1.0 - s) * near + s * far)
    return out


@kernel()
def _within(above, ground, cell, limit):  # type: ignore[no-untyped-def]
    """What is no higher than the limit of its cell, and either ground already or no lower."""
    out = np.empty(len(above), np.bool_)
    for i in range(len(above)):
        most = limit[cell[i]]
        out[i] = above[i] < most and (ground[i] or above[i] > -most)
    return out


def medians(cell: NDArray[np.int64], values: FloatArray, shape: NDArray[np.int64]) -> FloatArray:
    """Median of the values in each cell; nan in those without any."""
    out: FloatArray = _medians_of(cell, np.ascontiguousarray(values), int(np.prod(shape))).reshape(shape)
    return out


@kernel()
def _medians_of(cell, values, cells):  # type: ignore[no-untyped-def]
    starts = np.zeros(cells + 1, np.int64)
    for i in range(len(cell)):
        starts[cell[i] + 1] += 1
    for k in range(cells):
        starts[k + 1] += starts[k]
    place = starts[:-1].copy()
    by_cell = np.empty(len(cell))
    for i in range(len(cell)):
        by_cell[place[cell[i]]] = values[i]
        place[cell[i]] += 1
    out = np.full(cells, np.nan)
    for k in range(cells):
        if starts[k + 1] > starts[k]:
            z = by_cell[starts[k] : starts[k + 1]]
            sort_in_place(z)
            out[k] = 0.5 * (z[(len(z) - 1) // 2] + z[len(z) // 2])
    return out
