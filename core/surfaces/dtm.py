"""The bare ground as a raster, and how high things stand above it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.ndimage import map_coordinates

from furrowmap.core.surfaces.gaps import filled
from furrowmap.core.surfaces.grid import Surface


def with_gaps_filled(surface: Surface, reach_m: float) -> Surface:
    """The surface with heights where it has none, flagged as filled; see :func:`~furrowmap.core.surfaces.gaps.filled`.

    A DTM is the surface of the points that are ground; under what stands on the ground it has gaps.

    Args:
        surface: its gaps are nan, and stay so as to count, spread and standard error.
        reach_m: cells farther than this from every measured height stay without one.
    """
    height = filled(surface.height_m.astype(np.float64), reach_m / surface.grid.cell_m).astype(np.float32)
    new = np.isfinite(height) & ~np.isfinite(surface.height_m)
    return replace(surface, height_m=height, filled=new if surface.filled is None else surface.filled | new)


def height_above_ground(xyz_m: ArrayLike, dtm: Surface) -> NDArray[np.float64]:
    """Height of points above the ground, which is straight between the middles of four cells.

    Args:
        xyz_m: (n, 3) easting, northing, height.
        dtm: the ground.

    Returns:
        (n,), nan where one of the four cells has no height; in the outer half of the outermost cells the ground goes on
        level.
    """
    xyz = np.asarray(xyz_m, np.float64).reshape(-1, 3)
    grid = dtm.grid
    column = xyz[:, 0] / grid.cell_m - grid.west - 0.5
    row = grid.north - xyz[:, 1] / grid.cell_m - 0.5
    inside = (np.abs(column - 0.5 * (grid.columns - 1)) <= 0.5 * grid.columns) & (
        np.abs(row - 0.5 * (grid.rows - 1)) <= 0.5 * grid.rows
    )
    place = np.where(inside, np.stack([row, column]), 0.0)
    ground = map_coordinates(dtm.height_m, place, np.float64, order=1, mode="nearest")
    above: NDArray[np.float64] = np.where(inside, xyz[:, 2] - ground, np.nan)
    return above
