"""Logs of VectorNav sensors (VN-100, VN-200, VN-300, VN-310) as inertial measurements and attitudes.

A binary message is the byte FA, a byte with the groups that follow, 16 bits with the fields of each group, the fields
in the order of their bits, and a CRC-16 (polynomial 1021 hexadecimal, initial value 0) over all behind the first byte
(VN-200 user manual UM004, "User configurable binary output messages"). All numbers are little-endian.

An ASCII sentence is ``$VNIMU,…*XX`` with a checksum of 8 or 16 bits. Sentences of measurements have no time of their
own. It is what a logger wrote before them, or follows from sentences between them that have GPS time (`VNINS`,
`VNGPS`).
"""

import datetime as dt
import re
import struct
from abc import ABC, abstractmethod
from binascii import crc_hqx
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import reduce
from operator import xor
from pathlib import Path
from typing import Any, ClassVar, Final

import numpy as np

from furrowmap.core.readers.framed_messages import MESSAGE_CHUNK_BYTES, MessageCounts, scan_stream
from furrowmap.core.readers.inertial_rows import (
    attitude_track,
    first_beyond,
    imu_notices,
    inertial_facts,
    inertial_track,
    inspected_track,
)
from furrowmap.core.readers.reader import FileReader, Inspection
from furrowmap.core.readers.source import Head, Source, cut_notice
from furrowmap.core.runtime.arrays import FloatArray
from furrowmap.core.runtime.errors import InputError, Notice
from furrowmap.core.runtime.languages.texts import Text
from furrowmap.core.values.clock import WEEK_S, gps_to_utc_s
from furrowmap.core.values.inertial import InertialTrack, StatedUnits
from furrowmap.core.values.pose_track import UNSTATED_NORTH, AttitudeTrack
from furrowmap.core.values.scan import Clock, ClockReading

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
class _BinaryLayout:
    """The content of messages with one header: its bytes, the size of a message, offsets of fields by group and bit."""

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


def _layout_at(data: bytes, at: int) -> _BinaryLayout | None:
    """The layout of a message that begins at an offset; None where the bytes are no header."""
    groups = data[at + 1] if at + 1 < len(data) else 0
    chosen = [group for group in range(len(SIZES)) if groups >> group & 1]
    end = at + 2 + 2 * len(chosen)
    if not chosen or groups & 0x80 or end > len(data):
        return None
    offset = {}
    place = end - at
    for group, fields in zip(chosen, struct.unpack_from(f"<{len(chosen)}H", data, at + 2), strict=True):
        if not fields or fields >> len(SIZES[group]):
            return None
        for bit, size in enumerate(SIZES[group]):
            if fields >> bit & 1:
                offset[group, bit] = place
                place += size
    return _BinaryLayout(data[at + 1 : end], place + 2, offset)


@dataclass
class BinaryMessages:
    """Messages that were found, those of a header one after another, and what was not one."""

    layouts: dict[bytes, _BinaryLayout] = field(default_factory=dict)
    found: dict[bytes, bytearray] = field(default_factory=dict)
    counts: MessageCounts[bytes] = field(default_factory=MessageCounts)

    def scan(self, data: bytes, base: int = 0, last: bool = True) -> int:  # noqa: ARG002
        """Find the messages in a piece of a stream; see :func:`~furrowmap.core.readers.framed_messages.scan_stream`."""
        end = len(data) if last else max(len(data) - MAX_MESSAGE_BYTES, 0)
        done = end
        at = data.find(SYNC, 0, end)
        while at >= 0:
            layout = _layout_at(data, at)
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
        rate = layout.find(_RATE_FIELDS)
        force = layout.find(_FORCE_FIELDS)
        angles = layout.find(_YAW_PITCH_ROLL)
        if rate is not None and force is not None:
            rows[:, 1:4] = column(rate, "<f4", 3)
            rows[:, 4:7] = column(force, "<f4", 3)
        if angles is not None:
            rows[:, 7:] = column(angles, "<f4", 3)
        return rows


_VN_SENTENCE: Final = re.compile(rb"([^$\r\n]{0,64})\$(VN[A-Z]{3}),([^*$\r\n]{1,400})\*([0-9A-Fa-fX]{2,4})")
MEASURED_FIELDS: Final = {b"VNIMU": (6, 3, 11), b"VNYMR": (9, 6, 12), b"VNMAR": (6, 3, 9)}
"""First fields of angular rate and specific force, and the number of fields."""
TIMED_FIELDS: Final = {b"VNINS": 15, b"VNGPS": 15}
"""Sentences whose first two fields are GPS seconds of the week and week, and the number of fields at least."""
STAMPS_S: Final = (6.0e8, 5.0e9)
"""Numbers before a sentence that are smaller or larger are no seconds of UTC."""


_KEPT_ROW_BYTES: Final = 400
"""Memory of a row of numbers."""


@dataclass
class AsciiSentences:
    """Sentences of a log in their order.

    Attributes:
        rows: fields 0 to 2 time before the sentence (UTC, else nan), GPS time (else nan), number of the line; then
            angular rate and specific force (else nan), and yaw, pitch, roll (else nan).
        counts: those with fields that are no numbers count as bad, too.
    """

    rows: list[tuple[float, ...]] = field(default_factory=list)
    counts: MessageCounts[str] = field(default_factory=MessageCounts)

    def scan(self, data: bytes, base: int = 0, last: bool = True) -> int:  # noqa: ARG002
        """Find the sentences in part of a stream; see :func:`~furrowmap.core.readers.framed_messages.scan_stream`."""
        end = len(data) if last or len(data) >= 2 * MESSAGE_CHUNK_BYTES else data.rfind(b"\n") + 1
        for before, kind, body, checksum in _VN_SENTENCE.findall(data[:end]):
            values = _fields(kind, body, checksum)
            if values is None:
                self.counts.bad += 1
                continue
            self.counts.kinds[kind.decode()] += 1
            measured: tuple[float, ...] = (np.nan,) * 6
            angles: tuple[float, ...] = (np.nan,) * 3
            gps_s = np.nan
            if kind in MEASURED_FIELDS and len(values) >= MEASURED_FIELDS[kind][2]:
                rate, force, _ = MEASURED_FIELDS[kind]
                measured = (*values[rate : rate + 3], *values[force : force + 3])
            if kind in (b"VNYMR", b"VNYPR") and len(values) >= 3:
                angles = (values[0], values[1], values[2])
            if kind in TIMED_FIELDS and len(values) >= TIMED_FIELDS[kind] and values[1] > 0:
                gps_s = WEEK_S * values[1] + values[0]
            self.counts.row_bytes += _KEPT_ROW_BYTES
            self.rows.append((_stamp_s(before), gps_s, float(len(self.rows)), *measured, *angles))
        return end

    def table(self) -> FloatArray:
        """(n, 12) the rows."""
        return np.array(self.rows, np.float64).reshape(-1, 12)


def _fields(kind: bytes, body: bytes, checksum: bytes) -> list[float] | None:
    """The numbers of a sentence; None if it is damaged. A checksum of XX was switched off."""
    text = kind + b"," + body
    if b"X" not in checksum.upper():
        right = reduce(xor, text) if len(checksum) == 2 else crc_hqx(text, 0)
        if len(checksum) == 3 or int(checksum, 16) != right:
            return None
    try:
        # The status of VNINS is hexadecimal.
        values = [float(part) if k != 2 or kind not in TIMED_FIELDS else 0.0 for k, part in enumerate(body.split(b","))]
    except ValueError:
        return None
    return values if all(np.isfinite(values)) else None


def _stamp_s(before: bytes) -> float:
    """UTC that a logger wrote before a sentence: seconds or milliseconds since 1970, or ISO 8601; else nan."""
    text = before.decode("latin-1").strip(" \t,;:[]\"'")
    try:
        number = float(text)
    except ValueError:
        try:
            stamp = dt.datetime.fromisoformat(text)
        except ValueError:
            return float("nan")
        return (stamp if stamp.tzinfo else stamp.replace(tzinfo=dt.UTC)).timestamp()
    if number > 1e3 * STAMPS_S[0]:
        number *= 1e-3
    return number if STAMPS_S[0] < number < STAMPS_S[1] else float("nan")


class _VectorNav(FileReader, ABC):
    """What both forms of logs have in common."""

    @abstractmethod
    def _rows(self) -> FloatArray:
        """Rows (n, 10) of all files, see :data:`ROW_COLUMNS`; nan for what a row does not have."""

    def inertial(self) -> InertialTrack:
        """All measurements, in the axes of the sensor: forward, right, down."""
        return self._inertial(self.options.units)

    def _inertial(self, units: StatedUnits) -> InertialTrack:
        rows = self._rows()
        name = self.name
        measured = rows[np.isfinite(rows[:, 1:7]).all(axis=1)]
        timed = measured[np.isfinite(measured[:, 0])]
        if len(timed) < 2:
            if len(measured):
                raise InputError("imu-no-times", name=name, measured=len(measured))
            raise InputError("imu-no-measurements", name=name)
        if untimed := len(measured) - len(timed):
            notice = Notice("rows-incomplete.measurements", name=name, measured=untimed, measured_count=len(measured))
            self.notices.append(notice)
        values = units.in_si(timed[:, 1:7])
        beyond = first_beyond(values)
        if beyond is not None:
            raise InputError("value-out-of-range.beyond-imus", name=name, beyond=beyond[0])
        track, late = inertial_track(timed[:, 0], values, name)
        self.notices += late
        return track

    def attitude(self) -> AttitudeTrack:
        """The attitudes by the device's own filter; it does not say from which north they count."""
        rows = self._rows()
        rows = rows[np.isfinite(rows[:, [0, 7, 8, 9]]).all(axis=1)]
        angles = np.column_stack([rows[:, 9], rows[:, 8], rows[:, 7] % 360.0])
        track, late = attitude_track(rows[:, 0], angles, UNSTATED_NORTH, self.name)
        self.notices += late
        return track

    def inspect(self) -> Inspection:
        """Read the whole first file and report rates, span and the mean specific force."""
        reader = type(self)(self.paths[:1], self.options)
        track = inspected_track(reader._inertial, self.options.units)
        clock = ClockReading(Clock.STATED, float(track.t_s[0]), float(track.t_s[-1]), "of the sensor")
        notices = (*dict.fromkeys(reader.notices), *imu_notices(track))
        return Inspection(self.paths[0], self.format, self.title, inertial_facts(track), (clock,), notices)

    def _scan(self, path: Path, counts: MessageCounts[Any], scan: Callable[[bytes, int, bool], int]) -> None:
        """Pass a file to `scan`, and report what is damaged."""
        with Source(path) as source:
            scan_stream(source, counts, scan)
        if source.fault:
            self.notices.append(cut_notice(path, source.fault))
        if counts.bad:
            notice = Notice("sentences-damaged.binary-messages", paths=self.name, bad=counts.bad, intact=counts.intact)
            self.notices += [notice] if notice not in self.notices else []


class VectorNavBinary(_VectorNav):
    """Binary output messages with GPS time (TimeGps, or GpsTow and GpsWeek), angular rate and specific force."""

    format: ClassVar[str] = "vectornav-binary"
    title: ClassVar[Text] = Text("VectorNav binary messages")

    @classmethod
    def recognise(cls, head: Head) -> float:
        """Certain with intact messages that hold measurements."""
        if bytes((SYNC,)) not in head.data[:8192]:
            return 0.0
        found = BinaryMessages()
        found.scan(head.data)
        if found.counts.intact < 2:
            return 0.0
        return 1.0 if any(layout.is_inertial for layout in found.layouts.values()) else 0.6

    def _rows(self) -> FloatArray:
        parts = [np.empty((0, ROW_COLUMNS))]
        for path in self.paths:
            found = BinaryMessages()
            self._scan(path, found.counts, found.scan)
            outputs = [found.rows(header) for header in found.found]
            # Of several binary outputs, measurements and attitudes of the one with most of them each are used.
            for columns in (slice(1, 7), slice(7, 10)):
                count = [int(np.isfinite(rows[:, [0, columns.start]]).all(axis=1).sum()) for rows in outputs]
                for k, rows in enumerate(outputs):
                    if k != int(np.argmax(count)):
                        rows[:, columns] = np.nan
            parts += outputs
        return np.concatenate(parts)


class VectorNavAscii(_VectorNav):
    """ASCII sentences `VNIMU`, `VNYMR` or `VNMAR`.

    Their times are those that a logger wrote before each, or of `VNINS` or `VNGPS` between them. Between sentences
    with GPS time the others are spread evenly, so both should come at constant rates.
    """

    format: ClassVar[str] = "vectornav-ascii"
    title: ClassVar[Text] = Text("VectorNav ASCII sentences")

    @classmethod
    def recognise(cls, head: Head) -> float:
        """Certain with intact sentences of measurements."""
        if b"$VN" not in head.data:
            return 0.0
        found = AsciiSentences()
        found.scan(head.data)
        if not found.counts.kinds:
            return 0.0
        return 1.0 if any(kind.encode() in MEASURED_FIELDS for kind in found.counts.kinds) else 0.4

    def _rows(self) -> FloatArray:
        parts = [np.empty((0, ROW_COLUMNS))]
        for path in self.paths:
            found = AsciiSentences()
            self._scan(path, found.counts, found.scan)
            table = found.table()
            parts.append(np.column_stack([_times_s(table), table[:, 3:]]))
        return np.concatenate(parts)


def _times_s(table: FloatArray) -> FloatArray:
    """UTC (n,) of sentences (n, 12): as the logger wrote it, else between those with GPS time; else nan."""
    stamped = np.isfinite(table[:, 0])
    timed = np.isfinite(table[:, 1])
    measured = np.isfinite(table[:, 3])
    if stamped[measured].any():
        return table[:, 0]
    if timed.sum() < 2:
        return np.full(len(table), np.nan)
    utc_s = gps_to_utc_s(table[timed, 1])
    line = table[timed, 2]
    inside = (table[:, 2] >= line[0]) & (table[:, 2] <= line[-1])
    return np.where(inside, np.interp(table[:, 2], line, utc_s), np.nan)
