"""Files of Ouster's SDK (OSF): range images of the turns, with the metadata of the sensors.

A file is a header, chunks of messages, and metadata at the end, all of them FlatBuffers with their length before and a
CRC-32 behind them (Ouster SDK, ouster_osf/fb). A turn is a message of compressed images, one a field. They are made
into data packets again, so that times, gaps and angles are those of captures.
"""

import json
import struct
import sys
import warnings
from collections import Counter
from collections.abc import Generator, Iterator, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, BinaryIO, ClassVar, Final, NamedTuple
from zlib import crc32

import numpy as np
from numpy.typing import NDArray

from furrowmap.core.readers.ouster.captures import OusterReader, OusterSensor, PacketSender, chosen_by_source
from furrowmap.core.readers.ouster.metadata import STAMP, Metadata, settle
from furrowmap.core.readers.ouster.packets import ByteArray, OusterDecoder
from furrowmap.core.readers.reader import ReadOptions
from furrowmap.core.readers.source import Head
from furrowmap.core.runtime.arrays import FloatArray, IntArray
from furrowmap.core.runtime.errors import InputError, Notice
from furrowmap.core.runtime.languages.texts import Text, Words
from furrowmap.core.runtime.memory import expect_growth

if sys.version_info >= (3, 14):
    from compression import zstd
else:
    from backports import zstd

_HEADER_MARK: Final = b"OSF$"
_CHUNK_MARK: Final = b"OSF!"
_METADATA_MARK: Final = b"OSF#"
"""Identifiers of the parts."""
_SENSOR_ENTRY: Final = "ouster/v1/os_sensor/LidarSensor"
_SCAN_STREAM: Final = "ouster/v1/os_sensor/LidarScanStream"
_RANGES: Final = (1, 2)
_BRIGHTS: Final = (5, 6)
"""Numbers of the fields RANGE, RANGE2, REFLECTIVITY and REFLECTIVITY2."""
_PNG: Final = b"\x89PNG"
_ZPNG: Final = b"\xf8\xfb"
_ZPNG_HEADER: Final = struct.Struct("<2sHHBB")
_MAX_PART_BYTES: Final = 1 << 28
_MAX_SHARED: Final = 4
"""Bytes of vectors that are read from a buffer, for each of its own."""
_MAX_STREAMS: Final = 256
_FIRST_TURNS: Final = 3
"""Turns by which the clock is told."""
_MAX_RANGE_MM: Final = (1 << 19) - 1
_OSF_FAULTS: Final = (struct.error, ValueError, IndexError, UnicodeDecodeError, zstd.ZstdError)
"""What damaged content raises."""


class _Aliased(ValueError):
    """The vectors of a buffer refer to the same bytes again and again."""


class _FlatBuffer:
    """The bytes of a FlatBuffer, and how many bytes of vectors may still be taken from it.

    Offsets may refer to the same bytes any number of times. A writer shares a vector among a few tables at most, so
    that more bytes than `_MAX_SHARED` times those of the buffer are not what it wrote.
    """

    def __init__(self, data: bytes) -> None:
        self.data = data
        self._left = _MAX_SHARED * len(data)

    def take(self, size: int) -> None:
        """Count bytes that are taken; `_Aliased` if they are too many."""
        self._left -= size
        if self._left < 0:
            raise _Aliased("the same bytes are referred to many times")


class _FlatTable(NamedTuple):
    """A table of a FlatBuffer at an offset in it (FlatBuffers, "Internals"); fields count from 0."""

    buffer: _FlatBuffer
    at: int

    @classmethod
    def root(cls, data: bytes) -> "_FlatTable":
        """The root of a buffer with its length before it."""
        return cls(_FlatBuffer(data), 4 + struct.unpack_from("<I", data, 4)[0])

    @property
    def data(self) -> bytes:
        """The bytes of the buffer."""
        return self.buffer.data

    def _place(self, field: int) -> int:
        """Offset of a field; 0 if it is not there."""
        fields = self.at - struct.unpack_from("<i", self.data, self.at)[0]
        size = struct.unpack_from("<H", self.data, fields)[0]
        offset = struct.unpack_from("<H", self.data, fields + 4 + 2 * field)[0] if 6 + 2 * field <= size else 0
        return self.at + offset if offset else 0

    def number(self, field: int, form: str) -> int:
        """A number; 0 if it is not there."""
        place = self._place(field)
        return int(struct.unpack_from(f"<{form}", self.data, place)[0]) if place else 0

    def vector(self, field: int, form: str) -> NDArray[Any]:
        """(n,) numbers; empty if they are not there."""
        place = self._place(field)
        if not place:
            return np.empty(0, form)
        place += struct.unpack_from("<I", self.data, place)[0]
        found = np.frombuffer(self.data, form, struct.unpack_from("<I", self.data, place)[0], place + 4)
        self.buffer.take(found.nbytes)
        return found

    def text(self, field: int) -> str:
        """A string; empty if it is not there."""
        return self.vector(field, "u1").tobytes().decode()

    def tables(self, field: int) -> "list[_FlatTable]":
        """A vector of tables."""
        offsets = self.vector(field, "<u4")
        first = self._place(field)
        first += struct.unpack_from("<I", self.data, first)[0] + 4 if first else 0
        return [_FlatTable(self.buffer, first + 4 * k + offset) for k, offset in enumerate(offsets.tolist())]


@dataclass(frozen=True)
class _Stream:
    """The scans of one sensor in a file; rows of its PNG images are shifted against the beams' by columns (n,)."""

    number: int
    metadata: Metadata
    shifts: IntArray


class OusterOsf(OusterReader):
    """Scans in files of Ouster's SDK.

    `model` of the options chooses among several sensors by product line or serial number. InputError on opening, if a
    file is damaged, was never closed or has no scans; on reading, if there are several sensors and none is chosen.
    """

    format: ClassVar[str] = "ouster-osf"
    title: ClassVar[Text] = Text("Ouster scans in an OSF file")

    def __init__(self, paths: Sequence[Path], options: ReadOptions) -> None:
        super().__init__(paths, options)
        streams = _streams(self.paths[0])
        sensors = [OusterSensor(PacketSender(s.number, 0, s.metadata.serial), s.metadata) for s in streams]
        self._sensors = [one for one in sensors if options.model is None or one.metadata.fits(options.model)]
        if not self._sensors:
            there = "; ".join(sensor.name for sensor in sensors)
            raise InputError("ouster-other-sensor", path=self.paths[0], model=options.model, there=there)
        self._sensors = chosen_by_source(self._sensors, self.paths[0], options.source)
        stamp_ns, host_s = self._first_times()
        self.notices.clear()
        self._time, self._uncertain = settle(stamp_ns, host_s, self._sensors[0].metadata, None)

    @classmethod
    def recognise(cls, head: Head) -> float:
        """Certain by the identifier of the header."""
        return float(head.data[8:12] == _HEADER_MARK)

    def _first_times(self) -> tuple[IntArray, FloatArray]:
        """Stamps (m,) of the packets of the first turns that have any, and the recorder's times (m,) of these.

        Turns without a valid column or a time, as of a sensor that starts, and damaged ones show no clock.
        """
        metadata = self._decoder_metadata()
        stamps: list[IntArray] = []
        times: list[FloatArray] = []
        turns = 0
        valid = 0
        with closing(self._packets(self.paths[0], Counter())) as batches:
            for data, offset, host_s, _ in batches:
                stamp_ns = metadata.heads(data, offset).stamp_ns
                known = stamp_ns > 0
                turns += 1
                valid += bool(known.any())
                stamps.append(stamp_ns[known])
                times.append(host_s[known])
                if valid == _FIRST_TURNS:
                    break
        if not valid:
            why = "its turns have no valid columns" if turns else "it has no scans of its sensor"
            raise _damaged(self.paths[0], why)
        return np.concatenate(stamps), np.concatenate(times)

    def _decoder_metadata(self) -> Metadata:
        """Those of the packets that are made."""
        return replace(self._sensors[0].metadata, profile="RNG19_RFL8_SIG16_NIR16_DUAL", fusa=False)

    def _decoder(self) -> OusterDecoder:
        return OusterDecoder(self._decoder_metadata(), self._time)

    def _packets(
        self, path: Path, others: Counter[str]
    ) -> Generator[tuple[ByteArray, IntArray, FloatArray, float], None, None]:
        stream = next((s for s in _streams(path) if s.metadata.serial == self._sensors[0].metadata.serial), None)
        if stream is None or not stream.metadata.same_geometry(self._sensors[0].metadata):
            raise _damaged(path, f"it has no scans of {self._sensors[0].name}, as the file before it has")
        bad = 0
        try:
            with path.open("rb") as file:
                size = path.stat().st_size
                unpacked = 0
                for chunk in _chunks(file, path):
                    for found in _turns(chunk, stream, others):
                        if found is None:
                            bad += 1
                            continue
                        unpacked += found[0].nbytes
                        expect_growth(path, size, unpacked)
                        yield *found, file.tell() / size
        finally:  # also where no more packets are wanted
            if bad:
                self.notices.append(Notice("osf-damaged", path=path, bad=bad))


def _damaged(path: Path, why: Words) -> InputError:
    return InputError("osf-unreadable", path=path, why=why, name=path.name)


def _part(file: BinaryIO, at: int, kind: bytes) -> bytes:
    """A part of a file with its length before it; empty if it is damaged."""
    file.seek(at)
    size = int.from_bytes(file.read(4), "little")
    if not 8 <= size <= _MAX_PART_BYTES:
        return b""
    data = size.to_bytes(4, "little") + file.read(size)
    if data[8:12] != kind or int.from_bytes(file.read(4), "little") != crc32(data):
        return b""
    return data


def _header(file: BinaryIO, path: Path) -> tuple[int, int]:
    """Where the chunks begin, and the metadata; InputError if the header is damaged or the file was not finished."""
    header = _part(file, 0, _HEADER_MARK)
    begin = file.tell()
    if not header:
        raise _damaged(path, Text("its header is damaged"))
    try:
        root = _FlatTable.root(header)
        end = root.number(2, "Q")
        finished = root.number(1, "B") == 2 and root.number(3, "Q") == path.stat().st_size
    except _OSF_FAULTS:
        raise _damaged(path, Text("its header is damaged")) from None
    if not finished or not begin <= end < path.stat().st_size:
        raise _damaged(path, "it was not finished by the recorder, or is cut")
    return begin, end


def _streams(path: Path) -> list[_Stream]:
    """The sensors of a file; InputError if there are none, or it is damaged."""
    with path.open("rb") as file:
        data = _part(file, _header(file, path)[1], _METADATA_MARK)
    try:
        entries = [(e.number(0, "I"), e.text(1), e.vector(2, "u1").tobytes()) for e in _FlatTable.root(data).tables(4)]
        texts = {number: _FlatTable.root(content).text(0) for number, kind, content in entries if kind == _SENSOR_ENTRY}
        found = [
            (number, _FlatTable.root(content).number(0, "I"))
            for number, kind, content in entries
            if kind == _SCAN_STREAM
        ]
        if len(found) > _MAX_STREAMS:
            raise ValueError(f"it has {len(found):,} streams of scans")
        streams = [_stream(number, texts[sensor], path.name) for number, sensor in found]
    except (*_OSF_FAULTS, KeyError) as error:
        raise _damaged(path, f"its metadata are damaged ({error or type(error).__name__})") from None
    if not streams:
        raise _damaged(path, "it has no scans")
    return streams


def _stream(number: int, text: str, name: str) -> _Stream:
    metadata = Metadata.parse(text, name)
    if metadata is None or metadata.columns % metadata.packet_columns:
        raise ValueError("metadata of a sensor")
    said = json.loads(text)
    layout: Mapping[str, Any] = said.get("lidar_data_format") or said.get("data_format") or {}
    shifts = np.array(layout.get("pixel_shift_by_row") or metadata.beams[:, 3], np.float64)
    if shifts.shape != (len(metadata.beams),):
        raise ValueError("shifts of rows")
    return _Stream(number, metadata, shifts.astype(np.int64))


def _chunks(file: BinaryIO, path: Path) -> Iterator[bytes]:
    """The chunks; empty for a damaged one."""
    at, end = _header(file, path)
    while at < end:
        file.seek(at)
        step = int.from_bytes(file.read(4), "little")
        yield _part(file, at, _CHUNK_MARK)
        at += step + 8


def _turns(
    chunk: bytes, stream: _Stream, others: Counter[str]
) -> Iterator[tuple[ByteArray, IntArray, FloatArray] | None]:
    """The turns of a sensor in a chunk, as :func:`_packets_of`; None for what is damaged. `others` counts the rest."""
    try:
        messages = _FlatTable.root(chunk).tables(0) if chunk else []
    except _OSF_FAULTS:
        messages = []
    if not messages:
        yield None
    for message in messages:
        try:
            if message.number(1, "I") != stream.number:
                others["other messages"] += 1
                continue
            turn = _packets_of(message, stream)
        except _Aliased:
            yield None
            return
        except _OSF_FAULTS:
            yield None
            continue
        yield turn


def _packets_of(message: _FlatTable, stream: _Stream) -> tuple[ByteArray, IntArray, FloatArray]:
    """The data packets of a turn that have a valid column, as (data, offsets, the recorder's times).

    Raises one of `_OSF_FAULTS` if it is damaged.
    """
    m = stream.metadata
    turn = _FlatTable.root(message.vector(2, "u1").tobytes())
    images = dict(zip((turn.vector(1, "<u2") & 0xFF).tolist(), turn.tables(0), strict=True))
    stamp_ns = turn.vector(2, "<u8")
    status = turn.vector(4, "<u4") & 1
    if len(stamp_ns) != m.columns or len(status) != m.columns or _RANGES[0] not in images:
        raise ValueError("a turn of another size")
    blocks = m.columns // m.packet_columns
    beams = len(m.beams)
    pixels = np.zeros((m.columns, beams, 16), np.uint8)
    for k in range(2):
        if _RANGES[k] in images:
            ranges = _image(images[_RANGES[k]].vector(0, "u1").tobytes(), stream)
            ranges = np.where(ranges <= _MAX_RANGE_MM, ranges, 0).astype("<u4")
            pixels[..., 4 * k : 4 * k + 3] = ranges.T[..., None].view(np.uint8).reshape(m.columns, beams, 4)[..., :3]
        if _BRIGHTS[k] in images:
            pixels[..., 4 * k + 3] = _image(images[_BRIGHTS[k]].vector(0, "u1").tobytes(), stream).T
    columns = np.zeros((m.columns, 12 + pixels[0].size), np.uint8)
    columns[:, 12:] = pixels.reshape(m.columns, -1)
    columns[:, 10] = status
    columns[:, 8:10] = np.arange(m.columns, dtype="<u2")[:, None].view(np.uint8)
    there = status.reshape(blocks, -1) > 0
    # A packet is told by the stamp of its first column, also if that one is not valid.
    begin_ns = np.where(there, stamp_ns.reshape(blocks, -1), np.iinfo(np.int64).max).min(axis=1)
    stamp_ns = np.where(there, stamp_ns.reshape(blocks, -1), begin_ns[:, None]).astype("<u8").reshape(-1)
    columns[:, :8] = stamp_ns[:, None].view(np.uint8)
    packets = np.zeros((blocks, 64 + columns[0].size * m.packet_columns), np.uint8)
    packets[:, 0] = 1
    packets[:, 2:4] = np.frombuffer(struct.pack("<H", turn.number(5, "i") & 0xFFFF), np.uint8)
    packets[:, 32:-32] = columns.reshape(blocks, -1)
    stated_ns = turn.vector(7, "<u8") & np.uint64(STAMP)
    sent_ns: FloatArray = stated_ns.astype(np.float64) if len(stated_ns) == blocks else np.zeros(blocks)
    host_s = np.where(sent_ns > 0, sent_ns, message.number(0, "Q") & STAMP) * 1e-9
    order = np.roll(np.arange(blocks), -(m.window[0] // m.packet_columns))
    order = order[there[order].any(axis=1)]
    return packets.reshape(-1), order * packets.shape[1], host_s[order]


def _image(data: bytes, stream: _Stream) -> NDArray[Any]:
    """An image of a field (beams, columns) in a PNG, or as by the library Zpng."""
    shape = (len(stream.metadata.beams), stream.metadata.columns)
    if data[:2] == _ZPNG:
        _, width, height, channels, channel_bytes = _ZPNG_HEADER.unpack_from(data)
        n = channels * channel_bytes
        if (height, width) != shape or n not in (1, 2, 4):
            raise ValueError("an image of another size")
        size = height * width * n
        content = zstd.ZstdDecompressor().decompress(data[_ZPNG_HEADER.size :], size)
        steps = np.frombuffer(content, np.uint8, size)
        if n == 4:  # planes: blue, green - blue, green - red, alpha
            blue, green, red, alpha = steps.reshape(4, *shape)
            green = green + blue
            planes = [green - red, green, blue, alpha]
        else:
            planes = [*np.moveaxis(steps.reshape(*shape, n), -1, 0)]
        return _joined([np.cumsum(plane, axis=1, dtype=np.uint8) for plane in planes])
    if not data.startswith(_PNG):
        raise ValueError("an unknown encoding")
    import rasterio  # a tenth of a second of each run, whatever it reads: all readers look at a recording
    from rasterio.errors import NotGeoreferencedWarning, RasterioError
    from rasterio.io import MemoryFile

    try:
        with rasterio.Env(), warnings.catch_warnings(), MemoryFile(data) as memory:
            warnings.simplefilter("ignore", NotGeoreferencedWarning)
            with memory.open(driver="PNG") as png:
                if png.shape != shape or png.count > 4:
                    raise ValueError("an image of another size")
                image = _joined([*png.read()])
    except RasterioError as error:
        raise ValueError("a damaged PNG") from error
    return np.asarray(np.take_along_axis(image, (np.arange(shape[1]) + stream.shifts[:, None]) % shape[1], axis=1))


def _joined(planes: Sequence[NDArray[Any]]) -> NDArray[np.uint32]:
    """An image of the planes of its bytes, the lowest first."""
    image = planes[0].astype(np.uint32)
    for k, plane in enumerate(planes[1:], 1):
        image |= plane.astype(np.uint32) << np.uint32(8 * k)
    return image
