"""UDP datagrams in packet captures, classic pcap and pcapng, read block by block.

Formats: draft-ietf-opsawg-pcap (microseconds and nanoseconds, both byte orders) and draft-ietf-opsawg-pcapng; link
types as listed by the tcpdump group.
"""

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from ipaddress import IPv4Address
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from furrowmap.core.readers.source import Head, Source
from furrowmap.core.runtime.arrays import FloatArray, IntArray
from furrowmap.core.runtime.errors import InputError, Notice
from furrowmap.core.runtime.kernels import kernel, kernel_part
from furrowmap.core.runtime.languages.texts import Text

SKIPPED: Final = (
    "", "not IP", "not UDP", "IP fragments", "cut short by the capture", "damaged headers",
    "of an unsupported link type", "without a plausible time", "",
)  # fmt: skip
"""Why a frame has no datagram, by the kernels' reason code; the last is that others of its datagram follow."""
_NOT_IP, _NOT_UDP, FRAGMENT, _SHORT, _DAMAGED, _LINK, _NO_TIME, _PART = range(1, 9)


def counted(frames: Mapping[str, int]) -> tuple[Text, ...]:
    """How many frames are of each kind, in words; kinds without any are left out."""
    return tuple(Text("{count:,} {kind}", count=count, kind=kind) for kind, count in frames.items() if count)


MAX_FRAME: Final = 65_535 + 64
"""Largest IP datagram with its link header."""
MAX_BLOCK: Final = 1 << 24
"""Bytes of a pcapng block at most; a longer one is damage."""
MAX_FRAMES: Final = 1 << 14
"""Frames per call of a kernel, at most."""
LAST_TIME_S: Final = 2.0**34
"""The year 2514, the latest plausible time."""

MAX_DATAGRAM: Final = 65_536
_DATAGRAMS_OPEN: Final = 16
"""Datagrams of which fragments are awaited at a time: sensors on one network send theirs between each other's."""


class Fragments(NamedTuple):
    """Datagrams in fragments (RFC 791) that are being joined; the oldest is given up where there are too many.

    Attributes:
        key: (m,) sender's address and number of the datagram.
        counts: (m, 4) int64: fragments so far, 0 for none; bytes so far; bytes in all, -1 while the last fragment is
            missing; when the first fragment came.
        covered: (m, 8192) which eighths of its bytes are there.
        bytes: (m, 65536) its bytes, UDP header included.
        joined: (k,) bytes of complete datagrams since the walk began.
        used: (3,) bytes of `joined` in use; datagrams begun; fragments given up.
    """

    key: NDArray[np.uint64]
    counts: NDArray[np.int64]
    covered: NDArray[np.bool_]
    bytes: NDArray[np.uint8]
    joined: NDArray[np.uint8]
    used: NDArray[np.int64]


def no_fragments() -> Fragments:
    """At the start of a capture."""
    m = _DATAGRAMS_OPEN
    return Fragments(
        np.zeros(m, np.uint64),
        np.zeros((m, 4), np.int64),
        np.zeros((m, 8192), np.bool_),
        np.zeros((m, MAX_DATAGRAM), np.uint8),
        np.zeros(1 << 22, np.uint8),
        np.zeros(3, np.int64),
    )


class Interfaces(NamedTuple):
    """Link type, ticks a second and shift of the time (_MAX_INTERFACES,) of the interfaces of a pcapng file."""

    link: NDArray[np.int64]
    ticks: NDArray[np.int64]
    shift_s: FloatArray


class WalkedDatagrams(NamedTuple):
    """Room for the datagrams of a walk (MAX_FRAMES,), as in :class:`Datagrams`."""

    offset: IntArray
    length: IntArray
    time_s: FloatArray
    sender: NDArray[np.uint64]


MORE, DAMAGE, CONTROL, FULL = range(4)
"""Why a kernel stopped: end of the data, an implausible record, a control block of pcapng, or full output arrays."""


@kernel_part()
def _u32(data, at, big):  # type: ignore[no-untyped-def]
    if big:
        return (
            (np.int64(data[at]) << 24) | (np.int64(data[at + 1]) << 16) | (np.int64(data[at + 2]) << 8) | data[at + 3]
        )
    return (np.int64(data[at + 3]) << 24) | (np.int64(data[at + 2]) << 16) | (np.int64(data[at + 1]) << 8) | data[at]


@kernel_part()
def _join(data, at, stop, key, first, more, parts):  # type: ignore[no-untyped-def]
    """Keep data[at:stop], a fragment from byte `first` on; the length of its datagram if now complete, else 0.

    A complete datagram is appended to `parts.joined`.
    """
    size = stop - at
    if size <= 0 or first + size > MAX_DATAGRAM:
        return 0
    slot = -1
    for k in range(len(parts.key)):
        if parts.key[k] == key and parts.counts[k, 0]:
            slot = k
    if slot < 0:
        slot = 0  # the oldest
        for k in range(len(parts.key)):
            if parts.counts[k, 3] < parts.counts[slot, 3]:
                slot = k
        parts.used[2] += parts.counts[slot, 0]
        parts.used[1] += 1
        parts.key[slot] = key
        parts.counts[slot, 0] = 0
        parts.counts[slot, 1] = 0
        parts.counts[slot, 2] = -1
        parts.counts[slot, 3] = parts.used[1]
        for block in range(parts.covered.shape[1]):
            parts.covered[slot, block] = False
    parts.counts[slot, 0] += 1
    if not more:
        parts.counts[slot, 2] = first + size
    for block in range(first // 8, (first + size + 7) // 8):
        if not parts.covered[slot, block]:
            parts.covered[slot, block] = True
            parts.counts[slot, 1] += min(8, first + size - 8 * block)
    for i in range(size):
        parts.bytes[slot, first + i] = data[at + i]
    total = parts.counts[slot, 2]
    if parts.counts[slot, 1] != total:
        return 0
    for i in range(total):
        parts.joined[parts.used[0] + i] = parts.bytes[slot, i]
    parts.used[0] += total
    parts.counts[slot, 0] = parts.counts[slot, 3] = 0
    return total


@kernel_part()
def _datagram(data, start, stop, link, parts):  # type: ignore[no-untyped-def]
    """Reason code, offset and length of the payload, and sender of the frame in data[start:stop].

    An offset beyond `data` is one into `parts.joined` after it.
    """
    kind = -1  # where the type of what follows is; without one it is IP
    if link == 1:  # Ethernet
        kind = start + 12
        at = start + 14
    elif link == 113 or link == 276:  # Linux cooked, versions 1 and 2
        kind, at = (start + 14, start + 16) if link == 113 else (start, start + 20)
    elif link == 0 or link == 108:  # BSD loopback: four bytes of address family
        at = start + 4
    elif link == 101 or link == 12 or link == 14 or link == 228 or link == 229:  # raw IP
        at = start
    else:
        return _LINK, 0, 0, np.uint64(0)
    if at > stop:
        return _SHORT, 0, 0, np.uint64(0)
    if kind >= 0:
        ethertype = (np.int64(data[kind]) << 8) | data[kind + 1]
        while link == 1 and (ethertype == 0x8100 or ethertype == 0x88A8 or ethertype == 0x9100):  # VLAN tags
            at += 4
            if at > stop:
                return _SHORT, 0, 0, np.uint64(0)
            ethertype = (np.int64(data[at - 2]) << 8) | data[at - 1]
        if ethertype != 0x0800 and ethertype != 0x86DD:
            return _NOT_IP, 0, 0, np.uint64(0)

    if at + 20 > stop:
        return _SHORT, 0, 0, np.uint64(0)
    version = data[at] >> 4
    if version == 4:
        if data[at + 9] != 17:
            return _NOT_UDP, 0, 0, np.uint64(0)
        address = np.uint64(0)
        for i in range(12, 16):
            address = (address << np.uint64(8)) | np.uint64(data[at + i])
        header = np.int64(data[at] & 15) * 4
        if header < 20:
            return _DAMAGED, 0, 0, np.uint64(0)
        fragment = ((np.int64(data[at + 6]) << 8) | data[at + 7]) & 0x3FFF
        if fragment:
            ends = at + ((np.int64(data[at + 2]) << 8) | data[at + 3])
            if ends > stop:
                return _SHORT, 0, 0, np.uint64(0)
            key = (address << np.uint64(16)) | (np.uint64(data[at + 4]) << np.uint64(8)) | np.uint64(data[at + 5])
            begin = parts.used[0]
            total = _join(data, at + header, ends, key, 8 * (fragment & 0x1FFF), fragment & 0x2000, parts)
            if total == 0:
                return _PART, 0, 0, np.uint64(0)
            length = ((np.int64(parts.joined[begin + 4]) << 8) | parts.joined[begin + 5]) - 8
            if length < 0 or length > total - 8:
                return _DAMAGED, 0, 0, np.uint64(0)
            port = (np.uint64(parts.joined[begin + 2]) << np.uint64(8)) | np.uint64(parts.joined[begin + 3])
            return 0, len(data) + begin + 8, length, (address << np.uint64(16)) | port
        at += header
    elif version == 6:
        if at + 40 > stop:
            return _SHORT, 0, 0, np.uint64(0)
        if data[at + 6] != 17:
            return _NOT_UDP, 0, 0, np.uint64(0)
        address = np.uint64(14695981039346656037)  # FNV-1a of the address, to fit in the space of an IPv4 address
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


@kernel_part()
def walk_pcap(data, pos, big, ticks, link, last_s, parts, found, counts):  # type: ignore[no-untyped-def]
    """Walk over frames from `pos`; number of datagrams, offset of the first frame not walked, and why it stopped there.

    `data` (k,) are the bytes of a block, `big` is True for big-endian, `ticks` are those per second, `link` is the link
    type. `parts` keeps fragments from walk to walk. Output: `last_s` (1,) seconds of the last record; `found`;
    `counts` of frames by reason code.
    """
    end = len(data)
    n = 0
    for _ in range(len(found.offset)):
        if parts.used[0] > len(parts.joined) - MAX_DATAGRAM:
            return n, pos, FULL
        if pos + 16 > end:
            return n, pos, MORE
        seconds = _u32(data, pos, big)
        fraction = _u32(data, pos + 4, big)
        captured = _u32(data, pos + 8, big)
        if fraction >= ticks or captured > MAX_FRAME or captured > _u32(data, pos + 12, big):
            return n, pos, DAMAGE
        if pos + 16 + captured > end:
            return n, pos, MORE
        why, found.offset[n], found.length[n], found.sender[n] = _datagram(
            data, pos + 16, pos + 16 + captured, link, parts
        )
        found.time_s[n] = seconds + fraction / ticks
        last_s[0] = seconds
        counts[why] += 1
        if why == 0:
            n += 1
        pos += 16 + captured
    return n, pos, FULL


@kernel_part()
def walk_pcapng(data, pos, big, described, interfaces, parts, found, counts):  # type: ignore[no-untyped-def]
    """As `walk_pcap` for pcapng blocks; stops also at section headers and interface descriptions.

    `described` of the `interfaces` are known so far.
    """
    end = len(data)
    n = 0
    for _ in range(len(found.offset)):
        if parts.used[0] > len(parts.joined) - MAX_DATAGRAM:
            return n, pos, FULL
        if pos + 12 > end:
            return n, pos, MORE
        kind = _u32(data, pos, big)
        if kind == 0x0A0D0D0A:
            return n, pos, MORE if pos + 28 > end else CONTROL
        size = _u32(data, pos + 4, big)
        if size < 12 or size % 4 or size > MAX_BLOCK:
            return n, pos, DAMAGE
        if pos + size > end:
            return n, pos, MORE
        if _u32(data, pos + size - 4, big) != size:
            return n, pos, DAMAGE
        if kind == 1:
            if size < 20:
                return n, pos, DAMAGE
            if described < len(interfaces.link):  # further ones are passed over, and packets of theirs are damage
                return n, pos, CONTROL
        if kind == 6 or kind == 2:  # enhanced packet, and the obsolete one: as long, with 16 bits of the interface
            if size < 32:
                return n, pos, DAMAGE
            interface = _u32(data, pos + 8, big)
            if kind == 2:
                interface = interface >> 16 if big else interface & 0xFFFF
            captured = _u32(data, pos + 20, big)
            if captured > size - 32 or interface >= described:
                return n, pos, DAMAGE
            why, found.offset[n], found.length[n], found.sender[n] = _datagram(
                data, pos + 28, pos + 28 + captured, interfaces.link[interface], parts
            )
            stamp = (_u32(data, pos + 12, big) << 32) | _u32(data, pos + 16, big)
            per_s = interfaces.ticks[interface]
            found.time_s[n] = interfaces.shift_s[interface] + stamp // per_s + (stamp % per_s) / per_s
            if why == 0 and not 0.0 <= found.time_s[n] < LAST_TIME_S:
                why = _NO_TIME
            counts[why] += 1
            if why == 0:
                n += 1
        elif kind == 3:  # simple packets, which have no time
            counts[_NO_TIME] += 1
        pos += size
    return n, pos, FULL


@kernel()
def credible(data, pos, big, ticks, last_s, kind):  # type: ignore[no-untyped-def]
    """The next offset from `pos` with two plausible records in a row (kind 0) or a plausible block (kind 1)."""
    end = len(data)
    if kind == 1:
        while pos + 12 <= end:
            size = _u32(data, pos + 4, big)
            if (
                (_u32(data, pos, big) == 6 or _u32(data, pos, big) == 2)
                and 32 <= size <= MAX_FRAME
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
                or captured > MAX_FRAME
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
_END_OF_OPTIONS: Final = 0
_TIME_RESOLUTION: Final = 9
_TIME_OFFSET: Final = 14


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
        kinds = (np.int64, np.int64, np.float64)
        self._interfaces = Interfaces._make(np.zeros(_MAX_INTERFACES, kind) for kind in kinds)
        self._described = 0
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
                self._interfaces.link[0] = self._number(self._data[20:24]) & 0xFFFF

    def __iter__(self) -> Iterator[Datagrams]:
        counts = np.zeros(len(SKIPPED), np.int64)
        kinds = (np.int64, np.int64, np.float64, np.uint64)
        found = WalkedDatagrams._make(np.empty(MAX_FRAMES, kind) for kind in kinds)
        last_s = np.zeros(1)
        while True:
            data = np.frombuffer(self._data, np.uint8)
            if self.format == "pcap":
                link = self._interfaces.link[0]
                count, self._pos, why = walk_pcap(
                    data, self._pos, self._big, self.resolution, link, last_s, self._parts, found, counts
                )
            else:
                count, self._pos, why = walk_pcapng(
                    data, self._pos, self._big, self._described, self._interfaces, self._parts, found, counts
                )
            if why == CONTROL and not count and self._control_block():
                continue  # a file may consist of them; what was counted is kept for the next time
            self.records += int(counts.sum())
            counts[FRAGMENT] += self._parts.used[2]
            self.skipped.update({SKIPPED[i]: n for i, n in enumerate(counts.tolist()) if SKIPPED[i] and n})
            counts[:] = 0
            if count:
                if joined := self._parts.used[0]:
                    data = np.concatenate([data, self._parts.joined[:joined]])
                yield Datagrams(data, *WalkedDatagrams._make(column[:count].copy() for column in found))
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
            self._described = 0
            size = self._number(self._data[self._pos + 4 : self._pos + 8])
            if not 28 <= size <= MAX_BLOCK or size % 4:
                raise InputError("damaged-capture.section-length", path=self.path, size=size, at=self._at + self._pos)
            while self._pos + size > len(self._data):
                if not self._refill():
                    return False
        else:
            size = self._number(self._data[self._pos + 4 : self._pos + 8])
            self._add_interface(self._data[self._pos : self._pos + size])
        self._pos += size
        return True

    def _add_interface(self, block: bytearray) -> None:
        i = self._described
        self._described += 1
        interfaces = self._interfaces
        interfaces.link[i] = self._number(block[8:10])
        interfaces.ticks[i] = 1_000_000
        interfaces.shift_s[i] = 0.0
        at = 16
        while at + 4 <= len(block) - 4:
            code = self._number(block[at : at + 2])
            length = self._number(block[at + 2 : at + 4])
            value = block[at + 4 : at + 4 + length]
            if code == _END_OF_OPTIONS:
                break
            if code == _TIME_RESOLUTION and len(value) == 1:
                exponent = value[0] & 0x7F
                interfaces.ticks[i] = 2 ** min(exponent, 62) if value[0] & 0x80 else 10 ** min(exponent, 18)
            elif code == _TIME_OFFSET and len(value) == 8:
                interfaces.shift_s[i] = self._number(value, signed=True)
            at += 4 + (length + 3) // 4 * 4
        if i == 0:
            self.resolution = int(interfaces.ticks[0])

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
    host = sender >> 16
    port = sender & 0xFFFF
    return f"{IPv4Address(host) if host < 1 << 32 else 'an IPv6 address'} to port {port}"


def _no_capture(path: Path, head: bytes) -> InputError:
    looks_like = {
        b"": Text("empty"),
        b"#ROSBAG": Text("a ROS 1 bag"),
        b"SQLite format 3": Text("an SQLite database, as ROS 2 bags are"),
        b"\x89MCAP": Text("an MCAP bag"),
        b"$G": Text("an NMEA log"),
        b"LASF": Text("a LAS or LAZ point cloud"),
    }
    what = next((words for start, words in looks_like.items() if head.startswith(start) and (start or not head)), None)
    return InputError(
        "not-a-capture", path=path, what=what or Text("a file that begins with {bytes}", bytes=head[:4].hex(" "))
    )
