"""Points with all that they carry, sorted into squares in a scratch file, and given back square by square."""

from __future__ import annotations

import tempfile
from collections.abc import Iterable
from pathlib import Path
from types import TracebackType
from typing import Any, Final, Self

import numpy as np
from numpy.typing import NDArray

Square = tuple[int, int]
Records = NDArray[Any]
"""(n,) of a structured type, or (n, k) numbers."""

_MIDDLE: Final = 1 << 31


def squares_of(place_m: NDArray[np.float64], side_m: float) -> NDArray[np.int64]:
    """Number of the square in which each place (n, 2) lies."""
    column, row = np.floor(place_m.T / side_m).astype(np.int64) + _MIDDLE
    numbers: NDArray[np.int64] = column << 32 | row
    return numbers


def square_of(number: int) -> Square:
    """Column and row, from the CRS's 0, of a square by its number."""
    return (number >> 32) - _MIDDLE, (number & 0xFFFFFFFF) - _MIDDLE


class RecordSpool:
    """Takes records of one kind, gives them back by square, in the order in which they came: a context manager.

    Memory is that of the records at hand; the scratch file, which has no name, takes what the records take.

    Args:
        kind: of the records.
        folder: for the scratch file.
        side_m: of the squares.
    """

    def __init__(self, kind: np.dtype[Any], folder: Path, side_m: float) -> None:
        self.kind, self.side_m = kind, side_m
        self.count: dict[Square, int] = {}
        """Records of each square that has any."""
        self._file = tempfile.TemporaryFile(prefix="furrowmap-", dir=folder)  # noqa: SIM115  # closed with the spool
        self._runs: dict[Square, list[tuple[int, int]]] = {}
        self._end = 0

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._file.close()

    def add(self, place_m: NDArray[np.float64], records: Records) -> None:
        """Take records (n,) that belong to these places (n, 2).

        Raises:
            OSError: if the scratch file cannot be written.
        """
        if not len(records):
            return
        numbers = squares_of(place_m, self.side_m)
        order = np.argsort(numbers, kind="stable")
        there, first = np.unique(numbers[order], return_index=True)
        self._file.seek(self._end)
        self._file.write(records[order].tobytes())
        for number, start, stop in zip(there.tolist(), first.tolist(), [*first[1:].tolist(), len(order)], strict=True):
            square = square_of(number)
            self._runs.setdefault(square, []).append((self._end + start * self.kind.itemsize, stop - start))
            self.count[square] = self.count.get(square, 0) + stop - start
        self._end += len(order) * self.kind.itemsize

    def read(self, squares: Iterable[Square]) -> Records:
        """The records of squares, one square after the other."""
        parts = [np.empty(0, self.kind)]
        for square in squares:
            for offset, count in self._runs.get(square, ()):
                self._file.seek(offset)
                parts.append(np.frombuffer(self._file.read(count * self.kind.itemsize), self.kind))
        return np.concatenate(parts)

    def write(self, squares: Iterable[Square], records: Records) -> None:
        """Put records in the place of those that :meth:`read` gave of the same squares."""
        done = 0
        for square in squares:
            for offset, count in self._runs.get(square, ()):
                self._file.seek(offset)
                self._file.write(records[done : done + count].tobytes())
                done += count
