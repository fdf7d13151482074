"""Soil of a site: from the bare soil around its parcels, or from a raster of another survey."""

import math
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

import numpy as np
from pyproj import CRS
from scipy.ndimage import map_coordinates, uniform_filter

from furrowmap.core.crops.bare_soil import (
    MIN_SOIL_CELLS,
    NODE_M,
    SOIL_CELL_M,
    HeightCovariance,
    SoilCells,
    SoilPatch,
    Trend,
    estimate_covariance,
    interpolate_soil,
    patch_nodes,
    without_crop,
)
from furrowmap.core.crops.canopy_height import CROP_PIXEL_M
from furrowmap.core.crops.parcel_points import CellsNear, ParcelPoints
from furrowmap.core.geodesy.crs_change import CrsChange, crs_change
from furrowmap.core.readers.raster_heights import HeightRaster, open_heights
from furrowmap.core.runtime.arrays import FloatArray
from furrowmap.core.runtime.errors import InputError, Notice
from furrowmap.core.runtime.languages.texts import Words
from furrowmap.core.surfaces.gaps import filled
from furrowmap.core.values.parcel import Parcel, SoilMethod

SAMPLED_PARCELS: Final = 12
"""Parcels around which the covariance of the soil is estimated."""
SAMPLED_CELLS: Final = 100
"""Cells of each of them."""
KNOWN_SHARE: Final = 0.8
"""Of the nodes under a parcel; the survey does not cover one with fewer."""


@dataclass(frozen=True)
class SoilAround:
    """Soil from the bare cells around each parcel, by its id, by kriging ("surface") or a plane ("plane")."""

    near: Mapping[str, SoilCells]
    covariance: HeightCovariance
    method: SoilMethod
    trend: Trend = "plane"

    def under(self, parcel: Parcel) -> SoilPatch | None:
        """The soil under the net parcel; None where it is not known."""
        if parcel.id not in self.near:
            return None
        cells = without_crop(self.near[parcel.id]).nearest(parcel)
        patch = interpolate_soil(parcel, cells, self.covariance, self.trend)
        if patch is None or self.method == "surface":
            return patch
        alone_m = math.hypot(self.covariance.cell_m, self.covariance.relief_m)
        plane = interpolate_soil(parcel, cells, HeightCovariance(0.0, self.covariance.range_m, alone_m))
        # least squares do not tell how far the soil departs from the plane: the covariance does
        return None if plane is None else replace(plane, sigma_m=math.hypot(plane.sigma_m, patch.sigma_m))

    def plain(self) -> dict[str, Any]:
        """As reports have it."""
        relief_m = self.covariance.relief_m
        range_m = self.covariance.range_m
        cell_m = self.covariance.cell_m
        return {"relief_m": round(relief_m, 4), "range_m": round(range_m, 2), "cell_sigma_m": round(cell_m, 4)}


def soil_around(near: Mapping[str, SoilCells], method: SoilMethod = "surface", trend: Trend = "plane") -> SoilAround:
    """The soil from the cells around each parcel, with the covariance of those around parcels all over the site."""
    names = list(near)
    found = [without_crop(near[name]) for name in names[:: max(1, len(names) // (2 * SAMPLED_PARCELS))]]
    return SoilAround(near, estimate_covariance(sample_surroundings(found, MIN_SOIL_CELLS + 1), trend), method, trend)


def sample_surroundings(surroundings: Sequence[SoilCells], least: int) -> list[SoilCells]:
    """Some of the surroundings with enough cells, evenly chosen, and some cells of each."""
    full = [cells for cells in surroundings if len(cells) >= least]
    some = full[:: max(1, len(full) // SAMPLED_PARCELS)][:SAMPLED_PARCELS]
    return [cells.thinned(SAMPLED_CELLS) for cells in some]


@dataclass(frozen=True)
class SoilRaster:
    """An open raster of heights; `change` is from the map to its CRS, None where they agree.

    Attributes:
        notices: of the cloud that it was made of.
    """

    path: Path
    raster: HeightRaster
    change: CrsChange | None
    notices: tuple[Notice, ...] = ()

    def heights_m(self, xy_m: FloatArray, side_m: float) -> FloatArray:
        """Mean heights (n,) of the squares of a side around positions (n, 2) on the map.

        They are nan where less than a quarter of the cells have heights.
        """
        if not len(xy_m):
            return np.zeros(0)
        dataset = self.raster.dataset
        column, row = self._cells(xy_m)
        beside = np.array(self._cells(xy_m[:1] + np.array([[0.0, 0.0], [side_m, 0.0], [0.0, side_m]])))
        cells_wide = float(np.linalg.norm(beside[:, 1:] - beside[:, :1], axis=0).mean())
        size = max(1, 2 * int(0.5 * cells_wide) + 1)
        left = int(np.floor(column.min())) - size
        top = int(np.floor(row.min())) - size
        right = int(np.ceil(column.max())) + size + 1
        bottom = int(np.ceil(row.max())) + size + 1
        window = ((max(top, 0), min(bottom, dataset.height)), (max(left, 0), min(right, dataset.width)))
        out = np.full(len(column), np.nan)
        if window[0][0] >= window[0][1] or window[1][0] >= window[1][1]:
            return out
        cells = self.raster.read_m(*window)
        known = np.isfinite(cells)
        if not known.any():
            return out
        base = float(np.median(cells[known]))
        at = np.array([row - window[0][0], column - window[1][0]])
        share, total = (
            map_coordinates(uniform_filter(values, size, mode="constant"), at, order=1, mode="constant")
            for values in (known.astype(np.float64), np.where(known, cells - base, 0.0))
        )
        enough = share >= 0.25
        out[enough] = base + total[enough] / share[enough]
        return out

    def _cells(self, xy_m: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Columns and rows (n,) of positions (n, 2) on the map, from the middle of the first cell."""
        x, y = xy_m.T if self.change is None else self.change.points(xy_m).T
        column, row = self.raster.columns_rows(x, y)
        return column - 0.5, row - 0.5


@contextmanager
def open_soil_raster(path: Path, target: CRS, box_m: tuple[float, float, float, float]) -> Iterator[SoilRaster]:
    """The heights of a GeoTIFF for positions on a map within `box_m`: west, south, east, north.

    Raises InputError if it is no such raster, RefusedError if PROJ has no exact transformation to its CRS.
    """

    def unusable(path: Path, why: Words) -> InputError:
        return InputError("soil-unusable", path=path, why=why)

    with open_heights(path, unusable) as raster:
        flat = raster.crs.sub_crs_list[0] if raster.crs.is_compound else raster.crs
        own = target.sub_crs_list[0].to_2d() if target.is_compound else target.to_2d()
        change = None if own.equals(flat.to_2d(), ignore_axis_order=True) else crs_change(own, flat, box_m)
        yield SoilRaster(path, raster, change)


@dataclass(frozen=True)
class SurveyedSoil:
    """Soil of another survey, aligned in height by the bare soil that both it and the points show.

    Attributes:
        patches: the soil under each parcel that the survey covers, by its id.
        around: bare soil of the points less that of the survey, near each parcel.
        offset_m: that for parcels without bare soil nearby: the median of the others.
        offset_sigma_m: standard deviation of it; nan where there is bare soil at no parcel.
        notices: about the survey's heights.
    """

    name: str
    patches: dict[str, SoilPatch]
    around: SoilAround
    offset_m: float
    offset_sigma_m: float
    notices: tuple[Notice, ...] = ()

    def under(self, parcel: Parcel) -> SoilPatch | None:
        """The soil under the net parcel; None where the survey does not cover it."""
        return self.patches.get(parcel.id)

    def plain(self) -> dict[str, Any]:
        """As reports have it."""
        sigma_m = round(self.offset_sigma_m, 5) if math.isfinite(self.offset_sigma_m) else None
        offset = {"from": self.name, "offset_m": round(self.offset_m, 5), "offset_sigma_m": sigma_m}
        return offset | self.around.plain()


def align_survey(raster: SoilRaster, parcels: Sequence[Parcel], near: Mapping[str, SoilCells]) -> SurveyedSoil:
    """The soil of another survey.

    The differences of the bare soil near a parcel are interpolated below it by kriging with a constant as the trend, so
    that what the surveys have not in common (an offset, a tilt, soil that settled) is taken off and is in the standard
    deviation. `near` are cells of bare soil of the points near each parcel, by its id.
    """
    differences = {}
    for parcel in parcels:
        cells = near[parcel.id]
        other = raster.heights_m(cells.xy_m, SOIL_CELL_M)
        less = SoilCells(cells.xy_m, cells.height_m - other, cells.sigma_m).at(np.isfinite(other))
        differences[parcel.id] = without_crop(less).nearest(parcel)
    around = soil_around(differences, trend="constant")
    medians = np.array([np.median(cells.height_m) for cells in differences.values() if len(cells) >= MIN_SOIL_CELLS])
    offset_m = 0.0
    sigma_m = math.nan
    if len(medians):
        offset_m = float(np.median(medians))
        spread = 1.4826 * float(np.median(np.abs(medians - offset_m)))
        sigma_m = math.hypot(spread, around.covariance.relief_m)
    patches = {}
    for parcel in parcels:
        nodes = patch_nodes(parcel)
        height = raster.heights_m(nodes.xy_m, NODE_M)
        known = np.isfinite(height)[nodes.inside]
        if known.mean() < KNOWN_SHARE:
            continue
        offset = around.under(parcel) or nodes.patch(np.full(len(height), offset_m), sigma_m)
        # what is not correlated, such as the noise of the survey's cells, remains under the parcel
        chance = around.covariance.cell_m / math.sqrt(float(known.sum()))
        level = filled(height.reshape(nodes.shape)) + offset.height_m
        patches[parcel.id] = nodes.patch(level, math.hypot(offset.sigma_m, chance))
    notices = (*raster.notices, *raster.raster.scale.notices)
    return SurveyedSoil(raster.path.name, patches, around, offset_m, sigma_m, notices)


@dataclass(frozen=True)
class SiteSoil:
    """The soil of a site."""

    soil: SoilAround | SurveyedSoil
    noise_m: float
    cells: int

    @property
    def notices(self) -> list[Notice]:
        """Warnings about the heights of another survey, and where nothing shows its offset."""
        if isinstance(self.soil, SoilAround):
            return []
        known = math.isfinite(self.soil.offset_sigma_m)
        return [*self.soil.notices, *([] if known else [Notice("soil-not-aligned", name=self.soil.name)])]

    def plain(self) -> dict[str, Any]:
        """As reports have it."""
        return {"cells": self.cells, "noise_m": round(self.noise_m, 5), **self.soil.plain()}


def site_soil(points: ParcelPoints, source: SoilMethod | SoilRaster = "surface") -> SiteSoil:
    """The soil of a site, from that around its parcels by a method, or from the heights of another survey."""
    cells = points.soil()
    near = CellsNear(points.parcels, cells)
    soil = align_survey(source, points.parcels, near) if isinstance(source, SoilRaster) else soil_around(near, source)
    return SiteSoil(soil, points.noise_m(CROP_PIXEL_M), len(cells))
