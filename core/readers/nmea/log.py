"""NMEA 0183 logs of GNSS receivers: GGA, RMC, GST, VTG, HDT (THS) and ZDA, with whatever stands between them."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, ClassVar, Final

from furrowmap.core.readers.facts import jump_notices, position_facts, timing_facts, utc_facts
from furrowmap.core.readers.nmea.sentences import Kind, Sentences, Tally, read_sentences, scan_bytes
from furrowmap.core.readers.nmea.track import Epochs, assemble, clock_face
from furrowmap.core.readers.reader import ClockReading, Inspection, ReadOptions
from furrowmap.core.readers.source import Head, Source
from furrowmap.core.values.errors import Notice
from furrowmap.core.values.gnss import GnssTrack
from furrowmap.core.values.scan import Clock

MOST_OTHER_BYTES: Final = 0.5
"""Share of foreign bytes up to which a file is an NMEA log by that alone."""
LEAST_NMEA_BYTES: Final = 0.02
"""Share of sentences from which on a binary log with positions in GGA is read for them."""
TOLD_OTHER_BYTES: Final = 0.01


class NmeaLog:
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

    def __init__(self, paths: Sequence[Path], options: ReadOptions) -> None:
        self.paths = list(paths)
        self.options = options
        self.notices: list[Notice] = []

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

    def track(self) -> GnssTrack:
        """All positions of all files.

        Raises:
            InputError: if there are none, if they carry no date and none is known, or if two receivers wrote them under
                one name.
        """
        _, epochs = self._read(self.paths)
        if epochs.fault is not None:
            raise epochs.fault
        return epochs.track

    def inspect(self) -> Inspection:
        """Read the first file through and say what it is and holds; a log without a date is told by times of day.

        Raises:
            InputError: if the file cannot be read.
        """
        tally, epochs = self._read(self.paths[:1])
        track = epochs.track
        facts: dict[str, Any] = {
            "talkers": _by(tally, lambda address: "proprietary" if address.startswith("P") else address[:2]),
            "sentences": _by(tally, lambda address: address if address.startswith("P") else address[2:]),
            "intact": tally.intact,
            "bad_checksums": tally.bad_checksums,
            "cut_or_without_checksum": tally.cut,
            "begun_in_mid_line": tally.behind_cut,
            "other_bytes": tally.other_bytes,
            "positions_by_talker": epochs.positions_by_talker,
            "epochs": len(track),
            "epochs_without_position": epochs.without_position,
            "epochs_dropped": epochs.backward + epochs.repeated,
        }
        clocks: tuple[ClockReading, ...] = ()
        if epochs.dated and len(track):
            facts |= utc_facts(track.t_s)
            note = f"UTC by its sentences; GPS time is {facts['gps_minus_utc_s']} s ahead"
            clocks = (ClockReading(Clock.GNSS, float(track.t_s[0]), float(track.t_s[-1]), note),)
        elif len(track):
            facts |= {
                "first": f"{clock_face(track.t_s[0])} (no date)",
                "last": f"{clock_face(track.t_s[-1])} (no date)",
            }
        facts |= timing_facts(track.t_s) | position_facts(track)
        notices = list(self.notices)
        if epochs.fault is not None:
            notices.append(
                Notice(epochs.fault.code, f"{epochs.fault.what} {epochs.fault.meaning} {epochs.fault.remedy}")
            )
        return Inspection(self.paths[0], self.format, self.title, facts, clocks, tuple(notices))

    def _read(self, paths: list[Path]) -> tuple[Tally, Epochs]:
        tally = Tally()
        parts: list[Sentences] = []
        ends: list[int] = []
        self.notices = []
        for path in paths:
            with Source(path) as source:
                parts += read_sentences(source, tally, tally.stream_bytes)
                fault = source.fault
            ends.append(tally.stream_bytes)
            if fault:
                self.notices.append(Notice("stream-cut", f"{path}: {fault}; what came before is used."))

        def place(at: int) -> str:
            file = next(k for k, end in enumerate(ends) if at < end)
            return f"{paths[file]}, byte {at - (ends[file - 1] if file else 0)}"

        name = str(paths[0]) if len(paths) == 1 else f"{paths[0]} and {len(paths) - 1} more"
        sentences = Sentences.joined(parts)
        parts.clear()  # else a long log is held twice
        epochs = assemble(sentences, name, date=self.options.date, near_s=self.options.near_s, place=place)
        self.notices += _tally_notices(tally, name) + list(epochs.notices) + jump_notices(epochs.track)
        return tally, epochs


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
