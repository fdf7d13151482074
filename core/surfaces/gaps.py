"""Filling gaps in a raster of heights."""

import math
from typing import Final

import numpy as np
from scipy.ndimage import distance_transform_edt

from furrowmap.core.runtime.arrays import FloatArray
from furrowmap.core.runtime.kernels import kernel

_SWEEPS: Final = 12


def filled(height_m: FloatArray, reach: float = math.inf) -> FloatArray:
    """Heights with gaps filled by harmonic interpolation of the residuals from the plane of all heights.

    Solved approximately by cascadic multigrid (Bornemann and Deuflhard 1996, Numerische Mathematik 75, 135-152) with a
    few Gauss-Seidel sweeps a level; exact on a plane. `height_m` (rows, columns) is nan in the gaps; cells farther than
    `reach` cells from every height stay nan.
    """
    seen = np.isfinite(height_m)
    if seen.all() or not seen.any():
        return height_m
    row, column = np.indices(height_m.shape)
    basis = np.stack([np.ones(height_m.shape), row, column], axis=-1)
    plane = basis @ np.linalg.lstsq(basis[seen], height_m[seen], rcond=None)[0]
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
    padded = np.full((rows + rows % 2, columns + columns % 2), np.nan)
    padded[:rows, :columns] = height
    blocks = padded.reshape(padded.shape[0] // 2, 2, padded.shape[1] // 2, 2)
    count = np.isfinite(blocks).sum(axis=(1, 3))
    total = np.nansum(blocks, axis=(1, 3))
    coarse = _film(np.divide(total, count, out=np.full(count.shape, np.nan), where=count > 0))
    out = np.where(seen, height, np.repeat(np.repeat(coarse, 2, axis=0), 2, axis=1)[:rows, :columns])
    _relax(out, seen, _SWEEPS)
    return out


@kernel()
def _relax(height, fixed, sweeps):  # type: ignore[no-untyped-def]
    """Gauss-Seidel sweeps over the heights that are not fixed, alternating direction."""
    rows, columns = height.shape
    for sweep in range(sweeps):
        for k in range(rows * columns):
            place = k if sweep % 2 == 0 else rows * columns - 1 - k
            i = place // columns
            j = place % columns
            if fixed[i, j]:
                continue
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
            height[i, j] = total / count
