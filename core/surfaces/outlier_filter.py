"""Tiles of a spool without outliers, detected with the points of the tiles around."""

from __future__ import annotations

import math
from collections.abc import Callable
from concurrent.futures import Executor
from dataclasses import dataclass
from typing import Final, Literal

import numpy as np
from numpy.typing import NDArray

from furrowmap.core.surfaces.grid import Grid
from furrowmap.core.surfaces.outliers import NeighbourStatistics, mean_neighbour_distance, radius_outliers
from furrowmap.core.surfaces.spool import TILE, PointSpool, TilePoints

FloatArray = NDArray[np.float64]
Key = tuple[int, int]
Outliers = Literal["none", "radius", "statistical"]

REACH_M: Final = 5.0
RADIUS_M: Final = 0.5
RADIUS_CELLS: Final = 1.5
"""Least radius in cells, as points are placed at cell centres."""


@dataclass(frozen=True)
class FilteredTiles:
    """Gives tiles without outliers.

    Attributes:
        spool: of the points.
        outliers: detection method.
        usual: neighbour distances of all points, for "statistical".
    """

    spool: PointSpool
    outliers: Outliers
    usual: NeighbourStatistics

    @classmethod
    def of(
        cls, spool: PointSpool, outliers: Outliers, pool: Executor, progress: Callable[[float], None]
    ) -> FilteredTiles:
        """The tiles of a spool; "statistical" reads all of them first and passes the share done to `progress`."""
        usual = NeighbourStatistics()
        keys = spool.tiles if outliers == "statistical" else []
        for number, (xy_m, mean_m) in enumerate(pool.map(lambda key: _measured(spool, key), keys), start=1):
            usual.add(xy_m, mean_m)
            progress(number / len(keys))
        return cls(spool, outliers, usual)

    def tile(self, key: Key) -> TilePoints:
        """The points of a tile without outliers. Threads may read several at once."""
        own = self.spool.tile(key)
        if self.outliers == "none" or not len(own.cell):
            return own
        if self.outliers == "radius":
            xyz = _surroundings(self.spool, key, own)
            alone = radius_outliers(xyz, max(RADIUS_M, RADIUS_CELLS * self.spool.cell_m))[: len(own.cell)]
        else:
            alone = self.usual.exceeded(*_measured(self.spool, key))
        return own.part(~alone)


def _measured(spool: PointSpool, key: Key) -> tuple[FloatArray, FloatArray]:
    """Positions (n, 2) of the points of a tile, and their mean neighbour distances (n,)."""
    own = spool.tile(key)
    xyz = _surroundings(spool, key, own)
    mean_m = mean_neighbour_distance(xyz, reach_m=REACH_M, asked=len(own.cell))
    west, _, _, north = own.grid.bounds_m
    return xyz[: len(own.cell), :2] + (west, north), mean_m


def _surroundings(spool: PointSpool, key: Key, own: TilePoints) -> FloatArray:
    """Positions (m, 3) from its north-west corner of the points of a tile, followed by those within reach of it."""
    tiles = math.ceil(REACH_M / (TILE * spool.cell_m))
    around = [
        _places(spool.tile((key[0] + i, key[1] + j)), own.grid)
        for i in range(-tiles, tiles + 1)
        for j in range(-tiles, tiles + 1)
        if i or j
    ]
    return np.concatenate([_places(own, own.grid), *around])


def _places(points: TilePoints, near: Grid) -> FloatArray:
    """Positions (n, 3) of points in a tile or within reach of it."""
    row, column = np.divmod(points.cell.astype(np.int64), points.grid.columns)
    x = (points.grid.west - near.west + column + 0.5) * near.cell_m
    y = (points.grid.north - near.north - row - 0.5) * near.cell_m
    width, height = near.columns * near.cell_m, near.rows * near.cell_m
    inside = (x >= -REACH_M) & (x <= width + REACH_M) & (y >= -height - REACH_M) & (y <= REACH_M)
    return np.column_stack([x, y, points.height_m])[inside]
