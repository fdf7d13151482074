"""NMEA 0183 logs of GNSS receivers: GGA, RMC, GST, VTG, HDT (THS) and ZDA, with whatever stands between them."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import ClassVar, Final

from furrowmap.core.readers.nmea.sentences import Kind, Sentences, Tally, read_sentences, scan_bytes
from furrowmap.core.readers.nmea.track import assemble, clock_face
from furrowmap.core.readers.position_log import PositionLog, Positions, byte_place, log_name
from furrowmap.core.readers.source import Head
from furrowmap.core.values.errors import Notice

MOST_OTHER_BYTES: Final = 0.5
"""Share of foreign bytes up to which a file is an NMEA log by that alone."""
LEAST_NMEA_BYTES: Final = 0.02
"""Share of sentences from which on a binary log with positions in GGA is read for them."""
TOLD_OTHER_BYTES: Final = 0.01


class NmeaLog(PositionLog):
    """The positions in a log of NMEA 0183 sentences.

    Sentences are found at every ``$`` and believed if their checksum is right, so neither noise nor binary messages
    between them matter. The height above the ellipsoid is altitude + geoid separation. Times are UTC; the day comes
    from RMC or ZDA, else from `ReadOptions.date` or `ReadOptions.near_s`.

    Args:
        paths: the files of one recording, in the order of time.
        options: `date` and `near_s` are used.
    """

    format: ClassVar[str] = "nmea"
    title: ClassVar[str] = "NMEA 0183 log"

    @classmethod
    def recognise(cls, head: Head) -> float:
        """Certain where most of the file is sentences; possible where GGA stands between other things."""
        if b"$" not in head.data:
            return 0.0
        tally = Tally()
        sentences, _ = scan_bytes(head.data, tally)
        share = tally.nmea_bytes / len(head.data)
        if len(sentences) and share >= MOST_OTHER_BYTES:
            return 0.9
        return 0.6 if share >= LEAST_NMEA_BYTES and len(sentences.of(Kind.GGA)) else 0.0

    def _undated(self, t_s: float) -> str:
        return f"{clock_face(t_s)} (no date)"

    def _read(self, paths: list[Path]) -> Positions:
        tally = Tally()
        parts: list[Sentences] = []
        ends: list[int] = []
        for source in self._sources(paths):
            parts += read_sentences(source, tally, tally.stream_bytes)
            ends.append(tally.stream_bytes)
        name = log_name(paths)
        sentences = Sentences.joined(parts)
        parts.clear()  # else a long log is held twice
        date, near_s = self.options.date, self.options.near_s
        positions = assemble(sentences, name, date=date, near_s=near_s, place=byte_place(paths, ends))
        self.notices += _tally_notices(tally, name)
        facts = {
            "talkers": _by(tally, lambda address: "proprietary" if address.startswith("P") else address[:2]),
            "sentences": _by(tally, lambda address: address if address.startswith("P") else address[2:]),
            "intact": tally.intact,
            "bad_checksums": tally.bad_checksums,
            "cut_or_without_checksum": tally.cut,
            "begun_in_mid_line": tally.behind_cut,
            "other_bytes": tally.other_bytes,
            **positions.facts,
        }
        return replace(positions, facts=facts, scale="UTC from its sentences")


def _by(tally: Tally, part: Callable[[str], str]) -> dict[str, int]:
    """Intact sentences counted by a part of their address, most first."""
    counts: Counter[str] = Counter()
    for address, count in tally.addresses.items():
        counts[part(address)] += count
    return dict(counts.most_common())


def _tally_notices(tally: Tally, name: str) -> list[Notice]:
    notices = []
    if tally.bad_checksums or tally.cut:
        notices.append(
            Notice(
                "sentences-damaged",
                f"{name}: {tally.intact} sentences are intact; {tally.bad_checksums} with a wrong checksum and "
                f"{tally.cut} cut short or without one are not used.",
            )
        )
    if tally.other_bytes > TOLD_OTHER_BYTES * tally.stream_bytes:
        share = 100.0 * tally.other_bytes / tally.stream_bytes
        notices.append(
            Notice(
                "bytes-skipped",
                f"{name}: {tally.other_bytes} bytes ({share:.0f} %) are no NMEA sentences (comments, noise or a "
                f"receiver's binary messages) and are skipped.",
            )
        )
    return notices
