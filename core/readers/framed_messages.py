"""Messages of a fixed layout in a stream of frames, as tables.

A frame is synchronisation, header with a length, content and checksum. One scanner finds the frames of UBX (u-blox,
interface description of the ZED-F9P, "UBX frame structure") and of SBF (Septentrio, SBF reference guide, "SBF block
header format"), which differ only in a :class:`Framing`.
"""

from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, Final, Generic, NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from furrowmap.core.readers.source import Source
from furrowmap.core.runtime.kernels import kernel
from furrowmap.core.runtime.memory import expect_rows

FLETCHER: Final = 0
CRC: Final = 1
"""Checksums: Fletcher's of 8 bits (RFC 1145), which ends a frame and covers all behind its synchronisation; CRC-CCITT
(polynomial 1021 hexadecimal, initial value 0), which follows the synchronisation and covers all behind itself."""
_POLYNOMIAL: Final = 0x1021
_CRC_TABLE: Final = np.arange(256) << 8
for _ in range(8):
    _CRC_TABLE[:] = (_CRC_TABLE << 1 ^ (_CRC_TABLE >> 15) * _POLYNOMIAL) & 0xFFFF
_MAX_CRC_BYTES: Final = 1 << 15
"""Bytes that a CRC covers at most, in any framing."""
_RTCM: Final = 0xD3
"""First byte of a message of RTCM 3: six zero bits, ten bits of length, the content and three bytes of CRC follow."""
_MAX_RTCM_BYTES: Final = 1029


class Framing(NamedTuple):
    """Where the parts of a frame are, as byte offsets from its start.

    Attributes:
        sync_1, sync_2: the first two bytes of a frame.
        kind_high_at, kind_low_at: offsets of the bytes with its kind.
        kind_mask: the bits of those that are used.
        length_at: offset of the length, 16 bits, little-endian.
        extra: bytes of a frame that its length does not count.
        least, most: the valid range of the length.
        multiple: the length is a multiple of this.
        content_at: offset of the content.
        checksum: :data:`FLETCHER` or :data:`CRC`.
    """

    sync_1: int
    sync_2: int
    kind_high_at: int
    kind_low_at: int
    kind_mask: int
    length_at: int
    extra: int
    least: int
    most: int
    multiple: int
    content_at: int
    checksum: int

    @property
    def sync(self) -> bytes:
        """The first two bytes of a frame."""
        return bytes((self.sync_1, self.sync_2))


@dataclass(frozen=True)
class FoundFrames:
    """The frames found in a piece of a stream.

    Attributes:
        kind: (n,) int64 of each intact frame.
        at: (n,) int64, offset of its content in the piece.
        bad: frames with a wrong checksum or an invalid length.
        intact_bytes: bytes of the intact frames.
        foreign: bytes between the frames that are neither text, nor messages of RTCM 3, nor padding.
        used: bytes of the piece that are done with; the rest belongs before the next piece.
    """

    kind: NDArray[np.int64]
    at: NDArray[np.int64]
    length: NDArray[np.int64]
    bad: int
    cut: int
    intact_bytes: int
    foreign: int
    used: int


def find_frames(data: NDArray[np.uint8], framing: Framing, *, last: bool = True) -> FoundFrames:
    """The intact frames in a piece of a stream, whatever is between them.

    Checking a frame takes the same time whatever length it claims, because its checksum is a difference of running
    ones: a hostile file cannot make the scanner read the same bytes many times. If the piece is not the last, an
    unfinished frame at its end is left for the next one.
    """
    rows = np.empty((len(data) // (framing.extra + framing.least) + 1, 3), np.int64)
    n, bad, cut, used = _find(data, framing, last, rows)
    kind, at, length = rows[:n].T.copy()
    begins = at - framing.content_at
    ends = begins + framing.extra + length
    behind = int(ends[-1]) if n else 0
    if not last and used - behind < _MAX_RTCM_BYTES:
        used = behind  # the next piece may complete an RTCM message
    foreign = count_foreign(data, np.stack([np.append(0, ends), np.append(begins, max(used, behind))], axis=1))
    return FoundFrames(kind, at, length, bad, cut, int((ends - begins).sum()), foreign, used)


@kernel()
def _find(data: Any, framing: Any, last: Any, rows: Any) -> tuple[int, int, int, int]:
    """Fill `rows` with kind, offset and length; number of rows, bad frames, cut frames, and bytes done with."""
    size = len(data)
    running = _running_fletcher(data) if framing.checksum == FLETCHER else _running_crc(data)
    shift = _crc_shift()
    n = 0
    bad = 0
    cut = 0
    i: Any = 0
    while i + 1 < size:
        if data[i] != framing.sync_1 or data[i + 1] != framing.sync_2:
            i += 1
            continue
        end: Any = size + 1
        length = 0
        at: Any = i + framing.length_at
        if at + 2 <= size:
            length = _word(data, at, at + 1)
            if length < framing.least or length > framing.most or length % framing.multiple:
                bad += 1
                i += 2
                continue
            end = i + framing.extra + length
        if end > size:
            if not last:
                return n, bad, cut, i
            cut += 1
            i += 2
            continue
        if framing.checksum == FLETCHER:
            at = end - 2
            found = _fletcher(running, i + 2, at)
        else:
            at = i + 2
            found = np.int64(running[end]) ^ _product(np.int64(running[i + 4]), shift[end - i - 4])
        if found != _word(data, at, at + 1):
            bad += 1
            i += 2
            continue
        rows[n, 0] = _word(data, i + framing.kind_low_at, i + framing.kind_high_at) & framing.kind_mask
        rows[n, 1] = i + framing.content_at
        rows[n, 2] = length
        n += 1
        i = end
    if i < size and not last and data[i] == framing.sync_1:
        return n, bad, cut, i
    return n, bad, cut, size


@kernel()
def count_foreign(data: Any, spans: Any) -> int:
    """Bytes in spans (n, 2) that are neither text nor in a message of RTCM 3, and not 0 or 255 (padding)."""
    foreign = 0
    for k in range(len(spans)):
        i = spans[k, 0]
        end = spans[k, 1]
        while i < end:
            c = data[i]
            if c == _RTCM and i + 3 <= end and data[i + 1] < 4:
                after = i + 6 + (np.int64(data[i + 1]) << 8 | np.int64(data[i + 2]))
                if after <= end:
                    i = after
                    continue
            foreign += not (32 <= c <= 126 or c in (0, 9, 10, 13, 255))
            i += 1
    return foreign


@kernel()
def _word(data: Any, low_at: Any, high_at: Any) -> Any:
    return np.int64(data[low_at]) | np.int64(data[high_at]) << 8


@kernel()
def _running_fletcher(data: Any) -> Any:
    """Both sums (k + 1,) over the first bytes, for each number of bytes: the first sum in the low byte."""
    running = np.zeros(len(data) + 1, np.uint16)
    one: Any = 0
    two: Any = 0
    for k in range(len(data)):
        one = (one + np.int64(data[k])) & 255
        two = (two + one) & 255
        running[k + 1] = one | two << 8
    return running


@kernel()
def _fletcher(running: Any, begin: Any, stop: Any) -> Any:
    """The checksum of a span: each byte before it counts once in the first sum, and once a byte in the second."""
    before = np.int64(running[begin])
    after = np.int64(running[stop])
    one = (after - before) & 255
    two = ((after >> 8) - (before >> 8) - (stop - begin) * (before & 255)) & 255
    return one | two << 8


@kernel()
def _running_crc(data: Any) -> Any:
    """The CRC (k + 1,) over the first bytes, for each number of bytes."""
    running = np.zeros(len(data) + 1, np.uint16)
    crc = 0
    for k in range(len(data)):
        crc = ((crc << 8) & 0xFFFF) ^ _CRC_TABLE[(crc >> 8) ^ np.int64(data[k])]
        running[k + 1] = crc
    return running


@kernel()
def _crc_shift() -> Any:
    """X to the power of 8 n modulo the polynomial, for each n up to the longest frame: appends n bytes to a CRC."""
    shift = np.zeros(_MAX_CRC_BYTES + 1, np.int64)
    shift[0] = 1
    for n in range(_MAX_CRC_BYTES):
        shift[n + 1] = ((shift[n] << 8) & 0xFFFF) ^ _CRC_TABLE[shift[n] >> 8]
    return shift


@kernel()
def _product(a: int, b: int) -> int:
    """Product of two polynomials over GF(2), modulo that of the CRC."""
    out = 0
    while b:
        if b & 1:
            out ^= a
        b >>= 1
        a = ((a << 1) ^ _POLYNOMIAL) & 0xFFFF if a & 0x8000 else a << 1
    return out


MESSAGE_CHUNK_BYTES: Final = 1 << 22


Kind = TypeVar("Kind")


@dataclass
class MessageCounts(Generic[Kind]):
    """Counts over a stream: messages by kind, those with a wrong checksum or length, bytes of no known protocol.

    `row_bytes` is the memory of what is kept of the messages, if that is more than their own bytes.
    """

    kinds: Counter[Kind] = field(default_factory=Counter)
    bad: int = 0
    cut: int = 0
    message_bytes: int = 0
    stream_bytes: int = 0
    foreign_bytes: int = 0
    row_bytes: int = 0

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
    """Messages (n,) of one kind in the order of the stream: a structured record each, and the offset of its content."""

    values: NDArray[np.void]
    at: NDArray[np.int64]

    def __len__(self) -> int:
        return len(self.at)

    def __getitem__(self, index: NDArray[np.bool_] | NDArray[np.intp]) -> "Messages":
        """Some of the messages."""
        return Messages(self.values[index], self.at[index])

    def column(self, name: str, factor: float = 1.0) -> NDArray[np.float64]:
        """A field (n,) as float64, times `factor`."""
        with np.errstate(invalid="ignore"):  # damaged content may be a signalling NaN
            return self.values[name].astype(np.float64) * factor

    @classmethod
    def joined(cls, parts: "list[Messages]", layout: np.dtype[np.void]) -> "Messages":
        """The messages of several pieces of a stream, one piece after the other."""
        if not parts:
            return cls(np.empty(0, layout), np.empty(0, np.int64))
        return cls(np.concatenate([p.values for p in parts]), np.concatenate([p.at for p in parts]))


def read_messages(
    source: Source, framing: Framing, layouts: Mapping[int, np.dtype[np.void]], counts: MessageCounts[int]
) -> dict[int, list[Messages]]:
    """The messages of some kinds in a stream from its current position, piece by piece; `counts` are updated.

    `layouts` are, by kind, what the content of a message begins with; a shorter content counts as damaged. The length
    of the streams before is added to :attr:`Messages.at`.
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

    `scan` is called with the bytes that are not done with, their offset in all streams, and whether the stream ends
    with them; it returns how many of them are done with.

    RefusedError if what is kept of the messages takes implausibly much memory for the size of the file.
    """
    base = counts.stream_bytes
    rest = b""
    kept_before = max(counts.row_bytes, counts.message_bytes)
    while True:
        block = source.read(MESSAGE_CHUNK_BYTES)
        counts.stream_bytes += len(block)
        piece = rest + block
        used = scan(piece, base, not block)
        kept = max(counts.row_bytes, counts.message_bytes) - kept_before
        expect_rows(source.path, source.size_bytes, kept)
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
