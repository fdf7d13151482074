"""`furrowmap canopy`: stands that are no plots."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

import furrowmap
from furrowmap.cli.console import Console
from furrowmap.cli.options import FILE, common_options
from furrowmap.cli.point_options import bbox_option, box_of, classes_of, classes_option, crs_option, dst_crs_option
from furrowmap.cli.tables import figures, file_size, table
from furrowmap.core.runtime.errors import printable

SIZE = click.FloatRange(0, min_open=True)


@click.command(
    short_help="Describe stands by cell or polygon: heights, gaps, profile.",
    epilog="\b\nExample:\n  furrowmap canopy orchard.laz -o canopy --cell 5",
)
@click.argument("clouds", metavar="CLOUD...", nargs=-1, required=True, type=FILE)
@click.option("-o", "--output", type=FILE, metavar="DIR", required=True, help="Output folder.")
@click.option("--cell", type=SIZE, metavar="METRES", help="Side of the square cells that figures are of.")
@click.option("--polygons", type=FILE, metavar="FILE", help="Areas that figures are of, instead of cells.")
@click.option(
    "--pixel",
    type=SIZE,
    metavar="METRES",
    help="Pixel of the canopy height model [default: the smallest round size with four points, up to 1 m].",
)
@click.option(
    "--ground-height",
    type=click.FloatRange(0),
    default=0.2,
    show_default=True,
    metavar="METRES",
    help="Returns up to this height above the ground are from the ground; in forests 2 is usual.",
)
@click.option(
    "--layer", type=SIZE, default=0.5, show_default=True, metavar="METRES", help="Height of a layer of the profile."
)
@click.option(
    "--ground-method",
    type=click.Choice(["auto", "class", "smrf", "csf"]),
    default="auto",
    show_default=True,
    help="Ground classification method; auto uses the ground class of the input if there is one, else smrf.",
)
@bbox_option
@classes_option
@crs_option
@dst_crs_option
@click.option("--overwrite", is_flag=True, help="Replace existing products in DIR.")
@common_options
def canopy(
    console: Console,
    clouds: tuple[Path, ...],
    output: Path,
    cell: float | None,
    polygons: Path | None,
    pixel: float | None,
    ground_height: float,
    layer: float,
    ground_method: Any,
    bbox: str | None,
    classes: str | None,
    crs: str | None,
    dst_crs: str | None,
    *,
    overwrite: bool,
) -> None:
    """Describe trees, orchards and other stands in CLOUDs (LAS, LAZ or COPC) by cell or polygon.

    Writes canopy_height.tif (the highest return of each pixel above the ground), canopy.gpkg and canopy.csv (height
    percentiles, gap fraction and more of each area), canopy_profile.csv (share of returns by height) and canopy.json.
    """
    settings = furrowmap.CanopySettings(
        cell_m=cell,
        polygons=polygons,
        pixel_m=pixel,
        ground_m=ground_height,
        layer_m=layer,
        ground=ground_method,
        box=box_of(bbox),
        classes=classes_of(classes, "--class"),
        crs=crs,
        dst_crs=dst_crs,
    )
    with console.work() as progress:
        account = furrowmap.canopy(clouds, output, settings, overwrite=overwrite, progress=progress, warn=console.warn)
    console.answer({"folder": output, **account}, _words(account, output))


def _words(account: dict[str, Any], folder: Path) -> str:
    files = [(printable(name), file_size(folder / name)) for name in account["products"]]
    shown = {**account["figures"], "crs": account["crs"], "ground": account["parameters"]["ground"]}
    return f"{table(figures(shown))}\n{printable(str(folder))}:\n{table(files)}"
