"""`furrowmap season`: mosaics, points and trajectories of many sessions, with a catalogue."""

from __future__ import annotations

from pathlib import Path

import furrowmap
from furrowmap.cli.console import Console
from furrowmap.cli.options import Paths, command, files, output, overwrite, settings_options
from furrowmap.cli.tables import table
from furrowmap.core.runtime.errors import printable
from furrowmap.settings import SeasonSettings


@command(
    "Merge the results of a season: mosaics, GeoParquet, STAC catalogue.",
    "furrowmap season results -o season2026",
    "furrowmap season results -o season2026 --content mosaics --cell 0.1",
)
@files("results", "RESULTS...")
@output("FOLDER", "Folder of the season.", required=True)
@settings_options(SeasonSettings)
@overwrite("Replace another catalogue in FOLDER.")
def season(console: Console, results: Paths, output: Path, settings: SeasonSettings, *, overwrite: bool) -> None:
    """Merge the results in RESULTS into the products of a season.

    For each date, surface, change and worked ground become mosaics: Cloud Optimized GeoTIFFs, tiles of one grid.
    Points and trajectories become GeoParquet, partitioned by date. A STAC catalogue lists all of it. RESULTS are the
    folder of a batch, or results of runs; surfaces moved by `furrowmap tie` are used where a tie is among them. Parts
    that have not changed are not made again.
    """
    with console.work(passing=True) as progress:
        made = furrowmap.season(results, output, settings, overwrite=overwrite, say=console.say, progress=progress)
    console.warn_all(made.notices)
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
