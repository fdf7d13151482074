"""`furrowmap growth`: growth of crops by parcel between flights."""

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

SHOWN = ("growth_m", "growth_sigma_m", "rate_m_day", "rate_sigma_m_day")


@click.command(
    short_help="Measure growth of crops by parcel between flights.",
    epilog="\b\nExample:\n  furrowmap growth may13.laz may23.laz parcels.geojson -o growth --net-inset 1.0,0.11",
)
@click.argument("clouds", metavar="CLOUD...", nargs=-1, required=True, type=FILE)
@click.argument("parcels_file", metavar="PARCELS", type=FILE)
@click.option("-o", "--output", type=FILE, metavar="DIR", required=True, help="Output folder.")
@click.option(
    "--day",
    "days",
    multiple=True,
    metavar="DATE",
    help="Day of the flight, once for each CLOUD [default: that of its points].",
)
@net_inset_option
@net_option
@classes_option
@crs_option
@dst_crs_option
@click.option("--overwrite", is_flag=True, help="Replace existing products in DIR.")
@common_options
def growth(
    console: Console,
    clouds: tuple[Path, ...],
    parcels_file: Path,
    output: Path,
    days: tuple[str, ...],
    net_inset: str | None,
    net: Path | None,
    classes: str | None,
    crs: str | None,
    dst_crs: str | None,
    *,
    overwrite: bool,
) -> None:
    """Measure what the crop on each parcel of PARCELS grew between CLOUDs (LAS, LAZ or COPC) of several days.

    Bare soil that the flights have in common aligns them in height. Writes growth.gpkg (a layer coloured by growth),
    growth.csv, growth.xlsx and growth.json.
    """
    settings = furrowmap.GrowthSettings(
        days=days or None,
        net_inset_m=widths_of(net_inset, "--net-inset"),
        net=net,
        classes=classes_of(classes, "--class"),
        crs=crs,
        dst_crs=dst_crs,
    )
    with console.work() as progress:
        account = furrowmap.growth(
            clouds, parcels_file, output, settings, overwrite=overwrite, progress=progress, warn=console.warn
        )
    console.answer({"folder": output, **account}, _words(account, output))


def _words(account: dict[str, Any], folder: Path) -> str:
    shown = parcel_table(account["parcels"], SHOWN, "growth.csv")
    days = [(each["day"], _alignment(each)) for each in account["flights"]]
    files = [(printable(name), file_size(folder / name)) for name in account["products"]]
    return f"{table(days)}\n{shown}\n{printable(str(folder))}:\n{table(files)}"


def _alignment(flight: dict[str, Any]) -> str:
    """How a flight was aligned."""
    found = flight["alignment"]
    if found is None:
        return "reference"
    tilt = f", tilt {found['tilt_east']:+.1e} east, {found['tilt_north']:+.1e} north" if found["tilted"] else ""
    return f"soil {1000 * found['offset_m']:+.1f} ± {1000 * found['offset_sigma_m']:.1f} mm{tilt}"
