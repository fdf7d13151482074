"""MCAP files as a stream of records, with or without a summary, complete or truncated.

Source: the MCAP format specification, https://mcap.dev/spec. A file is a sequence of records (opcode, length,
content). Messages and their channels are in chunks or separate; the summary at the end only repeats and counts them.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Collection, Iterator
from pathlib import Path
from typing import Final

from furrowmap.core.readers.rosbag.storage import BagMessage, Damage, RecordsFile, inflate, ros2_type

MAGIC: Final = b"\x89MCAP0\r\n"

_FOOTER, _SCHEMA, _CHANNEL, _MESSAGE, _CHUNK, _STATISTICS = 0x02, 0x03, 0x04, 0x05, 0x06, 0x0B
_KNOWN = range(0x01, 0x10)
_PRIVATE = range(0x80, 0x100)
_RECORD = struct.Struct("<BQ")
_MESSAGE_HEAD = struct.Struct("<HIQQ")
_CHUNK_HEAD = struct.Struct("<QQQI")


class McapFile(RecordsFile):
    """An MCAP file, read once (implements :class:`~furrowmap.core.readers.rosbag.storage.Storage`)."""

    def __init__(self, path: Path) -> None:
        super().__init__(path)
        self._schemas: dict[int, str] = {}
        self._channels: dict[int, tuple[str, str, str]] = {}

    def messages(self, topics: Collection[str] | None = None) -> Iterator[BagMessage]:
        """The messages (of some topics) in the order of recording."""
        with self._stream.source:
            self._stream.take(len(MAGIC))
            try:
                while (record := self._record()) is not None:
                    op, content = record
                    if op == _FOOTER:
                        break
                    if op == _STATISTICS:
                        self.declared = int.from_bytes(content[:8], "little")
                    elif op == _CHUNK:
                        yield from self._chunk(content, topics)
                    else:
                        yield from self._message(op, content, topics)
                else:
                    self._note("bag-cut.footer", where=self._stream.where(), lost=self._lost())
            except Damage as damage:
                self._note("bag-cut", where=self._stream.where(), damage=damage, lost=self._lost())
            self._note_orphans("channels")

    def _record(self) -> tuple[int, bytes] | None:
        """The next record of the file, or None at its end."""
        head = self._stream.take(_RECORD.size)
        if not head:
            if self._stream.source.fault:
                raise Damage(self._stream.source.fault)
            return None
        if len(head) < _RECORD.size:
            raise Damage("the file ends within the header of a record")
        op, size = _RECORD.unpack(head)
        if op not in _KNOWN and op not in _PRIVATE:
            raise Damage(f"unknown record type {op}")
        content = self._stream.take(size)
        if len(content) < size and op != _CHUNK:
            raise Damage(f"the last record is truncated by {size - len(content)} bytes")
        return op, content

    def _chunk(self, content: bytes, topics: Collection[str] | None) -> Iterator[BagMessage]:
        """The messages of a chunk up to where it is damaged; none if its checksum is wrong."""
        at = self._stream.offset - len(content)
        faults = []
        records = b""
        try:
            _, _, size, checksum = _CHUNK_HEAD.unpack_from(content)
            method, start = _string(content, _CHUNK_HEAD.size)
            (packed,) = struct.unpack_from("<Q", content, start)
            records, fault = inflate(content[start + 8 : start + 8 + packed], method, size)
            if fault:
                faults.append(fault)
            elif checksum and zlib.crc32(records) != checksum:
                records = b""
                faults.append("its checksum is wrong, so all of it is skipped")
        except Damage as damage:
            faults.append(str(damage))
        except (struct.error, UnicodeDecodeError):
            faults.append("its header is damaged")
        position = 0
        while position < len(records):
            if position + _RECORD.size > len(records):
                break
            op, size = _RECORD.unpack_from(records, position)
            start, position = position + _RECORD.size, position + _RECORD.size + size
            if position > len(records):
                break
            yield from self._message(op, records[start:position], topics)
        if position != len(records):
            faults.append("its last record is truncated")
        if faults:
            self._note("bag-chunk-damaged", at=at, faults="; ".join(faults))

    def _message(self, op: int, content: bytes, topics: Collection[str] | None) -> Iterator[BagMessage]:
        """The message in a record, if it is one; schemas and channels are stored."""
        try:
            if op == _MESSAGE:
                channel, _, log_ns, _ = _MESSAGE_HEAD.unpack_from(content)
                topic, kind, encoding = self._channels[channel]
                self._last_ns = log_ns
                if topics is None or topic in topics:
                    yield BagMessage(topic, kind, encoding, log_ns, content[_MESSAGE_HEAD.size :])
            elif op == _SCHEMA:
                name, _ = _string(content, 2)
                self._schemas[int.from_bytes(content[:2], "little")] = name
            elif op == _CHANNEL:
                channel, schema = struct.unpack_from("<HH", content)
                topic, after = _string(content, 4)
                encoding, _ = _string(content, after)
                self._channels[channel] = (topic, ros2_type(self._schemas.get(schema, "")), encoding)
        except (KeyError, struct.error, UnicodeDecodeError):
            self._orphans += 1


def _string(content: bytes, position: int) -> tuple[str, int]:
    """The string at `position`, and its end."""
    (size,) = struct.unpack_from("<I", content, position)
    end = position + 4 + size
    if end > len(content):
        raise struct.error
    return content[position + 4 : end].decode(), end
