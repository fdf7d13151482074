"""Compressed points: checks of a LAZ file before it is passed to the decoder, and the decoding.

The decoder (lazrs) trusts what it reads: a chunk table of 2³² entries makes it ask for 68 GB, damaged GPS times
overflow its stack, both of which end a process, and there is no checksum. So it runs in a process of its own, and all
that it would use as a size is compared with the file first: the items of a point, the number of chunks, the bytes of
each, and the lengths of the layers inside (Isenburg 2013, *LASzip: lossless compression of LiDAR data*; LAZ
specification 1.4 R1, sections 2 to 4).
"""

import struct
from collections.abc import Generator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO, Final

import lazrs
import numpy as np
from numpy.typing import NDArray

from furrowmap.core.readers.las.header import LasHeader, LasRecord
from furrowmap.core.readers.las.las_decoder import DECODER, Decoder, Undecodable
from furrowmap.core.runtime.errors import InputError, Notice
from furrowmap.core.runtime.file_names import resolved
from furrowmap.core.runtime.languages.texts import Text, Words
from furrowmap.core.runtime.memory import expect_growth
from furrowmap.core.runtime.settings import allows

LAZ_USER_ID: Final = "laszip encoded"
LAZ_RECORD_ID: Final = 22204
POINTWISE: Final = 2
LAYERED: Final = 3
"""Compressors with chunks that can be decoded independently."""
VARIABLE_CHUNKS: Final = 0xFFFF_FFFF
"""Chunk size that stands for variable sizes, which are in the chunk table."""
MAX_CHUNKS: Final = 1 << 24
LARGEST_CHUNK_BYTES: Final = 1 << 27
"""Largest decompressed chunk that is decoded in one call, in parallel with others; larger ones are streamed."""

_LAZ_RECORD: Final = struct.Struct("<HHBBHIIqqH")
_ITEMS: Final = {
    0: (6,), 1: (6, 7), 2: (6, 8), 3: (6, 7, 8), 4: (6, 7, 9), 5: (6, 7, 8, 9),
    6: (10,), 7: (10, 11), 8: (10, 12), 9: (10, 13), 10: (10, 12, 13),
}  # fmt: skip
"""Items by point format, without extra bytes."""
_ITEM_BYTES: Final = {6: 20, 7: 8, 8: 6, 9: 29, 10: 30, 11: 6, 12: 8, 13: 29}
_ITEM_LAYERS: Final = {10: 9, 11: 1, 12: 2, 13: 1}
"""Layers of the items of layered chunks; extra bytes have one layer per byte."""
_EXTRA_ITEMS: Final = {0, 14}


@dataclass(frozen=True)
class LazPoints:
    """The compressed points of a file, checked.

    Attributes:
        begins: (n,) byte offset of each chunk.
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


def find_points(path: Path, file: BinaryIO, header: LasHeader, records: Sequence[LasRecord]) -> LazPoints:
    """Check the compressed points of a file; InputError if they cannot be decoded, RefusedError if implausibly many."""
    stated = next((record for record in records if (record.user, record.number) == (LAZ_USER_ID, LAZ_RECORD_ID)), None)
    if stated is None or len(stated.data) < _LAZ_RECORD.size:
        raise _damaged(path, Text("the LASzip record, which describes the compression, is missing"))
    compressor, _, _, _, _, _, chunk_points, _, _, items = _LAZ_RECORD.unpack_from(stated.data)
    if compressor not in (POINTWISE, LAYERED):
        raise InputError(
            "laz-compressor",
            path=path,
            compressor=compressor,
            pointwise=POINTWISE,
            layered=LAYERED,
            single=compressor == 1,
        )
    layers = _check_items(path, header, stated.data, items, layered=compressor == LAYERED)
    if header.points == 0:
        none = np.zeros(0, np.int64)
        return LazPoints(stated.data, none, none, none, layers, header.record_bytes)
    table = _chunk_table(path, file, header, stated.data, chunk_points)
    expect_growth(path, header.size_bytes, header.points * header.record_bytes)
    sizes = np.array([size for _, size in table], np.int64)
    points = np.array([number for number, _ in table], np.int64)
    if chunk_points != VARIABLE_CHUNKS:
        points[:] = chunk_points
        points[-1] = header.points - (len(points) - 1) * chunk_points
    begins = header.offset + 8 + np.cumsum(sizes) - sizes
    return LazPoints(stated.data, points, begins, sizes, layers, header.record_bytes)


def _damaged(path: Path, fault: Text, *, can_be_left_out: bool = False) -> InputError:
    return InputError("laz-damaged", path=path, fault=fault, can_be_left_out=can_be_left_out)


def _undecodable(path: Path, where: Words, error: Undecodable) -> InputError:
    fault = Text("{where} cannot be decoded: {reason}", where=where, reason=_short(error))
    return _damaged(path, fault, can_be_left_out=True)


def _check_items(path: Path, header: LasHeader, data: bytes, items: int, *, layered: bool) -> int:
    """Number of layers of a chunk."""
    if items > 8 or len(data) < _LAZ_RECORD.size + 6 * items:
        fault = Text(
            "its LASzip record states {items:,} items in {size_bytes} bytes", items=items, size_bytes=len(data)
        )
        raise _damaged(path, fault)
    listed_items = [struct.unpack_from("<3H", data, _LAZ_RECORD.size + 6 * number) for number in range(items)]
    kinds = tuple(kind for kind, _, _ in listed_items if kind not in _EXTRA_ITEMS)
    sizes = sum(size for _, size, _ in listed_items)
    fits = kinds == _ITEMS[header.point_format] and all(
        _ITEM_BYTES.get(kind, size) == size for kind, size, _ in listed_items
    )
    new = layered == (header.point_format >= 6) and all((version >= 3) <= layered for _, _, version in listed_items)
    if not fits or not new or sizes != header.record_bytes:
        listed = ", ".join(f"{kind} of {size} bytes (version {version})" for kind, size, version in listed_items)
        fault = Text(
            "the items of its LASzip record ({listed}) do not match point format {point_format} with "
            "{record_bytes} bytes",
            listed=listed,
            point_format=header.point_format,
            record_bytes=header.record_bytes,
        )
        raise _damaged(path, fault)
    return sum(_ITEM_LAYERS.get(kind, size) for kind, size, _ in listed_items) if layered else 0


def _chunk_table(path: Path, file: BinaryIO, header: LasHeader, vlr: bytes, chunk_points: int) -> list[tuple[int, int]]:
    """Points and bytes of each chunk."""
    start = header.offset + 8
    file.seek(header.offset)
    at = _signed(file.read(8))
    if at == -1:  # written to a stream: the offset of the table is at the end of the file
        file.seek(max(0, header.size_bytes - 8))
        at = _signed(file.read(8))
    if not start < at <= header.size_bytes - 8:
        fault = Text(
            "the chunk table is at byte {at:,}, but the file has {size_bytes:,} bytes: it was truncated, or writing "
            "was interrupted",
            at=at,
            size_bytes=header.size_bytes,
        )
        raise _damaged(path, fault)
    file.seek(at)
    _, count = struct.unpack("<2I", file.read(8))
    room = at - start
    if chunk_points == 0:
        raise _damaged(path, Text("its LASzip record states chunks of 0 points"))
    # Each chunk begins with an uncompressed point.
    most = min(room // header.record_bytes, header.points, MAX_CHUNKS)
    expected = -(-header.points // chunk_points)
    if not 0 < count <= most or (chunk_points != VARIABLE_CHUNKS and count != expected):
        fault = Text(
            "{points:,} points in the header, {count:,} chunks{chunk_points: of {chunk_points:,} points|} in the chunk "
            "table, {room:,} bytes of chunks: these do not match",
            points=header.points,
            count=count,
            chunk_points=chunk_points if chunk_points != VARIABLE_CHUNKS else None,
            room=room,
        )
        raise _damaged(path, fault)
    # With a record that has only the version of the method, the decoder neither seeks nor allocates more than `count`
    # entries.
    file.seek(at)
    try:
        table: list[tuple[int, int]] = lazrs.read_chunk_table_only(file, lazrs.LazVlr(vlr))
    except BaseException as error:
        # A Rust panic derives from BaseException, not Exception, and its class cannot be imported.
        if not isinstance(error, Exception) and type(error).__name__ != "PanicException":
            raise
        fault = Text("the chunk table cannot be decoded ({reason})", reason=_short(error))
        raise _damaged(path, fault, can_be_left_out=True) from None
    least = min(size for _, size in table)
    sizes = sum(size for _, size in table)
    points = sum(number for number, _ in table)
    fewest = min(number for number, _ in table)
    if least < header.record_bytes or sizes != room or len(table) != count:
        fault = Text("the chunk table states {sizes:,} bytes of chunks, but there are {room:,}", sizes=sizes, room=room)
        raise _damaged(path, fault)
    if chunk_points == VARIABLE_CHUNKS and (points != header.points or fewest <= 0):
        fault = Text(
            "the chunk table states {points:,} points, the header {header_points:,}",
            points=points,
            header_points=header.points,
        )
        raise _damaged(path, fault)
    return table


def decode_chunks(
    path: Path, file: BinaryIO, laz: LazPoints, first: int, last: int
) -> tuple[list[NDArray[np.uint8]], list[Notice]]:
    """The records (n × bytes of one, flat) of the consecutive chunks `first` to `last` − 1, decoded in parallel.

    Damage within a chunk cannot be located, because it has no checksum: if the user allows damaged files, it is left
    out as a whole, with a notice, and the other chunks are decoded. InputError if a chunk is found to be damaged, and
    the user does not allow that.
    """
    lost: list[Notice] = []
    try:
        whole = [_decode(path, file, laz, first, last)]
    except Undecodable:
        whole = []
        before = np.cumsum(laz.points) - laz.points
        for number in range(first, last):
            try:
                whole.append(_decode(path, file, laz, number, number + 1))
            except Undecodable as fault:
                begin = int(laz.begins[number])
                size = int(laz.sizes[number])
                where = Text(
                    "chunk {number} of {chunks:,} (bytes {begin:,} to {end:,})",
                    number=number + 1,
                    chunks=len(laz.points),
                    begin=begin,
                    end=begin + size,
                )
                if not allows("damaged"):
                    raise _undecodable(path, where, fault) from None
                what = Text(
                    "{where} cannot be decoded ({why}): points {first:,} to {last:,}",
                    where=where,
                    why=_short(fault),
                    first=before[number] + 1,
                    last=before[number] + laz.points[number],
                )
                lost.append(Notice("laz-damage-left-out", path=path.name, what=what))
    return whole, lost


def _decode(path: Path, file: BinaryIO, laz: LazPoints, first: int, last: int) -> NDArray[np.uint8]:
    """The records of consecutive chunks."""
    _check_layers(file, laz, first, last)
    begin = int(laz.begins[first])
    end = int(laz.begins[last - 1] + laz.sizes[last - 1])
    size = int(laz.points[first:last].sum()) * laz.record_bytes
    table = list(zip(laz.points[first:last].tolist(), laz.sizes[first:last].tolist(), strict=True))
    order = {"path": str(resolved(path)), "begin": begin, "bytes": end - begin, "table": table, "vlr": laz.vlr.hex()}
    return DECODER.points(size, what="chunks", **order)


def stream_points(
    path: Path,
    file: BinaryIO,
    header: LasHeader,
    laz: LazPoints,
    points: int,
    batch_points: int,
    decoder: Decoder,
) -> Generator[NDArray[np.uint8], None, list[Notice]]:
    """The records of the first `points`, decoded in sequence, `batch_points` at a time; returns notices of damage.

    If the user allows damaged files, the records end where damage is found. InputError if a chunk is found to be
    damaged, and the user does not allow that.
    """
    order = {"what": "stream", "path": str(resolved(path)), "offset": header.offset, "vlr": laz.vlr.hex()}
    done = 0
    try:
        _check_layers(file, laz, 0, int(np.searchsorted(np.cumsum(laz.points), points)) + 1)
        while done < points:
            count = min(batch_points, points - done)
            yield decoder.points(count * laz.record_bytes, **(order if done == 0 else {"what": "more"}))
            done += count
    except Undecodable as fault:
        where = f"points {done + 1:,} to {min(done + batch_points, points):,}"
        if not allows("damaged"):
            raise _undecodable(path, where, fault) from None
        what = f"{where} cannot be decoded: {_short(fault)}; points {done + 1:,} to {points:,}"
        return [Notice("laz-damage-left-out", path=path.name, what=what)]
    return []


def _check_layers(file: BinaryIO, laz: LazPoints, first: int, last: int) -> None:
    """Check the heads of layered chunks: the first point, the number of points, the lengths of the layers."""
    if not laz.layers:
        return
    lengths = laz.record_bytes + 4 + 4 * laz.layers
    for number in range(first, last):
        points = int(laz.points[number])
        size = int(laz.sizes[number])
        begin = int(laz.begins[number])
        file.seek(begin)
        data = file.read(lengths)
        if size < lengths or len(data) < lengths:
            raise Undecodable(
                Text(
                    "chunk {number} has {size} bytes, too few for its layers",
                    number=number + 1,
                    size=min(size, len(data)),
                )
            )
        counted, *layers = struct.unpack_from(f"<{1 + laz.layers}I", data, laz.record_bytes)
        if counted != points or lengths + sum(layers) != size:
            raise Undecodable(
                Text(
                    "chunk {number} states {counted:,} points in {lengths:,} bytes, the chunk table "
                    "{points:,} in {size:,}",
                    number=number + 1,
                    counted=counted,
                    lengths=lengths + sum(layers),
                    points=points,
                    size=size,
                )
            )


def _short(error: BaseException) -> str:
    reason = str(error)
    return reason.splitlines()[0][:120] if reason.strip() else "no reason is given"


def _signed(data: bytes) -> int:
    return struct.unpack("<q", data)[0] if len(data) == 8 else 0
