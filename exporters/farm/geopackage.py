"""A farm's base map in a GeoPackage."""

from __future__ import annotations

import datetime as dt
import getpass
import json
import shutil
import sqlite3
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, closing, contextmanager
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray
from pyproj import CRS

from furrowmap.core.values.errors import InputError, Notice, RefusedError
from furrowmap.core.values.progress import Progress, silent
from furrowmap.exporters.farm.database import BUSY_S, check_base, has_table, held, remember, set_value, wrote
from furrowmap.exporters.farm.edit import KNOWN_COLUMNS, SCHEMA, SETTINGS, KnownSession, row_of
from furrowmap.exporters.farm.lock import exclusive
from furrowmap.exporters.farm.project import PROJECT
from furrowmap.exporters.farm.results import PROVENANCE, SESSIONS
from furrowmap.exporters.files.atomic import atomic_output
from furrowmap.exporters.vectors.field_layers import Layer
from furrowmap.exporters.vectors.geopackage import GEOMETRY, store_styles, write_layer
from furrowmap.exporters.vectors.ogr import pyogrio

_COLUMN_TYPES: Final = {"f": "REAL", "i": "INTEGER", "u": "INTEGER", "b": "BOOLEAN", "O": "TEXT"}
_SYNCHRONOUS: Final = "OGR_SQLITE_SYNCHRONOUS"


@contextmanager
def geopackage_edit(path: Path, *, create: bool = False, progress: Progress = silent) -> Iterator[GeopackageEdit]:
    """Change the base at `path`, as a whole or not at all.

    The base is copied beside, changed there and put in its place once it is whole: whoever opens it meanwhile, or after
    the process was killed, finds the base as it was. Nothing is copied as long as nothing changes. Other processes of
    furrowmap wait; programs that want to save into the base are kept out until the end.

    Args:
        path: of the GeoPackage.
        create: whether it is made where it is not there.
        progress: is told of the stage "waiting for another process".

    Raises:
        InputError: if it is not there, or is no base.
        RefusedError: if another process changes it, or a program has it open for editing.
        OSError: if it cannot be written.
    """
    path = path.resolve()
    if not path.parent.is_dir():
        raise InputError(
            f"{path.parent} is not there.",
            "The base would have to be made in it, so nothing was done.",
            "Make the folder first, or check how its name is written.",
            code="base-unreachable",
        )
    with exclusive(path, progress):
        if path.exists():
            check_base(path)
        elif not create:
            raise InputError(
                f"{path} is not there.",
                "There is no base to look into.",
                "Check its name; `furrowmap base add DIR BASE.gpkg` makes one.",
                code="base-missing",
            )
        with ExitStack() as stack:
            edit = GeopackageEdit(path, stack)
            yield edit
            edit.finish()


class GeopackageEdit:
    """:class:`~furrowmap.exporters.farm.edit.Edit` of a GeoPackage."""

    def __init__(self, path: Path, stack: ExitStack) -> None:
        self._path = path
        self._stack = stack
        self._changing: Path | None = None
        self._held: sqlite3.Connection | None = None

    def shown(self) -> str:
        """The base's path."""
        return str(self._path)

    def crs(self) -> CRS | None:
        """Of all its layers; None if the base is new."""
        if SESSIONS not in self.layers():
            return None
        return CRS.from_user_input(pyogrio.read_info(self._current(), layer=SESSIONS)["crs"])

    def sessions(self) -> list[KnownSession]:
        """Those in the base, by time."""
        if SESSIONS not in self.layers():
            return []
        with self._open() as database:
            rows = database.execute(
                f"SELECT {KNOWN_COLUMNS} FROM {SESSIONS} s JOIN {PROVENANCE} p "  # noqa: S608
                "USING (session) ORDER BY s.start, s.session"
            ).fetchall()
        return [row_of(row) for row in rows]

    def remove(self, sessions: Sequence[str]) -> None:
        """Take sessions out of all layers, by their identities."""
        if not sessions:
            return
        self._begin()
        with self._open() as database:
            for layer in self.layers():
                database.executemany(
                    f'DELETE FROM "{layer}" WHERE session = ?',  # noqa: S608 (layers have plain names)
                    [(session,) for session in sessions],
                )

    def append(self, layer: Layer, crs: CRS) -> None:
        """Add features to a layer, which is made where it is not there; columns that it lacks too."""
        path = self._begin()
        if layer.name in self.layers():
            self._add_columns(layer)
            if len(layer.shapes):
                write_layer(path, layer, crs, indexed=True, append=True)
            return
        with self._open() as database:
            if has_table(database, layer.name):
                raise RefusedError(
                    f"{self._path} has a layer '{layer.name}' that furrowmap did not make.",
                    "It would be lost, so nothing was done.",
                    "Rename it, or begin a base in another file.",
                    code="base-clash",
                )
            set_value(database, f"{_LAYER}{layer.name}", layer.kind)
        write_layer(path, layer, crs, indexed=True)

    def layers(self) -> dict[str, str]:
        """Kind of geometry (as OGR calls it, empty for tables) of each layer of ours, by name."""
        if not self._current().exists():
            return {}
        with self._open() as database:
            rows = database.execute(
                f"SELECT substr(name, {len(_LAYER) + 1}), value FROM {SETTINGS} "  # noqa: S608
                f"JOIN gpkg_contents ON name = '{_LAYER}' || table_name ORDER BY fid"
            ).fetchall()
        return dict(rows)

    def bounds(self) -> tuple[float, float, float, float]:
        """Least easting and northing, greatest easting and northing of all sessions."""
        with self._open() as database:
            west, south, east, north = database.execute(_BOUNDS.format(table=SESSIONS, geometry=GEOMETRY)).fetchone()
        return west or 0.0, south or 0.0, east or 0.0, north or 0.0

    def source(self, layer: str, kind: str) -> tuple[str, str]:  # noqa: ARG002 (needed elsewhere)
        """QGIS's provider of a layer, and where that finds it, as seen from the stored project."""
        return "ogr", f"./{self._path.name}|layername={layer}"

    def store_styles(self, styles: dict[str, str]) -> tuple[Notice, ...]:
        """Keep the styles of layers where QGIS looks for them; one that a user has changed stays."""
        path = self._begin()
        with self._open() as database:
            there = has_table(database, "layer_styles")
            query = "SELECT f_table_name, id, styleQML FROM layer_styles WHERE styleName = f_table_name"
            rows = database.execute(query).fetchall() if there else []
            stored = {name: (number, text) for name, number, text in rows}
            for name in styles.keys() & stored.keys():
                number, text = stored[name]
                if text != styles[name] and wrote(database, f"style {name}", text):
                    database.execute("UPDATE layer_styles SET styleQML = ? WHERE id = ?", (styles[name], number))
                    remember(database, f"style {name}", styles[name])
            new = {name: text for name, text in styles.items() if name not in stored}
            for name, text in new.items():
                remember(database, f"style {name}", text)
        if new:
            store_styles(path, new, append=there)
        return ()

    def store_project(self, archive: bytes) -> None:
        """Keep the project where QGIS looks for it; one that a user has changed stays."""
        self._begin()
        content = archive.hex()  # as QGIS itself writes and expects it
        moment = dt.datetime.now(dt.UTC).strftime("%Y-%m-%dT%H:%M:%S")
        metadata = json.dumps({"last_modified_time": moment, "last_modified_user": _user()})
        with self._open() as database:
            database.execute(
                "CREATE TABLE IF NOT EXISTS qgis_projects(name TEXT PRIMARY KEY, metadata BLOB, content BLOB)"
            )
            stored = database.execute("SELECT content FROM qgis_projects WHERE name = ?", (PROJECT,)).fetchone()
            if stored is None or (stored[0] != content and wrote(database, "project", str(stored[0]))):
                database.execute("INSERT OR REPLACE INTO qgis_projects VALUES (?, ?, ?)", (PROJECT, metadata, content))
                remember(database, "project", content)

    def finish(self) -> None:
        """See that the changed base is sound, before it takes its place.

        Raises:
            OSError: if it is not: the disk kept something else than what was written.
        """
        if self._changing is None:
            return
        with self._open() as database:
            for layer, kind in self.layers().items():
                if kind:
                    box = database.execute(_BOUNDS.format(table=layer, geometry=GEOMETRY)).fetchone()
                    database.execute(
                        "UPDATE gpkg_contents SET min_x = ?, min_y = ?, max_x = ?, max_y = ?, "
                        "last_change = strftime('%Y-%m-%dT%H:%M:%fZ', 'now') WHERE table_name = ?",
                        (*box, layer),
                    )
        with self._open() as database:
            verdict = database.execute("PRAGMA integrity_check").fetchone()[0]
            journal = database.execute("PRAGMA journal_mode").fetchone()[0]
        if (verdict, journal) != ("ok", "delete"):
            raise OSError(f"{self._path} is not as it was written ({verdict}, journal {journal})")
        if self._held is not None:
            self._held.close()  # before the renaming, which Windows refuses while a file is open

    def _current(self) -> Path:
        return self._changing or self._path

    @contextmanager
    def _open(self) -> Iterator[sqlite3.Connection]:
        """The base as it is now; what is done to it lasts unless something is raised."""
        with closing(sqlite3.connect(self._current(), timeout=BUSY_S)) as database, database:
            if self._changing is not None:
                database.execute("PRAGMA synchronous = OFF")
            yield database

    def _begin(self) -> Path:
        """From here on the base is a copy beside, which takes its place in the end."""
        if self._changing is None:
            unfinished = self._stack.enter_context(atomic_output(self._path))
            self._stack.enter_context(_flushed_once())
            if self._path.exists():
                self._held = self._stack.enter_context(closing(held(self._path)))
                with closing(sqlite3.connect(self._path)) as source, closing(sqlite3.connect(unfinished)) as copy:
                    copy.execute("PRAGMA synchronous = OFF")
                    source.backup(copy)
                shutil.copymode(self._path, unfinished)
            else:
                _make(unfinished)
            self._changing = unfinished
        return self._changing

    def _add_columns(self, layer: Layer) -> None:
        with self._open() as database:
            there = {row[1].lower() for row in database.execute(f'PRAGMA table_info("{layer.name}")')}
            for name, values in layer.columns.items():
                if name.lower() not in there:
                    quoted = name.replace('"', '""')
                    database.execute(f'ALTER TABLE "{layer.name}" ADD COLUMN "{quoted}" {_column_type(values)}')


_LAYER: Final = "layer "
"""Names of settings that tell the kind of a layer begin with it."""
_BOUNDS: Final = 'SELECT min(minx), min(miny), max(maxx), max(maxy) FROM "rtree_{table}_{geometry}"'


def _make(path: Path) -> None:
    """A GeoPackage with nothing but the settings of a base."""
    columns = [np.array([word], dtype=object) for word in ("schema", str(SCHEMA))]
    description = "What furrowmap knows of this base"
    options = {"DESCRIPTION": description}
    pyogrio.raw.write(path, None, columns, ["name", "value"], layer=SETTINGS, driver="GPKG", layer_options=options)
    with closing(sqlite3.connect(path)) as database, database:
        database.execute(f"CREATE UNIQUE INDEX {SETTINGS}_name ON {SETTINGS}(name)")


@contextmanager
def _flushed_once() -> Iterator[None]:
    """Let GDAL leave flushing to the disk to whoever puts the file in its place, instead of after every layer."""
    pyogrio.set_gdal_config_options({_SYNCHRONOUS: "OFF"})
    try:
        yield
    finally:
        pyogrio.set_gdal_config_options({_SYNCHRONOUS: None})


def _column_type(values: NDArray[Any]) -> str:
    """How a GeoPackage calls the type of a column."""
    if values.dtype.kind == "M":
        return "DATE" if values.dtype == "datetime64[D]" else "DATETIME"
    return _COLUMN_TYPES[values.dtype.kind]


def _user() -> str:
    try:
        return getpass.getuser()
    except (ImportError, KeyError, OSError):  # a user without a name
        return ""
