"""Where a live session gets its scans and positions: a folder that grows, or a recording played."""

import json
import math
import time
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from queue import Empty, SimpleQueue
from threading import Event
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from furrowmap.core.readers.arrived_scans import ScanStream
from furrowmap.core.readers.pcap import Capture, Datagrams, capture_format, datagrams_of
from furrowmap.core.readers.reader import GivesTrack
from furrowmap.core.readers.source import Source
from furrowmap.core.runtime.errors import InputError, UsageError
from furrowmap.core.runtime.file_names import found_beside
from furrowmap.core.runtime.supervised import SupervisedThread
from furrowmap.core.session.opened import OpenSession
from furrowmap.core.values.gnss import GnssTrack
from furrowmap.core.values.scan import Scan
from furrowmap.core.values.session import Recording
from furrowmap.workflows.record.recorder import STATUS
from furrowmap.workflows.record.series import numbered_files

POLL_S: Final = 0.01
STATUS_EVERY_S: Final = 0.5
SCANLESS_S: Final = 2.0
"""Without scans for so long it is said that they are waited for."""
FEED_STEP_S: Final = 0.01
"""A recording is played in pieces of so long."""
GNSS_DELAY_S: Final = 0.05
"""A receiver sends an epoch so long after it."""
QUEUED_INPUTS: Final = 256
MAX_STATUS_BYTES: Final = 1 << 20


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

    def read_past(self, count: int) -> None:
        """Leave out so many bytes, which were read before."""
        while count > 0 and (data := self.read(min(count, 1 << 16))):
            count -= len(data)


@dataclass
class Followed:
    """How far the files of a series were read.

    Attributes:
        number: of the file that is read; 0 before any.
        is_first: whether it is the one that was written when following began.
        is_read: whether it was read to its end.
        given_bytes: of this file, a log, that were handed on.
        given_s: of this file, a capture, the time of the last packets that were handed on.
    """

    stem: str
    suffix: str
    number: int = 0
    is_first: bool = False
    is_read: bool = False
    given_bytes: int = 0
    given_s: float = -math.inf

    @classmethod
    def of(cls, file: str) -> "Followed":
        """The series of a file."""
        return cls(file.rpartition("-")[0], Path(file).suffix)

    def begin(self, number: int, *, is_first: bool) -> None:
        """Read this file from now on."""
        self.given_bytes = 0
        self.given_s = -math.inf
        self.is_read = False
        self.is_first = is_first
        self.number = number


class FolderFeed:
    """Follows the folder that `furrowmap record` writes; nothing in it is touched.

    Args:
        folder: the recording's.
        recording: of its session, with the scanner that is followed.
        scans: decodes its packets.
        stop: ends the feed.

    Attributes:
        status: what the recorder says of itself; empty where it says nothing.
        threads: that follow scanner and receiver.
    """

    def __init__(self, folder: Path, recording: Recording, scans: ScanStream, stop: Event) -> None:
        self._folder = folder
        self._scans = scans
        self._stop = stop
        self._over = Event()
        # The threads may be ended while they put: a `Queue` would stay locked, as it locks in Python code.
        self._queue: SimpleQueue[tuple[Datagrams | bytes, float]] = SimpleQueue()
        self.threads = [
            SupervisedThread(what, partial(self._follow, Followed.of(files[0])), lambda _: None)
            for what, files in (("scanner", recording.lidar), ("GNSS", recording.gnss))
            if files
        ]
        self._looked_s = -math.inf
        self.status: dict[str, Any] = {}

    def pieces(self) -> Iterator[Input]:
        """What comes in from now on, until the recorder has ended or the feed is stopped."""
        self._look()
        scans_s = time.monotonic()  # when the last scans came, or their lack was said
        while not self._over.is_set() or any(each.is_working for each in self.threads) or not self._queue.empty():
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
        """Read the recorder's status now and then, and see to it that all is followed."""
        for thread in self.threads:
            thread.ensure()
        if time.monotonic() - self._looked_s > STATUS_EVERY_S:
            self._looked_s = time.monotonic()
            self.status = recorder_status(self._folder)
        if self._stop.is_set() or self.status.get("state") == "ended":
            self._over.set()

    def _follow(self, series: Followed) -> None:
        """Read the files of a series, the one that is written now from its end on, each later one from its start.

        It goes on behind what was given where it is begun again.
        """
        while not self._over.is_set():
            files = numbered_files(self._folder, series.stem, series.suffix)
            if not series.number and files:
                series.begin(max(files), is_first=True)
            elif series.is_read and (later := [number for number in files if number > series.number]):
                series.begin(later[0], is_first=False)
            if series.is_read or series.number not in files:
                time.sleep(0.1)
                continue
            try:
                self._read(files[series.number], series)
            except InputError:  # the file is damaged: the next one is read, as soon as there is one
                if max(files) <= series.number:
                    raise
            series.is_read = True

    def _read(self, path: Path, series: Followed) -> None:
        """Read a file until a later one was begun, or the recorder has ended."""
        next_s = time.monotonic()

        def has_ended() -> bool:
            nonlocal next_s
            if self._over.is_set() or time.monotonic() < next_s:
                return self._over.is_set()
            next_s = time.monotonic() + 10.0 * POLL_S
            return max(numbered_files(self._folder, series.stem, series.suffix), default=0) > series.number

        with Growing(path, has_ended) as source:
            if series.suffix != ".pcap":
                source.read_past(series.given_bytes)
                for piece in _chunks(source):
                    self._put(piece, time.time())
                    series.given_bytes += len(piece)
                return
            before_s = series.given_s  # that were given before this thread was ended, and begun again
            for block in Capture(source):
                data = _some(block, np.flatnonzero(block.time_s > before_s)) if math.isfinite(before_s) else block
                if not len(data):
                    continue
                due_s = float(data.time_s[-1])
                # What was recorded before is not shown as now; the last seconds show what the clocks count from.
                if not series.is_first or time.time() - due_s < 5.0:
                    self._put(data, due_s)
                series.given_s = max(series.given_s, due_s)

    def _put(self, data: Datagrams | bytes, due_s: float) -> None:
        """Hand on some of the input, unless the feed is stopped first."""
        while self._queue.qsize() >= QUEUED_INPUTS:
            if self._stop.is_set():
                return
            time.sleep(POLL_S)
        self._queue.put((data, due_s))


def recorder_status(folder: Path) -> dict[str, Any]:
    """What the recorder says of itself; empty where it says nothing, or something else than a recorder says."""
    with suppress(OSError, ValueError, RecursionError):
        for path in found_beside(folder, STATUS):
            with path.open("rb") as file:
                status = json.loads(file.read(MAX_STATUS_BYTES).decode("utf-8"))
            if isinstance(status, dict):
                return status | {"warnings": _warnings(status.get("warnings"))}
    return {}


def _warnings(given: object) -> list[dict[str, str]]:
    """Warnings with their codes and texts, of whatever a status has at their place."""
    found = [each for each in given if isinstance(each, dict)] if isinstance(given, list) else []
    texts = [{key: text for key, text in each.items() if isinstance(text, str)} for each in found]
    return [text for text in texts if {"code", "text"} <= text.keys()]


def _some(datagrams: Datagrams, rows: NDArray[np.int64] | slice) -> Datagrams:
    """Some of the datagrams of a block."""
    cut = {name: getattr(datagrams, name)[rows] for name in ("offset", "length", "time_s", "sender")}
    return replace(datagrams, **cut)


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
        threads: none.

    Raises:
        InputError: if the recording cannot be read.
        UsageError: if the session has no scans or no positions.
    """

    def __init__(self, opened: OpenSession, scans: ScanStream, speed: float, stop: Event) -> None:
        self._opened = opened
        self._scans = scans
        self._speed = speed
        self._stop = stop
        inputs = opened.inputs
        if opened.session.trajectory is not None or not inputs.lidar or not inputs.positions:
            raise UsageError("usage.live-recording", file=opened.file)
        reader = opened.positions()
        assert isinstance(reader, GivesTrack)
        self._track = reader.track()
        self.status: dict[str, Any] = {}
        self.threads: list[SupervisedThread] = []

    def pieces(self) -> Iterator[Input]:
        """Scans by the times of their capture, each with the positions that came before."""
        given = 0
        begin_s = time.time()
        first_s = math.nan
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
                yield last_s, utc_s, self._scans.push(_some(block, some))


def recorded_scans(opened: OpenSession, begin_s: float, end_s: float, utc_minus_host_s: float) -> Iterator[Scan]:
    """The scans of a time, UTC, of a recording, and some of those around.

    `utc_minus_host_s` is that of the clock of the computer that recorded.
    """
    files = opened.inputs.lidar
    with Source(files[0]) as source:
        is_capture = bool(capture_format(source.read(12)))
    if not is_capture:
        offset_s = opened.session.recording.lidar_minus_gnss_s or 0.0
        yield from opened.lidar(begin_s).ahead_by(-offset_s).scans()
        return
    scanner = opened.session.lidar
    stream = ScanStream(files[0], scanner.model, scanner.source)
    begins_s = [first_packet_s(path) + utc_minus_host_s for path in files]
    first = max(0, sum(at_s < begin_s for at_s in begins_s) - 1)
    for block in datagrams_of(files[first:], Counter()):
        if len(block) and block.time_s[-1] + utc_minus_host_s > begin_s:
            yield from stream.push(block)
        if len(block) and block.time_s[0] + utc_minus_host_s > end_s:
            return


def first_packet_s(path: Path) -> float:
    """When the first packet of a capture was recorded, by the clock of the computer; infinite without any."""
    with Source(path) as source:
        block = next(iter(Capture(source)), None)
    return float(block.time_s[0]) if block is not None and len(block) else math.inf
