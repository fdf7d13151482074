"""Surfaces of clouds: DSM, DTM, height above ground, terrain products."""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, Final, Literal

import rasterio

from furrowmap.core.pointclouds.joined_clouds import no_points_error
from furrowmap.core.pointclouds.spool_clouds import cell_for, spool_clouds
from furrowmap.core.pointclouds.spooled_clouds import SpooledClouds
from furrowmap.core.pointclouds.surfaces import GroundMethod, finer_cells
from furrowmap.core.runtime.errors import InputError, Notice
from furrowmap.core.runtime.progress import Progress, silent
from furrowmap.core.surfaces.grid import Grid
from furrowmap.core.surfaces.spool import PointSpool
from furrowmap.core.values.crs import name_of
from furrowmap.exporters.files.result_folder import DSM, SURFACE_PRODUCTS, SURFACES_REPORT, refuse_occupied
from furrowmap.exporters.files.staging import staged_folder
from furrowmap.settings import SurfaceSettings
from furrowmap.workflows.clouds.inputs import area_records, box_to_use, input_records, open_inputs, write_account
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
        warn: is called once with each warning, as early as it is known.

    Returns:
        The content of `surfaces.json`: inputs, CRS, parameters, figures, warnings, names of the products.

    Raises:
        InputError: if a cloud cannot be read, the CRS do not fit together, or no point is left.
        RefusedError: if the folder holds surfaces, or the result of a run.
    """
    folder = Path(out)
    refuse_occupied(folder, SURFACE_PRODUCTS, DSM, overwrite=overwrite)
    opened = open_inputs(clouds, settings)
    warnings: list[Notice] = []

    def report(notices: Sequence[Notice]) -> None:
        for notice in notices:
            if notice not in warnings:
                warnings.append(notice)
                warn(notice)

    # Without a limit GDAL caches up to a twentieth of the memory.
    with staged_folder(folder) as staging, rasterio.Env(GDAL_CACHEMAX=CACHE_BYTES):
        box, far = box_to_use(opened, settings.box, settings.box_crs, progress)
        report(far)
        cell_m = settings.cell_m
        if cell_m is None:
            cell_m = cell_for(opened, box, settings.classes, progress)
        factor = 1 if settings.ground == "none" else finer_cells(cell_m)
        fine_m = cell_m / factor
        with PointSpool(fine_m, folder=staging) as points, PointSpool(fine_m, folder=staging) as ground:
            spooled = spool_clouds(opened, points, ground, box, settings.classes, settings.every, progress)
            if points.grid is None:
                raise no_points_error(opened, box)
            grid = points.grid.coarser(factor)
            method = ground_method(settings.ground, spooled)
            report([*opened.notices, *spooled.notices, *_sparse_notices(grid, spooled.count)])
            records = input_records(opened, progress)
            files = [*records, *area_records(opened)]
            rasters = CloudRasters(staging, opened, grid, settings, box, method, files, spooled.span_s)
            rasters.write_surfaces(spooled, progress)
        figures, notices = rasters.write_derived(progress)
        report(notices)
        size = {"points": spooled.count, "cell_m": cell_m, "columns": grid.columns, "rows": grid.rows}
        content = {"crs": name_of(opened.crs), "parameters": rasters.parameters, "figures": {**size, **figures}}
        return write_account(staging, SURFACES_REPORT, opened, records, content, warnings)


def ground_method(stated: GroundMethod | Literal["auto"], spooled: SpooledClouds) -> GroundMethod:
    """The ground filter to use; InputError if by the files' classes, and they have none."""
    if stated == "class" and not spooled.ground_count:
        raise InputError("no-ground-class.by-class")
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
