"""Binary output messages of VectorNav sensors (VN-100, VN-200, VN-300, VN-310).

A message is the byte FA, a byte with the groups that follow, 16 bits with the fields of each group, the fields in the
order of their bits, and a CRC-16 (polynomial 1021 hexadecimal, initial value 0) over all behind the first byte
(VN-200 user manual UM004, "User configurable binary output messages"). All numbers are little-endian.
"""

from __future__ import annotations

import struct
from binascii import crc_hqx
from dataclasses import dataclass, field
from typing import Final

import numpy as np

from furrowmap.core.readers.messages import MessageCounts
from furrowmap.core.runtime.arrays import FloatArray
from furrowmap.core.values.clock import WEEK_S, gps_to_utc_s

SYNC: Final = 0xFA
MAX_MESSAGE_BYTES: Final = 2048
"""All groups with all their fields are shorter."""
GPS_TIMES_S: Final = (3.2e8, 4.0e9)
"""GPS times before 1990 and after 2106 are of a device without a fix."""
ROW_COLUMNS: Final = 10
"""UTC, angular rate (rad/s), specific force (m/s²), yaw, pitch, roll (degrees)."""
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
_TIME_GPS: Final = (((0, 1), 0), ((1, 1), 0))
_GPS_TOW: Final = (1, 2)
_GPS_WEEK: Final = (1, 3)
_RATE_FIELDS: Final = (((2, 3), 0), ((0, 9), 12), ((2, 10), 0), ((0, 5), 0))
_FORCE_FIELDS: Final = (((2, 2), 0), ((0, 9), 0), ((2, 9), 0), ((0, 8), 0))
"""Angular rate and specific force: (group, field), and the offset in it. Those of the calibrated sensors come first;
the others are less the biases that the device's own filter estimates, which jump."""
_YAW_PITCH_ROLL: Final = (((0, 3), 0), ((4, 1), 0))


@dataclass(frozen=True)
class BinaryLayout:
    """The content of messages with one header.

    Attributes:
        header: the bytes from that of the groups to before the fields.
        size: of a message, with the first byte and the checksum.
        offset: of each field from the start of a message, by group and bit.
    """

    header: bytes
    size: int
    offset: dict[tuple[int, int], int]

    def find(self, wanted: tuple[tuple[tuple[int, int], int], ...]) -> int | None:
        """Offset of the first of some fields that is there."""
        return next((self.offset[one] + inside for one, inside in wanted if one in self.offset), None)

    @property
    def is_inertial(self) -> bool:
        """Whether the messages hold angular rate and specific force."""
        return self.find(_RATE_FIELDS) is not None and self.find(_FORCE_FIELDS) is not None


def layout_at(data: bytes, at: int) -> BinaryLayout | None:
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
    return BinaryLayout(data[at + 1 : end], place + 2, offset)


@dataclass
class BinaryMessages:
    """Messages that were found, and what was not one.

    Attributes:
        layouts: by header.
        found: bytes of all messages of a header, one after another.
        counts: their kind is the header.
    """

    layouts: dict[bytes, BinaryLayout] = field(default_factory=dict)
    found: dict[bytes, bytearray] = field(default_factory=dict)
    counts: MessageCounts[bytes] = field(default_factory=MessageCounts)

    def scan(self, data: bytes, base: int = 0, last: bool = True) -> int:  # noqa: ARG002
        """Find the messages in a piece of a stream; see :func:`~furrowmap.core.readers.messages.scan_stream`."""
        end = len(data) if last else max(len(data) - MAX_MESSAGE_BYTES, 0)
        done = end
        at = data.find(SYNC, 0, end)
        while at >= 0:
            layout = layout_at(data, at)
            size = 1
            if layout is not None and at + layout.size <= len(data):
                if crc_hqx(data[at + 1 : at + layout.size], 0) == 0:
                    size = layout.size
                    self.layouts.setdefault(layout.header, layout)
                    self.found.setdefault(layout.header, bytearray()).extend(data[at : at + size])
                    self.counts.kinds[layout.header] += 1
                    done = max(done, at + size)
                elif layout.header in self.layouts:
                    self.counts.bad += 1
            at = data.find(SYNC, at + size, end)
        return done

    def rows(self, header: bytes) -> FloatArray:
        """Rows (n, 10), see :data:`ROW_COLUMNS`, of the messages of a header; nan for what they do not have."""
        layout = self.layouts[header]
        messages = np.frombuffer(bytes(self.found[header]), np.uint8).reshape(-1, layout.size)

        def column(offset: int, kind: str, count: int) -> FloatArray:
            width = np.dtype(kind).itemsize * count
            return np.ascontiguousarray(messages[:, offset : offset + width]).view(kind).astype(np.float64)

        rows = np.full((len(messages), ROW_COLUMNS), np.nan)
        gps_s = np.zeros(len(messages))
        if (at := layout.find(_TIME_GPS)) is not None:
            gps_s = 1e-9 * column(at, "<u8", 1)[:, 0]
        elif _GPS_TOW in layout.offset and _GPS_WEEK in layout.offset:
            week = column(layout.offset[_GPS_WEEK], "<u2", 1)[:, 0]
            gps_s = np.where(week > 0, WEEK_S * week + 1e-9 * column(layout.offset[_GPS_TOW], "<u8", 1)[:, 0], 0.0)
        known = (gps_s > GPS_TIMES_S[0]) & (gps_s < GPS_TIMES_S[1])
        rows[known, 0] = gps_to_utc_s(gps_s[known])
        rate, force, angles = layout.find(_RATE_FIELDS), layout.find(_FORCE_FIELDS), layout.find(_YAW_PITCH_ROLL)
        if rate is not None and force is not None:
            rows[:, 1:4] = column(rate, "<f4", 3)
            rows[:, 4:7] = column(force, "<f4", 3)
        if angles is not None:
            rows[:, 7:] = column(angles, "<f4", 3)
        return rows
