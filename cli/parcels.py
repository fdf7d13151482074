"""`furrowmap parcels`: height and volume of crops by parcel."""

from __future__ import annotations

from pathlib import Path

import click

import furrowmap
from furrowmap.cli.console import Console
from furrowmap.cli.options import FILE, Paths, command, files, output, overwrite, settings_options
from furrowmap.cli.tables import parcel_table, written
from furrowmap.settings import ParcelSettings

PARCEL_COLUMNS = ("mean_height_m", "height_sigma_m", "volume_m3", "p95_m", "cover", "points_m2")


@command(
    "Measure height and volume of crops by parcel.",
    "furrowmap parcels flight.copc.laz parcels.geojson -o crops --net-inset 1.0,0.11",
)
@files("clouds", "CLOUD...")
@click.argument("parcels_file", metavar="PARCELS", type=FILE)
@output("DIR", "Output folder.", "Output folder", required=True)
@settings_options(ParcelSettings)
@overwrite("Replace existing products in DIR.")
def parcels(
    console: Console, clouds: Paths, parcels_file: Path, output: Path, settings: ParcelSettings, *, overwrite: bool
) -> None:
    """Measure height and volume of the crop on each parcel of PARCELS from CLOUDs (LAS, LAZ, COPC, PCD, PLY or E57).

    PARCELS is a GeoPackage, Shapefile (also zipped), GeoJSON, FlatGeobuf, KML, or a CSV of corners, with the gross
    parcels. Writes parcels.gpkg, parcels.csv, parcels.xlsx (with the extra `trials`), crop_height.tif and parcels.json.
    """
    with console.work() as progress:
        account = furrowmap.parcels(
            clouds, parcels_file, output, settings, overwrite=overwrite, progress=progress, warn=console.warn
        )
    shown = parcel_table(account["parcels"], PARCEL_COLUMNS, "parcels.csv")
    console.answer({"folder": output, **account}, f"{shown}\n{written(account, output)}")
