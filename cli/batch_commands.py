"""The commands on many sessions: `batch`, `season` and `tie`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import click

import furrowmap
from furrowmap.cli.command_options import (
    Paths,
    command,
    files,
    flag,
    output,
    overwrite,
    results_among,
    settings_options,
)
from furrowmap.cli.console import Console
from furrowmap.cli.result_tables import table, written
from furrowmap.core.runtime.errors import printable
from furrowmap.core.runtime.settings import language_of_user
from furrowmap.core.values.margins import with_margin
from furrowmap.settings import BatchSettings, SeasonSettings, TieSettings

if TYPE_CHECKING:
    from furrowmap import Batch

_MAX_NAMES: Final = 20


@command(
    "Run all sessions in some folders.",
    "furrowmap batch season2026 -o results",
    "furrowmap batch card1 card2 -o results --machine 'Tractor 1, tiller' --boundaries fields.gpkg",
)
@click.argument("folders", metavar="FOLDER...", nargs=-1, required=True)
@click.option("-o", "--output", metavar="RESULTS", required=True, help="Folder of the results, or its URL.")
@settings_options(BatchSettings)
@overwrite("Replace products of other recordings in result folders.")
@flag("--dry-run", "Show what would run and how long it would take; write nothing.")
def batch(
    console: Console, folders: tuple[str, ...], output: str, settings: BatchSettings, *, overwrite: bool, dry_run: bool
) -> None:
    """Run every session in each FOLDER and its subfolders, and list the results.

    Sessions are files named session.toml. Each gets a folder in RESULTS; batch.csv, batch.gpkg and batch.html list
    them. A session runs again only if its recordings, its settings or the version of furrowmap have changed. If one
    fails, the others run nevertheless. Call an interrupted batch again to continue it.
    """
    with console.work() as progress:
        found = furrowmap.batch(
            folders, output, settings, dry_run=dry_run, overwrite=overwrite, say=console.say, progress=progress
        )
    console.warn_all(found.notices)
    failures = [(row.name, row.outcome.failure) for row in found.sessions if row.outcome.failure is not None]
    answer = {
        "results": found.results,
        "run": found.run,
        "unchanged": found.unchanged,
        "warnings": {row.name: row.outcome.figures.get("warnings", 0) for row in found.sessions},
        "damaged": [{"name": name, "warnings": notices} for name, notices in found.damaged.items()],
        "failed": [{"name": name, "code": failure.code, "lines": failure.lines} for name, failure in failures],
        "estimate_s": found.estimate_s,
    }
    console.answer(answer, _planned(found) if dry_run else _done(found))
    if failures and not dry_run:
        click.get_current_context().exit(1)


def _planned(found: Batch) -> str:
    rows = [
        ("sessions to run", str(len(found.run))),
        ("unchanged", str(len(found.unchanged))),
        ("expected duration", _duration(found.estimate_s or 0.0)),
    ]
    return "\n".join([table(rows), *_names(found.run), *_failures(found)])


def _done(found: Batch) -> str:
    failed = [row for row in found.sessions if row.outcome.failure is not None]
    rows = [
        ("run", str(len(found.run))),
        ("unchanged", str(len(found.unchanged))),
        ("failed", str(len(failed))),
        ("with warnings", str(sum(bool(row.outcome.figures.get("warnings")) for row in found.sessions))),
        ("damaged inputs", str(len(found.damaged))),
    ]
    return "\n".join([f"{printable(str(found.results))}:", table(rows), *_damages(found.damaged), *_failures(found)])


def _damages(damaged: dict[str, list[dict[str, Any]]]) -> list[str]:
    """Names of the sessions whose inputs are damaged, and the warnings that say so."""
    key = f"text_{language_of_user()}"
    lines = []
    for name, notices in list(damaged.items())[:_MAX_NAMES]:
        told = [str(notice.get(key, notice["text"])) for notice in notices]
        lines += [f"{printable(name)}:", *(f"  {printable(line)}" for line in told)]
    return [*lines, f"  … {len(damaged) - _MAX_NAMES} more"] if len(damaged) > _MAX_NAMES else lines


def _failures(found: Batch) -> list[str]:
    """Names and errors of the sessions without a result."""
    lines = []
    for row in found.sessions:
        if row.outcome.failure is not None:
            told = row.outcome.failure.lines_in(language_of_user())
            lines += [f"{printable(row.name)}:", *(f"  {line}" for line in told)]
    return lines


def _names(names: tuple[str, ...]) -> list[str]:
    shown = [f"  {printable(name)}" for name in names[:_MAX_NAMES]]
    return [*shown, f"  … {len(names) - _MAX_NAMES} more"] if len(names) > _MAX_NAMES else shown


def _duration(length_s: float) -> str:
    minutes = round(length_s / 60)
    return f"{length_s:.0f} s" if length_s < 120 else f"{minutes // 60} h {minutes % 60:02d} min"


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

    For each date, surface, change and worked ground become mosaics: Cloud Optimized GeoTIFFs, tiles of one grid. Points
    and trajectories become GeoParquet, partitioned by date. A STAC catalogue lists all products. RESULTS are folders of
    batches and runs. If folders of `furrowmap tie` are among them, their moved surfaces are used. Unchanged parts are
    not computed again.
    """
    with console.work(passing=True) as progress:
        made = furrowmap.season(
            results_among(console, results), output, settings, overwrite=overwrite, say=console.say, progress=progress
        )
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


@command(
    "Align the dates of one field and measure the change between them.",
    "furrowmap tie june11 june18 june25 -o season --reference survey.tif",
)
@files("results", "RESULT...")
@output("DIR", "Output folder.", "Output folder", required=True)
@settings_options(TieSettings)
@overwrite("Replace existing products in DIR.")
def tie(console: Console, results: Paths, output: Path, settings: TieSettings, *, overwrite: bool) -> None:
    """Align RESULTs (folders of `furrowmap run`) of one field with each other on the ground that no tool touched.

    Each surface is moved in place, height, tilt and heading, with standard deviations. Writes the moved surfaces
    (dsm_NN.tif), the change from each date to the next (change_NN_NN.tif), tie.gpkg, tie.html and tie.json.
    """
    with console.work() as progress:
        account = furrowmap.tie(
            results_among(console, results), output, settings, overwrite=overwrite, progress=progress, warn=console.warn
        )
    console.answer({"folder": output, **account}, _tie_words(account, output))


def _tie_words(account: dict[str, Any], folder: Path) -> str:
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
