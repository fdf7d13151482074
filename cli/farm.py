"""`furrowmap farm`: the farm map, the sessions of a farm in one GeoPackage or in PostGIS."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import click

import furrowmap
from furrowmap.cli.console import Console
from furrowmap.cli.groups import CommandGroup
from furrowmap.cli.options import FILE, common_options
from furrowmap.cli.tables import table
from furrowmap.core.runtime.errors import UsageError, printable

if TYPE_CHECKING:
    from zoneinfo import ZoneInfo

    from furrowmap import FarmMapChange, FarmMemory, KnownSession

_DB_SCHEMA: Final = "furrowmap"


@click.group(
    cls=CommandGroup,
    short_help="Collect the sessions of a farm in a farm map.",
    subcommand_metavar="COMMAND ...",
    no_args_is_help=False,
    epilog="\b\nExample:\n  furrowmap farm add result farm.gpkg\n  furrowmap farm list farm.gpkg",
)
def farm() -> None:
    """The farm map: the sessions of a farm in one GeoPackage, or in PostGIS to share them."""


_schema = click.option(
    "--schema", default=_DB_SCHEMA, show_default=True, metavar="NAME", help="PostGIS schema of the tables."
)


@farm.command(
    short_help="Add the results of runs to a farm map.",
    epilog="\b\nExample:\n  furrowmap farm add results/* farm.gpkg\n"
    "  furrowmap farm add result postgresql://me@server/farm",
)
@click.argument("folders", metavar="DIR...", nargs=-1, required=True, type=FILE)
@click.argument("target", metavar="MAP")
@click.option("--crs", metavar="CRS", help="CRS of a new farm map, such as EPSG:6677 [default: the first session's].")
@click.option("--same-crs", is_flag=True, help="Refuse sessions in another CRS instead of transforming them.")
@click.option(
    "--time-zone",
    "zone",
    metavar="ZONE",
    help="Time zone of dates and map tips, such as Asia/Tokyo [default: that of the run].",
)
@click.option(
    "--season-start",
    metavar="MM-DD",
    help="First day of a season, such as 04-01; kept in MAP [default: 01-01].",
)
@_schema
@common_options
def add(console: Console, folders: tuple[Path, ...], target: str, **options: Any) -> None:
    """Add the results of `furrowmap run` in each DIR to MAP, a GeoPackage or a PostGIS database.

    A DIR may also be a GeoPackage that `furrowmap fields` wrote: each task in it becomes a session. MAP is created if
    it does not exist. A session that it already holds is replaced. Either all DIRs are added or none; an interruption
    leaves MAP unchanged.
    """
    options["zone"] = _zone(options["zone"])
    with console.work(passing=True) as progress:
        change = furrowmap.add_to_farm_map(target, folders, **options, progress=progress)
    for notice in change.notices:
        console.warn(notice)
    console.answer(change, _words(change))


@farm.command(
    "list",
    short_help="List the sessions in a farm map.",
    epilog="\b\nExample:\n  furrowmap farm list farm.gpkg",
)
@click.argument("target", metavar="MAP")
@_schema
@common_options
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


@farm.command(
    short_help="Remove sessions from a farm map.",
    epilog="\b\nExample:\n  furrowmap farm remove farm.gpkg c67f3212",
)
@click.argument("target", metavar="MAP")
@click.argument("sessions", metavar="SESSION...", nargs=-1, required=True)
@_schema
@common_options
def remove(console: Console, target: str, sessions: tuple[str, ...], *, schema: str) -> None:
    """Remove each SESSION, given by its identifier (or the beginning of it) or its name, from MAP.

    The result folders are not touched.
    """
    with console.work(passing=True) as progress:
        change = furrowmap.remove_from_farm_map(target, sessions, schema=schema, progress=progress)
    console.answer(change, _words(change))


@farm.command(
    short_help="Merge the surfaces of sessions into one raster.",
    epilog="\b\nExample:\n  furrowmap farm mosaic farm.gpkg -o farm.vrt\n"
    "  furrowmap farm mosaic farm.gpkg --product dsm_before -o before.tif --dst-crs EPSG:6691",
)
@click.argument("sources", metavar="MAP...", nargs=-1, required=True)
@click.option("-o", "--output", type=FILE, metavar="FILE", required=True, help="Output raster: .vrt or .tif.")
@click.option("--product", default="dsm", show_default=True, metavar="NAME", help="Surface to merge (NAME.tif).")
@click.option("--dst-crs", "crs", metavar="CRS", help="CRS of the raster [default: that of the surfaces].")
@click.option("--cell", "cell_m", type=click.FloatRange(min=0, min_open=True), metavar="METRES", help="Cell size.")
@click.option("--mean", is_flag=True, help="Average overlapping sessions instead of using the latest.")
@click.option("--overwrite", is_flag=True, help="Replace an existing FILE.")
@_schema
@common_options
def mosaic(console: Console, sources: tuple[str, ...], output: Path, **options: Any) -> None:
    """Merge the surfaces of the sessions in each MAP, or of the result in a folder, into one raster.

    Where sessions overlap, the latest is used. A .vrt is a small file that refers to the heights in the surfaces'
    files; a .tif is a Cloud Optimized GeoTIFF with all bands.
    """
    settings = furrowmap.MosaicSettings(options.pop("crs"), options.pop("cell_m"), options.pop("mean"))
    with console.work(passing=True) as progress:
        made = furrowmap.mosaic(sources, output, settings, **options, progress=progress)
    for notice in made.notices:
        console.warn(notice)
    size = f"{made.columns:,} × {made.rows:,} cells of {made.cell_m:g} m"
    console.answer(made, f"{printable(str(output))}: {made.surfaces} surfaces, {size}, {made.crs}.")


@farm.command(
    short_help="List the fields and machines of a farm map, with the work of each season.",
    epilog="\b\nExample:\n  furrowmap farm fields farm.gpkg",
)
@click.argument("target", metavar="MAP")
@_schema
@common_options
def fields(console: Console, target: str, *, schema: str) -> None:
    """List the work of each field and season in MAP, and that of each machine.

    A field is the boundary that sessions state, or the ground that they worked.
    """
    with console.work(passing=True) as progress:
        memory = furrowmap.farm_memory(target, schema=schema, progress=progress)
    console.answer(memory, _tables(memory) if memory.seasons or memory.machines else "No sessions.")


@farm.command(
    short_help="Write the history of a field as a page or a table.",
    epilog="\b\nExample:\n  furrowmap farm history farm.gpkg 'North field' -o north.html\n"
    "  furrowmap farm history farm.gpkg 7f580967 -o north.csv",
)
@click.argument("target", metavar="MAP")
@click.argument("field", metavar="FIELD")
@click.option("-o", "--output", "out", type=FILE, metavar="FILE", help="Output: .html for a page, .csv for a table.")
@click.option("--overwrite", is_flag=True, help="Replace an existing FILE.")
@_schema
@common_options
def history(console: Console, target: str, field: str, **options: Any) -> None:
    """Show all sessions of a FIELD in MAP, given by its name or identifier, the last one first."""
    with console.work(passing=True) as progress:
        found = furrowmap.field_history(target, field, **options, progress=progress)
    rows = (
        (row["date"], f"{_area(row['worked_area_m2'])}  {printable(row['machine'])}  {printable(row['name'])}")
        for row in found.visits
    )
    console.answer(found, printable(str(found.path)) if found.path else table(rows))


@farm.command(
    short_help="Write how often each spot was worked and driven on.",
    epilog="\b\nExample:\n  furrowmap farm traffic farm.gpkg -o traffic.tif --season 2026\n"
    "  furrowmap farm traffic farm.gpkg -o traffic.tif --track-width 1.5 --tyre-width 0.42",
)
@click.argument("target", metavar="MAP")
@click.option("-o", "--output", type=FILE, metavar="FILE", required=True, help="Output raster (.tif).")
@click.option("--season", type=int, metavar="YEAR", help="Only the season that begins in this year.")
@click.option("--since", type=click.DateTime(["%Y-%m-%d"]), metavar="DAY", help="Only sessions from this day on.")
@click.option("--until", type=click.DateTime(["%Y-%m-%d"]), metavar="DAY", help="Only sessions up to this day.")
@click.option(
    "--cell", "cell_m", type=click.FloatRange(min=0, min_open=True), default=0.1, show_default=True, metavar="METRES",
    help="Cell size.",
)  # fmt: skip
@click.option(
    "--track-width", type=click.FloatRange(min=0, min_open=True), metavar="METRES",
    help="Distance between the middles of the rear tyres; needed to count wheels.",
)  # fmt: skip
@click.option(
    "--tyre-width", type=click.FloatRange(min=0, min_open=True), metavar="METRES", help="Width of a rear tyre."
)
@click.option("--overwrite", is_flag=True, help="Replace an existing FILE.")
@_schema
@common_options
def traffic(console: Console, target: str, output: Path, **options: Any) -> None:
    """Write how often each spot of MAP was worked, when last, and how often rear wheels passed it.

    The raster is a Cloud Optimized GeoTIFF of whole numbers. Wheels are counted where both --track-width and
    --tyre-width are given.
    """
    widths = [options.pop("track_width"), options.pop("tyre_width")]
    if (widths[0] is None) != (widths[1] is None):
        raise UsageError("usage.traffic")
    since, until = (day and day.date() for day in (options.pop("since"), options.pop("until")))
    settings = furrowmap.TrafficSettings(
        options.pop("season"),
        since,
        until,
        options.pop("cell_m"),
        furrowmap.Wheels(*widths) if widths[0] is not None else None,
    )
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
        raise UsageError("usage.zone", name=name) from None
