"""From clouds to a folder of surfaces."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from importlib.metadata import version
from pathlib import Path
from typing import Any, Final

import rasterio

from furrowmap.core.pointclouds.clouds import box_in, no_points_error, open_clouds
from furrowmap.core.pointclouds.spooled_clouds import SpooledClouds, cell_for, spool_clouds
from furrowmap.core.pointclouds.surface_settings import SurfaceSettings
from furrowmap.core.pointclouds.surfaces import GroundMethod
from furrowmap.core.surfaces.grid import Grid
from furrowmap.core.surfaces.spool import PointSpool
from furrowmap.core.values.crs_name import name_of
from furrowmap.core.values.errors import InputError, Notice, RefusedError
from furrowmap.core.values.json_text import json_text, plain
from furrowmap.core.values.progress import Progress, silent
from furrowmap.exporters.files.file_records import file_records
from furrowmap.exporters.files.result_folder import REPORT, SURFACE_PRODUCTS, SURFACES_REPORT
from furrowmap.exporters.files.staging import recover, refuse_products, staged_folder
from furrowmap.workflows.cloud_rasters import CloudRasters

CACHE_BYTES: Final = 64 << 20
MANY_CELLS: Final = 10_000_000
"""Cells that take half a minute or more, of which nobody wants to wait for the empty ones."""
SPARSE_SHARE: Final = 0.05
"""Points a cell below which most of a grid stays empty: cells of a fair size hold four points where there are any."""


def unheard(notice: Notice) -> None:
    """A listener to warnings who does not listen."""


def write_cloud_surfaces(
    paths: Sequence[Path],
    folder: Path,
    settings: SurfaceSettings,
    *,
    overwrite: bool = False,
    progress: Progress = silent,
    warn: Callable[[Notice], None] = unheard,
) -> dict[str, Any]:
    """Make the surfaces of clouds and put them into a folder, all together or none.

    Args:
        paths: of LAS, LAZ or COPC files.
        folder: made if it is not there.
        settings: what is asked for.
        overwrite: replace earlier surfaces in the folder.
        progress: is told of the stages.
        warn: is told each warning once, those of the clouds and of long work before that begins.

    Returns:
        The content of `surfaces.json`.

    Raises:
        InputError: if a cloud cannot be read, their CRS do not fit, or no point is left.
        RefusedError: if there are surfaces in the folder already, or it is that of a run.
        OSError: if the folder cannot be written to.
    """
    _refuse_occupied(folder, overwrite=overwrite)
    clouds = open_clouds(paths, settings.crs, settings.dst_crs)
    box = box_in(clouds, settings.box, settings.box_crs)
    warnings: list[Notice] = []

    def tell(notices: Sequence[Notice]) -> None:
        for notice in notices:
            if notice not in warnings:
                warnings.append(notice)
                warn(notice)

    # GDAL would keep a twentieth of the computer's memory of what it has read.
    with staged_folder(folder) as staging, rasterio.Env(GDAL_CACHEMAX=CACHE_BYTES):
        cell_m = settings.cell_m
        if cell_m is None:
            cell_m = cell_for(clouds, box, settings.classes, progress)
        with PointSpool(cell_m, folder=staging) as points, PointSpool(cell_m, folder=staging) as ground:
            spooled = spool_clouds(clouds, points, ground, box, settings.classes, settings.every, progress)
            grid = points.grid
            if grid is None:
                raise no_points_error(clouds, box)
            method = _method(settings, spooled)
            tell([*clouds.notices, *spooled.notices, *_mostly_empty(grid, spooled.count)])
            records = [file_records([path], path.parent, progress)[0] for path in paths]
            rasters = CloudRasters(staging, clouds, grid, settings, box, method, records, spooled.span_s)
            rasters.surfaces(spooled, progress)
        figures, notices = rasters.derived(progress)
        tell(notices)
        account = {
            "furrowmap": version("furrowmap"),
            "inputs": [
                {"name": record.name, "format": file.format, "points": file.points, "sha256": record.sha256}
                for record, file in zip(records, clouds.files, strict=True)
            ],
            "crs": name_of(clouds.crs),
            "parameters": rasters.parameters,
            "figures": {
                "points": spooled.count,
                "cell_m": cell_m,
                "columns": grid.columns,
                "rows": grid.rows,
                **figures,
            },
            "warnings": warnings,
            "products": sorted([*(path.name for path in staging.iterdir()), SURFACES_REPORT]),
        }
        (staging / SURFACES_REPORT).write_text(json_text(account), encoding="utf-8")
    return dict(plain(account))


def _method(settings: SurfaceSettings, spooled: SpooledClouds) -> GroundMethod:
    """How the ground is told.

    Raises:
        InputError: if by the files' classes, and they have none.
    """
    if settings.ground == "class" and not spooled.ground_count:
        raise InputError(
            "Ground by 'class': no point of the clouds has the class 2, ground.",
            "Nobody has told the ground from what stands on it in these files, or those points are left out.",
            "Choose --ground-method smrf.",
            code="no-ground-class",
        )
    if settings.ground == "auto":
        return "class" if spooled.classified else "smrf"
    return settings.ground


def _mostly_empty(grid: Grid, points: int) -> list[Notice]:
    """What is to be known of a long wait for cells without points, before it begins."""
    cells = grid.rows * grid.columns
    if cells < MANY_CELLS or points >= SPARSE_SHARE * cells:
        return []
    text = (
        f"{points:,} points lie in a grid of {grid.columns:,} x {grid.rows:,} = {cells:,} cells of {grid.cell_m:g} m, "
        "so most of it stays empty and making it takes minutes. Choose larger cells (--cell; without it their density "
        "chooses), a box (--bbox), or leave out points that lie far away from the others."
    )
    return [Notice("cells-mostly-empty", text)]


def _refuse_occupied(folder: Path, *, overwrite: bool) -> None:
    """Keep what is in the folder.

    Raises:
        RefusedError: if it holds surfaces that may not be replaced, or the products of a run.
    """
    if not folder.is_dir():
        return
    recover(folder)
    if (folder / REPORT).exists():
        raise RefusedError(
            f"{folder} holds the products of a run.",
            "Its own dsm.tif would be replaced by another one.",
            "Choose another folder with -o.",
            code="output-is-run",
        )
    refuse_products(folder, SURFACE_PRODUCTS, overwrite=overwrite)
