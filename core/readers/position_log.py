"""Logs of one receiver's positions: what all formats have in common."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final, Self

import numpy as np
from numpy.typing import NDArray

from furrowmap.core.readers.epochs import in_order, week_time
from furrowmap.core.readers.facts import jump_notices, position_facts, timing_facts, utc_facts
from furrowmap.core.readers.implausible_positions import drop_implausible_positions
from furrowmap.core.readers.reader import FileReader, Inspection, ReadOptions
from furrowmap.core.readers.source import Piece, Source, cut_notice
from furrowmap.core.runtime.errors import InputError, Notice
from furrowmap.core.values.clock import iso_utc
from furrowmap.core.values.clock_readings import ClockReading
from furrowmap.core.values.gnss import GnssTrack
from furrowmap.core.values.scan import Clock

MIN_STEPS: Final = 10
MIN_REGULAR_SHARE: Final = 0.8
"""Least share of steps of the usual length in a log of a regular rate."""


@dataclass(frozen=True)
class LoggedPositions:
    """The positions in a log, and what was found about them.

    Attributes:
        track: the positions; if `dated` is False, their times count from the start of an unknown day or week.
        facts: what `inspect` reports besides these.
        fault: why the positions cannot be used, if they cannot.
        scale: where the UTC times come from, for `inspect`.
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

    @classmethod
    def in_order(
        cls,
        columns: Mapping[str, NDArray[Any]],
        place: Callable[[int], str],
        *,
        name: str,
        service: str = "",
        without_position: int = 0,
        notices: Sequence[Notice] = (),
        fault: InputError | None = None,
    ) -> Self:
        """The positions whose times increase; none, with the error as `fault`, if too many are out of order.

        Args:
            columns: (n,) each: `t_s` and columns of :class:`GnssTrack`, in the order of the log.
            place: describes where position k is in the log.
            fault: why the times are not UTC, if they are not.
        """
        try:
            forward, disorder = in_order(columns["t_s"], columns["lon_deg"], columns["lat_deg"], name, place)
        except InputError as error:
            return replace(cls.none(name, error, without_position=without_position), notices=tuple(notices))
        return cls(
            track=GnssTrack.build(
                source=name, service=service, **{column: values[forward] for column, values in columns.items()}
            ),
            dated=fault is None,
            without_position=without_position,
            dropped=int(np.sum(~forward)),
            facts={},
            notices=(*notices, *disorder),
            fault=fault,
        )


class PositionLog(FileReader, ABC):
    """A reader of one receiver's positions."""

    _piece: bytes | None = None

    @classmethod
    def of_bytes(cls, data: bytes, near_s: float) -> LoggedPositions:
        """The positions in a piece of a log; `near_s` is a UTC time near it, for logs without dates."""
        log = cls([Path("stream")], ReadOptions(near_s=near_s))
        log._piece = data
        return log._read(log.paths)

    @abstractmethod
    def _read(self, paths: list[Path]) -> LoggedPositions:
        """The positions of some of the files; damage to the files is added to `notices`."""

    def _undated(self, t_s: float) -> str:
        """A time without a date, for `inspect`."""
        return f"{week_time(t_s)} (GPS time, no date)"

    def track(self) -> GnssTrack:
        """All positions of all files; InputError if there are none, undated ones, or those of two receivers."""
        positions = self._positions(self.paths)
        if positions.fault is not None:
            raise positions.fault
        return positions.track

    def inspect(self) -> Inspection:
        """Read the whole first file and report what it contains; times without a date are reported as they are."""
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
            facts |= {"first": self._undated(float(track.t_s[0])), "last": self._undated(float(track.t_s[-1]))}
        facts |= timing_facts(track.t_s) | position_facts(track)
        fault = [Notice.from_error(positions.fault)] if positions.fault is not None else []
        return Inspection(self.paths[0], self.format, self.title, facts, clocks, (*self.notices, *fault))

    def _sources(self, paths: list[Path]) -> Iterator[Source]:
        """Each file, open; a truncated one is reported in `notices`."""
        for path in paths:
            with Source(path) if self._piece is None else Piece(self._piece) as source:
                yield source
            if source.fault:
                self.notices.append(cut_notice(path, source.fault))

    def _positions(self, paths: list[Path]) -> LoggedPositions:
        self.notices = []
        positions = self._read(paths)
        when = iso_utc if positions.dated else self._undated
        self.notices += positions.notices
        try:
            track, _, notices = drop_implausible_positions(positions.track, when)
        except InputError as fault:
            return replace(LoggedPositions.none(positions.track.source, fault), facts=positions.facts)
        self.notices += [*notices, *jump_notices(track, when), *_missing(positions, when)]
        return replace(positions, track=track)


def _missing(positions: LoggedPositions, when: Callable[[float], str]) -> list[Notice]:
    """A notice of epochs that are not in a log of a regular rate, besides those without a position."""
    t_s = positions.track.t_s
    step = np.diff(t_s)
    if len(step) < MIN_STEPS:
        return []
    interval = float(np.median(step))
    if np.mean(np.abs(step - interval) < 0.1 * interval) < MIN_REGULAR_SHARE:
        return []
    lost = np.round(step / interval).astype(np.int64) - 1
    count = int(lost.sum()) - positions.without_position - positions.dropped
    if count <= 0:
        return []
    worst = int(np.argmax(step))
    return [
        Notice(
            "epochs-missing",
            source=positions.track.source,
            count=count,
            count_min=min(count, int((lost > 0).sum())),
            interval=1.0 / interval,
            step=step[worst],
            t_s=when(float(t_s[worst])),
        )
    ]


def file_at(paths: Sequence[Path], ends: Sequence[int], at: int) -> tuple[Path, int]:
    """The file that an offset of a stream belongs to, and the offset in that file.

    `ends` are the offsets where files end.
    """
    k = next(k for k, end in enumerate(ends) if at < end)
    return paths[k], at - (ends[k - 1] if k else 0)


def byte_place(paths: Sequence[Path], ends: Sequence[int]) -> Callable[[int], str]:
    """Describes a byte offset in files that were read as one stream: file and byte; see :func:`file_at`."""

    def place(at: int) -> str:
        path, byte = file_at(paths, ends, at)
        return f"{path}, byte {byte}"

    return place
