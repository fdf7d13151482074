"""Points in E57 files (ASTM E2807): scans as packed binary fields, described by XML, in pages with checksums."""

import struct
from collections.abc import Iterator
from dataclasses import dataclass
from functools import reduce
from pathlib import Path
from typing import Any, BinaryIO, Final

import numpy as np
from numpy.typing import NDArray

from furrowmap.core.readers.isoxml.xml import Element, parse_xml
from furrowmap.core.readers.las.pcd_ply import E57_SIGNATURE, PointTable, batch_of_rows
from furrowmap.core.readers.las.point_records import CloudBatch
from furrowmap.core.runtime.arrays import FloatArray
from furrowmap.core.runtime.errors import InputError
from furrowmap.core.runtime.kernels import kernel
from furrowmap.core.runtime.languages.texts import reason

_HEADER: Final = struct.Struct("<8sIIQQQQ")
_CHECKSUM_BYTES: Final = 4
_MAX_XML_BYTES: Final = 1 << 27
_BLOCK_BYTES: Final = 1 << 22
"""Of packets that are decoded together."""
_WORD_BITS: Final = 56
"""Widest packed integer that is read, besides those of 64 bits, which begin at bytes."""
_BLOCK_POINTS: Final = 1 << 19
"""Points of a block at most: of a packed field a block of bytes may hold eight times as many."""
_MAX_FIELDS: Final = 1000
_PLACE: Final = [*((axis, "f8") for axis in "xyz"), ("intensity", "u2")]
_COLOURS: Final = [(colour, "u2") for colour in ("red", "green", "blue")]
_SCALED: Final = {"intensity": "intensity", "colorRed": "red", "colorGreen": "green", "colorBlue": "blue"}
"""Fields whose limits become those of 16 bits."""
_USED: Final = {
    *(f"cartesian{name}" for name in ("X", "Y", "Z", "InvalidState")),
    *(f"spherical{name}" for name in ("Range", "Azimuth", "Elevation", "InvalidState")),
    *_SCALED,
}
"""Fields that are read."""
_E57_FAULTS: Final = (struct.error, ValueError, KeyError, IndexError, OverflowError)


@dataclass(frozen=True)
class _PackedField:
    """A field of a point: bits in its stream, and value = scale × (lowest + bits) + offset; floats have no scale."""

    name: str
    bits: int
    is_float: bool
    lowest: int
    scale: float
    offset: float

    @classmethod
    def of(cls, said: Element) -> "_PackedField":
        kind = said.get("type")
        if kind == "Float":
            return cls(said.tag, 32 if said.get("precision") == "single" else 64, True, 0, 1.0, 0.0)  # noqa: FBT003
        if kind not in ("Integer", "ScaledInteger"):
            raise ValueError(f"a field of points is of the type {kind[:20]!r}")
        low = int(said.get("minimum") or -(2**63))
        high = int(said.get("maximum") or 2**63 - 1)
        bits = (high - low).bit_length()
        if high < low or _WORD_BITS < bits < 64 or bits > 64:
            raise ValueError(f"a field of points is from {low} to {high}")
        scale = float(said.get("scale") or 1.0)
        offset = float(said.get("offset") or 0.0)
        return cls(said.tag, bits, False, low, scale, offset)  # noqa: FBT003

    def values(self, data: NDArray[np.uint8], first_bit: int, count: int) -> FloatArray:
        """Values (count,) from a bit on; eight bytes follow behind the last one."""
        if self.is_float:
            return np.frombuffer(data, f"<f{self.bits // 8}", count, first_bit // 8).astype(np.float64)
        if not self.bits:
            return np.full(count, self.scale * self.lowest + self.offset)
        at = first_bit + np.arange(count, dtype=np.int64) * self.bits
        words = np.lib.stride_tricks.sliding_window_view(data, 8)[at >> 3].copy().view("<u8")[:, 0]
        raw = (words >> (at & 7).astype(np.uint64)) & np.uint64((1 << self.bits) - 1)
        return np.asarray(self.scale * (self.lowest + raw.astype(np.float64)) + self.offset)


@dataclass(frozen=True)
class _Scan:
    """A scan: where its points are, its fields, limits of some of them, and its pose (3, 4)."""

    at: int
    points: int
    fields: tuple[_PackedField, ...]
    limits: dict[str, tuple[float, float]]
    pose: FloatArray

    @classmethod
    def of(cls, said: Element, page_bytes: int) -> "_Scan":
        points = _child(said, "points")
        place = int(points.get("fileOffset"))
        limits = {}
        for group, name in (("intensityLimits", "intensity"), *(("colorLimits", name) for name in _SCALED)):
            ends = [_child(said, group, f"{name}{end}") for end in ("Minimum", "Maximum")]
            if all(end.tag for end in ends):
                limits[name] = (_number(ends[0]), _number(ends[1]))
        pose = np.eye(3, 4)
        turn = _child(said, "pose", "rotation")
        shift = _child(said, "pose", "translation")
        if turn.tag:
            w, x, y, z = (_number(_child(turn, axis)) for axis in "wxyz")
            a = np.array([x, y, z])
            b = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
            pose[:, :3] = (w * w - a @ a) * np.eye(3) + 2.0 * np.outer(a, a) + 2.0 * w * b
        if shift.tag:
            pose[:, 3] = [_number(_child(shift, axis)) for axis in "xyz"]
        count = int(points.get("recordCount"))
        if count < 0 or not np.isfinite(pose).all():
            raise ValueError(f"a scan has {count} points, or an invalid pose")
        fields = tuple(_PackedField.of(each) for each in _child(points, "prototype").children)
        if len({field.name for field in fields}) < len(fields) or len(fields) > _MAX_FIELDS:
            raise ValueError(f"a point has {len(fields)} fields, or two of the same name")
        return cls(_logical(place, page_bytes), count, fields, limits, pose)

    @property
    def point_bits(self) -> int:
        """Bits of a point."""
        return sum(field.bits for field in self.fields)

    def rows(self, column: dict[str, FloatArray], row: np.dtype[np.void]) -> NDArray[np.void]:
        """Points (n,) of values by the names of their fields; nan without coordinates."""
        n = len(next(iter(column.values())))
        rows = np.zeros(n, row)
        if "cartesianX" in column:
            xyz = np.column_stack([column[f"cartesian{axis}"] for axis in "XYZ"])
        else:
            length, azimuth, elevation = (column[f"spherical{name}"] for name in ("Range", "Azimuth", "Elevation"))
            level = length * np.cos(elevation)
            xyz = np.column_stack([level * np.cos(azimuth), level * np.sin(azimuth), length * np.sin(elevation)])
        for name in ("cartesianInvalidState", "sphericalInvalidState"):
            if name in column:
                xyz[column[name] != 0.0] = np.nan
        xyz = xyz @ self.pose[:, :3].T + self.pose[:, 3]
        rows["x"], rows["y"], rows["z"] = xyz.T
        for name, ours in _SCALED.items():
            if name in column and ours in (row.names or ()):
                low, high = self.limits.get(name, (0.0, 1.0 if name == "intensity" else 255.0))
                share = (column[name] - low) / (high - low) if high > low else np.zeros(n)
                rows[ours] = np.rint(65535.0 * np.clip(np.nan_to_num(share), 0.0, 1.0))
        return rows


@dataclass(frozen=True)
class E57Points(PointTable):
    """The points of all scans of an E57 file, and the length of its pages with their checksums."""

    page_bytes: int
    scans: tuple[_Scan, ...]

    def batches(self, path: Path, points: int, batch_points: int) -> Iterator[CloudBatch]:  # noqa: ARG002
        """The points in order, some millions of bytes at a time; InputError if a page or a packet is damaged."""
        with path.open("rb") as file:
            pages = _Pages(file, self.page_bytes)
            for scan in self.scans:
                try:
                    for column in _columns(pages, scan):
                        yield batch_of_rows(scan.rows(column, self.row))
                except _E57_FAULTS as error:
                    raise InputError("points-damaged", path=path, fault=reason(error)) from None


def read_e57(path: Path) -> E57Points:
    """The scans of an E57 file; InputError if its header or its XML is damaged, or it has no scans."""
    try:
        with path.open("rb") as file:
            signature, _, _, _, place, size, page_bytes = _HEADER.unpack(file.read(_HEADER.size))
            if signature != E57_SIGNATURE or not 64 <= page_bytes <= 1 << 20 or not 0 < size <= _MAX_XML_BYTES:
                raise ValueError(f"its pages have {page_bytes} bytes, and its XML {size}")
            text = _Pages(file, page_bytes).read(_logical(place, page_bytes), size)
        root = parse_xml(text, path.name)
        scans = tuple(_Scan.of(each, page_bytes) for each in _child(root, "data3D").children)
        if not scans:
            raise ValueError("it has no scans")
        bits = sum(scan.points * max(scan.point_bits, 1) for scan in scans)
        if bits > 8 * path.stat().st_size:
            raise ValueError(f"its points take {bits // 8:,} bytes, more than it has")
    except _E57_FAULTS as error:
        raise InputError("bad-table-header", path=path, title="E57", reason=reason(error)) from None
    coloured = any(field.name == "colorRed" for scan in scans for field in scan.fields)
    row = np.dtype(_PLACE + _COLOURS * coloured)
    return E57Points("e57", row, sum(scan.points for scan in scans), 0, "e57", page_bytes, scans)


class _Pages:
    """The pages of a file without their checksums, which are compared once for each reading in the order of the file.

    A page may be as large as the file, and hold thousands of packets.
    """

    def __init__(self, file: BinaryIO, page_bytes: int) -> None:
        self.page_bytes = page_bytes
        self._file = file
        self._size = self._left = file.seek(0, 2)
        self._first = 0
        self._content = b""
        """That of the pages read last, from the page `_first` on."""

    def take(self, size: int) -> None:
        """Count bytes of packets; ValueError if they are more than those of the file: scans refer to the same ones."""
        self._left -= size
        if self._left < 0:
            raise ValueError("its scans refer to the same packets")

    def read(self, at: int, size: int) -> bytes:
        """Bytes at an offset without checksums; ValueError if they are not there, or damaged."""
        content = self.page_bytes - _CHECKSUM_BYTES
        first = at // content
        last = (at + size - 1) // content
        if not 0 <= at <= self._size:
            raise ValueError(f"it has no byte {at:,}")
        if (last + 1) * self.page_bytes > self._size:
            raise ValueError(f"it ends before byte {(last + 1) * self.page_bytes:,}")
        if not (self._first <= first and (last - self._first + 1) * content <= len(self._content)):
            self._file.seek(first * self.page_bytes)
            data = self._file.read((last - first + 1) * self.page_bytes)
            pages = np.frombuffer(data, np.uint8).reshape(-1, self.page_bytes)
            stated = np.ascontiguousarray(pages[:, content:]).view(">u4")[:, 0]
            wrong = np.flatnonzero(_crc32c(pages, content) != stated)
            if len(wrong):
                at_byte = (first + int(wrong[0])) * self.page_bytes
                raise ValueError(f"the page at byte {at_byte:,} has a wrong checksum")
            self._first = first
            self._content = pages[:, :content].tobytes()
        within = at - self._first * content
        return self._content[within : within + size]


def _columns(pages: _Pages, scan: _Scan) -> Iterator[dict[str, FloatArray]]:
    """Values by the names of the fields, as many points at a time as the packets of a block hold."""
    head = pages.read(scan.at, 32)
    kind = head[0]
    (packets,) = struct.unpack_from("<Q", head, 16)
    if kind != 1:
        raise ValueError(f"a section of the type {kind} where points should be")
    at = _logical(packets, pages.page_bytes)
    done = 0
    held = 0
    streams = [bytearray() for _ in scan.fields]
    bits = [0] * len(streams)
    while done < scan.points:
        kind, _, last, count = struct.unpack("<BBHH", pages.read(at, 6))
        if (last + 1) % 4:
            raise ValueError(f"a packet has {last + 1} bytes, which is no multiple of four")
        pages.take(last + 1)
        if kind == 1:
            packet = pages.read(at, last + 1)
            sizes = struct.unpack_from(f"<{count}H", packet, 6)
            begin = 6 + 2 * count
            if count != len(streams) or begin + sum(sizes) > len(packet):
                raise ValueError(f"a packet has {count} fields of {len(streams)}")
            for stream, size in zip(streams, sizes, strict=True):
                stream += packet[begin : begin + size]
                begin += size
            held += len(packet)
        at += last + 1
        ready = [(8 * len(s) - b) // f.bits for s, b, f in zip(streams, bits, scan.fields, strict=True) if f.bits]
        n = min([*ready, scan.points - done])
        if n and (held >= _BLOCK_BYTES or n == scan.points - done):
            for count in [*[_BLOCK_POINTS] * (n // _BLOCK_POINTS), n % _BLOCK_POINTS]:
                column = {}
                for k, field in enumerate(scan.fields):
                    if field.name in _USED:
                        data = np.frombuffer(streams[k][: (bits[k] + count * field.bits + 7) // 8] + bytes(8), np.uint8)
                        column[field.name] = field.values(data, bits[k], count)
                    used, bits[k] = divmod(bits[k] + count * field.bits, 8)
                    del streams[k][:used]
                if count:
                    yield column
            done = done + n
            held = 0


def _logical(place: int, page_bytes: int) -> int:
    """Offset without checksums of a place in the file."""
    page, within = divmod(place, page_bytes)
    return page * (page_bytes - _CHECKSUM_BYTES) + within


@kernel()
def _crc32c(pages: Any, content: int) -> Any:
    """CRC-32C (Castagnoli) of the first bytes of rows (n, bytes)."""
    table = np.zeros(256, np.uint32)
    for k in range(256):
        value = np.uint32(k)
        for _ in range(8):
            value = (value >> np.uint32(1)) ^ (np.uint32(0x82F63B78) if value & np.uint32(1) else np.uint32(0))
        table[k] = value
    out = np.zeros(len(pages), np.uint32)
    for p in range(len(pages)):
        crc = np.uint32(0xFFFFFFFF)
        for k in range(content):
            crc = table[(crc ^ np.uint32(pages[p, k])) & np.uint32(0xFF)] ^ (crc >> np.uint32(8))
        out[p] = ~crc
    return out


def _child(element: Element, *tags: str) -> Element:
    """The element down a path of tags; an empty one where it ends."""
    return reduce(lambda at, tag: next(at.all(tag), Element("", {})), tags, element)


def _number(element: Element) -> float:
    """The number in an element; ScaledIntegers hold theirs in steps."""
    scale = float(element.get("scale") or 1.0)
    offset = float(element.get("offset") or 0.0)
    return scale * float(element.text or 0.0) + offset
