"""COPC files: LAS 1.4 header and records, compressed nodes, hierarchy."""

import datetime as dt
import io
import struct
from collections import deque
from collections.abc import Callable, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
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
from pyproj import CRS
from pyproj.exceptions import CRSError

from furrowmap.core.runtime.background import give_way
from furrowmap.core.runtime.settings import threads
from furrowmap.exporters.cloud.cube import Cube
from furrowmap.exporters.cloud.layers import ChunkColumns, compress_points
from furrowmap.exporters.cloud.octree import Key
from furrowmap.exporters.cloud.point_batches import Extent
from furrowmap.exporters.cloud.records import Chosen, select_columns

PLAIN: Final = 6
COLOURED: Final = 7
"""Point formats of LAS."""
MAX_COMING: Final = 64
"""Maximum number of nodes in compression; each waits with a few bytes a point."""
TABLE_OFFSET: Final = struct.Struct("<q")
"""Before the chunks: offset of the table of their lengths."""
MAX_VLR_BYTES: Final = 65_535
INFO: Final = struct.Struct("<5d2Q2d88x")
"""The info record: centre, half a side, spacing; offset and length of the hierarchy; first and last time."""
ENTRY: Final = np.dtype([("key", "<i4", 4), ("offset", "<u8"), ("bytes", "<i4"), ("points", "<i4")])
Chunk = tuple[bytes, int, NDArray[np.int64]]
"""A compressed node: its data, number of points, and points of each class."""


@dataclass(frozen=True)
class CopcFormat:
    """The properties of a COPC file apart from its points.

    Attributes:
        crs_wkt: of the coordinates; see :func:`las_wkt`.
        origin_m: easting, northing, height that the coordinates of batches are relative to.
        extra: name, numpy scalar type and description (at most 32 bytes) of additional dimensions.
        colour: whether points have colour (point format 7 instead of 6).
        week_time: whether times are seconds of an unknown GPS week instead of UTC.
    """

    crs_wkt: str
    origin_m: tuple[float, float, float]
    scale_m: float = 0.001
    extra: Sequence[tuple[str, str, str]] = ()
    colour: bool = False
    week_time: bool = False


def las_wkt(crs: CRS) -> str:
    """The WKT of a cloud's CRS: WKT 1, as LAS 1.4 requires; WKT 2 where WKT 1 cannot express the projection."""
    try:
        return crs.to_wkt("WKT1_GDAL")
    except CRSError:
        return crs.to_wkt("WKT2_2019")


def las_header(kind: CopcFormat) -> laspy.LasHeader:
    """A header of point format 6 or 7, complete but for the statistics of the points.

    The info record comes first, as COPC requires. The CRS is in an ordinary record at the beginning: QGIS does not
    read it from extended records at the end.
    """
    header = laspy.LasHeader(version="1.4", point_format=COLOURED if kind.colour else PLAIN)
    header.add_extra_dims([laspy.ExtraBytesParams(name, dtype, text) for name, dtype, text in kind.extra])
    header.scales = np.full(3, kind.scale_m)
    header.offsets = np.array(kind.origin_m)
    header.global_encoding.wkt = True
    times = laspy.header.GpsTimeType
    header.global_encoding.gps_time_type = times.WEEK_TIME if kind.week_time else times.STANDARD
    header.generating_software = f"furrowmap {version('furrowmap')}"
    header.creation_date = dt.datetime.now(dt.UTC).date()
    extra_bytes = header.point_format.num_extra_bytes
    laz = lazrs.LazVlr.new_for_compression(header.point_format.id, extra_bytes, use_variable_size_chunks=True)
    header.vlrs = [
        laspy.VLR("copc", 1, "COPC info VLR", bytes(INFO.size)),
        LasZipVlr(laz.record_data()),
        WktCoordinateSystemVlr(kind.crs_wkt),
    ]
    header.are_points_compressed = True
    header.number_of_evlrs = 1
    return header


def describe(header: laspy.LasHeader, text: str) -> None:
    """Add a "Text Area Description" (LAS 1.4 R15) to a header, as much as a record holds."""
    fitting = text.encode("utf-8", "backslashreplace")[:MAX_VLR_BYTES].decode("utf-8", "ignore")
    header.vlrs.append(laspy.VLR("LASF_Spec", 3, "text area description", fitting.encode()))


class _DiskFile(io.FileIO):
    """A file that keeps the system's error on writing, which lazrs does not pass on."""

    refusal: OSError | None = None

    def write(self, data: Any, /) -> int:
        """See :class:`io.FileIO`."""
        try:
            return super().write(data)
        except OSError as error:
            self.refusal = error
            raise


class CopcFile:
    """Compresses nodes, in any order, and writes them to a file.

    `written` receives the number of points so far; `complete` completes the points of a node in place, in several
    threads at once.
    """

    def __init__(
        self,
        path: Path,
        header: laspy.LasHeader,
        written: Callable[[int], None],
        complete: Callable[[ChunkColumns], None] | None = None,
    ) -> None:
        self._header = header
        self._written = written
        self._complete = complete
        self._disk = _DiskFile(path, "w+")
        self._stream = io.BufferedRandom(self._disk)
        header.write_to(self._stream)
        self._stream.write(bytes(TABLE_OFFSET.size))
        self._threads = ThreadPoolExecutor(threads(), "compress", initializer=give_way)
        self._coming: deque[Future[Chunk]] = deque()
        self._keys: list[Key] = []
        self._chunks: list[tuple[int, int]] = []
        self._done = 0
        self.points_by_class = np.zeros(256, np.int64)
        """Points of each class so far."""

    def close(self) -> None:
        """Close the file, finished or not."""
        self._threads.shutdown(cancel_futures=True)
        self._stream.close()

    def put(self, key: Key, parts: Sequence[Chosen]) -> Future[Chunk]:
        """Add a node; a thread reads and compresses its records until the returned future is done."""
        self._keys.append(key)
        chunk = self._threads.submit(_compress_node, parts, self._complete, self._header.point_format.id == COLOURED)
        self._coming.append(chunk)
        while self._coming and (len(self._coming) > MAX_COMING or self._coming[0].done()):
            self._write_next()
        return chunk

    def finish(self, extent: Extent, cube: Cube, spacing_m: float) -> tuple[int, NDArray[np.int64]]:
        """Write the remaining nodes, the hierarchy and the final header; number of nodes, and points of each level."""
        while self._coming:
            self._write_next()
        table = self._stream.tell()
        try:
            lazrs.write_chunk_table(self._stream, self._chunks, lazrs.LazVlr(self._header.vlrs[1].record_data))
        except (lazrs.LazrsError, OSError) as error:
            raise self._disk.refusal or error from error
        start = self._stream.seek(0, io.SEEK_END)
        self._stream.seek(self._header.offset_to_point_data)
        self._stream.write(TABLE_OFFSET.pack(table))
        self._stream.seek(start)
        # One page with all nodes in the order of their chunks; a file without points has an empty root.
        points, lengths = np.array(self._chunks or [(0, 0)], np.int64).T
        hierarchy = np.zeros(len(points), ENTRY)
        if self._keys:
            hierarchy["key"] = self._keys
            hierarchy["points"] = points
            hierarchy["bytes"] = lengths
            first = self._header.offset_to_point_data + TABLE_OFFSET.size
            hierarchy["offset"] = first + np.cumsum(lengths) - lengths
        record = laspy.VLR("copc", 1000, "EPT Hierarchy", hierarchy.tobytes())
        VLRList([record]).write_to(self._stream, as_extended=True)
        offset = self._stream.tell() - hierarchy.nbytes

        header = self._header
        scale_m = float(self._header.scales[0])
        header.start_of_first_evlr = start
        header.point_count = extent.points
        header.number_of_points_by_return = extent.by_return.astype(np.uint64)
        header.mins = extent.low * header.scales + header.offsets
        header.maxs = extent.high * header.scales + header.offsets
        # Cells extend half a step beyond their points, so that no point lies on a border.
        centre = (np.array(cube.origin) + 0.5 * (cube.side - 1)) * header.scales + header.offsets
        info = INFO.pack(
            *centre, 0.5 * cube.side * scale_m, spacing_m, offset, hierarchy.nbytes, extent.first_time, extent.last_time
        )
        header.vlrs[0] = laspy.VLR("copc", 1, "COPC info VLR", info)
        for record in header.vlrs.get("ExtraBytesVlr"):
            for dimension in record.extra_bytes_structs:
                ends = extent.extra.get(dimension.format_name())
                if ends is not None:
                    dimension.grow({dimension.format_name(): np.array(ends, dimension.dtype())[:, None]})
                else:  # no value
                    dimension.options &= ~(dimension.MIN_BIT_MASK | dimension.MAX_BIT_MASK)
                    dimension._min = dimension._max = type(dimension._min)()
        self._stream.seek(0)
        header.write_to(self._stream, ensure_same_size=True)
        self._stream.flush()
        levels = [key.level for key in self._keys]
        return len(levels), np.bincount(levels, points[: len(levels)]).astype(np.int64)

    def _write_next(self) -> None:
        """Write the oldest chunk, once it is compressed."""
        data, points, points_by_class = self._coming.popleft().result()
        self._stream.write(data)
        self._chunks.append((points, len(data)))
        self.points_by_class += points_by_class
        self._done += points
        self._written(self._done)


def _compress_node(parts: Sequence[Chosen], complete: Callable[[ChunkColumns], None] | None, coloured: bool) -> Chunk:
    """Complete and compress the points of a node."""
    columns = select_columns(parts, coloured=coloured)
    if complete is not None:
        complete(columns)
    return compress_points(columns), len(columns), np.bincount(columns.classification, minlength=256)
