"""The file itself: LAS 1.4 header and records, compressed nodes, hierarchy."""

from __future__ import annotations

import datetime as dt
import io
import struct
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from importlib.metadata import version
from pathlib import Path
from typing import Any, Final

import laspy
import lazrs
import numpy as np
from laspy.vlrs.known import LasZipVlr, WktCoordinateSystemVlr
from laspy.vlrs.vlrlist import VLRList
from numpy.typing import NDArray

from furrowmap.exporters.copc.cube import Cube
from furrowmap.exporters.copc.octree import Key
from furrowmap.exporters.copc.points import Extent, Records

BATCH_POINTS: Final = 2_000_000
"""Points that wait until they are compressed together, on all cores."""
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
) -> laspy.LasHeader:
    """A header of point format 6, or 7 with colour, that says all but what the points will be.

    The info record stands first, as COPC wants it. The CRS stands in an ordinary record at the head: QGIS does not
    look for it in extended records at the end.
    """
    header = laspy.LasHeader(version="1.4", point_format=7 if colour else 6)
    header.add_extra_dims([laspy.ExtraBytesParams(name, dtype, description) for name, dtype, description in extra])
    header.scales, header.offsets = np.full(3, scale_m), np.array(origin_m)
    header.global_encoding.wkt = True
    header.global_encoding.gps_time_type = laspy.header.GpsTimeType.STANDARD
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
        complete: fills in what was not known when the points came, in place; called from two threads at once.
    """

    def __init__(
        self,
        path: Path,
        header: laspy.LasHeader,
        written: Callable[[int], None],
        complete: Callable[[Records], None] | None = None,
    ) -> None:
        self._header, self._written, self._complete = header, written, complete
        self._disk = DiskFile(path, "w+")
        self._stream = io.BufferedRandom(self._disk)
        header.write_to(self._stream)
        self._laz = lazrs.LazVlr(header.vlrs[1].record_data)
        self._compressor = lazrs.ParLasZipCompressor(self._stream, self._laz)
        self._compressor.reserve_offset_to_chunk_table()
        self._keys: list[Key] = []
        self._points: list[int] = []
        self._batch: Records = np.empty(BATCH_POINTS, header.point_format.dtype())
        self._chunks: list[NDArray[np.uint8]] = []
        self._threads = ThreadPoolExecutor(2, "complete")
        self._waiting = 0
        self._done = 0
        self.points_by_class = np.zeros(256, np.int64)
        """Points of each class so far."""

    def close(self) -> None:
        """Close the file, finished or not."""
        self._threads.shutdown()
        self._stream.close()

    def room(self, key: Key, points: int) -> Records:
        """Where the records of a node are to be put, before the next call."""
        if self._waiting + points > len(self._batch):
            self._compress()
        if points > len(self._batch):
            self._batch = np.empty(points, self._batch.dtype)
        room = self._batch[self._waiting : self._waiting + points]
        self._waiting += points
        self._chunks.append(room.view(np.uint8))
        self._keys.append(key)
        self._points.append(points)
        return room

    def finish(self, extent: Extent, cube: Cube, spacing_m: float) -> None:
        """Write what is left, the hierarchy, and a header that is true."""
        self._compress()
        with self._refusals():
            self._compressor.done()
        hierarchy = self._hierarchy()
        start = self._stream.seek(0, io.SEEK_END)
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
        levels = [key.level for key in self._keys]
        return np.bincount(levels, weights=self._points).astype(np.int64)

    def _compress(self) -> None:
        if self._chunks:
            if self._complete is not None:
                half = self._waiting // 2
                parts = self._batch[:half], self._batch[half : self._waiting]
                for _ in self._threads.map(self._complete, [part for part in parts if len(part)]):
                    pass
            self.points_by_class += np.bincount(self._batch["classification"][: self._waiting], minlength=256)
            with self._refusals():
                self._compressor.compress_chunks(self._chunks)
            self._chunks.clear()
            self._done, self._waiting = self._done + self._waiting, 0
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
        self._stream.seek(self._header.offset_to_point_data)
        chunks = np.array(lazrs.read_chunk_table(self._stream, self._laz), np.int64).reshape(-1, 2)
        ends = self._header.offset_to_point_data + 8 + np.cumsum(chunks[:, 1])
        entries = np.zeros(len(self._keys), ENTRY)
        entries["key"] = self._keys
        entries["offset"] = ends - chunks[:, 1]
        entries["bytes"] = chunks[:, 1]
        entries["points"] = chunks[:, 0]
        return entries
