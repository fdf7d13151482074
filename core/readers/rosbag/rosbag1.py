"""ROS 1 bags (format V2.0) as a stream of records, with or without an index, complete or truncated.

Source: the ROS wiki's page 'Bags/Format/2.0'. A bag is a sequence of records: a header of named fields, then data.
Messages and their connections are in chunks, each followed by its index. A bag that was closed ends with the
connections again and a summary of each chunk.
"""

from __future__ import annotations

import struct
from collections.abc import Collection, Iterator
from pathlib import Path
from typing import Final

from furrowmap.core.readers.rosbag.storage import BagMessage, Damage, RecordsFile, inflate, ros2_type
from furrowmap.core.runtime.errors import InputError

MAGIC: Final = b"#ROSBAG V"
_VERSION: Final = b"#ROSBAG V2.0\n"

_MESSAGE, _BAG, _INDEX, _CHUNK, _CHUNK_INFO, _CONNECTION = (bytes([op]) for op in range(2, 8))
_U32 = struct.Struct("<I")
_TIME = struct.Struct("<II")

_Fields = dict[bytes, bytes]


class Rosbag1File(RecordsFile):
    """A ROS 1 bag, read once (implements :class:`~furrowmap.core.readers.rosbag.storage.Storage`)."""

    def __init__(self, path: Path) -> None:
        super().__init__(path)
        self._connections: dict[int, tuple[str, str]] = {}

    def messages(self, topics: Collection[str] | None = None) -> Iterator[BagMessage]:
        """The messages (of some topics) in the order of recording.

        Raises:
            InputError: if the file is not a bag of version 2.0, or is encrypted.
        """
        with self._stream.source:
            self._begin()
            counted: int | None = None
            indexed = False
            try:
                while (record := self._record()) is not None:
                    fields, data = record
                    op = fields.get(b"op")
                    if op == _BAG:
                        indexed = any(fields.get(b"index_pos", b""))
                        self._refuse_encrypted(fields)
                    elif op == _CHUNK_INFO:
                        counted = (counted or 0) + _messages_of_chunk(data)
                    elif op == _CHUNK:
                        yield from self._chunk(fields, data, topics)
                    elif op in (_MESSAGE, _CONNECTION):
                        yield from self._message(fields, data, topics)
                    elif op != _INDEX:
                        self._note("bag-record-unknown", where=self._stream.where())
            except Damage as damage:
                self._note("bag-cut", where=self._stream.where(), damage=damage, lost=self._lost())
            else:
                self.declared = counted
                if not indexed:
                    self._note("bag-unindexed")
                elif counted is None:
                    self._note("bag-cut.index", where=self._stream.where(), lost=self._lost())
            self._note_orphans("connections")

    def _begin(self) -> None:
        line = self._stream.take(len(_VERSION))
        if line != _VERSION:
            version = line[len(MAGIC) :].decode("ascii", "replace").strip()
            raise InputError("bag-version", path=self.path, version=version or "unknown")

    def _refuse_encrypted(self, fields: _Fields) -> None:
        if fields.get(b"encryptor"):
            raise InputError("bag-encrypted", path=self.path, value=fields[b"encryptor"].decode("ascii", "replace"))

    def _record(self) -> tuple[_Fields, bytes] | None:
        """The next record of the file, or None at its end."""
        head = self._stream.take(4)
        if not head:
            if self._stream.source.fault:
                raise Damage(self._stream.source.fault)
            return None
        header = self._whole(_U32.unpack(head)[0]) if len(head) == 4 else b""
        size = self._stream.take(4)
        if len(size) < 4:
            raise Damage("the file ends within the header of a record")
        fields = _fields(header)
        (length,) = _U32.unpack(size)
        data = self._stream.take(length)
        if len(data) < length and fields.get(b"op") != _CHUNK:
            raise Damage(f"the last record is truncated by {length - len(data)} bytes")
        return fields, data

    def _whole(self, size: int) -> bytes:
        data = self._stream.take(size)
        if len(data) < size:
            raise Damage(f"the last record is truncated by {size - len(data)} bytes")
        return data

    def _chunk(self, fields: _Fields, data: bytes, topics: Collection[str] | None) -> Iterator[BagMessage]:
        """The messages of a chunk up to where it is damaged."""
        at = self._stream.offset - len(data)
        faults = []
        content = b""
        try:
            method = fields[b"compression"].decode("ascii", "replace")
            content, fault = inflate(data, method, _U32.unpack(fields[b"size"])[0])
            faults += [fault] if fault else []
        except Damage as damage:
            faults.append(str(damage))
        except (KeyError, struct.error):
            faults.append("its header is damaged")
        position = 0
        try:
            while position < len(content):
                inner, start, position = _inner_record(content, position)
                yield from self._message(inner, content[start:position], topics)
        except Damage as damage:
            faults.append(str(damage))
        if faults:
            self._note("bag-chunk-damaged", at=at, faults="; ".join(faults))

    def _message(self, fields: _Fields, data: bytes, topics: Collection[str] | None) -> Iterator[BagMessage]:
        """The message in a record, if it is one; connections are stored."""
        try:
            op = fields[b"op"]
            if op == _CONNECTION:
                self._connections[_U32.unpack(fields[b"conn"])[0]] = _connection(fields, data)
            elif op == _MESSAGE:
                seconds, nanoseconds = _TIME.unpack(fields[b"time"])
                topic, kind = self._connections[_U32.unpack(fields[b"conn"])[0]]
                self._last_ns = seconds * 1_000_000_000 + nanoseconds
                if topics is None or topic in topics:
                    yield BagMessage(topic, kind, "ros1", self._last_ns, data)
        except (KeyError, struct.error, UnicodeDecodeError):
            self._orphans += 1


def _inner_record(content: bytes, position: int) -> tuple[_Fields, int, int]:
    """Fields, and start and end of the data, of the record at `position` in a chunk."""
    try:
        (header_size,) = _U32.unpack_from(content, position)
        start = position + 4 + header_size + 4
        (size,) = _U32.unpack_from(content, start - 4)
    except struct.error:
        raise Damage("it ends within the header of a record") from None
    if start + size > len(content):
        raise Damage(f"its last record is truncated by {start + size - len(content)} bytes")
    return _fields(content[position + 4 : start - 4]), start, start + size


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


def _connection(fields: _Fields, data: bytes) -> tuple[str, str]:
    """Topic and message type of a connection, the type with its ROS 2 name."""
    try:
        kind = _fields(data)[b"type"].decode()
    except Damage:
        raise KeyError("type") from None
    return fields[b"topic"].decode(), ros2_type(kind)


def _messages_of_chunk(data: bytes) -> int:
    """The number of messages of a chunk in its index."""
    return sum(count for _, count in _TIME.iter_unpack(data[: len(data) // 8 * 8]))
