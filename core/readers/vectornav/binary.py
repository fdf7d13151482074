"""Binary output messages of VectorNav sensors (VN-100, VN-200, VN-300, VN-310).

A message is the byte FA, a byte with the groups that follow, 16 bits with the fields of each group, the fields in the
order of their bits, and a CRC-16 (polynomial 1021 hexadecimal, initial value 0) over all behind the first byte
(VN-200 user manual UM004, "User configurable binary output messages"). All numbers are little-endian.
"""

from __future__ import annotations

import struct
from binascii import crc_hqx
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Final

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

SYNC: Final = 0xFA
LONGEST: Final = 2048
"""Bytes of a message: all groups with all their fields are shorter."""
_GPS: Final = (8, 8, 2, 1, 1, 24, 24, 12, 12, 12, 4, 4, 2, 28)
SIZES: Final = (
    (8, 8, 8, 12, 16, 12, 24, 12, 12, 24, 20, 28, 2, 4, 8),  # common
    (8, 8, 8, 2, 8, 8, 8, 4, 4, 1),  # time
    (2, 12, 12, 12, 4, 4, 16, 12, 12, 12, 12, 2, 40),  # IMU
    _GPS,
    (2, 12, 16, 36, 12, 12, 12, 12, 12, 12, 28, 24, 12),  # attitude
    (2, 24, 24, 12, 12, 12, 12, 12, 12, 4, 4, 68, 64),  # INS
    _GPS,  # second receiver
)
"""Bytes of each field of each group; fields of a varying length have none here and make a message unreadable."""
TIME_GPS: Final = ((0, 1), (1, 1))
GPS_TOW: Final = (1, 2)
GPS_WEEK: Final = (1, 3)
RATES: Final = (((2, 3), 0), ((0, 9), 12), ((2, 10), 0), ((0, 5), 0))
FORCES: Final = (((2, 2), 0), ((0, 9), 0), ((2, 9), 0), ((0, 8), 0))
"""Angular rate and specific force: (group, field), and the offset in it. Those of the calibrated sensors come first;
the others are less the biases that the device's own filter estimates, which jump."""
ANGLES: Final = ((0, 3), (4, 1))
"""Yaw, pitch, roll in degrees."""


@dataclass(frozen=True)
class Layout:
    """The content of messages with one header.

    Attributes:
        header: the bytes from that of the groups to before the fields.
        size: of a message, with the first byte and the checksum.
        offset: of each field from the start of a message, by group and bit.
    """

    header: bytes
    size: int
    offset: dict[tuple[int, int], int]

    def first(self, wanted: tuple[tuple[int, int], ...]) -> int | None:
        """Offset of the first of some fields that is there."""
        return next((self.offset[one] for one in wanted if one in self.offset), None)

    def measured(self, wanted: tuple[tuple[tuple[int, int], int], ...]) -> int | None:
        """Offset of the first of some vectors that is there."""
        return next((self.offset[one] + inside for one, inside in wanted if one in self.offset), None)

    @property
    def is_inertial(self) -> bool:
        """Whether the messages hold angular rate and specific force."""
        return self.measured(RATES) is not None and self.measured(FORCES) is not None

    @property
    def has_time(self) -> bool:
        """Whether they hold GPS time."""
        return self.first(TIME_GPS) is not None or (GPS_TOW in self.offset and GPS_WEEK in self.offset)


def layout_at(data: bytes, at: int) -> Layout | None:
    """The layout of a message that begins at an offset; None where the bytes are no header."""
    groups = data[at + 1] if at + 1 < len(data) else 0
    chosen = [group for group in range(len(SIZES)) if groups >> group & 1]
    end = at + 2 + 2 * len(chosen)
    if not chosen or groups & 0x80 or end > len(data):
        return None
    offset, place = {}, end - at
    for group, fields in zip(chosen, struct.unpack_from(f"<{len(chosen)}H", data, at + 2), strict=True):
        if not fields or fields >> len(SIZES[group]):
            return None
        for bit, size in enumerate(SIZES[group]):
            if fields >> bit & 1:
                offset[group, bit] = place
                place += size
    return Layout(data[at + 1 : end], place + 2, offset)


@dataclass
class Messages:
    """Messages that were found, and what was not one.

    Attributes:
        layouts: by header.
        found: bytes of all messages of a header, one after another.
        bad: beginnings of messages with a wrong checksum.
        count: intact messages.
    """

    layouts: dict[bytes, Layout] = field(default_factory=dict)
    found: dict[bytes, bytearray] = field(default_factory=dict)
    bad: int = 0
    count: int = 0

    def add(self, pieces: Iterator[bytes]) -> None:
        """Find the messages in pieces of a stream, whatever is between them."""
        rest = b""
        for piece in pieces:
            rest = rest + piece
            rest = rest[self._scan(rest, len(rest) - LONGEST) :]
        self._scan(rest, len(rest))

    def _scan(self, data: bytes, end: int) -> int:
        """Messages that begin before an offset; where to go on."""
        at = data.find(SYNC, 0, max(end, 0))
        behind = max(end, 0)
        while at >= 0:
            layout = layout_at(data, at)
            size = 1
            if layout is not None and at + layout.size <= len(data):
                if crc_hqx(data[at + 1 : at + layout.size], 0) == 0:
                    size = layout.size
                    self.layouts.setdefault(layout.header, layout)
                    self.found.setdefault(layout.header, bytearray()).extend(data[at : at + size])
                    self.count += 1
                elif layout.header in self.layouts:
                    self.bad += 1
            behind = max(behind, at + size) if size > 1 else behind
            at = data.find(SYNC, at + size, max(end, 0))
        return min(behind, len(data))

    def column(self, header: bytes, offset: int, kind: str, count: int) -> FloatArray:
        """(n, count) numbers at an offset of all messages of a header."""
        size = self.layouts[header].size
        rows = np.frombuffer(bytes(self.found[header]), np.uint8).reshape(-1, size)
        width = np.dtype(kind).itemsize * count
        return np.ascontiguousarray(rows[:, offset : offset + width]).view(kind).astype(np.float64)

    def gps_s(self, header: bytes) -> FloatArray:
        """(n,) GPS seconds since 1980-01-06; nan where the device does not know them."""
        layout = self.layouts[header]
        whole = layout.first(TIME_GPS)
        if whole is not None:
            since = 1e-9 * self.column(header, whole, "<u8", 1)[:, 0]
        else:
            week = self.column(header, layout.offset[GPS_WEEK], "<u2", 1)[:, 0]
            since = 604_800.0 * week + 1e-9 * self.column(header, layout.offset[GPS_TOW], "<u8", 1)[:, 0]
            since[week == 0] = 0.0
        return np.where((since > EARLIEST_S) & (since < LATEST_S), since, np.nan)


EARLIEST_S: Final = 3.2e8
LATEST_S: Final = 4.0e9
"""GPS times before 1990 and after 2106 are of a device without a fix."""
