"""Arrays that grow with the recording: large ones lie in nameless files instead of memory.

The system writes their pages out as it needs the memory, and takes the file back with the array. The room is reserved
first: a full disk is an error when the array is made, not a signal that ends the process when it is written to.
"""

import ctypes
import mmap
import os
import sys
import tempfile
import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import fields
from math import prod
from pathlib import Path
from typing import IO, Any, Final, Literal, TypeAlias, cast
from weakref import WeakSet

import numpy as np
from numpy.typing import DTypeLike, NDArray

from furrowmap.core.runtime.settings import settings
from furrowmap.core.runtime.write_errors import writing_scratch

FloatArray: TypeAlias = NDArray[np.float64]
Float32Array: TypeAlias = NDArray[np.float32]
IntArray: TypeAlias = NDArray[np.int64]
BoolArray: TypeAlias = NDArray[np.bool_]
LARGE: Final = 32 << 20
"""Arrays of fewer bytes stay in memory; so large ones malloc takes from the system each for itself."""
ROWS_AT_ONCE: Final = 1 << 15
"""Rows that are computed together where intermediate results would be large."""
RESIDENT_FILES: Final = 400 << 20
"""Bytes of mapped files in memory during a run, half of which are libraries."""
RELEASE_S: Final = 0.1
_mapped: WeakSet[mmap.mmap] = WeakSet()
"""Files of arrays in use."""


def scratch_file(buffering: int = -1) -> IO[bytes]:
    """A nameless file, taken back when it is closed and no array maps it. Raises WriteError if it cannot be made.

    `buffering` in bytes, as of `open`.
    """
    with writing_scratch():
        return tempfile.TemporaryFile(buffering=buffering, prefix="furrowmap-", dir=settings().scratch_folder)


def zeros(shape: int | tuple[int, ...], dtype: DTypeLike = np.float64, order: Literal["C", "F"] = "C") -> NDArray[Any]:
    """An array of zeros, in a file if it is LARGE. Raises WriteError if the disk has no room for it."""
    size = prod(shape if isinstance(shape, tuple) else (shape,)) * np.dtype(dtype).itemsize
    if size < LARGE:
        return np.zeros(shape, dtype, order)
    with scratch_file() as file, writing_scratch(size):
        if hasattr(os, "posix_fallocate"):
            os.posix_fallocate(file.fileno(), 0, size)
        else:
            for begin in range(0, size, 1 << 20):
                file.write(bytes(min(1 << 20, size - begin)))
            file.flush()
        mapped = mmap.mmap(file.fileno(), size)
    _mapped.add(mapped)
    return np.ndarray(shape, dtype, mapped, order=order)


def of_file(file: IO[bytes], shape: int | tuple[int, ...], dtype: DTypeLike) -> NDArray[Any]:
    """The content of a scratch file as an array; the file may be closed."""
    mapped = mmap.mmap(file.fileno(), 0)
    _mapped.add(mapped)
    return np.ndarray(shape, dtype, mapped)


def taken(array: NDArray[Any], part: slice) -> NDArray[Any]:
    """A copy of some rows, whose pages in a file no longer count as memory of the process."""
    out = np.array(array[part])
    base = cast("Any", array.base)
    if sys.platform != "win32" and isinstance(base, mmap.mmap) and len(out):
        begin = part.start * array.strides[0] // mmap.PAGESIZE * mmap.PAGESIZE
        base.madvise(mmap.MADV_DONTNEED, begin, min(part.stop, len(array)) * array.strides[0] - begin)
    return out


def first(array: NDArray[Any], rows: int) -> NDArray[Any]:
    """The first rows, for which :func:`taken` does the same."""
    base = cast("Any", array.base)
    if not rows or not isinstance(base, mmap.mmap):
        return array[:rows]
    return np.ndarray((rows, *array.shape[1:]), array.dtype, base)


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
    """Slices of at most `most` rows, by default ROWS_AT_ONCE, in their order."""
    length = most or ROWS_AT_ONCE
    return (slice(begin, min(begin + length, rows)) for begin in range(0, rows, length))


def in_parts(work: Callable[[slice], Sequence[NDArray[Any]]], rows: int) -> list[NDArray[Any]]:
    """The arrays that `work` gives for a slice of rows, computed part by part and put together as :func:`zeros`."""
    out: list[NDArray[Any]] = []
    for part in parts(rows) if rows else [slice(0, 0)]:
        found = work(part)
        out = out or [zeros((rows, *one.shape[1:]), one.dtype) for one in found]
        for whole, one in zip(out, found, strict=True):
            whole[part] = one
    return out


def concatenated(pieces: Sequence[NDArray[Any]]) -> NDArray[Any]:
    """Arrays of one type behind each other, as :func:`zeros`."""
    rows = sum(len(piece) for piece in pieces)
    return np.concatenate(pieces, out=zeros((rows, *pieces[0].shape[1:]), pieces[0].dtype))


def release_files() -> None:
    """Let the system take back the pages of arrays in files, which count as memory of the process; none is lost."""
    if sys.platform != "win32":
        for mapped in list(_mapped):
            mapped.madvise(mmap.MADV_DONTNEED)


@contextmanager
def keeping_files_out() -> Iterator[None]:
    """Within it a thread calls :func:`release_files` whenever mapped files take more than :data:`RESIDENT_FILES`."""
    ended = threading.Event()

    def watch() -> None:
        pages = Path("/proc/self/statm")  # of Linux alone
        while pages.exists() and not ended.wait(RELEASE_S):
            if int(pages.read_text(encoding="ascii").split()[2]) * mmap.PAGESIZE > RESIDENT_FILES:
                with suppress(RuntimeError):  # another array is being made: next time
                    release_files()

    thread = threading.Thread(target=watch, name="keeping files out", daemon=True)
    thread.start()
    try:
        yield
    finally:
        ended.set()
        thread.join()


def release() -> None:
    """Give memory that is free back to the system: glibc keeps what lies between blocks that are still used."""
    with suppress(AttributeError, OSError, TypeError):  # macOS, Windows and musl have no such function
        ctypes.CDLL(None).malloc_trim(0)


def three(xyz: FloatArray) -> tuple[float, float, float]:
    """Coordinates (3,) as a tuple."""
    return float(xyz[0]), float(xyz[1]), float(xyz[2])


def check_columns(value: Any, increasing: str = "t_s", **widths: int) -> None:
    """Check that a dataclass holds a table: each of its arrays has n rows, and one column strictly increases.

    `widths` are those of arrays (n, width); all others are (n,). Attributes that are no arrays are ignored. ValueError
    if not.
    """
    kind = type(value).__name__
    column = getattr(value, increasing)
    for name in (field.name for field in fields(value)):
        array = getattr(value, name)
        shape = (len(column), *([widths[name]] if name in widths else []))
        if isinstance(array, np.ndarray) and array.shape != shape:
            raise ValueError(f"{kind}.{name} has shape {array.shape}, not {shape}")
    if len(column) > 1 and not bool(np.all(np.diff(column) > 0)):
        raise ValueError(f"{kind}.{increasing} does not increase")
