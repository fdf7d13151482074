"""What surfaces of clouds are asked for."""

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
    """What surfaces are asked for.

    Attributes:
        cell_m: length of a cell's sides; None for one that the density of the points asks for.
        box: west, south, east, north in the CRS of the surfaces; None for all.
        box_crs: of the box, if that is another one.
        classes: of points that are wanted; None for all but noise, and in furrowmap's own clouds vehicle and implement.
        statistic: what stands for the points of a cell.
        ground: how the ground is told; "auto" for the files' own classes where they have them, else "smrf".
        outliers: how points that are alone are told.
        every: every so many-th point is taken.
        fill_m: gaps are filled in which no place is farther than this from a seen height; 0 for none.
        tillage_heading_deg: direction of tillage, clockwise from grid north: random roughness is without its marks.
        crs: of files that state none.
        dst_crs: of the surfaces; None for the files' own.
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
