"""Soil under parcels from another survey, brought to the height of the points by the bare soil that both have seen."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import shapely
from numpy.typing import NDArray

from furrowmap.core.crops.soil import (
    FEWEST_CELLS,
    NODE_M,
    SoilAround,
    SoilPatch,
    nearest,
    nodes_of,
    soil_around,
)
from furrowmap.core.crops.soil_cells import CELL_M, SoilCells, without_crop
from furrowmap.core.crops.soil_raster import SoilRaster
from furrowmap.core.runtime.errors import Notice
from furrowmap.core.surfaces.gaps import filled
from furrowmap.core.values.parcel import Parcel

FloatArray = NDArray[np.float64]

KNOWN_SHARE: Final = 0.8
"""Of the nodes under a parcel; the survey does not cover one with fewer."""


@dataclass(frozen=True)
class GivenSoil:
    """Soil of another survey.

    Attributes:
        patches: the soil under each parcel that the survey covers, by its id.
        around: bare soil of the points less that of the survey, near each parcel.
        offset_m: that for parcels without bare soil nearby: the median of the others.
        offset_sigma_m: standard deviation of it; nan where there is bare soil at no parcel.
    """

    name: str
    patches: dict[str, SoilPatch]
    around: SoilAround
    offset_m: float
    offset_sigma_m: float

    def under(self, parcel: Parcel) -> SoilPatch | None:
        """See :class:`~furrowmap.core.crops.soil.Soil`."""
        return self.patches.get(parcel.id)

    def plain(self) -> dict[str, Any]:
        """As reports have it."""
        known = math.isfinite(self.offset_sigma_m)
        return {
            "from": self.name,
            "offset_m": round(self.offset_m, 5),
            "offset_sigma_m": round(self.offset_sigma_m, 5) if known else None,
        }

    def notices(self) -> list[Notice]:
        """A warning where nothing shows the offset."""
        if math.isfinite(self.offset_sigma_m):
            return []
        return [Notice("soil-not-aligned", name=self.name)]


def given_soil(raster: SoilRaster, parcels: Sequence[Parcel], near: Mapping[str, SoilCells]) -> GivenSoil:
    """The soil of another survey.

    The differences of the bare soil near a parcel are interpolated below it by kriging with a constant as the trend, so
    that what the surveys have not in common (an offset, a tilt, soil that settled) is taken off and is in the standard
    deviation.

    Args:
        raster: the heights of the survey.
        near: cells of bare soil of the points near each parcel, by its id.
    """
    differences = {}
    for parcel in parcels:
        cells = near[parcel.id]
        other = raster.heights_m(cells.xy_m, CELL_M)
        less = SoilCells(cells.xy_m, cells.height_m - other, cells.sigma_m).at(np.isfinite(other))
        differences[parcel.id] = nearest(without_crop(less), parcel)
    around = soil_around(differences, trend="constant")
    offset_m, sigma_m = _offset(around)
    patches = {}
    for parcel in parcels:
        patch = _patch(parcel, raster, around, offset_m, sigma_m)
        if patch is not None:
            patches[parcel.id] = patch
    return GivenSoil(raster.path.name, patches, around, offset_m, sigma_m)


def _offset(around: SoilAround) -> tuple[float, float]:
    """The median of the parcels' differences, and the standard deviation of one of them; 0 and nan if unknown."""
    medians = np.array([np.median(cells.height_m) for cells in around.near.values() if len(cells) >= FEWEST_CELLS])
    if not len(medians):
        return 0.0, math.nan
    middle = float(np.median(medians))
    spread = 1.4826 * float(np.median(np.abs(medians - middle)))
    return middle, math.hypot(spread, around.relief.relief_m)


def _patch(parcel: Parcel, raster: SoilRaster, around: SoilAround, offset_m: float, sigma_m: float) -> SoilPatch | None:
    """The soil under a parcel; None where the survey does not cover it."""
    west, south, nodes, shape = nodes_of(parcel)
    height = raster.heights_m(nodes, NODE_M).reshape(shape)
    inside = shapely.contains_xy(parcel.net.buffer(0.5 * NODE_M), nodes[:, 0], nodes[:, 1]).reshape(shape)
    known = np.isfinite(height)
    if known[inside].mean() < KNOWN_SHARE:
        return None
    offset = around.under(parcel)
    level = offset.height_m if offset is not None else np.full(shape, offset_m)
    sigma = offset.sigma_m if offset is not None else sigma_m
    # what is not correlated, such as the noise of the survey's cells, goes on under the parcel
    chance = around.relief.cell_m / math.sqrt(float(known[inside].sum()))
    return SoilPatch(west, south, filled(height) + level, math.hypot(sigma, chance))
