"""`furrowmap tie`: dates of one field tied to each other."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

import furrowmap
from furrowmap.cli.console import Console
from furrowmap.cli.options import FILE, common_options
from furrowmap.cli.tables import file_size, table
from furrowmap.core.runtime.errors import printable


@click.command(
    short_help="Tie dates of one field to each other, and measure the change between them.",
    epilog="\b\nExample:\n  furrowmap tie june11 june18 june25 -o season --reference survey.tif",
)
@click.argument("results", metavar="RESULT...", nargs=-1, required=True, type=FILE)
@click.option("-o", "--output", type=FILE, metavar="DIR", required=True, help="Output folder.")
@click.option(
    "--reference",
    type=FILE,
    metavar="FILE",
    help="Surveyed surface (GeoTIFF) or points (CSV or GeoPackage) to move the dates onto.",
)
@click.option(
    "--reference-sigma",
    type=click.FloatRange(0),
    default=0.0,
    show_default=True,
    metavar="METRES",
    help="Standard deviation of the heights of the reference.",
)
@click.option("--overwrite", is_flag=True, help="Replace existing products in DIR.")
@common_options
def tie(
    console: Console,
    results: tuple[Path, ...],
    output: Path,
    reference: Path | None,
    reference_sigma: float,
    *,
    overwrite: bool,
) -> None:
    """Tie RESULTs (folders of `furrowmap run`) of one field to each other by the ground that no tool touched.

    Each surface is moved in place, height, tilt and heading, with standard deviations. Writes the moved surfaces
    (dsm_NN.tif), the change from each date to the next (change_NN_NN.tif), tie.gpkg, tie.html and tie.json.
    """
    settings = furrowmap.TieSettings(reference, reference_sigma)
    with console.work() as progress:
        account = furrowmap.tie(results, output, settings, overwrite=overwrite, progress=progress, warn=console.warn)
    console.answer({"folder": output, **account}, _words(account, output))


def _words(account: dict[str, Any], folder: Path) -> str:
    dates = [(f"{date['date']} {printable(date['name'])}", _move(date)) for date in account["dates"]]
    changes = [(f"{row['date_a']} to {row['date_b']}", _change(row)) for row in account["changes"]]
    files = [(printable(name), file_size(folder / name)) for name in account["products"]]
    return f"{table(dates)}\n{table(changes)}\n{printable(str(folder))}:\n{table(files)}"


def _move(date: dict[str, Any]) -> str:
    if not date["tied"]:
        return "not tied"
    east, north, up = (1000.0 * date[name] for name in ("east_m", "north_m", "height_m"))
    tilts = f"{date['tilt_east_deg']:+.4f}° east, {date['tilt_north_deg']:+.4f}° north"
    return f"moved {east:+.1f} mm east, {north:+.1f} mm north, {up:+.1f} mm up, tilted {tilts}"


def _change(row: dict[str, Any]) -> str:
    if row["volume_m3"] is None:
        return "no worked ground seen on both dates"
    return (
        f"{row['volume_m3']:+.3f} ± {row['volume_sigma_m3']:.3f} m³ on {row['worked_m2']:.1f} m², mean "
        f"{1000.0 * row['mean_change_m']:+.1f} ± {1000.0 * row['mean_change_sigma_m']:.1f} mm"
    )
