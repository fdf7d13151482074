"""Settings of surfaces from clouds."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from pyproj import CRS

from furrowmap.core.pointclouds.surfaces import GroundMethod
from furrowmap.core.readers.las.cloud import Box
from furrowmap.core.surfaces.outlier_filter import Outliers
from furrowmap.core.surfaces.statistic import MEDIAN, Statistic


@dataclass(frozen=True)
class SurfaceSettings:
    """Settings of surfaces.

    Attributes:
        cell_m: cell size; None to choose it by point density.
        box: west, south, east, north in the CRS of the surfaces; None for all.
        box_crs: of the box, if different.
        classes: of the points used; None for all but noise and, in furrowmap's own clouds, vehicle and implement.
        statistic: height of a cell.
        ground: classification method; "auto" for the classes of the files where present, else "smrf".
        outliers: detection method.
        every: use every n-th point.
        fill_m: maximum interpolation gap; 0 to leave gaps.
        tillage_heading_deg: clockwise from grid north; tillage marks are removed from random roughness.
        crs: of files without one.
        dst_crs: of the surfaces; None for that of the files.
    """

    cell_m: float | None = None
    box: Box | None = None
    box_crs: CRS | None = None
    classes: frozenset[int] | None = None
    statistic: Statistic = MEDIAN
    ground: GroundMethod | Literal["auto"] = "auto"
    outliers: Outliers = "none"
    every: int = 1
    fill_m: float = 0.0
    tillage_heading_deg: float | None = None
    crs: CRS | None = None
    dst_crs: CRS | None = None
