"""Surfaces of clouds, tile by tile: DSM, DTM and height above ground.

Points are sorted into tiles in a temporary file first, so that memory is that of a block of tiles. The ground is found
in the lowest heights of cells of half a metre, over blocks that overlap by twice the window of the filter; points are
then classified by their distance from it.
"""

import math
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from functools import partial
from threading import Lock
from typing import Final, Literal, Protocol

import numpy as np
from scipy.ndimage import distance_transform_edt

from furrowmap.core.pointclouds.spooled_clouds import SpooledClouds
from furrowmap.core.runtime.arrays import BoolArray, Float32Array, FloatArray
from furrowmap.core.runtime.background import in_turn
from furrowmap.core.runtime.progress import Progress, silent
from furrowmap.core.runtime.settings import threads
from furrowmap.core.surfaces.grid import Grid, Surface
from furrowmap.core.surfaces.ground_filter import SMRF, GroundRaster, ground_of_cells, require_cloth
from furrowmap.core.surfaces.spool import SPOOL_TILE, PointSpool, TilePoints
from furrowmap.core.surfaces.statistic import MEDIAN, Statistic

Key = tuple[int, int]
GroundMethod = Literal["smrf", "csf", "class", "none"]

GROUND_CELL_M: Final = 0.5
SURFACE_BLOCK_M: Final = 256.0
MAX_GROUND_DISTANCE_M: Final = 10.0
"""Greatest distance from observed ground of a height above ground."""
_LOWEST: Final = Statistic.parse("min")


class TileSource(Protocol):
    """A spool of points, or one without outliers."""

    def tile(self, key: Key) -> TilePoints:
        """The points of a tile."""


@dataclass(frozen=True)
class CloudTile:
    """The surfaces of one tile; the last two are None where the ground is not requested.

    Attributes:
        points: of the DSM.
        above_m: float32 height of the DSM above the ground, interpolated where the DTM has gaps; nan without a height,
            or without ground within 10 m.
    """

    points: TilePoints
    dsm: Surface
    dtm: Surface | None
    above_m: Float32Array | None

    @property
    def grid(self) -> Grid:
        """The cells of the surfaces."""
        return self.points.grid


def finer_cells(cell_m: float) -> int:
    """Into how many cells a side those of a surface are divided, so that the ground is found in half a metre or less.

    A power of two, as for :meth:`~furrowmap.core.surfaces.spool.TilePoints.coarser`.
    """
    return min(SPOOL_TILE, 1 << max(0, math.ceil(math.log2(cell_m / GROUND_CELL_M))))


def cloud_tiles(
    spooled: SpooledClouds,
    method: GroundMethod,
    cell_m: float,
    statistic: Statistic = MEDIAN,
    kept: tuple[TileSource, TileSource] | None = None,
    progress: Progress = silent,
) -> Iterator[CloudTile]:
    """The surfaces of spooled clouds, block by block of tiles.

    Args:
        method: ground classification: morphological filter, cloth simulation, classes of the files, or none.
        cell_m: of the surfaces: that of the spools times a power of two, see :func:`finer_cells`.
        statistic: height of a cell of the DSM; that of the DTM is the median.
        kept: the points and those of the ground without outliers; None for all.
        progress: receives the stage "making surfaces".

    Raises:
        InputError: if the method's library is not installed.
    """
    if method == "csf":
        require_cloth()
    factor = round(cell_m / spooled.points.cell_m)
    across = _across(spooled.points.cell_m)
    blocks: dict[Key, list[Key]] = {}
    for column, row in spooled.points.tiles:
        blocks.setdefault((column // across, row // across), []).append((column, row))
    source = spooled.ground if method == "class" else spooled.points
    lows = _Lows(source, set(source.tiles))
    ordered = [block for _, block in sorted(blocks.items(), key=lambda item: (-item[0][1], item[0][0]))]  # north first
    points, of_ground = kept or (spooled.points, spooled.ground)
    with ThreadPoolExecutor(threads()) as pool:
        grounds = in_turn(pool, lambda block: _ground(block, lows, method), ordered, threads())
        for number, (block, ground) in enumerate(zip(ordered, grounds, strict=True), start=1):
            made = partial(_tile, points, of_ground, ground, method, statistic, factor)
            yield from in_turn(pool, made, block, 2 * threads())
            lows.forget_above(block)
            progress("making surfaces", number / len(ordered))


@dataclass(frozen=True)
class _Ground:
    """The ground of a block in coarse cells."""

    cells: int  # fine cells a side of a coarse one
    raster: GroundRaster
    far: BoolArray  # (rows, columns) cells farther than 10 m from observed ground


@dataclass
class _Lows:
    """Cache of the lowest heights in the coarse cells of tiles."""

    spool: PointSpool
    there: set[Key]
    kept: dict[Key, tuple[Key, FloatArray]] = field(default_factory=dict)
    lock: Lock = field(default_factory=Lock)

    @property
    def cells(self) -> int:
        """Fine cells a side of a coarse one."""
        return max(1, round(GROUND_CELL_M / self.spool.cell_m))

    def of(self, key: Key) -> tuple[Key, FloatArray]:
        """Column and row of the first coarse cell of a tile, and the heights (rows, columns), southernmost first."""
        with self.lock:
            if key not in self.kept:
                self.kept[key] = self._lowest(key)
            return self.kept[key]

    def forget_above(self, block: list[Key]) -> None:
        """Drop tiles that the blocks from this one southward do not need."""
        north = max(row for _, row in block) + _margin(self.spool.cell_m) + _across(self.spool.cell_m)
        with self.lock:
            self.kept = {key: low for key, low in self.kept.items() if key[1] <= north}

    def _lowest(self, key: Key) -> tuple[Key, FloatArray]:
        fine = self.spool.tile(key).surface(_LOWEST).height_m[::-1]
        n = self.cells
        column = key[0] * SPOOL_TILE
        row = key[1] * SPOOL_TILE
        first = (column // n, row // n)
        before = (row - first[1] * n, column - first[0] * n)
        after = tuple(-(size + skipped) % n for size, skipped in zip(fine.shape, before, strict=True))
        padded = np.pad(fine, tuple(zip(before, after, strict=True)), constant_values=np.nan)
        blocks = padded.reshape(padded.shape[0] // n, n, padded.shape[1] // n, n)
        low: FloatArray = np.fmin.reduce(np.fmin.reduce(blocks, axis=3), axis=1).astype(np.float64)
        return first, low


def _across(cell_m: float) -> int:
    """Tiles a side of a block."""
    return max(1, math.ceil(SURFACE_BLOCK_M / (SPOOL_TILE * cell_m)))


def _margin(cell_m: float) -> int:
    """Margin of a block in tiles for ground classification."""
    return math.ceil(2.0 * SMRF.window_m / (SPOOL_TILE * cell_m))


def _ground(block: list[Key], lows: _Lows, method: GroundMethod) -> _Ground | None:
    """The ground of a block; None where there is none."""
    cell_m = lows.spool.cell_m
    margin = _margin(cell_m)
    columns = [key[0] for key in block]
    rows = [key[1] for key in block]
    near = [
        (column, row)
        for column in range(min(columns) - margin, max(columns) + margin + 1)
        for row in range(min(rows) - margin, max(rows) + margin + 1)
        if (column, row) in lows.there
    ]
    if method == "none" or not near:
        return None
    n = lows.cells
    parts = [lows.of(key) for key in near]
    first = np.array([corner for corner, _ in parts])
    behind = first + [low.shape[::-1] for _, low in parts]
    own_corner = np.min(block, axis=0) * SPOOL_TILE // n
    own_end = (np.max(block, axis=0) + 1) * SPOOL_TILE // n + 1
    corner = np.minimum(first.min(axis=0), own_corner)
    end = np.maximum(behind.max(axis=0), own_end)
    lowest = np.full((end - corner)[::-1], np.nan)
    for place, (_, low) in zip(first - corner, parts, strict=True):
        there = lowest[place[1] : place[1] + low.shape[0], place[0] : place[0] + low.shape[1]]
        np.fmin(there, low, out=there)
    coarse_m = n * cell_m
    around = math.ceil(2.0 * SMRF.window_m / coarse_m)  # tiles around reach further
    west, south = np.maximum(own_corner - around, corner).tolist()
    east, north = (own_end + around).tolist()
    lowest = lowest[south - corner[1] : north - corner[1], west - corner[0] : east - corner[0]].copy()
    raster = ground_of_cells(lowest, (west, south), method, replace(SMRF, cell_m=coarse_m))
    if raster is None:
        return None
    far = distance_transform_edt(~raster.seen) * coarse_m > MAX_GROUND_DISTANCE_M
    return _Ground(n, raster, np.asarray(far))


def _tile(
    all_points: TileSource,
    ground_points: TileSource,
    ground: _Ground | None,
    method: GroundMethod,
    statistic: Statistic,
    factor: int,
    key: Key,
) -> CloudTile:
    fine = all_points.tile(key)
    points = fine.coarser(factor)
    dsm = points.surface(statistic)
    if method == "none":
        return CloudTile(points, dsm, None, None)
    if ground is None:
        nothing = points.surface(MEDIAN, np.zeros(len(points.cell), bool))
        return CloudTile(points, dsm, nothing, np.full(points.grid.shape, np.nan, np.float32))
    height = _over(points.grid, factor, ground, ground.raster.height_m)
    if method == "class":
        dtm = ground_points.tile(key).coarser(factor).surface(MEDIAN)
    else:
        fine_height = height if factor == 1 else _over(fine.grid, 1, ground, ground.raster.height_m)
        limit = _over(fine.grid, 1, ground, ground.raster.limit_m)
        above = fine.height_m + fine.base_m - fine_height.ravel()[fine.cell]
        dtm = points.surface(MEDIAN, np.abs(above) <= limit.ravel()[fine.cell])
    far = _over(points.grid, factor, ground, ground.far) > 0.5
    below = np.where(np.isfinite(dtm.height_m), dtm.height_m, np.where(far, np.nan, height))
    return CloudTile(points, dsm, dtm, (dsm.height_m - below).astype(np.float32))


def _over(grid: Grid, factor: int, ground: _Ground, values: FloatArray | BoolArray) -> FloatArray:
    """Values of the coarse cells of the ground over the cells of a tile, each of so many fine ones a side, north up."""
    column = (grid.west + 0.5 + np.arange(grid.columns)) * factor / ground.cells - 0.5 - ground.raster.corner[0]
    row = (grid.north - 0.5 - np.arange(grid.rows)) * factor / ground.cells - 0.5 - ground.raster.corner[1]
    return _along_rows(_along_rows(values, row).T, column).T


def _along_rows(values: FloatArray | BoolArray, row: FloatArray) -> FloatArray:
    """Values (rows, columns) at fractional rows, by linear interpolation; those of the border beyond it."""
    last = len(values) - 1
    place = np.clip(row, 0, last)
    before = np.minimum(place.astype(np.intp), max(last - 1, 0))
    after = np.minimum(before + 1, last)
    part = (place - before)[:, None]
    between: FloatArray = values[before] * (1.0 - part) + values[after] * part
    return between
