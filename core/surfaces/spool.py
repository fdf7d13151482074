"""Points sorted into square tiles in a temporary file, so that memory does not grow with a surface."""

from collections.abc import Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from furrowmap.core.runtime.arrays import FloatArray
from furrowmap.core.runtime.kernels import kernel, kernel_part
from furrowmap.core.runtime.record_spool import RecordSpool, Square, square_keys, square_of
from furrowmap.core.surfaces.grid import Grid, Surface
from furrowmap.core.surfaces.statistic import Statistic, cell_surface
from furrowmap.core.values.extents import bounds

SPOOL_TILE: Final = 256
"""Cells a side, so that a cell index has 16 bits."""
HELD: Final = 1 << 19
"""Points collected in memory before they are sorted and written, while as many others are collected."""
TILE_RECORD: Final = np.dtype([("cell", "<u2"), ("height_m", "<f4"), ("t_s", "<f4")])


@dataclass(frozen=True)
class TilePoints:
    """The points of one tile in their original order.

    Attributes:
        cell: (n,) uint16 flat cell index.
        height_m: (n,) float32 less `base_m`.
        t_s: (n,) float32 seconds after `begin_s`.
        base_m: height offset.
        begin_s: UTC of the first point of the spool.
    """

    grid: Grid
    cell: NDArray[np.uint16]
    height_m: NDArray[np.float32]
    t_s: NDArray[np.float32]
    base_m: float
    begin_s: float

    def part(self, kept: NDArray[np.bool_]) -> "TilePoints":
        """A subset of the points."""
        arrays = self.cell[kept], self.height_m[kept], self.t_s[kept]
        return TilePoints(self.grid, *arrays, self.base_m, self.begin_s)

    def coarser(self, factor: int) -> "TilePoints":
        """The same points in cells a power of two, at most SPOOL_TILE, times as large."""
        if factor == 1:
            return self
        row, column = np.divmod(self.cell, SPOOL_TILE)
        cell = (row // factor) * (SPOOL_TILE // factor) + column // factor
        return replace(self, grid=self.grid.coarser(factor), cell=cell)

    def surface(self, statistic: Statistic, kept: NDArray[np.bool_] | None = None) -> Surface:
        """The surface of the tile, of all points or those kept (n,)."""
        return cell_surface(self.grid, self.cell, self.height_m, self.base_m, statistic, kept)


class TileBuffers(NamedTuple):
    """Points to be written: column and row of their tiles (HELD, 2), and what :class:`TilePoints` has of them."""

    tile: NDArray[np.int32]
    cell: NDArray[np.uint16]
    height_m: NDArray[np.float32]
    t_s: NDArray[np.float32]


def _buffers() -> TileBuffers:
    return TileBuffers(np.empty((HELD, 2), np.int32), np.empty(HELD, np.uint16), *np.empty((2, HELD), np.float32))


class PointSpool:
    """Takes points in any order and returns them tile by tile: a context manager.

    Memory is some 40 MB and that of the largest tile; the temporary file has 10 bytes a point. Full buffers are sorted
    and written by a thread. Heights are stored as float32 less `base_m`, which should be near them.
    """

    def __init__(self, cell_m: float, base_m: float = 0.0, folder: Path | None = None) -> None:
        Grid(cell_m, 0, 0, (1, 1))  # raises on a bad cell size
        self.cell_m = cell_m
        self.base_m = base_m
        self._records = RecordSpool(TILE_RECORD, folder)
        self._points = _buffers()
        self._others = _buffers()
        self._writer = ThreadPoolExecutor(1)
        self._written: Future[None] | None = None
        self._held = 0
        self._begin_s: float | None = None
        self._ends = (2**62, 2**62, -(2**62), -(2**62))

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._writer.shutdown()
        self._records.close()

    def add(
        self,
        xyz_m: FloatArray,
        t_s: FloatArray | None = None,
        kept: NDArray[np.bool_] | None = None,
        origin_m: tuple[float, float, float] = (0.0, 0.0, 0.0),
    ) -> None:
        """Add points (n, 3) less `origin_m`, if finite, and UTC (n,) where needed; raises OSError at a full disk."""
        n = len(xyz_m)
        times = np.zeros(n) if t_s is None else np.ascontiguousarray(t_s, np.float64)
        if self._begin_s is None and n:
            self._begin_s = float(times[0])
        mask = np.ones(n, bool) if kept is None else np.ascontiguousarray(kept)
        points = np.ascontiguousarray(xyz_m, np.float64)
        shift = np.array([*origin_m[:2], origin_m[2] - self.base_m, -(self._begin_s or 0.0)])
        done = 0
        while done < n:
            done, self._held, self._ends = collect(
                points, times, mask, done, shift, self.cell_m, self._points, self._ends, self._held
            )
            if self._held == HELD:
                self._hand_over()

    @property
    def grid(self) -> Grid | None:
        """The smallest grid over all points, if any. Raises InputError if it has more cells than any raster."""
        self._hand_over()
        self._wait()
        return self._covering() if self._records.counts else None

    @property
    def tiles(self) -> list[Square]:
        """Column and row from the CRS origin of the tiles with points: north first, then west; as :attr:`grid`."""
        squares = map(square_of, self._records.counts) if self.grid is not None else ()
        return sorted(squares, key=lambda square: (-square[1], square[0]))

    def tile(self, key: Square) -> TilePoints:
        """The points of a tile. Threads may read several at once, after :attr:`tiles` has been read."""
        cell, height_m, t_s = self._records.read_fields([square_keys(*key)])
        grid = Grid(self.cell_m, key[0] * SPOOL_TILE, (key[1] + 1) * SPOOL_TILE, (SPOOL_TILE, SPOOL_TILE))
        return TilePoints(grid, cell, height_m, t_s, self.base_m, self._begin_s or 0.0)

    def __iter__(self) -> Iterator[TilePoints]:
        return (self.tile(key) for key in self.tiles)

    def _covering(self) -> Grid:
        west, south, east, north = self._ends
        return Grid(self.cell_m, west, north + 1, (north + 1 - south, east + 1 - west))

    def _hand_over(self) -> None:
        """Start writing the buffers and switch to the others."""
        self._wait()
        if self._held:
            self._covering()  # raises on too large a grid
            self._written = self._writer.submit(self._write, self._points, self._held)
            self._points, self._others, self._held = self._others, self._points, 0

    def _wait(self) -> None:
        """Wait for the writer and raise its errors."""
        written = self._written
        self._written = None
        if written is not None:
            written.result()

    def _write(self, points: TileBuffers, held: int) -> None:
        """Sort points by tile and append them to the file."""
        low, high = bounds(points.tile[:held])
        columns, rows = (high - low + 1).tolist()
        records, starts = sort_by_tile(*(array[:held] for array in points), low, columns, rows)
        there = np.flatnonzero(np.diff(starts))
        column, row = np.divmod(there, rows)
        self._records.append([records], square_keys(column + low[0], row + low[1]), np.append(starts[there], held))


@kernel_part()
def collect(xyz_m, t_s, kept, first, shift, cell_m, buffers, ends, held):  # type: ignore[no-untyped-def]
    """Add points from index `first` on until the buffers are full: where it stopped, how many are held, and `ends`.

    Coordinates and times are stored with a `shift`; `ends` are the least and greatest column and row of all cells.
    """
    west, south, east, north = ends
    stopped = len(xyz_m)
    for i in range(first, len(xyz_m)):
        if held == len(buffers.cell):
            stopped = i
            break
        x = xyz_m[i, 0] + shift[0]
        y = xyz_m[i, 1] + shift[1]
        z = xyz_m[i, 2] + shift[2]
        if not kept[i] or not np.isfinite(x + y + z + t_s[i]):
            continue
        column = int(np.floor(x / cell_m))
        row = int(np.floor(y / cell_m))
        west = min(west, column)
        east = max(east, column)
        south = min(south, row)
        north = max(north, row)
        buffers.tile[held, 0] = column >> 8
        buffers.tile[held, 1] = row >> 8
        buffers.cell[held] = (255 - (row & 255)) * 256 + (column & 255)
        buffers.height_m[held] = z
        buffers.t_s[held] = t_s[i] + shift[3]
        held += 1
    return stopped, held, (west, south, east, north)


@kernel()
def sort_by_tile(tiles, cells, heights, times, low, columns, rows):  # type: ignore[no-untyped-def]
    """Records sorted by column and row of their tile, and the first record of each tile (tiles + 1,)."""
    n = len(heights)
    starts = np.zeros(columns * rows + 1, np.int64)
    tile = np.empty(n, np.int32)
    for i in range(n):
        tile[i] = (tiles[i, 0] - low[0]) * rows + tiles[i, 1] - low[1]
        starts[tile[i] + 1] += 1
    for k in range(columns * rows):
        starts[k + 1] += starts[k]
    place = starts.copy()
    out = np.empty(n, TILE_RECORD)
    for i in range(n):
        record = out[place[tile[i]]]
        place[tile[i]] += 1
        record.cell = cells[i]
        record.height_m = heights[i]
        record.t_s = times[i]
    return out, starts
