"""`furrowmap season`: mosaics, points and trajectories of many sessions, with a catalogue."""

from __future__ import annotations

from pathlib import Path

import click

import furrowmap
from furrowmap.cli.console import Console
from furrowmap.cli.options import FILE, common_options, worker_options
from furrowmap.cli.tables import table
from furrowmap.core.runtime.errors import printable

_CONTENT = ("mosaics", "points", "trajectories")


@click.command(
    short_help="Merge the results of a season: mosaics, GeoParquet, STAC catalogue.",
    epilog="\b\nExample:\n  furrowmap season results -o season2026\n"
    "  furrowmap season results -o season2026 --content mosaics --cell 0.1",
)
@click.argument("results", metavar="RESULTS...", type=FILE, nargs=-1, required=True)
@click.option("-o", "--output", type=FILE, metavar="FOLDER", required=True, help="Folder of the season.")
@click.option(
    "--content", type=click.Choice(_CONTENT), multiple=True, help="What to write; can be repeated [default: all]."
)
@click.option("--dst-crs", "crs", metavar="CRS", help="CRS of all products [default: that of the sessions].")
@click.option(
    "--cell",
    "cell_m",
    type=click.FloatRange(min=0, min_open=True),
    metavar="METRES",
    help="Cell size of the mosaics [default: that of the latest surface].",
)
@click.option(
    "--spacing",
    "spacing_m",
    type=click.FloatRange(min=0),
    default=0.0,
    metavar="METRES",
    help="Point spacing that is sufficient; 0 for all points [default: 0].",
)
@click.option(
    "--most-rows",
    type=click.IntRange(1),
    default=5_000_000,
    show_default=True,
    metavar="N",
    help="Maximum number of rows of a Parquet file.",
)
@worker_options
@click.option("--overwrite", is_flag=True, help="Replace another catalogue in FOLDER.")
@common_options
def season(
    console: Console,
    results: tuple[Path, ...],
    output: Path,
    content: tuple[str, ...],
    crs: str | None,
    cell_m: float | None,
    spacing_m: float,
    most_rows: int,
    workers: int | None,
    scheduler: str | None,
    *,
    overwrite: bool,
) -> None:
    """Merge the results in RESULTS into the products of a season.

    For each date, surface, change and worked ground become mosaics: Cloud Optimized GeoTIFFs, tiles of one grid.
    Points and trajectories become GeoParquet, partitioned by date. A STAC catalogue lists all of it. RESULTS are the
    folder of a batch, or results of runs; surfaces moved by `furrowmap tie` are used where a tie is among them. Parts
    that have not changed are not made again.
    """
    settings = furrowmap.SeasonSettings(content, crs, cell_m, spacing_m, most_rows, workers, scheduler)
    with console.work(passing=True) as progress:
        made = furrowmap.season(results, output, settings, overwrite=overwrite, say=console.say, progress=progress)
    for notice in made.notices:
        console.warn(notice)
    rows = [
        ("sessions", str(made.sessions)),
        ("dates", str(len(made.dates))),
        ("tiles of mosaics", str(made.tiles)),
        ("points", f"{made.points:,}"),
        ("poses", f"{made.poses:,}"),
        ("written parts", str(made.written)),
        ("unchanged parts", str(made.unchanged)),
    ]
    console.answer(made, f"{printable(str(output))}:\n{table(rows)}")
