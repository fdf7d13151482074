"""How densely, and by which strips of a flight, the ground was covered, and the outlines of the strips."""

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely.geometry.base import BaseGeometry

from furrowmap.core.runtime.kernels import kernel
from furrowmap.core.surfaces.grid import Grid
from furrowmap.core.surfaces.spool import TilePoints
from furrowmap.core.trajectory.straight_passes import Strip
from furrowmap.core.values.time_span import Interval

COVERAGE_BLOCK: Final = 8
"""Cells a side of the blocks that are counted: with fewer points each, densities are noise."""
MIN_STRIP_POINTS: Final = 3
"""Of a strip in a block that it covers."""


@dataclass(frozen=True)
class Coverage:
    """Points of a tile by blocks of COVERAGE_BLOCK cells a side; arrays (rows, columns) of the blocks, north up.

    Attributes:
        points: (rows, columns) number of points, those of turns included.
        number: (k,) numbers of the strips in the tile.
        by_strip: (k, rows, columns) number of points of each.
    """

    grid: Grid
    points: NDArray[np.int64]
    number: NDArray[np.int64]
    by_strip: NDArray[np.int64]

    @property
    def density_m2(self) -> NDArray[np.float32]:
        """Points a square metre; nan without points."""
        density = self.points / self.grid.cell_area_m2
        return np.where(self.points > 0, density, np.nan).astype(np.float32)

    @property
    def covered(self) -> NDArray[np.bool_]:
        """(k, rows, columns) which blocks each strip covers."""
        out: NDArray[np.bool_] = self.by_strip >= MIN_STRIP_POINTS
        return out

    @property
    def strips(self) -> NDArray[np.float32]:
        """Number of strips that cover a block; nan without points."""
        return np.where(self.points > 0, self.covered.sum(axis=0), np.nan).astype(np.float32)


def coverage(points: TilePoints, strips: Sequence[Interval]) -> Coverage:
    """Points of a tile of whole blocks (COVERAGE_BLOCK cells a side) by blocks and strips, in the order of time."""
    grid = points.grid.coarser(COVERAGE_BLOCK)
    ends_s = np.array([(strip.begin_s, strip.end_s) for strip in strips], np.float64).reshape(-1, 2) - points.begin_s
    blocks = grid.rows * grid.columns
    counts = count_blocks(points.cell, points.t_s, ends_s, points.grid.columns, blocks, COVERAGE_BLOCK)
    counts = counts.reshape(len(strips) + 1, *grid.shape)
    there = np.flatnonzero(counts[1:].any(axis=(1, 2)))
    return Coverage(grid, counts.sum(axis=0), there + 1, counts[1:][there])


@kernel()
def count_blocks(cell, t_s, ends_s, columns, blocks, block):  # type: ignore[no-untyped-def]
    """Points (1 + strips, blocks): row 0 those of no strip, row k those of strip k."""
    counts = np.zeros((len(ends_s) + 1, blocks), np.int64)
    across = columns // block
    k = 0
    for i in range(len(cell)):
        t = t_s[i]
        while k < len(ends_s) and t > ends_s[k, 1]:  # points come nearly in order of time
            k += 1
        while k and t <= ends_s[k - 1, 1]:
            k -= 1
        row = cell[i] // columns
        column = cell[i] % columns
        number = k + 1 if k < len(ends_s) and t >= ends_s[k, 0] else 0
        counts[number, row // block * across + column // block] += 1
    return counts


@dataclass(frozen=True)
class StripGround:
    """A strip and the ground that it covers: the outline, in the map's plane, of the blocks with points of it."""

    strip: Strip
    outline: BaseGeometry
    points: int
    area_m2: float

    @property
    def points_m2(self) -> float:
        """Points a square metre; nan without ground."""
        return self.points / self.area_m2 if self.area_m2 else float("nan")


class StripOutlines:
    """Collects the ground of strips from tiles."""

    def __init__(self) -> None:
        self._parts: defaultdict[int, list[BaseGeometry]] = defaultdict(list)
        self._points: defaultdict[int, int] = defaultdict(int)

    def add(self, tile: Coverage) -> None:
        """Add a tile."""
        west, _, _, north = tile.grid.bounds_m
        size_m = tile.grid.cell_m
        for number, covered, points in zip(tile.number.tolist(), tile.covered, tile.by_strip, strict=True):
            # Runs of blocks along the rows: a tenth of the boxes, of the same union.
            edges = np.diff(np.pad(covered.astype(np.int8), ((0, 0), (1, 1))), axis=1)
            row, first = np.nonzero(edges == 1)
            behind = np.nonzero(edges == -1)[1]
            top = north - row * size_m
            boxes = shapely.box(west + first * size_m, top - size_m, west + behind * size_m, top)
            self._parts[number].append(shapely.union_all(boxes))
            self._points[number] += int(points[covered].sum())

    def grounds(self, strips: Sequence[Strip]) -> list[StripGround]:
        """The ground of each strip that has any."""
        found = []
        for strip in strips:
            if strip.number in self._parts:
                outline = shapely.union_all(self._parts[strip.number])
                outline = shapely.MultiPolygon([part for part in shapely.get_parts(outline) if part.area > 0.0])
                found.append(StripGround(strip, outline, self._points[strip.number], float(outline.area)))
        return found
