"""Sentence messages (nmea_msgs) to positions, with the same assembly as logs of NMEA 0183."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from furrowmap.core.readers.nmea.log import assemble
from furrowmap.core.readers.nmea.sentences import Kind, SentenceCounts, scan_bytes
from furrowmap.core.readers.position_log import LoggedPositions
from furrowmap.core.readers.rosbag.messages import stamp_s
from furrowmap.core.readers.rosbag.storage import BagMessage
from furrowmap.core.values.clock import DAY_S, nearest_in_cycle


class SentenceLog:
    """LoggedPositions collected from the sentences of one topic.

    Times are those of the sentences; a log without dates has the date of the stamps.
    """

    def __init__(self) -> None:
        self._lines: list[bytes] = []
        self._received_s: list[float] = []
        self._first_s = 0.0

    def add(self, content: Any, message: BagMessage) -> None:
        """Add one message."""
        if not self._lines:
            self._first_s = stamp_s(content, message)
        self._lines.append(content.sentence.encode("latin-1", "replace").strip() + b"\r\n")
        self._received_s.append(message.received_ns * 1e-9)

    def positions(self, source: str, date: str | None) -> LoggedPositions:
        """The positions of the receiver; see :func:`~furrowmap.core.readers.nmea.log.assemble`.

        Raises:
            InputError: if `date` is not a date.
        """

        def place(at: int) -> str:
            return f"{source}, message {self._message(np.array([at]))[0]}"

        sentences = scan_bytes(b"".join(self._lines), SentenceCounts())[0]
        return assemble(sentences, source, date=date, near_s=self._first_s, place=place)

    def delay_s(self) -> float:
        """Median of the reception of sentences minus the times in them."""
        sentences = scan_bytes(b"".join(self._lines), SentenceCounts())[0]
        timed = sentences[(sentences.kind == Kind.GGA) | (sentences.kind == Kind.GNS)]
        received = np.array(self._received_s)[self._message(timed.at)]
        return float(np.nanmedian(received - nearest_in_cycle(timed.values[:, 0], received, DAY_S)))

    def _message(self, at: NDArray[np.int64]) -> NDArray[np.intp]:
        """Index of the message with each byte (n,) of the stream."""
        ends = np.cumsum([len(line) for line in self._lines])
        return np.searchsorted(ends, at, side="right")
