"""Files that are written in their places: logs, locks and databases. No link at their names is followed."""

import os
import stat
from collections.abc import Iterable
from pathlib import Path
from typing import IO, Final

from furrowmap.core.runtime.errors import InputError
from furrowmap.core.runtime.file_names import leads_out

_NO_FOLLOW: Final = getattr(os, "O_NOFOLLOW", 0)
_NO_WAIT: Final = getattr(os, "O_NONBLOCK", 0)
_BINARY: Final = getattr(os, "O_BINARY", 0)
_DATABASE_SUFFIXES: Final = ("", "-journal", "-wal", "-shm")
"""Of the files that SQLite keeps beside each other."""


def create_new(path: Path) -> int:
    """The descriptor of a new file; raises FileExistsError if anything has that name, be it a link to nothing."""
    return os.open(path, os.O_CREAT | os.O_EXCL | os.O_WRONLY | _NO_FOLLOW | _BINARY, 0o644)


def append_to(path: Path) -> IO[bytes]:
    """A log, opened or made, to which each write appends.

    Raises InputError if its name is that of a link, of a file with other names (hard links), or of anything else than a
    regular file: appending would change another file, or wait for ever.
    """
    return os.fdopen(_open_plain(path, os.O_WRONLY | os.O_APPEND), "ab")


def open_lock(path: Path) -> int:
    """The descriptor of a file to lock, made if it does not exist; raises InputError as :func:`append_to` does."""
    return _open_plain(path, os.O_RDWR)


def refuse_special(path: Path) -> None:
    """Check that nothing, a regular file or a link to one has the name of a file that will be replaced.

    A link is replaced itself, what it leads to is not changed. Raises InputError for a folder, a pipe, a socket or a
    device, and for a link to one.
    """
    if os.path.lexists(path) and path.exists() and not path.is_file():
        raise _no_plain_file(path)


def refuse_unlike_products(folder: Path, names: Iterable[str]) -> None:
    """Check that nothing but files of the folder have the names of products, which later are read under these names.

    A run leaves what it does not replace. Raises InputError for links that lead out, and as :func:`refuse_special`.
    """
    for name in names:
        refuse_special(folder / name)
        if leads_out(folder / name, folder):
            raise _no_plain_file(folder / name)


def refuse_dangling(path: Path) -> None:
    """Check that a database, which may be a link to one elsewhere, is no link to nothing: it would be made there."""
    if path.is_symlink() and not path.exists():
        raise _no_plain_file(path)


def refuse_shared(path: Path) -> None:
    """Check that a database which is changed in its place is nobody else's file, nor are those beside it.

    Raises InputError for links, files with other names (hard links), and what is no regular file.
    """
    for suffix in _DATABASE_SUFFIXES:
        part = path.with_name(path.name + suffix)
        if os.path.lexists(part) and not _is_plain(part.lstat()):
            raise _no_plain_file(part)


def _open_plain(path: Path, flags: int) -> int:
    try:
        descriptor = os.open(path, flags | os.O_CREAT | _NO_FOLLOW | _NO_WAIT | _BINARY, 0o644)
    except OSError:
        # The system's word for it differs by what is there: a loop, a folder, no reader.
        if os.path.lexists(path) and not _is_plain(path.lstat()):
            raise _no_plain_file(path) from None
        raise
    if _is_own(descriptor, path):
        return descriptor
    os.close(descriptor)
    raise _no_plain_file(path)


def _is_own(descriptor: int, path: Path) -> bool:
    """Whether an open file is a plain one of that name: Windows opens what a link leads to."""
    opened = os.fstat(descriptor)
    try:
        return _is_plain(opened) and os.path.samestat(opened, path.lstat())
    except FileNotFoundError:  # another process has removed it since
        return _is_plain(opened)


def _is_plain(status: os.stat_result) -> bool:
    return stat.S_ISREG(status.st_mode) and status.st_nlink <= 1


def _no_plain_file(path: Path) -> InputError:
    return InputError(
        "output-no-file",
        path=path,
        link=path.is_symlink(),
        folder=path.is_dir(),
        names=path.is_file(),
    )
