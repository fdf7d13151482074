"""The state of a batch: what became of each session, in one SQLite file.

A row is written when a session has ended, in a transaction of its own, so that a killed batch has the rows of all that
had ended. The results themselves are the truth: a session without a row, whose result is there, is recognised by the
content of its inputs.
"""

import sqlite3
from collections.abc import Iterator, Mapping, Sequence
from contextlib import closing, contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final, Self

import msgspec

from furrowmap.core.runtime.errors import FurrowmapError, InputError
from furrowmap.core.runtime.json_text import from_kept_json, kept_json, plain
from furrowmap.core.runtime.languages.texts import LANGUAGES
from furrowmap.core.runtime.write_errors import failed_write, write_error
from furrowmap.exporters.files.plain_files import refuse_shared

STATE: Final = ".batch.sqlite"
_STATE_VERSION: Final = 1


@dataclass(frozen=True)
class Stamp:
    """A file when it was read: time of its last change in ns or ETag in a store, SHA-256, empty where not read."""

    path: str
    bytes: int
    mark: str
    sha256: str = ""


def same_files(some: Sequence[Stamp], others: Sequence[Stamp]) -> bool:
    """Whether files are the same, unchanged, whether or not their content was read."""
    plain = [{(one.path, one.bytes, one.mark) for one in stamps} for stamps in (some, others)]
    return plain[0] == plain[1]


@dataclass(frozen=True)
class Failure:
    """The error that ended a session.

    Attributes:
        lines: in English.
        exit_status: that of `furrowmap run`.
        other_lines: in other languages; those of earlier versions are in English alone.
    """

    code: str
    lines: tuple[str, str, str]
    exit_status: int
    other_lines: dict[str, tuple[str, str, str]] = field(default_factory=dict)

    @classmethod
    def from_error(cls, error: FurrowmapError) -> Self:
        """From an error."""
        others = {language: error.lines_in(language) for language in LANGUAGES[1:]}
        return cls(error.code, error.lines, error.exit_status, others)

    def lines_in(self, language: str) -> tuple[str, str, str]:
        """What is wrong, what that means, and what to do."""
        return self.other_lines.get(language, self.lines)


@dataclass(frozen=True)
class SessionOutcome:
    """What became of a session.

    Attributes:
        key: of settings and version with which it ran.
        failure: the error that ended it; None for a session with a result.
        peak_mb: peak memory of the process that ran it, up to the end of the run.
        repeated: whether the result was there already and only looked at.
        figures: of the report, texts and numbers.
        footprint: hull of trajectory and worked ground in longitude and latitude, as hexadecimal WKB.
        track: the vehicle's path in longitude and latitude, as hexadecimal WKB.
    """

    key: str
    inputs: tuple[Stamp, ...] = ()
    failure: Failure | None = None
    seconds: float = 0.0
    processor_s: float = 0.0
    peak_mb: float = 0.0
    repeated: bool = False
    figures: dict[str, Any] = field(default_factory=dict)
    footprint: str = ""
    track: str = ""


class BatchState:
    """The rows of a state file."""

    def __init__(self, database: sqlite3.Connection) -> None:
        self._database = database

    def outcomes(self) -> dict[str, SessionOutcome]:
        """What became of each session, by its name."""
        rows = self._database.execute("SELECT name, outcome FROM sessions")
        return {name: from_kept_json(text, SessionOutcome) for name, text in rows}

    def sources(self) -> dict[str, str]:
        """The name of each session, by what it was made from."""
        return dict(self._database.execute("SELECT source, name FROM names").fetchall())

    def keep(self, name: str, outcome: SessionOutcome) -> None:
        """Keep what became of a session."""
        with self._database:
            row = (name, kept_json(outcome))
            self._database.execute("INSERT OR REPLACE INTO sessions VALUES (?, ?)", row)

    def keep_names(self, names: Mapping[str, str]) -> None:
        """Keep the names of sessions, by what they were made from."""
        with self._database:
            self._database.executemany("INSERT OR REPLACE INTO names VALUES (?, ?)", names.items())

    def prepared(self, source: str, key: str) -> bytes | None:
        """What was found in a source with that key of its content; None if nothing was kept."""
        found = self._database.execute("SELECT found FROM prepared WHERE source = ? AND key = ?", (plain(source), key))
        row = found.fetchone()
        return bytes(row[0]) if row is not None else None

    def keep_prepared(self, source: str, key: str, found: bytes) -> None:
        """Keep what was found in a source."""
        with self._database:
            self._database.execute("INSERT OR REPLACE INTO prepared VALUES (?, ?, ?)", (plain(source), key, found))

    def save_as(self, path: Path) -> None:
        """Write a copy that is whole while this file changes."""
        path.unlink(missing_ok=True)
        with closing(sqlite3.connect(path)) as copy:
            self._database.backup(copy)


@contextmanager
def batch_state(path: Path | None) -> Iterator[BatchState]:
    """The state in a file, made where missing; None if not kept. Raises InputError at a damaged or other version.

    Raises InputError as well for links at its names: it would change another file.
    """
    if path is not None:
        refuse_shared(path)
    try:
        with closing(sqlite3.connect(path if path is not None else ":memory:")) as database:
            _prepare(database)
            yield BatchState(database)
    except (sqlite3.DatabaseError, msgspec.DecodeError, msgspec.ValidationError) as error:
        if path is not None and failed_write(error, path.parent) is not None:
            raise write_error(path, error) from error
        raise InputError("batch-state", path=path, error=error) from None
    finally:
        if path is not None and path.is_file() and not path.stat().st_size:
            path.unlink()


def _prepare(database: sqlite3.Connection) -> None:
    (version,) = database.execute("PRAGMA user_version").fetchone()
    if version == _STATE_VERSION:
        return
    if version:
        raise sqlite3.DatabaseError(f"it has version {version}, not {_STATE_VERSION}")
    with database:
        database.execute("CREATE TABLE IF NOT EXISTS sessions (name TEXT PRIMARY KEY, outcome BLOB NOT NULL)")
        database.execute("CREATE TABLE IF NOT EXISTS names (source TEXT PRIMARY KEY, name TEXT NOT NULL)")
        database.execute(
            "CREATE TABLE IF NOT EXISTS prepared (source TEXT PRIMARY KEY, key TEXT NOT NULL, found BLOB NOT NULL)"
        )
        database.execute(f"PRAGMA user_version = {_STATE_VERSION}")
