"""What must hold of each command, whatever it was given."""

from __future__ import annotations

import json
import os
import sqlite3
import stat
import sys
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import closing
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

import rasterio

from furrowmap.core.runtime.errors import FurrowmapError
from furrowmap.core.runtime.languages.texts import LANGUAGES
from tests.fuzz_sessions.commands import NAMES_FILES
from tests.fuzz_sessions.place import Listing, Place

STATUSES: Final = frozenset({0, 1, 2, 3, 4})
FAULTS: Final = ("Traceback (most recent call last)", "Exception ignored in", "This is a bug", "Exception in thread",
                 "Fatal Python error", "\\x1b[31mNo such message")  # fmt: skip
"""What must not stand on standard output or standard error."""
MOST_BYTES: Final = 300 << 20
"""Products of recordings of half a megabyte."""
CHANGES: Final = frozenset({"os.remove", "os.rmdir", "os.mkdir", "os.link", "os.truncate", "os.chmod", "os.rename"})
_WRITES: Final = os.O_WRONLY | os.O_RDWR | os.O_CREAT | os.O_TRUNC


@dataclass
class Watch:
    """Sees what Python writes anywhere on the machine, and connections that it asks for.

    Attributes:
        allowed: the folders that may be written to.
        seen: events elsewhere.
    """

    allowed: tuple[str, ...] = ()
    seen: list[str] = field(default_factory=list)

    def __call__(self, event: str, arguments: tuple[Any, ...]) -> None:
        """As a hook of audits."""
        if not self.allowed:
            return
        if event == "open":
            if isinstance(arguments[2], int) and arguments[2] & _WRITES:
                self._look(event, arguments[0])
        elif event in CHANGES:
            if isinstance(arguments[-1], int) and arguments[-1] >= 0 and event != "os.chmod":
                return  # relative to a folder that is open, as rmtree does: the listing sees it
            for path in arguments[:2] if event in ("os.rename", "os.link") else arguments[:1]:
                self._look(event, path)
        elif event in ("socket.connect", "socket.bind", "socket.getaddrinfo"):
            self.seen.append(f"{event} {arguments[1:]}")

    def _look(self, event: str, path: object) -> None:
        if isinstance(path, str | bytes | os.PathLike):
            whole = Path(os.fsdecode(path))
            place = f"{os.path.realpath(whole.parent)}/{whole.name}"
            if not place.startswith(self.allowed) and "/__pycache__/" not in place:
                self.seen.append(f"{event} {place}")


WATCH: Final = Watch()


def own_folders() -> tuple[str, ...]:
    """What furrowmap itself writes elsewhere: compiled kernels, compiled modules, nothing."""
    return (os.devnull, os.path.realpath(os.environ["NUMBA_CACHE_DIR"]), sys.prefix, "/proc/self/")


def faults(
    line: Sequence[str], status: int, error: FurrowmapError | None, said: tuple[str, str], raised: str
) -> Iterator[tuple[str, str]]:
    """What is wrong with the end of a command, by kind: its status, its three lines, what it printed."""
    out, err = said
    if status not in STATUSES:
        yield "status", f"exit status {status}"
    if error is not None:
        yield from _error_faults(line, status, error, raised)
    for text in FAULTS:
        for stream in (out, err):
            if text in stream:
                yield "printed", stream[stream.index(text) :][:2000]
    if "--json" in line and status == 0 and line[0] != "live":  # which prints a line for each scan
        try:
            json.loads(out, parse_constant=_no_constant)
        except ValueError as unread:
            yield "json", f"{unread}: {out[:500]}"
    for code in ("fault", "out-of-memory", "worker-lost"):
        if f'"code": "{code}"' in out:
            yield "exception", out[out.index(f'"code": "{code}"') :][:1500]


def _error_faults(line: Sequence[str], status: int, error: FurrowmapError, raised: str) -> Iterator[tuple[str, str]]:
    if error.code in ("fault", "cancelled", "system"):
        yield "exception" if error.code == "fault" else error.code, f"{error}\n{raised}"
    if error.code == "out-of-memory":
        yield "memory", f"{error}\n{raised}"
    if error.code.endswith("worker-lost"):
        yield "crash", f"{error}"
    if status != error.exit_status or status == 0:
        yield "status", f"exit status {status} with {error.code}"
    for language in [one for one in LANGUAGES if one in line] or LANGUAGES[:1]:
        lines = error.lines_in(language)
        if len(lines) != 3 or not all(one.strip() for one in lines):
            yield "lines", f"{error.code} has {lines}"
        if any(not character.isprintable() for one in lines for character in one):
            yield "lines", f"{error.code} prints control characters: {lines!r}"


def _no_constant(name: str) -> None:
    raise ValueError(f"{name} is no JSON")


def changes(place: Place, before: Listing, after: Listing, *, failed: bool) -> Iterator[tuple[str, str]]:
    """What a command changed that it must not: anything outside of the output, and, where it failed, inside."""
    for name in before.keys() | after.keys():
        if before.get(name) == after.get(name):
            continue
        how = "made" if name not in before else "removed" if name not in after else "changed"
        path = Path(name)
        if path.parent == place.temporary:
            yield "left", f"temporary file {path.name}"
        elif not place.may_change(path):
            if not (how == "made" and after[name][0] == stat.S_IFDIR and path in place.out.parents):
                yield "outside", f"{how} {path.relative_to(place.root)}"
        elif failed and path != place.out and how != "made":
            yield "half-written", f"{how} {path.relative_to(place.root)} by a command that failed"
        elif ".furrowmap-run-" in str(path) and how == "made":
            yield "left", f"{path.relative_to(place.root)}"


def products(before: Listing, after: Listing) -> Iterator[tuple[str, str]]:
    """What is wrong with new files of a command that succeeded."""
    total = 0
    for name, state in after.items():
        if before.get(name) == state or state[0] != stat.S_IFREG:
            continue
        path = Path(name)
        size = path.stat().st_size
        total += size
        try:
            if path.suffix == ".json":
                json.loads(path.read_text(encoding="utf-8"), parse_constant=_no_constant)
            elif path.suffix == ".tif":
                with rasterio.open(path) as raster:
                    raster.read(1, out_shape=(8, 8))
            elif path.suffix == ".gpkg":
                with closing(sqlite3.connect(f"file:{path}?mode=ro".replace("#", "%23"), uri=True)) as base:
                    assert base.execute("PRAGMA quick_check").fetchone() == ("ok",)
            elif path.suffix == ".laz":
                with path.open("rb") as file:
                    assert file.read(4) == b"LASF"
            elif path.suffix == ".html":
                path.read_text(encoding="utf-8")
        except Exception as unread:  # noqa: BLE001
            yield "product", f"{path.name}: {unread!r}"
    if total > MOST_BYTES:
        yield "large", f"{total} bytes of products"


def opened(place: Place, names: Sequence[str], line: Sequence[str]) -> Iterator[tuple[str, str]]:
    """Files outside that were opened; the aim of links may be, by a command that was given the link."""
    aim = os.path.realpath(place.outside / "linked")
    is_given = line[0] in NAMES_FILES or any(os.path.realpath(word) == aim for word in line)
    for name in sorted(set(names)):
        if not (name == "linked" and is_given):
            yield "opened", f"{place.outside.name}/{name}"


def temporary_folder(place: Place) -> None:
    """Let this process write its temporary files there."""
    tempfile.tempdir = str(place.temporary)
    for name in ("TMPDIR", "TMP", "TEMP", "CPL_TMPDIR"):
        os.environ[name] = str(place.temporary)
