"""The soil of a site from the points around its parcels, or from a raster, and the noise of its heights."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from furrowmap.core.crops.canopy import PIXEL_M
from furrowmap.core.crops.given_soil import GivenSoil, given_soil
from furrowmap.core.crops.parcel_points import CellsNear, ParcelPoints
from furrowmap.core.crops.soil import Soil, SoilAround, soil_around
from furrowmap.core.crops.soil_raster import SoilRaster
from furrowmap.core.runtime.errors import Notice
from furrowmap.core.values.parcel import SoilMethod


@dataclass(frozen=True)
class SiteSoil:
    """The soil of a site.

    Attributes:
        soil: its heights.
        noise_m: standard deviation of heights of returns from one place.
        cells: number of cells of bare soil.
    """

    soil: Soil
    noise_m: float
    cells: int

    @property
    def notices(self) -> list[Notice]:
        """Warnings."""
        return self.soil.notices() if isinstance(self.soil, GivenSoil) else []

    def plain(self) -> dict[str, Any]:
        """As reports have it."""
        out: dict[str, Any] = {"cells": self.cells, "noise_m": round(self.noise_m, 5)}
        around = self.soil.around if isinstance(self.soil, GivenSoil) else self.soil
        if isinstance(self.soil, GivenSoil):
            out |= self.soil.plain()
        if isinstance(around, SoilAround):
            relief = around.relief
            out |= {
                "relief_m": round(relief.relief_m, 4),
                "range_m": round(relief.range_m, 2),
                "cell_sigma_m": round(relief.cell_m, 4),
            }
        return out


def site_soil(points: ParcelPoints, source: SoilMethod | SoilRaster = "surface") -> SiteSoil:
    """The soil of a site.

    Args:
        points: of its parcels, all collected.
        source: how the soil under the parcels follows from that around them, or the heights of another survey.
    """
    cells = points.soil()
    near = CellsNear(points.parcels, cells)
    soil = given_soil(source, points.parcels, near) if isinstance(source, SoilRaster) else soil_around(near, source)
    return SiteSoil(soil, points.noise_m(PIXEL_M), len(cells))
