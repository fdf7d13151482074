"""What a receiver's own binary log is to the user, whichever maker's it is."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from furrowmap.core.readers.epochs import week_face
from furrowmap.core.readers.facts import jump_notices, position_facts, timing_facts, utc_facts
from furrowmap.core.readers.frames import Records, Scan, Tally, joined, read_records
from furrowmap.core.readers.reader import ClockReading, Inspection, ReadOptions
from furrowmap.core.readers.source import Source
from furrowmap.core.values.errors import InputError, Notice
from furrowmap.core.values.gnss import GnssTrack
from furrowmap.core.values.scan import Clock


@dataclass(frozen=True)
class Epochs:
    """What the messages of a log come to.

    Attributes:
        track: the positions; its times are those of the GPS week while `dated` is False.
        dated: whether the times are UTC.
        without_position: epochs that state none.
        dropped: positions whose time does not run forward.
        facts: what else `inspect` tells.
        notices: what is odd.
        fault: why the positions cannot be used, if they cannot.
    """

    track: GnssTrack
    dated: bool
    without_position: int
    dropped: int
    facts: Mapping[str, Any]
    notices: tuple[Notice, ...]
    fault: InputError | None

    @classmethod
    def none(cls, name: str, fault: InputError, *, without_position: int = 0) -> Epochs:
        """No positions, and why."""
        return cls(GnssTrack.build(np.empty(0), source=name), False, without_position, 0, {}, (), fault)  # noqa: FBT003


class ReceiverLog(ABC):
    """The positions in a log of binary messages of fixed layout, with whatever stands between them.

    Args:
        paths: the files of one recording, in the order of time.
        options: `date`, `near_s` and `week` are used where the messages carry no date.
    """

    format: ClassVar[str]
    title: ClassVar[str]
    messages: ClassVar[str]
    """What the frames are called, in the plural."""
    layouts: ClassVar[Mapping[int, np.dtype[np.void]]]
    find: ClassVar[Scan]

    def __init__(self, paths: Sequence[Path], options: ReadOptions) -> None:
        self.paths = list(paths)
        self.options = options
        self.notices: list[Notice] = []

    @abstractmethod
    def _epochs(self, records: Mapping[int, Records], tally: Tally, name: str, place: Callable[[int], str]) -> Epochs:
        """The positions of the messages; `place` has words for where in the stream something stands."""

    @abstractmethod
    def _names(self, kinds: Sequence[int]) -> dict[int, str]:
        """Names of kinds of messages."""

    def track(self) -> GnssTrack:
        """All positions of all files.

        Raises:
            InputError: if there are none, if they carry no date and none is known, or if two receivers wrote them.
        """
        _, epochs = self._read(self.paths)
        if epochs.fault is not None:
            raise epochs.fault
        return epochs.track

    def inspect(self) -> Inspection:
        """Read the first file through and say what it is and holds; a log without a date is told by times of the week.

        Raises:
            InputError: if the file cannot be read.
        """
        tally, epochs = self._read(self.paths[:1])
        track = epochs.track
        names = self._names(list(tally.kinds))
        facts: dict[str, Any] = {
            self.messages: {names[kind]: count for kind, count in tally.kinds.most_common()},
            "intact": tally.intact,
            "bad_checksums": tally.bad_checksums,
            "cut": tally.cut,
            "other_bytes": tally.other_bytes,
            "epochs": len(track),
            "epochs_without_position": epochs.without_position,
            "epochs_dropped": epochs.dropped,
            **epochs.facts,
        }
        clocks: tuple[ClockReading, ...] = ()
        if epochs.dated and len(track):
            facts |= utc_facts(track.t_s)
            note = f"UTC by its messages; GPS time is {facts['gps_minus_utc_s']} s ahead"
            clocks = (ClockReading(Clock.GNSS, float(track.t_s[0]), float(track.t_s[-1]), note),)
        elif len(track):
            facts |= {
                "first": f"{week_face(track.t_s[0])} (GPS time, no date)",
                "last": f"{week_face(track.t_s[-1])} (GPS time, no date)",
            }
        facts |= timing_facts(track.t_s) | position_facts(track)
        notices = list(self.notices)
        if epochs.fault is not None:
            fault = epochs.fault
            notices.append(Notice(fault.code, f"{fault.what} {fault.meaning} {fault.remedy}"))
        return Inspection(self.paths[0], self.format, self.title, facts, clocks, tuple(notices))

    def _read(self, paths: list[Path]) -> tuple[Tally, Epochs]:
        tally = Tally()
        parts: dict[int, list[Records]] = {kind: [] for kind in self.layouts}
        ends: list[int] = []
        self.notices = []
        for path in paths:
            with Source(path) as source:
                found = read_records(source, type(self).find, self.layouts, tally, tally.stream_bytes)
                fault = source.fault
            for kind, pieces in found.items():
                parts[kind] += pieces
            ends.append(tally.stream_bytes)
            if fault:
                self.notices.append(Notice("stream-cut", f"{path}: {fault}; what came before is used."))

        def place(at: int) -> str:
            file = next(k for k, end in enumerate(ends) if at < end)
            return f"{paths[file]}, byte {at - (ends[file - 1] if file else 0)}"

        name = str(paths[0]) if len(paths) == 1 else f"{paths[0]} and {len(paths) - 1} more"
        records = {kind: joined(pieces, self.layouts[kind]) for kind, pieces in parts.items()}
        epochs = self._epochs(records, tally, name, place)
        if tally.bad_checksums or tally.cut:
            self.notices.append(
                Notice(
                    "messages-damaged",
                    f"{name}: {tally.intact} messages are intact; {tally.bad_checksums} with a wrong checksum or "
                    f"length and {tally.cut} that the log's end cuts are not used.",
                )
            )
        self.notices += [*epochs.notices, *jump_notices(epochs.track)]
        return tally, epochs


def sound(columns: Mapping[str, NDArray[np.float64]]) -> NDArray[np.bool_]:
    """Which epochs (n,) state a place on the earth: finite, no pole passed, no height beyond 100 km."""
    lon, lat, height = (columns[name] for name in ("lon_deg", "lat_deg", "height_m"))
    with np.errstate(invalid="ignore"):
        return (np.abs(lon) <= 360.0) & (np.abs(lat) <= 90.0) & ~(np.abs(height) > 1e5)
