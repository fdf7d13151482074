"""Points in PCD and PLY files: a header with the fields of a point, and rows in binary or text.

PCD is the Point Cloud Library's format, version 0.7; PLY is Stanford's polygon format, of which the vertices are read.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import Any, BinaryIO, Final

import numpy as np
from numpy.typing import NDArray

from furrowmap.core.readers.las.header import MAX_COORDINATE
from furrowmap.core.readers.las.point_records import CloudBatch
from furrowmap.core.runtime.errors import InputError
from furrowmap.core.runtime.kernels import kernel
from furrowmap.core.runtime.languages.texts import Text, reason
from furrowmap.core.runtime.memory import expect_memory

TABLE_SIGNATURES: Final = {
    b"# .PCD": "pcd",
    b"VERSION .7": "pcd",
    b"VERSION 0.7": "pcd",
    b"ply\n": "ply",
    b"ply\r\n": "ply",
}
E57_SIGNATURE: Final = b"ASTM-E57"
POINT_SIGNATURES: Final = (E57_SIGNATURE, *TABLE_SIGNATURES)
"""First bytes of files of points besides LAS."""
TABLE_HEADER_BYTES: Final = 1 << 16
MAX_TEXT_ROW_BYTES: Final = 4096
_PLY_TYPES: Final = {
    "char": "i1", "uchar": "u1", "short": "i2", "ushort": "u2", "int": "i4", "uint": "u4", "float": "f4",
    "double": "f8", "int8": "i1", "uint8": "u1", "int16": "i2", "uint16": "u2", "int32": "i4", "uint32": "u4",
    "float32": "f4", "float64": "f8",
}  # fmt: skip
_PCD_TYPES: Final = {*("F4", "F8", "I1", "I2", "I4", "I8", "U1", "U2", "U4", "U8")}
_CLASSES: Final = ("classification", "class", "label")


@dataclass(frozen=True)
class PointTable:
    """Where the points of a PCD or PLY file are.

    Attributes:
        row: fields of a point; their names are in lower case, without CloudCompare's prefix ``scalar_``.
        offset: byte offset of the first of them.
        coding: "ascii" (lines of numbers), "binary", or "binary_compressed" (PCD: all values of a field together).
    """

    format: str
    row: np.dtype[np.void]
    points: int
    offset: int
    coding: str

    def batches(self, path: Path, points: int, batch_points: int) -> Iterator[CloudBatch]:
        """The first points in the order of the file, without those that are nan; InputError at damaged points."""
        with path.open("rb") as file:
            file.seek(self.offset)
            done = 0
            whole = self._unpacked(path, file) if self.coding == "binary_compressed" else None
            while done < points:
                count = min(batch_points, points - done)
                if whole is not None:
                    rows = whole[done : done + count]
                elif self.coding == "ascii":
                    rows = self._text_rows(path, file, count, done)
                else:
                    data = file.read(count * self.row.itemsize)
                    rows = np.frombuffer(data, self.row, len(data) // self.row.itemsize)
                if not len(rows):
                    return
                done += len(rows)
                yield batch_of_rows(rows)

    def _unpacked(self, path: Path, file: BinaryIO) -> NDArray[np.void]:
        """All points of a compressed file."""
        size = self.points * self.row.itemsize
        packed, unpacked = np.frombuffer(file.read(8).ljust(8, b"\0"), "<u4").tolist()
        data = np.frombuffer(file.read(min(packed, path.stat().st_size)), np.uint8)
        # Of three bytes become at most 264.
        if unpacked == size <= 88 * len(data):
            expect_memory(path, 3 * size)
            columns = np.zeros(size, np.uint8)
            if _unpack(data, columns) == size:
                rows = np.zeros(self.points, self.row)
                at = 0
                for name in self.row.names or ():
                    end = at + self.points * self.row[name].itemsize
                    rows[name] = columns[at:end].view(self.row[name].base).reshape(self.points, *self.row[name].shape)
                    at = end
                return rows
        fault = Text("its {points:,} compressed points cannot be decompressed", points=self.points)
        raise InputError("points-damaged", path=path, fault=fault)

    def _text_rows(self, path: Path, file: BinaryIO, count: int, done: int) -> NDArray[np.void]:
        width = sum(int(np.prod(self.row[name].shape, dtype=int)) for name in self.row.names or ())
        lines = list(islice(iter(lambda: file.readline(MAX_TEXT_ROW_BYTES), b""), count))
        try:
            values = np.array([line.split() for line in lines], np.float64).reshape(-1, width)
        except ValueError:
            fault = Text(
                "one of the points {first:,} to {last:,} is not a line of as many numbers as the header states",
                first=done + 1,
                last=done + len(lines),
            )
            raise InputError("points-damaged", path=path, fault=fault) from None
        rows = np.zeros(len(values), self.row)
        at = 0
        for name in self.row.names or ():
            field = self.row[name]
            many = int(np.prod(field.shape, dtype=int))
            column = values[:, at : at + many].reshape(-1, *field.shape)
            if field.base.kind in "iu":
                limits = np.iinfo(field.base)
                high = float(limits.max) if field.base.itemsize < 8 else np.nextafter(float(limits.max), 0.0)
                column = np.clip(np.nan_to_num(column), float(limits.min), high)
            rows[name] = column
            at += many
        return rows


@kernel()
def _unpack(data: Any, out: Any) -> Any:
    """Decompress LZF (liblzf); number of bytes written, −1 if the data are damaged."""
    i: Any = 0
    n: Any = 0
    while i < len(data):
        control = np.int64(data[i])
        i += 1
        if control < 32:
            length = control + 1
            if i + length > len(data) or n + length > len(out):
                return -1
            out[n : n + length] = data[i : i + length]
            i += length
            n += length
            continue
        length = (control >> 5) + 2
        if length == 9 and i < len(data):
            length += np.int64(data[i])
            i += 1
        if i >= len(data):
            return -1
        begin = n - ((control & 31) << 8 | np.int64(data[i])) - 1
        i += 1
        if begin < 0 or n + length > len(out):
            return -1
        for k in range(length):  # may overlap
            out[n + k] = out[begin + k]
        n += length
    return n


def batch_of_rows(rows: NDArray[np.void]) -> CloudBatch:
    """The points of rows (n,) with the usual names of fields, without those without coordinates."""
    names = rows.dtype.names or ()
    xyz = np.column_stack([rows[axis].astype(np.float64) for axis in "xyz"])
    known = (np.abs(xyz) <= MAX_COORDINATE).all(axis=1)  # False for nan
    rows = rows[known]
    xyz = xyz[known]
    nothing = np.zeros(len(rows), np.uint8)
    classes = next((name for name in _CLASSES if name in names), None)
    return CloudBatch(
        xyz_m=xyz,
        classification=nothing if classes is None else _whole(rows[classes], np.uint8),
        intensity=_whole(rows["intensity"], np.uint16) if "intensity" in names else nothing.astype(np.uint16),
        return_number=nothing + np.uint8(1),
        returns=nothing + np.uint8(1),
        point_source_id=nothing.astype(np.uint16),
        withheld=np.zeros(len(rows), bool),
        gps_time=None,
        t_s=None,
        rgb=_colours(rows),
    )


def _whole(values: NDArray[Any], kind: type[np.unsignedinteger[Any]]) -> NDArray[Any]:
    """Values (n,) rounded, within the limits of a type."""
    limits = np.iinfo(kind)
    return np.clip(np.rint(np.nan_to_num(values.astype(np.float64))), limits.min, limits.max).astype(kind)


def _colours(rows: NDArray[np.void]) -> NDArray[np.uint16] | None:
    """Red, green and blue (n, 3), from fields of their own or packed in one (PCD)."""
    names = rows.dtype.names or ()
    if {"red", "green", "blue"} <= set(names):
        colours = np.stack([rows[name] for name in ("red", "green", "blue")], axis=1)
        if colours.dtype == np.uint8:
            return colours.astype(np.uint16) * np.uint16(257)
        return np.asarray(_whole(colours, np.uint16))
    packed = next((name for name in ("rgb", "rgba") if name in names and rows[name].dtype.itemsize == 4), None)
    if packed is None or rows[packed].ndim > 1:
        return None
    bits = np.ascontiguousarray(rows[packed]).view("<u4")
    return np.stack([(bits >> shift & 255).astype(np.uint16) * np.uint16(257) for shift in (16, 8, 0)], axis=1)


def read_table(path: Path, data: bytes) -> PointTable | None:
    """The header in the first bytes (64 KiB) of a PCD or PLY file; None if it is of another format.

    InputError if the header is damaged, or the points are not in rows.
    """
    form = next((form for start, form in TABLE_SIGNATURES.items() if data.startswith(start)), None)
    if form is None:
        return None
    try:
        return _pcd(data) if form == "pcd" else _ply(data)
    except (ValueError, KeyError, IndexError, TypeError, OverflowError) as error:
        raise InputError("bad-table-header", path=path, title=form.upper(), reason=reason(error)) from None


def _lines(data: bytes, last: str) -> tuple[list[list[str]], int]:
    """Words of the lines of a header up to the one that begins with `last`, and the offset behind that."""
    lines = []
    at = 0
    while True:
        end = data.find(b"\n", at, TABLE_HEADER_BYTES)
        if end < 0:
            raise ValueError(f"it has no line {last}")
        words = data[at:end].decode("latin-1").split()
        at = end + 1
        lines.append(words)
        if words[:1] == [last]:
            return lines, at


def _pcd(data: bytes) -> PointTable:
    lines, offset = _lines(data, "DATA")
    stated = {words[0]: words[1:] for words in lines if words and not words[0].startswith("#")}
    coding = stated["DATA"][0].lower()
    if coding not in ("ascii", "binary", "binary_compressed"):
        raise ValueError(f"DATA {coding} is unknown")
    for line in ("FIELDS", "SIZE", "TYPE", "POINTS"):
        if not stated.get(line):
            raise ValueError(f"it has no line {line}")
    names = stated["FIELDS"]
    for line in ("SIZE", "TYPE", "COUNT"):
        if line in stated and len(stated[line]) != len(names):
            raise ValueError(f"{line} has {len(stated[line])} entries for {len(names)} FIELDS")
    counts = [int(count) for count in stated.get("COUNT", ["1"] * len(names))]
    kinds = [kind.upper() + size for kind, size in zip(stated["TYPE"], stated["SIZE"], strict=True)]
    if not set(kinds) <= _PCD_TYPES:
        raise ValueError(f"its types are {' '.join(kinds)}")
    fields = [(n, f"<{k.lower()}", c) for n, k, c in zip(names, kinds, counts, strict=True)]
    return PointTable("pcd", _row(fields), int(stated["POINTS"][0]), offset, coding)


def _ply(data: bytes) -> PointTable:
    lines, offset = _lines(data, "end_header")
    form = next((words[1] for words in lines if words[:1] == ["format"]), "")
    order = {"ascii": "<", "binary_little_endian": "<", "binary_big_endian": ">"}[form]
    elements = [(k, words) for k, words in enumerate(lines) if words[:1] == ["element"]]
    if not elements or elements[0][1][1] != "vertex":
        raise ValueError("its first element is not vertex")
    end = elements[1][0] if len(elements) > 1 else len(lines)
    properties = [words for words in lines[elements[0][0] : end] if words[:1] == ["property"]]
    lists = [words[-1] for words in properties if words[1:2] == ["list"]]
    if lists:
        raise ValueError(f"its vertices have lists ({', '.join(lists)}), whose rows have no fixed length")
    fields = [(words[2], order + _PLY_TYPES[words[1]], 1) for words in properties]
    return PointTable("ply", _row(fields), int(elements[0][1][2]), offset, "ascii" if form == "ascii" else "binary")


def _row(fields: list[tuple[str, str, int]]) -> np.dtype[np.void]:
    """The fields of a point; padding (`_`) and fields with the name of another keep their place under a number."""
    row: list[tuple[str, str] | tuple[str, str, tuple[int]]] = []
    for k, (name, kind, count) in enumerate(fields):
        name = name.lower().removeprefix("scalar_")
        name = str(k) if name == "_" or name in [each[0] for each in row] else name
        if not 1 <= count <= TABLE_HEADER_BYTES:
            raise ValueError(f"a field has {count} values")
        row.append((name, kind) if count == 1 else (name, kind, (count,)))
    found: np.dtype[np.void] = np.dtype(row)
    for axis in "xyz":
        if axis not in (found.names or ()) or found[axis].shape:
            raise ValueError(f"it has no field {axis}")
    if found.itemsize > TABLE_HEADER_BYTES:
        raise ValueError(f"a point has {found.itemsize} bytes")
    return found
