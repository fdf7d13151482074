"""A farm map in a GeoPackage; :mod:`.postgis` has the same operations."""

import getpass
import os
import shutil
import sqlite3
import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, closing, contextmanager, suppress
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray
from pyproj import CRS

from furrowmap.core.readers.ogr_layers import layer_info
from furrowmap.core.readers.sqlite_file import check_sqlite, check_triggers
from furrowmap.core.runtime.errors import InputError, Notice, RefusedError
from furrowmap.core.runtime.file_names import resolved
from furrowmap.core.runtime.plain_reads import open_plain
from furrowmap.core.runtime.progress import Progress, silent
from furrowmap.core.values.crs import crs_of_file
from furrowmap.exporters.farm.edit import (
    KNOWN_COLUMNS,
    LAYER_SETTING,
    SCHEMA,
    SETTINGS,
    KnownSession,
    check_schema,
    chosen_columns,
    column_type,
    content_hash,
    is_due,
    row_of,
)
from furrowmap.exporters.farm.farm_memory_tables import DERIVED
from furrowmap.exporters.farm.farm_results import PROVENANCE, SESSIONS
from furrowmap.exporters.farm.project import PROJECT, project_metadata
from furrowmap.exporters.files.atomic import atomic_output
from furrowmap.exporters.files.plain_files import open_lock, refuse_dangling
from furrowmap.exporters.files.vector_layers import unflushed, write_arrays
from furrowmap.exporters.vectors.field_layers import Columns, Layer
from furrowmap.exporters.vectors.geopackage import GEOMETRY, read_layer, store_styles, write_layer

BUSY_S: Final = 5.0
"""Maximum wait for another program that writes."""
_SQLITE_MAGIC: Final = b"SQLite format 3\0"


def check_farm_map(path: Path) -> None:
    """Check that the file at `path` is a farm map of this version, and not locked by another program."""
    if path.is_dir():
        raise _not_a_farm_map(path, "is a folder")
    with open_plain(path) as file:
        if file.read(len(_SQLITE_MAGIC)) != _SQLITE_MAGIC:
            raise _not_a_farm_map(path, "is not a GeoPackage")
    try:
        check_sqlite(path)
        with closing(sqlite3.connect(path, timeout=BUSY_S)) as database:
            check_triggers(database)
            has_settings = has_table(database, SETTINGS) and has_table(database, "gpkg_contents")
            schema = setting(database, "schema") if has_settings else None
    except sqlite3.OperationalError as error:
        raise _open_elsewhere(path, error) from None
    except sqlite3.DatabaseError as error:
        raise _not_a_farm_map(path, f"is damaged ({error})") from None
    except ValueError as error:
        raise _not_a_farm_map(path, f"does more than to hold rows: {error}") from None
    if schema is None:
        raise _not_a_farm_map(path, "is a GeoPackage, but was not made by `furrowmap farm add`")
    check_schema(str(path), schema, "from the result folders")


def _not_a_farm_map(path: Path, why: str) -> InputError:
    return InputError("not-a-base", path=path, why=why)


def _open_elsewhere(path: Path, error: Exception) -> RefusedError:
    return RefusedError("base-open", path=path, error=error)


def locked(path: Path) -> sqlite3.Connection:
    """A connection that keeps other programs from writing until it is closed.

    Refused where a program has the file open in WAL mode: its log must not be found beside another file.
    """
    database = sqlite3.connect(path, timeout=BUSY_S, isolation_level=None)
    try:
        database.execute("PRAGMA journal_mode = DELETE").fetchone()
        database.execute("BEGIN IMMEDIATE")
    except sqlite3.OperationalError as error:
        database.close()
        raise _open_elsewhere(path, error) from None
    return database


def has_table(database: sqlite3.Connection, name: str) -> bool:
    """Whether there is a table of that name."""
    query = "SELECT 1 FROM sqlite_master WHERE type = 'table' AND name = ?"
    return database.execute(query, (name,)).fetchone() is not None


def setting(database: sqlite3.Connection, name: str) -> str | None:
    """The value of a setting."""
    row = database.execute(f"SELECT value FROM {SETTINGS} WHERE name = ?", (name,)).fetchone()  # noqa: S608
    return None if row is None else str(row[0])


def set_value(database: sqlite3.Connection, name: str, value: str) -> None:
    """Store a setting in place of an earlier one."""
    database.execute(
        f"INSERT INTO {SETTINGS} (name, value) VALUES (?, ?) "  # noqa: S608
        "ON CONFLICT (name) DO UPDATE SET value = excluded.value",
        (name, value),
    )


_PATIENCE_S: Final = 60.0
_STEP_S: Final = 0.05


@contextmanager
def exclusive(path: Path, progress: Progress, patience_s: float = _PATIENCE_S) -> Iterator[None]:
    """Keep other processes of furrowmap from changing the file at `path`, which need not exist.

    The lock is a system lock on a hidden file beside it, so it ends with the process, however that ends.
    """
    lock = path.with_name(f".{path.name}.lock")
    deadline = time.monotonic() + patience_s
    while (descriptor := _try(lock)) is None:
        if time.monotonic() > deadline:
            raise RefusedError("base-busy.locked-by-another", path=path, patience_s=patience_s)
        progress("waiting for another process", 0.0)
        time.sleep(_STEP_S)
    try:
        yield
    finally:
        with suppress(OSError):  # Windows does not remove an open file; an empty one remains
            lock.unlink()
        os.close(descriptor)


def _try(lock: Path) -> int | None:
    """The descriptor of the file at `lock`, locked; None while another process has it."""
    descriptor = open_lock(lock)
    with suppress(OSError):
        if sys.platform == "win32":
            import msvcrt

            msvcrt.locking(descriptor, msvcrt.LK_NBLCK, 1)
        else:
            import fcntl

            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        if os.path.samestat(os.fstat(descriptor), lock.stat()):
            return descriptor
    os.close(descriptor)  # another process's, or of a name that the process before has just removed
    return None


_COLUMN_TYPES: Final = {
    "f": "REAL", "i": "INTEGER", "u": "INTEGER", "b": "BOOLEAN", "O": "TEXT", "D": "DATE", "M": "DATETIME",
}  # fmt: skip
_NUMPY_TYPES: Final = {
    "REAL": "f8", "INTEGER": "i8", "MEDIUMINT": "i8", "BOOLEAN": "?", "DATE": "datetime64[D]",
    "DATETIME": "datetime64[ms]",
}  # fmt: skip


@contextmanager
def geopackage_edit(path: Path, *, create: bool = False, progress: Progress = silent) -> "Iterator[GeopackageEdit]":
    """Change the farm map at `path`, as a whole or not at all.

    The first change copies the file; the changed copy replaces it at the end. A program that opens the file meanwhile,
    or after the process was killed, finds the earlier state. Other processes of furrowmap wait; other programs cannot
    save to the file until the end.
    """
    refuse_dangling(path)
    path = resolved(path)
    if not path.parent.is_dir():
        raise InputError("base-unreachable.no-folder", parent=path.parent)
    with exclusive(path, progress):
        if path.exists():
            check_farm_map(path)
        elif not create:
            raise InputError("base-missing", path=path)
        with ExitStack() as stack:
            edit = GeopackageEdit(path, stack)
            yield edit
            edit.finish()


class GeopackageEdit:
    """A change of a farm map in a GeoPackage: all of it takes place, or nothing."""

    def __init__(self, path: Path, stack: ExitStack) -> None:
        self._path = path
        self._stack = stack
        self._changing: Path | None = None
        self._lock: sqlite3.Connection | None = None
        self._layers: dict[str, str] | None = None
        """Those of the copy that is changed, once they were asked for: each opening reads the schema."""

    def name(self) -> str:
        """Path of the GeoPackage."""
        return str(self._path)

    def file(self) -> Path | None:
        """The file of the farm map; None for one in a database."""
        return self._path

    def crs(self) -> CRS | None:
        """Of all layers; None for a new farm map."""
        if SESSIONS not in self.layers():
            return None
        return crs_of_file(layer_info(self._current(), SESSIONS)["crs"])

    def sessions(self) -> list[KnownSession]:
        """The sessions in order of time."""
        if SESSIONS not in self.layers():
            return []
        with self._open() as database:
            rows = database.execute(
                f"SELECT {KNOWN_COLUMNS} FROM {SESSIONS} s JOIN {PROVENANCE} p "  # noqa: S608
                "USING (session) ORDER BY s.start, s.session"
            ).fetchall()
        return [row_of(row) for row in rows]

    def remove(self, sessions: Sequence[str]) -> None:
        """Remove sessions, given by their identities, from all layers."""
        if not sessions:
            return
        self._begin()
        with self._open() as database:
            for layer in self.layers().keys() - DERIVED:
                database.executemany(
                    f'DELETE FROM "{layer}" WHERE session = ?',  # noqa: S608 (layers have plain names)
                    [(session,) for session in sessions],
                )

    def append(self, layer: Layer, crs: CRS) -> None:
        """Append features to a layer; a missing layer or column is created."""
        path = self._begin()
        if layer.name in self.layers():
            whole = self._fit_columns(layer)
            if len(layer.shapes):
                write_layer(path, whole, crs, indexed=True, append=True)
            return
        with self._open() as database:
            if has_table(database, layer.name):
                raise RefusedError("base-clash", path=self._path, layer=layer.name)
            set_value(database, f"{LAYER_SETTING}{layer.name}", layer.kind)
        self._layers = None
        write_layer(path, layer, crs, indexed=True)

    def layers(self) -> dict[str, str]:
        """Geometry type (as OGR calls it, empty for tables) of each layer of furrowmap, by name."""
        if self._layers is not None:
            return self._layers
        if not self._current().exists():
            return {}
        with self._open() as database:
            rows = database.execute(
                f"SELECT substr(name, {len(LAYER_SETTING) + 1}), value FROM {SETTINGS} "  # noqa: S608
                f"JOIN gpkg_contents ON name = '{LAYER_SETTING}' || table_name ORDER BY fid"
            ).fetchall()
        layers = dict(rows)
        self._layers = layers if self._changing is not None else None
        return layers

    def columns(self, layer: str) -> set[str]:
        """Names of the columns of a layer's table."""
        with self._open() as database:
            return {row[1] for row in database.execute(f'PRAGMA table_info("{layer}")')}

    def read(self, layer: str, columns: Sequence[str]) -> Layer:
        """Features of a layer with some of its columns; those that it does not have are None or nan throughout."""
        kind = self.layers().get(layer)
        if kind is None:
            return chosen_columns(Layer(layer, "", "", np.empty(0, object), {}), columns)
        return chosen_columns(read_layer(self._current(), layer), columns)

    def rewrite(self, layer: Layer, crs: CRS) -> None:
        """Replace all features of a layer; a missing layer or column is created."""
        self._begin()
        if layer.name in self.layers():
            with self._open() as database:
                database.execute(f'DELETE FROM "{layer.name}"')  # noqa: S608 (layers have plain names)
        if len(layer.shapes):
            self.append(layer, crs)

    def setting(self, name: str) -> str | None:
        """A setting of the farm map; None where it was never stored."""
        if not self._current().exists():
            return None
        with self._open() as database:
            return setting(database, name)

    def store_setting(self, name: str, value: str) -> None:
        """Store a setting of the farm map."""
        self._begin()
        with self._open() as database:
            set_value(database, name, value)

    def bounds(self) -> tuple[float, float, float, float]:
        """West, south, east and north bound of all sessions."""
        with self._open() as database:
            west, south, east, north = database.execute(_BOUNDS.format(table=SESSIONS, geometry=GEOMETRY)).fetchone()
        return west or 0.0, south or 0.0, east or 0.0, north or 0.0

    def source(self, layer: str, kind: str) -> tuple[str, str]:  # noqa: ARG002 (of the protocol)
        """QGIS's provider of a layer, and its data source as seen from the stored project."""
        return "ogr", f"./{self._path.name}|layername={layer}"

    def store_styles(self, styles: dict[str, str]) -> tuple[Notice, ...]:
        """Store the styles of layers where QGIS looks for them; one that a user has changed stays."""
        path = self._begin()
        with self._open() as database:
            has_styles = has_table(database, "layer_styles")
            query = "SELECT f_table_name, styleQML FROM layer_styles WHERE styleName = f_table_name"
            rows = database.execute(query).fetchall() if has_styles else []
            stored = dict(rows)
            due = {
                name: text
                for name, text in styles.items()
                if is_due(stored.get(name), text, setting(database, f"style {name}"))
            }
            update = "UPDATE layer_styles SET styleQML = ? WHERE styleName = f_table_name AND f_table_name = ?"
            for name, text in due.items():
                if name in stored:
                    database.execute(update, (text, name))
                set_value(database, f"style {name}", content_hash(text))
        new = {name: text for name, text in due.items() if name not in stored}
        if new:
            store_styles(path, new, append=has_styles)
        return ()

    def store_project(self, archive: bytes) -> None:
        """Store the project where QGIS looks for it; one that a user has changed stays."""
        self._begin()
        content = archive.hex()  # as QGIS itself writes and expects it
        with self._open() as database:
            database.execute(
                "CREATE TABLE IF NOT EXISTS qgis_projects(name TEXT PRIMARY KEY, metadata BLOB, content BLOB)"
            )
            stored = database.execute("SELECT content FROM qgis_projects WHERE name = ?", (PROJECT,)).fetchone()
            if is_due(None if stored is None else str(stored[0]), content, setting(database, "project")):
                database.execute(
                    "INSERT OR REPLACE INTO qgis_projects VALUES (?, ?, ?)",
                    (PROJECT, project_metadata(_user()), content),
                )
                set_value(database, "project", content_hash(content))

    def finish(self) -> None:
        """Check the changed file before it replaces the earlier one; OSError if the disk holds something else."""
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
            raise OSError(f"{self._path} differs from what was written ({verdict}, journal {journal})")
        if self._lock is not None:
            self._lock.close()  # before the renaming, which Windows refuses while a file is open

    def _current(self) -> Path:
        return self._changing or self._path

    @contextmanager
    def _open(self) -> Iterator[sqlite3.Connection]:
        """The current state; changes are committed unless an exception is raised."""
        with closing(sqlite3.connect(self._current(), timeout=BUSY_S)) as database, database:
            if self._changing is not None:
                database.execute("PRAGMA synchronous = OFF")
            yield database

    def _begin(self) -> Path:
        """Work from here on in a copy, which replaces the file at the end."""
        if self._changing is None:
            unfinished = self._stack.enter_context(atomic_output(self._path))
            self._stack.enter_context(unflushed())
            if self._path.exists():
                self._lock = self._stack.enter_context(closing(locked(self._path)))
                with closing(sqlite3.connect(self._path)) as source, closing(sqlite3.connect(unfinished)) as copy:
                    copy.execute("PRAGMA synchronous = OFF")
                    source.backup(copy)
                shutil.copymode(self._path, unfinished)
            else:
                _create(unfinished)
            self._changing = unfinished
        return self._changing

    def _fit_columns(self, layer: Layer) -> Layer:
        """The layer with all columns of its table in their order, as GDAL needs; new ones are added there."""
        with self._open() as database:
            rows = database.execute(f'PRAGMA table_info("{layer.name}")').fetchall()
            own = {name.lower(): name for name in layer.columns}
            columns: Columns = {}
            for _, name, kind, _, _, key in rows:
                if name.lower() in own:
                    name = own.pop(name.lower())
                    columns[name] = layer.columns[name]
                elif not key and name != GEOMETRY:
                    columns[name] = _unknown(len(layer.shapes), kind)
            for name in own.values():
                columns[name] = layer.columns[name]
                quoted = name.replace('"', '""')
                kind = column_type(columns[name], _COLUMN_TYPES)
                database.execute(f'ALTER TABLE "{layer.name}" ADD COLUMN "{quoted}" {kind}')
        return replace(layer, columns=columns)


def _unknown(n: int, kind: str) -> NDArray[Any]:
    """A column (n,) of nothing but NULL."""
    whole: NDArray[Any] = np.zeros(n, np.dtype(_NUMPY_TYPES.get(kind.partition("(")[0], "O")))
    return np.ma.MaskedArray(whole, np.ones(n, bool)) if whole.dtype.kind != "O" else np.full(n, None, object)


_BOUNDS: Final = 'SELECT min(minx), min(miny), max(maxx), max(maxy) FROM "rtree_{table}_{geometry}"'


def _create(path: Path) -> None:
    """Create a GeoPackage with nothing but the settings of a farm map."""
    columns = [np.array([word], dtype=object) for word in ("schema", str(SCHEMA))]
    options = {"DESCRIPTION": "Settings of furrowmap for this farm map"}
    write_arrays(path, None, columns, ["name", "value"], layer=SETTINGS, driver="GPKG", layer_options=options)
    with closing(sqlite3.connect(path)) as database, database:
        database.execute(f"CREATE UNIQUE INDEX {SETTINGS}_name ON {SETTINGS}(name)")


def _user() -> str:
    try:
        return getpass.getuser()
    except (ImportError, KeyError, OSError):  # a user without a name
        return ""
