"""GNSS receivers: their bytes as they arrive."""

import math
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Final

from furrowmap.core.readers.arrived_positions import ArrivedPositions
from furrowmap.core.runtime.supervised import SupervisedThread
from furrowmap.core.values.gnss import Fix
from furrowmap.workflows.record.gnss_source import GnssBytes, GnssSource
from furrowmap.workflows.record.recording_files import Storage
from furrowmap.workflows.record.series import Series

REOPEN_S: Final = 1.0
"""Between two attempts to open a source."""
MAX_BYTES_PER_S: Final = 1 << 20
"""Several times what any receiver sends. What a server sends faster is read later; a UDP port loses it."""
BURST_S: Final = 4.0
"""What waited for so long is read at once."""
WAITING_BYTES: Final = 16 << 20
"""Of a receiver in memory, where the disk takes nothing."""
MAX_SENDERS: Final = 4
"""To one UDP port that are recorded until one of them gives a position."""
MAX_CANDIDATE_BYTES: Final = 64 << 20
SENDER_SILENT_S: Final = 10.0
"""A sender that is silent for so long gives its place to another one with positions."""
MAX_NAMED: Final = 1000
STOP_S: Final = 10.0


@dataclass(eq=False)
class Stream:
    """What comes from one sender.

    Attributes:
        last_s: when the last bytes arrived, by the monotonic clock.
        received: number of bytes.
    """

    series: Series
    last_s: float
    received: int = 0
    arrived: ArrivedPositions = field(default_factory=ArrivedPositions)


class GnssReceiver:
    """Reads a GNSS receiver in a thread and lets its bytes be written; a source that is lost is opened again.

    A UDP port takes messages of any sender. Those of a few are recorded, each in its own logs, until one gives a
    position; from then on only its own are, and those of others are counted.

    Args:
        source: as the user named it.
        new_series: the logs of a sender: of the first one with the empty text, of others with their address.
        told: is called by the thread where it was ended by an exception, before it begins again.

    Attributes:
        fault: why the source cannot be opened, or was lost; empty while it is open.
        flooded_s: when more came than a receiver sends, by the monotonic clock.
        foreign: messages of other senders, which are not recorded.
        foreign_of: the addresses that sent them; of a thousand at most.
    """

    def __init__(
        self,
        source: str,
        storage: Storage,
        new_series: Callable[[str], Series],
        told: Callable[[SupervisedThread], None] = lambda _: None,
    ) -> None:
        self.source = source
        self.fault = ""
        self.foreign = 0
        self.foreign_of: dict[str, None] = {}
        self.flooded_s = -math.inf
        self._where = GnssSource.parse(source)
        self._storage = storage
        self._new_series = new_series
        self._begun_s = time.monotonic()
        self._streams: dict[str, Stream] = {}
        self._chosen: str | None = None
        self._used: list[Series] = []
        self._due_s = 0.0
        self.thread = SupervisedThread(f"GNSS receiver {source}", self._receive, told)
        self.thread.ensure()

    @property
    def stream(self) -> Stream | None:
        """That of the sender that is used; None before any."""
        streams = dict(self._streams)
        return streams.get(self._chosen or "", next(iter(streams.values()), None))

    @property
    def arrived(self) -> ArrivedPositions:
        """What the bytes that are used say."""
        stream = self.stream
        return stream.arrived if stream is not None else ArrivedPositions()

    @property
    def files(self) -> list[str]:
        """The logs of the senders that were used, in their order."""
        used = self._used or [stream.series for stream in [self.stream] if stream is not None]
        return [name for series in used for name in series.files]

    @property
    def all_series(self) -> list[Series]:
        """The logs of all senders."""
        return [stream.series for stream in list(self._streams.values())]

    @property
    def last_s(self) -> float:
        """When the last bytes of the sender that is used arrived, by the monotonic clock; the start before any."""
        stream = self.stream
        return stream.last_s if stream is not None else self._begun_s

    @property
    def sender(self) -> str:
        """The address that is used; empty for sources that have one only, or before it is known."""
        return self._chosen or ""

    def look(self) -> None:
        """Look at what arrived, and choose the sender. Whatever hostile bytes raise, all were looked at."""
        failed: Exception | None = None
        for stream in list(self._streams.values()):
            try:
                stream.arrived.look()
            except Exception as error:  # noqa: BLE001 whatever hostile bytes raise, the other senders are looked at
                failed = error
        self._choose()
        if failed is not None:
            raise failed

    def stop(self) -> None:
        """End reading."""
        self.thread.stop(STOP_S)

    def _choose(self) -> None:
        now_s = time.monotonic()
        chosen = self._streams.get(self._chosen) if self._chosen is not None else None
        if chosen is not None and now_s - chosen.last_s < SENDER_SILENT_S:
            return
        for sender, stream in list(self._streams.items()):
            if stream.arrived.fix is not Fix.NONE and now_s - stream.last_s < SENDER_SILENT_S:
                self._chosen = sender
                if stream.series not in self._used:
                    self._used.append(stream.series)
                return

    def _receive(self) -> None:
        while not self.thread.stopping.is_set():
            try:
                with self._where.open() as read:
                    self.fault = ""
                    while not self.thread.stopping.is_set():
                        piece = read()
                        if piece.data:
                            self._take(piece)
            except (OSError, UnicodeError) as error:  # a resolver may refuse names otherwise than by an OSError
                self.fault = getattr(error, "strerror", None) or str(error) or type(error).__name__
                self.thread.stopping.wait(REOPEN_S)

    def _take(self, piece: GnssBytes) -> None:
        now_s = time.monotonic()
        stream = None if piece.is_foreign else self._stream_of(piece.sender)
        if stream is None:
            self.foreign += 1
            if len(self.foreign_of) < MAX_NAMED:
                self.foreign_of[piece.sender] = None
            return
        stream.last_s = now_s
        stream.received += len(piece.data)
        self._storage.put(stream.series, (piece.data, now_s))
        stream.arrived.add(piece.data, time.time())
        self._keep_pace(len(piece.data), now_s)

    def _stream_of(self, sender: str) -> Stream | None:
        """Where the bytes of a sender go; None where they are not recorded."""
        stream = self._streams.get(sender)
        chosen = self._streams.get(self._chosen) if self._chosen is not None else None
        if stream is chosen and stream is not None:
            return stream
        if chosen is not None and time.monotonic() - chosen.last_s < SENDER_SILENT_S:
            return None
        if stream is None:
            if len(self._streams) >= MAX_SENDERS:
                return None
            series = self._new_series(sender if self._streams else "")
            series.most_waiting_bytes = WAITING_BYTES
            stream = Stream(series, time.monotonic())
            self._streams[sender] = stream
        has_room = stream.received < MAX_CANDIDATE_BYTES or len(self._streams) == 1
        return stream if has_room else None

    def _keep_pace(self, size: int, now_s: float) -> None:
        """Wait where more comes than a receiver sends: its disk and processor time are bounded."""
        self._due_s = max(self._due_s, now_s - BURST_S) + size / MAX_BYTES_PER_S
        if self._due_s > now_s:
            self.flooded_s = now_s
            self.thread.stopping.wait(self._due_s - now_s)
