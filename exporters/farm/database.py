"""The SQLite side of a farm map's GeoPackage: checks, locks, settings."""

from __future__ import annotations

import hashlib
import os
import sqlite3
import sys
import time
from collections.abc import Iterator
from contextlib import closing, contextmanager, suppress
from pathlib import Path
from typing import Final

from furrowmap.core.runtime.errors import InputError, RefusedError
from furrowmap.core.runtime.progress import Progress
from furrowmap.exporters.farm.edit import SETTINGS, check_schema

BUSY_S: Final = 5.0
"""Maximum wait for another program that writes."""
_SQLITE_MAGIC: Final = b"SQLite format 3\0"


def check_farm_map(path: Path) -> None:
    """Check that the file at `path` is a farm map of this version, and not locked by another program."""
    if path.is_dir():
        raise _not_a_farm_map(path, "is a folder")
    with path.open("rb") as file:
        if file.read(len(_SQLITE_MAGIC)) != _SQLITE_MAGIC:
            raise _not_a_farm_map(path, "is not a GeoPackage")
    try:
        with closing(sqlite3.connect(path, timeout=BUSY_S)) as database:
            has_settings = has_table(database, SETTINGS) and has_table(database, "gpkg_contents")
            schema = setting(database, "schema") if has_settings else None
    except sqlite3.OperationalError as error:
        raise _open_elsewhere(path, error) from None
    except sqlite3.DatabaseError as error:
        raise _not_a_farm_map(path, f"is damaged ({error})") from None
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


def store_hash(database: sqlite3.Connection, name: str, text: str) -> None:
    """Store the hash of a written text under `name`, to detect later changes by a user."""
    set_value(database, name, hashlib.sha256(text.encode()).hexdigest())


def is_unchanged(database: sqlite3.Connection, name: str, text: str) -> bool:
    """Whether `text` is what :func:`store_hash` saw last under `name`."""
    return setting(database, name) == hashlib.sha256(text.encode()).hexdigest()


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
            raise RefusedError("base-busy.exclusive", path=path, patience_s=patience_s)
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
    descriptor = os.open(lock, os.O_RDWR | os.O_CREAT | getattr(os, "O_NOFOLLOW", 0), 0o666)
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
