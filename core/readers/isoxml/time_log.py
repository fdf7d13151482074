"""Time logs, `TLG`: an XML header that describes the records, and binary records.

ISO 11783-10:2015, annex D.8 and clause 8.8.2.2. A record, little-endian: milliseconds of the day (u32), days since
1980-01-01 (u16), the attributes of PTN that the header leaves open in their order, the number of values (u8), and for
each value its index among the header's DLV (u8) and an i32. A record has only the values that changed, so each is found
from the one before.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from furrowmap.core.readers.isoxml.devices import INT32
from furrowmap.core.readers.isoxml.xml import parse_xml
from furrowmap.core.runtime.arrays import FloatArray
from furrowmap.core.runtime.errors import InputError, Notice
from furrowmap.core.runtime.kernels import kernel
from furrowmap.core.runtime.languages.texts import Text
from furrowmap.core.values.clock import DAY_S

EPOCH_S: Final = 315_532_800
"""1980-01-01, day 0, in POSIX seconds."""
_ATTRIBUTE_BYTES: Final = {"A": 4, "B": 4, "C": 4, "D": 1, "E": 2, "F": 2, "G": 1, "H": 4, "I": 2}
"""Bytes of each attribute of PTN: latitude, longitude, up, status, PDOP, HDOP, satellites, GPS time and day."""
MAX_CHANNELS: Final = 256
NOT_AVAILABLE: Final = 0x7FFFFFFF
DAY_NOT_AVAILABLE: Final = 0xFFFE
"""From this on a day is an error or not available."""
ANY_DAY: Final = -1
LONGEST_LOG_DAYS: Final = 366


@dataclass(frozen=True)
class RecordLayout:
    """The layout of records.

    Attributes:
        open: letters of the PTN attributes in each record.
        fixed: raw value of the PTN attributes that the header states for all records.
        channels: data dictionary identifier (ISO 11783-11) and id of the device element of each value, a `DLV`.
        constants: raw value of the channels that the header states for all records, by their index.
    """

    open: str
    fixed: dict[str, float]
    channels: tuple[tuple[int, str], ...]
    constants: dict[int, int]


@dataclass(frozen=True)
class TimeLog:
    """A time log's records in the order of the file.

    Attributes:
        clock_s: (n,) time of the terminal's clock, POSIX seconds as if it were UTC.
        lat_deg: (n,) nan without a position.
        up_m: (n,) height above the ellipsoid; nan where not stated.
        status: (n,) int8: the codes of NMEA 2000 (0 none, 1 single, 2 DGNSS, 3 precise, 4 RTK fixed, 5 float, ...), −1
            where not stated.
        hdop: (n,) nan where not stated.
        satellites: (n,) int16, −1 where not stated.
        gps_s: (n,) UTC by GPS, POSIX seconds; nan where not stated.
        record: (m,) int64 index of the record of each value.
        channel: (m,) uint8 index among the channels of each value.
        value: (m,) int32 raw.
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
    header: RecordLayout
    record: NDArray[np.int64]
    channel: NDArray[np.uint8]
    value: NDArray[np.int32]
    notices: tuple[Notice, ...]

    def __len__(self) -> int:
        return len(self.clock_s)

    def values_of(self, ddi: int) -> Iterator[tuple[str, FloatArray]]:
        """Device element and raw values (n,) of each channel of a data dictionary identifier that has any value."""
        seen = np.zeros(MAX_CHANNELS, bool)
        seen[self.channel] = True
        seen[list(self.header.constants)] = True
        for k, (stated_ddi, element) in enumerate(self.header.channels):
            if stated_ddi == ddi and seen[k]:
                yield element, self.latest(k)

    def latest(self, channel: int) -> FloatArray:
        """(n,) the raw value at each record, the last one logged; before the first that of the header, else nan."""
        mine = self.channel == channel
        at = self.record[mine]
        value = self.value[mine].astype(np.float64)
        row = np.searchsorted(at, np.arange(len(self)), side="right") - 1
        before = float(self.header.constants.get(channel, np.nan))
        return np.where(row >= 0, value[np.maximum(row, 0)] if len(value) else np.nan, before)


def read_time_log(header: bytes, records: bytes, name: str) -> TimeLog:
    """A time log from the content of its two files.

    After damage (a byte was lost or added), reading resumes at the next two plausible records in a row; a notice counts
    the bytes between. Records of before a terminal knows its date carry another day than the others, often 1980-01-01:
    they are left out, and counted in a notice. InputError if the header is invalid.
    """
    layout = read_header(header, name)
    data = np.frombuffer(records, np.uint8)

    def offset(letter: str) -> int:
        """Offset of an attribute of PTN in a record; −1 if it has none."""
        before, found, _ = layout.open.partition(letter)
        return 6 + sum(_ATTRIBUTE_BYTES[other] for other in before) if found else -1

    width = 6 + sum(_ATTRIBUTE_BYTES[letter] for letter in layout.open)
    places = np.array([offset("A"), offset("B")], np.int64)
    day = _usual_day(data, _find_records(data, width, places, len(layout.channels), ANY_DAY)[0])
    found, dated, lost, breaks = _find_records(data, width, places, len(layout.channels), day)
    starts = found[dated]
    n = len(starts)
    undated = len(found) - n
    count = int(data[found + width].astype(np.int64).sum()) if len(found) else 0
    record, channel, value = _read_values(data, found, width, count)
    # Values hold until they change, so those of an undated record count from the next dated one on.
    record = (np.cumsum(dated) - dated)[record]
    held = record < n
    record = record[held]
    channel = channel[held]
    value = value[held]

    def column(at: int, kind: str) -> NDArray[Any]:
        """Numbers (n,) at an offset of each record."""
        size = np.dtype(kind).itemsize
        return np.ascontiguousarray(data[starts[:, None] + (at + np.arange(size))]).view(kind)[:, 0]

    def attribute(letter: str, kind: str) -> FloatArray:
        """A PTN attribute (n,), raw; nan where it is not stated."""
        at = offset(letter)
        return np.full(n, layout.fixed.get(letter, np.nan)) if at < 0 else column(at, kind).astype(np.float64)

    lat = 1e-7 * attribute("A", "<i4")
    lon = 1e-7 * attribute("B", "<i4")
    nowhere = ~((np.abs(lat) <= 90.0) & (np.abs(lon) <= 180.0)) | ((lat == 0.0) & (lon == 0.0))
    status = attribute("D", "<u1")
    stated = np.isfinite(status) & (status < 9)
    nowhere |= stated & (status == 0)
    up = attribute("C", "<i4")
    hdop = attribute("F", "<u2")
    satellites = attribute("G", "<u1")
    gps_day = attribute("I", "<u2")
    gps_s = EPOCH_S + DAY_S * gps_day + attribute("H", "<u4") / 1000.0
    return TimeLog(
        name=name,
        clock_s=EPOCH_S + DAY_S * column(4, "<u2").astype(np.float64) + column(0, "<u4") / 1000.0,
        lat_deg=np.where(nowhere, np.nan, lat),
        lon_deg=np.where(nowhere, np.nan, lon),
        up_m=np.where(np.abs(up) < NOT_AVAILABLE, up / 1000.0, np.nan),
        status=np.where(stated, status, -1).astype(np.int8),
        hdop=np.where(hdop < 0xFFFE, hdop / 100.0, np.nan),
        satellites=np.where(satellites < 0xFE, satellites, -1).astype(np.int16),
        gps_s=np.where((gps_day < 0xFFFE) & (gps_day > 0), gps_s, np.nan),
        header=layout,
        record=record,
        channel=channel,
        value=value,
        notices=(
            *(Notice("time-log-damaged", name=name, lost=lost, size=len(data), breaks=breaks),) * (lost > 0),
            *(Notice("time-log-undated", name=name, undated=undated, records=n + undated),) * (undated > 0),
        ),
    )


def _usual_day(data: NDArray[np.uint8], starts: NDArray[np.int64]) -> int:
    """The median of the days of records at the offsets `starts` (n,), without unset ones where others are set."""
    days = data[starts + 4].astype(np.int64) + (data[starts + 5].astype(np.int64) << 8)
    stated = days[(days > 0) & (days < DAY_NOT_AVAILABLE)]
    if not len(days):
        return ANY_DAY
    ordered = np.sort(stated if len(stated) else days)
    return int(ordered[(len(ordered) - 1) // 2])  # one that occurs, where a mean of two would lie between them


def read_header(data: bytes, name: str) -> RecordLayout:
    """The header of a time log; InputError if it is invalid."""
    root = parse_xml(data, f"{name}.xml")
    position = next(root.all("PTN"), None)
    if root.tag != "TIM" or position is None:
        fault = Text(
            "not the header of a time log (root <{tag}>{has_no_position:, without PTN|})",
            tag=root.tag[:40],
            has_no_position=position is None,
        )
        raise InputError("time-log-header", name=name, fault=fault)
    channels: list[tuple[int, str]] = []
    constants: dict[int, int] = {}
    for item in root.all("DLV"):
        stated_value = item.get("B").strip()
        if stated_value:
            constants[len(channels)] = _constant(stated_value, name)
        try:
            channels.append((int(item.get("A"), 16), item.get("C")))
        except ValueError:
            fault = Text("{item!r} is not a hexadecimal number of the data dictionary", item=item.get("A"))
            raise InputError("time-log-header", name=name, fault=fault) from None
    if len(channels) > MAX_CHANNELS:
        fault = Text("{values} values; at most {most} can be numbered", values=len(channels), most=MAX_CHANNELS)
        raise InputError("time-log-header", name=name, fault=fault)
    open_letters = ""
    stated = {}
    for letter in _ATTRIBUTE_BYTES:
        if letter in position.attributes:
            try:
                stated[letter] = float(position.get(letter))
            except ValueError:
                open_letters += letter
    return RecordLayout(open_letters, stated, tuple(channels), constants)


def _constant(text: str, name: str) -> int:
    """A value that the header states for all records."""
    try:
        value = int(text)
    except ValueError:
        value = INT32.max + 1
    if not INT32.min <= value <= INT32.max:
        fault = Text("{item!r} as the value of all records is not a whole number of 32 bits", item=text[:40])
        raise InputError("time-log-header", name=name, fault=fault)
    return value


@kernel()
def _record_end(data: Any, at: int, width: int, offsets: Any, channels: int) -> Any:
    """End of the record at an offset; −1 if it is not plausible, −2 if the file ends within it."""
    size = len(data)
    if at + width + 1 > size:
        return -2
    millis = data[at] + (data[at + 1] << 8) + (data[at + 2] << 16) + (np.int64(data[at + 3]) << 24)
    if millis > 86_400_999:
        return -1
    end = at + width + 1 + 5 * np.int64(data[at + width])
    if end > size:
        return -2
    for k in range(at + width + 1, end, 5):
        if data[k] >= channels:
            return -1
    for k in range(2):
        if offsets[k] >= 0:
            place = at + offsets[k]
            raw = np.int32(
                np.uint32(data[place])
                | (np.uint32(data[place + 1]) << np.uint32(8))
                | (np.uint32(data[place + 2]) << np.uint32(16))
                | (np.uint32(data[place + 3]) << np.uint32(24))
            )
            limit = 900_000_000 if k == 0 else 1_800_000_000
            # values around 0x7FFFFFFF stand for no position
            if (raw > limit or raw < -limit) and raw < 0x7FFFFFF0 and raw > -0x7FFFFFF0:
                return -1
    return end


@kernel()
def _day(data: Any, at: int) -> Any:
    return np.int64(data[at + 4]) + (np.int64(data[at + 5]) << 8)


@kernel()
def _find_records(data: Any, width: int, offsets: Any, channels: int, day: int) -> Any:
    """Offset of each record (n,), whether it is dated (n,), number of bytes that are not records, in how many places.

    A record is plausible if its time is within a day, its position is on the Earth or missing, and its values are among
    the header's. Of another year than `day` (:data:`ANY_DAY` for none) it is undated if a plausible record or the end
    of the file follows, else damage. After damage, reading resumes at the next two plausible records in a row.
    `offsets` of latitude and longitude in a record are −1 if it has none.
    """
    size = len(data)
    starts = np.empty(size // (width + 1) + 1, np.int64)
    dated = np.empty(len(starts), np.bool_)
    n = 0
    at = np.int64(0)
    lost = 0
    breaks = 0
    broken = False
    while at < size:
        end = _record_end(data, at, width, offsets, channels)
        good = end > 0
        if good and broken:
            # after damage, resume at two records in a row on neighbouring days
            follower = _record_end(data, end, width, offsets, channels) if end < size else -1
            good = follower > 0 and abs(_day(data, end) - _day(data, at)) <= 1
        is_dated = day == ANY_DAY or abs(_day(data, at) - day) <= LONGEST_LOG_DAYS
        if good and not is_dated:
            good = not broken and (end == size or _record_end(data, end, width, offsets, channels) > 0)
        if good:
            starts[n] = at
            dated[n] = is_dated
            n += 1
            at = end
            broken = False
        else:
            if not broken:
                breaks += 1
            broken = True
            lost += 1
            at += 1
    return starts[:n].copy(), dated[:n].copy(), lost, breaks


@kernel()
def _read_values(data: Any, starts: Any, width: int, count: int) -> Any:
    """(record, channel, value), each (count,), of all values in the records at the offsets `starts` (n,)."""
    record = np.empty(count, np.int64)
    channel = np.empty(count, np.uint8)
    value = np.empty(count, np.int32)
    k = 0
    for n in range(len(starts)):
        at = starts[n] + width
        for _ in range(np.int64(data[at])):
            place = at + 1
            record[k] = n
            channel[k] = data[place]
            value[k] = np.int32(
                np.uint32(data[place + 1])
                | (np.uint32(data[place + 2]) << np.uint32(8))
                | (np.uint32(data[place + 3]) << np.uint32(16))
                | (np.uint32(data[place + 4]) << np.uint32(24))
            )
            at += 5
            k += 1
    return record, channel, value
