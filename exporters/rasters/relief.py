"""Shaded relief from the coarse levels of a cloud, as the background of a map."""

from pathlib import Path
from typing import Final

import laspy
import numpy as np
from laspy.copc import Bounds
from numpy.typing import NDArray
from scipy import ndimage

from furrowmap.core.runtime.arrays import FloatArray

Box = tuple[float, float, float, float]
"""West, south, east, north."""

MAX_RELIEF_POINTS: Final = 250_000
POINTS_PER_RELIEF_CELL: Final = 6
MAX_RELIEF_SIDE: Final = 500
MAX_FILLED_CELLS: Final = 3
"""Cells without a point are drawn up to this distance from one."""
VERTICAL_EXAGGERATION: Final = 3.0
DARKEST_GREY: Final = 150.0


def shaded_ground(cloud: Path, points_by_level: tuple[int, ...], box_m: Box) -> NDArray[np.uint8] | None:
    """Shaded relief of the ground in a box, from the coarse levels of a COPC file; None for no points.

    Pixels (rows, columns, 2) of grey and alpha, north on top, which fill the box.
    """
    enough = int(np.searchsorted(np.cumsum(points_by_level), MAX_RELIEF_POINTS, side="right"))
    west, south, east, north = box_m
    with laspy.CopcReader.open(cloud) as reader:
        bounds = Bounds(np.array([west, south]), np.array([east, north]))
        points = reader.query(bounds=bounds, level=range(max(1, enough)))
        x, y, z = (np.asarray(axis, np.float64) for axis in (points.x, points.y, points.z))
    if not len(x):
        return None
    width_m = east - west
    height_m = north - south
    cell_m = max(
        np.sqrt(POINTS_PER_RELIEF_CELL * width_m * height_m / len(x)), max(width_m, height_m) / MAX_RELIEF_SIDE
    )
    columns = max(2, round(width_m / cell_m))
    rows = max(2, round(height_m / cell_m))
    column = np.clip(((x - west) * (columns / width_m)).astype(np.intp), 0, columns - 1)
    row = np.clip(((north - y) * (rows / height_m)).astype(np.intp), 0, rows - 1)
    lowest = _lowest(row * columns + column, z, rows * columns).reshape(rows, columns)
    return _shaded(lowest, cell_m)


def _lowest(cell: NDArray[np.intp], z: FloatArray, cells: int) -> FloatArray:
    """The least height in each cell; nan for none."""
    order = np.lexsort((z, cell))
    there, first = np.unique(cell[order], return_index=True)
    out = np.full(cells, np.nan)
    out[there] = z[order][first]
    return out


def _shaded(height_m: FloatArray, cell_m: float) -> NDArray[np.uint8]:
    """Lit from the north-west at 45 degrees; transparent far from any point."""
    away, (row, column) = ndimage.distance_transform_edt(np.isnan(height_m), return_indices=True)
    ground = ndimage.median_filter(height_m[row, column], 3)
    down, right = np.gradient(ground * VERTICAL_EXAGGERATION, cell_m)
    light = (1.0 + (down + right) * np.sqrt(0.5)) / np.sqrt(2.0) / np.sqrt(1.0 + down**2 + right**2)
    grey = np.clip(255.0 - (np.sqrt(0.5) - light) * 160.0 - 20.0, DARKEST_GREY, 255.0)
    alpha = np.where(away <= MAX_FILLED_CELLS, 255, 0)
    return np.stack([grey, alpha], axis=-1).astype(np.uint8)
