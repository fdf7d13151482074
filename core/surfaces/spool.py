"""Points sorted into square tiles in a scratch file, so that a surface is made tile by tile, however large it is."""

from __future__ import annotations

import os
import tempfile
import threading
from collections.abc import Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Any, Final, NamedTuple, Self

import numba
import numpy as np
from numpy.typing import NDArray

from furrowmap.core.surfaces.grid import Grid

FloatArray = NDArray[np.float64]

TILE: Final = 256
"""Cells a side: so a cell of a tile has a number of 16 bits."""
HELD: Final = 1 << 20
"""Points in memory until they are sorted and written, while as many others are collected."""


@dataclass(frozen=True)
class TilePoints:
    """The points of one tile, in the order in which they came.

    Attributes:
        grid: the tile's cells.
        cell: (n,) uint16 flat index of the cell of each point.
        height_m: (n,) float32 less `base_m`.
        t_s: (n,) float32 seconds after `begin_s`.
        base_m: height that is taken off.
        begin_s: UTC of the first point that came to the spool.
    """

    grid: Grid
    cell: NDArray[np.uint16]
    height_m: NDArray[np.float32]
    t_s: NDArray[np.float32]
    base_m: float
    begin_s: float

    def part(self, kept: NDArray[np.bool_]) -> TilePoints:
        """Those of the points that are kept."""
        arrays = self.cell[kept], self.height_m[kept], self.t_s[kept]
        return TilePoints(self.grid, *arrays, self.base_m, self.begin_s)


@dataclass(frozen=True)
class _Block:
    """Points sorted by tile as they stand in the file: all cells, all heights, all times.

    Attributes:
        offset: of the block in the file.
        tiles: column and row of each tile -> first and behind the last of its points.
        points: in the block.
    """

    offset: int
    tiles: dict[tuple[int, int], tuple[int, int]]
    points: int


class _Held(NamedTuple):
    """Room for points that wait to be written: their tiles (HELD, 2), and cells in these, heights and times (HELD,)."""

    tiles: NDArray[np.int32]
    cells: NDArray[np.uint16]
    heights: NDArray[np.float32]
    times: NDArray[np.float32]

    @classmethod
    def none(cls) -> Self:
        heights, times = np.empty((2, HELD), np.float32)
        return cls(np.empty((HELD, 2), np.int32), np.empty(HELD, np.uint16), heights, times)


class PointSpool:
    """Takes points in any order and gives them back tile by tile: a context manager, whose scratch file has no name.

    Memory is some 80 MB, and that of the largest tile; the scratch file takes 10 bytes a point. What is held is sorted
    and written by a thread of the spool's own, while its owner goes on.

    Args:
        cell_m: length of a cell's sides.
        base_m: a height near all others: heights are kept as float32 less this.
        folder: for the scratch file; None for the system's own.
    """

    def __init__(self, cell_m: float, base_m: float = 0.0, folder: Path | None = None) -> None:
        Grid(cell_m, 0, 0, (1, 1))  # says what is wrong with the cell size
        self.cell_m, self.base_m = cell_m, base_m
        self._file = tempfile.TemporaryFile(prefix="furrowmap-", dir=folder)  # noqa: SIM115  # closed with the spool
        self._points, self._others = _Held.none(), _Held.none()
        self._writer = ThreadPoolExecutor(1)
        self._written: Future[None] | None = None
        self._reading = threading.Lock()
        self._held = 0
        self._blocks: list[_Block] = []
        self._begin_s: float | None = None
        self._ends = np.array([2**62, 2**62, -(2**62), -(2**62)])

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._writer.shutdown()
        self._file.close()

    def add(
        self,
        xyz_m: FloatArray,
        t_s: FloatArray | None = None,
        kept: NDArray[np.bool_] | None = None,
        origin_m: tuple[float, float, float] = (0.0, 0.0, 0.0),
    ) -> None:
        """Take points.

        Args:
            xyz_m: (n, 3) easting, northing, height less `origin_m`; those that are not finite are passed over.
            t_s: (n,) UTC; None where times play no part.
            kept: (n,) which points to take; None for all.
            origin_m: what is taken off the coordinates.

        Raises:
            OSError: if the scratch file cannot be written.
        """
        n = len(xyz_m)
        times = np.zeros(n) if t_s is None else np.ascontiguousarray(t_s, np.float64)
        if self._begin_s is None and n:
            self._begin_s = float(times[0])
        mask = np.ones(n, bool) if kept is None else np.ascontiguousarray(kept)
        points = np.ascontiguousarray(xyz_m, np.float64)
        shift = np.array([*origin_m[:2], origin_m[2] - self.base_m])
        done = 0
        while done < n:
            done, self._held = collect(
                points, times, mask, done, shift, self.cell_m, self._begin_s or 0.0,
                *self._points, self._ends, self._held,
            )  # fmt: skip
            if self._held == HELD:
                self._hand_over()

    @property
    def grid(self) -> Grid | None:
        """The least grid that covers all points; None where there are none.

        Raises:
            InputError: if it has more cells than any raster.
        """
        self._hand_over()
        self._wait()
        return self._covering() if self._blocks else None

    @property
    def tiles(self) -> list[tuple[int, int]]:
        """Column and row, counted from the CRS's 0, of the tiles in which there are points: north first, then west.

        Raises:
            InputError: as :attr:`grid`.
        """
        if self.grid is None:
            return []
        return sorted({key for block in self._blocks for key in block.tiles}, key=lambda key: (-key[1], key[0]))

    def tile(self, key: tuple[int, int]) -> TilePoints:
        """The points of a tile. Threads may ask for several at once, after :attr:`tiles` has been asked for."""
        parts = [(block, *block.tiles[key]) for block in self._blocks if key in block.tiles]
        return TilePoints(
            Grid(self.cell_m, key[0] * TILE, (key[1] + 1) * TILE, (TILE, TILE)),
            self._read(parts, np.dtype(np.uint16), 0),
            self._read(parts, np.dtype(np.float32), 2),
            self._read(parts, np.dtype(np.float32), 6),
            self.base_m,
            self._begin_s or 0.0,
        )

    def __iter__(self) -> Iterator[TilePoints]:
        return (self.tile(key) for key in self.tiles)

    def _covering(self) -> Grid:
        west, south, east, north = self._ends.tolist()
        return Grid(self.cell_m, west, north + 1, (north + 1 - south, east + 1 - west))

    def _hand_over(self) -> None:
        """Let what is held be written, and go on with other arrays."""
        self._wait()
        if self._held:
            self._covering()  # refuses what no raster holds
            self._written = self._writer.submit(self._write, self._points, self._held)
            self._points, self._others, self._held = self._others, self._points, 0

    def _wait(self) -> None:
        """Until everything handed over is in the file; raises what went wrong with it."""
        written, self._written = self._written, None
        if written is not None:
            written.result()

    def _write(self, points: _Held, held: int) -> None:
        """Sort points by tile and append them to the file."""
        low, high = bounds(points.tiles[:held])
        columns, rows = (high - low + 1).tolist()
        *sorted_points, starts = sort_by_tile(*(array[:held] for array in points), low, columns, rows)
        there = np.flatnonzero(np.diff(starts)).tolist()
        tiles = {
            (int(low[0]) + k % columns, int(low[1]) + k // columns): (int(starts[k]), int(starts[k + 1])) for k in there
        }
        offset = self._file.seek(0, os.SEEK_END)
        for array in sorted_points:
            self._file.write(array.data)
        self._file.flush()
        self._blocks.append(_Block(offset, tiles, held))

    def _read(self, parts: list[tuple[_Block, int, int]], dtype: np.dtype[np.generic], skipped: int) -> NDArray[Any]:
        """One array of a tile; `skipped` bytes a point stand before it in each block."""
        out = np.empty(sum(end - begin for _, begin, end in parts), dtype)
        done = 0
        for block, begin, end in parts:
            into = out[done : done + end - begin].view(np.uint8).data
            with self._reading:
                self._file.seek(block.offset + skipped * block.points + begin * dtype.itemsize)
                if self._file.readinto(into) != into.nbytes:
                    raise OSError("the scratch file of the surfaces is shorter than was written")
            done += end - begin
        return out


@numba.njit(
    "UniTuple(int64, 2)(float64[:, ::1], float64[::1], boolean[::1], int64, float64[::1], float64, float64,"
    " int32[:, ::1], uint16[::1], float32[::1], float32[::1], int64[::1], int64)",
    cache=True,
    nogil=True,
)
def collect(xyz_m, t_s, kept, first, shift_m, cell_m, begin_s, tiles, cells, heights, times, ends, held):  # type: ignore[no-untyped-def]
    """Take points from number `first` on until there is no more room: where it stopped, and how many are held.

    `ends` are the least column and row, and the greatest ones, of all cells.
    """
    west, south, east, north = ends[0], ends[1], ends[2], ends[3]
    stopped = len(xyz_m)
    for i in range(first, len(xyz_m)):
        if held == len(heights):
            stopped = i
            break
        x, y, z = xyz_m[i, 0] + shift_m[0], xyz_m[i, 1] + shift_m[1], xyz_m[i, 2] + shift_m[2]
        if not kept[i] or not np.isfinite(x + y + z + t_s[i]):
            continue
        column, row = int(np.floor(x / cell_m)), int(np.floor(y / cell_m))
        west, east = min(west, column), max(east, column)
        south, north = min(south, row), max(north, row)
        tiles[held, 0] = column >> 8
        tiles[held, 1] = row >> 8
        cells[held] = (255 - (row & 255)) * 256 + (column & 255)
        heights[held] = z
        times[held] = t_s[i] - begin_s
        held += 1
    ends[0], ends[1], ends[2], ends[3] = west, south, east, north
    return stopped, held


@numba.njit("UniTuple(int32[::1], 2)(int32[:, ::1])", cache=True, nogil=True)
def bounds(tiles):  # type: ignore[no-untyped-def]
    """Least and greatest column and row, fifty times as fast as numpy's along so narrow an axis."""
    low, high = tiles[0].copy(), tiles[0].copy()
    for i in range(len(tiles)):
        for j in range(2):
            low[j] = min(low[j], tiles[i, j])
            high[j] = max(high[j], tiles[i, j])
    return low, high


@numba.njit(
    "Tuple((uint16[::1], float32[::1], float32[::1], int64[::1]))"
    "(int32[:, ::1], uint16[::1], float32[::1], float32[::1], int32[::1], int64, int64)",
    cache=True,
    nogil=True,
)
def sort_by_tile(tiles, cells, heights, times, low, columns, rows):  # type: ignore[no-untyped-def]
    """Cells within their tiles, heights and times in the order of tiles, and where each tile's begin (tiles + 1,)."""
    n = len(heights)
    starts = np.zeros(columns * rows + 1, np.int64)
    tile = np.empty(n, np.int32)
    for i in range(n):
        tile[i] = (tiles[i, 1] - low[1]) * columns + tiles[i, 0] - low[0]
        starts[tile[i] + 1] += 1
    for k in range(columns * rows):
        starts[k + 1] += starts[k]
    place = starts.copy()
    cell, height, time = np.empty(n, np.uint16), np.empty(n, np.float32), np.empty(n, np.float32)
    for i in range(n):
        at = place[tile[i]]
        place[tile[i]] += 1
        cell[at] = cells[i]
        height[at] = heights[i]
        time[at] = times[i]
    return cell, height, time, starts
