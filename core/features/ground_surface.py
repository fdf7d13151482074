"""Height above the ground, and ground told from what touches it."""

from __future__ import annotations

from typing import Final

import numba
import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import uniform_filter

from furrowmap.core.runtime.arrays import FloatArray
from furrowmap.core.surfaces.gaps import filled
from furrowmap.core.surfaces.ground import from_nearest
from furrowmap.core.values.extents import bounds

MEDIAN_CELL_M: Final = 0.5
GROUND_LIMITS_M: Final = (0.05, 0.15)
"""Limits of the distance from the ground within which a point is ground: four deviations of the ground around it."""
DEVIATIONS: Final = 4.0
SLOPE_M: Final = 0.15
"""Added to that, times the slope up to 1: medians cut the edges of banks."""
MIN_SLOPE_CELLS: Final = 16
"""With fewer cells of ground the height is that of the nearest: they show no slope."""


def heights_above_ground(xyz_m: FloatArray, ground: NDArray[np.bool_]) -> tuple[FloatArray, NDArray[np.bool_]]:
    """Height (n,) of points (n, 3) above the ground, nan without any, and which of them are ground.

    The ground is the median of the points (n,) of the ground filter in cells of 0.5 m. What the filter took for ground
    and stands out of it, such as the foot of a post or low plants, is not.
    """
    if not ground.any():
        return np.full(len(xyz_m), np.nan), np.zeros(len(xyz_m), bool)
    low, high = (np.floor(end[:2] / MEDIAN_CELL_M) for end in bounds(xyz_m))
    corner = low - 1.0
    shape = (high - corner + 2.0).astype(np.int64)
    cell = cells_of(xyz_m, corner, MEDIAN_CELL_M, int(shape[1]))
    known = medians(cell[ground], xyz_m[ground, 2], shape)
    surface = filled(known) if np.count_nonzero(np.isfinite(known)) >= MIN_SLOPE_CELLS else from_nearest(known)
    above = _above(xyz_m, corner, surface)
    spread = medians(cell[ground], np.abs(above[ground]), shape)
    known = np.isfinite(spread)
    around = uniform_filter(np.where(known, spread, 0.0), 3) / np.maximum(uniform_filter(known.astype(float), 3), 1e-9)
    slope = np.hypot(*np.gradient(surface, MEDIAN_CELL_M))
    limit = np.clip(DEVIATIONS * 1.4826 * around, *GROUND_LIMITS_M) + SLOPE_M * np.minimum(slope, 1.0)
    return above, _within(above, ground, cell, limit.ravel())


@numba.njit(cache=True, nogil=True)
def cells_of(xyz_m, corner, cell_m, rows):  # type: ignore[no-untyped-def]
    """Number (n,) of the cell of each point (n, 3), row by row of each column; `corner` (2,) is counted in cells."""
    out = np.empty(len(xyz_m), np.int64)
    for i in range(len(xyz_m)):
        column, row = np.floor(xyz_m[i, 0] / cell_m) - corner[0], np.floor(xyz_m[i, 1] / cell_m) - corner[1]
        out[i] = int(column) * rows + int(row)
    return out


@numba.njit(cache=True, nogil=True)
def _above(xyz_m, corner, surface):  # type: ignore[no-untyped-def]
    """Height of points above a surface, between the middles of whose cells it is interpolated."""
    out = np.empty(len(xyz_m))
    columns, rows = surface.shape
    for i in range(len(xyz_m)):
        u = min(max(xyz_m[i, 0] / MEDIAN_CELL_M - corner[0] - 0.5, 0.0), columns - 1.0)
        v = min(max(xyz_m[i, 1] / MEDIAN_CELL_M - corner[1] - 0.5, 0.0), rows - 1.0)
        j, k = min(int(u), columns - 2), min(int(v), rows - 2)
        s, t = u - j, v - k
        near = (1.0 - t) * surface[j, k] + t * surface[j, k + 1]
        far = (1.0 - t) * surface[j + 1, k] + t * surface[j + 1, k + 1]
        out[i] = xyz_m[i, 2] - ((1.0 - s) * near + s * far)
    return out


@numba.njit(cache=True, nogil=True)
def _within(above, ground, cell, limit):  # type: ignore[no-untyped-def]
    """What is no higher than the limit of its cell, and either ground already or no lower."""
    out = np.empty(len(above), np.bool_)
    for i in range(len(above)):
        most = limit[cell[i]]
        out[i] = above[i] < most and (ground[i] or above[i] > -most)
    return out


def medians(cell: NDArray[np.int64], values: FloatArray, shape: NDArray[np.int64]) -> FloatArray:
    """Median of the values in each cell; nan in those without any."""
    out: FloatArray = _medians_of(cell, values, int(np.prod(shape))).reshape(shape)
    return out


@numba.njit(cache=True, nogil=True)
def _medians_of(cell, values, cells):  # type: ignore[no-untyped-def]
    starts = np.zeros(cells + 1, np.int64)
    for i in range(len(cell)):
        starts[cell[i] + 1] += 1
    for k in range(cells):
        starts[k + 1] += starts[k]
    place, by_cell = starts[:-1].copy(), np.empty(len(cell))
    for i in range(len(cell)):
        by_cell[place[cell[i]]] = values[i]
        place[cell[i]] += 1
    out = np.full(cells, np.nan)
    for k in range(cells):
        if starts[k + 1] > starts[k]:
            out[k] = np.median(by_cell[starts[k] : starts[k + 1]])
    return out
