"""Files of a recording: one thread writes them, another flushes them, so that a slow disk never stops a receiver."""

import errno
import math
import os
import queue
import shutil
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Final

from furrowmap.core.runtime.supervised import StopFlag, SupervisedThread
from furrowmap.exporters.files.atomic import flush_folder
from furrowmap.workflows.record.series import Series, Waiting
from furrowmap.workflows.record.small_files import SmallFiles

SYNC_S: Final = 0.5
"""Between two flushes: with the time that one takes, this is what a power cut loses."""
RETRY_S: Final = 1.0
RESERVE_BYTES: Final = 32 << 20
RESERVE_SHARE: Final = 0.01
"""Space that is left for session, status and log: the smaller of a number of bytes and a share of the disk."""
_IDLE_S: Final = 0.25
_FULL: Final = (errno.ENOSPC, errno.EDQUOT)


class Storage:
    """Writes blocks to series of files in one thread, and flushes them in another.

    A full or failing disk ends neither thread: writing is tried again each second. Meanwhile blocks wait in memory, up
    to the bound of their series; further ones are discarded and counted. Series have turns, a block each.

    Args:
        small: session, status and log, which are written with each flush.
        told: is called by a thread that was ended by an exception, before it begins again.

    Attributes:
        discarded_bytes: for which there was no memory, or at the end no disk.
        most_unsynced_s: the longest time that a power cut at the worst moment would have lost.
        threads: the two.
    """

    def __init__(
        self, folder: Path, small: SmallFiles, told: Callable[[SupervisedThread], None] = lambda _: None
    ) -> None:
        self.folder = folder
        self.small = small
        self.discarded_bytes = 0
        self.most_unsynced_s = 0.0
        self._lock = threading.Lock()
        self._wake: queue.SimpleQueue[None] = queue.SimpleQueue()
        self._draining = StopFlag()
        self._drained = StopFlag()
        self._series: dict[Series, None] = {}
        self._changed: dict[Series, int] = {}
        self._has_new_files = False
        self._retired: list[int] = []
        self._oldest_s = math.inf
        self._flushing_s = math.inf
        self._writer = SupervisedThread("writer", self._write_blocks, told)
        self._flusher = SupervisedThread("flusher", self._flush_often, told)
        self.threads = (self._writer, self._flusher)
        for thread in self.threads:
            thread.ensure()

    def put(self, series: Series, waiting: Waiting) -> None:
        """Let a block be written, once: by a thread that was interrupted here it is put again."""
        block = waiting[0]
        with self._lock:
            if waiting is series.last_put:
                return
            series.last_put = waiting
            if series.waiting_bytes + len(block) > series.most_waiting_bytes:
                self._discard(series, len(block))
                return
            self._series[series] = None
            series.waiting_bytes += len(block)
            series.blocks.append(waiting)
        if self._wake.empty():
            self._wake.put(None)

    @property
    def fault(self) -> str:
        """Why the disk takes nothing; empty if it does."""
        return next((series.fault for series in list(self._series) if series.fault), "")

    @property
    def waiting_bytes(self) -> int:
        """Bytes of all blocks in memory."""
        return sum(series.waiting_bytes for series in list(self._series))

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
        self._draining.set()
        self._wake.put(None)
        self._writer.finish()

    def close(self) -> None:
        """Flush and close all files; call it after `drain`."""
        self._drained.set()
        self._flusher.finish()

    def _discard(self, series: Series, size: int) -> None:
        series.discarded_bytes += size
        self.discarded_bytes += size

    def _write_blocks(self) -> None:
        with self._lock:  # it may have been interrupted while it counted
            for series in self._series:
                series.waiting_bytes = sum(len(block) for block, _ in series.blocks)
        while True:
            last_round = self._draining.is_set()
            wrote = [self._write_first(series) for series in list(self._series) if series.blocks]
            if any(wrote):
                continue
            if last_round and not wrote:
                break
            self._close_ended()
            with suppress(queue.Empty):
                self._wake.get(timeout=_IDLE_S if not last_round else 0.0)
        for series in list(self._series):
            self._retire(series)

    def _write_first(self, series: Series) -> bool:
        """Write the first block of a series that has some; whether it waits no longer."""
        now_s = time.monotonic()
        if now_s < series.retry_s and not self._draining.is_set():
            return False
        block, received_s = series.blocks[0]
        self._oldest_s = min(self._oldest_s, received_s)
        taken = self._takes(series)
        if not taken and not self._draining.is_set():
            series.retry_s = now_s + RETRY_S
            return False
        with self._lock:
            if not taken:
                self._discard(series, len(block))
            series.blocks.popleft()
            series.waiting_bytes -= len(block)
            self._oldest_s = min(self._oldest_s, received_s)  # a flush may have begun before the block was written
            if series.descriptor is not None:
                self._changed[series] = series.descriptor
        return True

    def _close_ended(self) -> None:
        """Close the files of series to which nothing comes any more."""
        for series in list(self._series):
            if series.is_over and not series.blocks:
                self._retire(series)
                with self._lock:
                    if not series.blocks:
                        self._series.pop(series, None)

    def _takes(self, series: Series) -> bool:
        """Whether the disk took the first block. After a fault that is no lack of space another file is begun."""
        try:
            if self.free_bytes < len(series.blocks[0][0]):
                series.fault = os.strerror(errno.ENOSPC)
                return False
            if series.is_done:
                self._retire(series)
                series.begin()
                self._has_new_files = True
            series.append(series.blocks[0])
        except OSError as error:
            series.fault = error.strerror or str(error)
            if error.errno not in _FULL:
                self._retire(series)
            return False
        series.fault = ""
        return True

    def _retire(self, series: Series) -> None:
        if series.descriptor is not None:
            with self._lock:
                self._retired.append(series.descriptor)
                self._changed.pop(series, None)
                series.descriptor = None

    def _flush_often(self) -> None:
        while not self._drained.wait(SYNC_S):
            self._flush()
        self._flush()

    def _flush(self) -> None:
        with self._lock:
            retired = list(self._retired)
            changed = self._changed
            self._changed = {}
            has_new_files = self._has_new_files
            self._has_new_files = False
            self._flushing_s = self._oldest_s
            self._oldest_s = math.inf
        try:
            for descriptor in (*retired, *changed.values()):
                getattr(os, "fdatasync", os.fsync)(descriptor)
            if has_new_files:
                flush_folder(self.folder)
        except BaseException as error:  # nothing of it is known to be safe: its age shows that
            self._oldest_s = min(self._oldest_s, self._flushing_s)
            self._has_new_files |= has_new_files
            if not isinstance(error, OSError):
                with self._lock:
                    open_ones = {series: number for series, number in changed.items() if number not in self._retired}
                    self._changed = open_ones | self._changed
                raise
        else:
            if retired or changed:
                self.most_unsynced_s = max(self.most_unsynced_s, time.monotonic() - self._flushing_s)
        self._flushing_s = math.inf
        for descriptor in retired:
            self._retired.remove(descriptor)
            with suppress(OSError):
                os.close(descriptor)
        self.small.write()
