"""UDP datagrams in packet captures, classic pcap and pcapng, read block by block.

Formats: draft-ietf-opsawg-pcap (microseconds and nanoseconds, both byte orders) and draft-ietf-opsawg-pcapng; link
types as listed by the tcpdump group.
"""

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from ipaddress import IPv4Address
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from furrowmap.core.readers.pcap_walk import (
    CONTROL,
    DAMAGE,
    FRAGMENT,
    MAX_BLOCK,
    MAX_FRAMES,
    MORE,
    SKIPPED,
    credible,
    no_fragments,
    walk_pcap,
    walk_pcapng,
)
from furrowmap.core.readers.source import Head, Source
from furrowmap.core.runtime.arrays import FloatArray, IntArray
from furrowmap.core.runtime.errors import InputError, Notice

ByteArray = NDArray[np.uint8]

BLOCK_BYTES: Final = 1 << 21
"""Bytes that are read at a time."""

_PCAP_MAGIC: Final = {
    b"\xd4\xc3\xb2\xa1": (False, 1_000_000),
    b"\xa1\xb2\xc3\xd4": (True, 1_000_000),
    b"\x4d\x3c\xb2\xa1": (False, 1_000_000_000),
    b"\xa1\xb2\x3c\x4d": (True, 1_000_000_000),
}
_SECTION: Final = b"\x0a\x0d\x0d\x0a"
_MAX_INTERFACES: Final = 1 << 10
_END_OF_OPTIONS, _TIME_RESOLUTION, _TIME_OFFSET = 0, 9, 14


def capture_format(head: bytes) -> str:
    """The format of a capture by its first bytes: "pcap", "pcapng", or "" for none."""
    if head[:4] in _PCAP_MAGIC:
        return "pcap"
    if head[:4] == _SECTION and head[8:12] in (b"\x1a\x2b\x3c\x4d", b"\x4d\x3c\x2b\x1a"):
        return "pcapng"
    return ""


@dataclass(frozen=True)
class Datagrams:
    """UDP datagrams in one block of a capture.

    Attributes:
        data: (k,) the block's bytes, and after them those of datagrams that came in fragments.
        offset: (n,) where in `data` each payload begins.
        length: (n,) length of each payload in bytes.
        time_s: (n,) float64, time of capture: UTC by the recorder's clock.
        sender: (n,) uint64, IPv4 address times 65,536 plus destination port; a hash instead of an IPv6 address.
    """

    data: ByteArray
    offset: IntArray
    length: IntArray
    time_s: FloatArray
    sender: NDArray[np.uint64]

    def __len__(self) -> int:
        return len(self.offset)


class Capture:
    """A capture's datagrams in the order of the file, streamed.

    Iterating reads the file once. Damaged bytes are skipped up to the next plausible record; reading ends at a
    truncated record. Both are in `notices` when iteration has ended.

    Attributes:
        resolution: ticks per second of the capture's time stamps (of its first interface).
        skipped: number of frames without a UDP datagram, by reason (see `SKIPPED`).

    Raises:
        InputError: if the file is not a capture, or has no readable record or an invalid section header.
    """

    def __init__(self, source: Source) -> None:
        self._source = source
        self.path = source.path
        self.records = 0
        self.skipped: Counter[str] = Counter()
        self.resolution = 1_000_000
        self._lost_bytes = 0
        self._lost_places = 0
        self._first_lost_at = 0
        self._left_over = 0
        self._big = False
        self._links = np.zeros(_MAX_INTERFACES, np.int64)
        self._ticks = np.ones(_MAX_INTERFACES, np.int64)
        self._shift_s = np.zeros(_MAX_INTERFACES, np.float64)
        self._interfaces = 0
        self._parts = no_fragments()
        self._data = bytearray(source.read(BLOCK_BYTES))
        self._at = 0
        """Offset in the file of the first byte of `_data`."""
        self.format = capture_format(bytes(self._data[:12]))
        if not self.format:
            raise _no_capture(self.path, bytes(self._data[:16]))
        self._pos = 0
        if self.format == "pcap":
            self._big, self.resolution = _PCAP_MAGIC[bytes(self._data[:4])]
            self._pos = min(24, len(self._data))
            if self._pos == 24:
                self._links[0] = self._number(self._data[20:24]) & 0xFFFF

    def __iter__(self) -> Iterator[Datagrams]:
        counts = np.zeros(len(SKIPPED), np.int64)
        found: list[NDArray[Any]] = [np.empty(MAX_FRAMES, kind) for kind in (np.int64, np.int64, np.float64, np.uint64)]
        last_s = np.zeros(1)
        while True:
            data = np.frombuffer(self._data, np.uint8)
            if self.format == "pcap":
                count, self._pos, why = walk_pcap(
                    data, self._pos, self._big, self.resolution, self._links[0], last_s, self._parts, *found, counts
                )
            else:
                count, self._pos, why = walk_pcapng(
                    data,
                    self._pos,
                    self._big,
                    self._interfaces,
                    self._links,
                    self._ticks,
                    self._shift_s,
                    self._parts,
                    *found,
                    counts,
                )
            self.records += int(counts.sum())
            counts[FRAGMENT] += self._parts.used[2]
            self.skipped.update({SKIPPED[i]: n for i, n in enumerate(counts.tolist()) if SKIPPED[i] and n})
            counts[:] = 0
            if count:
                if joined := self._parts.used[0]:
                    data = np.concatenate([data, self._parts.joined[:joined]])
                yield Datagrams(data, *(column[:count].copy() for column in found))
            self._parts.used[[0, 2]] = 0
            if why == CONTROL:
                if not self._control_block():
                    break
            elif why == DAMAGE:
                if not self.records:
                    raise InputError("damaged-capture", path=self.path, has_big=bool(self._big), format=self.format)
                self._step_over(last_s)
            elif why == MORE and not self._refill():
                break
        if unjoined := int(self._parts.counts[:, 0].sum()):
            self.skipped[SKIPPED[FRAGMENT]] += unjoined
        self._left_over = len(self._data) - self._pos

    @property
    def notices(self) -> list[Notice]:
        """Damage to the file; complete when iteration has ended."""
        notices = []
        if self._lost_bytes:
            notices.append(
                Notice(
                    "damaged-records",
                    path=self.path.name,
                    lost_bytes=self._lost_bytes,
                    lost_places=self._lost_places,
                    first_lost_at=self._first_lost_at,
                )
            )
        if self._source.fault:
            notices.append(Notice("cut-stream", path=self.path.name, fault=self._source.fault, records=self.records))
        if self._left_over:
            notices.append(
                Notice(
                    "cut-capture",
                    path=self.path.name,
                    at=self._at + self._pos,
                    left_over=self._left_over,
                    records=self.records,
                )
            )
        return notices

    def _refill(self) -> bool:
        """Append the next block to the unread bytes; False at the end of the file."""
        more = self._source.read(BLOCK_BYTES)
        if not more:
            return False
        self._data = self._data[self._pos :] + more  # a new buffer: datagrams that were yielded refer to the old one
        self._at += self._pos
        self._pos = 0
        return True

    def _number(self, raw: bytes | bytearray, *, signed: bool = False) -> int:
        return int.from_bytes(raw, "big" if self._big else "little", signed=signed)

    def _control_block(self) -> bool:
        """Read a section header or an interface description of pcapng; False if it is truncated."""
        if self._data[self._pos : self._pos + 4] == _SECTION:
            self._big = self._data[self._pos + 8 : self._pos + 12] == b"\x1a\x2b\x3c\x4d"
            self._interfaces = 0
            size = self._number(self._data[self._pos + 4 : self._pos + 8])
            if not 28 <= size <= MAX_BLOCK or size % 4:
                raise InputError("damaged-capture.control-block", path=self.path, size=size, at=self._at + self._pos)
            while self._pos + size > len(self._data):
                if not self._refill():
                    return False
        else:
            size = self._number(self._data[self._pos + 4 : self._pos + 8])
            if self._interfaces < _MAX_INTERFACES:
                self._add_interface(self._data[self._pos : self._pos + size])
        self._pos += size
        return True

    def _add_interface(self, block: bytearray) -> None:
        i = self._interfaces
        self._interfaces += 1
        self._links[i] = self._number(block[8:10])
        self._ticks[i], self._shift_s[i] = 1_000_000, 0.0
        at = 16
        while at + 4 <= len(block) - 4:
            code, length = self._number(block[at : at + 2]), self._number(block[at + 2 : at + 4])
            value = block[at + 4 : at + 4 + length]
            if code == _END_OF_OPTIONS:
                break
            if code == _TIME_RESOLUTION and len(value) == 1:
                exponent = value[0] & 0x7F
                self._ticks[i] = 2 ** min(exponent, 62) if value[0] & 0x80 else 10 ** min(exponent, 18)
            elif code == _TIME_OFFSET and len(value) == 8:
                self._shift_s[i] = self._number(value, signed=True)
            at += 4 + (length + 3) // 4 * 4
        if i == 0:
            self.resolution = int(self._ticks[0])

    def _step_over(self, last_s: FloatArray) -> None:
        """Skip to the next plausible record."""
        self._lost_places += 1
        if not self._lost_bytes:
            self._first_lost_at = self._at + self._pos
        self._pos += 1
        self._lost_bytes += 1
        while True:
            data = np.frombuffer(self._data, np.uint8)
            kind = 0 if self.format == "pcap" else 1
            pos, found = credible(data, self._pos, self._big, self.resolution, float(last_s[0]), kind)
            self._lost_bytes += pos - self._pos
            self._pos = pos
            if found:
                return
            if not self._refill():
                self._lost_bytes += len(self._data) - self._pos
                self._pos = len(self._data)
                return


def datagrams_of(paths: Sequence[Path], skipped: Counter[str]) -> Iterator[Datagrams]:
    """The datagrams of captures, block by block; frames without one are counted in `skipped`."""
    for path in paths:
        with Source(path) as source:
            capture = Capture(source)
            yield from capture
            skipped.update(capture.skipped)


def first_datagrams(head: Head) -> Datagrams | None:
    """The datagrams of the first block of a capture; None if the file is none, or nothing of it can be read."""
    if not capture_format(head.data):
        return None
    try:
        with Source(head.path) as source:
            return next(iter(Capture(source)), None)
    except (InputError, OSError):
        return None


def address_of(sender: int) -> str:
    """Source address and destination port of a sender (see `Datagrams.sender`), for messages."""
    host, port = sender >> 16, sender & 0xFFFF
    return f"{IPv4Address(host) if host < 1 << 32 else 'an IPv6 address'} to port {port}"


def _no_capture(path: Path, head: bytes) -> InputError:
    looks_like = {
        b"": "empty",
        b"#ROSBAG": "a ROS 1 bag",
        b"SQLite format 3": "an SQLite database, as ROS 2 bags are",
        b"\x89MCAP": "an MCAP bag",
        b"$G": "an NMEA log",
        b"LASF": "a LAS or LAZ point cloud",
    }
    what = next((words for start, words in looks_like.items() if head.startswith(start) and (start or not head)), "")
    return InputError("not-a-capture", path=path, what=what or "a file that begins with " + head[:4].hex(" "))
