"""`furrowmap base`: a farm's sessions together, in one GeoPackage or in PostGIS."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import click

from furrowmap.cli.console import Console
from furrowmap.cli.deeds import Deeds
from furrowmap.cli.options import FILE, common_options
from furrowmap.cli.words import table
from furrowmap.core.values.errors import UsageError, printable

if TYPE_CHECKING:
    from zoneinfo import ZoneInfo

    from pyproj import CRS

    from furrowmap.exporters.farm.farm_map import Change

_DB_SCHEMA: Final = "furrowmap"


@click.group(
    cls=Deeds,
    short_help="Gather sessions into a farm's base map.",
    subcommand_metavar="COMMAND ...",
    no_args_is_help=False,
    epilog="\b\nExample:\n  furrowmap base add result farm.gpkg\n  furrowmap base list farm.gpkg",
)
def base() -> None:
    """A farm's base map: the sessions of many runs in one GeoPackage, or in PostGIS where several people share them."""


_schema = click.option(
    "--schema", default=_DB_SCHEMA, show_default=True, metavar="NAME", help="Schema of the tables, in PostGIS."
)


@base.command(
    short_help="Put the results of runs into a base.",
    epilog="\b\nExample:\n  furrowmap base add results/* farm.gpkg\n"
    "  furrowmap base add result postgresql://me@server/farm",
)
@click.argument("folders", metavar="DIR...", nargs=-1, required=True, type=FILE)
@click.argument("target", metavar="BASE")
@click.option("--crs", metavar="CRS", help="CRS of a new base, such as EPSG:6677 [default: the first session's].")
@click.option("--same-crs", is_flag=True, help="Refuse sessions of another CRS instead of transforming them.")
@click.option(
    "--time-zone", "zone", metavar="ZONE", help="Tells the days, such as Asia/Tokyo [default: by the longitude]."
)
@_schema
@common_options
def add(
    console: Console,
    folders: tuple[Path, ...],
    target: str,
    *,
    crs: str | None,
    same_crs: bool,
    zone: str | None,
    schema: str,
) -> None:
    """Put the results that `furrowmap run` wrote into each DIR into BASE, a GeoPackage or a PostGIS database.

    BASE is made where it is not there. A session that it has already is replaced by its new result. Either all of
    DIR... get into it or none; an interruption leaves it as it was.
    """
    from furrowmap.exporters.farm.farm_map import add_results

    options: dict[str, Any] = {"crs": _crs(crs), "same_crs": same_crs, "zone": _zone(zone), "schema": schema}
    with console.work(passing=True) as progress:
        change = add_results(target, folders, **options, progress=progress)
    for notice in change.notices:
        console.warn(notice)
    console.answer(change, _words(change))


@base.command(
    "list",
    short_help="Tell the sessions in a base.",
    epilog="\b\nExample:\n  furrowmap base list farm.gpkg",
)
@click.argument("target", metavar="BASE")
@_schema
@common_options
def list_sessions(console: Console, target: str, *, schema: str) -> None:
    """Tell which sessions are in BASE: identity, day, ground worked, name."""
    from furrowmap.exporters.farm.edit import KnownSession
    from furrowmap.exporters.farm.farm_map import known_sessions

    def row(session: KnownSession) -> tuple[str, str]:
        area_m2 = session.worked_area_m2
        area = "        unknown" if area_m2 is None else f"{area_m2:12,.0f} m²"
        return session.session, f"{session.date}  {area}  {printable(session.name)}"

    with console.work(passing=True) as progress:
        shown, crs, sessions = known_sessions(target, schema=schema, progress=progress)
    answer = {"base": shown, "crs": crs and crs.to_string(), "sessions": [session.told() for session in sessions]}
    console.answer(answer, table(row(session) for session in sessions) if sessions else "No sessions.")


@base.command(
    short_help="Take sessions out of a base.",
    epilog="\b\nExample:\n  furrowmap base remove farm.gpkg c67f3212",
)
@click.argument("target", metavar="BASE")
@click.argument("sessions", metavar="SESSION...", nargs=-1, required=True)
@_schema
@common_options
def remove(console: Console, target: str, sessions: tuple[str, ...], *, schema: str) -> None:
    """Take each SESSION, told by its identity (or how that begins) or its name, out of BASE.

    The folders of their results stay as they are.
    """
    from furrowmap.exporters.farm.farm_map import remove_sessions

    with console.work(passing=True) as progress:
        change = remove_sessions(target, sessions, schema=schema, progress=progress)
    console.answer(change, _words(change))


@base.command(
    short_help="Put the surfaces of sessions into one raster.",
    epilog="\b\nExample:\n  furrowmap base mosaic farm.gpkg -o farm.vrt\n"
    "  furrowmap base mosaic farm.gpkg --product dsm_before -o before.tif --dst-crs EPSG:6691",
)
@click.argument("sources", metavar="BASE...", nargs=-1, required=True)
@click.option("-o", "--output", type=FILE, metavar="FILE", required=True, help="Raster to make: .vrt or .tif.")
@click.option("--product", default="dsm", show_default=True, metavar="NAME", help="Which surface: NAME.tif of each.")
@click.option("--dst-crs", "crs", metavar="CRS", help="CRS of the raster [default: that of the surfaces].")
@click.option("--cell", "cell_m", type=click.FloatRange(min=0, min_open=True), metavar="METRES", help="Side of a cell.")
@click.option("--mean", is_flag=True, help="The mean of all sessions instead of the latest session's cells.")
@click.option("--overwrite", is_flag=True, help="Replace FILE.")
@_schema
@common_options
def mosaic(
    console: Console,
    sources: tuple[str, ...],
    output: Path,
    *,
    product: str,
    crs: str | None,
    cell_m: float | None,
    mean: bool,
    overwrite: bool,
    schema: str,
) -> None:
    """Put the surfaces of the sessions in each BASE, or of the result in a folder, into one raster.

    The latest session wins where they overlap. A .vrt is a small file that refers to the surfaces' heights where they
    lie; a .tif is a cloud-optimised GeoTIFF with all their bands.
    """
    from furrowmap.exporters.farm.mosaic import mosaic as put_together
    from furrowmap.exporters.farm.surfaces import find_surfaces, refuse_output

    refuse_output(output, overwrite=overwrite)
    with console.work(passing=True) as progress:
        paths, missing = find_surfaces(sources, product, schema=schema, progress=progress)
        made = put_together(paths, output, crs=_crs(crs, "--dst-crs"), cell_m=cell_m, mean=mean, progress=progress)
    for notice in (*missing, *made.notices):
        console.warn(notice)
    size = f"{made.columns:,} × {made.rows:,} cells of {made.cell_m:g} m"
    console.answer(made, f"{printable(str(output))}: {made.surfaces} surfaces, {size}, {made.crs}.")


def _words(change: Change) -> str:
    deeds = ("added", "replaced", "unchanged", "removed")
    done = [f"{len(getattr(change, deed))} {deed}" for deed in deeds if getattr(change, deed)]
    number = "1 session" if change.sessions == 1 else f"{change.sessions} sessions"
    return f"{printable(change.base)}: {', '.join(done) or 'nothing to do'}; now {number} in {change.crs}."


def _crs(text: str | None, option: str = "--crs") -> CRS | None:
    from pyproj import CRS
    from pyproj.exceptions import CRSError

    if text is None:
        return None
    try:
        crs = CRS.from_user_input(text)
    except CRSError:
        crs = None
    if crs is None or not (crs.is_projected or crs.is_geographic):
        raise UsageError(
            f"{option}: {text!r} is no horizontal CRS that PROJ knows.",
            "Nothing was done.",
            "Give it as EPSG:6677, for example.",
            code="usage",
        )
    return crs


def _zone(name: str | None) -> ZoneInfo | None:
    from zoneinfo import ZoneInfo

    if name is None:
        return None
    try:
        return ZoneInfo(name)
    except (KeyError, ValueError, OSError):
        raise UsageError(
            f"--time-zone: there is no time zone {name!r}.",
            "Nothing was done.",
            "Give it as Asia/Tokyo, for example, or leave it out.",
            code="usage",
        ) from None
