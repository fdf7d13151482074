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

POLL_S: Final = 0.01
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
        while True:
            ended = self._ended()
            data = self._raw.read(-1 if size is None else size)
            if data or ended:
                return bytes(data)
            time.sleep(POLL_S)


class FolderFeed:
    """Follows the folder that `furrowmap record` writes; nothing in it is touched.

    Args:
        folder: the recording's.
        stop: ends the feed.
    """

    def __init__(self, folder: Path, stop: Event) -> None:
        self._folder, self._stop = folder, stop
        self._queue: Queue[Input] = Queue(QUEUED_INPUTS)

    def status(self) -> dict[str, Any]:
        """What the recorder says of itself; empty where it says nothing."""
        try:
            status: dict[str, Any] = json.loads((self._folder / "status.json").read_text("utf-8"))
        except (OSError, ValueError):
            return {}
        return status

    def pieces(self) -> Iterator[Input]:
        """What comes in from now on, until the recorder has ended or the feed is stopped."""
        threads = [
            Thread(target=self._follow, args=(pattern,), daemon=True) for pattern in ("lidar-*.pcap", "gnss-*.log")
        ]
        for thread in threads:
            thread.start()
        while any(thread.is_alive() for thread in threads) or not self._queue.empty():
            try:
                yield self._queue.get(timeout=0.2)
            except Empty:
                continue

    def _follow(self, pattern: str) -> None:
        """Read the files of a pattern, the one that is written now from its end on, each later one from its start."""
        done: set[Path] = set()
        while not self._over():
            files = [path for path in sorted(self._folder.glob(pattern)) if path not in done]
            if not files:
                time.sleep(0.1)
                continue
            path = files[0] if done else files[-1]
            first = not done
            done.update(files[:1] if done else files)
            with Growing(path, lambda: self._over() or self._is_followed(pattern, done)) as source:
                for data in Capture(source) if path.suffix == ".pcap" else _chunks(source):
                    due_s = time.time() if isinstance(data, bytes) else float(data.time_s[-1])
                    # What was recorded before is not shown as now; the last seconds show what the clocks count from.
                    if not first or isinstance(data, bytes) or time.time() - due_s < 5.0:
                        self._queue.put(Input(data, due_s))

    def _is_followed(self, pattern: str, done: set[Path]) -> bool:
        return any(path not in done for path in self._folder.glob(pattern))

    def _over(self) -> bool:
        return self._stop.is_set() or self.status().get("state") == "ended"


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

    def status(self) -> dict[str, Any]:
        """Nothing: no recorder is at work."""
        return {}

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
