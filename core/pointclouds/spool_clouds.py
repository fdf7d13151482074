"""Points of clouds read into spools, and a cell size for their density."""

import math
from typing import Final

import numpy as np

from furrowmap.core.pointclouds.joined_clouds import Clouds
from furrowmap.core.pointclouds.spooled_clouds import SpooledClouds
from furrowmap.core.readers.las.cloud import Box, Survey
from furrowmap.core.runtime.progress import Progress, silent
from furrowmap.core.surfaces.spool import PointSpool

ROUND_CELLS_M: Final = (0.05, 0.1, 0.2, 0.5, 1.0, 2.0, 5.0)
POINTS_A_CELL: Final = 4.0
ALMOST: Final = 0.9
"""A round size down to this share of the computed one is accepted."""
COVERAGE_PATCH_M: Final = 2.0
"""Side of the squares by which the covered area is measured."""


def cell_for(
    clouds: Clouds, box: Box | None = None, classes: frozenset[int] | None = None, progress: Progress = silent
) -> float:
    """A round cell size with some four points a cell, from one pass over the clouds."""
    total = max(clouds.points, 1)
    covered = np.zeros(0, np.int64)
    count = 0
    for batch in clouds.batches(box, classes, read=lambda done: progress("measuring density", done / total)):
        if not len(batch.xyz_m):
            continue
        column, row = np.floor(batch.xyz_m[:, :2].T / COVERAGE_PATCH_M).astype(np.int64)
        covered = np.union1d(covered, (column << 32) + row)
        count += len(batch.xyz_m)
    wanted_m = math.sqrt(POINTS_A_CELL * len(covered) * COVERAGE_PATCH_M**2 / max(count, 1))
    return next(cell_m for cell_m in ROUND_CELLS_M if cell_m >= ALMOST * wanted_m)  # a point a patch wants 4 m


def spool_clouds(
    clouds: Clouds,
    points: PointSpool,
    ground: PointSpool,
    box: Box | None = None,
    classes: frozenset[int] | None = None,
    every: int = 1,
    progress: Progress = silent,
) -> SpooledClouds:
    """Sort the points of clouds into tiles.

    Args:
        ground: receives those classified as ground in the files.
        box: west, south, east, north of the points; None for all.
        classes: of the points; None for all but noise and machines.
        every: use every n-th point, from the first.
        progress: receives the stage "reading clouds".

    Raises:
        InputError: if a file is damaged.
        OSError: if the temporary files cannot be written.
    """
    surveys: list[Survey] = []
    seen = count = ground_count = 0
    total = max(clouds.points, 1)
    first_s = math.inf
    last_s = -math.inf
    for batch in clouds.batches(box, classes, surveys.append, lambda done: progress("reading clouds", done / total)):
        kept = (seen + np.arange(len(batch.xyz_m))) % every == 0
        seen += len(kept)
        of_ground = kept & batch.ground
        points.add(batch.xyz_m, kept=kept)
        ground.add(batch.xyz_m, kept=of_ground)
        count += int(np.count_nonzero(kept))
        ground_count += int(np.count_nonzero(of_ground))
        if batch.t_s is not None and len(batch.t_s) and np.isfinite(batch.t_s).any():
            first_s = min(first_s, float(np.nanmin(batch.t_s)))
            last_s = max(last_s, float(np.nanmax(batch.t_s)))
    notices = tuple(notice for survey in surveys for notice in survey.notices())
    span = (first_s, last_s) if first_s <= last_s else None
    return SpooledClouds(points, ground, count, ground_count, span, notices)
