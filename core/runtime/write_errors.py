"""Failed writes: which file it was, how much space was free there, and what to do.

Few libraries name the file, and GDAL, SQLite and LAZ hide that the disk was full. The innermost :func:`writing` knows
the file, and looks at the disk before anything is removed.
"""

import errno
import os
import re
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Final

from furrowmap.core.runtime.errors import Cancelled, FurrowmapError, InputError, Notice
from furrowmap.core.runtime.file_names import resolved
from furrowmap.core.runtime.memory import size_text
from furrowmap.core.runtime.settings import settings

UNFINISHED_PREFIX: Final = ".furrowmap-"
"""How the names of unfinished files and folders begin."""
_FULL: Final = (errno.ENOSPC, errno.EDQUOT)
_OF_WRITES: Final = (*_FULL, errno.EROFS, errno.EFBIG)
"""Errors of the system that nothing but writing raises."""
_REFUSED: Final = (*_OF_WRITES, errno.EIO, errno.ENAMETOOLONG, errno.EACCES, errno.EPERM, None)
"""Errors of writing; None is that of numpy, which does not pass the system's on."""
_LIBRARIES: Final = ("laspy", "lazrs", "pyogrio", "pyarrow", "rasterio", "sqlite3", "zipfile")
"""Packages whose errors on a full disk are not system errors."""
_FULL_WORDS: Final = re.compile(r"no space left|disk is full|not enough (?:free )?space|disk quota", re.IGNORECASE)
_NOTHING_LEFT_BYTES: Final = 1 << 20
"""With less free space, an error of a library that was writing is that of a full disk."""


class WriteError(FurrowmapError):
    """A file cannot be written."""


@contextmanager
def writing(path: Path, needed_bytes: int | None = None) -> Iterator[None]:
    """Within it, what cannot be written is an error that names `path` and the free space there.

    Errors of the system that name other files, such as one that is read, are not changed, nor are any where `path` is
    an unfinished file: whoever renames it knows its name.

    Args:
        path: the file.
        needed_bytes: space that it takes, if known.
    """
    if path.name.startswith(UNFINISHED_PREFIX):
        yield
        return
    try:
        yield
    except OSError as error:
        name = _written_name(error)
        if error.errno in _OF_WRITES or (error.errno in _REFUSED and (name is None or _is_unfinished(name))):
            raise write_error(path, error, needed_bytes) from error
        if name is None or _is_unfinished(name):
            error.filename = str(path)
        raise
    except Exception as error:
        if type(error).__module__.partition(".")[0] not in _LIBRARIES:
            raise
        raise write_error(path, error, needed_bytes) from error


@contextmanager
def writing_scratch(needed_bytes: int | None = None, folder: Path | None = None) -> Iterator[None]:
    """Within it, what cannot be written to a temporary file is an error that names its folder.

    The folder is by default that of :func:`~furrowmap.core.runtime.settings.settings`, or the system's.
    """
    try:
        yield
    except OSError as error:
        name = _written_name(error)
        place = folder or settings().scratch_folder or temporary_folder()
        if error.errno in _OF_WRITES or name is None or Path(os.fsdecode(name)).is_relative_to(place):
            raise _scratch_error(error, needed_bytes, folder) from error
        raise


@contextmanager
def scratch_directory() -> Iterator[Path]:
    """A temporary folder, removed at the end; what is written there is to be written within :func:`writing_scratch`."""
    with writing_scratch():
        made = tempfile.TemporaryDirectory(prefix="furrowmap-", dir=temporary_folder(), ignore_cleanup_errors=True)
    with made as name:
        yield Path(name)


def temporary_folder() -> Path:
    """The folder of temporary files. Raises WriteError if none can be used."""
    try:
        return Path(tempfile.gettempdir())
    except OSError as error:
        raise WriteError("not-written.no-temporary-folder", strerror=error.strerror or error) from None


def temporary_elsewhere() -> Notice | None:
    """That temporary files were written to another folder than the environment states; None where none were, too."""
    named = ((name, os.environ.get(name)) for name in ("TMPDIR", "TEMP", "TMP"))  # as tempfile looks for it
    variable, stated = next(((name, folder) for name, folder in named if folder), ("", ""))
    used = tempfile.tempdir
    if not stated or used is None or resolved(Path(stated)) == resolved(Path(used)):
        return None
    return Notice("temporary-elsewhere", used=used, stated=stated, variable=variable)


def write_error(path: Path, error: BaseException, needed_bytes: int | None = None) -> WriteError:
    """That a file cannot be written, with the free space there."""
    place = temporary_folder() if _fills_temporary_folder(error, path) else path
    return _not_written(place, error, needed_bytes, temporary=place is not path)


def as_furrowmap_error(raised: BaseException) -> FurrowmapError:
    """Any exception as an error with a remedy."""
    if isinstance(raised, FurrowmapError):
        return raised
    if isinstance(raised, KeyboardInterrupt):
        return Cancelled()
    if isinstance(raised, MemoryError):
        return FurrowmapError("out-of-memory")
    if isinstance(raised, OSError) and raised.errno == errno.ELOOP and raised.filename is not None:
        return InputError("circular-links", path=raised.filename)
    if isinstance(raised, OSError) and raised.errno in _OF_WRITES and _written_name(raised) is not None:
        return write_error(Path(os.fsdecode(_written_name(raised) or "")), raised)
    failed = failed_write(raised)
    if failed is not None and _is_full(free_bytes(temporary_folder())):
        return _scratch_error(failed, None, None)
    if failed is not None:
        return WriteError("not-written.somewhere", reason=getattr(failed, "strerror", None) or failed)
    if isinstance(raised, OSError) and raised.strerror:
        return FurrowmapError(
            "system",
            filename=raised.filename or None,
            strerror=raised.strerror if raised.filename else None,
            raised_strerror=raised.strerror if not (raised.filename) else None,
        )
    return FurrowmapError("fault", name=type(raised).__name__, raised=raised)


def failed_write(raised: BaseException, place: Path | None = None) -> BaseException | None:
    """The error of a failed write among those that led to an exception; None where it has another cause.

    An error of a library counts as one where a disk is full: that of `place`, or of temporary files.
    """
    seen: list[BaseException] = []
    error: BaseException | None = raised
    while error is not None and error not in seen:
        seen.append(error)
        if _says_full(error) or (isinstance(error, OSError) and error.errno in _OF_WRITES):
            return error
        error = error.__cause__ or error.__context__
    if type(raised).__module__.partition(".")[0] not in (*_LIBRARIES, "builtins"):
        return None
    places = [temporary_folder(), *([place] if place is not None else [])]
    return raised if any(_is_full(free_bytes(one)) for one in places) else None


def shown_path(name: str | bytes | Path) -> Path:
    """A path without the hidden folders of a run, which no user knows: a file in them is named as its product."""
    path = Path(os.fsdecode(name))
    hidden = [place for place in (path, *path.parents) if place.name.startswith(UNFINISHED_PREFIX)]
    if not hidden:
        return path
    folder, *rest = hidden[-1].parent, *path.relative_to(hidden[-1]).parts[1:]
    return folder.joinpath(*rest)


def free_bytes(path: Path) -> int | None:
    """Free space of the disk where `path` is or will be; None where the system does not say."""
    for place in (path.absolute(), *path.absolute().parents):
        try:
            return shutil.disk_usage(place).free
        except (FileNotFoundError, NotADirectoryError):
            continue
        except OSError:
            return None
    return None


def _not_written(path: Path, error: BaseException, needed_bytes: int | None, *, temporary: bool = False) -> WriteError:
    free = free_bytes(path)
    is_full = _says_full(error) or ((not isinstance(error, OSError) or error.errno is None) and _is_full(free))
    reason = error.strerror if isinstance(error, OSError) and error.strerror else f"{type(error).__name__}: {error}"
    return WriteError(
        "not-written.temporary" if temporary else "not-written",
        path=shown_path(path),
        full=is_full,
        reason=str(reason).rstrip("."),
        free=size_text(free) if free is not None else None,
        needed=size_text(needed_bytes) if needed_bytes else None,
    )


def _scratch_error(error: BaseException, needed_bytes: int | None, folder: Path | None) -> WriteError:
    place = folder or settings().scratch_folder
    if place is None:
        return _not_written(temporary_folder(), error, needed_bytes, temporary=True)
    return _not_written(place, error, needed_bytes)


def _fills_temporary_folder(error: BaseException, path: Path) -> bool:
    """Whether a write failed by lack of space that is not lacking where the file is, but for temporary files."""
    if isinstance(error, OSError) and error.errno is not None and error.errno not in _FULL:
        return False
    return not _is_full(free_bytes(path)) and _is_full(free_bytes(temporary_folder()))


def _says_full(error: BaseException) -> bool:
    if isinstance(error, OSError) and error.errno is not None:
        return error.errno in _FULL
    return _FULL_WORDS.search(str(error)) is not None


def _is_full(free: int | None) -> bool:
    return free is not None and free < _NOTHING_LEFT_BYTES


def _is_unfinished(name: str | bytes) -> bool:
    return UNFINISHED_PREFIX in os.fsdecode(name)


def _written_name(error: OSError) -> str | bytes | None:
    """The file that an error names as the one written: of two, as in copying, the second."""
    name = error.filename2 or error.filename
    return None if isinstance(name, int) else name
