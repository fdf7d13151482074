"""Bare soil between and around parcels: heights of its cells, without crop that reaches into them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
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
    cell = np.floor(xyz_m[:, :2] / cell_m).astype(np.int64)
    order = np.lexsort((xyz_m[:, 2], cell[:, 0], cell[:, 1]))
    cell, points = cell[order], xyz_m[order]
    first = np.flatnonzero(np.r_[True, (np.diff(cell, axis=0) != 0).any(axis=1)]) if len(cell) else np.zeros(0, np.intp)
    count = np.diff(np.r_[first, len(cell)])

    def quantile(share: float) -> FloatArray:
        place = first + share * (count - 1)
        low = np.floor(place).astype(np.intp)
        part = place - low
        values: FloatArray = points[low, 2] + part * (points[np.minimum(low + 1, len(points) - 1), 2] - points[low, 2])
        return values

    if not len(first):
        return SoilCells(np.zeros((0, 2)), np.zeros(0), np.zeros(0))
    scatter = (quantile(0.75) - quantile(0.25)) / 1.349
    xy = np.add.reduceat(points[:, :2] - points[0, :2], first, axis=0) / count[:, None] + points[0, :2]
    sigma = MEDIAN_LOSS * np.maximum(scatter, 1e-3) / np.sqrt(count)
    even = (count >= FEWEST_POINTS) & (1.349 * scatter <= SPREAD_M)
    return SoilCells(xy, quantile(0.5), sigma).at(even)


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
        off = cells.height_m - design @ np.linalg.lstsq(design[kept], cells.height_m[kept])[0]
        if number < _LOW_ROUNDS:
            now = off <= np.quantile(off, LOW_SHARE)
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
    means = pixel_returns(column, row, xyz_m[:, 2], grid).means_m
    second = means[..., 1] - means[..., 0]
    out: FloatArray = np.sqrt(np.pi) * second[np.isfinite(second)]
    return out
