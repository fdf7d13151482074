"""The file itself: LAS 1.4 header and records, compressed nodes, hierarchy."""

from __future__ import annotations

import datetime as dt
import io
import struct
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Any, Final

import laspy
import lazrs
import numpy as np
from laspy.vlrs.known import LasZipVlr, WktCoordinateSystemVlr
from laspy.vlrs.vlrlist import VLRList
from numpy.typing import NDArray

from furrowmap.core.values.threads import threads
from furrowmap.exporters.cloud.chunk import Columns, compressed
from furrowmap.exporters.cloud.cube import Cube
from furrowmap.exporters.cloud.octree import Key
from furrowmap.exporters.cloud.points import Extent
from furrowmap.exporters.cloud.records import Chosen, columns_of

MOST_COMING: Final = 64
"""Nodes that are read and compressed while others are made ready; each waits with a few bytes a point."""
TABLE_OFFSET: Final = struct.Struct("<q")
"""Before the chunks: where the table of their lengths begins."""
MOST_RECORD_BYTES: Final = 65_535
INFO: Final = struct.Struct("<5d2Q2d88x")
"""The info record: centre, half a side, spacing; offset and length of the hierarchy; first and last time."""
ENTRY: Final = np.dtype([("key", "<i4", 4), ("offset", "<u8"), ("bytes", "<i4"), ("points", "<i4")])


def las_header(
    crs_wkt: str,
    scale_m: float,
    origin_m: tuple[float, float, float],
    extra: Sequence[tuple[str, str, str]],
    *,
    colour: bool,
    week_time: bool,
) -> laspy.LasHeader:
    """A header of point format 6, or 7 with colour, that says all but what the points will be.

    The info record stands first, as COPC wants it. The CRS stands in an ordinary record at the head: QGIS does not
    look for it in extended records at the end.
    """
    header = laspy.LasHeader(version="1.4", point_format=7 if colour else 6)
    header.add_extra_dims([laspy.ExtraBytesParams(name, dtype, description) for name, dtype, description in extra])
    header.scales, header.offsets = np.full(3, scale_m), np.array(origin_m)
    header.global_encoding.wkt = True
    kinds = laspy.header.GpsTimeType
    header.global_encoding.gps_time_type = kinds.WEEK_TIME if week_time else kinds.STANDARD
    header.generating_software = f"furrowmap {version('furrowmap')}"
    header.creation_date = dt.datetime.now(dt.UTC).date()
    extra_bytes = header.point_format.num_extra_bytes
    laz = lazrs.LazVlr.new_for_compression(header.point_format.id, extra_bytes, use_variable_size_chunks=True)
    header.vlrs = [
        laspy.VLR("copc", 1, "COPC info VLR", bytes(INFO.size)),
        LasZipVlr(laz.record_data()),
        WktCoordinateSystemVlr(crs_wkt),
    ]
    header.are_points_compressed = True
    header.number_of_evlrs = 1
    return header


def describe(header: laspy.LasHeader, text: str) -> None:
    """Put words on the cloud into a header: a "Text Area Description" (LAS 1.4 R15), as much as a record holds."""
    held = text.encode("utf-8", "backslashreplace")[:MOST_RECORD_BYTES].decode("utf-8", "ignore")
    header.vlrs.append(laspy.VLR("LASF_Spec", 3, "text area description", held.encode()))


class DiskFile(io.FileIO):
    """A file that remembers what the system said when it refused to write: lazrs passes on only that it did."""

    refusal: OSError | None = None

    def write(self, data: Any, /) -> int:
        """Write what there is room for; see :class:`io.FileIO`."""
        try:
            return super().write(data)
        except OSError as error:
            self.refusal = error
            raise


class CopcFile:
    """Takes nodes, in any order, and makes a file of them.

    Args:
        path: of the file, which is made.
        header: as :func:`las_header` makes it.
        written: is told how many points have been written.
        complete: fills in what was not known when the points came, in place; called from several threads at once.
    """

    def __init__(
        self,
        path: Path,
        header: laspy.LasHeader,
        written: Callable[[int], None],
        complete: Callable[[Columns], None] | None = None,
    ) -> None:
        self._header, self._written, self._complete = header, written, complete
        self._disk = DiskFile(path, "w+")
        self._stream = io.BufferedRandom(self._disk)
        header.write_to(self._stream)
        self._stream.write(bytes(TABLE_OFFSET.size))
        self._threads = ThreadPoolExecutor(threads(), "compress")
        self._coming: deque[Future[_Chunk]] = deque()
        self._keys: list[Key] = []
        self._chunks: list[tuple[int, int]] = []
        self._done = 0
        self.points_by_class = np.zeros(256, np.int64)
        """Points of each class so far."""

    def close(self) -> None:
        """Close the file, finished or not."""
        self._threads.shutdown(cancel_futures=True)
        self._stream.close()

    def put(self, key: Key, parts: Sequence[Chosen]) -> Future[_Chunk]:
        """Take a node; its records are read and compressed in a thread, until what is returned is done.

        Raises:
            OSError: if an earlier node cannot be written.
        """
        self._keys.append(key)
        chunk = self._threads.submit(_chunk_of, parts, self._complete)
        self._coming.append(chunk)
        while self._coming and (len(self._coming) > MOST_COMING or self._coming[0].done()):
            self._write_next()
        return chunk

    def finish(self, extent: Extent, cube: Cube, spacing_m: float) -> None:
        """Write what is left, the hierarchy, and a header that is true."""
        while self._coming:
            self._write_next()
        table = self._stream.tell()
        with self._refusals():
            lazrs.write_chunk_table(self._stream, self._chunks, lazrs.LazVlr(self._header.vlrs[1].record_data))
        start = self._stream.seek(0, io.SEEK_END)
        self._stream.seek(self._header.offset_to_point_data)
        self._stream.write(TABLE_OFFSET.pack(table))
        self._stream.seek(start)
        hierarchy = self._hierarchy()
        record = laspy.VLR("copc", 1000, "EPT Hierarchy", hierarchy.tobytes())
        VLRList([record]).write_to(self._stream, as_extended=True)
        offset = self._stream.tell() - hierarchy.nbytes

        header, scale_m = self._header, float(self._header.scales[0])
        header.start_of_first_evlr = start
        header.point_count = extent.points
        header.number_of_points_by_return = extent.by_return.astype(np.uint64)
        header.mins = extent.low * header.scales + header.offsets
        header.maxs = extent.high * header.scales + header.offsets
        # Cells reach half a step beyond their points, so that no point lies on a border.
        centre = (np.array(cube.origin) + 0.5 * (cube.side - 1)) * header.scales + header.offsets
        info = INFO.pack(
            *centre, 0.5 * cube.side * scale_m, spacing_m, offset, hierarchy.nbytes, extent.first_time, extent.last_time
        )
        header.vlrs[0] = laspy.VLR("copc", 1, "COPC info VLR", info)
        self._stream.seek(0)
        header.write_to(self._stream, ensure_same_size=True)
        self._stream.flush()

    @property
    def nodes(self) -> int:
        """Nodes so far."""
        return len(self._keys)

    @property
    def points_by_level(self) -> NDArray[np.int64]:
        """Points in each level so far."""
        levels, points = [key.level for key in self._keys], [points for points, _ in self._chunks]
        return np.bincount(levels, weights=points).astype(np.int64)

    def _write_next(self) -> None:
        """Write the chunk that was asked for first, once it is there."""
        chunk = self._coming.popleft().result()
        self._stream.write(chunk.data)
        self._chunks.append((chunk.points, len(chunk.data)))
        self.points_by_class += chunk.points_by_class
        self._done += chunk.points
        self._written(self._done)

    @contextmanager
    def _refusals(self) -> Iterator[None]:
        """Errors of the disk as the system told them."""
        try:
            yield
        except (lazrs.LazrsError, OSError) as error:
            raise self._disk.refusal or error from error

    def _hierarchy(self) -> NDArray[np.void]:
        """One page with every node; nodes stand in the file in the order in which they were asked room for.

        A file without points has a root without points, which points nowhere.
        """
        if not self._keys:
            return np.zeros(1, ENTRY)
        points, lengths = np.array(self._chunks, np.int64).T
        entries = np.zeros(len(self._keys), ENTRY)
        entries["key"] = self._keys
        entries["offset"] = self._header.offset_to_point_data + TABLE_OFFSET.size + np.cumsum(lengths) - lengths
        entries["bytes"] = lengths
        entries["points"] = points
        return entries


@dataclass(frozen=True)
class _Chunk:
    """A compressed node."""

    data: bytes
    points: int
    points_by_class: NDArray[np.int64]


def _chunk_of(parts: Sequence[Chosen], complete: Callable[[Columns], None] | None) -> _Chunk:
    """Complete and compress the points of a node."""
    columns = columns_of(parts)
    if complete is not None:
        complete(columns)
    return _Chunk(compressed(columns), len(columns), np.bincount(columns.classification, minlength=256))
