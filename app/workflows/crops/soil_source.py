"""Soil of another survey for parcels: a raster, a cloud of bare soil, or a folder with one of them."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

from pyproj import CRS

from furrowmap.core.crops.site_soil import SoilRaster, open_soil_raster
from furrowmap.core.crops.soil import SOIL_CELL_M
from furrowmap.core.pointclouds.clouds import Clouds, no_points_error, open_clouds
from furrowmap.core.pointclouds.spooled_clouds import spool_clouds
from furrowmap.core.pointclouds.surfaces import GroundMethod
from furrowmap.core.readers.las.cloud import Box
from furrowmap.core.readers.las.header import SIGNATURE
from furrowmap.core.runtime.progress import Progress
from furrowmap.core.surfaces.spool import PointSpool
from furrowmap.core.values.parcel import SOIL_METHODS, SoilMethod
from furrowmap.exporters.files.result_folder import DSM, DTM
from furrowmap.settings import SurfaceSettings, soil_file
from furrowmap.workflows.clouds.inputs import input_records
from furrowmap.workflows.clouds.rasters import CloudRasters


def expect_soil(path: Path | None, target: CRS, box_m: Box) -> None:
    """Open a soil survey before long work, and close it.

    Raises:
        InputError, RefusedError: as :func:`soil_source`.
    """
    if path is None:
        return
    if _is_cloud(path):
        _clouds(path, target)
        return
    with open_soil_raster(path, target, box_m):
        pass


@contextmanager
def soil_source(
    source: str | Path, target: CRS, box_m: Box, folder: Path, progress: Progress
) -> Iterator[SoilMethod | SoilRaster]:
    """The soil under parcels, as :func:`~furrowmap.core.crops.site_soil.site_soil` takes it.

    The points of a cloud are gridded: those of its ground class if it has one, else all, by their median.

    Args:
        source: "surface", "plane", or a GeoTIFF, a cloud or a result folder of another survey.
        box_m: west, south, east, north of the parcels and what surrounds them.

    Raises:
        InputError: if the survey cannot be read, or has nothing in the box.
        RefusedError: if PROJ has no exact transformation between it and the map.
    """
    path = soil_file(source)
    if path is None:
        yield next(method for method in SOIL_METHODS if method == source)
    elif _is_cloud(path):
        with tempfile.TemporaryDirectory(prefix="soil-", dir=folder) as made:
            raster = _gridded(_clouds(path, target), Path(made), box_m, progress)
            with open_soil_raster(raster, target, box_m) as opened:
                yield replace(opened, path=path)
    else:
        with open_soil_raster(path, target, box_m) as opened:
            yield opened


def _is_cloud(path: Path) -> bool:
    with path.open("rb") as file:
        return file.read(4) == SIGNATURE


def _clouds(path: Path, target: CRS) -> Clouds:
    return open_clouds([path], target, target)


def _gridded(clouds: Clouds, folder: Path, box_m: Box, progress: Progress) -> Path:
    """The surface of a cloud in a box."""
    with PointSpool(SOIL_CELL_M, folder=folder) as points, PointSpool(SOIL_CELL_M, folder=folder) as ground:
        spooled = spool_clouds(clouds, points, ground, box_m, progress=progress)
        if points.grid is None:
            raise no_points_error(clouds, box_m)
        method: GroundMethod = "class" if spooled.classified else "none"
        settings = SurfaceSettings(cell_m=SOIL_CELL_M)
        records = input_records(clouds, progress)
        CloudRasters(folder, clouds, points.grid, settings, box_m, method, records, spooled.span_s).surfaces(
            spooled, progress
        )
    return folder / (DTM if method == "class" else DSM)
