"""Files that are there whole or not at all."""

from __future__ import annotations

import hashlib
import os
import platform
import re
import secrets
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Final

from furrowmap.core.values.errors import RefusedError

_UNFINISHED: Final = re.compile(r"\.furrowmap-(?P<host>[0-9a-f]{8})-(?P<process>\d+)-[0-9a-f]{8}\b.*", re.DOTALL)


@contextmanager
def atomic_output(path: Path) -> Iterator[Path]:
    """Write a file beside `path` and put it there once it is whole.

    What is written under the name that is given out is flushed to the disk and renamed to `path`, taking the place of
    an older file in one step. If anything interrupts the work, it is removed and `path` stays as it was. Files that a
    killed process of this machine left in the same folder are removed first.

    Yields:
        The name to write to: hidden, in the same folder, short, with the last suffix of `path`. Whatever else a
        library puts beside it, under a name that begins the same, is removed in the end.

    Raises:
        OSError: if the file cannot be written, or cannot take its place (another program may hold it open).
    """
    remove_abandoned(path.parent)
    unfinished = path.with_name(f".furrowmap-{_host()}-{os.getpid()}-{secrets.token_hex(4)}{path.suffix[:16]}")
    try:
        yield unfinished
        _flush(unfinished)
        unfinished.replace(path)
        _flush_folder(path.parent)
    except OSError as error:
        error.filename = error.filename or str(path)  # a full disk does not say which file it had no room for
        raise
    finally:
        for left in path.parent.iterdir():
            if left.name.startswith(unfinished.name):
                with suppress(OSError):
                    left.unlink()


def refuse_existing(path: Path, *, overwrite: bool) -> None:
    """Keep what is there, unless it was asked to go; to be called before the work.

    Raises:
        RefusedError: if there is something, and nobody said `overwrite`.
    """
    if path.exists() and not overwrite:
        raise RefusedError(
            f"{path} is there already.",
            "It would be replaced, so nothing was done.",
            "Choose another name, or replace it with --overwrite.",
            code="output-exists",
        )


def remove_abandoned(folder: Path) -> None:
    """Remove the unfinished files in `folder` whose process, on this machine, is no more."""
    for left in folder.iterdir():
        match = _UNFINISHED.fullmatch(left.name)
        if match and match["host"] == _host() and not is_running(int(match["process"])):
            with suppress(OSError):
                left.unlink()


def _host() -> str:
    return hashlib.sha256(platform.node().encode()).hexdigest()[:8]


def is_running(process: int) -> bool:
    """Whether a process of this machine with that number is at work, as far as the system tells."""
    if process == os.getpid():
        return True
    if sys.platform == "win32":  # where a signal 0 would end it; but a file that somebody writes is not removed there
        return False
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return False
    except (OSError, OverflowError):  # it belongs to somebody else, or is no number of a process: not ours to judge
        return True
    return True


def _flush(path: Path) -> None:
    with path.open("rb+") as file:
        os.fsync(file.fileno())


def _flush_folder(folder: Path) -> None:
    """Let the new name itself survive a loss of power; only POSIX opens folders."""
    if sys.platform != "win32":
        descriptor = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(descriptor)
        finally:
            os.close(descriptor)
