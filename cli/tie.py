"""`furrowmap tie`: dates of one field tied to each other."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import furrowmap
from furrowmap.cli.console import Console
from furrowmap.cli.options import Paths, command, files, output, overwrite, settings_options
from furrowmap.cli.tables import table, written
from furrowmap.core.runtime.errors import printable
from furrowmap.core.values.margins import with_margin
from furrowmap.settings import TieSettings


@command(
    "Tie dates of one field to each other, and measure the change between them.",
    "furrowmap tie june11 june18 june25 -o season --reference survey.tif",
)
@files("results", "RESULT...")
@output("DIR", "Output folder.", "Output folder", required=True)
@settings_options(TieSettings)
@overwrite("Replace existing products in DIR.")
def tie(console: Console, results: Paths, output: Path, settings: TieSettings, *, overwrite: bool) -> None:
    """Tie RESULTs (folders of `furrowmap run`) of one field to each other by the ground that no tool touched.

    Each surface is moved in place, height, tilt and heading, with standard deviations. Writes the moved surfaces
    (dsm_NN.tif), the change from each date to the next (change_NN_NN.tif), tie.gpkg, tie.html and tie.json.
    """
    with console.work() as progress:
        account = furrowmap.tie(results, output, settings, overwrite=overwrite, progress=progress, warn=console.warn)
    console.answer({"folder": output, **account}, _words(account, output))


def _words(account: dict[str, Any], folder: Path) -> str:
    dates = [(f"{date['date']} {printable(date['name'])}", _move(date)) for date in account["dates"]]
    changes = [(f"{row['date_a']} to {row['date_b']}", _change(row)) for row in account["changes"]]
    return f"{table(dates)}\n{table(changes)}\n{written(account, folder)}"


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
        f"{with_margin(row['volume_m3'], row['volume_sigma_m3'], ' m³', sign=True)} on {row['worked_m2']:.1f} m², mean "
        f"{with_margin(row['mean_change_m'], row['mean_change_sigma_m'], ' mm', 1000.0, sign=True)} (95 %)"
    )
