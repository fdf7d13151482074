"""What the storages of ROS bags have in common.

A storage is read once from start to end, in the order of recording, without its index. So the same code reads complete
bags, bags that were never closed and truncated ones. Memory holds one chunk, and no size that a file declares is
trusted before that many bytes have been read.
"""

from __future__ import annotations

import bz2
import struct
import sys
import zlib
from abc import ABC, abstractmethod
from collections.abc import Collection, Iterator
from pathlib import Path
from typing import Any, ClassVar, NamedTuple

from furrowmap.core.readers.source import Source
from furrowmap.core.runtime.errors import Notice
from furrowmap.core.values.clock import iso_utc

if sys.version_info >= (3, 14):
    from compression import zstd
else:
    from backports import zstd

MAX_RECORD_BYTES = 1 << 29
"""Largest plausible record or chunk: a rosbag chunk has 768 KiB or a single message, one of an MCAP file a few MiB."""

_READ_BYTES = 1 << 20
_ZSTD = b"\x28\xb5\x2f\xfd"


class BagMessage(NamedTuple):
    """One recorded message, still serialised.

    Attributes:
        type: ROS 2 name of the type, such as "sensor_msgs/msg/PointCloud2".
        encoding: "ros1" or "cdr".
        received_ns: time of reception by the recorder, POSIX nanoseconds.
        data: the serialised message.
    """

    topic: str
    type: str
    encoding: str
    received_ns: int
    data: bytes


class Damage(Exception):
    """A part of a bag that cannot be decoded, and why."""


class BagStorage(ABC):
    """One file of a bag, read once.

    Attributes:
        notices: damage; complete when the messages have ended.
        declared: number of messages in the file's index, if it has one and was read to its end.
        share_read: how much of the file has been read, 0 to 1.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.notices: list[Notice] = []
        self.declared: int | None = None
        self.share_read = 0.0

    @abstractmethod
    def messages(self, topics: Collection[str] | None = None) -> Iterator[BagMessage]:
        """The messages (of some topics) in the order of recording, up to the end or to damage.

        Raises:
            InputError: if the file is encrypted, or of a version that is not supported.
        """

    def _note(self, key: str, **values: object) -> None:
        self.notices.append(Notice(key, file=self.path.name, **values))


class RecordStorage(BagStorage):
    """A storage that is a sequence of records, some of them in chunks, which may end anywhere."""

    declared_by: ClassVar[str]
    """What states topic and type of a message, in the plural."""

    def __init__(self, path: Path) -> None:
        super().__init__(path)
        self._source = Source(path)
        self._offset = 0  # in the decompressed bytes of a `.gz`
        self._orphans = 0
        self._last_ns: int | None = None

    def messages(self, topics: Collection[str] | None = None) -> Iterator[BagMessage]:
        """See :meth:`BagStorage.messages`."""
        with self._source:
            try:
                yield from self._read(topics)
            except Damage as damage:
                self._note("bag-cut", where=self._where(), damage=damage, lost=self._lost())
        self.share_read = 1.0
        if self._orphans:
            self._note("bag-orphans", orphans=self._orphans, kind=self.declared_by)

    @abstractmethod
    def _read(self, topics: Collection[str] | None) -> Iterator[BagMessage]:
        """The messages of the file; raises Damage where it is damaged."""

    @abstractmethod
    def _chunk_content(self, header: Any, data: bytes) -> tuple[bytes, str, int, int]:
        """Compressed bytes, compression, declared size and CRC-32 (0 for none) of a chunk."""

    @abstractmethod
    def _messages_of(self, content: bytes, topics: Collection[str] | None) -> Iterator[BagMessage]:
        """The messages in the content of a chunk; raises Damage where it is damaged."""

    def _chunk(self, header: Any, data: bytes, topics: Collection[str] | None) -> Iterator[BagMessage]:
        """The messages of a chunk up to where it is damaged; none if its checksum is wrong."""
        at = self._offset - len(data)
        faults = []
        content = b""
        try:
            packed, method, size, checksum = self._chunk_content(header, data)
            content, fault = inflate(packed, method, size)
            if fault:
                faults.append(fault)
            elif checksum and zlib.crc32(content) != checksum:
                content = b""
                faults.append("its checksum is wrong, so all of it is skipped")
        except Damage as damage:
            faults.append(str(damage))
        except (KeyError, struct.error, UnicodeDecodeError):
            faults.append("its header is damaged")
        try:
            yield from self._messages_of(content, topics)
        except Damage as damage:
            faults.append(str(damage))
        if faults:
            self._note("bag-chunk-damaged", at=at, faults="; ".join(faults))

    def _take(self, size: int) -> bytes:
        """The next `size` bytes; fewer only at the end of the file."""
        if size > MAX_RECORD_BYTES:
            raise Damage(f"a record of {size} bytes is declared at byte {self._offset}")
        blocks = []
        wanted = size
        while wanted > 0 and (block := self._source.read(min(wanted, _READ_BYTES))):
            blocks.append(block)
            wanted -= len(block)
        self._offset += size - wanted
        self.share_read = self._source.share_read
        return blocks[0] if len(blocks) == 1 else b"".join(blocks)

    def _take_head(self, size: int) -> bytes:
        """The first `size` bytes of a record; none at the end of the file."""
        head = self._take(size)
        if not head and self._source.fault:
            raise Damage(self._source.fault)
        if 0 < len(head) < size:
            raise Damage("the file ends within the header of a record")
        return head

    def _take_whole(self, size: int, *, may_be_cut: bool = False) -> bytes:
        """The next `size` bytes; fewer at the end of the file only where the content `may_be_cut`."""
        data = self._take(size)
        if len(data) < size and not may_be_cut:
            raise Damage(f"the last record is truncated by {size - len(data)} bytes")
        return data

    def _where(self) -> str:
        """The current offset, for messages."""
        packed = self._source.compression
        return f"byte {self._offset}" + (f" (unpacked from {packed})" if packed else f" of {self._source.size_bytes}")

    def _lost(self) -> str:
        """What a truncated file has lost."""
        last_ns = self._last_ns
        return "it has no message" if last_ns is None else f"messages after {iso_utc(last_ns * 1e-9)} are lost"


def ros2_type(name: str) -> str:
    """The ROS 2 name of a message type: "sensor_msgs/Imu" becomes "sensor_msgs/msg/Imu"."""
    parts = name.split("/")
    return f"{parts[0]}/msg/{parts[1]}" if len(parts) == 2 else name


def inflate(data: bytes, method: str, size: int) -> tuple[bytes, str]:
    """A chunk's content, decompressed in steps: content before damage is kept, and decompression bombs are stopped.

    Args:
        data: the chunk, possibly truncated.
        method: name of its compression: "", "none", "lz4", "bz2" or "zstd".
        size: the declared size of its content.

    Returns:
        Up to `size` bytes, and why they are fewer, or "".

    Raises:
        Damage: if the compression is unknown or the declared size is implausible.
    """
    if size > MAX_RECORD_BYTES:
        raise Damage(f"a chunk of {size} bytes is declared")
    if method in ("", "none"):
        return data[:size], "" if len(data) >= size else "it is cut"
    decompressor, faults = _decompressor(method)
    out: list[bytes] = []
    wanted, fault = size, ""
    try:
        for start in range(0, len(data), _READ_BYTES):
            if decompressor.eof or wanted <= 0:
                break
            out.append(decompressor.decompress(data[start : start + _READ_BYTES], wanted))
            wanted -= len(out[-1])
    except faults as error:
        fault = f"its {method} data are damaged ({error})"
    if wanted and not fault:
        fault = f"it has {size - wanted} bytes instead of the declared {size}"
    return b"".join(out), fault


def decompress_message(data: bytes) -> bytes:
    """A CDR message, decompressed if its bag is (mode "message"); Damage if it cannot be decompressed."""
    if not data.startswith(_ZSTD):
        return data
    decompressor = zstd.ZstdDecompressor()
    try:
        out: bytes = decompressor.decompress(data, MAX_RECORD_BYTES)
    except zstd.ZstdError as error:
        raise Damage(f"its zstd data are damaged ({error})") from None
    if not decompressor.eof:
        raise Damage("its zstd data are truncated")
    return out


def _decompressor(method: str) -> tuple[Any, tuple[type[Exception], ...]]:
    """An incremental decompressor, and the exceptions that it raises on damage."""
    if method == "lz4":
        from lz4.frame import LZ4FrameDecompressor

        return LZ4FrameDecompressor(), (RuntimeError, EOFError)
    if method == "bz2":
        return bz2.BZ2Decompressor(), (OSError, EOFError, ValueError)
    if method == "zstd":
        return zstd.ZstdDecompressor(), (zstd.ZstdError, EOFError)
    raise Damage(f"unsupported compression {method[:20]!r} of a chunk (supported: lz4, bz2, zstd)")
