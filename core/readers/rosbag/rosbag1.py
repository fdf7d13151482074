"""ROS 1 bags (format V2.0) as a stream of records, with or without an index, complete or truncated.

Source: the ROS wiki's page 'Bags/Format/2.0'. A bag is a sequence of records: a header of named fields, then data.
Messages and their connections are in chunks, each followed by its index. A bag that was closed ends with the
connections again and a summary of each chunk.
"""

from __future__ import annotations

import struct
from collections.abc import Collection, Iterator
from pathlib import Path
from typing import ClassVar, Final

from furrowmap.core.readers.rosbag.storage import BagMessage, Damage, RecordStorage, ros2_type
from furrowmap.core.runtime.errors import InputError

ROSBAG1_MAGIC: Final = b"#ROSBAG V"
_VERSION: Final = b"#ROSBAG V2.0\n"

_MESSAGE, _BAG, _INDEX, _CHUNK, _CHUNK_INFO, _CONNECTION = (bytes([op]) for op in range(2, 8))
_U32 = struct.Struct("<I")
_TIME = struct.Struct("<II")

_Fields = dict[bytes, bytes]


class Rosbag1Storage(RecordStorage):
    """A ROS 1 bag, read once."""

    declared_by: ClassVar[str] = "connections"

    def __init__(self, path: Path) -> None:
        super().__init__(path)
        self._connections: dict[int, tuple[str, str]] = {}

    def _read(self, topics: Collection[str] | None) -> Iterator[BagMessage]:
        line = self._take(len(_VERSION))
        if line != _VERSION:
            version = line[len(ROSBAG1_MAGIC) :].decode("ascii", "replace").strip()
            raise InputError("bag-version", path=self.path, version=version or "unknown")
        counted: int | None = None
        indexed = False
        while head := self._take_head(4):
            header = self._take_whole(_U32.unpack(head)[0])
            size = self._take(4)
            if len(size) < 4:
                raise Damage("the file ends within the header of a record")
            fields = _fields(header)
            op = fields.get(b"op")
            data = self._take_whole(_U32.unpack(size)[0], may_be_cut=op == _CHUNK)
            if op == _BAG:
                indexed = any(fields.get(b"index_pos", b""))
                if encryptor := fields.get(b"encryptor"):
                    raise InputError("bag-encrypted", path=self.path, value=encryptor.decode("ascii", "replace"))
            elif op == _CHUNK_INFO:
                counted = (counted or 0) + sum(n for _, n in _TIME.iter_unpack(data[: len(data) // 8 * 8]))
            elif op == _CHUNK:
                yield from self._chunk(fields, data, topics)
            elif op in (_MESSAGE, _CONNECTION):
                if (message := self._message(fields, data, topics)) is not None:
                    yield message
            elif op != _INDEX:
                self._note("bag-record-unknown", where=self._where())
        self.declared = counted
        if not indexed:
            self._note("bag-unindexed")
        elif counted is None:
            self._note("bag-cut.index", where=self._where(), lost=self._lost())

    def _chunk_content(self, header: _Fields, data: bytes) -> tuple[bytes, str, int, int]:
        return data, header[b"compression"].decode("ascii", "replace"), _U32.unpack(header[b"size"])[0], 0

    def _messages_of(self, content: bytes, topics: Collection[str] | None) -> Iterator[BagMessage]:
        at = 0
        while at < len(content):
            try:
                begin = at + 4 + _U32.unpack_from(content, at)[0] + 4
                end = begin + _U32.unpack_from(content, begin - 4)[0]
            except struct.error:
                raise Damage("it ends within the header of a record") from None
            if end > len(content):
                raise Damage(f"its last record is truncated by {end - len(content)} bytes")
            message = self._message(_fields(content[at + 4 : begin - 4]), content[begin:end], topics)
            if message is not None:
                yield message
            at = end

    def _message(self, fields: _Fields, data: bytes, topics: Collection[str] | None) -> BagMessage | None:
        """The message in a record, if it is one of these topics; connections are stored."""
        try:
            op = fields[b"op"]
            if op == _CONNECTION:
                topic, kind = fields[b"topic"].decode(), ros2_type(_fields(data)[b"type"].decode())
                self._connections[_U32.unpack(fields[b"conn"])[0]] = topic, kind
            elif op == _MESSAGE:
                seconds, nanoseconds = _TIME.unpack(fields[b"time"])
                topic, kind = self._connections[_U32.unpack(fields[b"conn"])[0]]
                self._last_ns = seconds * 1_000_000_000 + nanoseconds
                if topics is None or topic in topics:
                    return BagMessage(topic, kind, "ros1", self._last_ns, data)
        except (KeyError, struct.error, UnicodeDecodeError, Damage):
            self._orphans += 1
        return None


def _fields(header: bytes) -> _Fields:
    """The fields of a record's header: each a length, a name, '=' and a value."""
    fields: _Fields = {}
    position = 0
    while position < len(header):
        end = position + 4 + int.from_bytes(header[position : position + 4], "little")
        name, equals, value = header[position + 4 : end].partition(b"=")
        if end > len(header) or not equals:
            raise Damage("the header of a record is damaged")
        fields[name] = value
        position = end
    return fields
