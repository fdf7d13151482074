"""Variable-length records before the points, and extended ones after the points."""

from __future__ import annotations

import struct
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO, Final

import numpy as np

from furrowmap.core.readers.las.header import LasHeader, text_of
from furrowmap.core.runtime.errors import Notice

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
    """A variable-length record.

    Attributes:
        user: user id.
        number: record id.
        data: its content, up to a megabyte of extended ones.
    """

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
    notices: list[Notice] = []
    records = [*_before_points(path, file, header, notices), *_after_points(path, file, header, notices)]
    return tuple(records), tuple(notices)


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


def _before_points(path: Path, file: BinaryIO, header: LasHeader, notices: list[Notice]) -> Iterator[LasRecord]:
    file.seek(header.header_bytes)
    data = file.read(min(header.offset, header.size_bytes) - header.header_bytes)
    at = 0
    for number in range(header.records):
        end = at + _RECORD_HEAD.size
        length = _RECORD_HEAD.unpack_from(data, at)[2] if end <= len(data) else 0
        if end + length > len(data):
            notices.append(
                Notice(
                    "records-broken",
                    path=path.name,
                    number=number + 1,
                    records=header.records,
                    header_bytes=header.header_bytes + at,
                    offset=header.offset,
                )
            )
            return
        user, number_of_kind, _ = _RECORD_HEAD.unpack_from(data, at)
        yield LasRecord(text_of(user), number_of_kind, data[end : end + length])
        at = end + length
    # LAS 1.0 has two bytes between records and points, and there may be more; a name would be an uncounted record.
    rest = data[at:]
    if len(rest) >= _RECORD_HEAD.size and rest[2:].startswith((b"LASF_", b"copc\0", b"laszip")):
        notices.append(
            Notice("records-uncounted", path=path.name, records=header.records, header_bytes=header.header_bytes + at)
        )


def _after_points(path: Path, file: BinaryIO, header: LasHeader, notices: list[Notice]) -> Iterator[LasRecord]:
    at = header.extended_at
    for number in range(header.extended):
        file.seek(min(at, header.size_bytes))
        head = file.read(_EXTENDED_HEAD.size)
        length = _EXTENDED_HEAD.unpack(head)[2] if len(head) == _EXTENDED_HEAD.size else 0
        end = at + _EXTENDED_HEAD.size + length
        if at < header.offset or end > header.size_bytes or number == MAX_EXTENDED_RECORDS:
            notices.append(
                Notice(
                    "extended-records-broken",
                    path=path.name,
                    number=number + 1,
                    extended=header.extended,
                    at=at,
                    size_bytes=header.size_bytes,
                )
            )
            return
        user, number_of_kind, _ = _EXTENDED_HEAD.unpack(head)
        yield LasRecord(text_of(user), number_of_kind, file.read(min(length, MAX_EXTENDED_BYTES)))
        at = end
