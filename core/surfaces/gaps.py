"""Filling gaps in a raster of heights."""

import math
from typing import Final

import numpy as np
from scipy.ndimage import distance_transform_edt

from furrowmap.core.runtime.arrays import FloatArray
from furrowmap.core.runtime.kernels import kernel, kernel_part

_SWEEPS: Final = 12


def filled(height_m: FloatArray, reach: float = math.inf) -> FloatArray:
    """Heights with gaps filled by harmonic interpolation of the residuals from the plane of all heights.

    Solved approximately by cascadic multigrid (Bornemann and Deuflhard 1996, Numerische Mathematik 75, 135-152) with a
    few red-black Gauss-Seidel sweeps a level; exact on a plane. `height_m` (rows, columns) is nan in the gaps; cells
    farther than `reach` cells from every height stay nan.
    """
    seen = np.isfinite(height_m)
    if seen.all() or not seen.any():
        return height_m
    row, column = np.nonzero(seen)
    basis = np.column_stack([np.ones(len(row)), row, column])
    level, by_row, by_column = np.linalg.lstsq(basis, height_m[seen], rcond=None)[0]
    plane = level + by_row * np.arange(height_m.shape[0])[:, None] + by_column * np.arange(height_m.shape[1])
    out = np.where(seen, height_m, plane + _film(height_m - plane))
    if math.isfinite(reach):
        out[distance_transform_edt(~seen) > reach] = np.nan
    return out


def bridged(height_m: FloatArray, reach: float) -> FloatArray:
    """Heights with gaps filled up to a maximum interpolation gap, and nothing outside the covered area.

    Fills the morphological closing of the covered cells by a disk of radius `reach` cells.
    """
    seen = np.isfinite(height_m)
    if seen.all() or not seen.any():
        return height_m
    rim = int(np.ceil(reach)) + 1
    near = distance_transform_edt(~np.pad(seen, rim)) <= reach
    closed = np.asarray(distance_transform_edt(near))[rim:-rim, rim:-rim] > reach
    return np.where(closed | seen, filled(height_m, reach), np.nan)


def _film(height: FloatArray) -> FloatArray:
    """Harmonic interpolation; at least one height is finite."""
    seen = np.isfinite(height)
    if seen.all():
        return height
    rows, columns = height.shape
    if rows * columns == 1:
        return height
    coarse = _film(_halved(height))
    out = np.where(seen, height, np.repeat(np.repeat(coarse, 2, axis=0), 2, axis=1)[:rows, :columns])
    _relax(out, seen, _SWEEPS)
    return out


@kernel()
def _halved(height):  # type: ignore[no-untyped-def]
    """Means of the finite heights of squares of four cells; nan without any."""
    rows, columns = height.shape
    out = np.empty(((rows + 1) // 2, (columns + 1) // 2))
    for row in range(out.shape[0]):
        for column in range(out.shape[1]):
            total = 0.0
            count = 0
            for i in range(2 * row, min(2 * row + 2, rows)):
                for j in range(2 * column, min(2 * column + 2, columns)):
                    if np.isfinite(height[i, j]):
                        total += height[i, j]
                        count += 1
            out[row, column] = total / count if count else np.nan
    return out


@kernel_part()
def _relax(height, fixed, sweeps):  # type: ignore[no-untyped-def]
    """Red-black Gauss-Seidel sweeps over the heights that are not fixed.

    Cells of one colour do not depend on each other, so that the processor computes several at a time.
    """
    rows, columns = height.shape
    for half_sweep in range(2 * sweeps):
        for i in range(rows):
            inner_row = 0 < i < rows - 1
            for j in range((i + half_sweep) % 2, columns, 2):
                if fixed[i, j]:
                    continue
                if inner_row and 0 < j < columns - 1:
                    height[i, j] = 0.25 * (height[i - 1, j] + height[i + 1, j] + height[i, j - 1] + height[i, j + 1])
                else:
                    height[i, j] = _mean_beside(height, i, j)


@kernel_part()
def _mean_beside(height, i, j):  # type: ignore[no-untyped-def]
    """Mean of the neighbours of a cell at the border."""
    rows, columns = height.shape
    total = 0.0
    count = 0
    if i > 0:
        total += height[i - 1, j]
        count += 1
    if i + 1 < rows:
        total += height[i + 1, j]
        count += 1
    if j > 0:
        total += height[i, j - 1]
        count += 1
    if j + 1 < columns:
        total += height[i, j + 1]
        count += 1
    return total / count
