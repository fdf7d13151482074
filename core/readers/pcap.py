"""UDP datagrams out of packet captures: classic pcap and pcapng, block by block.

Formats: draft-ietf-opsawg-pcap (microseconds and nanoseconds, both byte orders) and draft-ietf-opsawg-pcapng; link
types after the tcpdump group's list.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
from numba import njit
from numpy.typing import NDArray

from furrowmap.core.readers.source import Source
from furrowmap.core.values.errors import InputError, Notice

IntArray = NDArray[np.int64]
FloatArray = NDArray[np.float64]
ByteArray = NDArray[np.uint8]

BLOCK_BYTES: Final = 1 << 21
"""How much is read and walked at a time."""

SKIPPED: Final = (
    "",
    "not IP",
    "not UDP",
    "IP fragments",
    "cut short by the capture",
    "damaged headers",
    "of a link type that is not read",
    "without a credible time",
)
"""Why a frame gave no datagram, by the kernels' reason code."""
_NOT_IP, _NOT_UDP, _FRAGMENT, _SHORT, _DAMAGED, _LINK, _NO_TIME = range(1, 8)

_MAGIC: Final = {
    b"\xd4\xc3\xb2\xa1": (False, 1_000_000),
    b"\xa1\xb2\xc3\xd4": (True, 1_000_000),
    b"\x4d\x3c\xb2\xa1": (False, 1_000_000_000),
    b"\xa1\xb2\x3c\x4d": (True, 1_000_000_000),
}
_SECTION: Final = b"\x0a\x0d\x0d\x0a"
_MAX_FRAME: Final = 65_535 + 64
"""No IP datagram with its link header is longer."""
_MAX_BLOCK: Final = 1 << 24
_MAX_FRAMES: Final = 1 << 14
"""Frames that one call of a kernel walks over at most."""
_LAST_TIME_S: Final = 2.0**34
"""The year 2514: no capture is later."""
_MAX_INTERFACES: Final = 1 << 10
_END_OF_OPTIONS, _TIME_RESOLUTION, _TIME_OFFSET = 0, 9, 14

# Why a kernel stopped.
_MORE, _DAMAGE, _CONTROL, _FULL = range(4)


def capture_format(head: bytes) -> str:
    """Which kind of capture begins like this: "pcap", "pcapng", or "" for none."""
    if head[:4] in _MAGIC:
        return "pcap"
    if head[:4] == _SECTION and head[8:12] in (b"\x1a\x2b\x3c\x4d", b"\x4d\x3c\x2b\x1a"):
        return "pcapng"
    return ""


@dataclass(frozen=True)
class Datagrams:
    """UDP datagrams that lie in one block of a capture.

    Attributes:
        data: (k,) the block's bytes.
        offset: (n,) where in `data` each payload begins.
        length: (n,) its length in bytes.
        time_s: (n,) float64, when it was captured: UTC by the recorder's clock.
        sender: (n,) uint64, IPv4 address times 65,536 plus destination port; a hash in place of an IPv6 address.
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

    Iterating reads the file through once. Damage inside is stepped over to the next credible record, an end in the
    middle of a record is where reading ends; `notices` tells of both when iteration has ended.

    Attributes:
        format: "pcap" or "pcapng".
        resolution: ticks a second of the capture's time stamps (of its first interface).
        records: frames found so far.
        skipped: frames that held no UDP datagram, by reason (see `SKIPPED`).

    Raises:
        InputError: if the file is no capture, has no readable record, or a section header that makes no sense.
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
        self._data = bytearray(source.read(BLOCK_BYTES))
        self._at = 0
        """Offset in the file of the first byte of `_data`."""
        self.format = capture_format(bytes(self._data[:12]))
        if not self.format:
            raise _no_capture(self.path, bytes(self._data[:16]))
        self._pos = 0 if self.format == "pcapng" else self._file_header()

    def __iter__(self) -> Iterator[Datagrams]:
        walked = _Walk()
        last_s = np.zeros(1)
        while True:
            data = np.frombuffer(self._data, np.uint8)
            if self.format == "pcap":
                count, self._pos, why = _walk_pcap(
                    data, self._pos, self._big, self.resolution, self._links[0], last_s, *walked.arrays
                )
            else:
                count, self._pos, why = _walk_pcapng(
                    data,
                    self._pos,
                    self._big,
                    self._interfaces,
                    self._links,
                    self._ticks,
                    self._shift_s,
                    *walked.arrays,
                )
            self.records += int(walked.counts.sum())
            self.skipped.update(walked.take_skipped())
            if count:
                yield walked.datagrams(data, count)
            if why == _CONTROL:
                if not self._control_block():
                    break
            elif why == _DAMAGE:
                if not self.records:
                    raise self._unreadable()
                self._step_over(last_s)
            elif why == _MORE and not self._refill():
                break
        self._left_over = len(self._data) - self._pos

    @property
    def notices(self) -> list[Notice]:
        """What was wrong with the file; complete when iteration has ended."""
        notices = []
        if self._lost_bytes:
            notices.append(
                Notice(
                    "damaged-records",
                    f"{self.path.name}: {self._lost_bytes:,} bytes at {self._lost_places} places (the first at byte"
                    f" {self._first_lost_at:,}) are no credible record and were stepped over.",
                )
            )
        if self._source.fault:
            notices.append(
                Notice(
                    "cut-stream",
                    f"{self.path.name}: {self._source.fault}; {self.records:,} records before it were read.",
                )
            )
        if self._left_over:
            notices.append(
                Notice(
                    "cut-capture",
                    f"{self.path.name} ends within a record (at byte {self._at + self._pos:,}; {self._left_over:,}"
                    f" bytes of it), as when power fails; the {self.records:,} records before it are whole.",
                )
            )
        return notices

    def _refill(self) -> bool:
        """Read on behind what is left of the block; False at the end of the file."""
        more = self._source.read(BLOCK_BYTES)
        if not more:
            return False
        self._data = self._data[self._pos :] + more  # a new buffer: datagrams given out lie in the old one
        self._at += self._pos
        self._pos = 0
        return True

    def _file_header(self) -> int:
        self._big, self.resolution = _MAGIC[bytes(self._data[:4])]
        if len(self._data) < 24:
            return len(self._data)
        self._links[0] = self._number(self._data[20:24]) & 0xFFFF
        return 24

    def _number(self, raw: bytes | bytearray, *, signed: bool = False) -> int:
        return int.from_bytes(raw, "big" if self._big else "little", signed=signed)

    def _control_block(self) -> bool:
        """Take in a pcapng block that changes how the following ones are read; False if it is cut.

        Such blocks are section headers and interface descriptions.
        """
        if self._data[self._pos : self._pos + 4] == _SECTION:
            self._big = self._data[self._pos + 8 : self._pos + 12] == b"\x1a\x2b\x3c\x4d"
            self._interfaces = 0
            size = self._number(self._data[self._pos + 4 : self._pos + 8])
            if not 28 <= size <= _MAX_BLOCK or size % 4:
                raise InputError(
                    f"{self.path}: the section header at byte {self._at + self._pos:,} gives its length as {size:,}.",
                    "Where the next block begins cannot be known.",
                    "Copy the capture again, or repair it with Wireshark (open, then export all packets).",
                    code="damaged-capture",
                )
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
        """Go to the next place that looks like a record, reading on as far as it takes."""
        self._lost_places += 1
        if not self._lost_bytes:
            self._first_lost_at = self._at + self._pos
        self._pos += 1
        self._lost_bytes += 1
        while True:
            data = np.frombuffer(self._data, np.uint8)
            kind = 0 if self.format == "pcap" else 1
            pos, found = _credible(data, self._pos, self._big, self.resolution, float(last_s[0]), kind)
            self._lost_bytes += pos - self._pos
            self._pos = pos
            if found:
                return
            if not self._refill():
                self._lost_bytes += len(self._data) - self._pos
                self._pos = len(self._data)
                return

    def _unreadable(self) -> InputError:
        other = "little" if self._big else "big"
        return InputError(
            f"{self.path}: the header is that of a {self.format} file with the {'big' if self._big else 'little'} end"
            " first, but no record behind it makes sense.",
            f"Either the header was written with the wrong byte order (the records may have the {other} end first), or"
            " the file is damaged from its start.",
            "Copy the capture again from the recorder, or repair it with Wireshark (open, then export all packets).",
            code="damaged-capture",
        )


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
    return InputError(
        f"{path} is no packet capture: it is {what or 'something that begins with ' + head[:4].hex(' ')}.",
        "Captures begin with the magic number of pcap or pcapng, whatever they are called.",
        "Give the capture as tcpdump, dumpcap or Wireshark wrote it, or the file under its right name.",
        code="not-a-capture",
    )


class _Walk:
    """The arrays that the kernels write to."""

    def __init__(self) -> None:
        self.offset = np.empty(_MAX_FRAMES, np.int64)
        self.length = np.empty(_MAX_FRAMES, np.int64)
        self.time_s = np.empty(_MAX_FRAMES, np.float64)
        self.sender = np.empty(_MAX_FRAMES, np.uint64)
        self.counts = np.zeros(len(SKIPPED), np.int64)

    @property
    def arrays(self) -> tuple[IntArray, IntArray, FloatArray, NDArray[np.uint64], IntArray]:
        return self.offset, self.length, self.time_s, self.sender, self.counts

    def take_skipped(self) -> dict[str, int]:
        skipped = {SKIPPED[i]: int(self.counts[i]) for i in range(1, len(SKIPPED)) if self.counts[i]}
        self.counts[:] = 0
        return skipped

    def datagrams(self, data: ByteArray, count: int) -> Datagrams:
        return Datagrams(
            data,
            self.offset[:count].copy(),
            self.length[:count].copy(),
            self.time_s[:count].copy(),
            self.sender[:count].copy(),
        )


@njit(cache=True, nogil=True)
def _u32(data, at, big):  # type: ignore[no-untyped-def]
    if big:
        return (
            (np.int64(data[at]) << 24) | (np.int64(data[at + 1]) << 16) | (np.int64(data[at + 2]) << 8) | data[at + 3]
        )
    return (np.int64(data[at + 3]) << 24) | (np.int64(data[at + 2]) << 16) | (np.int64(data[at + 1]) << 8) | data[at]


@njit(cache=True, nogil=True)
def _datagram(data, start, stop, link):  # type: ignore[no-untyped-def]
    """Reason code, payload's offset and length, and sender of the frame in data[start:stop]."""
    at = start
    if link == 1:  # Ethernet
        at += 14
        if at > stop:
            return _SHORT, 0, 0, np.uint64(0)
        ethertype = (np.int64(data[at - 2]) << 8) | data[at - 1]
        while ethertype == 0x8100 or ethertype == 0x88A8 or ethertype == 0x9100:  # VLAN tags
            at += 4
            if at > stop:
                return _SHORT, 0, 0, np.uint64(0)
            ethertype = (np.int64(data[at - 2]) << 8) | data[at - 1]
        if ethertype != 0x0800 and ethertype != 0x86DD:
            return _NOT_IP, 0, 0, np.uint64(0)
    elif link == 113 or link == 276:  # Linux cooked, versions 1 and 2
        at += 16 if link == 113 else 20
        if at > stop:
            return _SHORT, 0, 0, np.uint64(0)
        kind = start + 14 if link == 113 else start
        ethertype = (np.int64(data[kind]) << 8) | data[kind + 1]
        if ethertype != 0x0800 and ethertype != 0x86DD:
            return _NOT_IP, 0, 0, np.uint64(0)
    elif link == 0 or link == 108:  # BSD loopback: four bytes of address family
        at += 4
    elif link != 101 and link != 12 and link != 14 and link != 228 and link != 229:  # raw IP
        return _LINK, 0, 0, np.uint64(0)

    if at + 20 > stop:
        return _SHORT, 0, 0, np.uint64(0)
    version = data[at] >> 4
    if version == 4:
        if data[at + 9] != 17:
            return _NOT_UDP, 0, 0, np.uint64(0)
        if ((np.int64(data[at + 6]) << 8) | data[at + 7]) & 0x3FFF:
            return _FRAGMENT, 0, 0, np.uint64(0)
        address = np.uint64(0)
        for i in range(12, 16):
            address = (address << np.uint64(8)) | np.uint64(data[at + i])
        header = np.int64(data[at] & 15) * 4
        if header < 20:
            return _DAMAGED, 0, 0, np.uint64(0)
        at += header
    elif version == 6:
        if at + 40 > stop:
            return _SHORT, 0, 0, np.uint64(0)
        if data[at + 6] != 17:
            return _NOT_UDP, 0, 0, np.uint64(0)
        address = np.uint64(14695981039346656037)  # FNV-1a of the address, so that it fits where an IPv4 one does
        for i in range(16):
            address = (address ^ np.uint64(data[at + 8 + i])) * np.uint64(1099511628211)
        address = (address >> np.uint64(16)) | np.uint64(1 << 47)
        at += 40
    else:
        return _NOT_IP, 0, 0, np.uint64(0)
    if at + 8 > stop:
        return _SHORT, 0, 0, np.uint64(0)
    port = (np.uint64(data[at + 2]) << np.uint64(8)) | np.uint64(data[at + 3])
    length = ((np.int64(data[at + 4]) << 8) | data[at + 5]) - 8
    if length < 0:
        return _DAMAGED, 0, 0, np.uint64(0)
    if at + 8 + length > stop:
        return _SHORT, 0, 0, np.uint64(0)
    return 0, at + 8, length, (address << np.uint64(16)) | port


@njit(cache=True, nogil=True)
def _walk_pcap(data, pos, big, ticks, link, last_s, offset, length, time_s, sender, counts):  # type: ignore[no-untyped-def]
    """Frames from `pos` on; how many gave a datagram, where the first one not walked begins, and why it was not."""
    end = len(data)
    n = 0
    for _ in range(len(offset)):
        if pos + 16 > end:
            return n, pos, _MORE
        seconds = _u32(data, pos, big)
        fraction = _u32(data, pos + 4, big)
        captured = _u32(data, pos + 8, big)
        if fraction >= ticks or captured > _MAX_FRAME or captured > _u32(data, pos + 12, big):
            return n, pos, _DAMAGE
        if pos + 16 + captured > end:
            return n, pos, _MORE
        why, offset[n], length[n], sender[n] = _datagram(data, pos + 16, pos + 16 + captured, link)
        time_s[n] = seconds + fraction / ticks
        last_s[0] = seconds
        counts[why] += 1
        if why == 0:
            n += 1
        pos += 16 + captured
    return n, pos, _FULL


@njit(cache=True, nogil=True)
def _walk_pcapng(data, pos, big, interfaces, links, ticks, shift_s, offset, length, time_s, sender, counts):  # type: ignore[no-untyped-def]
    """As `_walk_pcap`, over blocks; stops also at a block that changes how the following ones are read."""
    end = len(data)
    n = 0
    for _ in range(len(offset)):
        if pos + 12 > end:
            return n, pos, _MORE
        kind = _u32(data, pos, big)
        if kind == 0x0A0D0D0A:
            return n, pos, _MORE if pos + 28 > end else _CONTROL
        size = _u32(data, pos + 4, big)
        if size < 12 or size % 4 or size > _MAX_BLOCK:
            return n, pos, _DAMAGE
        if pos + size > end:
            return n, pos, _MORE
        if _u32(data, pos + size - 4, big) != size:
            return n, pos, _DAMAGE
        if kind == 1:
            if size < 20:
                return n, pos, _DAMAGE
            return n, pos, _CONTROL
        if kind == 6:  # enhanced packet
            if size < 32:
                return n, pos, _DAMAGE
            interface = _u32(data, pos + 8, big)
            captured = _u32(data, pos + 20, big)
            if captured > size - 32 or interface >= interfaces:
                return n, pos, _DAMAGE
            why, offset[n], length[n], sender[n] = _datagram(data, pos + 28, pos + 28 + captured, links[interface])
            stamp = (_u32(data, pos + 12, big) << 32) | _u32(data, pos + 16, big)
            per_s = ticks[interface]
            time_s[n] = shift_s[interface] + stamp // per_s + (stamp % per_s) / per_s
            if why == 0 and not 0.0 <= time_s[n] < _LAST_TIME_S:
                why = _NO_TIME
            counts[why] += 1
            if why == 0:
                n += 1
        elif kind == 2 or kind == 3:  # packets of obsolete and of simple blocks
            counts[_NO_TIME] += 1
        pos += size
    return n, pos, _FULL


@njit(cache=True, nogil=True)
def _credible(data, pos, big, ticks, last_s, kind):  # type: ignore[no-untyped-def]
    """The next place from `pos` on at which two records (kind 0) or a block (kind 1) follow each other credibly."""
    end = len(data)
    if kind == 1:
        while pos + 12 <= end:
            size = _u32(data, pos + 4, big)
            if (
                _u32(data, pos, big) == 6
                and 32 <= size <= _MAX_FRAME
                and size % 4 == 0
                and (pos + size > end or _u32(data, pos + size - 4, big) == size)
            ):
                return pos, True
            pos += 1
        return pos, False
    while pos + 16 <= end:
        at = pos
        good = 0
        while good < 2 and at + 16 <= end:
            captured = _u32(data, at + 8, big)
            if (
                captured < 28
                or captured > _MAX_FRAME
                or captured > _u32(data, at + 12, big)
                or _u32(data, at + 4, big) >= ticks
                or (last_s > 0.0 and abs(_u32(data, at, big) - last_s) > 86_400.0)
            ):
                good = -1
                break
            good += 1
            at += 16 + captured
        if good == 2 or (good == 1 and at >= end):
            return pos, True
        pos += 1
    return pos, False
