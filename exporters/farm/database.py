"""A base's GeoPackage as SQLite sees it: whether it is one, who has it, and what furrowmap remembers in it."""

from __future__ import annotations

import hashlib
import sqlite3
from contextlib import closing
from pathlib import Path
from typing import Final

from furrowmap.core.values.errors import FurrowmapError, InputError, RefusedError
from furrowmap.exporters.farm.edit import SCHEMA, SETTINGS

BUSY_S: Final = 5.0
"""How long to wait for another program that writes."""
_MAGIC: Final = b"SQLite format 3\0"


def check_base(path: Path) -> None:
    """See that the file at `path` is a base.

    Raises:
        InputError: if it is none.
        RefusedError: if it is one of another schema, or another program keeps it to itself.
    """
    with path.open("rb") as file:
        if file.read(len(_MAGIC)) != _MAGIC:
            raise _no_base(path, "is no GeoPackage")
    try:
        with closing(sqlite3.connect(path, timeout=BUSY_S)) as database:
            there = has_table(database, SETTINGS) and has_table(database, "gpkg_contents")
            schema = setting(database, "schema") if there else None
    except sqlite3.OperationalError as error:
        raise _open_elsewhere(path, error) from None
    except sqlite3.DatabaseError as error:
        raise _no_base(path, f"is damaged ({error})") from None
    if schema is None:
        raise _no_base(path, "is a GeoPackage, but not one that `furrowmap base add` made")
    if schema != str(SCHEMA):
        raise RefusedError(
            f"{path} has the schema {schema}; this version of furrowmap knows {SCHEMA}.",
            "Its tables may mean something else, so nothing was done.",
            "Use the version of furrowmap that made it, or begin a new base from the folders of results.",
            code="base-schema",
        )


def _no_base(path: Path, why: str) -> InputError:
    return InputError(
        f"{path} {why}.",
        "What is in it could be damaged, so nothing was done.",
        "Name a file that is not there yet, or a base that furrowmap made.",
        code="not-a-base",
    )


def _open_elsewhere(path: Path, error: Exception) -> FurrowmapError:
    return RefusedError(
        f"{path} is open for editing in another program ({error}).",
        "What that program saves would be lost, so nothing was done.",
        "Save and end editing there (in QGIS: toggle editing off, or close the project), and run the command again.",
        code="base-open",
    )


def held(path: Path) -> sqlite3.Connection:
    """The base, kept from being written by others until the connection is closed.

    Raises:
        RefusedError: if another program is writing it, or has it open with a log of its own (WAL) beside it, which
            must not be found beside another file.
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
    """What is kept under that name."""
    row = database.execute(f"SELECT value FROM {SETTINGS} WHERE name = ?", (name,)).fetchone()  # noqa: S608
    return None if row is None else str(row[0])


def remember(database: sqlite3.Connection, name: str, text: str) -> None:
    """Keep a hash of what was written under `name`, to tell later whether somebody has changed it."""
    set_value(database, name, hashlib.sha256(text.encode()).hexdigest())


def set_value(database: sqlite3.Connection, name: str, value: str) -> None:
    """Keep a value under a name, in place of an earlier one."""
    database.execute(
        f"INSERT INTO {SETTINGS} (name, value) VALUES (?, ?) "  # noqa: S608
        "ON CONFLICT (name) DO UPDATE SET value = excluded.value",
        (name, value),
    )


def wrote(database: sqlite3.Connection, name: str, text: str) -> bool:
    """Whether `text` is what furrowmap itself wrote last under `name`."""
    return setting(database, name) == hashlib.sha256(text.encode()).hexdigest()
