"""Where a live session gets its datagrams and the receiver's bytes: a folder that grows, or a recording played."""

from __future__ import annotations

import json
import math
import re
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from queue import Empty, Queue
from threading import Event, Thread
from typing import Any, Final

import numpy as np

from furrowmap.core.readers.pcap import Capture, Datagrams
from furrowmap.core.readers.reader import GivesTrack
from furrowmap.core.readers.source import Source
from furrowmap.core.session.opened import OpenSession
from furrowmap.core.values.clock import DAY_S, nearest_in_cycle, unroll
from furrowmap.core.values.session import Recording

POLL_S: Final = 0.01
STATUS_EVERY_S: Final = 0.5
FEED_STEP_S: Final = 0.01
"""A recording is played in pieces of so long."""
GNSS_DELAY_S: Final = 0.05
"""A receiver sends an epoch so long after it."""
QUEUED_INPUTS: Final = 256
_GGA: Final = re.compile(rb"\$[A-Z]{2}GGA,(\d\d)(\d\d)(\d\d(?:\.\d+)?),")


@dataclass(frozen=True)
class Input:
    """Some of the input.

    Attributes:
        data: datagrams of the scanner, or bytes of the receiver.
        due_s: when it came, by this computer's clock.
    """

    data: Datagrams | bytes
    due_s: float


class Growing(Source):
    """A file that a recorder still writes: reading waits at its end until more comes, or another file was begun."""

    def __init__(self, path: Path, ended: Callable[[], bool]) -> None:
        super().__init__(path)
        self._ended = ended

    def read(self, size: int | None = -1, /) -> bytes:
        """Up to `size` bytes, at least one unless the file has ended."""
        ended = False
        while not (data := self._raw.read(-1 if size is None else size)) and not ended:
            ended = self._ended()  # what was written until then is read once more
            if not ended:
                time.sleep(POLL_S)
        return bytes(data)


class FolderFeed:
    """Follows the folder that `furrowmap record` writes; nothing in it is touched.

    Args:
        folder: the recording's.
        recording: of its session; of several scanners the first is followed.
        stop: ends the feed.

    Attributes:
        status: what the recorder says of itself; empty where it says nothing.
    """

    def __init__(self, folder: Path, recording: Recording, stop: Event) -> None:
        self._folder, self._stop, self._over = folder, stop, Event()
        self._series = [
            (files[0].rpartition("-")[0], Path(files[0]).suffix) for files in (recording.lidar, recording.gnss)
        ]
        self._queue: Queue[Input] = Queue(QUEUED_INPUTS)
        self._looked_s = -math.inf
        self.status: dict[str, Any] = {}

    def pieces(self) -> Iterator[Input]:
        """What comes in from now on, until the recorder has ended or the feed is stopped."""
        self._look()
        threads = [Thread(target=self._follow, args=series, daemon=True) for series in self._series]
        for thread in threads:
            thread.start()
        while any(thread.is_alive() for thread in threads) or not self._queue.empty():
            self._look()
            try:
                yield self._queue.get(timeout=0.2)
            except Empty:
                continue

    def _look(self) -> None:
        """Read the recorder's status now and then."""
        if time.monotonic() - self._looked_s > STATUS_EVERY_S:
            self._looked_s = time.monotonic()
            try:
                self.status = json.loads((self._folder / "status.json").read_text("utf-8"))
            except (OSError, ValueError):
                self.status = {}
        if self._stop.is_set() or self.status.get("state") == "ended":
            self._over.set()

    def _follow(self, stem: str, suffix: str) -> None:
        """Read the files of a series, the one that is written now from its end on, each later one from its start."""
        number = 0
        while not self._over.is_set():
            files = sorted(self._folder.glob(f"{stem}-[0-9]*{suffix}"))
            if len(files) <= number:
                time.sleep(0.1)
                continue
            first = not number
            path, number = (files[-1], len(files)) if first else (files[number], number + 1)
            next_s = time.monotonic()

            def has_ended(number: int = number) -> bool:
                nonlocal next_s
                if self._over.is_set() or time.monotonic() < next_s:
                    return self._over.is_set()
                next_s = time.monotonic() + 10.0 * POLL_S
                return len(list(self._folder.glob(f"{stem}-[0-9]*{suffix}"))) > number

            with Growing(path, has_ended) as source:
                for data in Capture(source) if suffix == ".pcap" else _chunks(source):
                    due_s = time.time() if isinstance(data, bytes) else float(data.time_s[-1])
                    # What was recorded before is not shown as now; the last seconds show what the clocks count from.
                    if not first or isinstance(data, bytes) or time.time() - due_s < 5.0:
                        self._queue.put(Input(data, due_s))


def _chunks(source: Source) -> Iterator[bytes]:
    while data := source.read(1 << 16):
        yield data


class PlayedFeed:
    """Plays the recording of a session as it came in.

    Args:
        opened: the session.
        speed: so many times as fast as it was recorded; infinite for as fast as it can be looked at.
        stop: ends the feed.

    Attributes:
        status: nothing, because no recorder is at work.
        utc_minus_recorder_s: of the capture's clock; nan until the scanner's is known, and no positions come before.

    Raises:
        InputError: if the positions cannot be read.
    """

    def __init__(self, opened: OpenSession, speed: float, stop: Event) -> None:
        self._opened, self._speed, self._stop = opened, speed, stop
        reader = opened.positions()
        assert isinstance(reader, GivesTrack)
        self._log = b"".join(path.read_bytes() for path in opened.inputs.positions)
        t_s = reader.track().t_s
        found = list(_GGA.finditer(self._log))
        if found:  # each epoch begins with its sentence, or a moment before
            tod_s = unroll(np.array([int(m[1]) * 3600 + int(m[2]) * 60 + float(m[3]) for m in found]), DAY_S)
            self._epoch_s = tod_s + float(nearest_in_cycle(tod_s[0], t_s[0], DAY_S) - tod_s[0])
            self._ends = np.append([m.start() for m in found[1:]], len(self._log))
        else:  # receivers write epochs at an even pace
            self._epoch_s = t_s
            self._ends = np.linspace(0, len(self._log), len(t_s) + 1).astype(np.int64)[1:]
        self.utc_minus_recorder_s = math.nan
        self.status: dict[str, Any] = {}

    def pieces(self) -> Iterator[Input]:
        """Datagrams by the time of their capture, and the receiver's bytes by the times of its positions."""
        sent, begin_s, first_s = 0, time.time(), math.nan
        for datagrams in self._batches():
            last_s = float(datagrams.time_s[-1])
            first_s = last_s if math.isnan(first_s) else first_s
            due_s = begin_s + (last_s - first_s) / self._speed
            if self._stop.wait(max(0.0, due_s - time.time())):
                return
            due_s = due_s if math.isfinite(self._speed) else time.time()
            utc_s = last_s + self.utc_minus_recorder_s
            come = int(np.searchsorted(self._epoch_s, utc_s - GNSS_DELAY_S)) if math.isfinite(utc_s) else 0
            upto = int(self._ends[come - 1]) if come else 0
            if upto > sent:
                yield Input(self._log[sent:upto], due_s)
                sent = upto
            yield Input(datagrams, due_s)

    def _batches(self) -> Iterator[Datagrams]:
        for path in self._opened.inputs.lidar:
            with Source(path) as source:
                for block in Capture(source):
                    cuts = np.flatnonzero(np.diff(np.floor(block.time_s / FEED_STEP_S)) != 0) + 1
                    for part in np.split(np.arange(len(block)), cuts):
                        some = slice(int(part[0]), int(part[-1]) + 1)
                        yield replace(
                            block,
                            offset=block.offset[some],
                            length=block.length[some],
                            time_s=block.time_s[some],
                            sender=block.sender[some],
                        )
