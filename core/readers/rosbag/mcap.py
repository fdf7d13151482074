"""MCAP files as a stream of records, with or without a summary, complete or truncated.

Source: the MCAP format specification, https://mcap.dev/spec. A file is a sequence of records (opcode, length,
content). Messages and their channels are in chunks or separate; the summary at the end only repeats and counts them.
"""

from __future__ import annotations

import struct
from collections.abc import Collection, Iterator
from pathlib import Path
from typing import ClassVar, Final

from furrowmap.core.readers.rosbag.storage import BagMessage, Damage, RecordStorage, ros2_type

MCAP_MAGIC: Final = b"\x89MCAP0\r\n"

_FOOTER, _SCHEMA, _CHANNEL, _MESSAGE, _CHUNK, _STATISTICS = 0x02, 0x03, 0x04, 0x05, 0x06, 0x0B
_KNOWN = range(0x01, 0x10)
_PRIVATE = range(0x80, 0x100)
_RECORD = struct.Struct("<BQ")
_MESSAGE_HEAD = struct.Struct("<HIQQ")
_CHUNK_HEAD = struct.Struct("<QQQI")


class McapStorage(RecordStorage):
    """An MCAP file, read once."""

    declared_by: ClassVar[str] = "channels"

    def __init__(self, path: Path) -> None:
        super().__init__(path)
        self._schemas: dict[int, str] = {}
        self._channels: dict[int, tuple[str, str, str]] = {}

    def _read(self, topics: Collection[str] | None) -> Iterator[BagMessage]:
        self._take(len(MCAP_MAGIC))
        while head := self._take_head(_RECORD.size):
            op, size = _RECORD.unpack(head)
            if op not in _KNOWN and op not in _PRIVATE:
                raise Damage(f"unknown record type {op}")
            content = self._take_whole(size, may_be_cut=op == _CHUNK)
            if op == _FOOTER:
                return
            if op == _STATISTICS:
                self.declared = int.from_bytes(content[:8], "little")
            elif op == _CHUNK:
                yield from self._chunk(None, content, topics)
            elif (message := self._message(op, content, topics)) is not None:
                yield message
        self._note("bag-cut.footer", where=self._where(), lost=self._lost())

    def _chunk_content(self, header: None, data: bytes) -> tuple[bytes, str, int, int]:  # noqa: ARG002
        _, _, size, checksum = _CHUNK_HEAD.unpack_from(data)
        method, start = _string(data, _CHUNK_HEAD.size)
        (packed,) = struct.unpack_from("<Q", data, start)
        return data[start + 8 : start + 8 + packed], method, size, checksum

    def _messages_of(self, content: bytes, topics: Collection[str] | None) -> Iterator[BagMessage]:
        at = 0
        while at < len(content):
            begin = at + _RECORD.size
            op, size = _RECORD.unpack_from(content, at) if begin <= len(content) else (0, 0)
            at = begin + size
            if at > len(content):
                raise Damage("its last record is truncated")
            if (message := self._message(op, content[begin:at], topics)) is not None:
                yield message

    def _message(self, op: int, content: bytes, topics: Collection[str] | None) -> BagMessage | None:
        """The message in a record, if it is one of these topics; schemas and channels are stored."""
        try:
            if op == _MESSAGE:
                channel, _, log_ns, _ = _MESSAGE_HEAD.unpack_from(content)
                topic, kind, encoding = self._channels[channel]
                self._last_ns = log_ns
                if topics is None or topic in topics:
                    return BagMessage(topic, kind, encoding, log_ns, content[_MESSAGE_HEAD.size :])
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
        return None


def _string(content: bytes, position: int) -> tuple[str, int]:
    """The string at `position`, and its end."""
    (size,) = struct.unpack_from("<I", content, position)
    end = position + 4 + size
    if end > len(content):
        raise struct.error
    return content[position + 4 : end].decode(), end
