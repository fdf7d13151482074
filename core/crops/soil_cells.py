"""Bare soil between and around parcels: heights of its cells, without crop that reaches into them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numba import njit
from numpy.typing import NDArray

from furrowmap.core.crops.pixels import pixel_returns
from furrowmap.core.surfaces.grid import Grid

FloatArray = NDArray[np.float64]

CELL_M: Final = 0.25
FEWEST_POINTS: Final = 3
"""Of a cell."""
SPREAD_M: Final = 0.06
"""Between the quartiles of a cell of bare soil at most: crop at its edge, or a mound, spreads more."""
REJECTED: Final = 3.0
"""Standard deviations above or below the local plane, and at least `LEAST_REJECTED_M`."""
LEAST_REJECTED_M: Final = 0.03
LOW_SHARE: Final = 0.4
"""Share of the cells that is soil at least."""
_LOW_ROUNDS: Final = 4
_ROUNDS: Final = 14
MEDIAN_LOSS: Final = 1.2533
"""Standard deviation of a median over that of a mean, of normal values."""


@dataclass(frozen=True)
class SoilCells:
    """Cells of bare soil.

    Attributes:
        xy_m: (n, 2) float64 mean easting and northing of their points.
        height_m: (n,) float64 median height.
        sigma_m: (n,) float64 standard deviation of it by the scatter of the points.
    """

    xy_m: FloatArray
    height_m: FloatArray
    sigma_m: FloatArray

    def __len__(self) -> int:
        return len(self.height_m)

    def at(self, kept: NDArray[np.bool_] | NDArray[np.intp]) -> SoilCells:
        """Some of the cells, by a mask (n,) or by their numbers."""
        return SoilCells(self.xy_m[kept], self.height_m[kept], self.sigma_m[kept])


def soil_cells(xyz_m: FloatArray, cell_m: float = CELL_M) -> SoilCells:
    """The cells of points (n, 3) of bare soil that hold enough of them and are even."""
    if not len(xyz_m):
        return SoilCells(np.zeros((0, 2)), np.zeros(0), np.zeros(0))
    (west, south), (east, north) = xyz_m[:, :2].min(axis=0).tolist(), xyz_m[:, :2].max(axis=0).tolist()
    grid = Grid.of_bounds(cell_m, (west, south, east, north))
    out = np.empty((min(grid.rows * grid.columns, len(xyz_m)), 4))
    cell = np.floor(xyz_m[:, :2] / cell_m).astype(np.int64) - (grid.west, grid.north - grid.rows)
    count = _cells(np.ascontiguousarray(xyz_m), cell[:, 1] * grid.columns + cell[:, 0], grid.rows * grid.columns, out)
    return SoilCells(out[:count, :2].copy(), out[:count, 2].copy(), out[:count, 3].copy())


@njit(cache=True, nogil=True)
def _cells(points, cell, cells, out):  # type: ignore[no-untyped-def]
    """Mean place, median height and its standard deviation of the even cells that hold enough points; their number."""
    starts = np.zeros(cells + 1, np.int64)
    for k in range(len(cell)):
        starts[cell[k] + 1] += 1
    for c in range(cells):
        starts[c + 1] += starts[c]
    place, order = starts[:-1].copy(), np.empty(len(cell), np.int64)
    for k in range(len(cell)):
        order[place[cell[k]]] = k
        place[cell[k]] += 1
    found = 0
    for c in range(cells):
        first, n = starts[c], starts[c + 1] - starts[c]
        if n < FEWEST_POINTS:
            continue
        heights = np.empty(n)
        x, y, base = 0.0, 0.0, points[order[first]]
        for k in range(n):
            point = points[order[first + k]]
            heights[k] = point[2]
            x += point[0] - base[0]
            y += point[1] - base[1]
        heights.sort()
        quartiles = np.empty(3)
        for q in range(3):
            at = 0.25 * (q + 1) * (n - 1)
            low = int(at)
            quartiles[q] = heights[low] + (at - low) * (heights[min(low + 1, n - 1)] - heights[low])
        spread = quartiles[2] - quartiles[0]
        if spread <= SPREAD_M:
            out[found, 0], out[found, 1], out[found, 2] = base[0] + x / n, base[1] + y / n, quartiles[1]
            out[found, 3] = MEDIAN_LOSS * max(spread / 1.349, 1e-3) / np.sqrt(n)
            found += 1
    return found


def without_crop(cells: SoilCells) -> SoilCells:
    """Cells near one parcel without those that lie above or below the others.

    A plane is fitted by least squares to the lower part of the cells, over which crop of parcels that the user does not
    name stands; then cells farther from it than three standard deviations (from the median of the distances) are left
    out, and the plane fitted to the others, until nothing changes.
    """
    if not len(cells):
        return cells
    kept = np.ones(len(cells), np.bool_)
    design = np.column_stack([np.ones(len(cells)), cells.xy_m - cells.xy_m.mean(axis=0)])
    for number in range(_ROUNDS):
        if kept.sum() <= design.shape[1]:
            break
        some = design[kept]
        # of cells in a row the plane of least slope
        plane = np.linalg.lstsq(some.T @ some, some.T @ cells.height_m[kept])[0]
        off = cells.height_m - design @ plane
        if number < _LOW_ROUNDS:
            lowest = round(LOW_SHARE * (len(off) - 1))
            now = off <= np.partition(off, lowest)[lowest]
        else:
            off = off - np.median(off[kept])
            limit = max(REJECTED * 1.4826 * float(np.median(np.abs(off[kept]))), LEAST_REJECTED_M)
            now = np.abs(off) <= limit
            if (now == kept).all():
                break
        kept = now
    return cells.at(kept)


def noise_in_pixels(xyz_m: FloatArray, pixel_m: float) -> FloatArray:
    """Standard deviations (k,) of the heights in each pixel of points (n, 3) of soil that holds three or more.

    They are from half the mean distance of two heights (the second L-moment), which for normal noise is the standard
    deviation over √π, without bias for any number of points.
    """
    if not len(xyz_m):
        return np.zeros(0)
    (west, south), (east, north) = xyz_m[:, :2].min(axis=0).tolist(), xyz_m[:, :2].max(axis=0).tolist()
    grid = Grid.of_bounds(pixel_m, (west, south, east, north))
    column, row = xyz_m[:, 0] / pixel_m - grid.west, grid.north - xyz_m[:, 1] / pixel_m
    means = pixel_returns(column, row, xyz_m[:, 2], grid).means_m(np.ones(grid.shape, np.bool_))
    out: FloatArray = np.sqrt(np.pi) * (means[:, 1] - means[:, 0])
    return out
