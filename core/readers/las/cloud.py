"""LAS, LAZ and COPC files from other software: checked when opened, read in batches, compared with their headers."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import closing
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import BinaryIO, Final

import numpy as np
import pyproj
from numpy.typing import NDArray

from furrowmap.core.readers.las.copc import CopcIndex, is_copc, read_index
from furrowmap.core.readers.las.crs import stated_crs
from furrowmap.core.readers.las.decoder import DECODER, Decoder
from furrowmap.core.readers.las.e57 import read_e57
from furrowmap.core.readers.las.header import LEAST_RECORD_BYTES, LasHeader, read_header
from furrowmap.core.readers.las.laz import (
    LAZ_RECORD_ID,
    LAZ_USER_ID,
    LazPoints,
    decode_chunks,
    find_points,
    stream_points,
)
from furrowmap.core.readers.las.points import TIME_SAMPLE, CloudBatch, TimeKind, clock_of, layout, unpack
from furrowmap.core.readers.las.records import ExtraDimension, extra_dimensions, read_records
from furrowmap.core.readers.las.tables import E57_SIGNATURE, TABLE_HEADER_BYTES, PointTable, read_table
from furrowmap.core.runtime.arrays import FloatArray
from furrowmap.core.runtime.errors import InputError, Notice
from furrowmap.core.values.clock import las_time_to_utc
from furrowmap.core.values.extents import bounds


@dataclass
class Survey:
    """Statistics over the points of a cloud.

    Attributes:
        points: number of points so far.
        low: (3,) minimum x, y, z.
        high: (3,) maximum x, y, z.
        by_return: (16,) number of points by return number.
        by_class: (256,) number of points by class.
        withheld: number of points marked as deleted.
        first_time: earliest GPS time as in the file; inf without times.
        last_time: latest; -inf without times.
        bad_times: number of points with an invalid time.
    """

    cloud: CloudFile
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
        cloud, header = self.cloud, self.cloud.header
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
                    listed=listed[0],
                    listed_2=listed[1] or "none",
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


def survey(cloud: CloudFile) -> Survey:
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
        format: "las", "laz" or "copc".
        points: number of points that can be read.
        crs: None if the file states none, or none that PROJ understands.
        clock: the meaning of its times.
        extra: dimensions that are not part of the point format; they are listed, not read.
        laz: where the compressed points are; None if the points are not compressed.
        index: the octree; None if there is none, or it is invalid.
        notices: errors in header and records that show before the points are read; for the others see :class:`Survey`.
        lost: what of damaged points has been left out so far.
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
                yield from stream_points(
                    self.path, file, self.header, laz, self.points, batch_points, self.lost, decoder
                )
        else:
            wanted = np.arange(len(laz.points))
            if self.index is not None and (box is not None or resolution is not None):
                wanted = self.index.chunks_in(box, resolution)
            for first, last in _runs(wanted, laz.points, batch_points):
                yield from decode_chunks(self.path, file, laz, first, last, self.lost)


@dataclass(frozen=True)
class TableCloud(CloudFile):
    """A PCD, PLY or E57 file; its header is that of a LAS file with the same points.

    Attributes:
        table: where the points are.
    """

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
    x, y = batch.xyz_m[:, 0], batch.xyz_m[:, 1]
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
        raise InputError("no-points.table", path=path, points=table.points)
    if found.points < points:
        notices += (Notice("points-without-place", path=path.name, points=points, without=points - found.points),)
    low, high = (tuple(ends.tolist()) for ends in (found.low, found.high))
    return replace(cloud, header=replace(header, low=low, high=high), notices=notices)


def open_cloud(path: Path) -> CloudFile:
    """Open a LAS, LAZ, COPC, PCD, PLY or E57 file and check everything that can be checked before its points are read.

    Raises:
        InputError: if there is no such file, or its points cannot be read.
    """
    if not path.is_file():
        raise InputError("no-such-file.open-cloud", path=path, is_path=bool(path.is_dir()))
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
            laz, form, points = find_points(path, file, header, records), "laz", header.points
            if is_copc(records):
                index, found = read_index(path, file, header, records, laz)
                notices, form = (*notices, *found), "copc"
        else:
            points, found = _room(path, header)
            notices += found
        crs, crs_notices = stated_crs(path, header, records)
        extra, extra_notices = extra_dimensions(
            path, records, header.record_bytes - LEAST_RECORD_BYTES[header.point_format]
        )
        times, count = np.empty(0), min(TIME_SAMPLE, points)
        if header.has_time and count and laz is None:
            times = next(_plain(path, file, header, count, count)).view(layout(header))["gps_time"]
        elif header.has_time and count and laz is not None:
            first = stream_points(path, file, header, laz, count, count, [], DECODER)
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
        raise InputError("no-points.room", path=path, points=header.points, size_bytes=header.size_bytes)
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
            start, total = i, 0
        total += int(points[number])
    if len(wanted):
        yield int(wanted[start]), int(wanted[-1]) + 1
