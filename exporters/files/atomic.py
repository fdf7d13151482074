"""Files that are written whole or not at all."""

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
    """Write a file beside `path` and rename it to `path` at the end.

    The file is flushed to the disk and replaces an older one in one step. If the work is interrupted, it is removed and
    `path` is unchanged. Files that a killed process of this machine left in the folder are removed first.

    Yields:
        The path to write to: hidden, in the same folder, short, with the last suffix of `path`. Other files that a
        library creates under a name that begins the same are removed at the end.

    Raises:
        OSError: if the file cannot be written or renamed (another program may have it open).
    """
    remove_abandoned(path.parent)
    unfinished = path.with_name(f".furrowmap-{_host()}-{os.getpid()}-{secrets.token_hex(4)}{path.suffix[:16]}")
    try:
        yield unfinished
        _flush(unfinished)
        unfinished.replace(path)
        _flush_folder(path.parent)
    except OSError as error:
        error.filename = error.filename or str(path)  # a full disk does not name the file
        raise
    finally:
        for left in path.parent.iterdir():
            if left.name.startswith(unfinished.name):
                with suppress(OSError):
                    left.unlink()


def refuse_existing(path: Path, *, overwrite: bool) -> None:
    """Check, before the work, that the output does not exist or may be replaced.

    Raises:
        RefusedError: if it exists and `overwrite` is not given.
    """
    if path.exists() and not overwrite:
        raise RefusedError(
            f"{path} exists already.",
            "It would be replaced.",
            "Choose another name, or replace it with --overwrite.",
            code="output-exists",
        )


def relative_path(path: Path, start: Path) -> str | None:
    """`path` relative to the folder `start`, with slashes; None where it is on another drive of Windows."""
    try:
        return Path(os.path.relpath(path.resolve(), start.resolve())).as_posix()
    except ValueError:
        return None


def remove_abandoned(folder: Path) -> None:
    """Remove the unfinished files in `folder` whose process, on this machine, has ended."""
    for left in folder.iterdir():
        match = _UNFINISHED.fullmatch(left.name)
        if match and match["host"] == _host() and not is_running(int(match["process"])):
            with suppress(OSError):
                left.unlink()


def _host() -> str:
    return hashlib.sha256(platform.node().encode()).hexdigest()[:8]


def is_running(process: int) -> bool:
    """Whether a process of that number runs on this machine, as far as the system reports."""
    if process == os.getpid():
        return True
    if sys.platform == "win32":  # signal 0 would end it; but open files are not removed there
        return False
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return False
    except (OSError, OverflowError):  # of another user, or not a process number
        return True
    return True


def _flush(path: Path) -> None:
    with path.open("rb+") as file:
        os.fsync(file.fileno())


def _flush_folder(folder: Path) -> None:
    """Let the new name survive a loss of power; only POSIX opens folders."""
    if sys.platform != "win32":
        descriptor = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(descriptor)
        finally:
            os.close(descriptor)
