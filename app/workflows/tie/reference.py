"""A surveyed surface or surveyed points that dates are tied to."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from furrowmap.core.checking.surface_at_points import surface_at_points
from furrowmap.core.dates.pair_tie import PLACE_TERMS, PairTie, tie_pair, tie_points
from furrowmap.core.readers.surveyed_points import SurveyOptions
from furrowmap.core.runtime.arrays import FloatArray
from furrowmap.core.runtime.errors import RefusedError
from furrowmap.core.surfaces.grid import Grid
from furrowmap.exporters.farm.surface_file import heights_of, same_map, surface_file
from furrowmap.exporters.rasters.dated_surface import DatedSurface, OpenSurface, resample_surface
from furrowmap.exporters.rasters.tied_surfaces import ground_pairs
from furrowmap.workflows.clouds.check import TABLES

CELL_SIGMA_M: Final = 0.01
"""Of a surface at a point: the roughness of the ground below the surveyor's rod."""
_SURE: Final = 1e-4


@dataclass(frozen=True)
class Reference:
    """What dates are moved onto: a surface on their cells, or points.

    `sigma`: (6,) standard deviations of its own place, height, tilts and turn; `sigma_m`: of a point that states none.
    """

    path: Path
    surface: OpenSurface | None
    sigma: FloatArray
    sigma_m: float | None


def open_reference(
    path: Path,
    dates: Sequence[DatedSurface],
    bounds_m: tuple[float, float, float, float],
    sigma_m: float,
    stack: ExitStack,
) -> Reference:
    """Open a table of points (.csv, .txt, .tsv, .gpkg) or a GeoTIFF; its heights have the standard deviation."""
    if path.suffix.lower() in TABLES:
        # the points themselves carry the survey's errors
        return Reference(path, None, np.full(6, _SURE), sigma_m or None)
    file, first = surface_file(path), dates[0].after
    heights = {heights_of(surface.crs) for surface in (file, first)}
    if not same_map(file.crs, first.crs) or len(heights - {""}) > 1:
        raise RefusedError("tie-crs.open-reference", path=path, first=first.path)
    grid = Grid.of_bounds(first.cell_m, bounds_m)
    surface = stack.enter_context(resample_surface(file, grid))
    sigma = np.full(6, _SURE)
    sigma[2] = max(sigma_m, _SURE)
    return Reference(path, surface, sigma, None)


def reference_tie(
    reference: Reference, before: OpenSurface, date: DatedSurface, touched: BaseGeometry, middle_m: FloatArray
) -> PairTie | None:
    """Tie a date to the reference by ground that no tool touched on any date."""
    if reference.surface is not None:
        pieces = list(ground_pairs(reference.surface, before, touched))
        return tie_pair(pieces, middle_m, date.sigma[PLACE_TERMS])
    options = SurveyOptions(sigma_m=reference.sigma_m)
    found = surface_at_points(date.before.path, reference.path, options)
    xyz = np.array([point.surveyed_m for point in found.points])
    above = np.array([point.error_m[2] for point in found.points])
    stated = found.survey.sigma_m[:, 2]
    sigma = np.hypot(np.where(np.isfinite(stated), stated, reference.sigma_m or 0.0), CELL_SIGMA_M)
    used = np.isfinite(above) & ~shapely.contains_xy(touched, xyz[:, 0], xyz[:, 1])
    return tie_points(xyz[used, :2], above[used], sigma[used], middle_m)
