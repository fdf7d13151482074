"""Frames of a binary protocol in a stream of bytes: synchronisation, header with a length, content, checksum.

One scanner finds the frames of UBX (u-blox, interface description of the ZED-F9P, "UBX frame structure") and of SBF
(Septentrio, SBF reference guide, "SBF block header format"), which differ only in a :class:`Framing`.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final, NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

FLETCHER, CRC = 0, 1
"""Checksums: Fletcher's of 8 bits (RFC 1145), which ends a frame and covers all behind its synchronisation; CRC-CCITT
(polynomial 1021 hexadecimal, initial value 0), which follows the synchronisation and covers all behind itself."""
_POLYNOMIAL: Final = 0x1021
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
        length: (n,) int64, its length as the frame states it.
        bad: frames with a wrong checksum or an invalid length.
        cut: frames that are not complete where the stream ends.
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
    ones: a hostile file cannot make the scanner read the same bytes many times.

    Args:
        last: whether the stream ends with this piece; else an unfinished frame at its end is left for the next one.
    """
    rows = np.empty((len(data) // (framing.extra + framing.least) + 1, 3), np.int64)
    n, bad, cut, used = _find(data, framing, last, rows)
    kind, at, length = rows[:n].T.copy()
    begins = at - framing.content_at
    ends = begins + framing.extra + length
    behind = int(ends[-1]) if n else 0
    if not last and used - behind < _MAX_RTCM_BYTES:
        used = behind  # the next piece may complete an RTCM message
    foreign = _foreign(data, np.append(0, ends), np.append(begins, max(used, behind)))
    return FoundFrames(kind, at, length, bad, cut, int((ends - begins).sum()), foreign, used)


@njit(cache=True, nogil=True)
def _find(data: Any, framing: Any, last: Any, rows: Any) -> tuple[int, int, int, int]:
    """Fill `rows` with kind, offset and length; number of rows, bad frames, cut frames, and bytes done with."""
    size = len(data)
    table = _crc_table()
    running = _running_fletcher(data) if framing.checksum == FLETCHER else _running_crc(data, table)
    shift = _crc_shift(table)
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


@njit(cache=True, nogil=True)
def _foreign(data: Any, begins: Any, ends: Any) -> int:
    """Number of bytes in the spans that are neither text nor in a message of RTCM 3, and not 0 or 255 (padding)."""
    foreign = 0
    for k in range(len(begins)):
        i: Any = begins[k]
        while i < ends[k]:
            c = data[i]
            if c == _RTCM and i + 3 <= ends[k] and data[i + 1] < 4:
                after = i + 6 + (np.int64(data[i + 1]) << 8 | np.int64(data[i + 2]))
                if after <= ends[k]:
                    i = after
                    continue
            foreign += not (32 <= c <= 126 or c in (0, 9, 10, 13, 255))
            i += 1
    return foreign


@njit(cache=True, nogil=True)
def _word(data: Any, low_at: Any, high_at: Any) -> Any:
    return np.int64(data[low_at]) | np.int64(data[high_at]) << 8


@njit(cache=True, nogil=True)
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


@njit(cache=True, nogil=True)
def _fletcher(running: Any, begin: Any, stop: Any) -> Any:
    """The checksum of a span: each byte before it counts once in the first sum, and once a byte in the second."""
    before, after = np.int64(running[begin]), np.int64(running[stop])
    one = (after - before) & 255
    two = ((after >> 8) - (before >> 8) - (stop - begin) * (before & 255)) & 255
    return one | two << 8


@njit(cache=True, nogil=True)
def _crc_table() -> Any:
    table = np.zeros(256, np.int64)
    for value in range(256):
        crc = value << 8
        for _ in range(8):
            crc = ((crc << 1) ^ _POLYNOMIAL) & 0xFFFF if crc & 0x8000 else crc << 1
        table[value] = crc
    return table


@njit(cache=True, nogil=True)
def _running_crc(data: Any, table: Any) -> Any:
    """The CRC (k + 1,) over the first bytes, for each number of bytes."""
    running = np.zeros(len(data) + 1, np.uint16)
    crc = 0
    for k in range(len(data)):
        crc = ((crc << 8) & 0xFFFF) ^ table[(crc >> 8) ^ np.int64(data[k])]
        running[k + 1] = crc
    return running


@njit(cache=True, nogil=True)
def _crc_shift(table: Any) -> Any:
    """X to the power of 8 n modulo the polynomial, for each n up to the longest frame: appends n bytes to a CRC."""
    shift = np.zeros(_MAX_CRC_BYTES + 1, np.int64)
    shift[0] = 1
    for n in range(_MAX_CRC_BYTES):
        shift[n + 1] = ((shift[n] << 8) & 0xFFFF) ^ table[shift[n] >> 8]
    return shift


@njit(cache=True, nogil=True)
def _product(a: int, b: int) -> int:
    """Product of two polynomials over GF(2), modulo that of the CRC."""
    out = 0
    while b:
        if b & 1:
            out ^= a
        b >>= 1
        a = ((a << 1) ^ _POLYNOMIAL) & 0xFFFF if a & 0x8000 else a << 1
    return out
