"""`furrowmap growth`: growth of crops by parcel between flights."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

import furrowmap
from furrowmap.cli.console import Console
from furrowmap.cli.options import FILE, Paths, command, files, output, overwrite, settings_options
from furrowmap.cli.tables import parcel_table, table, written
from furrowmap.core.values.margins import with_margin
from furrowmap.settings import GrowthSettings

GROWTH_COLUMNS = ("growth_m", "growth_sigma_m", "rate_m_day", "rate_sigma_m_day")


@command(
    "Measure growth of crops by parcel between flights.",
    "furrowmap growth may13.laz may23.laz parcels.geojson -o growth --net-inset 1.0,0.11",
)
@files("clouds", "CLOUD...")
@click.argument("parcels_file", metavar="PARCELS", type=FILE)
@output("DIR", "Output folder.", "Output folder", required=True)
@settings_options(GrowthSettings)
@overwrite("Replace existing products in DIR.")
def growth(
    console: Console, clouds: Paths, parcels_file: Path, output: Path, settings: GrowthSettings, *, overwrite: bool
) -> None:
    """Measure what the crop on each parcel of PARCELS grew between CLOUDs (LAS, LAZ or COPC) of several days.

    Bare soil that the flights have in common aligns them in height. Writes growth.gpkg (a layer coloured by growth),
    growth.csv, growth.xlsx and growth.json.
    """
    with console.work() as progress:
        account = furrowmap.growth(
            clouds, parcels_file, output, settings, overwrite=overwrite, progress=progress, warn=console.warn
        )
    days = table((each["day"], _alignment(each)) for each in account["flights"])
    shown = parcel_table(account["parcels"], GROWTH_COLUMNS, "growth.csv")
    console.answer({"folder": output, **account}, f"{days}\n{shown}\n{written(account, output)}")


def _alignment(flight: dict[str, Any]) -> str:
    """How a flight was aligned."""
    found = flight["alignment"]
    if found is None:
        return "reference"
    tilt = f", tilt {found['tilt_east']:+.1e} east, {found['tilt_north']:+.1e} north" if found["tilted"] else ""
    return f"soil {with_margin(found['offset_m'], found['offset_sigma_m'], ' mm', 1000.0, sign=True)} (95 %){tilt}"
