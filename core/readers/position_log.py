"""What a log of one receiver's positions is to the user, whatever form it has."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar, Self

import numpy as np

from furrowmap.core.readers.epochs import week_face
from furrowmap.core.readers.facts import jump_notices, position_facts, timing_facts, utc_facts
from furrowmap.core.readers.reader import ClockReading, FileReader, Inspection
from furrowmap.core.readers.source import Source, cut_notice
from furrowmap.core.values.errors import InputError, Notice
from furrowmap.core.values.gnss import GnssTrack
from furrowmap.core.values.scan import Clock


@dataclass(frozen=True)
class Positions:
    """What a log comes to.

    Attributes:
        track: the positions; while `dated` is False, its times count from the beginning of an unknown day or week.
        dated: whether the times are UTC.
        without_position: epochs that state none.
        dropped: positions whose time does not run forward.
        facts: what `inspect` tells beside these.
        notices: what is odd.
        fault: why the positions cannot be used, if they cannot.
        scale: by what the times are UTC, in words.
    """

    track: GnssTrack
    dated: bool
    without_position: int
    dropped: int
    facts: Mapping[str, Any]
    notices: tuple[Notice, ...]
    fault: InputError | None
    scale: str = ""

    @classmethod
    def none(cls, name: str, fault: InputError, *, without_position: int = 0) -> Self:
        """No positions, and why."""
        return cls(GnssTrack.build(np.empty(0), source=name), False, without_position, 0, {}, (), fault)  # noqa: FBT003


class PositionLog(FileReader, ABC):
    """A reader of one receiver's positions."""

    format: ClassVar[str]
    title: ClassVar[str]

    @abstractmethod
    def _read(self, paths: list[Path]) -> Positions:
        """The positions of some of the files; what is odd about the files goes into `notices`.

        Raises:
            InputError: if a file cannot be read.
        """

    def _face(self, t_s: float) -> str:
        """A time without a date, in words."""
        return f"{week_face(t_s)} (GPS time, no date)"

    def track(self) -> GnssTrack:
        """All positions of all files.

        Raises:
            InputError: if there are none, if they carry no date and none is known, or if two receivers wrote them.
        """
        positions = self._positions(self.paths)
        if positions.fault is not None:
            raise positions.fault
        return positions.track

    def inspect(self) -> Inspection:
        """Read the first file through and say what it is and holds; times without a date are told as they are.

        Raises:
            InputError: if the file cannot be read.
        """
        positions = self._positions(self.paths[:1])
        track = positions.track
        facts: dict[str, Any] = {
            **positions.facts,
            "epochs": len(track),
            "epochs_without_position": positions.without_position,
            "epochs_dropped": positions.dropped,
        }
        clocks: tuple[ClockReading, ...] = ()
        if positions.dated and len(track):
            facts |= utc_facts(track.t_s)
            note = f"{positions.scale}; GPS time is {facts['gps_minus_utc_s']} s ahead of UTC"
            clocks = (ClockReading(Clock.GNSS, float(track.t_s[0]), float(track.t_s[-1]), note),)
        elif len(track):
            facts |= {"first": self._face(float(track.t_s[0])), "last": self._face(float(track.t_s[-1]))}
        facts |= timing_facts(track.t_s) | position_facts(track)
        fault = [Notice.of(positions.fault)] if positions.fault is not None else []
        return Inspection(self.paths[0], self.format, self.title, facts, clocks, (*self.notices, *fault))

    def _sources(self, paths: list[Path]) -> Iterator[Source]:
        """Each file, open; where one ends too early is taken down in `notices`."""
        for path in paths:
            with Source(path) as source:
                yield source
            if source.fault:
                self.notices.append(cut_notice(path, source.fault))

    def _positions(self, paths: list[Path]) -> Positions:
        self.notices = []
        positions = self._read(paths)
        self.notices += [*positions.notices, *jump_notices(positions.track)]
        return positions


def log_name(paths: Sequence[Path]) -> str:
    """What the files of one recording are called together in messages."""
    return str(paths[0]) if len(paths) == 1 else f"{paths[0]} and {len(paths) - 1} more"


def file_at(paths: Sequence[Path], ends: Sequence[int], at: int) -> tuple[Path, int]:
    """The file in which a place lies, and where in it.

    Args:
        paths: files that were read as one stream.
        ends: where in that stream each of them ends.
        at: the place in the stream, before the end of the last.
    """
    k = next(k for k, end in enumerate(ends) if at < end)
    return paths[k], at - (ends[k - 1] if k else 0)
