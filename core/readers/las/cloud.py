"""LAS, LAZ and COPC files from other software: checked when opened, read in batches, compared with their headers."""

import math
import struct
from collections.abc import Iterator, Sequence
from contextlib import closing
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import BinaryIO, Final

import numpy as np
import pyproj
from numpy.typing import NDArray
from pyproj.exceptions import CRSError, ProjError

from furrowmap.core.readers.las.e57 import read_e57
from furrowmap.core.readers.las.header import (
    LEAST_RECORD_BYTES,
    SIGNATURE,
    ExtraDimension,
    LasHeader,
    LasRecord,
    extra_dimensions,
    read_header,
    read_records,
)
from furrowmap.core.readers.las.las_decoder import DECODER, Decoder
from furrowmap.core.readers.las.laz import (
    LAZ_RECORD_ID,
    LAZ_USER_ID,
    LazPoints,
    decode_chunks,
    find_points,
    stream_points,
)
from furrowmap.core.readers.las.pcd_ply import (
    E57_SIGNATURE,
    POINT_SIGNATURES,
    TABLE_HEADER_BYTES,
    PointTable,
    read_table,
)
from furrowmap.core.readers.las.point_records import TIME_SAMPLE, CloudBatch, TimeKind, clock_of, layout, unpack
from furrowmap.core.readers.vertical_keys import heights_by_keys, heights_differ, tells_more, with_heights
from furrowmap.core.runtime.arrays import FloatArray
from furrowmap.core.runtime.errors import InputError, Notice
from furrowmap.core.runtime.languages.texts import Text
from furrowmap.core.runtime.plain_reads import open_plain
from furrowmap.core.values.clock import las_time_to_utc
from furrowmap.core.values.crs import crs_of_file
from furrowmap.core.values.extents import bounds

_USER_ID: Final = "LASF_Projection"
_WKT_RECORD: Final = 2112
_KEYS_RECORD: Final = 34735
_DOUBLES_RECORD: Final = 34736
_TEXTS_RECORD: Final = 34737
_MODEL: Final = 1024
_GEOGRAPHIC: Final = 2048
_PROJECTED: Final = 3072
"""GeoTIFF keys: model type, code of the geographic CRS, code of the projected CRS (or 32767: user-defined)."""
_SAME: Final = 1e-3
"""Two CRS are the same if the middle of the file differs by less than this between them, in their unit."""


def stated_crs(
    path: Path, header: LasHeader, records: tuple[LasRecord, ...]
) -> tuple[pyproj.CRS | None, tuple[Notice, ...]]:
    """The CRS that the records state; None if they state none, or none that PROJ understands.

    If there are both WKT and GeoTIFF keys, the kind that the header announces is used; of the other are heights where
    only that states them.
    """
    notices: list[Notice] = []
    texts = [r.data for r in records if (r.user, r.number) == (_USER_ID, _WKT_RECORD) and r.data.strip(b"\0 ")]
    keys = {
        r.number: r.data
        for r in reversed(records)
        if r.user == _USER_ID and r.number in (_KEYS_RECORD, _DOUBLES_RECORD, _TEXTS_RECORD)
    }
    by_text: pyproj.CRS | None = None
    for text in texts:
        by_text, invalid = _from_wkt(path, text)
        notices += invalid
        if by_text is not None:
            break
    by_keys, unreadable = _from_keys(path, keys)
    heights, odd = heights_by_keys(path.name, _short_keys(keys), by_keys)
    notices += [*unreadable, *odd]
    if by_keys is not None and heights is not None and not (by_keys.is_compound and by_keys.sub_crs_list[1] == heights):
        by_keys = with_heights(by_keys, heights)
    first, second = (by_text, by_keys) if header.crs_is_wkt else (by_keys, by_text)
    kinds = ("WKT", "GeoTIFF keys") if header.crs_is_wkt else ("GeoTIFF keys", "WKT")
    if first is not None and second is not None and not _same(first, second, header):
        notices.append(
            Notice(
                "crs-contradiction",
                path=path.name,
                first=first.name,
                kinds=kinds[0],
                second=second.name,
                kinds_other=kinds[1],
            )
        )
        return first, tuple(notices)
    found = first or second
    other = second.sub_crs_list[1] if second is not None and second.is_compound else heights
    if found is None or other is None:
        return found, tuple(notices)
    if found.is_compound:
        notices += heights_differ(path.name, found.sub_crs_list[1], other, kinds)
    elif len(found.axis_info) == 2 and tells_more(found, other):
        found = with_heights(found, other)
    return found, tuple(notices)


def _from_wkt(path: Path, data: bytes) -> tuple[pyproj.CRS | None, list[Notice]]:
    text = data.split(b"\0")[0].decode("utf-8", "replace").strip()
    try:
        pyproj.CRS.from_wkt(text)  # no other form is one of LAS
        return crs_of_file(text), []
    except (CRSError, ProjError) as error:
        invalid = Notice(
            "crs-unreadable.invalid-wkt",
            path=path.name,
            start=text[:40],
            more=len(text) > 40,
            size_bytes=len(data),
            reason=str(error).split(":")[0][:120],
        )
        return None, [invalid]


def _from_keys(path: Path, records: dict[int, bytes]) -> tuple[pyproj.CRS | None, list[Notice]]:
    """The CRS of GeoTIFF keys. GDAL reads it from a TIFF of one pixel: it knows user-defined CRS, units, old codes."""
    keys = _short_keys(records)
    if keys.get(_PROJECTED) or keys.get(_GEOGRAPHIC):
        import rasterio
        from rasterio.errors import RasterioError

        try:
            with (
                rasterio.Env(GTIFF_REPORT_COMPD_CS=True),
                rasterio.MemoryFile(_pixel(records), ext=".tif") as file,
                file.open(driver="GTiff") as picture,
            ):
                found = crs_of_file(picture.crs.to_wkt()) if picture.crs else None
        except (RasterioError, CRSError, ProjError, ValueError):
            found = None
        flat = found.sub_crs_list[0] if found is not None and found.is_compound else found
        # GDAL makes a local CRS from keys that name none.
        if flat is not None and (flat.is_projected or flat.is_geographic):
            return found, []
    elif not keys.get(_MODEL):
        return None, []
    return None, [Notice("crs-unreadable", path=path.name)]


def _short_keys(records: dict[int, bytes]) -> dict[int, int]:
    """The GeoTIFF keys that have one number, such as a code."""
    directory = records.get(_KEYS_RECORD, b"")
    entries = struct.iter_unpack(
        "<4H", directory[8 : 8 + (len(directory) - 8) // 8 * 8] if len(directory) >= 8 else b""
    )
    return {key: value for key, place, _, value in entries if place == 0}


def _pixel(records: dict[int, bytes]) -> bytes:
    """A TIFF of one pixel with these GeoTIFF records, without the keys that point outside them."""
    doubles = records.get(_DOUBLES_RECORD, b"")[: len(records.get(_DOUBLES_RECORD, b"")) // 8 * 8]
    texts = records.get(_TEXTS_RECORD, b"")
    data = records[_KEYS_RECORD]
    entries = [
        entry
        for entry in struct.iter_unpack("<4H", data[8 : 8 + (len(data) - 8) // 8 * 8])
        if entry[1] == 0
        or (entry[1] == _DOUBLES_RECORD and (entry[2] + entry[3]) * 8 <= len(doubles))
        or (entry[1] == _TEXTS_RECORD and entry[2] + entry[3] <= len(texts))
    ]
    entries = [entry for entry in sorted(entries) if entry[0]]
    directory = struct.pack("<4H", 1, 1, 0, len(entries)) + b"".join(struct.pack("<4H", *entry) for entry in entries)
    tags: list[tuple[int, int, int, bytes]] = [
        (256, 3, 1, struct.pack("<H", 1)),
        (257, 3, 1, struct.pack("<H", 1)),
        (258, 3, 1, struct.pack("<H", 8)),
        (262, 3, 1, struct.pack("<H", 1)),
        (273, 4, 1, struct.pack("<I", 8)),
        (277, 3, 1, struct.pack("<H", 1)),
        (278, 3, 1, struct.pack("<H", 1)),
        (279, 4, 1, struct.pack("<I", 1)),
        (33550, 12, 3, struct.pack("<3d", 1, 1, 0)),
        (33922, 12, 6, bytes(48)),
        (_KEYS_RECORD, 3, len(directory) // 2, directory),
    ]
    tags += [(_DOUBLES_RECORD, 12, len(doubles) // 8, doubles)] if doubles else []
    tags += [(_TEXTS_RECORD, 2, len(texts) + 1, texts + b"\0")] if texts else []
    start = 16
    values = b""
    entries_at = b""
    for tag, kind, count, content in tags:
        place = struct.pack("<I", start + len(values)) if len(content) > 4 else content.ljust(4, b"\0")
        if len(content) > 4:
            values += content + b"\0" * (len(content) % 2)
        entries_at += struct.pack("<HHI", tag, kind, count) + place
    pixel = bytes(8)
    table = struct.pack("<H", len(tags)) + entries_at + bytes(4)
    return b"II*\0" + struct.pack("<I", start + len(values)) + pixel + values + table


def _same(one: pyproj.CRS, other: pyproj.CRS, header: LasHeader) -> bool:
    if one.equals(other, ignore_axis_order=True):
        return True
    try:
        to_other = pyproj.Transformer.from_crs(one.to_2d(), other.to_2d(), always_xy=True)
        x, y = (0.5 * (low + high) for low, high in zip(header.low[:2], header.high[:2], strict=True))
        return math.dist((x, y), to_other.transform(x, y)) < _SAME
    except (CRSError, ProjError):
        return False


INFO_BYTES: Final = 160
ENTRY: Final = np.dtype([("key", "<i4", 4), ("offset", "<u8"), ("bytes", "<i4"), ("points", "<i4")])
MAX_LEVEL: Final = 30
MAX_PAGES: Final = 100_000
_INFO: Final = struct.Struct("<5d2Q2d")


@dataclass(frozen=True)
class CopcIndex:
    """An octree, checked against the file's chunks.

    Attributes:
        low: minimum x, y, z of the root's cube.
        side: length of that cube's sides.
        spacing: point spacing of the root.
        keys: (n, 4) int32 level, x, y, z of each node with points.
        chunks: (n,) index of the chunk with its points.
    """

    low: tuple[float, float, float]
    side: float
    spacing: float
    keys: NDArray[np.int32]
    chunks: NDArray[np.intp]

    def chunks_in(self, box: tuple[float, float, float, float] | None, resolution: float | None) -> NDArray[np.intp]:
        """Indices (n,) of the chunks for a box (least x and y, greatest x and y) and a sufficient point spacing."""
        level = self.keys[:, 0]
        keep = np.ones(len(level), bool)
        if resolution is not None:
            keep &= (level == 0) | (self.spacing / 2.0 ** (level - 1.0) > resolution)
        if box is not None:
            side = self.side / 2.0**level
            for axis in (0, 1):
                least = self.low[axis] + self.keys[:, 1 + axis] * side
                # Writers round cubes: a point may lie slightly outside its own.
                keep &= (least - 1e-6 * self.side <= box[2 + axis]) & (least + side + 1e-6 * self.side >= box[axis])
        return np.sort(self.chunks[keep])


class _OctreeError(Exception):
    """Why an octree is invalid."""


def _index(file: BinaryIO, header: LasHeader, records: Sequence[LasRecord], laz: LazPoints) -> CopcIndex:
    info = next(record for record in records if (record.user, record.number) == ("copc", 1))
    if len(info.data) < INFO_BYTES:
        raise _OctreeError(
            Text("the info record has {size} bytes instead of {wanted}", size=len(info.data), wanted=INFO_BYTES)
        )
    *cube, root_at, root_bytes, _, _ = _INFO.unpack_from(info.data)
    x, y, z, half, spacing = cube
    if not (np.isfinite(cube).all() and half > 0 and spacing > 0):
        raise _OctreeError(Text("half size of the cube {half:g}, spacing {spacing:g}", half=half, spacing=spacing))
    entries = _entries(file, header, int(root_at), int(root_bytes))
    nodes = entries[entries["points"] > 0]
    if int(nodes["points"].sum(dtype=np.int64)) != header.points or len(nodes) != len(laz.points):
        raise _OctreeError(
            Text(
                "it has {points:,} points in {nodes:,} nodes, the file {in_file:,} points in {chunks:,} chunks",
                points=nodes["points"].sum(dtype=np.int64),
                nodes=len(nodes),
                in_file=header.points,
                chunks=len(laz.points),
            )
        )
    level = nodes["key"][:, :1]
    place = nodes["key"][:, 1:]
    if np.any(level < 0) or np.any(level > MAX_LEVEL) or np.any(place < 0) or np.any(place >= 2.0**level):
        raise _OctreeError(Text("a node is outside the cube"))
    chunks = np.searchsorted(laz.begins, nodes["offset"].astype(np.int64))
    fitting = chunks < len(laz.begins)
    at = np.minimum(chunks, len(laz.begins) - 1)
    for name, true in (("offset", laz.begins), ("bytes", laz.sizes), ("points", laz.points)):
        fitting &= nodes[name].astype(np.int64) == true[at]
    if not fitting.all():
        number = int(np.flatnonzero(~fitting)[0])
        node = "-".join(map(str, nodes["key"][number].tolist()))
        raise _OctreeError(
            Text(
                "node {node} is not a chunk of the file (byte {offset:,})",
                node=node,
                offset=int(nodes["offset"][number]),
            )
        )
    return CopcIndex((x - half, y - half, z - half), 2.0 * half, spacing, nodes["key"].copy(), chunks.astype(np.intp))


def _entries(file: BinaryIO, header: LasHeader, root_at: int, root_bytes: int) -> NDArray[np.void]:
    """All entries of all pages; each page is read once."""
    waiting = [(root_at, root_bytes)]
    seen: set[int] = set()
    pages = [np.zeros(0, ENTRY)]
    left = math.inf
    while waiting:
        at, size = waiting.pop()
        if at in seen:
            raise _OctreeError(Text("the hierarchy page at byte {at:,} refers to itself", at=at))
        seen.add(at)
        if at < header.header_bytes or at + size > header.size_bytes or size < 0 or size % ENTRY.itemsize:
            raise _OctreeError(
                Text("a hierarchy page at bytes {begin:,} to {end:,} is outside the file", begin=at, end=at + size)
            )
        left = min(left, header.size_bytes) - size
        if left < 0 or len(seen) > MAX_PAGES:
            raise _OctreeError(Text("hierarchy pages overlap"))
        file.seek(at)
        page = np.frombuffer(file.read(size), ENTRY)
        pages.append(page[page["points"] >= 0])
        waiting += [(int(entry["offset"]), int(entry["bytes"])) for entry in page[page["points"] < 0]]
    return np.concatenate(pages)


@dataclass
class Survey:
    """Statistics over the points of a cloud.

    Attributes:
        low: (3,) minimum x, y, z.
        high: (3,) maximum x, y, z.
        by_return: (16,) number of points by return number.
        by_class: (256,) number of points by class.
        first_time: earliest GPS time as in the file; inf without times.
        last_time: latest; -inf without times.
    """

    cloud: "CloudFile"
    points: int = 0
    low: FloatArray = field(default_factory=lambda: np.full(3, np.inf))
    high: FloatArray = field(default_factory=lambda: np.full(3, -np.inf))
    by_return: NDArray[np.int64] = field(default_factory=lambda: np.zeros(16, np.int64))
    by_class: NDArray[np.int64] = field(default_factory=lambda: np.zeros(256, np.int64))
    withheld: int = 0
    first_time: float = np.inf
    last_time: float = -np.inf
    bad_times: int = 0

    def add(self, batch: CloudBatch) -> None:
        """Add the points of a batch."""
        self.points += len(batch)
        if len(batch):
            low, high = bounds(batch.xyz_m)
            self.low, self.high = np.minimum(self.low, low), np.maximum(self.high, high)
        self.by_return += np.bincount(batch.return_number, minlength=16)
        self.by_class += np.bincount(batch.classification, minlength=256)
        self.withheld += int(np.count_nonzero(batch.withheld))
        if batch.gps_time is not None and len(batch):
            self.bad_times += int(np.count_nonzero(np.isnan(batch.gps_time)))
            self.first_time = float(np.fmin(self.first_time, np.fmin.reduce(batch.gps_time)))
            self.last_time = float(np.fmax(self.last_time, np.fmax.reduce(batch.gps_time)))

    def notices(self) -> tuple[Notice, ...]:
        """Lost points, and differences between header and points, once all points have been added."""
        cloud = self.cloud
        header = self.cloud.header
        found = list(dict.fromkeys(cloud.lost))
        off = np.maximum(np.abs(np.subtract(header.low, self.low)), np.abs(np.subtract(header.high, self.high)))
        # One step of the scale is rounding, and so is the resolution of a double for large coordinates.
        slack = 1.5 * np.array(header.scale) + 1e-12 * np.maximum(np.abs(self.low), np.abs(self.high))
        wrong = ~(off <= slack)
        if self.points and wrong.any():
            in_header, in_points = (
                ", ".join(
                    f"{axis} {low:.10g} to {high:.10g}"
                    for axis, low, high, bad in zip("xyz", *box, wrong, strict=True)
                    if bad
                )
                for box in ((header.low, header.high), (self.low, self.high))
            )
            found.append(Notice("header-box", cloud=cloud.path.name, in_header=in_header, in_points=in_points))
        in_header_by_return = np.zeros(15, np.int64)
        stated = np.minimum(np.array(header.by_return, np.uint64), np.iinfo(np.int64).max).astype(np.int64)
        in_header_by_return[: len(stated)] = stated
        counts = in_header_by_return, self.by_return[1:]
        if self.points and stated.any() and not np.array_equal(*counts):
            listed = [" + ".join(f"{n:,}" for n in np.trim_zeros(numbers, "b")) for numbers in counts]
            found.append(
                Notice(
                    "returns-differ",
                    cloud=cloud.path.name,
                    in_header=listed[0],
                    in_file=listed[1] or "none",
                    by_return=self.by_return[0] or None,
                )
            )
        if self.bad_times and cloud.clock is not TimeKind.UNKNOWN:  # that has a notice since the file was opened
            found.append(
                Notice(
                    "gps-times-bad",
                    cloud=cloud.path.name,
                    bad_times=self.bad_times,
                    points=self.points,
                    kind=cloud.clock,
                )
            )
        return tuple(found)

    @property
    def utc_s(self) -> tuple[float, float] | None:
        """Earliest and latest UTC; None if the file has no date."""
        if self.cloud.clock is not TimeKind.STANDARD or self.first_time > self.last_time:
            return None
        first, last = las_time_to_utc([self.first_time, self.last_time]).tolist()
        return first, last


def survey(cloud: "CloudFile") -> Survey:
    """Statistics over all points of a cloud; InputError if its points are damaged."""
    found = Survey(cloud)
    for batch in cloud.batches():
        found.add(batch)
    return found


BATCH_POINTS: Final = 1_000_000
BATCH_BYTES: Final = 1 << 26
"""Bytes of records at a time: a record may have up to 65,535 bytes."""
LAS_HEAD_BYTES: Final = 375
LEAST_TEXT_BYTES: Final = 6
"""A line of three digits."""
TABLE_SCALE: Final = 1e-4
"""Scale of points that are stored as floating-point numbers."""

Box = tuple[float, float, float, float]


@dataclass(frozen=True)
class CloudFile:
    """A LAS, LAZ or COPC file whose header, records and chunks have been checked.

    Attributes:
        crs: None if the file states none, or none that PROJ understands.
        clock: the meaning of its times.
        extra: dimensions that are not part of the point format; they are listed, not read.
        notices: errors in header and records that show before the points are read; for the others see :class:`Survey`.
        lost: what of damaged points has been left out so far: it shows only while points are decoded, batch by batch.
    """

    path: Path
    format: str
    header: LasHeader
    points: int
    crs: pyproj.CRS | None
    clock: TimeKind
    extra: tuple[ExtraDimension, ...]
    laz: LazPoints | None = field(repr=False)
    index: CopcIndex | None = field(repr=False)
    notices: tuple[Notice, ...]
    lost: list[Notice] = field(default_factory=list, repr=False, compare=False)

    @property
    def dimensions(self) -> tuple[str, ...]:
        """Names of the dimensions of a point."""
        return (*(layout(self.header).names or ()), *(dimension.name for dimension in self.extra))

    def batches(
        self, box: Box | None = None, resolution: float | None = None, batch_points: int = BATCH_POINTS
    ) -> Iterator[CloudBatch]:
        """The points in the order of the file, about `batch_points` at a time.

        Args:
            box: minimum x, minimum y, maximum x, maximum y of the points to read, in the file's CRS; None for all. Of a
                COPC file only the nodes that intersect it are read.
            resolution: point spacing that is sufficient; only COPC files have coarser levels, of others all points
                are read.
            batch_points: a larger compressed chunk (up to four million points) is a batch of its own.

        Raises:
            InputError: if compressed points are damaged and the user does not allow that, or the file was truncated
                since it was opened.
        """
        kind = layout(self.header)
        with self.path.open("rb") as file:
            for records in self._records(file, box, resolution, batch_points):
                batch = unpack(records.view(kind), self.header, self.clock)
                batch = batch if box is None else batch.where(_inside(batch, box))
                if len(batch):
                    yield batch

    def _records(
        self, file: BinaryIO, box: Box | None, resolution: float | None, batch_points: int
    ) -> Iterator[NDArray[np.uint8]]:
        laz = self.laz
        batch_points = max(1, min(batch_points, BATCH_BYTES // self.header.record_bytes))
        if laz is None:
            yield from _plain(self.path, file, self.header, self.points, batch_points)
        elif not laz.wholesale:
            with closing(Decoder()) as decoder:
                lost = yield from stream_points(self.path, file, self.header, laz, self.points, batch_points, decoder)
                self.lost.extend(lost)
        else:
            wanted = np.arange(len(laz.points))
            if self.index is not None and (box is not None or resolution is not None):
                wanted = self.index.chunks_in(box, resolution)
            for first, last in _runs(wanted, laz.points, batch_points):
                whole, lost = decode_chunks(self.path, file, laz, first, last)
                self.lost.extend(lost)
                yield from whole


@dataclass(frozen=True)
class TableCloud(CloudFile):
    """A PCD, PLY or E57 file; its header is that of a LAS file with the same points."""

    table: PointTable = field(kw_only=True, repr=False)

    @property
    def dimensions(self) -> tuple[str, ...]:
        """Names of the dimensions of a point."""
        return tuple(self.table.row.names or ())

    def batches(
        self,
        box: Box | None = None,
        resolution: float | None = None,  # noqa: ARG002
        batch_points: int = BATCH_POINTS,
    ) -> Iterator[CloudBatch]:
        """As those of :class:`CloudFile`; nothing is coarser than the file."""
        batch_points = max(1, min(batch_points, BATCH_BYTES // self.header.record_bytes))
        for batch in self.table.batches(self.path, self.points, batch_points):
            found = batch if box is None else batch.where(_inside(batch, box))
            if len(found):
                yield found


def _inside(batch: CloudBatch, box: Box) -> NDArray[np.bool_]:
    x = batch.xyz_m[:, 0]
    y = batch.xyz_m[:, 1]
    return np.asarray((x >= box[0]) & (y >= box[1]) & (x <= box[2]) & (y <= box[3]))


def _open_table(path: Path, table: PointTable, size_bytes: int) -> TableCloud:
    """A PCD, PLY or E57 file, whose points are read once for their bounds."""
    record_bytes = LEAST_TEXT_BYTES if table.coding == "ascii" else table.row.itemsize
    header = LasHeader(
        version=4, encoding=0, system="", software="", created=None, header_bytes=table.offset, offset=table.offset,
        records=0, point_format=2, compressed=False, record_bytes=record_bytes,
        points=table.points, by_return=(), scale=(TABLE_SCALE,) * 3, shift=(0.0,) * 3, low=(np.inf,) * 3,
        high=(-np.inf,) * 3, extended_at=0, extended=0, waveforms_at=0, size_bytes=size_bytes, notices=(),
    )  # fmt: skip
    packed = table.coding in ("binary_compressed", "e57")
    points, notices = (table.points, ()) if packed else _room(path, header)
    cloud = TableCloud(path, table.format, header, points, None, TimeKind.NONE, (), None, None, notices, table=table)
    found = survey(cloud)
    if not found.points:
        raise InputError("no-points.no-coordinates", path=path, points=table.points)
    if found.points < points:
        notices += (Notice("points-without-place", path=path.name, points=points, without=points - found.points),)
    low, high = (tuple(ends.tolist()) for ends in (found.low, found.high))
    return replace(cloud, header=replace(header, low=low, high=high), notices=notices)


def is_cloud(path: Path) -> bool:
    """Whether a file begins as a point cloud that :func:`open_cloud` reads. Raises OSError if it cannot be opened."""
    with open_plain(path) as file:
        return file.read(16).startswith((SIGNATURE, *POINT_SIGNATURES))


def open_cloud(path: Path) -> CloudFile:
    """Open a LAS, LAZ, COPC, PCD, PLY or E57 file and check everything that can be checked before its points are read.

    InputError if there is no such file, or its points cannot be read.
    """
    if not path.is_file():
        raise InputError("no-such-file.of-cloud", path=path, is_path=bool(path.is_dir()))
    with path.open("rb") as file:
        size_bytes = path.stat().st_size
        head = file.read(TABLE_HEADER_BYTES)
        table = read_e57(path) if head.startswith(E57_SIGNATURE) else read_table(path, head)
        if table is not None:
            return _open_table(path, table, size_bytes)
        header = read_header(path, head[:LAS_HEAD_BYTES], size_bytes)
        records, notices = read_records(path, file, header)
        notices = (*header.notices, *notices)
        said_compressed = any((record.user, record.number) == (LAZ_USER_ID, LAZ_RECORD_ID) for record in records)
        laz = index = None
        form = "las"
        if header.compressed or said_compressed:
            laz = find_points(path, file, header, records)
            form = "laz"
            points = header.points
            if any((record.user, record.number) == ("copc", 1) for record in records):
                form = "copc"
                try:
                    index = _index(file, header, records, laz)
                except _OctreeError as fault:
                    notices = (*notices, Notice("copc-index", path=path.name, fault=fault))
        else:
            points, found = _room(path, header)
            notices += found
        crs, crs_notices = stated_crs(path, header, records)
        extra, extra_notices = extra_dimensions(
            path, records, header.record_bytes - LEAST_RECORD_BYTES[header.point_format]
        )
        times = np.empty(0)
        count = min(TIME_SAMPLE, points)
        if header.has_time and count and laz is None:
            times = next(_plain(path, file, header, count, count)).view(layout(header))["gps_time"]
        elif header.has_time and count and laz is not None:
            first = stream_points(path, file, header, laz, count, count, DECODER)
            times = next(first, np.empty(0, np.uint8)).view(layout(header))["gps_time"]
        clock, time_notices = clock_of(path, header, times)
    notices = (*notices, *crs_notices, *extra_notices, *time_notices)
    return CloudFile(path, form, header, points, crs, clock, extra, laz, index, notices)


def _room(path: Path, header: LasHeader) -> tuple[int, tuple[Notice, ...]]:
    """Number of complete uncompressed points in the file, up to the number in the header."""
    behind = [at for at in (header.extended_at, header.waveforms_at) if header.offset <= at <= header.size_bytes]
    end = min([*(at for at in behind if at), header.size_bytes])
    room = (end - header.offset) // header.record_bytes
    if header.points <= room:
        return header.points, ()
    if room == 0:
        raise InputError("no-points.file-ends", path=path, points=header.points, size_bytes=header.size_bytes)
    return room, (
        Notice(
            "points-missing",
            path=path.name,
            points=header.points,
            offset=header.offset,
            end=end,
            room=room,
            record_bytes=header.record_bytes,
        ),
    )


def _plain(
    path: Path, file: BinaryIO, header: LasHeader, points: int, batch_points: int
) -> Iterator[NDArray[np.uint8]]:
    file.seek(header.offset)
    done = 0
    while done < points:
        wanted = min(batch_points, points - done)
        data = file.read(wanted * header.record_bytes)
        if len(data) < wanted * header.record_bytes:
            raise InputError("file-changed", path=path, done=done, points=points)
        done += wanted
        yield np.frombuffer(data, np.uint8)


def _runs(wanted: NDArray[np.intp], points: NDArray[np.int64], batch_points: int) -> Iterator[tuple[int, int]]:
    """First and last + 1 of consecutive chunks with about `batch_points` in total."""
    start = total = 0
    for i, number in enumerate(wanted):
        gap = i > start and number != wanted[i - 1] + 1
        if i > start and (gap or total + points[number] > batch_points):
            yield int(wanted[start]), int(wanted[i - 1]) + 1
            start = i
            total = 0
        total += int(points[number])
    if len(wanted):
        yield int(wanted[start]), int(wanted[-1]) + 1
