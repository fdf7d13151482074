"""The header of a LAS file and its variable-length records, before and after the points, checked."""

import datetime as dt
import struct
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO, Final

import numpy as np

from furrowmap.core.runtime.errors import InputError, Notice
from furrowmap.core.runtime.languages.texts import Text

SIGNATURE: Final = b"LASF"
LEAST_RECORD_BYTES: Final = (20, 28, 26, 34, 57, 63, 30, 36, 38, 59, 67)
"""Bytes of a point record without extra bytes, of point formats 0 to 10 (LAS 1.4 R15, tables 7 to 17)."""
HEADER_BYTES: Final = {0: 227, 1: 227, 2: 227, 3: 235, 4: 375}
"""By minor version."""
SCALES_AT: Final = 131
"""Byte of the first of three scales (float64); their offsets follow."""
MAX_COORDINATE: Final = 1e13
"""Largest plausible coordinate in any CRS and unit; a double resolves smaller ones to 2 mm or better."""
MIN_SCALE: Final = 1e-12
"""Smallest plausible scale: 32 bits of a smaller one span less than 0.01."""
COMPRESSED_BIT: Final = 0x80
FIRST_YEAR: Final = 1990

_LAS_HEADER: Final = struct.Struct("<4sHH16xBB32s32sHHHIIBHI5I12d")
_LAS14_COUNTS: Final = struct.Struct("<QIQ15Q")
"""From byte 235: start and number of extended records, points, points by return."""


@dataclass(frozen=True)
class LasHeader:
    """The fields of the header of a LAS file.

    Attributes:
        version: minor version of LAS 1.
        encoding: global encoding, bit 0: standard time instead of week time, bit 4: CRS as WKT.
        header_bytes: length of the header; the variable-length records begin behind it.
        point_format: 0 to 10.
        record_bytes: bytes of a point, extra bytes included.
        by_return: number of points by return number, 5 or (LAS 1.4) 15 of them.
        shift: offsets of x, y and z.
        low: minimum x, y and z.
        high: maximum x, y and z.
        extended_at: byte offset of the extended records, 0 for none.
        waveforms_at: byte offset of the waveforms, 0 for none.
    """

    version: int
    encoding: int
    system: str
    software: str
    created: dt.date | None
    header_bytes: int
    offset: int
    records: int
    point_format: int
    compressed: bool
    record_bytes: int
    points: int
    by_return: tuple[int, ...]
    scale: tuple[float, float, float]
    shift: tuple[float, float, float]
    low: tuple[float, float, float]
    high: tuple[float, float, float]
    extended_at: int
    extended: int
    waveforms_at: int
    size_bytes: int
    notices: tuple[Notice, ...]

    @property
    def has_time(self) -> bool:
        """Whether the points have a GPS time."""
        return self.point_format not in (0, 2)

    @property
    def is_standard_time(self) -> bool:
        """Whether times are declared as adjusted standard GPS time; else they are seconds of a week."""
        return bool(self.encoding & 1)

    @property
    def crs_is_wkt(self) -> bool:
        """Whether the CRS is declared as WKT; else as GeoTIFF keys."""
        return bool(self.encoding & 16)


def read_header(path: Path, data: bytes, size_bytes: int) -> LasHeader:
    """Read the header in the first bytes (375 or more, if the file has as many) of a LAS file.

    InputError if it is none.
    """
    head = _checked_head(path, data, size_bytes)
    encoding, _, version, system, software, day, year, header_bytes, offset, records = head[2:12]
    kind, record_bytes, points = head[12:15]
    by_return = head[15:20]
    doubles = head[20:32]
    notices = []
    waveforms_at = extended_at = extended = 0
    if version >= 3:
        (waveforms_at,) = struct.unpack_from("<Q", data, 227)
    if version >= 4:
        extended_at, extended, whole, *of_returns = _LAS14_COUNTS.unpack_from(data, 235)
        if points and points != whole:
            notices.append(Notice("legacy-count", path=path.name, whole=whole, points=points))
        points = whole or points
        by_return = tuple(of_returns) if whole else by_return
    least = HEADER_BYTES[version]
    if header_bytes < least:
        raise _invalid(
            path, 94, Text("a header size of {size} bytes; the minimum is {least}", size=header_bytes, least=least)
        )
    if not header_bytes <= offset <= size_bytes:
        fault = Text(
            "the points begin at byte {offset}, which is not after the header ({header_bytes}) and before the end "
            "({size_bytes})",
            offset=offset,
            header_bytes=header_bytes,
            size_bytes=size_bytes,
        )
        raise _invalid(path, 96, fault)
    if kind & 0x7F >= len(LEAST_RECORD_BYTES):
        raise _invalid(path, 104, Text("unknown point format {kind} (0 to 10 are defined)", kind=kind))
    shortest = LEAST_RECORD_BYTES[kind & 0x7F]
    if record_bytes < shortest:
        fault = Text(
            "{record_bytes} bytes for a point of format {kind}, which needs {shortest}",
            record_bytes=record_bytes,
            kind=kind & 0x7F,
            shortest=shortest,
        )
        raise _invalid(path, 105, fault)
    scale = doubles[:3]
    shift = doubles[3:6]
    box = doubles[6:]
    for k, (step, start) in enumerate(zip(scale, shift, strict=True)):
        if not (step >= MIN_SCALE and abs(start) + abs(step) * 2.0**31 <= MAX_COORDINATE):
            fault = Text("invalid scale {step:g} or offset {start:g} for {axis}", step=step, start=start, axis="xyz"[k])
            raise _invalid(path, SCALES_AT + 8 * k, fault)
    created = _date(year, day)
    if created is None and (year, day) != (0, 0):
        notices.append(Notice("creation-date", path=path.name, day=day, year=year))
    return LasHeader(
        version=version,
        encoding=encoding,
        system=text_of(system),
        software=text_of(software),
        created=created,
        header_bytes=header_bytes,
        offset=offset,
        records=records,
        point_format=kind & 0x3F,
        compressed=bool(kind & COMPRESSED_BIT),
        record_bytes=record_bytes,
        points=points,
        by_return=tuple(by_return),
        scale=scale,
        shift=shift,
        low=(box[1], box[3], box[5]),
        high=(box[0], box[2], box[4]),
        extended_at=extended_at,
        extended=extended,
        waveforms_at=waveforms_at,
        size_bytes=size_bytes,
        notices=tuple(notices),
    )


def _invalid(path: Path, byte: int, fault: Text) -> InputError:
    """The error of a header that is wrong at a byte."""
    return InputError("las-header", path=Text("{path}, byte {byte}", path=path, byte=byte), fault=fault)


def _checked_head(path: Path, data: bytes, size_bytes: int) -> tuple[Any, ...]:
    """The fields that all versions have, after checks of signature, length and version."""
    if data[:4] != SIGNATURE:
        raise InputError("not-las", path=path, data=data[:4])
    least = HEADER_BYTES.get(data[25], 375) if len(data) > 25 else 227
    if len(data) < least:
        fault = Text("the file ends inside its header of {least} bytes", least=least)
        raise _invalid(path, size_bytes, fault)
    head = _LAS_HEADER.unpack_from(data)
    major, version = head[3:5]
    if (major, version) not in {(1, minor) for minor in HEADER_BYTES}:
        raise InputError("las-version", path=path, major=major, version=version)
    return head


def _date(year: int, day: int) -> dt.date | None:
    if not (FIRST_YEAR <= year <= dt.datetime.now(dt.UTC).year + 1 and 1 <= day <= 366):
        return None
    date = dt.date(year, 1, 1) + dt.timedelta(days=day - 1)
    return date if date.year == year else None


def text_of(field: bytes) -> str:
    """The text in a field that is filled with zeros."""
    return field.split(b"\0")[0].decode("utf-8", "replace").strip()


MAX_EXTENDED_BYTES: Final = 1 << 20
"""Bytes that are read of an extended record, at most: a CRS, or the page of a small hierarchy, has less."""
MAX_EXTENDED_RECORDS: Final = 10_000
_RECORD_HEAD: Final = struct.Struct("<2x16sHH32x")
_EXTENDED_HEAD: Final = struct.Struct("<2x16sHQ32x")
_EXTRA_BYTES: Final = struct.Struct("<2xBB32s156x")
EXTRA_TYPES: Final = (
    *("undocumented", "uint8", "int8", "uint16", "int16", "uint32", "int32", "uint64", "int64", "float32", "float64"),
)
"""Data types of extra dimensions (LAS 1.4 R15, table 24)."""


@dataclass(frozen=True)
class LasRecord:
    """A variable-length record; the content of extended ones is read up to a megabyte."""

    user: str
    number: int
    data: bytes


@dataclass(frozen=True)
class ExtraDimension:
    """A dimension of the points that is not part of their format; `type` is the data type of its values."""

    name: str
    type: str


def read_records(path: Path, file: BinaryIO, header: LasHeader) -> tuple[tuple[LasRecord, ...], tuple[Notice, ...]]:
    """All valid records; a notice for each chain of records that breaks off."""
    before, broken = _before_points(path, file, header)
    after, broken_after = _after_points(path, file, header)
    return (*before, *after), (*broken, *broken_after)


def extra_dimensions(
    path: Path, records: tuple[LasRecord, ...], spare_bytes: int
) -> tuple[tuple[ExtraDimension, ...], tuple[Notice, ...]]:
    """The extra dimensions that a file describes, if they fit into the `spare_bytes` of a point."""
    found: list[ExtraDimension] = []
    taken = 0
    for record in records:
        if (record.user, record.number) == ("LASF_Spec", 4):
            for kind, options, name in _EXTRA_BYTES.iter_unpack(record.data[: len(record.data) // 192 * 192]):
                known = kind < len(EXTRA_TYPES)
                # Types 11 to 30 were vectors of two or three (LAS 1.4 R13).
                base, many = (kind, 1) if known else ((kind - 1) % 10 + 1, (kind - 1) // 10 + 1)
                taken += options if kind == 0 else many * np.dtype(EXTRA_TYPES[base]).itemsize
                label = EXTRA_TYPES[base] if many == 1 else f"{many} {EXTRA_TYPES[base]}"
                found.append(ExtraDimension(text_of(name), label))
    if taken > spare_bytes:
        return (), (Notice("extra-bytes", path=path.name, taken=taken, spare_bytes=spare_bytes),)
    return tuple(found), ()


def _before_points(path: Path, file: BinaryIO, header: LasHeader) -> tuple[list[LasRecord], list[Notice]]:
    records: list[LasRecord] = []
    file.seek(header.header_bytes)
    data = file.read(min(header.offset, header.size_bytes) - header.header_bytes)
    at = 0
    for number in range(header.records):
        end = at + _RECORD_HEAD.size
        length = _RECORD_HEAD.unpack_from(data, at)[2] if end <= len(data) else 0
        if end + length > len(data):
            broken = Notice(
                "records-broken",
                path=path.name,
                number=number + 1,
                records=header.records,
                header_bytes=header.header_bytes + at,
                offset=header.offset,
            )
            return records, [broken]
        user, number_of_kind, _ = _RECORD_HEAD.unpack_from(data, at)
        records.append(LasRecord(text_of(user), number_of_kind, data[end : end + length]))
        at = end + length
    # LAS 1.0 has two bytes between records and points, and there may be more; a name would be an uncounted record.
    rest = data[at:]
    if len(rest) >= _RECORD_HEAD.size and rest[2:].startswith((b"LASF_", b"copc\0", b"laszip")):
        end = header.header_bytes + at
        return records, [Notice("records-uncounted", path=path.name, records=header.records, header_bytes=end)]
    return records, []


def _after_points(path: Path, file: BinaryIO, header: LasHeader) -> tuple[list[LasRecord], list[Notice]]:
    records: list[LasRecord] = []
    at = header.extended_at
    for number in range(header.extended):
        file.seek(min(at, header.size_bytes))
        head = file.read(_EXTENDED_HEAD.size)
        length = _EXTENDED_HEAD.unpack(head)[2] if len(head) == _EXTENDED_HEAD.size else 0
        end = at + _EXTENDED_HEAD.size + length
        if at < header.offset or end > header.size_bytes or number == MAX_EXTENDED_RECORDS:
            broken = Notice(
                "extended-records-broken",
                path=path.name,
                number=number + 1,
                extended=header.extended,
                at=at,
                size_bytes=header.size_bytes,
            )
            return records, [broken]
        user, number_of_kind, _ = _EXTENDED_HEAD.unpack(head)
        records.append(LasRecord(text_of(user), number_of_kind, file.read(min(length, MAX_EXTENDED_BYTES))))
        at = end
    return records, []
