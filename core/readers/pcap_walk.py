"""Kernels that walk over a capture's records: which frames hold UDP datagrams, and where damage ends.

Formats: as in :mod:`furrowmap.core.readers.pcap`.
"""

from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from furrowmap.core.runtime.kernels import kernel

SKIPPED: Final = (
    "",
    "not IP",
    "not UDP",
    "IP fragments",
    "cut short by the capture",
    "damaged headers",
    "of an unsupported link type",
    "without a plausible time",
    "",
)
"""Why a frame has no datagram, by the kernels' reason code; the last is that others of its datagram follow."""
_NOT_IP, _NOT_UDP, FRAGMENT, _SHORT, _DAMAGED, _LINK, _NO_TIME, _PART = range(1, 9)

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


MORE, DAMAGE, CONTROL, FULL = range(4)
"""Why a kernel stopped: end of the data, an implausible record, a control block of pcapng, or full output arrays."""


@kernel()
def _u32(data, at, big):  # type: ignore[no-untyped-def]
    if big:
        return (
            (np.int64(data[at]) << 24) | (np.int64(data[at + 1]) << 16) | (np.int64(data[at + 2]) << 8) | data[at + 3]
        )
    return (np.int64(data[at + 3]) << 24) | (np.int64(data[at + 2]) << 16) | (np.int64(data[at + 1]) << 8) | data[at]


@kernel()
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
        parts.counts[slot, 0], parts.counts[slot, 1], parts.counts[slot, 2] = 0, 0, -1
        parts.counts[slot, 3] = parts.used[1]
        parts.covered[slot] = False
    counts = parts.counts[slot]
    counts[0] += 1
    if not more:
        counts[2] = first + size
    for block in range(first // 8, (first + size + 7) // 8):
        if not parts.covered[slot, block]:
            parts.covered[slot, block] = True
            counts[1] += min(8, first + size - 8 * block)
    for i in range(size):
        parts.bytes[slot, first + i] = data[at + i]
    total = counts[2]
    if counts[1] != total:
        return 0
    for i in range(total):
        parts.joined[parts.used[0] + i] = parts.bytes[slot, i]
    parts.used[0] += total
    counts[0] = counts[3] = 0
    return total


@kernel()
def _datagram(data, start, stop, link, parts):  # type: ignore[no-untyped-def]
    """Reason code, offset and length of the payload, and sender of the frame in data[start:stop].

    An offset beyond `data` is one into `parts.joined` after it.
    """
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


@kernel()
def walk_pcap(data, pos, big, ticks, link, last_s, parts, offset, length, time_s, sender, counts):  # type: ignore[no-untyped-def]
    """Walk over frames from `pos`; number of datagrams, offset of the first frame not walked, and why it stopped there.

    `data` (k,) are the bytes of a block, `big` is True for big-endian, `ticks` are those per second, `link` is the link
    type. `parts` keeps fragments from walk to walk. Output: `last_s` (1,) seconds of the last record; `offset`,
    `length`, `time_s` and `sender` (MAX_FRAMES,) as
    in :class:`~furrowmap.core.readers.pcap.Datagrams`; `counts` of frames by reason code.
    """
    end = len(data)
    n = 0
    for _ in range(len(offset)):
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
        why, offset[n], length[n], sender[n] = _datagram(data, pos + 16, pos + 16 + captured, link, parts)
        time_s[n] = seconds + fraction / ticks
        last_s[0] = seconds
        counts[why] += 1
        if why == 0:
            n += 1
        pos += 16 + captured
    return n, pos, FULL


@kernel()
def walk_pcapng(data, pos, big, interfaces, links, ticks, shift_s, parts, offset, length, time_s, sender, counts):  # type: ignore[no-untyped-def]
    """As `walk_pcap` for pcapng blocks; stops also at section headers and interface descriptions.

    `links`, `ticks` and `shift_s` are those of the `interfaces` interfaces described so far.
    """
    end = len(data)
    n = 0
    for _ in range(len(offset)):
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
            return n, pos, CONTROL
        if kind == 6:  # enhanced packet
            if size < 32:
                return n, pos, DAMAGE
            interface = _u32(data, pos + 8, big)
            captured = _u32(data, pos + 20, big)
            if captured > size - 32 or interface >= interfaces:
                return n, pos, DAMAGE
            why, offset[n], length[n], sender[n] = _datagram(
                data, pos + 28, pos + 28 + captured, links[interface], parts
            )
            stamp = (_u32(data, pos + 12, big) << 32) | _u32(data, pos + 16, big)
            per_s = ticks[interface]
            time_s[n] = shift_s[interface] + stamp // per_s + (stamp % per_s) / per_s
            if why == 0 and not 0.0 <= time_s[n] < LAST_TIME_S:
                why = _NO_TIME
            counts[why] += 1
            if why == 0:
                n += 1
        elif kind == 2 or kind == 3:  # obsolete and simple packets
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
                _u32(data, pos, big) == 6
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
