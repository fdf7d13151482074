"""What the storages of ROS bags have in common: messages out, one after another, and damage survived.

A storage is read once from its start to its end, in the order in which it was recorded, without its index. The same
few lines so read a whole bag, one that was never closed and one that was cut; memory holds one chunk, whatever the
bag's length; and no size that a file declares is believed before as many bytes have come.
"""

from __future__ import annotations

import bz2
import sys
from collections.abc import Collection, Iterator
from pathlib import Path
from typing import Any, NamedTuple, Protocol

from furrowmap.core.readers.source import Source
from furrowmap.core.values.clock import iso_utc
from furrowmap.core.values.errors import Notice

if sys.version_info >= (3, 14):
    from compression import zstd
else:
    from backports import zstd

LARGEST_BYTES = 1 << 29
"""No record or chunk of a bag is larger: a rosbag chunk holds 768 KiB or a single message, one of an MCAP file a few
MiB. A declared size beyond is damage."""

_BLOCK_BYTES = 1 << 20
_ZSTD = b"\x28\xb5\x2f\xfd"


class BagMessage(NamedTuple):
    """One recorded message, still serialised.

    Attributes:
        topic: its name.
        type: in ROS 2's spelling, such as "sensor_msgs/msg/PointCloud2".
        encoding: "ros1" or "cdr".
        received_ns: when the recorder received it, POSIX nanoseconds.
        data: the message.
    """

    topic: str
    type: str
    encoding: str
    received_ns: int
    data: bytes


class Storage(Protocol):
    """One file of a bag.

    Attributes:
        notices: what was damaged; complete when the messages have ended.
        declared: how many messages the file's own index counts, where it has one and was read to its end.
    """

    notices: list[Notice]
    declared: int | None

    @property
    def share_read(self) -> float:
        """How much of the file has been read, 0 to 1."""
        ...

    def messages(self, topics: Collection[str] | None = None) -> Iterator[BagMessage]:
        """The messages (of some topics) in the order of recording; they end where the file or its sense does."""
        ...


class Damage(Exception):
    """A part of a bag that makes no sense; says which and why."""


class ByteStream:
    """A file's bytes in order, and where one stands in them (counted behind the decompression of a `.gz`)."""

    def __init__(self, path: Path) -> None:
        self.source = Source(path)
        self.offset = 0

    def take(self, size: int) -> bytes:
        """The next `size` bytes; fewer only where the file ends.

        Raises:
            Damage: if no record of a bag can be so large.
        """
        if size > LARGEST_BYTES:
            raise Damage(f"a record of {size} bytes is declared at byte {self.offset}")
        blocks = []
        wanted = size
        while wanted > 0 and (block := self.source.read(min(wanted, _BLOCK_BYTES))):
            blocks.append(block)
            wanted -= len(block)
        self.offset += size - wanted
        return blocks[0] if len(blocks) == 1 else b"".join(blocks)

    @property
    def share_read(self) -> float:
        """How much of the file has been read, 0 to 1."""
        return 1.0 if self.source.closed else self.source.share_read

    def where(self) -> str:
        """The byte reached, in words."""
        packed = self.source.compression
        return f"byte {self.offset}" + (f" (unpacked from {packed})" if packed else f" of {self.source.size_bytes}")


class StorageFile:
    """What all storages begin with."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.notices: list[Notice] = []
        self.declared: int | None = None

    def _note(self, code: str, text: str) -> None:
        self.notices.append(Notice(code, f"{self.path.name}: {text}."))


class RecordsFile(StorageFile):
    """A storage that is a row of records, which may break off anywhere."""

    def __init__(self, path: Path) -> None:
        super().__init__(path)
        self._stream = ByteStream(path)
        self._orphans = 0
        self._last_ns: int | None = None

    @property
    def share_read(self) -> float:
        """How much of the file has been read, 0 to 1."""
        return self._stream.share_read

    def _lost(self) -> str:
        """What records that end too early have lost, as far as anyone can tell."""
        last_ns = self._last_ns
        return (
            "no message was found" if last_ns is None else f"what was recorded after {iso_utc(last_ns * 1e-9)} is lost"
        )

    def _note_orphans(self, kind: str) -> None:
        """Tell how many messages are left out because what they belong to, of that kind, is damaged."""
        if self._orphans:
            self._note("bag-orphans", f"{self._orphans} messages of {kind} that are damaged were left out")


def ros2_type(name: str) -> str:
    """A message type in ROS 2's spelling: "sensor_msgs/Imu" and "sensor_msgs/msg/Imu" are the same."""
    parts = name.split("/")
    return f"{parts[0]}/msg/{parts[1]}" if len(parts) == 2 else name


def inflate(data: bytes, method: str, size: int) -> tuple[bytes, str]:
    """A chunk's content, decompressed step by step so that what precedes damage is kept and no bomb goes off.

    Args:
        data: the chunk, perhaps cut.
        method: its compression as the storage names it: "", "none", "lz4", "bz2" or "zstd".
        size: the size its content is declared to have.

    Returns:
        Up to `size` bytes, and why they are fewer, or "".

    Raises:
        Damage: if the compression is unknown or the declared size is beyond reason.
    """
    if size > LARGEST_BYTES:
        raise Damage(f"a chunk of {size} bytes is declared")
    if method in ("", "none"):
        return data[:size], "" if len(data) >= size else "it is cut"
    decompressor, faults = _decompressor(method)
    out: list[bytes] = []
    wanted, fault = size, ""
    try:
        for start in range(0, len(data), _BLOCK_BYTES):
            if decompressor.eof or wanted <= 0:
                break
            out.append(decompressor.decompress(data[start : start + _BLOCK_BYTES], wanted))
            wanted -= len(out[-1])
    except faults as error:
        fault = f"its {method} data are damaged ({error})"
    if wanted and not fault:
        fault = f"it holds {size - wanted} bytes where {size} are declared"
    return b"".join(out), fault


def unpacked(data: bytes) -> bytes:
    """A CDR message as it was before rosbag2 compressed it (mode "message"); other messages as they are.

    Raises:
        Damage: if it cannot be decompressed.
    """
    if not data.startswith(_ZSTD):
        return data
    decompressor = zstd.ZstdDecompressor()
    try:
        out: bytes = decompressor.decompress(data, LARGEST_BYTES)
    except zstd.ZstdError as error:
        raise Damage(f"its zstd data are damaged ({error})") from None
    if not decompressor.eof:
        raise Damage("its zstd data are cut")
    return out


def _decompressor(method: str) -> tuple[Any, tuple[type[Exception], ...]]:
    """An incremental decompressor of a fresh chunk, and what it raises on damage."""
    if method == "lz4":
        from lz4.frame import LZ4FrameDecompressor

        return LZ4FrameDecompressor(), (RuntimeError, EOFError)
    if method == "bz2":
        return bz2.BZ2Decompressor(), (OSError, EOFError, ValueError)
    if method == "zstd":
        return zstd.ZstdDecompressor(), (zstd.ZstdError, EOFError)
    raise Damage(f"a chunk is compressed by {method[:20]!r}, which is none of lz4, bz2 and zstd")
