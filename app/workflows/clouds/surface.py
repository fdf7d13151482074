"""Surfaces of clouds: DSM, DTM, height above ground, terrain products."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from importlib.metadata import version
from pathlib import Path
from typing import Any, Final, Literal

import rasterio

from furrowmap.core.geodesy.crs_change import optional_crs
from furrowmap.core.pointclouds.clouds import Clouds, box_in, clipped, no_points_error, open_clouds
from furrowmap.core.pointclouds.far_points import near_box
from furrowmap.core.pointclouds.spooled_clouds import SpooledClouds, cell_for, spool_clouds
from furrowmap.core.pointclouds.surfaces import GroundMethod
from furrowmap.core.runtime.errors import InputError, Notice
from furrowmap.core.runtime.json_text import json_text, plain
from furrowmap.core.runtime.progress import Progress, silent
from furrowmap.core.surfaces.grid import Grid
from furrowmap.core.surfaces.spool import PointSpool
from furrowmap.core.values.crs import name_of
from furrowmap.exporters.files.result_folder import DSM, SURFACE_PRODUCTS, SURFACES_REPORT, refuse_occupied
from furrowmap.exporters.files.staging import staged_folder
from furrowmap.settings import SurfaceSettings
from furrowmap.workflows.clouds.inputs import area_records, input_records, input_rows
from furrowmap.workflows.clouds.rasters import CloudRasters

CACHE_BYTES: Final = 64 << 20
MANY_CELLS: Final = 10_000_000
"""Cells that take half a minute or more, of which nobody wants to wait for the empty ones."""
SPARSE_SHARE: Final = 0.05
"""Points a cell below which most of a grid stays empty: cells of a fair size hold four points where there are any."""


def no_warning(notice: Notice) -> None:
    """Takes a warning and does nothing with it."""


def surface(
    clouds: Sequence[str | Path],
    out: str | Path,
    settings: SurfaceSettings = SurfaceSettings(),
    *,
    overwrite: bool = False,
    progress: Progress = silent,
    warn: Callable[[Notice], None] = no_warning,
) -> dict[str, Any]:
    """Make DSM, DTM, height above ground, hillshade, slope, roughness and low spots of clouds.

    Args:
        clouds: LAS, LAZ or COPC files, which are gridded together.
        out: folder for the surfaces, made if it does not exist; all of them are written or none.
        settings: cell size, statistic, ground filter, box, CRS and more.
        overwrite: replace earlier surfaces in the folder.
        progress: is called with each stage and its share, 0 to 1.
        warn: is called once with each warning, as early as it is known.

    Returns:
        The content of `surfaces.json`: inputs, CRS, parameters, figures, warnings, names of the products.

    Raises:
        InputError: if a cloud cannot be read, the CRS do not fit together, or no point is left.
        RefusedError: if the folder holds surfaces, or the result of a run.
        OSError: if the folder cannot be written to.
    """
    folder = Path(out)
    refuse_occupied(folder, SURFACE_PRODUCTS, DSM, overwrite=overwrite)
    opened = open_clouds([Path(path) for path in clouds], optional_crs(settings.crs), optional_crs(settings.dst_crs))
    opened = clipped(opened, Path(settings.within) if settings.within is not None else None)
    # Without a limit GDAL caches up to a twentieth of the memory.
    with staged_folder(folder) as staging, rasterio.Env(GDAL_CACHEMAX=CACHE_BYTES):
        account = _write_surfaces(opened, staging, settings, progress, warn)
        (staging / SURFACES_REPORT).write_text(json_text(account), encoding="utf-8")
    return dict(plain(account))


def _write_surfaces(
    clouds: Clouds,
    staging: Path,
    settings: SurfaceSettings,
    progress: Progress,
    warn: Callable[[Notice], None],
) -> dict[str, Any]:
    """Write the surfaces into `staging`; the content of `surfaces.json`."""
    warnings: list[Notice] = []

    def report(notices: Sequence[Notice]) -> None:
        for notice in notices:
            if notice not in warnings:
                warnings.append(notice)
                warn(notice)

    box = box_in(clouds, settings.box, optional_crs(settings.box_crs))
    if box is None:
        box, far = near_box(clouds, progress)
        report(far)
    cell_m = settings.cell_m
    if cell_m is None:
        cell_m = cell_for(clouds, box, settings.classes, progress)
    with PointSpool(cell_m, folder=staging) as points, PointSpool(cell_m, folder=staging) as ground:
        spooled = spool_clouds(clouds, points, ground, box, settings.classes, settings.every, progress)
        grid = points.grid
        if grid is None:
            raise no_points_error(clouds, box)
        method = ground_method(settings.ground, spooled)
        report([*clouds.notices, *spooled.notices, *_sparse_notices(grid, spooled.count)])
        records = input_records(clouds, progress)
        files = [*records, *area_records(clouds)]
        rasters = CloudRasters(staging, clouds, grid, settings, box, method, files, spooled.span_s)
        rasters.write_surfaces(spooled, progress)
    figures, notices = rasters.write_derived(progress)
    report(notices)
    size = {"points": spooled.count, "cell_m": cell_m, "columns": grid.columns, "rows": grid.rows}
    return {
        "furrowmap": version("furrowmap"),
        "inputs": input_rows(clouds, records),
        "crs": name_of(clouds.crs),
        "parameters": rasters.parameters,
        "figures": {**size, **figures},
        "warnings": warnings,
        "products": sorted([*(path.name for path in staging.iterdir()), SURFACES_REPORT]),
    }


def ground_method(stated: GroundMethod | Literal["auto"], spooled: SpooledClouds) -> GroundMethod:
    """The ground filter to use; InputError if by the files' classes, and they have none."""
    if stated == "class" and not spooled.ground_count:
        raise InputError("no-ground-class.ground-method")
    if stated == "auto":
        return "class" if spooled.classified else "smrf"
    return stated


def _sparse_notices(grid: Grid, points: int) -> list[Notice]:
    """A warning about a grid that is mostly empty, before the long work on it."""
    cells = grid.rows * grid.columns
    if cells < MANY_CELLS or points >= SPARSE_SHARE * cells:
        return []
    return [
        Notice(
            "cells-mostly-empty", points=points, columns=grid.columns, rows=grid.rows, cells=cells, cell_m=grid.cell_m
        )
    ]
