"""Messages of a fixed layout in a stream of frames, as tables."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, Final, Generic, TypeVar

import numpy as np
from numpy.typing import NDArray

from furrowmap.core.readers.framing import Framing, find_frames
from furrowmap.core.readers.source import Source

MESSAGE_CHUNK_BYTES: Final = 1 << 22


Kind = TypeVar("Kind")


@dataclass
class MessageCounts(Generic[Kind]):
    """Counts over a stream of messages.

    Attributes:
        kinds: intact messages by kind.
        bad: messages with a wrong checksum or length.
        cut: messages that are not complete.
        message_bytes: bytes that belong to messages.
        foreign_bytes: bytes of no known protocol.
    """

    kinds: Counter[Kind] = field(default_factory=Counter)
    bad: int = 0
    cut: int = 0
    message_bytes: int = 0
    stream_bytes: int = 0
    foreign_bytes: int = 0

    @property
    def intact(self) -> int:
        """Number of intact messages."""
        return self.kinds.total()

    @property
    def other_bytes(self) -> int:
        """Bytes that belong to no message."""
        return self.stream_bytes - self.message_bytes


@dataclass(frozen=True)
class Messages:
    """Messages of one kind, in the order of the stream.

    Attributes:
        values: (n,) structured, one record a message.
        at: (n,) int64, offset of their content in the stream.
    """

    values: NDArray[np.void]
    at: NDArray[np.int64]

    def __len__(self) -> int:
        return len(self.at)

    def __getitem__(self, index: NDArray[np.bool_] | NDArray[np.intp]) -> Messages:
        """Some of the messages."""
        return Messages(self.values[index], self.at[index])

    def column(self, name: str, factor: float = 1.0) -> NDArray[np.float64]:
        """A field (n,) as float64, times `factor`."""
        with np.errstate(invalid="ignore"):  # damaged content may be a signalling NaN
            return self.values[name].astype(np.float64) * factor

    @classmethod
    def joined(cls, parts: list[Messages], layout: np.dtype[np.void]) -> Messages:
        """The messages of several pieces of a stream, one piece after the other."""
        if not parts:
            return cls(np.empty(0, layout), np.empty(0, np.int64))
        return cls(np.concatenate([p.values for p in parts]), np.concatenate([p.at for p in parts]))


def read_messages(
    source: Source, framing: Framing, layouts: Mapping[int, np.dtype[np.void]], counts: MessageCounts[int]
) -> dict[int, list[Messages]]:
    """The messages of some kinds in a stream from its current position, piece by piece.

    Args:
        layouts: by kind, what the content of a message begins with; a shorter content counts as damaged.
        counts: of the streams before, if there are any; updated. Their lengths are added to :attr:`Messages.at`.
    """
    found: dict[int, list[Messages]] = {kind: [] for kind in layouts}

    def scan(piece: bytes, base: int, last: bool) -> int:
        data = np.frombuffer(piece, np.uint8)
        frames = find_frames(data, framing, last=last)
        kinds, times = np.unique(frames.kind, return_counts=True)
        counts.kinds.update(dict(zip(kinds.tolist(), times.tolist(), strict=True)))
        counts.bad += frames.bad
        counts.cut += frames.cut
        counts.message_bytes += frames.intact_bytes
        counts.foreign_bytes += frames.foreign
        for kind, layout in layouts.items():
            of_kind = frames.kind == kind
            whole = of_kind & (frames.length >= layout.itemsize)
            counts.bad += int(of_kind.sum() - whole.sum())
            if whole.any():
                begin = frames.at[whole]
                content = data[begin[:, None] + np.arange(layout.itemsize)]
                found[kind].append(Messages(content.view(layout).ravel(), begin + base))
        return frames.used

    scan_stream(source, counts, scan)
    return found


def scan_stream(source: Source, counts: MessageCounts[Any], scan: Callable[[bytes, int, bool], int]) -> None:
    """Scan a stream from its current position, piece by piece; its length is added to `counts.stream_bytes`.

    Args:
        scan: is called with the bytes that are not done with, their offset in all streams, and whether the stream ends
            with them; returns how many of them are done with.
    """
    base, rest = counts.stream_bytes, b""
    while True:
        block = source.read(MESSAGE_CHUNK_BYTES)
        counts.stream_bytes += len(block)
        piece = rest + block
        used = scan(piece, base, not block)
        if not block:
            return
        base += used
        rest = piece[used:]


def layout(size: int, **columns: tuple[int, str]) -> np.dtype[np.void]:
    """A little-endian record of `size` bytes with the fields ``name=(offset, format)``."""
    described: Any = {
        "names": list(columns),
        "offsets": [offset for offset, _ in columns.values()],
        "formats": [f"<{kind}" for _, kind in columns.values()],
        "itemsize": size,
    }
    packed: np.dtype[np.void] = np.dtype(described)
    return packed


def paired(key: NDArray[np.int64], other: NDArray[np.int64]) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Index pairs (into `key`, into `other`) of equal values: each of `key` with the last equal one of `other`."""
    if not len(other) or not len(key):
        return np.empty(0, np.intp), np.empty(0, np.intp)
    order = np.argsort(other, kind="stable")
    at = np.searchsorted(other[order], key, side="right") - 1
    equal = (at >= 0) & (other[order][at] == key)
    return np.flatnonzero(equal), order[at[equal]]


def at_equal(key: NDArray[np.int64], other: NDArray[np.int64], values: NDArray[np.float64]) -> NDArray[np.float64]:
    """`values` (m,) joined from `other` (m,) to `key` (n,) where the two are equal; nan elsewhere."""
    out = np.full(len(key), np.nan)
    row, of = paired(key, other)
    out[row] = values[of]
    return out
