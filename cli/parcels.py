"""`furrowmap parcels`: height and volume of crops by parcel."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

import furrowmap
from furrowmap.cli.console import Console
from furrowmap.cli.options import FILE, common_options
from furrowmap.cli.point_options import (
    classes_of,
    classes_option,
    crs_option,
    dst_crs_option,
    net_inset_option,
    net_option,
    widths_of,
)
from furrowmap.cli.tables import file_size, parcel_table, table
from furrowmap.core.runtime.errors import printable

SHOWN = ("mean_height_m", "height_sigma_m", "volume_m3", "p95_m", "cover", "points_m2")


@click.command(
    short_help="Measure height and volume of crops by parcel.",
    epilog="\b\nExample:\n  furrowmap parcels flight.copc.laz parcels.geojson -o crops --net-inset 1.0,0.11",
)
@click.argument("clouds", metavar="CLOUD...", nargs=-1, required=True, type=FILE)
@click.argument("parcels_file", metavar="PARCELS", type=FILE)
@click.option("-o", "--output", type=FILE, metavar="DIR", required=True, help="Output folder.")
@net_inset_option
@net_option
@click.option(
    "--method",
    type=click.Choice(["canopy-top", "christiansen2017"]),
    default="canopy-top",
    show_default=True,
    help="Method for heights and volumes: the canopy's top, unbiased by point density, or as published in 2017.",
)
@click.option(
    "--soil",
    metavar="surface|plane|FILE",
    default="surface",
    show_default=True,
    help="Soil below the crop: a surface through the bare soil around the parcels, a plane around each, or another "
    "survey: a surface or terrain model (GeoTIFF), a cloud of bare soil, or the folder of a result.",
)
@click.option("--treatments", metavar="FILE", help="CSV or spreadsheet with what each parcel or treatment was given.")
@click.option("--day", metavar="DATE", help="Day up to which doses are summed [default: that of the points].")
@click.option("--compare", is_flag=True, help="Compute the published method beside the default one.")
@classes_option
@crs_option
@dst_crs_option
@click.option("--overwrite", is_flag=True, help="Replace existing products in DIR.")
@common_options
def parcels(
    console: Console,
    clouds: tuple[Path, ...],
    parcels_file: Path,
    output: Path,
    net_inset: str | None,
    net: Path | None,
    method: Any,
    soil: str,
    classes: str | None,
    crs: str | None,
    dst_crs: str | None,
    treatments: str | None,
    day: str | None,
    *,
    compare: bool,
    overwrite: bool,
) -> None:
    """Measure height and volume of the crop on each parcel of PARCELS from CLOUDs (LAS, LAZ or COPC).

    PARCELS is a GeoPackage, Shapefile (also zipped), GeoJSON, FlatGeobuf, KML, or a CSV of corners, with the gross
    parcels. Writes parcels.gpkg, parcels.csv, parcels.xlsx (with the extra `trials`), crop_height.tif and parcels.json.
    """
    settings = furrowmap.ParcelSettings(
        net_inset_m=widths_of(net_inset, "--net-inset"),
        net=net,
        method=method,
        soil=soil,
        compare=compare,
        classes=classes_of(classes, "--class"),
        crs=crs,
        dst_crs=dst_crs,
        treatments=treatments,
        day=day,
    )
    with console.work() as progress:
        account = furrowmap.parcels(
            clouds, parcels_file, output, settings, overwrite=overwrite, progress=progress, warn=console.warn
        )
    console.answer({"folder": output, **account}, _words(account, output))


def _words(account: dict[str, Any], folder: Path) -> str:
    shown = parcel_table(account["parcels"], SHOWN, "parcels.csv")
    files = [(printable(name), file_size(folder / name)) for name in account["products"]]
    return f"{shown}\n{printable(str(folder))}:\n{table(files)}"
