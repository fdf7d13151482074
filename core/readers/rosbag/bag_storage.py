"""The storages of ROS bags: ROS 1 (V2.0), MCAP and SQLite (.db3), complete, without an index, or truncated.

A storage is read once from start to end, in the order of recording, without its index. So the same code reads complete
bags, bags that were never closed and truncated ones. Memory holds one chunk, and no size that a file declares is
trusted before that many bytes have been read.

Sources: the ROS wiki's page 'Bags/Format/2.0', the MCAP format specification (https://mcap.dev/spec), and the schema in
rosbag2_storage_sqlite3. A bag of ROS 1 is a sequence of records: a header of named fields, then data. One of MCAP is a
sequence of opcode, length and content. In both, messages and their connections or channels are in chunks or separate;
the summary at the end only repeats and counts them. In a database two tables matter: `topics` (id, name, type,
serialization_format) and `messages` (topic_id, timestamp, data), whose rows are in the order of reception.
"""

import bz2
import json
import shutil
import sqlite3
import struct
import sys
import zlib
from abc import ABC, abstractmethod
from collections import Counter
from collections.abc import Collection, Iterator
from contextlib import closing
from pathlib import Path
from typing import Any, ClassVar, Final, NamedTuple
from urllib.parse import quote

from furrowmap.core.readers.source import Source
from furrowmap.core.readers.sqlite_file import is_plain_table, names_second_file
from furrowmap.core.runtime.errors import InputError, Notice
from furrowmap.core.runtime.file_names import resolved
from furrowmap.core.runtime.languages.texts import Text, Words, reason
from furrowmap.core.runtime.memory import expect_disk, expect_growth
from furrowmap.core.runtime.plain_reads import open_plain
from furrowmap.core.runtime.write_errors import scratch_directory, writing_scratch
from furrowmap.core.values.clock import iso_utc

if sys.version_info >= (3, 14):
    from compression import zstd
else:
    from backports import zstd

MAX_RECORD_BYTES: Final = 1 << 29
"""Largest plausible record or chunk: a rosbag chunk has 768 KiB or a single message, one of an MCAP file a few MiB."""

_MOST_NOTED: Final = 20
"""Notices of one kind about one file."""
_READ_BYTES: Final = 1 << 20
_ZSTD: Final = b"\x28\xb5\x2f\xfd"


class BagMessage(NamedTuple):
    """One recorded message, still serialised.

    Attributes:
        type: ROS 2 name of the type, such as "sensor_msgs/msg/PointCloud2".
        encoding: "ros1" or "cdr".
        received_ns: time of reception by the recorder, POSIX nanoseconds.
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
        self._noted: Counter[str] = Counter()

    @abstractmethod
    def messages(self, topics: Collection[str] | None = None) -> Iterator[BagMessage]:
        """The messages (of some topics) in the order of recording, up to the end or to damage.

        InputError if the file is encrypted, or of a version that is not supported.
        """

    def _note(self, key: str, **values: object) -> None:
        """Add a notice; those of one key are counted when there are many."""
        self._noted[key] += 1
        if self._noted[key] <= _MOST_NOTED:
            self.notices.append(Notice(key, file=self.path.name, **values))

    def _note_further(self) -> None:
        """Add how many notices were left out."""
        if further := sum(max(0, count - _MOST_NOTED) for count in self._noted.values()):
            self.notices.append(Notice("bag-more-damage", file=self.path.name, further=further))


class RecordStorage(BagStorage):
    """A storage that is a sequence of records, some of them in chunks, which may end anywhere."""

    declared_by: ClassVar[str]
    """What states topic and type of a message, in the plural."""

    def __init__(self, path: Path) -> None:
        super().__init__(path)
        self._source = Source(path)
        self._offset = 0  # in the decompressed bytes of a `.gz`
        self._orphans = 0
        self._unpacked = 0
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
        self._note_further()

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
        faults: list[Words] = []
        content = b""
        try:
            packed, method, size, checksum = self._chunk_content(header, data)
            content, fault = inflate(packed, method, size)
            self._unpacked += len(content)
            expect_growth(self.path, self._source.size_bytes, self._unpacked)
            if fault:
                faults.append(fault)
            elif checksum and zlib.crc32(content) != checksum:
                content = b""
                faults.append(Text("its checksum is wrong, so all of it is skipped"))
        except Damage as damage:
            faults.append(reason(damage))
        except (KeyError, struct.error, UnicodeDecodeError):
            faults.append(Text("its header is damaged"))
        try:
            yield from self._messages_of(content, topics)
        except Damage as damage:
            faults.append(reason(damage))
        if faults:
            self._note("bag-chunk-damaged", at=at, faults=faults)

    def _take(self, size: int) -> bytes:
        """The next `size` bytes; fewer only at the end of the file."""
        if size > MAX_RECORD_BYTES:
            raise Damage(Text("a record of {size} bytes is declared at byte {offset}", size=size, offset=self._offset))
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
            raise Damage(Text("the file ends within the header of a record"))
        return head

    def _take_whole(self, size: int, *, may_be_cut: bool = False) -> bytes:
        """The next `size` bytes; fewer at the end of the file only where the content `may_be_cut`."""
        data = self._take(size)
        if len(data) < size and not may_be_cut:
            raise Damage(Text("the last record is truncated by {missing} bytes", missing=size - len(data)))
        return data

    def _where(self) -> Text:
        """The current offset, for messages."""
        packed = self._source.compression
        return Text(
            "byte {offset}{packed: (unpacked from {packed})| of {size}}",
            offset=self._offset,
            packed=packed,
            size=self._source.size_bytes,
        )

    def _lost(self) -> Text:
        """What a truncated file has lost."""
        last_ns = self._last_ns
        return (
            Text("it has no message")
            if last_ns is None
            else Text("messages after {last_time} are lost", last_time=iso_utc(last_ns * 1e-09))
        )


def ros2_type(name: str) -> str:
    """The ROS 2 name of a message type: "sensor_msgs/Imu" becomes "sensor_msgs/msg/Imu"."""
    parts = name.split("/")
    return f"{parts[0]}/msg/{parts[1]}" if len(parts) == 2 else name


def inflate(data: bytes, method: str, size: int) -> tuple[bytes, Text | None]:
    """A chunk's content, decompressed in steps: content before damage is kept, and decompression bombs are stopped.

    `method` is "", "none", "lz4", "bz2" or "zstd". Up to `size` bytes, and why they are fewer, or None. Damage if the
    compression is unknown or the declared size is implausible.
    """
    if size > MAX_RECORD_BYTES:
        raise Damage(Text("a chunk of {size} bytes is declared", size=size))
    if method in ("", "none"):
        return data[:size], None if len(data) >= size else Text("it is cut")
    decompressor, faults = _decompressor(method)
    out: list[bytes] = []
    wanted = size
    fault = None
    try:
        for start in range(0, len(data), _READ_BYTES):
            if decompressor.eof or wanted <= 0:
                break
            out.append(decompressor.decompress(data[start : start + _READ_BYTES], wanted))
            wanted -= len(out[-1])
    except faults as error:
        fault = Text("its {method} data are damaged ({why})", method=method, why=error)
    if wanted and not fault:
        fault = Text("it has {found} bytes instead of the declared {declared}", found=size - wanted, declared=size)
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
    raise Damage(Text("unsupported compression {method!r} of a chunk (supported: lz4, bz2, zstd)", method=method[:20]))


ROSBAG1_MAGIC: Final = b"#ROSBAG V"
_VERSION: Final = b"#ROSBAG V2.0\n"

_MESSAGE, _BAG, _INDEX, _CHUNK, _CHUNK_INFO, _CONNECTION = (bytes([op]) for op in range(2, 8))
_U32: Final = struct.Struct("<I")
_TIME: Final = struct.Struct("<II")

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
                raise Damage(Text("the file ends within the header of a record"))
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
            self._note("bag-cut.without-index", where=self._where(), lost=self._lost())

    def _chunk_content(self, header: _Fields, data: bytes) -> tuple[bytes, str, int, int]:
        return data, header[b"compression"].decode("ascii", "replace"), _U32.unpack(header[b"size"])[0], 0

    def _messages_of(self, content: bytes, topics: Collection[str] | None) -> Iterator[BagMessage]:
        at = 0
        while at < len(content):
            try:
                begin = at + 4 + _U32.unpack_from(content, at)[0] + 4
                end = begin + _U32.unpack_from(content, begin - 4)[0]
            except struct.error:
                raise Damage(Text("it ends within the header of a record")) from None
            if end > len(content):
                raise Damage(Text("its last record is truncated by {missing} bytes", missing=end - len(content)))
            message = self._message(_fields(content[at + 4 : begin - 4]), content[begin:end], topics)
            if message is not None:
                yield message
            at = end

    def _message(self, fields: _Fields, data: bytes, topics: Collection[str] | None) -> BagMessage | None:
        """The message in a record, if it is one of these topics; connections are stored."""
        try:
            op = fields[b"op"]
            if op == _CONNECTION:
                topic = fields[b"topic"].decode()
                kind = ros2_type(_fields(data)[b"type"].decode())
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
            raise Damage(Text("the header of a record is damaged"))
        fields[name] = value
        position = end
    return fields


MCAP_MAGIC: Final = b"\x89MCAP0\r\n"

_MCAP_FOOTER: Final = 0x02
_MCAP_SCHEMA: Final = 0x03
_MCAP_CHANNEL: Final = 0x04
_MCAP_MESSAGE: Final = 0x05
_MCAP_CHUNK: Final = 0x06
_MCAP_STATISTICS: Final = 0x0B
_KNOWN: Final = range(0x01, 0x10)
_PRIVATE: Final = range(0x80, 0x100)
_RECORD: Final = struct.Struct("<BQ")
_MESSAGE_HEAD: Final = struct.Struct("<HIQQ")
_CHUNK_HEAD: Final = struct.Struct("<QQQI")


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
                raise Damage(Text("unknown record type {kind}", kind=op))
            content = self._take_whole(size, may_be_cut=op == _MCAP_CHUNK)
            if op == _MCAP_FOOTER:
                return
            if op == _MCAP_STATISTICS:
                self.declared = int.from_bytes(content[:8], "little")
            elif op == _MCAP_CHUNK:
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
                raise Damage(Text("its last record is truncated"))
            if (message := self._message(op, content[begin:at], topics)) is not None:
                yield message

    def _message(self, op: int, content: bytes, topics: Collection[str] | None) -> BagMessage | None:
        """The message in a record, if it is one of these topics; schemas and channels are stored."""
        try:
            if op == _MCAP_MESSAGE:
                channel, _, log_ns, _ = _MESSAGE_HEAD.unpack_from(content)
                topic, kind, encoding = self._channels[channel]
                self._last_ns = log_ns
                if topics is None or topic in topics:
                    return BagMessage(topic, kind, encoding, log_ns, content[_MESSAGE_HEAD.size :])
            elif op == _MCAP_SCHEMA:
                name, _ = _string(content, 2)
                self._schemas[int.from_bytes(content[:2], "little")] = name
            elif op == _MCAP_CHANNEL:
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


SQLITE_MAGIC: Final = b"SQLite format 3\x00"
_SQLITE_STEPS: Final = 10_000_000
_SQLITE_STEPS_A_BYTE: Final = 20
"""Steps of SQLite's virtual machine that a file may take: a row takes some twenty, and has more bytes than that."""
_SQLITE_STEPS_AT_ONCE: Final = 10_000


def end_after(connection: sqlite3.Connection, steps: int) -> None:
    """Let SQLite end with an error after so many steps: a view or a tree of a hostile file may have no end."""
    left = iter(range(steps // _SQLITE_STEPS_AT_ONCE))
    connection.set_progress_handler(lambda: next(left, None) is None, _SQLITE_STEPS_AT_ONCE)


class Db3Storage(BagStorage):
    """A .db3 file, read once."""

    def messages(self, topics: Collection[str] | None = None) -> Iterator[BagMessage]:
        """See :meth:`BagStorage.messages`."""
        with scratch_directory() as folder:
            with writing_scratch():
                database, writable = self._plain(folder)
            self._note_missing_pages(database)
            flags = "mode=rw" if writable else "mode=ro&immutable=1"
            try:
                with closing(sqlite3.connect(f"file:{quote(str(database))}?{flags}", uri=True)) as connection:
                    largest = min(MAX_RECORD_BYTES, database.stat().st_size)
                    connection.setlimit(sqlite3.SQLITE_LIMIT_LENGTH, largest)
                    computed = [name for name in ("topics", "messages") if not is_plain_table(connection, name)]
                    if computed:  # a stored query may never end
                        raise sqlite3.DatabaseError(f"it has no table {computed[0]}")
                    size = database.stat().st_size
                    end_after(connection, _SQLITE_STEPS + _SQLITE_STEPS_A_BYTE * size)
                    yield from self._rows(connection, topics, size)
            except (sqlite3.Error, UnicodeDecodeError, OverflowError) as error:
                self._note("bag-cut.database", error=error)
        self.share_read = 1.0

    def _plain(self, folder: Path) -> tuple[Path, bool]:
        """The database to open, and whether it is a copy: unpacked, or with a journal that SQLite has to complete."""
        journals = [Path(f"{self.path}{end}") for end in ("-wal", "-journal")]
        journals = [journal for journal in journals if journal.is_file() and journal.stat().st_size]
        with Source(self.path) as source:
            if not source.compression and not journals:
                return resolved(self.path), False
            copy = folder / "bag.db3"
            with copy.open("wb") as file:
                while piece := source.read(1 << 20):
                    expect_disk(self.path, folder, max(file.tell(), 0 if source.compression else source.size_bytes))
                    file.write(piece)
            if source.fault:
                self._note("bag-cut.unpacking", fault=source.fault)
        for journal in journals:
            if names_second_file(journal):
                self._note("bag-cut.database", error=f"{journal.name} names another file")
                continue
            shutil.copyfile(journal, f"{copy}{journal.name[len(self.path.name) :]}")
            self._note("bag-unclosed", journal=journal.name)
        return copy, True

    def _note_missing_pages(self, database: Path) -> None:
        """Compare the size with the header's (sqlite.org/fileformat.html, 1.3.7), which SQLite does only if need be."""
        with open_plain(database) as file:
            header = file.read(100)
        page_bytes = int.from_bytes(header[16:18], "big")
        pages = int.from_bytes(header[28:32], "big") if header[24:28] == header[92:96] else 0
        expected = pages * (65536 if page_bytes == 1 else page_bytes)
        there = database.stat().st_size
        if there < expected:
            self._note("bag-cut.shorter-file", size_bytes=there, expected=expected)

    def _rows(
        self, connection: sqlite3.Connection, topics: Collection[str] | None, most_bytes: int
    ) -> Iterator[BagMessage]:
        rows = connection.execute("SELECT id, name, type, serialization_format FROM topics")
        # Converted bags state no format: messages of ROS 2 are CDR.
        known = {number: (str(name), ros2_type(str(kind)), str(form or "cdr")) for number, name, kind, form in rows}
        wanted = [number for number, (topic, _, _) in known.items() if topics is None or topic in topics]
        (last,) = connection.execute("SELECT max(id) FROM messages").fetchone()
        rows = connection.execute(
            "SELECT id, topic_id, timestamp, data FROM messages WHERE topic_id IN (SELECT value FROM json_each(?))"
            " ORDER BY id",
            (json.dumps(wanted),),
        )
        damaged = 0
        left = most_bytes
        for row, number, received_ns, data in rows:
            if isinstance(row, int) and isinstance(last, int) and last > 0:  # a table may be made otherwise
                self.share_read = min(1.0, max(0.0, row / last))
            left -= len(data) if isinstance(data, bytes) else 1
            if left < 0:
                raise sqlite3.DatabaseError("its rows refer to the same pages again and again")
            if number in known and isinstance(received_ns, int) and isinstance(data, bytes):
                yield BagMessage(*known[number], received_ns, data)
            else:
                damaged += 1
        if damaged:
            self._note("bag-orphans.unknown-topics", damaged=damaged)
