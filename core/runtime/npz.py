"""NumPy archives of anybody, whose sizes are checked before memory is taken for them."""

import math
import zipfile
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.lib import format as npy
from numpy.typing import NDArray

from furrowmap.core.runtime.memory import expect_growth, expect_memory
from furrowmap.core.runtime.plain_reads import expect_plain_file

MAX_ARRAYS: Final = 1000


def read_npz(path: Path) -> dict[str, NDArray[Any]]:
    """The arrays of an archive by name; those of objects are refused.

    Raises:
        OSError: if the file cannot be opened.
        ValueError: if it is no such archive, or damaged.
        RefusedError: if its content is implausibly large for the file, or takes more than half of the free memory.
    """
    try:
        expect_plain_file(path)
        archive = zipfile.ZipFile(path)
    except (zipfile.BadZipFile, NotImplementedError, UnicodeDecodeError) as error:
        raise ValueError(str(error)) from None
    with archive:
        entries = archive.infolist()
        size = sum(entry.file_size for entry in entries)
        expect_growth(path, path.stat().st_size, size)
        expect_memory(path, size)
        if len(entries) > MAX_ARRAYS:
            raise ValueError(f"{len(entries):,} arrays")
        return {entry.filename.removesuffix(".npy"): _array(archive, entry) for entry in entries}


def _array(archive: zipfile.ZipFile, entry: zipfile.ZipInfo) -> NDArray[Any]:
    """An array, once its header agrees with the size of its data."""
    try:
        with archive.open(entry) as stream:
            version = npy.read_magic(stream)
            read_header = npy.read_array_header_1_0 if version == (1, 0) else npy.read_array_header_2_0
            shape, fortran_order, kind = read_header(stream)
            count = math.prod(shape)
            data = b"" if kind.hasobject else stream.read(min(count * kind.itemsize, entry.file_size))
        values = np.frombuffer(data, kind, count)  # an error, if these are fewer
    except Exception as error:  # noqa: BLE001 (zipfile, zlib and NumPy's parser of headers raise whatever comes)
        raise ValueError(f"{entry.filename}: {error}") from None
    return values.reshape(shape, order="F" if fortran_order else "C")
