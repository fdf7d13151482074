"""SQLite databases of anybody (GeoPackage, MBTiles, bags), checked before GDAL or a query of ours relies on them.

A database holds more than rows: stored queries that never end, virtual tables that read other files, columns and
triggers that compute, pages that are used a thousand times over, a journal that deletes a file elsewhere.
"""

import re
import sqlite3
from collections.abc import Iterator
from contextlib import closing, contextmanager
from functools import lru_cache
from pathlib import Path
from typing import Final
from urllib.parse import quote

from furrowmap.core.runtime.file_names import resolved

SQLITE_MAGIC: Final = b"SQLite format 3\0"
MAX_SCHEMA_BYTES: Final = 10_000_000
"""Of all `CREATE` statements together."""
MAX_VIEW_STEPS: Final = 50_000_000
"""Instructions of SQLite's virtual machine that all stored queries of a file may take: about two seconds."""
_STEPS_A_CALL: Final = 100_000
SIDECARS: Final = ("-journal", "-wal", "-shm")
"""Ends of the names of the files that SQLite keeps beside a database."""
_TABLE_NAME: Final = r"""(?:"(?:[^"]|"")*"|'(?:[^']|'')*'|`(?:[^`]|``)*`|\[[^\]]*\]|[\w$]+)"""
_MODULE: Final = re.compile(
    rf"\s*CREATE\s+VIRTUAL\s+TABLE\s+(?:IF\s+NOT\s+EXISTS\s+)?(?:{_TABLE_NAME}\s*\.\s*)?{_TABLE_NAME}\s*USING\s+[\"'`\[]?(\w+)",
    re.IGNORECASE,
)
"""The module of a virtual table; a name may hold the words, too."""
_SPATIAL_INDEX: Final = "rtree"
_ENDLESS_WORDS: Final = re.compile(r"\b(SELECT|WITH)\b", re.IGNORECASE)
_JOURNAL_MAGIC: Final = bytes.fromhex("d9d505f920a163d7")
"""Ends a journal that names a second file, which SQLite deletes after the roll-back (sqlite.org/fileformat.html, 3)."""
_BROKEN_TREE: Final = re.compile(r"\bpage\b|out of order|malformed", re.IGNORECASE)
_GENERATED: Final = (2, 3)
_VIEW_FUNCTIONS: Final = frozenset(
    {
        "abs", "avg", "coalesce", "count", "ifnull", "iif", "instr", "length", "lower", "ltrim", "max", "min", "nullif",
        "replace", "round", "rtrim", "substr", "substring", "sum", "total", "trim", "typeof", "upper",
    }
)  # fmt: skip
"""Functions of stored queries: none that another program defines, and none whose value changes."""


def check_sqlite(path: Path) -> None:
    """Raises ValueError for a database that does more than to hold rows, or is damaged; sqlite3.Error if it is none.

    Stored queries (views) are allowed as far as they end soon.
    """
    for end in SIDECARS:
        if Path(f"{path}{end}").is_symlink():
            raise ValueError(f"its file '{path.name}{end}' is a link")
    if names_second_file(Path(f"{path}-journal")):
        raise ValueError(f"its journal '{path.name}-journal' names another file")
    status = path.stat()
    write_ahead = Path(f"{path}-wal")
    changed_ns = write_ahead.stat().st_mtime_ns if write_ahead.is_file() else 0
    _check(resolved(path), (status.st_ino, status.st_size, status.st_mtime_ns, status.st_ctime_ns, changed_ns))


def names_second_file(journal: Path) -> bool:
    """Whether a journal names another file, which SQLite would delete."""
    if not journal.is_file():
        return False
    with journal.open("rb") as file:
        size = file.seek(0, 2)
        file.seek(max(size - len(_JOURNAL_MAGIC), 0))
        return file.read() == _JOURNAL_MAGIC


def check_triggers(database: sqlite3.Connection) -> None:
    """Raises ValueError for a trigger with a query: it would run whenever a row is written."""
    rows = database.execute("SELECT name, sql FROM sqlite_master WHERE type = 'trigger'").fetchall()
    for name, sql in rows:
        # those of the specification may refuse a row, after a query: tiles and metadata, which no farm map has
        if not str(name).startswith("gpkg_") and _ENDLESS_WORDS.search(str(sql)):
            raise ValueError(f"it has the trigger '{name}', which runs a query for each row")


def is_plain_table(database: sqlite3.Connection, name: str) -> bool:
    """Whether a name is that of a table: no stored query, and no virtual one."""
    row = database.execute("SELECT rootpage FROM sqlite_master WHERE type = 'table' AND name = ?", (name,)).fetchone()
    return row is not None and bool(row[0])  # a virtual table has no pages of its own


@contextmanager
def limited_steps(database: sqlite3.Connection, most: int) -> Iterator[None]:
    """Within it, queries are interrupted (sqlite3.OperationalError) after so many instructions altogether."""
    left = most // _STEPS_A_CALL

    def spent() -> bool:
        nonlocal left
        left -= 1
        return left < 0

    database.set_progress_handler(spent, _STEPS_A_CALL)
    try:
        yield
    finally:
        database.set_progress_handler(None, 0)


@lru_cache(maxsize=64)
def _check(path: Path, state: tuple[int, ...]) -> None:  # noqa: ARG001 (a file that has changed is checked again)
    size = path.stat().st_size
    with closing(sqlite3.connect(f"file:{quote(str(path))}?mode=ro", uri=True)) as database:
        database.execute("PRAGMA trusted_schema = OFF")
        database.execute("PRAGMA ignore_check_constraints = ON")
        database.setlimit(sqlite3.SQLITE_LIMIT_LENGTH, max(size, 1_000_000))
        (schema_bytes,) = database.execute("SELECT total(length(sql)) FROM sqlite_master").fetchone()
        if schema_bytes > MAX_SCHEMA_BYTES:
            raise ValueError(f"its tables are described in {schema_bytes:,.0f} bytes")
        entries = database.execute("SELECT type, name, sql, rootpage FROM sqlite_master").fetchall()
        tables = [str(name) for kind, name, _, _ in entries if kind == "table"]
        for kind, name, sql, root_page in entries:
            if kind == "table" and not root_page:
                found = _MODULE.match(str(sql))
                module = found[1] if found is not None else "?"
                if module.lower() != _SPATIAL_INDEX:
                    raise ValueError(f"it has the virtual table '{name}' of the module '{module}'")
        for name in tables:
            columns = database.execute("SELECT name, hidden FROM pragma_table_xinfo(?)", (name,)).fetchall()
            computed = [column for column, hidden in columns if hidden in _GENERATED]
            if computed:
                raise ValueError(f"its table '{name}' computes the column '{computed[0]}'")
        _check_pages(database)
        _check_views(database, [str(name) for kind, name, _, _ in entries if kind == "view"])


def _check_pages(database: sqlite3.Connection) -> None:
    """Pages that a tree holds twice make a small file endless."""
    for (line,) in database.execute("PRAGMA quick_check(100)"):
        if _BROKEN_TREE.search(line):
            raise ValueError(f"it is damaged ({' '.join(str(line).split())[:120]})")


def _check_views(database: sqlite3.Connection, views: list[str]) -> None:
    def permission(action: int, _table: str | None, name: str | None, *_: str | None) -> int:
        if action in (sqlite3.SQLITE_SELECT, sqlite3.SQLITE_READ):
            return sqlite3.SQLITE_OK
        known = action == sqlite3.SQLITE_FUNCTION and name is not None and name.lower() in _VIEW_FUNCTIONS
        return sqlite3.SQLITE_OK if known else sqlite3.SQLITE_DENY

    if not views:
        return
    database.set_authorizer(permission)
    with limited_steps(database, MAX_VIEW_STEPS):
        for name in views:
            quoted = name.replace('"', '""')
            try:
                for _ in database.execute(f'SELECT * FROM "{quoted}"'):  # noqa: S608 (quoted)
                    pass
            except sqlite3.DatabaseError as error:
                raise ValueError(f"its stored query '{name}' does not end soon, or is not allowed ({error})") from None
