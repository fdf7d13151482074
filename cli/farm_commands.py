"""`furrowmap farm`: the farm map, the sessions of a farm in one GeoPackage or in PostGIS."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

import furrowmap
from furrowmap.cli.command_options import (
    Paths,
    command,
    files,
    flag,
    group,
    option,
    output,
    overwrite,
    results_among,
    settings_options,
)
from furrowmap.cli.console import Console
from furrowmap.cli.result_tables import table
from furrowmap.core.runtime.errors import OptionError, UsageError, printable
from furrowmap.core.runtime.languages.texts import Text
from furrowmap.settings import MosaicSettings, TrafficSettings

if TYPE_CHECKING:
    from zoneinfo import ZoneInfo

    from furrowmap import FarmMapChange, FarmMemory, KnownSession


@group(
    "Collect the sessions of a farm in a farm map.",
    "furrowmap farm add result farm.gpkg",
    "furrowmap farm list farm.gpkg",
)
def farm() -> None:
    """The farm map: the sessions of a farm in one GeoPackage, or in PostGIS to share them."""


_schema = option("--schema", "NAME", "PostGIS schema of the tables.", default="furrowmap", label="PostGIS schema")


@command(
    "Add the results of runs to a farm map.",
    "furrowmap farm add results/* farm.gpkg",
    "furrowmap farm add result postgresql://me@server/farm",
    group=farm,
)
@files("folders", "DIR...")
@click.argument("target", metavar="MAP")
@option(
    "--crs",
    "CRS",
    "CRS of a new farm map, such as EPSG:6677 [default: the first session's].",
    label="CRS of a new farm map",
)
@flag(
    "--same-crs", "Refuse sessions in another CRS instead of transforming them.", label="Refuse sessions in another CRS"
)
@option(
    "--time-zone", "ZONE", "Time zone of dates and map tips, such as Asia/Tokyo [default: that of the run].", "zone"
)
@option(
    "--season-start",
    "MM-DD",
    "First day of a season, such as 04-01; kept in MAP [default: 01-01].",
    label="First day of a season (MM-DD)",
)
@_schema
def add(console: Console, folders: Paths, target: str, **options: Any) -> None:
    """Add the results of `furrowmap run` in each DIR to MAP, a GeoPackage or a PostGIS database.

    A DIR may also be a GeoPackage that `furrowmap fields` wrote: each task in it becomes a session. MAP is created if
    it does not exist. Results replace those of the same session. Either all DIRs are added or none; an interruption
    leaves MAP unchanged.
    """
    options["zone"] = _zone(options["zone"])
    with console.work(passing=True) as progress:
        change = furrowmap.add_to_farm_map(target, results_among(console, folders), **options, progress=progress)
    console.warn_all(change.notices)
    console.answer(change, _words(change))


@command("List the sessions in a farm map.", "furrowmap farm list farm.gpkg", name="list", group=farm)
@click.argument("target", metavar="MAP")
@_schema
def list_sessions(console: Console, target: str, *, schema: str) -> None:
    """List the sessions in MAP: identifier, date, worked area, name."""

    def row(session: KnownSession) -> tuple[str, str]:
        area_m2 = session.worked_area_m2
        area = "        unknown" if area_m2 is None else f"{area_m2:12,.0f} m²"
        return session.session, f"{session.date}  {area}  {printable(session.name)}"

    with console.work(passing=True) as progress:
        name, crs, sessions = furrowmap.farm_map_sessions(target, schema=schema, progress=progress)
    answer = {"farm_map": name, "crs": crs and crs.to_string(), "sessions": [session.plain() for session in sessions]}
    console.answer(answer, table(row(session) for session in sessions) if sessions else "No sessions.")


@command("Remove sessions from a farm map.", "furrowmap farm remove farm.gpkg c67f3212", group=farm)
@click.argument("target", metavar="MAP")
@click.argument("sessions", metavar="SESSION...", nargs=-1, required=True)
@_schema
def remove(console: Console, target: str, sessions: tuple[str, ...], *, schema: str) -> None:
    """Remove each SESSION, given by its identifier (or the beginning of it) or its name, from MAP.

    The result folders are not touched.
    """
    with console.work(passing=True) as progress:
        change = furrowmap.remove_from_farm_map(target, sessions, schema=schema, progress=progress)
    console.answer(change, _words(change))


@command(
    "Merge the surfaces of sessions into one raster.",
    "furrowmap farm mosaic farm.gpkg -o farm.vrt",
    "furrowmap farm mosaic farm.gpkg --product dsm_before -o before.tif --dst-crs EPSG:6691",
    group=farm,
)
@click.argument("sources", metavar="MAP...", nargs=-1, required=True)
@output("FILE", "Output raster: .vrt or .tif.", "Mosaic", required=True)
@option("--product", "NAME", "Surface to merge (NAME.tif).", default="dsm", label="Surface")
@settings_options(MosaicSettings)
@overwrite("Replace an existing FILE.")
@_schema
def mosaic(console: Console, sources: tuple[str, ...], output: Path, settings: MosaicSettings, **options: Any) -> None:
    """Merge the surfaces of the sessions in each MAP, or of the result in a folder, into one raster.

    Where sessions overlap, the latest is used. A .vrt is a small file that refers to the heights in the surfaces'
    files; a .tif is a Cloud Optimized GeoTIFF with all bands.
    """
    with console.work(passing=True) as progress:
        made = furrowmap.mosaic(sources, output, settings, **options, progress=progress)
    console.warn_all(made.notices)
    size = f"{made.columns:,} × {made.rows:,} cells of {made.cell_m:g} m"
    console.answer(made, f"{printable(str(output))}: {made.surfaces} surfaces, {size}, {made.crs}.")


@command(
    "List the fields and machines of a farm map, with the work of each season.",
    "furrowmap farm fields farm.gpkg",
    group=farm,
)
@click.argument("target", metavar="MAP")
@_schema
def fields(console: Console, target: str, *, schema: str) -> None:
    """List the work of each field and season in MAP, and that of each machine.

    A field is the boundary that sessions state, or the ground that they worked.
    """
    with console.work(passing=True) as progress:
        memory = furrowmap.farm_memory(target, schema=schema, progress=progress)
    console.answer(memory, _tables(memory) if memory.seasons or memory.machines else "No sessions.")


@command(
    "Write the history of a field as a page or a table.",
    "furrowmap farm history farm.gpkg 'North field' -o north.html",
    "furrowmap farm history farm.gpkg 7f580967 -o north.csv",
    group=farm,
)
@click.argument("target", metavar="MAP")
@click.argument("field", metavar="FIELD")
@output("FILE", "Output: .html for a page, .csv for a table.", "Page or table")
@overwrite("Replace an existing FILE.")
@_schema
def history(console: Console, target: str, field: str, output: Path | None, **options: Any) -> None:
    """Show all sessions of a FIELD in MAP, given by its name or identifier, newest first."""
    with console.work(passing=True) as progress:
        found = furrowmap.field_history(target, field, out=output, **options, progress=progress)
    rows = (
        (row["date"], f"{_area(row['worked_area_m2'])}  {printable(row['machine'])}  {printable(row['name'])}")
        for row in found.visits
    )
    console.answer(found, printable(str(found.path)) if found.path else table(rows))


@command(
    "Write how often each spot was worked and driven on.",
    "furrowmap farm traffic farm.gpkg -o traffic.tif --season 2026",
    "furrowmap farm traffic farm.gpkg -o traffic.tif --track-width 1.5 --tyre-width 0.42",
    group=farm,
)
@click.argument("target", metavar="MAP")
@output("FILE", "Output raster (.tif).", "Traffic", required=True)
@settings_options(TrafficSettings)
@option(
    "--track-width", "METRES", "Distance between the centres of the rear tyres; needed to count wheel passes.", above=0
)
@option("--tyre-width", "METRES", "Width of a rear tyre.", above=0)
@overwrite("Replace an existing FILE.")
@_schema
def traffic(
    console: Console,
    target: str,
    output: Path,
    settings: TrafficSettings,
    *,
    track_width: float | None,
    tyre_width: float | None,
    **options: Any,
) -> None:
    """Write how often each spot of MAP was worked, when last, and how often rear wheels passed it.

    The raster is a Cloud Optimized GeoTIFF of whole numbers. To count wheel passes, state --track-width and
    --tyre-width.
    """
    if (track_width is None) != (tyre_width is None):
        raise UsageError("usage.track-and-tyre")
    if track_width is not None and tyre_width is not None:
        settings = replace(settings, wheels=furrowmap.Wheels(track_width, tyre_width))
    with console.work(passing=True) as progress:
        made = furrowmap.farm_traffic(target, output, settings, **options, progress=progress)
    size = f"{made.columns:,} × {made.rows:,} cells of {made.cell_m:g} m"
    console.answer(made, f"{printable(str(output))}: {made.sessions} sessions, {made.passes} passes, {size}.")


def _tables(memory: FarmMemory) -> str:
    """The seasons and the machines as text."""
    seasons = [
        (
            f"{row['season']}  {printable(row['name'])}",
            f"{row['times_worked']} ×  {_area(row['worked_area_m2'])}  {_known(row['hours'], '{:.1f} h')}  "
            f"{_known(row['work_rate_ha_h'], '{:.2f} ha/h')}",
        )
        for row in memory.seasons
    ]
    machines = [
        (printable(row["machine"]), f"{row['sessions']} sessions  {_area(row['worked_area_m2'])}")
        for row in memory.machines
    ]
    return "\n\n".join(table(rows) for rows in (seasons, machines) if rows)


def _area(area_m2: float | None) -> str:
    return _known(area_m2, "{:,.0f} m²").rjust(15)


def _known(value: float | None, form: str) -> str:
    return "unknown" if value is None else form.format(value)


def _words(change: FarmMapChange) -> str:
    counts = [(len(getattr(change, verb)), verb) for verb in ("added", "replaced", "unchanged", "removed")]
    done = ", ".join(f"{count} {verb}" for count, verb in counts if count)
    number = "1 session" if change.sessions == 1 else f"{change.sessions} sessions"
    return f"{printable(change.farm_map)}: {done or 'nothing changed'}; now {number} in {change.crs}."


def _zone(name: str | None) -> ZoneInfo | None:
    from zoneinfo import ZoneInfo

    if name is None:
        return None
    try:
        return ZoneInfo(name)
    except (KeyError, ValueError, OSError):
        wanted = Text("a time zone of the IANA database")
        raise OptionError("--time-zone", name, wanted, "Asia/Tokyo") from None
