"""A farm map: the sessions of many runs in one GeoPackage or PostGIS database."""

from __future__ import annotations

import datetime as dt
from collections.abc import Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass, replace
from itertools import groupby
from pathlib import Path
from typing import TYPE_CHECKING, Final, TypeAlias
from zoneinfo import ZoneInfo

import numpy as np
from pyproj import CRS

from furrowmap.core.geodesy.crs_change import horizontal_part, optional_crs
from furrowmap.core.geodesy.measurable_crs import expect_map
from furrowmap.core.runtime.errors import InputError, MissingExtraError, Notice, OptionError, RefusedError
from furrowmap.core.runtime.languages.texts import Text
from furrowmap.core.runtime.progress import Progress, silent
from furrowmap.core.runtime.settings import language_of_user
from furrowmap.core.values.crs import name_of
from furrowmap.exporters.farm.edit import KnownSession
from furrowmap.exporters.farm.farm_geopackage import GeopackageEdit, geopackage_edit
from furrowmap.exporters.farm.farm_memory_tables import (
    GROUND_COLUMNS,
    PASS_COLUMNS,
    SESSION_COLUMNS,
    Sessions,
    memory_layers,
)
from furrowmap.exporters.farm.farm_results import (
    PROVENANCE,
    SESSIONS,
    SessionResult,
    drawing_order,
    read_result,
    read_tasks,
)
from furrowmap.exporters.farm.ground_files import report_of, write_ground_files
from furrowmap.exporters.farm.project import (
    CLOUDS,
    POINT_CLOUD_WORDS,
    RASTER,
    SURFACE,
    background_layer,
    layer_title,
    project_archive,
    styles,
)
from furrowmap.exporters.files.qgis_project import ProjectLayer
from furrowmap.exporters.files.result_folder import packaged_style
from furrowmap.exporters.vectors.field_layers import concatenate_layers
from furrowmap.workflows.farm.folders import foreign_notices, named_folders

if TYPE_CHECKING:
    from furrowmap.exporters.farm.postgis import PostgisEdit

FarmEdit: TypeAlias = "GeopackageEdit | PostgisEdit"
"""A change of a farm map, wherever it is stored."""
DATABASES: Final = ("postgresql://", "postgres://", "postgresql:", "service=", "host=", "dbname=")
"""A farm map whose name starts with one of these is in PostGIS, any other one is a GeoPackage."""
DB_SCHEMA: Final = "furrowmap"
SEASON_START: Final = "season start"
"""Setting of the farm map: month and day on which a season begins."""
FIRST_DAY: Final = "01-01"


@dataclass(frozen=True)
class FarmMapChange:
    """What a command changed in a farm map.

    Attributes:
        farm_map: its path or address, without a password.
        crs: of its layers.
        added: identities of the new sessions.
        replaced: of the sessions with a new result.
        unchanged: of the sessions whose result was there already.
        removed: of the sessions taken out.
        sessions: number of sessions after the change.
    """

    farm_map: str
    crs: str | None
    added: tuple[str, ...] = ()
    replaced: tuple[str, ...] = ()
    unchanged: tuple[str, ...] = ()
    removed: tuple[str, ...] = ()
    sessions: int = 0
    notices: tuple[Notice, ...] = ()


def open_edit(
    farm_map: str | Path, *, create: bool = False, schema: str = DB_SCHEMA, progress: Progress = silent
) -> AbstractContextManager[FarmEdit]:
    """Open a farm map (a GeoPackage, or a PostgreSQL connection string) for a change as a whole or not at all."""
    if str(farm_map).startswith(DATABASES):
        try:
            from furrowmap.exporters.farm.postgis import postgis_edit
        except ImportError as error:
            raise MissingExtraError(
                "psycopg",
                "postgis",
                Text("A farm map in PostGIS needs it."),
                otherwise=Text("name a GeoPackage"),
                error=error,
            ) from None
        return postgis_edit(str(farm_map), create=create, schema=schema)
    return geopackage_edit(Path(farm_map), create=create, progress=progress)


def add_to_farm_map(
    farm_map: str | Path,
    folders: Sequence[str | Path],
    *,
    crs: CRS | str | None = None,
    same_crs: bool = False,
    zone: ZoneInfo | None = None,
    season_start: str | None = None,
    schema: str = DB_SCHEMA,
    progress: Progress = silent,
) -> FarmMapChange:
    """Add the results of runs to a farm map: all of them, or none where one of them fails.

    A session that is there already (same name and recordings) is replaced by its new result, or left unchanged where
    the result is the same.

    Args:
        farm_map: path of a GeoPackage, or a PostgreSQL connection string; created where it is missing.
        folders: that `furrowmap run` wrote, and GeoPackages that `furrowmap fields` wrote.
        crs: of a new farm map; None for that of the first session.
        same_crs: refuse sessions of another CRS instead of transforming them.
        zone: time zone of the dates and times; None for that of each run.
        season_start: month and day on which a season begins, such as "04-01"; kept in the farm map; None for what it
            has, which is "01-01" at first.
        schema: of the tables in a database.

    Raises:
        UsageError: if `season_start` is not a day of the year.
        InputError: if a folder holds no result, or `farm_map` is not a farm map.
        RefusedError: if PROJ has no reliable transformation of a session, the farm map has another CRS than `crs`, or
            another process is writing to it or to a folder.
    """
    wanted = optional_crs(crs)
    _month_day(season_start or FIRST_DAY)
    results = _read_results([Path(folder) for folder in folders], zone, progress)
    with open_edit(farm_map, create=True, schema=schema, progress=progress) as edit:
        progress("writing the farm map", 0.0)
        target = _target_crs(edit, wanted) or next(iter(results.values())).crs
        if wanted is not None:
            places = [(one.crs, one.layers[0].shapes[0].bounds) for one in results.values()]
            expect_map(horizontal_part(wanted), places, "--crs")
        known = {session.session: session for session in edit.sessions()}
        fresh = [r for r in results.values() if r.session not in known or known[r.session].digest != r.digest]
        placed, notices = _transform_results(fresh, target, edit.name(), same_crs=same_crs)
        notices += _plausibility_notices([*known.values()], fresh)
        added, replaced = (tuple(r.session for r in placed if (r.session in known) == old) for old in (False, True))
        edit.remove(replaced)
        _append(edit, placed, target)
        if placed or season_start is not None:
            update_memory(edit, season_start)
            notices += _update_project(edit)
        unchanged = tuple(session for session in results if session not in {*added, *replaced})
        return FarmMapChange(
            edit.name(),
            name_of(target),
            added=added,
            replaced=replaced,
            unchanged=unchanged,
            sessions=len(known) + len(added),
            notices=tuple(notices),
        )


def remove_from_farm_map(
    farm_map: str | Path, wanted: Sequence[str], *, schema: str = DB_SCHEMA, progress: Progress = silent
) -> FarmMapChange:
    """Remove sessions from a farm map; the folders of their results stay.

    Args:
        farm_map: path of a GeoPackage, or a PostgreSQL connection string.
        wanted: an identity or its beginning, or a name that only one session has, each.
        schema: of the tables in a database.

    Raises:
        InputError: if the farm map has no such session, or several.
        FurrowmapError: if it cannot be opened.
    """
    with open_edit(farm_map, schema=schema, progress=progress) as edit:
        known = edit.sessions()
        removed = tuple(dict.fromkeys(_match(word, known, edit.name()).session for word in wanted))
        edit.remove(removed)
        update_memory(edit)
        notices = _update_project(edit)
        crs = edit.crs()
        left = len(known) - len(removed)
        return FarmMapChange(
            edit.name(), name_of(crs) if crs else None, removed=removed, sessions=left, notices=notices
        )


def farm_map_sessions(
    farm_map: str | Path, *, schema: str = DB_SCHEMA, progress: Progress = silent
) -> tuple[str, CRS | None, list[KnownSession]]:
    """Name (no password), CRS and sessions of a farm map by time; raises FurrowmapError if it cannot be opened."""
    with open_edit(farm_map, schema=schema, progress=progress) as edit:
        return edit.name(), edit.crs(), edit.sessions()


def _read_results(folders: Sequence[Path], zone: ZoneInfo | None, progress: Progress) -> dict[str, SessionResult]:
    """The results by the identity of their sessions."""
    results: dict[str, SessionResult] = {}
    for i, folder in enumerate(folders):
        progress("reading results", i / len(folders))
        for result in read_tasks(folder, zone) if folder.suffix == ".gpkg" else [read_result(folder, zone)]:
            if result.session in results:
                folders_of_it = (results[result.session].folder, folder)
                raise InputError("session-twice", folders=folders_of_it, session=result.name)
            results[result.session] = result
    return results


def update_memory(edit: FarmEdit, season_start: str | None = None) -> None:
    """Compute the tables of fields, visits, seasons and machines again; seasons begin as before without a start."""
    if season_start is not None:
        edit.store_setting(SEASON_START, season_start)
    crs = edit.crs()
    assert crs is not None
    sessions = edit.read(SESSIONS, SESSION_COLUMNS)
    order = np.lexsort([sessions.columns["session"].astype(str), sessions.columns["start"]])
    sessions = replace(
        sessions, shapes=sessions.shapes[order], columns={k: v[order] for k, v in sessions.columns.items()}
    )
    ground = {name: edit.read(name, GROUND_COLUMNS) for name in ("coverage", "boundary", "overlaps", "misses")}
    known = Sessions(sessions, passes=edit.read("passes", PASS_COLUMNS), **ground)
    for layer in memory_layers(known, _month_day(edit.setting(SEASON_START) or FIRST_DAY)):
        edit.rewrite(layer, crs)


def _month_day(text: str) -> tuple[int, int]:
    """Month and day of "MM-DD"."""
    try:
        day = dt.date.fromisoformat(f"2024-{text}")
    except ValueError:
        wanted = Text("a month and a day")
        raise OptionError("--season-start", text, wanted, "04-01") from None
    return day.month, day.day


def _target_crs(edit: FarmEdit, wanted: CRS | None) -> CRS | None:
    """The CRS of the farm map; None for a new one without `wanted`."""
    current = edit.crs()
    if current is not None and wanted is not None and not current.equals(wanted, ignore_axis_order=True):
        raise RefusedError("base-crs", edit=edit.name(), current=name_of(current), wanted=name_of(wanted))
    return current or wanted


def _transform_results(
    results: Sequence[SessionResult], target: CRS, farm_map: str, *, same_crs: bool
) -> tuple[list[SessionResult], list[Notice]]:
    """The results in the CRS of the farm map, and notices on the transformations."""
    placed: list[SessionResult] = []
    notices: dict[Notice, None] = {}
    for result in results:
        if same_crs and not result.crs.equals(target, ignore_axis_order=True):
            raise RefusedError(
                "base-crs.transformed",
                folder=result.folder,
                crs=name_of(result.crs),
                farm_map=farm_map,
                target=name_of(target),
            )
        moved, changes = result.in_crs(target)
        placed.append(moved)
        notices |= dict.fromkeys(changes)
    return placed, list(notices)


def _plausibility_notices(known: Sequence[KnownSession], fresh: Sequence[SessionResult]) -> list[Notice]:
    """Signs of a mistake: the same recordings under another name, mixed height systems."""
    notices = []
    for result in fresh:
        twins = [s.name for s in known if s.recordings == result.recordings and s.session != result.session]
        twins += [r.name for r in fresh if r.recordings == result.recordings and r.name < result.name]
        if twins:
            notices.append(Notice("session-renamed", result=result.name, twins=twins[0]))
    kinds = sorted({session.heights for session in known} | {result.heights for result in fresh})
    if fresh and len(kinds) > 1:
        notices.append(Notice("heights-mixed", kinds=", ".join(kinds)))
    return notices


def _append(edit: FarmEdit, results: Sequence[SessionResult], crs: CRS) -> None:
    """Append all results in the farm map's order of layers, those with the same columns together."""
    layers = [layer for result in results for layer in result.layers]
    names = list(dict.fromkeys(layer.name for layer in layers))
    layers.sort(key=lambda layer: names.index(layer.name))
    for _, same in groupby(layers, lambda layer: (layer.name, layer.kind, layer.fields)):
        edit.append(concatenate_layers(list(same)), crs)


def _update_project(edit: FarmEdit) -> tuple[Notice, ...]:
    """Store the styles and the QGIS project for the current content."""
    sessions = edit.sessions()
    kinds = edit.layers()
    crs = edit.crs()
    assert crs is not None
    own = styles({name: edit.columns(name) for name in kinds}, sessions, edit.read)
    notices = edit.store_styles({name: style for name, style in own.items() if kinds[name]})
    layers = []
    for name in drawing_order(list(kinds)):
        provider, source = edit.source(name, kinds[name])
        layers.append(ProjectLayer(name, kinds[name], source, provider, own.get(name), layer_title(name)))
    ground, foreign = _ground_layers(edit, sessions, crs)
    layers += ground
    layers.append(background_layer(crs, edit.bounds()))
    now = dt.datetime.now(dt.UTC)
    start = min((s.start for s in sessions), default=now)
    end = max((s.end for s in sessions), default=now)
    edit.store_project(project_archive(layers, crs, edit.bounds(), (start, end)))
    return (*notices, *foreign)


def _ground_layers(
    edit: FarmEdit, sessions: Sequence[KnownSession], crs: CRS
) -> tuple[list[ProjectLayer], tuple[Notice, ...]]:
    """The surfaces and clouds of all sessions, in files beside a GeoPackage; none for a database."""
    path = edit.file()
    if path is None:
        return [], ()
    named = named_folders(path, sessions)
    stored = edit.read(PROVENANCE, ("session", "report"))
    reports = dict(zip(stored.columns["session"], map(report_of, stored.columns["report"]), strict=True))
    results = [(folder, reports[s.session]) for s, folder in named.results if reports.get(s.session)]
    surface, clouds = write_ground_files(path, results, crs)
    language = language_of_user()
    layers = []
    if clouds is not None:
        layers.append(
            ProjectLayer(
                CLOUDS,
                POINT_CLOUD_WORDS,
                f"./{clouds.name}",
                "vpc",
                None,
                Text("Point clouds").in_language(language),
            )
        )
    if surface is not None:
        style = packaged_style("dsm.qml").replace('opacity="1"', 'opacity="0.6"')  # the background shows through
        layers.append(
            ProjectLayer(
                SURFACE,
                RASTER,
                f"./{surface.name}",
                "gdal",
                style,
                Text("Surface, the latest on top").in_language(language),
            )
        )
    return layers, foreign_notices(named.foreign)


def _match(word: str, known: Sequence[KnownSession], farm_map: str) -> KnownSession:
    """The session that a user means."""
    named = [session for session in known if session.session == word] or [
        session for session in known if session.name == word or (len(word) >= 4 and session.session.startswith(word))
    ]
    if len(named) == 1:
        return named[0]
    listed = ", ".join(f"{s.session} ({s.date}, {s.name})" for s in (named or known)[:5]) or "none"
    raise InputError(
        "no-such-session", farm_map=farm_map, named=bool(named), word=word, known=bool(known), listed=listed
    )
