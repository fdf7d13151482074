"""Compressed points: checks of a LAZ file before it is passed to the decoder, and the decoding.

The decoder (lazrs) trusts what it reads: a chunk table of 2³² entries makes it ask for 68 GB, which ends the process,
and there is no checksum. So everything that the decoder would use as a size is compared with the file first: the items
of a point, the number of chunks, the bytes of each, and the lengths of the layers inside (Isenburg 2013, *LASzip:
lossless compression of LiDAR data*; LAZ specification 1.4 R1, sections 2 to 4).
"""

from __future__ import annotations

import struct
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO, Final

import lazrs
import numpy as np
from numpy.typing import NDArray

from furrowmap.core.readers.las.header import LasHeader
from furrowmap.core.readers.las.records import Record
from furrowmap.core.values.errors import InputError

USER: Final = "laszip encoded"
NUMBER: Final = 22204
POINTWISE, LAYERED = 2, 3
"""Compressors with chunks that can be decoded independently."""
VARIABLE: Final = 0xFFFF_FFFF
"""Chunk size that stands for variable sizes, which are in the chunk table."""
MOST_CHUNKS: Final = 1 << 24
LARGEST_CHUNK_BYTES: Final = 1 << 27
"""Largest decompressed chunk that is decoded in one call, in parallel with others; larger ones are streamed."""

_RECORD: Final = struct.Struct("<HHBBHIIqqH")
_ITEMS: Final = {
    0: (6,), 1: (6, 7), 2: (6, 8), 3: (6, 7, 8), 4: (6, 7, 9), 5: (6, 7, 8, 9),
    6: (10,), 7: (10, 11), 8: (10, 12), 9: (10, 13), 10: (10, 12, 13),
}  # fmt: skip
"""Items by point format, without extra bytes."""
_ITEM_BYTES: Final = {6: 20, 7: 8, 8: 6, 9: 29, 10: 30, 11: 6, 12: 8, 13: 29}
_LAYERS: Final = {10: 9, 11: 1, 12: 2, 13: 1}
"""Layers of the items of layered chunks; extra bytes have one layer per byte."""
_EXTRA: Final = {0, 14}
_AGAIN: Final = "Copy or download the file again, or write it again with the program that made it."


@dataclass(frozen=True)
class LazPoints:
    """The compressed points of a file, checked.

    Attributes:
        vlr: the LASzip record for the decoder.
        points: (n,) number of points of each chunk.
        begins: (n,) byte offset of each chunk.
        sizes: (n,) bytes of each chunk.
        layers: number of layers of a chunk; 0 for pointwise compression.
        record_bytes: bytes of a decompressed point.
    """

    vlr: bytes
    points: NDArray[np.int64]
    begins: NDArray[np.int64]
    sizes: NDArray[np.int64]
    layers: int
    record_bytes: int

    @property
    def wholesale(self) -> bool:
        """Whether each chunk is small enough to be decoded in one call."""
        return not len(self.points) or int(self.points.max()) * self.record_bytes <= LARGEST_CHUNK_BYTES


def find_points(path: Path, file: BinaryIO, header: LasHeader, records: Sequence[Record]) -> LazPoints:
    """Check the compressed points of a file.

    Raises:
        InputError: if they cannot be found or decoded.
    """
    stated = next((record for record in records if (record.user, record.number) == (USER, NUMBER)), None)
    if stated is None or len(stated.data) < _RECORD.size:
        raise _refusal(path, "the LASzip record, which describes the compression, is missing", "laz-record")
    compressor, _, _, _, _, _, chunk_points, _, _, items = _RECORD.unpack_from(stated.data)
    if compressor not in (POINTWISE, LAYERED):
        raise InputError(
            f"{path}: unsupported compression method {compressor} (supported: {POINTWISE} and {LAYERED}).",
            "That is the method of LASzip before 2011, without chunks."
            if compressor == 1
            else "The method is unknown: the LASzip record is damaged, or newer than this program.",
            "Decompress the file with LASzip: `laszip -i in.laz -o out.las`.",
            code="laz-compressor",
        )
    layers = _check_items(path, header, stated.data, items, layered=compressor == LAYERED)
    if header.points == 0:
        none = np.zeros(0, np.int64)
        return LazPoints(stated.data, none, none, none, layers, header.record_bytes)
    table = _chunk_table(path, file, header, stated.data, chunk_points)
    sizes = np.array([size for _, size in table], np.int64)
    points = np.array([number for number, _ in table], np.int64)
    if chunk_points != VARIABLE:
        points[:] = chunk_points
        points[-1] = header.points - (len(points) - 1) * chunk_points
    begins = header.offset + 8 + np.cumsum(sizes) - sizes
    return LazPoints(stated.data, points, begins, sizes, layers, header.record_bytes)


def _check_items(path: Path, header: LasHeader, data: bytes, items: int, *, layered: bool) -> int:
    """Number of layers of a chunk.

    Raises:
        InputError: if the items do not match the point format of the header.
    """
    if items > 8 or len(data) < _RECORD.size + 6 * items:
        raise _refusal(path, f"its LASzip record states {items:,} items in {len(data)} bytes", "laz-items")
    listed_items = [struct.unpack_from("<3H", data, _RECORD.size + 6 * number) for number in range(items)]
    kinds = tuple(kind for kind, _, _ in listed_items if kind not in _EXTRA)
    sizes = sum(size for _, size, _ in listed_items)
    fits = kinds == _ITEMS[header.point_format] and all(
        _ITEM_BYTES.get(kind, size) == size for kind, size, _ in listed_items
    )
    new = layered == (header.point_format >= 6) and all((version >= 3) <= layered for _, _, version in listed_items)
    if not fits or not new or sizes != header.record_bytes:
        listed = ", ".join(f"{kind} of {size} bytes (version {version})" for kind, size, version in listed_items)
        raise _refusal(
            path,
            f"the items of its LASzip record ({listed}) do not match point format {header.point_format} with "
            f"{header.record_bytes} bytes",
            "laz-items",
        )
    return sum(_LAYERS.get(kind, size) for kind, size, _ in listed_items) if layered else 0


def _chunk_table(path: Path, file: BinaryIO, header: LasHeader, vlr: bytes, chunk_points: int) -> list[tuple[int, int]]:
    """Points and bytes of each chunk.

    Raises:
        InputError: if the table is invalid.
    """
    start = header.offset + 8
    file.seek(header.offset)
    at = _signed(file.read(8))
    if at == -1:  # written to a stream: the offset of the table is at the end of the file
        file.seek(max(0, header.size_bytes - 8))
        at = _signed(file.read(8))
    if not start < at <= header.size_bytes - 8:
        raise _refusal(
            path,
            f"the chunk table is at byte {at:,}, but the file has {header.size_bytes:,} bytes: it was truncated, or "
            "writing was interrupted",
            "laz-chunk-table",
        )
    file.seek(at)
    _, count = struct.unpack("<2I", file.read(8))
    room = at - start
    if chunk_points == 0:
        raise _refusal(path, "its LASzip record states chunks of 0 points", "laz-chunk-size")
    # Each chunk begins with an uncompressed point.
    most = min(room // header.record_bytes, header.points, MOST_CHUNKS)
    expected = -(-header.points // chunk_points)
    if not 0 < count <= most or (chunk_points != VARIABLE and count != expected):
        of_points = f" of {chunk_points:,} points" if chunk_points != VARIABLE else ""
        counts = f"{header.points:,} points in the header, {count:,} chunks{of_points} in the chunk table"
        raise _refusal(path, f"{counts}, {room:,} bytes of chunks: these do not match", "laz-chunk-count")
    # With a record that has only the version of the method, the decoder neither seeks nor allocates more than `count`
    # entries.
    file.seek(at)
    with decoding(path, "the chunk table"):
        table: list[tuple[int, int]] = lazrs.read_chunk_table_only(file, lazrs.LazVlr(vlr))
    least = min(size for _, size in table)
    sizes = sum(size for _, size in table)
    points = sum(number for number, _ in table)
    fewest = min(number for number, _ in table)
    if least < header.record_bytes or sizes != room or len(table) != count:
        raise _refusal(
            path, f"the chunk table states {sizes:,} bytes of chunks, but there are {room:,}", "laz-chunk-table"
        )
    if chunk_points == VARIABLE and (points != header.points or fewest <= 0):
        raise _refusal(
            path,
            f"the chunk table states {points:,} points, the header {header.points:,}",
            "laz-chunk-table",
        )
    return table


def decode_chunks(path: Path, file: BinaryIO, laz: LazPoints, first: int, last: int) -> NDArray[np.uint8]:
    """The records (n × bytes of one, flat) of the consecutive chunks `first` to `last` − 1, decoded in parallel.

    Raises:
        InputError: if a chunk is found to be damaged.
    """
    begin, end = int(laz.begins[first]), int(laz.begins[last - 1] + laz.sizes[last - 1])
    file.seek(begin)
    data = file.read(end - begin)
    if len(data) != end - begin:
        raise _refusal(
            path, f"the file ends at byte {begin + len(data):,}, within chunk {first + 1}", "laz-chunk-damaged"
        )
    if laz.layers:
        whole = memoryview(data)
        for number in range(first, last):
            _check_layers(path, laz, number, whole[int(laz.begins[number]) - begin :])
    records = np.empty(int(laz.points[first:last].sum()) * laz.record_bytes, np.uint8)
    table = list(zip(laz.points[first:last].tolist(), laz.sizes[first:last].tolist(), strict=True))
    with decoding(path, f"chunks {first + 1} to {last} (bytes {begin:,} to {end:,})"):
        lazrs.decompress_points_with_chunk_table(data, laz.vlr, records, table)
    return records


def stream_points(
    path: Path, file: BinaryIO, header: LasHeader, laz: LazPoints, points: int, batch_points: int
) -> Iterator[NDArray[np.uint8]]:
    """The records of the first `points`, decoded in sequence, `batch_points` at a time.

    Raises:
        InputError: if a chunk is found to be damaged.
    """
    if laz.layers:
        for number in range(int(np.searchsorted(np.cumsum(laz.points), points)) + 1):
            file.seek(int(laz.begins[number]))
            _check_layers(path, laz, number, file.read(laz.record_bytes + 4 + 4 * laz.layers))
    file.seek(header.offset)
    with decoding(path, "the first chunk"):
        decoder = lazrs.LasZipDecompressor(file, laz.vlr)
    done = 0
    while done < points:
        count = min(batch_points, points - done)
        records = np.empty(count * laz.record_bytes, np.uint8)
        with decoding(path, f"points {done + 1:,} to {done + count:,}"):
            decoder.decompress_many(records)
        done += count
        yield records


def _check_layers(path: Path, laz: LazPoints, number: int, data: bytes | memoryview) -> None:
    """Check a layered chunk: its first point, the number of its points, the lengths of its layers, and the layers.

    Raises:
        InputError: if they do not add up to the chunk's length.
    """
    points, size = int(laz.points[number]), int(laz.sizes[number])
    lengths = laz.record_bytes + 4 + 4 * laz.layers
    if size < lengths or len(data) < lengths:
        raise _refusal(path, f"chunk {number + 1} has {size} bytes, too few for its layers", "laz-chunk-damaged")
    counted, *layers = struct.unpack_from(f"<{1 + laz.layers}I", data, laz.record_bytes)
    if counted != points or lengths + sum(layers) != size:
        raise _refusal(
            path,
            f"chunk {number + 1} (byte {int(laz.begins[number]):,}) states {counted:,} points in "
            f"{lengths + sum(layers):,} bytes, the chunk table {points:,} in {size:,}",
            "laz-chunk-damaged",
        )


@contextmanager
def decoding(path: Path, what: str) -> Iterator[None]:
    """Turns the decoder's errors, including panics, into `InputError`."""
    try:
        yield
    except (KeyboardInterrupt, SystemExit, GeneratorExit, MemoryError, InputError):
        raise
    except BaseException as error:
        # A Rust panic derives from BaseException, not Exception, and its class cannot be imported.
        if not isinstance(error, Exception) and type(error).__name__ != "PanicException":
            raise
        reason = str(error).splitlines()[0][:120] if str(error) else type(error).__name__
        raise _refusal(path, f"{what} cannot be decoded ({reason})", "laz-chunk-damaged") from error


def _signed(data: bytes) -> int:
    return struct.unpack("<q", data)[0] if len(data) == 8 else 0


def _refusal(path: Path, what: str, code: str) -> InputError:
    return InputError(
        f"{path}: {what}.",
        "Compressed points cannot be decoded after damage, so none of them is used.",
        _AGAIN,
        code=code,
    )
