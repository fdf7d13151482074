"""The points of clouds sorted into tiles for surfaces, and the size of cells that their density asks for."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np

from furrowmap.core.pointclouds.clouds import Clouds
from furrowmap.core.readers.las.cloud import Box
from furrowmap.core.readers.las.survey import Survey
from furrowmap.core.surfaces.spool import PointSpool
from furrowmap.core.values.errors import Notice
from furrowmap.core.values.progress import Progress, silent

CELLS_M: Final = (0.05, 0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0, 20.0, 50.0)
POINTS_A_CELL: Final = 4.0
ALMOST: Final = 0.9
"""A round size that is so little smaller than wanted will do."""
PATCH_M: Final = 2.0
"""Squares of this size count as covered where there is a point in them, when the density of points is measured."""
CLASSED_SHARE: Final = 0.01
"""A cloud in which so many points are called ground has been classified."""


@dataclass(frozen=True)
class SpooledClouds:
    """The points of clouds, sorted into tiles.

    Attributes:
        points: all that are wanted.
        ground: those among them that the files call ground.
        count: of the first.
        ground_count: of the second.
        span_s: earliest and latest UTC; None where no file tells it.
        notices: where headers and points differ.
    """

    points: PointSpool
    ground: PointSpool
    count: int
    ground_count: int
    span_s: tuple[float, float] | None
    notices: tuple[Notice, ...]

    @property
    def classified(self) -> bool:
        """Whether somebody has told the ground already."""
        return self.ground_count > CLASSED_SHARE * self.count


def cell_for(
    clouds: Clouds, box: Box | None = None, classes: frozenset[int] | None = None, progress: Progress = silent
) -> float:
    """A round cell size, in metres, that gives a cell some four points where the clouds are; reads them through."""
    total = max(clouds.points, 1)
    covered = np.zeros(0, np.int64)
    count = 0
    for batch in clouds.batches(box, classes, read=lambda done: progress("measuring density", done / total)):
        if not len(batch.xyz_m):
            continue
        column, row = np.floor(batch.xyz_m[:, :2].T / PATCH_M).astype(np.int64)
        covered = np.union1d(covered, (column << 32) + row)
        count += len(batch.xyz_m)
    wanted_m = math.sqrt(POINTS_A_CELL * len(covered) * PATCH_M**2 / max(count, 1))
    return next((cell_m for cell_m in CELLS_M if cell_m >= ALMOST * wanted_m), CELLS_M[-1])


def spool_clouds(
    clouds: Clouds,
    points: PointSpool,
    ground: PointSpool,
    box: Box | None = None,
    classes: frozenset[int] | None = None,
    every: int = 1,
    progress: Progress = silent,
) -> SpooledClouds:
    """Sort the points of clouds into tiles, `ground` taking those that the files call ground as well.

    Args:
        clouds: the clouds.
        points: takes the points.
        ground: takes those of the ground.
        box: west, south, east, north of the points wanted; None for all.
        classes: that are wanted; None for all but noise and machines.
        every: every so many-th of them is taken, beginning with the first.
        progress: is told of the stage "reading clouds".

    Raises:
        InputError: if a file turns out to be damaged.
        OSError: if the scratch files cannot be written.
    """
    surveys: list[Survey] = []
    seen = count = ground_count = 0
    total = max(clouds.points, 1)
    first_s, last_s = math.inf, -math.inf
    for batch in clouds.batches(box, classes, surveys.append, lambda done: progress("reading clouds", done / total)):
        kept = (seen + np.arange(len(batch.xyz_m))) % every == 0
        seen += len(kept)
        of_ground = kept & batch.ground
        points.add(batch.xyz_m, kept=kept)
        ground.add(batch.xyz_m, kept=of_ground)
        count += int(np.count_nonzero(kept))
        ground_count += int(np.count_nonzero(of_ground))
        if batch.t_s is not None and len(batch.t_s) and np.isfinite(batch.t_s).any():
            first_s, last_s = min(first_s, float(np.nanmin(batch.t_s))), max(last_s, float(np.nanmax(batch.t_s)))
    notices = tuple(notice for survey in surveys for notice in survey.notices())
    span = (first_s, last_s) if first_s <= last_s else None
    return SpooledClouds(points, ground, count, ground_count, span, notices)
