"""A farm's base map: the sessions of many runs together, each with its day."""

from __future__ import annotations

import datetime as dt
from collections.abc import Iterator, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass, replace
from itertools import groupby
from pathlib import Path
from typing import Any, Final
from zoneinfo import ZoneInfo

import numpy as np
from numpy.typing import NDArray
from pyproj import CRS

from furrowmap.core.values.crs_name import name_of
from furrowmap.core.values.errors import InputError, Notice, RefusedError
from furrowmap.core.values.progress import Progress, silent
from furrowmap.exporters.farm.edit import Edit, KnownSession
from furrowmap.exporters.farm.geopackage import geopackage_edit
from furrowmap.exporters.farm.project import ProjectLayer, project_archive
from furrowmap.exporters.farm.results import SessionResult, drawing_order, read_result
from furrowmap.exporters.farm.styling import styles
from furrowmap.exporters.vectors.field_layers import Layer

DATABASES: Final = ("postgresql://", "postgres://", "postgresql:", "service=", "host=", "dbname=")
"""A base whose name begins so is one in PostGIS, all others are GeoPackages."""
DB_SCHEMA: Final = "furrowmap"


@dataclass(frozen=True)
class Change:
    """What a command did to a base.

    Attributes:
        base: as it may be told.
        crs: of its layers.
        added: sessions that are new in it.
        replaced: sessions that took the place of an earlier result of theirs.
        unchanged: sessions of which it had the same result already.
        removed: sessions that are no longer in it.
        sessions: how many it holds now.
        notices: what a user should know.
    """

    base: str
    crs: str | None
    added: tuple[str, ...] = ()
    replaced: tuple[str, ...] = ()
    unchanged: tuple[str, ...] = ()
    removed: tuple[str, ...] = ()
    sessions: int = 0
    notices: tuple[Notice, ...] = ()


def open_edit(
    base: str, *, create: bool = False, schema: str = DB_SCHEMA, progress: Progress = silent
) -> AbstractContextManager[Edit]:
    """Change the base of that name, as a whole or not at all.

    Args:
        base: the path of a GeoPackage, or how PostgreSQL calls a database (`postgresql://…`).
        create: whether it is made where it is not there.
        schema: of the tables in a database.
        progress: is told of waiting for others.

    Raises:
        FurrowmapError: if it cannot be had.
    """
    if base.startswith(DATABASES):
        try:
            from furrowmap.exporters.farm.postgis import postgis_edit
        except ImportError as error:
            raise RefusedError(
                f"The package psycopg is not installed ({error}).",
                "A base in PostGIS needs it, so nothing was done.",
                'Install it with pip install "furrowmap[postgis]", or name a GeoPackage.',
                code="no-psycopg",
            ) from None
        return postgis_edit(base, create=create, schema=schema)
    return geopackage_edit(Path(base), create=create, progress=progress)


def add_results(
    base: str,
    folders: Sequence[Path],
    *,
    crs: CRS | None = None,
    same_crs: bool = False,
    zone: ZoneInfo | None = None,
    schema: str = DB_SCHEMA,
    progress: Progress = silent,
) -> Change:
    """Put the results of runs into a base: all of them, or none where one of them cannot be.

    A session that is there already (the same name and recordings) is replaced by its new result, and left as it is
    where the result is the same.

    Args:
        base: the path of a GeoPackage, or how PostgreSQL calls a database; made where it is not there.
        folders: that `furrowmap run` wrote.
        crs: of a new base; None for that of the first session.
        same_crs: refuse sessions of another CRS instead of transforming them.
        zone: by which days are told; None for the nautical zone of each place.
        schema: of the tables in a database.
        progress: is told of the stages.

    Raises:
        InputError: if a folder holds no result, or the base is none.
        RefusedError: if a session has no way into the base's CRS that PROJ can vouch for, the base has another CRS than
            the one asked for, or somebody else is at work in the base or in a folder.
        OSError: if the base cannot be written.
    """
    results: dict[str, SessionResult] = {}
    for i, folder in enumerate(folders):
        progress("reading results", i / len(folders))
        result = read_result(folder, zone)
        if result.session in results:
            raise InputError(
                f"{folder} and {results[result.session].folder} hold results of the same session "
                f"('{result.name}' of {result.date}).",
                "The base keeps one result of a session, and nobody said which, so nothing was done.",
                "Name only the folder that counts.",
                code="session-twice",
            )
        results[result.session] = result
    with open_edit(base, create=True, schema=schema, progress=progress) as edit:
        progress("writing the base", 0.0)
        target = _target(edit, crs) or next(iter(results.values())).crs
        known = {session.session: session for session in edit.sessions()}
        fresh = [r for r in results.values() if r.session not in known or known[r.session].digest != r.digest]
        placed, notices = _placed(fresh, target, edit.shown(), same_crs=same_crs)
        notices += _doubts([*known.values()], fresh)
        replaced = tuple(result.session for result in placed if result.session in known)
        edit.remove(replaced)
        for layer in _together(placed):
            edit.append(layer, target)
        if placed:
            notices += _dress(edit)
        added = tuple(result.session for result in placed if result.session not in known)
        unchanged = tuple(session for session in results if session not in {*added, *replaced})
        return Change(
            edit.shown(),
            name_of(target),
            added=added,
            replaced=replaced,
            unchanged=unchanged,
            sessions=len(known) + len(added),
            notices=tuple(notices),
        )


def remove_sessions(
    base: str, wanted: Sequence[str], *, schema: str = DB_SCHEMA, progress: Progress = silent
) -> Change:
    """Take sessions out of a base; the folders of their results stay.

    Args:
        base: the path of a GeoPackage, or how PostgreSQL calls a database.
        wanted: an identity or its beginning, or a name that only one session has, each.
        schema: of the tables in a database.
        progress: is told of waiting for others.

    Raises:
        InputError: if the base has no such session, or several.
        FurrowmapError: if the base cannot be had.
    """
    with open_edit(base, schema=schema, progress=progress) as edit:
        known = edit.sessions()
        removed = tuple(dict.fromkeys(_found(word, known, edit.shown()).session for word in wanted))
        edit.remove(removed)
        _dress(edit)
        crs = edit.crs()
        left = len(known) - len(removed)
        return Change(edit.shown(), name_of(crs) if crs else None, removed=removed, sessions=left)


def known_sessions(
    base: str, *, schema: str = DB_SCHEMA, progress: Progress = silent
) -> tuple[str, CRS | None, list[KnownSession]]:
    """A base as it may be told, its CRS and its sessions by time.

    Raises:
        FurrowmapError: if the base cannot be had.
    """
    with open_edit(base, schema=schema, progress=progress) as edit:
        return edit.shown(), edit.crs(), edit.sessions()


def _target(edit: Edit, wanted: CRS | None) -> CRS | None:
    """The CRS of the base; None if nobody has said it yet.

    Raises:
        RefusedError: if it has another one than is wanted.
    """
    there = edit.crs()
    if there is not None and wanted is not None and not there.equals(wanted, ignore_axis_order=True):
        raise RefusedError(
            f"{edit.shown()} is in {name_of(there)}, not in {name_of(wanted)}.",
            "The layers of a base have one CRS, so nothing was done.",
            "Leave --crs out: sessions are brought into the base's. Or begin another base.",
            code="base-crs",
        )
    return there or wanted


def _placed(
    results: Sequence[SessionResult], target: CRS, base: str, *, same_crs: bool
) -> tuple[list[SessionResult], list[Notice]]:
    """The results in the CRS of the base, and what is to be known of the way there."""
    placed: list[SessionResult] = []
    notices: list[Notice] = []
    for result in results:
        if same_crs and not result.crs.equals(target, ignore_axis_order=True):
            raise RefusedError(
                f"{result.folder} is in {name_of(result.crs)}, {base} in {name_of(target)}.",
                "With --same-crs nothing is transformed, so nothing was done.",
                "Run the session with the base's CRS, or leave --same-crs out.",
                code="base-crs",
            )
        moved, told = result.in_crs(target)
        placed.append(moved)
        notices += [notice for notice in told if notice not in notices]
    return placed, notices


def _doubts(known: Sequence[KnownSession], fresh: Sequence[SessionResult]) -> list[Notice]:
    """What speaks for a mistake: the same recordings under another name, heights of another kind."""
    notices = []
    for result in fresh:
        twins = [s.name for s in known if s.recordings == result.recordings and s.session != result.session]
        twins += [r.name for r in fresh if r.recordings == result.recordings and r.name < result.name]
        if twins:
            text = (
                f"'{result.name}' is made of the same recordings as '{twins[0]}', so its ground counts twice. If it is "
                f"the same session under a new name, take the other out with `furrowmap base remove`."
            )
            notices.append(Notice("session-renamed", text))
    kinds = sorted({session.heights for session in known} | {result.heights for result in fresh})
    if fresh and len(kinds) > 1:
        text = f"Heights in this base are of several kinds ({', '.join(kinds)}): see the column 'heights' of sessions."
        notices.append(Notice("heights-mixed", text))
    return notices


def _together(results: Sequence[SessionResult]) -> Iterator[Layer]:
    """The layers of all results, those of the same table joined as far as their columns are the same.

    In the order of the first result's, which is the base's own: sessions first.
    """
    layers = [layer for result in results for layer in result.layers]
    names = list(dict.fromkeys(layer.name for layer in layers))
    layers.sort(key=lambda layer: names.index(layer.name))
    for (name, *_), same in groupby(layers, lambda layer: (layer.name, layer.kind, _columns(layer))):
        parts = list(same)
        columns = {column: _joined([part.columns[column] for part in parts]) for column in parts[0].columns}
        yield replace(parts[0], name=name, shapes=np.concatenate([part.shapes for part in parts]), columns=columns)


def _joined(parts: Sequence[NDArray[Any]]) -> NDArray[Any]:
    """The parts one after the other; masked where one of them is."""
    values = np.concatenate([np.ma.getdata(part) for part in parts])
    if not any(np.ma.isMA(part) for part in parts):
        return values
    return np.ma.MaskedArray(values, np.concatenate([np.ma.getmaskarray(part) for part in parts]))


def _columns(layer: Layer) -> tuple[tuple[str, str], ...]:
    return tuple((name, values.dtype.str) for name, values in layer.columns.items())


def _dress(edit: Edit) -> tuple[Notice, ...]:
    """Give the base the styles and the project that go with what it holds now."""
    sessions = edit.sessions()
    crs = edit.crs()
    assert crs is not None
    kinds = edit.layers()
    own = styles(kinds, [session.date for session in sessions])
    notices = edit.store_styles(own)
    layers = []
    for name in drawing_order(list(kinds)):
        provider, source = edit.source(name, kinds[name])
        layers.append(ProjectLayer(name, kinds[name], source, provider, own.get(name)))
    now = dt.datetime.now(dt.UTC)
    span = (
        min((session.start for session in sessions), default=now),
        max((session.end for session in sessions), default=now),
    )
    edit.store_project(project_archive(layers, crs, edit.bounds(), span))
    return notices


def _found(word: str, known: Sequence[KnownSession], base: str) -> KnownSession:
    named = [session for session in known if session.session == word] or [
        session for session in known if session.name == word or (len(word) >= 4 and session.session.startswith(word))
    ]
    if len(named) == 1:
        return named[0]
    listed = ", ".join(f"{s.session} ({s.date}, {s.name})" for s in (named or known)[:5]) or "none"
    raise InputError(
        f"{base} has {'several sessions' if named else 'no session'} '{word}'.",
        "Nothing was taken out.",
        f"Name one by its identity, such as {listed}; `furrowmap base list` shows all."
        if known
        else "The base is empty.",
        code="no-such-session",
    )
