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
from furrowmap.core.values.errors import UsageError, printable

if TYPE_CHECKING:
    from zoneinfo import ZoneInfo

    from furrowmap import FarmMapChange, KnownSession

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
@_schema
@common_options
def add(console: Console, folders: tuple[Path, ...], target: str, **options: Any) -> None:
    """Add the results of `furrowmap run` in each DIR to MAP, a GeoPackage or a PostGIS database.

    MAP is created if it does not exist. A session that it already holds is replaced. Either all DIRs are added or none;
    an interruption leaves MAP unchanged.
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
        raise UsageError(
            f"--time-zone: unknown time zone {name!r}.",
            "Nothing was done.",
            "Give a name of the IANA database such as Asia/Tokyo, or omit the option.",
            code="usage",
        ) from None
