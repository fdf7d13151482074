"""Arrays that grow with the recording, in nameless files instead of memory.

The system writes their pages out as it needs the memory, and takes the file back with the array. The room is reserved
first: a full disk is an error when the array is made, not a signal that ends the process when it is written to.
"""

from __future__ import annotations

import ctypes
import mmap
import os
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import cache
from math import prod
from pathlib import Path
from typing import IO, Any, Final, Literal

import numpy as np
from numpy.typing import DTypeLike, NDArray

LARGE: Final = 8 << 20
"""Arrays of fewer bytes stay in memory."""
PART: Final = 1 << 15
"""So many rows are worked on together where what is made of them on the way would be large."""
_ZEROS: Final = bytes(1 << 20)

_folders: list[Path] = []
"""Folders in force, the innermost last."""


@contextmanager
def scratch_in(folder: Path) -> Iterator[None]:
    """Within it, scratch files are made in a folder; else in the system's, which may be kept in memory."""
    _folders.append(folder)
    try:
        yield
    finally:
        _folders.pop()


def scratch_file() -> IO[bytes]:
    """A nameless file; the system takes it back when it is closed and no array maps it.

    Raises:
        OSError: if it cannot be made.
    """
    return tempfile.TemporaryFile(prefix="furrowmap-", dir=_folders[-1] if _folders else None)


def zeros(shape: int | tuple[int, ...], dtype: DTypeLike = np.float64, order: Literal["C", "F"] = "C") -> NDArray[Any]:
    """An array of zeros, in a file if it is LARGE.

    Raises:
        OSError: if the disk has no room for it.
    """
    size = prod(shape if isinstance(shape, tuple) else (shape,)) * np.dtype(dtype).itemsize
    if size < LARGE:
        return np.zeros(shape, dtype, order)
    with scratch_file() as file:
        _reserve(file, size)
        mapped = mmap.mmap(file.fileno(), size)
    return np.ndarray(shape, dtype, mapped, order=order)


def full(shape: int | tuple[int, ...], value: float, dtype: DTypeLike = np.float64) -> NDArray[Any]:
    """An array of one value, as :func:`zeros`."""
    out = zeros(shape, dtype)
    out[...] = value
    return out


def copied(array: NDArray[Any]) -> NDArray[Any]:
    """A copy with the same order in memory, as :func:`zeros`."""
    out = zeros(array.shape, array.dtype, "F" if array.flags.f_contiguous and not array.flags.c_contiguous else "C")
    out[...] = array
    return out


def parts(rows: int, most: int | None = None) -> Iterator[slice]:
    """Slices of at most `most` rows, by default PART, in their order."""
    length = most or PART
    return (slice(begin, min(begin + length, rows)) for begin in range(0, rows, length))


def release() -> None:
    """Give memory that is free back to the system: glibc keeps what lies between blocks that are still used."""
    if (trim := _trim()) is not None:
        trim(0)


@cache
def _trim() -> Callable[[int], int] | None:
    """The C library's function; None where it has none, as on macOS, Windows and with musl."""
    try:
        found: Callable[[int], int] = ctypes.CDLL(None).malloc_trim
    except (AttributeError, OSError, TypeError):
        return None
    return found


def _reserve(file: IO[bytes], size: int) -> None:
    """Take room for `size` zeros on the disk."""
    if hasattr(os, "posix_fallocate"):
        os.posix_fallocate(file.fileno(), 0, size)
        return
    for begin in range(0, size, len(_ZEROS)):
        file.write(_ZEROS[: size - begin])
    file.flush()
