"""Records of one layout in a temporary file, read back by integer key."""

import tempfile
import threading
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from types import TracebackType
from typing import Any, Final, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from furrowmap.core.runtime.arrays import IntArray
from furrowmap.core.runtime.write_errors import writing_scratch

RecordArray = NDArray[Any]
"""(n,) of a structured type, or (n, k) numbers of a sub-array type."""
Square = tuple[int, int]
"""Column and row."""

_OFFSET: Final = 1 << 30


def square_keys(column: ArrayLike, row: ArrayLike) -> IntArray:
    """Keys (n,) of squares by column and row, each within ±2³⁰; sorted by column, then row."""
    keys: IntArray = (np.asarray(column, np.int64) + _OFFSET << 32) + np.asarray(row, np.int64) + _OFFSET
    return keys


def square_of(key: int) -> Square:
    """Column and row of the square with a key."""
    return (key >> 32) - _OFFSET, (key & 0xFFFFFFFF) - _OFFSET


@dataclass
class _Block:
    """Increasing keys (k,) of records contiguous in the file, and the first record of each and the end (k + 1,)."""

    keys: IntArray
    starts: IntArray


class RecordSpool:
    """A temporary file of blocks, removed when it is closed or the process ends; a context manager.

    One thread may append; after the last append any number of threads may read, and overwrite what no other reads.
    """

    def __init__(self, layout: np.dtype[Any], folder: Path | None) -> None:
        self.layout = layout
        self._folder = folder
        with writing_scratch(folder=folder):
            self._file = tempfile.TemporaryFile(prefix="furrowmap-", dir=folder)  # noqa: SIM115  # closed with the spool
        self._lock = threading.Lock()
        self._blocks: list[_Block] = []
        self._length = 0

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """Remove the file."""
        self._file.close()

    def append(self, parts: Iterable[RecordArray], keys: IntArray, starts: IntArray) -> None:
        """Append a block of records, sorted by key, in any number of contiguous arrays.

        Keys (k,) increase; `starts` (k + 1,) are the first record of each within the block, and their number. OSError
        if the file cannot be written.
        """
        with writing_scratch(folder=self._folder):
            self._file.seek(self._length * self.layout.itemsize)
            for part in parts:
                self._file.write(part.data)
            self._file.flush()
        self._blocks.append(_Block(keys, self._length + starts))
        self._length += int(starts[-1])
        self.__dict__.pop("_segments", None)

    def add(self, records: RecordArray, keys: IntArray) -> None:
        """Append records (n,) in any order as a block, each under its key (n,); the order within a key is kept."""
        if len(records):
            # Numbers of two bytes are sorted digit by digit.
            lowest = int(keys.min())
            short = int(keys.max()) - lowest < 1 << 16
            order = np.argsort((keys - lowest).astype(np.uint16) if short else keys, kind="stable")
            keys = keys[order]
            first = np.flatnonzero(np.diff(keys, prepend=keys[0] - 1))
            self.append([records.take(order, axis=0)], keys[first], np.append(first, len(keys)))

    @property
    def counts(self) -> dict[int, int]:
        """Number of records of each key, keys increasing."""
        keys, _, counts = self._segments
        there, first = np.unique(keys, return_index=True)
        totals = np.add.reduceat(counts, first) if len(first) else counts
        return dict(zip(there.tolist(), totals.tolist(), strict=True))

    def read(self, keys: ArrayLike) -> RecordArray:
        """The records of keys (k,), key after key; within a key in the order in which they were added."""
        segments = self._segments_of(keys)
        out = np.empty(sum(count for _, count in segments), self.layout)
        done = 0
        for start, count in segments:
            self._read(start, out[done : done + count])
            done += count
        return out

    def read_fields(self, keys: ArrayLike) -> list[NDArray[Any]]:
        """As :meth:`read`, but each field of the records in an array of its own."""
        segments = self._segments_of(keys)
        fields = {
            name: np.empty(sum(count for _, count in segments), self.layout[name]) for name in self.layout.names or ()
        }
        done = 0
        for start, count in segments:
            self._read(start, records := np.empty(count, self.layout))
            for name, field in fields.items():
                field[done : done + count] = records[name]
            done += count
        return list(fields.values())

    def overwrite(self, keys: ArrayLike, records: RecordArray) -> None:
        """Replace the records that :meth:`read` returned for the same keys."""
        done = 0
        for start, count in self._segments_of(keys):
            with self._lock, writing_scratch(folder=self._folder):
                self._file.seek(start * self.layout.itemsize)
                self._file.write(records[done : done + count].data)
            done += count

    def parts(self, first: int, end: int, room: Callable[[], RecordArray]) -> Iterator[RecordArray]:
        """The records with keys from `first` to `end` − 1, block after block, in few large reads.

        Each part is read into an array from `room`, which must be as long as the longest block.
        """
        buffer = room()
        used = 0
        for block in self._blocks:
            start, stop = block.starts[np.searchsorted(block.keys, [first, end])].tolist()
            if used + stop - start > len(buffer):
                yield buffer[:used]
                buffer = room()
                used = 0
            if stop > start:
                self._read(start, buffer[used : used + stop - start])
                used += stop - start
        if used:
            yield buffer[:used]

    def shift_keys(self, bits: int, first: int) -> None:
        """Replace each key by ``first + (key >> bits)``; several may become one."""
        for block in self._blocks:
            block.keys = first + (block.keys >> bits)
        self.__dict__.pop("_segments", None)

    @cached_property
    def _segments(self) -> tuple[IntArray, IntArray, IntArray]:
        """Key, first record and number of records of each contiguous piece of the file, sorted by key."""
        nothing = np.zeros(0, np.int64)
        keys = np.concatenate([nothing, *(block.keys for block in self._blocks)])
        starts = np.concatenate([nothing, *(block.starts[:-1] for block in self._blocks)])
        counts = np.concatenate([nothing, *(np.diff(block.starts) for block in self._blocks)])
        order = np.argsort(keys, kind="stable")
        return keys[order], starts[order], counts[order]

    def _segments_of(self, keys: ArrayLike) -> list[tuple[int, int]]:
        """First record and number of records of the pieces that hold the records of keys."""
        there, starts, counts = self._segments
        wanted = np.asarray(keys, np.int64)
        pieces = zip(np.searchsorted(there, wanted), np.searchsorted(there, wanted, side="right"), strict=True)
        at = [k for first, end in pieces for k in range(first, end)]
        return list(zip(starts[at].tolist(), counts[at].tolist(), strict=True))

    def _read(self, start: int, into: RecordArray) -> None:
        with self._lock:
            self._file.seek(start * self.layout.itemsize)
            if self._file.readinto(into.view(np.uint8).data) != into.nbytes:
                raise OSError(f"the temporary file of {self._length:,} records is shorter than was written")
