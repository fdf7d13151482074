"""A surface moved as a tie says."""

import math

import numpy as np

from furrowmap.core.runtime.arrays import Float32Array, FloatArray
from furrowmap.core.runtime.kernels import kernel
from furrowmap.core.surfaces.grid import Grid


def reach_cells(move: FloatArray, grid: Grid, middle_m: FloatArray) -> int:
    """Width in cells of the margin that a moved surface needs round its cells."""
    west, south, east, north = grid.bounds_m
    far = max(math.dist((x, y), middle_m) for x in (west, east) for y in (south, north))
    shift_m = float(np.abs(move[:2]).max() + abs(move[5]) * far)
    return math.ceil(shift_m / grid.cell_m) + 1


def move_surface(
    height_m: Float32Array, around: Grid, part: Grid, move: FloatArray, middle_m: FloatArray
) -> Float32Array:
    """Heights of the cells of `part` in a surface that was moved.

    Bilinear between the cells' middles; a cell whose neighbours are unknown takes the nearest. `around` are the cells
    of the surface (nan where unknown), at least the margin of :func:`reach_cells` larger than `part`; `move` (6,) is in
    the order of :data:`furrowmap.core.coregistration.pair_tie.MOVE_NAMES`, about the place `middle_m` (2,).
    """
    out = np.full(part.shape, np.nan, np.float32)
    west = part.west * part.cell_m - middle_m[0]
    north = part.north * part.cell_m - middle_m[1]
    offset = (around.north - part.north, part.west - around.west)
    _sample(height_m, offset, west, north, part.cell_m, np.ascontiguousarray(move), out)
    return out


def move_places(xy_m: FloatArray, move: FloatArray, middle_m: FloatArray) -> FloatArray:
    """Eastings and northings (n, 2) moved in place; arguments as :func:`move_surface`."""
    east, north = (xy_m - middle_m).T
    return np.column_stack([xy_m[:, 0] + move[0] - move[5] * north, xy_m[:, 1] + move[1] + move[5] * east])


@kernel()
def _sample(height, offset, west, north, cell, move, out):  # type: ignore[no-untyped-def]
    rows, columns = height.shape
    for i in range(out.shape[0]):
        y = north - (i + 0.5) * cell
        for j in range(out.shape[1]):
            x = west + (j + 0.5) * cell
            u = j + offset[1] - (move[0] - move[5] * y) / cell
            v = i + offset[0] + (move[1] + move[5] * x) / cell
            p = math.floor(v)
            q = math.floor(u)
            value = np.nan
            if p >= 0 and q >= 0 and p + 1 < rows and q + 1 < columns:
                fv = v - p
                fu = u - q
                value = (1.0 - fv) * ((1.0 - fu) * height[p, q] + fu * height[p, q + 1])
                value += fv * ((1.0 - fu) * height[p + 1, q] + fu * height[p + 1, q + 1])
            if not np.isfinite(value):
                p = math.floor(v + 0.5)
                q = math.floor(u + 0.5)
                if p < 0 or q < 0 or p >= rows or q >= columns:
                    continue
                value = height[p, q]
            out[i, j] = value + move[2] + move[3] * x + move[4] * y
