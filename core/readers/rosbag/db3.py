"""SQLite storages of ROS 2 bags (.db3), closed or not.

Two tables matter: `topics` (id, name, type, serialization_format) and `messages` (topic_id, timestamp, data), whose
rows are in the order of reception. Source: the schema in rosbag2_storage_sqlite3.
"""

from __future__ import annotations

import json
import shutil
import sqlite3
import tempfile
from collections.abc import Collection, Iterator
from contextlib import closing
from pathlib import Path
from typing import Final
from urllib.parse import quote

from furrowmap.core.readers.rosbag.storage import MAX_RECORD_BYTES, BagMessage, BagStorage, ros2_type
from furrowmap.core.readers.source import Source
from furrowmap.core.runtime.limits import expect_disk

SQLITE_MAGIC: Final = b"SQLite format 3\x00"


class Db3Storage(BagStorage):
    """A .db3 file, read once."""

    def messages(self, topics: Collection[str] | None = None) -> Iterator[BagMessage]:
        """See :meth:`BagStorage.messages`."""
        with tempfile.TemporaryDirectory(prefix="furrowmap-") as folder:
            database, writable = self._plain(Path(folder))
            self._note_missing_pages(database)
            flags = "mode=rw" if writable else "mode=ro&immutable=1"
            try:
                with closing(sqlite3.connect(f"file:{quote(str(database))}?{flags}", uri=True)) as connection:
                    largest = min(MAX_RECORD_BYTES, database.stat().st_size)
                    connection.setlimit(sqlite3.SQLITE_LIMIT_LENGTH, largest)
                    yield from self._rows(connection, topics)
            except (sqlite3.Error, UnicodeDecodeError, OverflowError) as error:
                self._note("bag-cut.database", error=error)
        self.share_read = 1.0

    def _plain(self, folder: Path) -> tuple[Path, bool]:
        """The database to open, and whether it is a copy: unpacked, or with a journal that SQLite has to complete."""
        journals = [Path(f"{self.path}{end}") for end in ("-wal", "-journal")]
        journals = [journal for journal in journals if journal.is_file() and journal.stat().st_size]
        with Source(self.path) as source:
            if not source.compression and not journals:
                return self.path.resolve(), False
            copy = folder / "bag.db3"
            with copy.open("wb") as file:
                while piece := source.read(1 << 20):
                    expect_disk(self.path, folder, max(file.tell(), 0 if source.compression else source.size_bytes))
                    file.write(piece)
            if source.fault:
                self._note("bag-cut.unpacking", fault=source.fault)
        for journal in journals:
            shutil.copyfile(journal, f"{copy}{journal.name[len(self.path.name) :]}")
            self._note("bag-unclosed", journal=journal.name)
        return copy, True

    def _note_missing_pages(self, database: Path) -> None:
        """Compare the size with the header's (sqlite.org/fileformat.html, 1.3.7), which SQLite does only if need be."""
        with database.open("rb") as file:
            header = file.read(100)
        page_bytes = int.from_bytes(header[16:18], "big")
        pages = int.from_bytes(header[28:32], "big") if header[24:28] == header[92:96] else 0
        expected, there = pages * (65536 if page_bytes == 1 else page_bytes), database.stat().st_size
        if there < expected:
            self._note("bag-cut.size", size_bytes=there, expected=expected)

    def _rows(self, connection: sqlite3.Connection, topics: Collection[str] | None) -> Iterator[BagMessage]:
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
        for row, number, received_ns, data in rows:
            if isinstance(row, int) and isinstance(last, int) and last > 0:  # a table may be made otherwise
                self.share_read = min(1.0, max(0.0, row / last))
            if number in known and isinstance(received_ns, int) and isinstance(data, bytes):
                yield BagMessage(*known[number], received_ns, data)
            else:
                damaged += 1
        if damaged:
            self._note("bag-orphans.rows", damaged=damaged)
