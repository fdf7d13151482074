"""Files that are written whole or not at all."""

import os
import re
import secrets
import sys
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager, suppress
from functools import partial
from pathlib import Path
from typing import Final

from furrowmap.core.runtime.errors import FurrowmapError, InputError, RefusedError
from furrowmap.core.runtime.file_names import resolved
from furrowmap.core.runtime.write_errors import failed_write, write_error, writing
from furrowmap.exporters.files.lease import is_staged
from furrowmap.exporters.files.owner import PATTERN, Owner, machine
from furrowmap.exporters.files.plain_files import refuse_special

_UNFINISHED: Final = re.compile(rf"\.furrowmap-({PATTERN})-[0-9a-f]{{8}}\b.*", re.DOTALL)

_AT_A_TIME: Final = 8
"""Files that are flushed at a time: the file system writes its journal once for all that wait."""

_HELD_S: Final = 3.0 if sys.platform == "win32" else 0.0
"""Virus scanners and indexers hold new files for moments, in which Windows does not rename them."""


def make_folder(folder: Path) -> None:
    """Make a folder for products, if it does not exist. Raises InputError or WriteError if that is not possible."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise unwritable(folder, error) from error


@contextmanager
def made_folder(folder: Path) -> Iterator[None]:
    """As :func:`make_folder`; a folder in which nothing was made, and those made above it, are removed again."""
    created = [place for place in (folder, *folder.parents) if not place.exists()]
    try:
        make_folder(folder)
        yield
    finally:
        for place in created:
            with suppress(OSError):  # not empty
                place.rmdir()


def unwritable(folder: Path, error: OSError) -> FurrowmapError:
    """The error of a folder that cannot be made or written to."""
    if failed_write(error) is not None:
        return write_error(folder, error)
    return InputError("output-unwritable", folder=folder, strerror=error.strerror or error)


@contextmanager
def atomic_output(path: Path, *, durable: bool = True) -> Iterator[Path]:
    """Write a file beside `path` and rename it to `path` at the end; its folder is made if it does not exist.

    The file is flushed to the disk, unless it need not be `durable`, and replaces an older one in one step. If the work
    is interrupted, it is removed and `path` is unchanged. A link at `path` is replaced, what it leads to is unchanged.
    Files that a killed process of this machine left in the folder are removed first. In a staging folder nothing is
    flushed here: its files are, together, before they become products.

    Yields the path to write to: hidden, in the same folder, short, with the last suffix of `path`; nothing has that
    name. Other files that a library creates under a name that begins the same are removed at the end. Raises InputError
    if `path` is a folder, pipe, socket or device; RefusedError if another program has it open, on Windows.
    """
    refuse_special(path)
    with made_folder(path.parent):
        remove_abandoned(path.parent)
        with _replacing(path, flushed=durable and not is_staged(path)) as unfinished:
            yield unfinished


@contextmanager
def _replacing(path: Path, *, flushed: bool) -> Iterator[Path]:
    unfinished = _free_name(path)
    try:
        with writing(path):
            yield unfinished
            if flushed:
                flush(unfinished)
            try:
                move(unfinished, path)
            except PermissionError:
                raise RefusedError("output-open", path=path) from None
            if flushed:
                flush_folder(path.parent)
    finally:
        for left in path.parent.iterdir():
            if left.name.startswith(unfinished.name):
                with suppress(OSError):
                    left.unlink()


def _free_name(path: Path) -> Path:
    """A name for the unfinished file that nothing has, not even a link to nothing, and that nobody can guess."""
    while True:
        name = f".furrowmap-{Owner.here().words()}-{secrets.token_hex(4)}{path.suffix[:16]}"
        if not os.path.lexists(path.with_name(name)):
            return path.with_name(name)


def refuse_existing(path: Path, *, overwrite: bool) -> None:
    """Check, before the work, that the output does not exist or may be replaced; InputError for a pipe or device."""
    if not path.is_dir():  # which may be that of an output of several files
        refuse_special(path)
    if os.path.lexists(path) and not overwrite:
        raise RefusedError("output-exists.existing-file", path=path)


def move(source: Path, target: Path) -> None:
    """Rename a file, replacing another; raises PermissionError if a program keeps one of them open, on Windows."""
    _while_held(partial(source.replace, target))


def refuse_open(files: Iterable[Path]) -> None:
    """Check that no other program keeps files from being replaced, as Windows does with open ones."""
    for path in files:
        if path.is_file():
            try:
                _while_held(partial(path.rename, path))
            except PermissionError:
                raise RefusedError("output-open", path=path) from None
            except OSError:  # a file system that refuses to rename a file to its own name
                pass


def _while_held(rename: Callable[[], object]) -> None:
    until = time.monotonic() + _HELD_S
    while True:
        try:
            rename()
        except PermissionError:
            if time.monotonic() >= until:
                raise
            time.sleep(0.05)
        else:
            return


def relative_path(path: Path, start: Path) -> str | None:
    """`path` relative to the folder `start`, with slashes; None where it is on another drive of Windows."""
    try:
        return Path(os.path.relpath(resolved(path), resolved(start))).as_posix()
    except ValueError:
        return None


def remove_abandoned(folder: Path) -> None:
    """Remove the unfinished files in `folder` whose process, on this machine, has ended."""
    for left in folder.iterdir():
        match = _UNFINISHED.fullmatch(left.name)
        owner = Owner.parse(match[1]) if match else None
        if owner is None or owner.machine != machine() or owner == Owner.here():
            continue
        if owner.is_running() is False:
            with suppress(OSError):
                left.unlink()


def remove_unfinished(folder: Path) -> None:
    """Remove what ended processes, of any machine, left in a folder and those below; nothing may be writing there."""
    for left in folder.rglob(".furrowmap-*"):
        if _UNFINISHED.fullmatch(left.name):
            with suppress(OSError):
                left.unlink()


def flush(path: Path) -> None:
    """Let the content of a file survive a loss of power."""
    with path.open("rb+") as file:
        os.fsync(file.fileno())


def flush_together(files: Sequence[Path]) -> None:
    """Let the content and the names of files survive a loss of power; a disk takes many at a time."""
    with ThreadPoolExecutor(_AT_A_TIME, "flush") as pool:
        list(pool.map(flush, files))
    for folder in {file.parent for file in files}:
        flush_folder(folder)


def flush_folder(folder: Path) -> None:
    """Let the new name survive a loss of power; only POSIX opens folders."""
    if sys.platform != "win32":
        descriptor = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(descriptor)
        finally:
            os.close(descriptor)
