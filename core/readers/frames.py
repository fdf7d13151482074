"""Messages of fixed layout out of a stream of bytes in which anything may stand between them."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from furrowmap.core.readers.source import Source

CHUNK_BYTES: Final = 1 << 22

Scan = Callable[[NDArray[np.uint8], bool], tuple[NDArray[np.int64], NDArray[np.int64], int]]
"""Finds intact frames in a piece of a stream: ``scan(data, last)`` → frames (n, 3) int64 with their kind, where their
content begins and its length; counts (3,) of :data:`BAD`, :data:`CUT` and :data:`BYTES`; bytes done with. Unless the
stream ends here, an unfinished frame at the end is left for the next piece."""

BAD, CUT, BYTES = range(3)


@dataclass
class Tally:
    """What a stream held, counted.

    Attributes:
        kinds: intact frames by their kind.
        bad_checksums: frames whose checksum is wrong.
        cut: frames that begin, and do not end before the stream does.
        frame_bytes: bytes of intact frames.
        stream_bytes: all bytes.
    """

    kinds: Counter[int] = field(default_factory=Counter)
    bad_checksums: int = 0
    cut: int = 0
    frame_bytes: int = 0
    stream_bytes: int = 0

    @property
    def intact(self) -> int:
        """Number of intact frames."""
        return self.kinds.total()

    @property
    def other_bytes(self) -> int:
        """Bytes of the stream that belong to no intact frame."""
        return self.stream_bytes - self.frame_bytes


@dataclass(frozen=True)
class Records:
    """The frames of one kind.

    Attributes:
        values: (n,) structured, one record a frame, in the order in which they stand.
        at: (n,) int64, where in the stream their content begins.
    """

    values: NDArray[np.void]
    at: NDArray[np.int64]

    def __len__(self) -> int:
        return len(self.at)

    def __getitem__(self, index: NDArray[np.bool_] | NDArray[np.intp]) -> Records:
        """Some of them."""
        return Records(self.values[index], self.at[index])

    def column(self, name: str, factor: float = 1.0) -> NDArray[np.float64]:
        """A field (n,) as float64, times `factor`."""
        return self.values[name].astype(np.float64) * factor


def read_records(
    source: Source, scan: Scan, wanted: Mapping[int, np.dtype[np.void]], tally: Tally, base: int = 0
) -> dict[int, list[Records]]:
    """The frames of the wanted kinds in a stream, piece by piece; `tally` grows on the way.

    Args:
        source: the stream, from where it stands.
        scan: finds the frames.
        wanted: what the content of a kind begins with; frames that are shorter count as damaged.
        tally: takes the counts.
        base: added to every :attr:`Records.at`.
    """
    found: dict[int, list[Records]] = {kind: [] for kind in wanted}
    rest = b""
    while True:
        block = source.read(CHUNK_BYTES)
        tally.stream_bytes += len(block)
        data = np.frombuffer(rest + block, np.uint8)
        frames, counts, used = scan(data, not block)
        kinds, times = np.unique(frames[:, 0], return_counts=True)
        tally.kinds.update(dict(zip(kinds.tolist(), times.tolist(), strict=True)))
        tally.bad_checksums += int(counts[BAD])
        tally.cut += int(counts[CUT])
        tally.frame_bytes += int(counts[BYTES])
        for kind, layout in wanted.items():
            mine = frames[frames[:, 0] == kind]
            short = mine[:, 2] < layout.itemsize
            tally.bad_checksums += int(short.sum())
            if not short.all():
                begin = mine[~short, 1]
                content = data[begin[:, None] + np.arange(layout.itemsize)]
                found[kind].append(Records(content.view(layout).ravel(), begin + base))
        if not block:
            return found
        base += used
        rest = (rest + block)[used:]


def joined(parts: list[Records], layout: np.dtype[np.void]) -> Records:
    """The records of several pieces, one after the other."""
    if not parts:
        return Records(np.empty(0, layout), np.empty(0, np.int64))
    return Records(np.concatenate([p.values for p in parts]), np.concatenate([p.at for p in parts]))


def layout(size: int, **columns: tuple[int, str]) -> np.dtype[np.void]:
    """A little-endian record of `size` bytes, of which the columns ``name=(offset, format)`` are read."""
    described: Any = {
        "names": list(columns),
        "offsets": [offset for offset, _ in columns.values()],
        "formats": [f"<{kind}" for _, kind in columns.values()],
        "itemsize": size,
    }
    packed: np.dtype[np.void] = np.dtype(described)
    return packed


def paired(key: NDArray[np.int64], other: NDArray[np.int64]) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Index pairs (into `key`, into `other`) of equal values: for each of `key` the last one of `other`."""
    if not len(other) or not len(key):
        return np.empty(0, np.intp), np.empty(0, np.intp)
    order = np.argsort(other, kind="stable")
    at = np.searchsorted(other[order], key, side="right") - 1
    equal = (at >= 0) & (other[order][at] == key)
    return np.flatnonzero(equal), order[at[equal]]


def at_equal(key: NDArray[np.int64], other: NDArray[np.int64], values: NDArray[np.float64]) -> NDArray[np.float64]:
    """`values` (m,) of `other` (m,) at the equal ones of `key` (n,); nan where there is none."""
    out = np.full(len(key), np.nan)
    row, of = paired(key, other)
    out[row] = values[of]
    return out
