"""`furrowmap surface`: surfaces of any cloud."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from furrowmap.cli.console import Console
from furrowmap.cli.options import FILE, common_options, named_crs
from furrowmap.cli.point_options import box_of, classes_of
from furrowmap.cli.words import figures, file_size, table
from furrowmap.core.values.errors import printable


@click.command(
    short_help="Make surfaces of LAS, LAZ or COPC clouds.",
    epilog="\b\nExample:\n  furrowmap surface field_a.laz field_b.laz -o surfaces --cell 0.1",
)
@click.argument("clouds", metavar="CLOUD...", nargs=-1, required=True, type=FILE)
@click.option("-o", "--output", type=FILE, metavar="DIR", required=True, help="Folder for the surfaces.")
@click.option(
    "--cell",
    type=click.FloatRange(0, min_open=True),
    metavar="METRES",
    help="Side of a cell [default: the least round one with four points in it].",
)
@click.option(
    "--statistic",
    metavar="NAME",
    default="median",
    show_default=True,
    help="What stands for the points of a cell: median, trimmed, mean, min, max, or a percentile such as p90.",
)
@click.option("--bbox", metavar="W,S,E,N", help="Only points in this box, in the CRS of the surfaces.")
@click.option("--bbox-crs", metavar="CRS", help="The CRS of the box, if it is another one.")
@click.option(
    "--class",
    "classes",
    metavar="N,N",
    help="Only points of these classes [default: all but noise and, in furrowmap's own clouds, the machine].",
)
@click.option(
    "--ground-method",
    type=click.Choice(["auto", "class", "smrf", "csf", "none"]),
    default="auto",
    show_default=True,
    help="How ground is told; auto: by the clouds' own classes where they have them, else smrf.",
)
@click.option(
    "--outliers",
    type=click.Choice(["none", "radius", "statistical"]),
    default="none",
    show_default=True,
    help="How points that are alone are told, and left out.",
)
@click.option("--every", type=click.IntRange(1), default=1, metavar="N", help="Take every N-th point only.")
@click.option(
    "--fill",
    type=click.FloatRange(0),
    default=0.0,
    metavar="METRES",
    help="Fill gaps up to so far from seen heights, nothing outside.",
)
@click.option(
    "--tillage",
    type=float,
    metavar="DEGREES",
    help="Direction of tillage, clockwise from grid north: random roughness is then told without its marks.",
)
@click.option("--crs", metavar="CRS", help="The CRS of clouds that state none.")
@click.option("--dst-crs", metavar="CRS", help="The CRS of the surfaces, in metres [default: that of the clouds].")
@click.option("--overwrite", is_flag=True, help="Replace earlier surfaces in that folder.")
@common_options
def surface(
    console: Console,
    clouds: tuple[Path, ...],
    output: Path,
    cell: float | None,
    statistic: str,
    bbox: str | None,
    bbox_crs: str | None,
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
    """Make surfaces of CLOUDs, which lie together on one grid: LAS, LAZ or COPC, from furrowmap or from anybody else.

    The folder then holds dsm.tif (all points), dtm.tif (the ground), height_above_ground.tif, hillshade.tif, slope.tif,
    roughness.tif, low_spots.tif with low_spots.gpkg, and surfaces.json. What a file says that is not so is told on
    standard error.
    """
    box, kept = box_of(bbox), classes_of(classes, "--class")
    from furrowmap.core.pointclouds.surface_settings import SurfaceSettings
    from furrowmap.core.surfaces.statistic import Statistic
    from furrowmap.workflows.surface import write_cloud_surfaces

    settings = SurfaceSettings(
        cell_m=cell,
        box=box,
        box_crs=named_crs(bbox_crs),
        classes=kept,
        statistic=Statistic.parse(statistic),
        ground=ground_method,
        outliers=outliers,
        every=every,
        fill_m=fill,
        tillage_heading_deg=tillage,
        crs=named_crs(crs),
        dst_crs=named_crs(dst_crs),
    )
    with console.work() as progress:
        account = write_cloud_surfaces(
            clouds, output, settings, overwrite=overwrite, progress=progress, warn=console.warn
        )
    console.answer({"folder": output, **account}, _words(account, output))


def _words(account: dict[str, Any], folder: Path) -> str:
    files = [(printable(name), file_size(folder / name)) for name in account["products"]]
    told = {**account["figures"], "crs": account["crs"], "ground": account["parameters"]["ground"]}
    return f"{table(figures(told))}\n{printable(str(folder))}:\n{table(files)}"
