"""Records that memory does not hold, kept on disk so that those of neighbouring cells come back together."""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from furrowmap.exporters.cloud.cube import sorted_order
from furrowmap.exporters.cloud.records import Records, gathered

SLICE: Final = 1_000_000
"""Records written in one go: what is sorted beside those in memory."""


@dataclass
class Block:
    """Records sorted by cell, as they stand in the file one after another.

    Attributes:
        codes: (k,) of the cells that occur, never falling.
        starts: (k + 1,) where the records of each begin, in records from the file's start; last, where the block ends.
    """

    codes: NDArray[np.int64]
    starts: NDArray[np.int64]

    def segment(self, first: int, end: int) -> tuple[int, int]:
        """Where the records of the cells from `first` up to but without `end` stand."""
        i, j = np.searchsorted(self.codes, [first, end])
        return int(self.starts[i]), int(self.starts[j])


class Spool:
    """A nameless file of blocks that is gone when it is closed or its process ends.

    Args:
        folder: where it lies.
    """

    def __init__(self, folder: Path) -> None:
        self._file = tempfile.TemporaryFile(dir=folder)  # noqa: SIM115  # closed with the spool
        self._blocks: list[Block] = []
        self._length = 0

    def close(self) -> None:
        """Give the disk's space back."""
        self._file.close()

    def add(self, records: Records, codes: NDArray[np.uint32], counts: NDArray[np.int64]) -> None:
        """Append a block.

        Args:
            records: (n,) in any order.
            codes: (n,) the cell of each.
            counts: records in each cell.
        """
        order = sorted_order(codes, counts)
        for start in range(0, len(records), SLICE):
            self._file.write(gathered(records, order[start : start + SLICE]).data)
        there = np.flatnonzero(counts)
        starts = self._length + np.concatenate([[0], np.cumsum(counts[there])])
        self._blocks.append(Block(there, starts))
        self._length += len(records)

    def put_into_octant(self, octant: int, depth: int) -> None:
        """Rename the cells after their cube became one of the eight of another that is divided as often."""
        for block in self._blocks:
            block.codes = (octant << 3 * (depth - 1)) | (block.codes >> 3)

    def parts(self, first: int, end: int, room: Callable[[], Records]) -> Iterator[Records]:
        """The records of the cells from `first` up to but without `end`, in parts.

        Each part is put into what `room` gives; no block may be longer.
        """
        buffer, held = room(), 0
        for block in self._blocks:
            start, stop = block.segment(first, end)
            if held + stop - start > len(buffer):
                yield buffer[:held]
                buffer, held = room(), 0
            if stop > start:
                self._read(start, buffer[held : held + stop - start])
                held += stop - start
        if held:
            yield buffer[:held]

    def _read(self, start: int, into: Records) -> None:
        self._file.seek(start * into.dtype.itemsize)
        if self._file.readinto(into.view(np.uint8).data) != into.nbytes:
            raise OSError(f"the temporary file of {self._length} points is shorter than was written")
