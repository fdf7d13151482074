"""Files of a recording: one thread writes them, another flushes them, so that a slow disk never stops a receiver."""

import errno
import math
import os
import queue
import shutil
import threading
import time
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final, TypeAlias

from furrowmap.exporters.files.atomic import atomic_output, flush_folder

Block: TypeAlias = bytes | bytearray

SYNC_S: Final = 0.5
"""Between two flushes: with the time that one takes, this is what a power cut loses."""
RETRY_S: Final = 1.0
RESERVE_BYTES: Final = 32 << 20
RESERVE_SHARE: Final = 0.01
"""Space that is left for session, status and log: the smaller of a number of bytes and a share of the disk."""
WAITING_BYTES: Final = 256 << 20
"""Blocks that wait in memory for the disk, at most: minutes of a scanner."""
_FULL: Final = (errno.ENOSPC, errno.EDQUOT)


@dataclass
class Series:
    """The files of one source, such as `lidar-192.168.1.201-0001.pcap`, written one after the other.

    Attributes:
        head: what every file begins with.
        roll_s: age of a file from which on the next one is begun.
        roll_bytes: size of a file from which on the next one is begun.
        files: names of all files with content, also those of an earlier recording into the same folder.
        written: bytes of all blocks of this recording.
        descriptor: of the open file; None for none.
    """

    folder: Path
    stem: str
    suffix: str
    head: bytes = b""
    roll_s: float = math.inf
    roll_bytes: float = math.inf
    files: list[str] = field(default_factory=list)
    written: int = 0
    descriptor: int | None = None
    _number: int = 0
    _size: int = 0
    _begun_s: float = 0.0

    def __post_init__(self) -> None:
        for path in sorted(self.folder.glob(f"{self.stem}-[0-9]*{self.suffix}")):
            self._number = int(path.stem.rpartition("-")[2])
            if path.stat().st_size > len(self.head):
                self.files.append(path.name)

    @property
    def is_done(self) -> bool:
        """Whether the next block begins a file."""
        old = time.monotonic() - self._begun_s >= self.roll_s
        return self.descriptor is None or old or self._size >= self.roll_bytes

    def begin(self) -> None:
        """Begin the next file. Raises OSError."""
        self._number += 1
        flags = os.O_CREAT | os.O_EXCL | os.O_WRONLY | getattr(os, "O_BINARY", 0)
        self.descriptor = os.open(self.folder / self._name, flags, 0o644)
        self._size, self._begun_s = 0, time.monotonic()

    def append(self, block: Block) -> None:
        """Append a block to the open file: the whole of it, or if that fails nothing. Raises OSError."""
        assert self.descriptor is not None
        data = block if self._size else self.head + block
        done = 0
        try:
            while done < len(data):
                done += os.write(self.descriptor, memoryview(data)[done:])
        except OSError:
            with suppress(OSError):
                os.ftruncate(self.descriptor, self._size)
                os.lseek(self.descriptor, self._size, os.SEEK_SET)
            raise
        if not self._size:
            self.files.append(self._name)
        self._size += len(data)
        self.written += len(block)

    @property
    def _name(self) -> str:
        return f"{self.stem}-{self._number:04d}{self.suffix}"


class Storage:
    """Writes blocks to series of files in one thread, and flushes them in another.

    A full or failing disk ends neither thread: writing is tried again each second. Meanwhile blocks wait in memory, up
    to `WAITING_BYTES`; further ones are discarded and counted.

    Attributes:
        waiting_bytes: in memory.
        discarded_bytes: for which there was no memory, or at the end no disk.
        fault: why the disk takes nothing; empty if it does.
        most_unsynced_s: the longest time that a power cut at the worst moment would have lost.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.waiting_bytes = self.discarded_bytes = 0
        self.fault = ""
        self.most_unsynced_s = 0.0
        self._blocks: queue.SimpleQueue[tuple[Series, Block, float] | None] = queue.SimpleQueue()
        self._lock = threading.Lock()
        self._closing, self._drained = threading.Event(), threading.Event()
        self._series: dict[str, Series] = {}
        self._changed: dict[str, int] = {}
        self._has_new_files = False
        self._retired: list[int] = []
        self._oldest_s = self._flushing_s = math.inf
        self._texts: dict[str, tuple[str, bool]] = {}
        self._lines: list[str] = []
        self._threads = [threading.Thread(target=work, daemon=True) for work in (self._write_blocks, self._flush_often)]
        for thread in self._threads:
            thread.start()

    def put(self, series: Series, block: Block, received_s: float) -> None:
        """Let a block be written whose first byte was received at that time of the monotonic clock."""
        with self._lock:
            if self.waiting_bytes + len(block) > WAITING_BYTES:
                self.discarded_bytes += len(block)
                return
            self.waiting_bytes += len(block)
        self._blocks.put((series, block, received_s))

    def replace(self, name: str, text: str, *, durable: bool = False) -> None:
        """Let a small file be replaced in one step, and be safe from a power cut if it is to be durable."""
        with self._lock:
            self._texts[name] = (text, durable)

    def log(self, line: str) -> None:
        """Let a line be appended to the log."""
        with self._lock:
            self._lines.append(f"{line}\n")

    @property
    def unsynced_s(self) -> float:
        """What a power cut would lose now."""
        return max(0.0, time.monotonic() - min(self._oldest_s, self._flushing_s))

    @property
    def free_bytes(self) -> int:
        """Free space for blocks. Raises OSError."""
        disk = shutil.disk_usage(self.folder)
        return disk.free - min(RESERVE_BYTES, int(RESERVE_SHARE * disk.total))

    def drain(self) -> None:
        """Write all blocks that wait; those that a full disk does not take are counted as discarded."""
        self._closing.set()
        self._blocks.put(None)
        self._threads[0].join()

    def close(self) -> None:
        """Flush and close all files; call it after `drain`."""
        self._drained.set()
        self._threads[1].join()

    def _write_blocks(self) -> None:
        while (item := self._blocks.get()) is not None:
            series, block, received_s = item
            self._oldest_s = min(self._oldest_s, received_s)
            while not self._takes(series, block):
                if self._closing.wait(RETRY_S):
                    self.discarded_bytes += len(block)
                    break
            with self._lock:
                self.waiting_bytes -= len(block)
                self._oldest_s = min(self._oldest_s, received_s)  # a flush may have begun before the block was written
                if series.descriptor is not None:
                    self._changed[series.stem] = series.descriptor
        for series in self._series.values():
            self._retire(series)

    def _takes(self, series: Series, block: Block) -> bool:
        """Whether the disk took the block. A file that fails otherwise than by lack of space is followed by another."""
        try:
            if self.free_bytes < len(block):
                self.fault = os.strerror(errno.ENOSPC)
                return False
            if series.is_done:
                self._retire(series)
                series.begin()
                self._series[series.stem], self._has_new_files = series, True
            series.append(block)
        except OSError as error:
            self.fault = error.strerror or str(error)
            if error.errno not in _FULL:
                self._retire(series)
            return False
        self.fault = ""
        return True

    def _retire(self, series: Series) -> None:
        if series.descriptor is not None:
            with self._lock:
                self._retired.append(series.descriptor)
                self._changed.pop(series.stem, None)
            series.descriptor = None

    def _flush_often(self) -> None:
        while not self._drained.wait(SYNC_S):
            self._flush()
        self._flush()

    def _flush(self) -> None:
        with self._lock:
            retired, self._retired = self._retired, []
            descriptors = [*retired, *self._changed.values()]
            self._changed = {}
            has_new_files, self._has_new_files = self._has_new_files, False
            self._flushing_s, self._oldest_s = self._oldest_s, math.inf
        try:
            for descriptor in descriptors:
                getattr(os, "fdatasync", os.fsync)(descriptor)
            if has_new_files:
                flush_folder(self.folder)
        except OSError:  # nothing of it is known to be safe: its age shows that
            self._oldest_s = min(self._oldest_s, self._flushing_s)
            self._has_new_files |= has_new_files
        else:
            if descriptors:
                self.most_unsynced_s = max(self.most_unsynced_s, time.monotonic() - self._flushing_s)
        self._flushing_s = math.inf
        for descriptor in retired:
            os.close(descriptor)
        self._write_texts()

    def _write_texts(self) -> None:
        with self._lock:
            texts, self._texts = self._texts, {}
            lines, self._lines = self._lines, []
        try:
            if lines:
                with (self.folder / "record.log").open("a", encoding="utf-8") as file:
                    file.writelines(lines)
                lines = []
            for name in list(texts):
                text, durable = texts[name]
                if durable:
                    with atomic_output(self.folder / name) as unfinished:
                        unfinished.write_text(text, encoding="utf-8")
                else:
                    unfinished = self.folder / f".{name}"
                    unfinished.write_text(text, encoding="utf-8")
                    unfinished.replace(self.folder / name)
                del texts[name]
        except OSError:  # a full disk: tried again with the next flush
            with self._lock:
                self._lines = lines + self._lines
                self._texts = texts | self._texts
