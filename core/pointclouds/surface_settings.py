"""How surfaces of clouds are made."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from pyproj import CRS

from furrowmap.core.pointclouds.surfaces import GroundMethod
from furrowmap.core.readers.las.cloud import Box
from furrowmap.core.surfaces.outlier_filter import Outliers
from furrowmap.core.surfaces.statistic import Statistic


@dataclass(frozen=True)
class SurfaceSettings:
    """How surfaces of clouds are made.

    Attributes:
        cell_m: side of a cell; None for the smallest round one with four points in it.
        box: west, south, east, north of the points used, in the CRS of the surfaces; None for all.
        box_crs: CRS of the box; None for that of the surfaces.
        classes: classes of the points used; None for all but noise and, in furrowmap's own clouds, the machine.
        statistic: height of a cell: "median", "trimmed", "mean", "min", "max", or a percentile such as "p90".
        ground: ground filter; "auto" for the classes of the files where they have any, else "smrf".
        outliers: outlier filter.
        every: use every n-th point.
        fill_m: gaps are filled up to this distance from measured heights; 0 for none.
        tillage_heading_deg: direction of tillage, clockwise from grid north, whose marks random roughness leaves out.
        crs: CRS of files that state none.
        dst_crs: CRS of the surfaces; None for that of the files.
        within: vector file, or CSV of corners, in whose polygons the points used lie; None for all.

    Raises:
        UsageError: if there is no such statistic.
    """

    cell_m: float | None = None
    box: Box | None = None
    box_crs: CRS | str | None = None
    classes: frozenset[int] | None = None
    statistic: str = "median"
    ground: GroundMethod | Literal["auto"] = "auto"
    outliers: Outliers = "none"
    every: int = 1
    fill_m: float = 0.0
    tillage_heading_deg: float | None = None
    crs: CRS | str | None = None
    dst_crs: CRS | str | None = None
    within: str | Path | None = None

    def __post_init__(self) -> None:
        Statistic.parse(self.statistic)

    @property
    def cell_statistic(self) -> Statistic:
        """How the heights of a cell become one."""
        return Statistic.parse(self.statistic)
