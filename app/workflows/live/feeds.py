"""Where a live session gets its scans and positions: a folder that grows, or a recording played."""

import json
import math
import time
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from queue import Empty, Queue
from threading import Event, Thread
from typing import Any, Final

import numpy as np

from furrowmap.core.readers.arrived_scans import ScanStream
from furrowmap.core.readers.pcap import Capture, Datagrams, capture_format, datagrams_of
from furrowmap.core.readers.reader import GivesTrack
from furrowmap.core.readers.source import Source
from furrowmap.core.runtime.errors import InputError, UsageError
from furrowmap.core.session.opened import OpenSession
from furrowmap.core.values.gnss import GnssTrack
from furrowmap.core.values.scan import Scan
from furrowmap.core.values.session import Recording

POLL_S: Final = 0.01
STATUS_EVERY_S: Final = 0.5
SCANLESS_S: Final = 2.0
"""Without scans for so long it is said that they are waited for."""
FEED_STEP_S: Final = 0.01
"""A recording is played in pieces of so long."""
GNSS_DELAY_S: Final = 0.05
"""A receiver sends an epoch so long after it."""
QUEUED_INPUTS: Final = 256


@dataclass(frozen=True)
class Input:
    """Some of the input.

    Attributes:
        data: scans that are complete, or positions as bytes of the receiver or as read; an error says what is missing
            for scans.
        due_s: when it came, by this computer's clock.
    """

    data: list[Scan] | bytes | GnssTrack | InputError
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
        scans: decodes its packets.
        stop: ends the feed.

    Attributes:
        status: what the recorder says of itself; empty where it says nothing.
    """

    def __init__(self, folder: Path, recording: Recording, scans: ScanStream, stop: Event) -> None:
        self._folder, self._scans, self._stop, self._over = folder, scans, stop, Event()
        self._series = [
            (files[0].rpartition("-")[0], Path(files[0]).suffix) for files in (recording.lidar, recording.gnss)
        ]
        self._queue: Queue[tuple[Datagrams | bytes, float]] = Queue(QUEUED_INPUTS)
        self._looked_s = -math.inf
        self.status: dict[str, Any] = {}

    def pieces(self) -> Iterator[Input]:
        """What comes in from now on, until the recorder has ended or the feed is stopped."""
        self._look()
        threads = [Thread(target=self._follow, args=series, daemon=True) for series in self._series]
        for thread in threads:
            thread.start()
        scans_s = time.monotonic()  # when the last scans came, or their lack was said
        while any(thread.is_alive() for thread in threads) or not self._queue.empty():
            self._look()
            if self._queue.empty() and time.monotonic() - scans_s > SCANLESS_S:
                scans_s = time.monotonic()
                yield Input(InputError("live-waits"), time.time())
            try:
                data, due_s = self._queue.get(timeout=0.2)
            except Empty:
                continue
            try:
                come = data if isinstance(data, bytes) else self._scans.push(data)
            except InputError as error:
                yield Input(error, due_s)
                continue
            scans_s = time.monotonic() if isinstance(come, list) and come else scans_s
            yield Input(come, due_s)

    def _look(self) -> None:
        """Read the recorder's status now and then."""
        if time.monotonic() - self._looked_s > STATUS_EVERY_S:
            self._looked_s = time.monotonic()
            self.status = recorder_status(self._folder)
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
                        self._queue.put((data, due_s))


def recorder_status(folder: Path) -> dict[str, Any]:
    """What the recorder says of itself; empty where it says nothing."""
    with suppress(OSError, ValueError):
        status: dict[str, Any] = json.loads((folder / "status.json").read_text("utf-8"))
        return status
    return {}


def _chunks(source: Source) -> Iterator[bytes]:
    while data := source.read(1 << 16):
        yield data


class PlayedFeed:
    """Plays the recording of a session as it came in.

    Args:
        opened: the session.
        scans: decodes the packets of captures; other recordings are read as scans.
        speed: so many times as fast as it was recorded; infinite for as fast as it can be looked at.
        stop: ends the feed.

    Attributes:
        status: nothing, because no recorder is at work.

    Raises:
        InputError: if the recording cannot be read.
        UsageError: if the session has no scans or no positions.
    """

    def __init__(self, opened: OpenSession, scans: ScanStream, speed: float, stop: Event) -> None:
        self._opened, self._scans, self._speed, self._stop = opened, scans, speed, stop
        inputs = opened.inputs
        if opened.session.trajectory is not None or not inputs.lidar or not inputs.positions:
            raise UsageError("usage.live-recording", file=opened.file)
        reader = opened.positions()
        assert isinstance(reader, GivesTrack)
        self._track = reader.track()
        self.status: dict[str, Any] = {}

    def pieces(self) -> Iterator[Input]:
        """Scans by the times of their capture, each with the positions that came before."""
        given, begin_s, first_s = 0, time.time(), math.nan
        for now_s, utc_s, scans in self._batches():
            first_s = now_s if math.isnan(first_s) else first_s
            due_s = begin_s + (now_s - first_s) / self._speed
            if self._stop.wait(max(0.0, due_s - time.time())):
                return
            due_s = due_s if math.isfinite(self._speed) else time.time()
            come = int(np.searchsorted(self._track.t_s, utc_s - GNSS_DELAY_S)) if math.isfinite(utc_s) else 0
            if come > given:
                yield Input(self._track[given:come], due_s)
                given = come
            yield Input(scans, due_s)

    def _batches(self) -> Iterator[tuple[float, float, list[Scan]]]:
        """The recorder's time, UTC as far as it is known, and the scans that are complete."""
        with Source(self._opened.inputs.lidar[0]) as source:
            is_capture = capture_format(source.read(12))
        if not is_capture:
            offset_s = self._opened.session.recording.lidar_minus_gnss_s or 0.0
            for scan in self._opened.lidar(float(self._track.t_s[0])).ahead_by(-offset_s).scans():
                yield float(scan.t_s[-1]), float(scan.t_s[-1]) - offset_s, [scan]
            return
        for block in datagrams_of(self._opened.inputs.lidar, Counter()):
            cuts = np.flatnonzero(np.diff(np.floor(block.time_s / FEED_STEP_S)) != 0) + 1
            for part in np.split(np.arange(len(block)), cuts):
                some = slice(int(part[0]), int(part[-1]) + 1)
                last_s = float(block.time_s[some][-1])
                utc_s = last_s + self._scans.utc_minus_host_s
                cut = {name: getattr(block, name)[some] for name in ("offset", "length", "time_s", "sender")}
                yield last_s, utc_s, self._scans.push(replace(block, **cut))
