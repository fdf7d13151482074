"""Outlines and densities of the strips of a flight, collected tile by tile."""

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from furrowmap.core.surfaces.coverage import Coverage
from furrowmap.core.trajectory.straight_passes import Strip


@dataclass(frozen=True)
class StripGround:
    """A strip and the ground that it covers.

    Attributes:
        strip: its times and direction.
        outline: of the blocks with points of it; a MultiPolygon in the map's plane.
    """

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
