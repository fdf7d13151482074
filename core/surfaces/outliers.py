"""Outlier detection by neighbour distances: of points in memory, and of the tiles of a spool with those around."""

import math
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Final, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial import cKDTree

from furrowmap.core.runtime.arrays import FloatArray
from furrowmap.core.runtime.record_spool import Square
from furrowmap.core.runtime.settings import threads
from furrowmap.core.surfaces.grid import Grid
from furrowmap.core.surfaces.spool import SPOOL_TILE, PointSpool, TilePoints

Outliers = Literal["none", "radius", "statistical"]

OUTLIER_REACH_M: Final = 5.0
OUTLIER_RADIUS_M: Final = 0.5
MIN_RADIUS_CELLS: Final = 1.5
"""Of the radius, as points are placed at cell centres."""
NEIGHBOUR_TILE_M: Final = 32.0
NEIGHBOURS: Final = 8
"""Neighbours whose mean distance is compared."""
MAX_DISTANCE_SIGMAS: Final = 2.0
"""Threshold above the mean."""
THINNED_M: Final = 0.5
STATISTICS_SQUARE_M: Final = 16.0
"""Side of the squares of the statistics, which cover three by three of them."""
_SHORT: Final = 1 << 16
_BESIDE: Final = [(i, j) for i in (-1.0, 0.0, 1.0) for j in (-1.0, 0.0, 1.0) if i or j]


@dataclass(frozen=True)
class PointTile:
    """A square of the map: the indices of its points (m,), and these followed by those in the margin (k,)."""

    own: NDArray[np.intp]
    members: NDArray[np.intp]


def tiles(xyz_m: NDArray[np.float64], tile_m: float, margin_m: float) -> Iterator[PointTile]:
    """The squares that hold finite points (n, 2 or 3), each with the points in a margin of at most its side."""
    if not 0.0 <= margin_m <= tile_m:
        raise ValueError(f"a margin of {margin_m} m round squares of {tile_m} m")
    if not len(xyz_m):
        return
    (columns, column), (rows, row) = (_number_values(np.floor(axis / tile_m)) for axis in xyz_m[:, :2].T)
    key = column * len(rows) + row
    if len(columns) * len(rows) <= _SHORT:
        key = key.astype(np.uint16)  # numpy sorts short numbers by their digits, several times as fast
    order = np.argsort(key, kind="stable")
    keys, first = np.unique(key[order], return_index=True)
    squares = [(float(columns[k // len(rows)]), float(rows[k % len(rows)])) for k in keys.tolist()]
    parts = dict(zip(squares, np.split(order, first[1:]), strict=True))
    for (x, y), own in parts.items():
        beside = [parts[x + i, y + j] for i, j in _BESIDE if (x + i, y + j) in parts]
        around = np.concatenate(beside) if beside else np.zeros(0, np.intp)
        low = np.array([x, y]) * tile_m - margin_m
        within = np.all((xyz_m[around, :2] >= low) & (xyz_m[around, :2] < low + tile_m + 2.0 * margin_m), axis=1)
        yield PointTile(own, np.concatenate([own, around[within]]))


def _number_values(place: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.intp]]:
    """Sorted unique values, and the index (n,) of each value among them."""
    low = place.min()
    if place.max() - low < _SHORT:
        step = (place - low).astype(np.intp)
        there = np.bincount(step) > 0
        return np.flatnonzero(there) + low, (np.cumsum(there) - 1)[step]
    levels, number = np.unique(place, return_inverse=True)
    return levels, number


def radius_outliers(xyz_m: ArrayLike, radius_m: float = 0.5, fewest: int = 3) -> NDArray[np.bool_]:
    """Which points (n, 3) have fewer than `fewest` others within `radius_m`; also those that are not finite."""
    distance_m = _neighbour_distances(np.asarray(xyz_m, np.float64), fewest, radius_m)
    out: NDArray[np.bool_] = ~(distance_m[:, -1] <= radius_m)
    return out


def mean_neighbour_distance(xyz_m: FloatArray, reach_m: float = 5.0, asked: int | None = None) -> FloatArray:
    """Mean neighbour distance of the first `asked` of points (n, 3), or all; inf with too few in reach."""
    mean_m: FloatArray = _neighbour_distances(xyz_m, NEIGHBOURS, reach_m, asked).mean(axis=1)
    return mean_m


def thin_points(xyz_m: FloatArray) -> FloatArray:
    """The first 9 of points (n, 3) in each cube of half a metre, as neighbours of isolated points.

    Distances to them are too large by less than the diagonal of a cube, and exact where points are sparse.
    """
    cube = np.floor(xyz_m / THINNED_M)
    order = np.lexsort(cube.T)  # stable: the first of a cube stay first
    new = np.ones(len(order), bool)
    new[1:] = np.any(np.diff(cube[order], axis=0) != 0, axis=1)
    begin = np.flatnonzero(new)
    rank = np.arange(len(order)) - np.repeat(begin, np.diff(np.append(begin, len(order))))
    few: FloatArray = xyz_m[np.sort(order[rank <= NEIGHBOURS])]
    return few


def mean_distance_to(xyz_m: FloatArray, few_m: FloatArray, reach_m: float) -> FloatArray:
    """Mean distance (n,) of points (n, 3) to the nearest of others (m, 3), which may include themselves."""
    if not len(few_m):
        return np.full(len(xyz_m), np.inf)
    ranks = np.arange(1, NEIGHBOURS + 2)
    found, _ = cKDTree(few_m).query(xyz_m, ranks, distance_upper_bound=np.nextafter(reach_m, np.inf))
    distance: FloatArray = np.asarray(found)
    itself = distance[:, 0] == 0.0
    mean_m: FloatArray = np.where(itself, distance[:, 1:].mean(axis=1), distance[:, :-1].mean(axis=1))
    return mean_m


class NeighbourStatistics:
    """Local mean and standard deviation of neighbour distances, accumulated over points.

    Statistical outlier removal after R. B. Rusu, Z. C. Marton, N. Blodow, M. Dolha, M. Beetz (2008), Towards 3D point
    cloud based object maps for household environments, Robotics and Autonomous Systems 56, 927-941, but with statistics
    of the squares of 16 m around a point instead of the whole cloud, as point spacing grows with range. Squares start
    at the CRS origin, so that results do not depend on tiling.
    """

    def __init__(self) -> None:
        self._sums: dict[tuple[float, float], FloatArray] = {}

    def add(self, xy_m: FloatArray, mean_m: FloatArray) -> None:
        """Add the mean distances (n,) of points (n, 2 or 3); infinite ones are ignored."""
        near = np.isfinite(mean_m)
        squares, number = self._squares(xy_m[near])
        of_each = [np.bincount(number, mean_m[near] ** power, len(squares)) for power in (0, 1, 2)]
        for square, sums in zip(squares, np.column_stack(of_each), strict=True):
            self._sums[square] = self._sums.get(square, 0.0) + sums

    def exceeded(self, xy_m: FloatArray, mean_m: FloatArray) -> NDArray[np.bool_]:
        """Which distances (n,) exceed the limit at their points (n, 2 or 3)."""
        near = np.isfinite(mean_m)
        squares, number = self._squares(xy_m[near])
        limits_m = np.empty(len(squares))
        for k, (column, row) in enumerate(squares):
            around = ((column + i, row + j) for i in (-1, 0, 1) for j in (-1, 0, 1))
            count, total, of_squares = sum((self._sums[key] for key in around if key in self._sums), np.zeros(3))
            usual_m = total / count
            sigma_m = np.sqrt(max(0.0, of_squares / count - usual_m * usual_m))
            limits_m[k] = usual_m + MAX_DISTANCE_SIGMAS * sigma_m
        out = ~near
        out[near] = ~(mean_m[near] <= limits_m[number])
        return out

    @staticmethod
    def _squares(xy_m: FloatArray) -> tuple[list[tuple[float, float]], NDArray[np.intp]]:
        """The squares that hold points, and the index of the square of each point."""
        there, number = np.unique(np.floor(xy_m[:, :2] / STATISTICS_SQUARE_M), axis=0, return_inverse=True)
        return [(column, row) for column, row in there.tolist()], number.ravel()


def _neighbour_distances(xyz_m: FloatArray, neighbours: int, reach_m: float, asked: int | None = None) -> FloatArray:
    """Distances (n or asked, neighbours) to the nearest other points; inf beyond the reach or for points not finite."""
    if neighbours < 1 or not 0.0 < reach_m <= NEIGHBOUR_TILE_M:
        raise ValueError(f"{neighbours} neighbours within {reach_m} m (at most {NEIGHBOUR_TILE_M} m)")
    known = np.flatnonzero(np.isfinite(xyz_m).all(axis=1))
    asked = len(xyz_m) if asked is None else asked
    out = np.full((asked, neighbours), np.inf)
    finite = xyz_m[known]
    for tile in tiles(finite, NEIGHBOUR_TILE_M, reach_m):
        of_tile = known[tile.own] < asked
        part = finite[tile.members]
        own = part[: len(tile.own)][of_tile]
        if not len(own):
            continue
        middle = own[0]
        tree = cKDTree(part - middle)
        ranks = np.arange(2, neighbours + 2)  # the nearest of all is the point itself
        distance, _ = tree.query(own - middle, ranks, distance_upper_bound=np.nextafter(reach_m, np.inf))
        out[known[tile.own][of_tile]] = distance
    return out


@dataclass(frozen=True)
class FilteredTiles:
    """Gives tiles without outliers; "statistical" needs the usual neighbour distances of all points."""

    spool: PointSpool
    outliers: Outliers
    usual: NeighbourStatistics

    def tile(self, key: Square) -> TilePoints:
        """The points of a tile without outliers. Threads may read several at once."""
        own = self.spool.tile(key)
        if self.outliers == "none" or not len(own.cell):
            return own
        if self.outliers == "radius":
            xyz = _surroundings(self.spool, key, own)
            alone = radius_outliers(xyz, max(OUTLIER_RADIUS_M, MIN_RADIUS_CELLS * self.spool.cell_m))[: len(own.cell)]
        else:
            alone = self.usual.exceeded(*_tile_distances(self.spool, key))
        return own.part(~alone)


def filter_tiles(spool: PointSpool, outliers: Outliers, progress: Callable[[float], None]) -> FilteredTiles:
    """The tiles of a spool; "statistical" reads all of them first and passes the share done to `progress`."""
    usual = NeighbourStatistics()
    keys = spool.tiles if outliers == "statistical" else []
    with ThreadPoolExecutor(threads()) as pool:
        for number, (xy_m, mean_m) in enumerate(pool.map(lambda key: _tile_distances(spool, key), keys), start=1):
            usual.add(xy_m, mean_m)
            progress(number / len(keys))
    return FilteredTiles(spool, outliers, usual)


def _tile_distances(spool: PointSpool, key: Square) -> tuple[FloatArray, FloatArray]:
    """Positions (n, 2) of the points of a tile, and their mean neighbour distances (n,)."""
    own = spool.tile(key)
    xyz = _surroundings(spool, key, own)
    mean_m = mean_neighbour_distance(xyz, reach_m=OUTLIER_REACH_M, asked=len(own.cell))
    west, _, _, north = own.grid.bounds_m
    return xyz[: len(own.cell), :2] + (west, north), mean_m


def _surroundings(spool: PointSpool, key: Square, own: TilePoints) -> FloatArray:
    """Positions (m, 3) from its north-west corner of the points of a tile, followed by those within reach of it."""
    tiles = math.ceil(OUTLIER_REACH_M / (SPOOL_TILE * spool.cell_m))
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
    width = near.columns * near.cell_m
    height = near.rows * near.cell_m
    inside = (
        (x >= -OUTLIER_REACH_M)
        & (x <= width + OUTLIER_REACH_M)
        & (y >= -height - OUTLIER_REACH_M)
        & (y <= OUTLIER_REACH_M)
    )
    return np.column_stack([x, y, points.height_m])[inside]
