"""Which part of a field is not worked yet."""

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from furrowmap.core.coverage.worked_cells import CELL_SIDE_M, OVERLAP, TILE_CELLS, WORKED, Tile, WorkedCells
from furrowmap.core.runtime.arrays import FloatArray


class FieldLeft:
    """Counts the cells of ground worked inside of a boundary, tile by tile as they change."""

    def __init__(self, boundary: BaseGeometry) -> None:
        shapely.prepare(boundary)
        self._boundary = boundary
        self._worked: dict[Tile, int] = {}

    @property
    def left_m2(self) -> float:
        """Area of the field that is not worked, in the map's plane."""
        return max(0.0, float(self._boundary.area) - sum(self._worked.values()) * CELL_SIDE_M**2)

    def rings(self, inside_m: float = 0.0) -> list[FloatArray]:
        """The boundary, or what lies so far inside of it: each ring (n, 2) easting and northing."""
        area = self._boundary if inside_m == 0.0 else self._boundary.buffer(-inside_m, join_style="mitre")
        return [shapely.get_coordinates(line) for line in shapely.get_parts(shapely.boundary(area))]

    def look_at(self, cells: WorkedCells, tiles: set[Tile]) -> None:
        """Count the cells of tiles anew."""
        middle = CELL_SIDE_M * (np.arange(TILE_CELLS) + 0.5)
        for tile in tiles:
            state = cells.tiles().get(tile)
            if state is None:
                continue
            row, column = np.nonzero((state == WORKED) | (state == OVERLAP))
            corner_m = CELL_SIDE_M * TILE_CELLS * np.array(tile)
            inside = shapely.contains_xy(self._boundary, corner_m[0] + middle[column], corner_m[1] + middle[row])
            self._worked[tile] = int(inside.sum())
