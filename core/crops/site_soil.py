"""The soil of a site from the points around its parcels, or from a raster, and the noise of its heights."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final

from furrowmap.core.crops.canopy import PIXEL_M
from furrowmap.core.crops.parcel_points import ParcelPoints, soil_near
from furrowmap.core.crops.soil import Soil, SoilAround, SoilMethod, soil_around

SOILS: Final[tuple[SoilMethod, ...]] = ("surface", "plane")


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

    def plain(self) -> dict[str, Any]:
        """As reports have it."""
        out: dict[str, Any] = {"cells": self.cells, "noise_m": round(self.noise_m, 5)}
        if isinstance(self.soil, SoilAround):
            relief = self.soil.relief
            out |= {
                "relief_m": round(relief.relief_m, 4),
                "range_m": round(relief.range_m, 2),
                "cell_sigma_m": round(relief.cell_m, 4),
            }
        return out


def site_soil(points: ParcelPoints, source: SoilMethod = "surface") -> SiteSoil:
    """The soil of a site.

    Args:
        points: of its parcels, all collected.
        source: how the soil under the parcels follows from that around them.
    """
    cells = points.soil()
    return SiteSoil(soil_around(soil_near(points.parcels, cells), source), points.noise_m(PIXEL_M), len(cells))
