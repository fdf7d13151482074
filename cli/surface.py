"""`furrowmap surface`: surfaces of any point cloud."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

import furrowmap
from furrowmap.cli.console import Console
from furrowmap.cli.options import FILE, common_options
from furrowmap.cli.point_options import (
    bbox_crs_option,
    bbox_option,
    box_of,
    classes_of,
    classes_option,
    crs_option,
    dst_crs_option,
    every_option,
    within_option,
)
from furrowmap.cli.tables import figures, file_size, table
from furrowmap.core.runtime.errors import printable


@click.command(
    short_help="Compute DSM, DTM and derived surfaces of point clouds.",
    epilog="\b\nExample:\n  furrowmap surface field_a.laz field_b.laz -o surfaces --cell 0.1",
)
@click.argument("clouds", metavar="CLOUD...", nargs=-1, required=True, type=FILE)
@click.option("-o", "--output", type=FILE, metavar="DIR", required=True, help="Output folder.")
@click.option(
    "--cell",
    type=click.FloatRange(0, min_open=True),
    metavar="METRES",
    help="Cell size [default: the smallest round size with four points per cell].",
)
@click.option(
    "--statistic",
    metavar="NAME",
    default="median",
    show_default=True,
    help="Height statistic per cell: median, trimmed, mean, min, max, or a percentile such as p90.",
)
@bbox_option
@bbox_crs_option
@classes_option
@click.option(
    "--ground-method",
    type=click.Choice(["auto", "class", "smrf", "csf", "none"]),
    default="auto",
    show_default=True,
    help="Ground classification method; auto uses the ground class of the input if there is one, else smrf.",
)
@click.option(
    "--outliers",
    type=click.Choice(["none", "radius", "statistical"]),
    default="none",
    show_default=True,
    help="Outlier detection method; outliers are left out.",
)
@every_option
@click.option(
    "--fill",
    type=click.FloatRange(0),
    default=0.0,
    metavar="METRES",
    help="Fill gaps up to this distance from the nearest measured height, but not beyond the outline of the data.",
)
@click.option(
    "--tillage",
    type=float,
    metavar="DEGREES",
    help="Direction of tillage, clockwise from grid north; removes tillage marks from the random roughness.",
)
@within_option
@crs_option
@dst_crs_option
@click.option("--overwrite", is_flag=True, help="Replace existing surfaces in DIR.")
@common_options
def surface(
    console: Console,
    clouds: tuple[Path, ...],
    output: Path,
    cell: float | None,
    statistic: str,
    bbox: str | None,
    bbox_crs: str | None,
    within: Path | None,
    classes: str | None,
    ground_method: Any,
    outliers: Any,
    every: int,
    fill: float,
    tillage: float | None,
    crs: str | None,
    dst_crs: str | None,
    *,
    overwrite: bool,
) -> None:
    """Compute surfaces of CLOUDs (LAS, LAZ or COPC from any software) together on one grid.

    Writes dsm.tif (all points), dtm.tif (ground), height_above_ground.tif, hillshade.tif, slope.tif, roughness.tif,
    low_spots.tif, low_spots.gpkg and surfaces.json. False statements in a file header are reported as warnings.
    """
    box, kept = box_of(bbox), classes_of(classes, "--class")
    settings = furrowmap.SurfaceSettings(
        cell_m=cell,
        box=box,
        box_crs=bbox_crs,
        classes=kept,
        statistic=statistic,
        ground=ground_method,
        outliers=outliers,
        every=every,
        fill_m=fill,
        tillage_heading_deg=tillage,
        crs=crs,
        dst_crs=dst_crs,
        within=within,
    )
    with console.work() as progress:
        account = furrowmap.surface(clouds, output, settings, overwrite=overwrite, progress=progress, warn=console.warn)
    console.answer({"folder": output, **account}, _words(account, output))


def _words(account: dict[str, Any], folder: Path) -> str:
    files = [(printable(name), file_size(folder / name)) for name in account["products"]]
    shown = {**account["figures"], "crs": account["crs"], "ground": account["parameters"]["ground"]}
    return f"{table(figures(shown))}\n{printable(str(folder))}:\n{table(files)}"
