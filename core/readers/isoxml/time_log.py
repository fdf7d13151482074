"""Time logs, `TLG`: an XML header that describes the records, and binary records.

ISO 11783-10:2015, annex D.8 and clause 8.8.2.2. A record, little-endian: milliseconds of the day (u32), days since
1980-01-01 (u16), the attributes of PTN that the header leaves open in their order, the number of values (u8), and for
each value its index among the header's DLV (u8) and an i32. A record has only the values that changed.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from furrowmap.core.readers.isoxml.records import find_records, read_values
from furrowmap.core.readers.isoxml.xml import Element, parse_xml
from furrowmap.core.runtime.errors import InputError, Notice

FloatArray = NDArray[np.float64]

EPOCH_S: Final = 315_532_800
"""1980-01-01, day 0, in POSIX seconds."""
DAY_S: Final = 86_400
POSITION: Final = {"A": 4, "B": 4, "C": 4, "D": 1, "E": 2, "F": 2, "G": 1, "H": 4, "I": 2}
"""Bytes of each attribute of PTN: latitude, longitude, up, status, PDOP, HDOP, satellites, GPS time and day."""
MOST_VALUES: Final = 255
NOT_AVAILABLE: Final = 0x7FFFFFFF


@dataclass(frozen=True)
class Channel:
    """The meaning of a value, a `DLV` of the header.

    Attributes:
        ddi: data dictionary identifier (ISO 11783-11).
        element: id of its device element.
    """

    ddi: int
    element: str


@dataclass(frozen=True)
class Header:
    """The layout of records.

    Attributes:
        open: letters of the PTN attributes in each record.
        fixed: raw value of the PTN attributes that the header states for all records.
        channels: of the values, in their order.
    """

    open: str
    fixed: dict[str, float]
    channels: tuple[Channel, ...]


@dataclass(frozen=True)
class TimeLog:
    """A time log's records in the order of the file.

    Attributes:
        name: name of the file, for messages.
        clock_s: (n,) time of the terminal's clock, POSIX seconds as if it were UTC.
        lat_deg: (n,) nan without a position.
        lon_deg: (n,) likewise.
        up_m: (n,) height above the ellipsoid; nan where not stated.
        status: (n,) int8: the codes of NMEA 2000 (0 none, 1 single, 2 DGNSS, 3 precise, 4 RTK fixed, 5 float, ...), −1
            where not stated.
        hdop: (n,) nan where not stated.
        satellites: (n,) int16, −1 where not stated.
        gps_s: (n,) UTC by GPS, POSIX seconds; nan where not stated.
        record: (m,) int64 index of the record of each value.
        channel: (m,) uint8 index among the channels of each value.
        value: (m,) int32 raw.
        notices: damage.
    """

    name: str
    clock_s: FloatArray
    lat_deg: FloatArray
    lon_deg: FloatArray
    up_m: FloatArray
    status: NDArray[np.int8]
    hdop: FloatArray
    satellites: NDArray[np.int16]
    gps_s: FloatArray
    header: Header
    record: NDArray[np.int64]
    channel: NDArray[np.uint8]
    value: NDArray[np.int32]
    notices: tuple[Notice, ...]

    def __len__(self) -> int:
        return len(self.clock_s)

    @cached_property
    def placed(self) -> NDArray[np.bool_]:
        """(n,) whether a record has a position."""
        return np.isfinite(self.lat_deg)

    def channels(self, ddi: int) -> list[int]:
        """Indices of the channels of a data dictionary identifier that have at least one value."""
        seen = np.zeros(MOST_VALUES + 1, bool)
        seen[self.channel] = True
        return [k for k, channel in enumerate(self.header.channels) if channel.ddi == ddi and seen[k]]

    def latest(self, channel: int) -> FloatArray:
        """(n,) the raw value at each record, the last one logged; nan before the first."""
        mine = self.channel == channel
        at, value = self.record[mine], self.value[mine].astype(np.float64)
        row = np.searchsorted(at, np.arange(len(self)), side="right") - 1
        return np.where(row >= 0, value[np.maximum(row, 0)] if len(value) else np.nan, np.nan)


def read_time_log(header: bytes, records: bytes, name: str) -> TimeLog:
    """A time log from the content of its two files.

    After damage (a byte was lost or added), reading resumes at the next two plausible records in a row; a notice counts
    the bytes between.

    Raises:
        InputError: if the header is invalid.
    """
    layout = read_header(header, name)
    data = np.frombuffer(records, np.uint8)
    width = 6 + sum(POSITION[letter] for letter in layout.open)
    places = _offset(layout.open, "A"), _offset(layout.open, "B")
    starts, lost, breaks = find_records(data, width, places, len(layout.channels))
    notices = _damage(name, len(data), lost, breaks)
    return _assembled(name, layout, data, starts, read_values(data, starts, width), notices)


def read_header(data: bytes, name: str) -> Header:
    """The header of a time log.

    Raises:
        InputError: if it is invalid.
    """
    root = parse_xml(data, f"{name}.xml")
    position = next(root.all("PTN"), None)
    if root.tag != "TIM" or position is None:
        raise InputError("time-log-header", name=name, tag=root.tag[:40], position=", without PTN" * (position is None))
    channels = [_channel(item, name) for item in root.all("DLV")]
    if len(channels) > MOST_VALUES + 1:
        raise InputError("time-log-header.read-header", name=name, channels=len(channels), most_values=MOST_VALUES + 1)
    present = [letter for letter in POSITION if letter in position.attributes]
    stated = {letter: float(position.get(letter)) for letter in present if _is_number(position.get(letter))}
    return Header("".join(letter for letter in present if letter not in stated), stated, tuple(channels))


def _channel(item: Element, name: str) -> Channel:
    try:
        return Channel(int(item.get("A"), 16), item.get("C"))
    except ValueError:
        raise InputError("time-log-header.channel", name=name, item=item.get("A")) from None


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


def _offset(letters: str, letter: str) -> int:
    """Offset of an attribute of PTN in a record; −1 if it has none."""
    if letter not in letters:
        return -1
    return 6 + sum(POSITION[other] for other in letters[: letters.index(letter)])


def _assembled(
    name: str,
    header: Header,
    data: NDArray[np.uint8],
    starts: NDArray[np.int64],
    values: tuple[NDArray[np.int64], NDArray[np.uint8], NDArray[np.int32]],
    notices: tuple[Notice, ...],
) -> TimeLog:
    n = len(starts)

    def column(offset: int, kind: str) -> NDArray[Any]:
        """Numbers (n,) at an offset of each record."""
        size = np.dtype(kind).itemsize
        return np.ascontiguousarray(data[starts[:, None] + (offset + np.arange(size))]).view(kind)[:, 0]

    def attribute(letter: str, kind: str) -> FloatArray:
        """A PTN attribute (n,), raw; nan where it is not stated."""
        offset = _offset(header.open, letter)
        if offset < 0:
            return np.full(n, header.fixed.get(letter, np.nan))
        return column(offset, kind).astype(np.float64) if n else np.zeros(0)

    if not n:
        empty = np.zeros(0)
        return TimeLog(
            name, empty, empty, empty, empty, np.zeros(0, np.int8), empty, np.zeros(0, np.int16), empty, header,
            *values, notices,
        )  # fmt: skip
    clock_s = EPOCH_S + DAY_S * column(4, "<u2").astype(np.float64) + column(0, "<u4") / 1000.0
    lat, lon = 1e-7 * attribute("A", "<i4"), 1e-7 * attribute("B", "<i4")
    nowhere = ~((np.abs(lat) <= 90.0) & (np.abs(lon) <= 180.0)) | ((lat == 0.0) & (lon == 0.0))
    status = attribute("D", "<u1")
    stated = np.isfinite(status) & (status < 9)
    nowhere |= stated & (status == 0)
    up = attribute("C", "<i4")
    gps = EPOCH_S + DAY_S * attribute("I", "<u2") + attribute("H", "<u4") / 1000.0
    hdop, satellites = attribute("F", "<u2"), attribute("G", "<u1")
    return TimeLog(
        name=name,
        clock_s=clock_s,
        lat_deg=np.where(nowhere, np.nan, lat),
        lon_deg=np.where(nowhere, np.nan, lon),
        up_m=np.where(np.abs(up) < NOT_AVAILABLE, up / 1000.0, np.nan),
        status=np.where(stated, status, -1).astype(np.int8),
        hdop=np.where(hdop < 0xFFFE, hdop / 100.0, np.nan),
        satellites=np.where(satellites < 0xFE, satellites, -1).astype(np.int16),
        gps_s=np.where((attribute("I", "<u2") < 0xFFFE) & (attribute("I", "<u2") > 0), gps, np.nan),
        header=header,
        record=values[0],
        channel=values[1],
        value=values[2],
        notices=notices,
    )


def _damage(name: str, size: int, lost: int, breaks: int) -> tuple[Notice, ...]:
    if not lost:
        return ()
    return (Notice("time-log-damaged", name=name, lost=lost, size=size, breaks=breaks),)
