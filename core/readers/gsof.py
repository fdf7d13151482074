"""Logs of Trimble receivers: GSOF records in packets of the Data Collector Format.

A packet is 02, status, type, length, content, a sum of the bytes behind 02 modulo 256, and 03. Those of type 40
hexadecimal (GENOUT) hold the pages of transmissions: transmission number, page, last page, then a part of the records,
each with its type and length; numbers are big-endian (Trimble, OEM GNSS receiver help, "GSOF messages").
"""

from collections import defaultdict
from dataclasses import replace
from pathlib import Path
from typing import Any, ClassVar, Final

import numpy as np
from numpy.typing import NDArray

from furrowmap.core.readers.framed_messages import MessageCounts, Messages, at_equal, count_foreign, scan_stream
from furrowmap.core.readers.position_log import (
    MIN_INTACT_SHARE,
    LoggedPositions,
    PositionLog,
    byte_place,
    damage_notices,
    dated_positions,
    log_facts,
)
from furrowmap.core.readers.reader import recording_name
from furrowmap.core.readers.source import Head
from furrowmap.core.runtime.arrays import FloatArray
from furrowmap.core.runtime.errors import InputError
from furrowmap.core.runtime.languages.texts import Text
from furrowmap.core.values.clock import WEEK_S, gps_to_utc_s
from furrowmap.core.values.gnss import Fix

TIME_RECORD: Final = 1
PLACE_RECORD: Final = 2
VELOCITY_RECORD: Final = 8
DILUTION_RECORD: Final = 9
SIGMAS_RECORD: Final = 12
ATTITUDE_RECORD: Final = 27
SOLUTION_RECORD: Final = 38
"""Types of the records that are read."""
_LAYOUTS: Final = {
    TIME_RECORD: np.dtype([("ms", ">u4"), ("week", ">u2"), ("satellites", "u1"), ("flags", "u1"), ("solution", "u1")]),
    PLACE_RECORD: np.dtype([("lat", ">f8"), ("lon", ">f8"), ("height", ">f8")]),
    VELOCITY_RECORD: np.dtype([("flags", "u1"), ("speed", ">f4"), ("course", ">f4")]),
    DILUTION_RECORD: np.dtype([("pdop", ">f4"), ("hdop", ">f4")]),
    SIGMAS_RECORD: np.dtype([("rms", ">f4"), ("e", ">f4"), ("n", ">f4"), ("en", ">f4"), ("h", ">f4")]),
    ATTITUDE_RECORD: np.dtype(
        [("ms", ">u4"), ("valid", "u1"), ("satellites", "u1"), ("mode", ">u2"), ("pitch", ">f8"), ("yaw", ">f8")]
    ),
    SOLUTION_RECORD: np.dtype([("scale", ">f4"), ("rtk", ">u2"), ("age", ">f4"), ("network", "u1")]),
}
"""What all versions of a record begin with."""
_NAMES: Final = {
    1: "position time", 2: "lat long height", 3: "ECEF position", 4: "local datum", 5: "local zone", 6: "ECEF delta",
    7: "tangent plane delta", 8: "velocity", 9: "PDOP", 10: "clock", 11: "position VCV", 12: "position sigma",
    13: "SV brief", 14: "SV detailed", 15: "receiver serial number", 16: "current time", 26: "position time UTC",
    27: "attitude", 33: "all SV brief", 34: "all SV detailed", 35: "received base", 37: "battery and memory",
    38: "position type", 40: "L-band status", 41: "base position and quality", 49: "INS full navigation",
    50: "INS RMS", 57: "radio",
}  # fmt: skip
_STX: Final = b"\x02"
_ETX: Final = 0x03
_GENOUT: Final = 0x40
_KEPT_RECORD_BYTES: Final = 200
"""Memory of a record that is kept."""
_PACKET_BYTES: Final = 6
"""Of a packet without content."""
_NEW: Final = 1
_HORIZONTAL: Final = 4
_DIFFERENTIAL: Final = 1
_CARRIER_PHASE: Final = 2
_FIXED: Final = 4
_OMNISTAR: Final = 8
_RTX: Final = 64
_VELOCITY_VALID: Final = 1
_YAW_VALID: Final = 4
_FIXED_MODE: Final = 3 << 8
"""Bit of the flags of an attitude; mode of one with fixed ambiguities, with the reserved byte behind it."""

_Content = tuple[int, bytes]
"""Offset of a transmission in the stream, and a record in it."""


class _Scanner:
    """Finds the records of a stream that is given piece by piece."""

    def __init__(self, counts: MessageCounts[str]) -> None:
        self.counts = counts
        self.found: dict[int, list[_Content]] = defaultdict(list)
        self._pages: list[bytes] = []
        self._open = (-1, -1)
        """Number and last page of the transmission that has begun."""

    def scan(self, data: bytes, base: int, last: bool) -> int:
        """Take the packets of a piece; the number of bytes that are done with."""
        spans = [0]
        at = 0
        used = len(data)
        while (begin := data.find(_STX, at)) >= 0:
            end = begin + _PACKET_BYTES + (data[begin + 3] if begin + 3 < len(data) else 0)
            if end > len(data):
                if not last:
                    used = begin
                    break
                self.counts.cut += data[begin + 2 : begin + 3] == bytes([_GENOUT])
            elif data[end - 1] == _ETX:
                if sum(data[begin + 1 : end - 2]) & 0xFF == data[end - 2]:
                    spans += [begin, end]
                    self.counts.message_bytes += end - begin
                    self._take(data[begin + 2], data[begin + 4 : end - 2], base + begin)
                    at = end
                    continue
                self.counts.bad += data[begin + 2] == _GENOUT
            at = begin + 1
        bounds = np.array([*spans, max(used, spans[-1])], np.int64)
        self.counts.foreign_bytes += count_foreign(np.frombuffer(data, np.uint8), bounds.reshape(-1, 2))
        return used

    def _take(self, kind: int, content: bytes, at: int) -> None:
        """Take a packet: the records of the transmission that it completes."""
        if kind != _GENOUT or len(content) < 3:
            self.counts.kinds[f"packet {kind:02X}"] += 1
            return
        number, page, last_page = content[:3]
        if page == 0:
            self.counts.bad += bool(self._pages)
            self._pages = [content[3:]]
            self._open = (number, last_page)
        elif self._open == (number, last_page) and page == len(self._pages):
            self._pages.append(content[3:])
        else:
            self.counts.bad += 1
            self._pages = []
        if self._pages and page == last_page:
            records = b"".join(self._pages)
            self._pages = []
            k = 0
            while k + 2 <= len(records):
                kind, size = records[k : k + 2]
                record = records[k + 2 : k + 2 + size]
                k += 2 + size
                layout = _LAYOUTS.get(kind)
                if len(record) < max(size, layout.itemsize if layout else 0):
                    self.counts.bad += 1
                    continue
                self.counts.kinds[_NAMES.get(kind, f"record {kind}")] += 1
                if layout:
                    self.counts.row_bytes += _KEPT_RECORD_BYTES
                    self.found[kind].append((at, record[: layout.itemsize]))

    def messages(self, kind: int) -> Messages:
        """The records of a type."""
        rows = self.found[kind]
        values = np.frombuffer(b"".join(record for _, record in rows), _LAYOUTS[kind])
        return Messages(values, np.array([at for at, _ in rows], np.int64))


class GsofLog(PositionLog):
    """The positions in a log of Trimble's GSOF records.

    Records 1 (time and kind of solution) and 2 (place) of a transmission make the epoch. Speed and course (8), dilution
    (9), standard deviations (12), the heading of two antennas (27) and the age of corrections (38) are joined where the
    same transmission has them. Heights are above the ellipsoid.
    """

    format: ClassVar[str] = "gsof"
    title: ClassVar[Text] = Text("Trimble GSOF log")

    @classmethod
    def recognise(cls, head: Head) -> float:
        """By records with positions; possible (0.3) where there are others."""
        scanner = _Scanner(MessageCounts[str]())
        scanner.scan(head.data, 0, last=True)
        if scanner.found[TIME_RECORD] and scanner.found[PLACE_RECORD]:
            return 0.95
        counts = scanner.counts
        return 0.3 if counts.intact > 2 and counts.message_bytes >= MIN_INTACT_SHARE * len(head.data) else 0.0

    def _read(self, paths: list[Path]) -> LoggedPositions:
        scanner = _Scanner(MessageCounts[str]())
        ends = []
        for source in self._sources(paths):
            scan_stream(source, scanner.counts, scanner.scan)
            ends.append(scanner.counts.stream_bytes)
        name = recording_name(paths)
        self.notices += damage_notices(scanner.counts, name)
        facts = log_facts(scanner.counts, "messages", str)
        time = scanner.messages(TIME_RECORD)
        place = scanner.messages(PLACE_RECORD)
        base = time[np.isin(time.at, place.at)]
        if not len(base):
            kinds = ", ".join(kind for kind, _ in scanner.counts.kinds.most_common(4))
            fault = InputError("no-positions.gsof", name=name, frames=kinds or None)
            return replace(LoggedPositions.none(name, fault), facts=facts)
        columns, ppp = _columns(base, scanner)
        service = "ppp" if np.mean(ppp) > 0.5 else ""
        return dated_positions(
            columns, base.at, byte_place(paths, ends), name=name, what="records of positions", facts=facts,
            service=service,
        )  # fmt: skip


def _columns(base: Messages, scanner: _Scanner) -> tuple[dict[str, NDArray[Any]], NDArray[np.bool_]]:
    """The columns (n,) of the epochs, with nan for unknown times, and which of them are PPP."""

    def joined(kind: int, field: str) -> FloatArray:
        """A field (n,) of another record of the same transmissions; nan without it."""
        other = scanner.messages(kind)
        if kind == VELOCITY_RECORD:
            other = other[(other.values["flags"] & _VELOCITY_VALID) > 0]
        if kind == ATTITUDE_RECORD:
            fixed = other.values["mode"] & 0xFF00 == _FIXED_MODE
            other = other[fixed & ((other.values["valid"] & _YAW_VALID) > 0)]
        return at_equal(base.at, other.at, other.column(field))

    solution, flags, week = (base.values[field].astype(np.int64) for field in ("solution", "flags", "week"))
    differential, phase, fixed = ((solution & bit) > 0 for bit in (_DIFFERENTIAL, _CARRIER_PHASE, _FIXED))
    network = np.nan_to_num(joined(SOLUTION_RECORD, "network")).astype(np.int64)
    ppp = differential & phase & ((network & _RTX > 0) | (solution & _OMNISTAR > 0) & ~fixed)
    fix = np.select(
        [(flags & (_NEW | _HORIZONTAL)) != _NEW | _HORIZONTAL, ppp, differential & phase & fixed, differential & phase,
         differential | fixed],
        [Fix.NONE, Fix.PPP, Fix.FIXED, Fix.FLOAT, Fix.DGPS],
        Fix.SINGLE,
    )  # fmt: skip
    lat, lon = (np.degrees(joined(PLACE_RECORD, name)) for name in ("lat", "lon"))
    on_earth = (np.abs(lat) <= 90.0) & (np.abs(lon) <= 360.0)
    ms = base.column("ms")
    known = (week > 0) & (week < 10_000) & (ms < 1000.0 * WEEK_S)
    sigma = {f"sigma_{axis}_m": joined(SIGMAS_RECORD, axis) for axis in "enh"}
    return {
        "t_s": np.where(known, gps_to_utc_s(week * WEEK_S + 1e-3 * ms), np.nan),
        "lon_deg": np.where(on_earth, lon, np.nan),
        "lat_deg": np.where(on_earth, lat, np.nan),
        "height_m": joined(PLACE_RECORD, "height"),
        "fix": fix.astype(np.int8),
        **{name: np.where(values > 0.0, values, np.nan) for name, values in sigma.items()},
        "speed_mps": joined(VELOCITY_RECORD, "speed"),
        "course_deg": np.degrees(joined(VELOCITY_RECORD, "course")) % 360.0,
        "heading_deg": np.degrees(joined(ATTITUDE_RECORD, "yaw")) % 360.0,
        "satellites": base.values["satellites"].astype(np.int16),
        "hdop": joined(DILUTION_RECORD, "hdop"),
        "age_s": joined(SOLUTION_RECORD, "age"),
    }, ppp
