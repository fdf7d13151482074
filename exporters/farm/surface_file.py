"""What a GeoTIFF of heights says of itself, as far as a mosaic asks."""

from __future__ import annotations

import datetime as dt
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import rasterio
from pyproj import CRS

from furrowmap.core.surfaces.grid import Grid
from furrowmap.core.values.errors import InputError
from furrowmap.exporters.rasters.cog import Band

_OFF_CELLS: Final = 1e-3
"""By how much of a cell a raster's edge may be off the grid's lines, for its numbers are rounded."""


@dataclass(frozen=True)
class SurfaceFile:
    """A surface of a session, as its file says.

    Attributes:
        path: of the GeoTIFF.
        crs: of its cells, with heights where the file tells them.
        cell_m: length of a cell's sides.
        bounds_m: west, south, east, north.
        grid: its cells; None where they are not anchored to the CRS.
        bands: what they hold, the height first.
        nodata: of each band; None where there is none.
        span_s: UTC of the first and the last measurement; None where it does not tell.
    """

    path: Path
    crs: CRS
    cell_m: float
    bounds_m: tuple[float, float, float, float]
    grid: Grid | None
    bands: tuple[Band, ...]
    nodata: float | None
    span_s: tuple[float, float] | None


def surface_file(path: Path) -> SurfaceFile:
    """What the GeoTIFF at `path` says of its cells.

    Raises:
        InputError: if it is none, or has no CRS or cells that are not square and north-up.
    """
    try:
        with rasterio.Env(GTIFF_REPORT_COMPD_CS=True), rasterio.open(path, driver="GTiff") as raster:
            if raster.crs is None:
                raise _unusable(path, "has no CRS")
            width, skew, _, skew2, height = raster.transform[:5]
            if skew or skew2 or height >= 0 or abs(width + height) > 1e-9 * width:
                raise _unusable(path, "has cells that are not square and north-up")
            bands = tuple(
                Band(description or f"band {i}", unit or "", 0)
                for i, (description, unit) in enumerate(zip(raster.descriptions, raster.units, strict=True), start=1)
            )
            crs = CRS.from_wkt(raster.crs.to_wkt())
            grid = _anchored(width, raster.bounds, raster.shape)
            return SurfaceFile(
                path.resolve(), crs, width, tuple(raster.bounds), grid, bands, raster.nodata, _span(raster.tags())
            )
    except rasterio.errors.RasterioIOError as error:
        raise _unusable(path, f"cannot be read ({error})") from None


def _unusable(path: Path, why: str) -> InputError:
    return InputError(
        f"{path} {why}.",
        "It is no surface that a mosaic could be made of, so nothing was done.",
        "Make it again with `furrowmap run` or `furrowmap surface`, or leave its folder out.",
        code="surface-unusable",
    )


def _span(tags: Mapping[str, str]) -> tuple[float, float] | None:
    try:
        first, last = (dt.datetime.fromisoformat(tags[name]) for name in ("TIME_START", "TIME_END"))
    except (KeyError, ValueError):
        return None
    return first.timestamp(), last.timestamp()


def _anchored(cell_m: float, bounds: Any, shape: tuple[int, int]) -> Grid | None:
    west, north = bounds[0] / cell_m, bounds[3] / cell_m
    if max(abs(west - round(west)), abs(north - round(north))) > _OFF_CELLS:
        return None
    return Grid(cell_m, round(west), round(north), shape)


def heights_of(crs: CRS) -> str:
    """The name of a CRS's heights; empty where it has none."""
    return crs.sub_crs_list[1].name if crs.is_compound else ""


def horizontal(crs: CRS) -> CRS:
    """A CRS without its heights."""
    return crs.sub_crs_list[0] if crs.is_compound else crs.to_2d()


def same_map(one: CRS, other: CRS) -> bool:
    """Whether two CRSs have the same coordinates, whatever their heights."""
    return horizontal(one).equals(horizontal(other), ignore_axis_order=True)
