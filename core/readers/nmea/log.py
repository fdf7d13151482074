"""NMEA 0183 logs of GNSS receivers: GGA or GNS, RMC, GST, VTG, HDT (THS) and ZDA."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import ClassVar, Final

from furrowmap.core.readers.nmea.sentences import Kind, SentenceCounts, Sentences, read_sentences, scan_bytes
from furrowmap.core.readers.nmea.track import assemble, time_of_day
from furrowmap.core.readers.position_log import LoggedPositions, PositionLog, byte_place
from furrowmap.core.readers.reader import recording_name
from furrowmap.core.readers.source import Head
from furrowmap.core.runtime.errors import Notice

MOST_OTHER_BYTES: Final = 0.5
"""Largest share of other bytes in a file that is recognised by its sentences alone."""
LEAST_NMEA_BYTES: Final = 0.02
"""Smallest share of sentences in a binary log that is recognised by its GGA or GNS sentences."""
NOTED_OTHER_BYTES: Final = 0.01
"""Share of other bytes from which a notice reports them."""


class NmeaLog(PositionLog):
    """The positions in a log of NMEA 0183 sentences.

    Sentences may begin at every ``$`` and need a valid checksum, so noise and binary messages between them are skipped.
    The height above the ellipsoid is altitude + geoid separation. Times are UTC; the date comes from RMC or ZDA, else
    from `ReadOptions.date` or `ReadOptions.near_s`.

    Args:
        paths: the files of one recording, in the order of time.
        options: `date` and `near_s` are used.
    """

    format: ClassVar[str] = "nmea"
    title: ClassVar[str] = "NMEA 0183 log"

    @classmethod
    def recognise(cls, head: Head) -> float:
        """Certain if most of the file is sentences; possible with GGA or GNS among other bytes."""
        if b"$" not in head.data:
            return 0.0
        counts = SentenceCounts()
        sentences, _ = scan_bytes(head.data, counts)
        share = counts.message_bytes / len(head.data)
        if len(sentences) and share >= MOST_OTHER_BYTES:
            return 0.9
        return 0.6 if share >= LEAST_NMEA_BYTES and _with_epochs(sentences) else 0.0

    def _undated(self, t_s: float) -> str:
        return f"{time_of_day(t_s)} (no date)"

    def _read(self, paths: list[Path]) -> LoggedPositions:
        counts = SentenceCounts()
        parts: list[Sentences] = []
        ends: list[int] = []
        for source in self._sources(paths):
            parts += read_sentences(source, counts, counts.stream_bytes)
            ends.append(counts.stream_bytes)
        name = recording_name(paths)
        sentences = Sentences.joined(parts)
        parts.clear()  # else memory holds a long log twice
        date, near_s = self.options.date, self.options.near_s
        positions = assemble(sentences, name, date=date, near_s=near_s, place=byte_place(paths, ends))
        self.notices += _damage_notices(counts, name)
        facts = {
            "talkers": _by(counts, lambda address: "proprietary" if address.startswith("P") else address[:2]),
            "sentences": _by(counts, lambda address: address if address.startswith("P") else address[2:]),
            "intact": counts.intact,
            "bad_checksums": counts.bad,
            "cut_or_without_checksum": counts.cut,
            "begun_in_mid_line": counts.behind_cut,
            "other_bytes": counts.other_bytes,
            **positions.facts,
        }
        return replace(positions, facts=facts, scale="UTC from its sentences")


def _with_epochs(sentences: Sentences) -> bool:
    return bool(len(sentences.of(Kind.GGA)) or len(sentences.of(Kind.GNS)))


def _by(counts: SentenceCounts, part: Callable[[str], str]) -> dict[str, int]:
    """Number of intact sentences by a part of their address, in descending order."""
    by_part: Counter[str] = Counter()
    for address, count in counts.kinds.items():
        by_part[part(address)] += count
    return dict(by_part.most_common())


def _damage_notices(counts: SentenceCounts, name: str) -> list[Notice]:
    notices = []
    if counts.bad or counts.cut:
        notices.append(Notice("sentences-damaged", name=name, bad=counts.bad, cut=counts.cut, intact=counts.intact))
    if counts.other_bytes > NOTED_OTHER_BYTES * counts.stream_bytes:
        share = 100.0 * counts.other_bytes / counts.stream_bytes
        notices.append(Notice("bytes-skipped", name=name, other_bytes=counts.other_bytes, share=share))
    return notices
