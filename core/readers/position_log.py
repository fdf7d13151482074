"""Logs of one receiver's positions: what all formats have in common, and what binary ones (UBX, SBF) have."""

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, ClassVar, Final, Self

import numpy as np
from numpy.typing import NDArray

from furrowmap.core.readers.epochs import MAX_BACKWARD_SHARE, timing_facts, utc_facts, week_time
from furrowmap.core.readers.facts import jump_notices, position_facts
from furrowmap.core.readers.framed_messages import Framing, Kind, MessageCounts, Messages, find_frames, read_messages
from furrowmap.core.readers.implausible_positions import drop_implausible_positions
from furrowmap.core.readers.reader import FileReader, Inspection, ReadOptions, recording_name
from furrowmap.core.readers.source import Head, Piece, Source, cut_notice
from furrowmap.core.runtime.arrays import FloatArray
from furrowmap.core.runtime.errors import InputError, Notice
from furrowmap.core.runtime.languages.texts import Text, Words
from furrowmap.core.values.clock import iso_utc, runs_forward
from furrowmap.core.values.gnss import Fix, GnssTrack
from furrowmap.core.values.scan import Clock, ClockReading

MAX_SPLICES: Final = 4
"""Largest number of steps back in a log whose parts are in the wrong order; more are those of two receivers."""
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
            rate_hz=1.0 / interval,
            longest_gap_s=step[worst],
            gap_begins=when(float(t_s[worst])),
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


MIN_INTACT_SHARE: Final = 0.02
"""Share of intact frames in a file's head from which a file without positions is recognised."""


class ReceiverLog(PositionLog):
    """The positions in a log of binary messages of a fixed layout; other bytes between them are skipped.

    Of the options, `date`, `near_s` and `week` are used where the messages carry no date.
    """

    frames_title: ClassVar[str]
    """What a frame is called, in the plural; also its name among the facts."""
    framing: ClassVar[Framing]
    layouts: ClassVar[Mapping[int, np.dtype[np.void]]]
    """The beginning of each kind of message that is read: what all its versions have."""
    certainty: ClassVar[Mapping[int, float]]
    """How certain a file is of this format by one intact message of a kind with positions."""

    @classmethod
    def recognise(cls, head: Head) -> float:
        """By intact messages with positions; possible (0.3) where there are others."""
        if cls.framing.sync not in head.data:
            return 0.0
        frames = find_frames(np.frombuffer(head.data, np.uint8), cls.framing)
        kinds = set(frames.kind.tolist())
        possible = 0.3 if frames.intact_bytes >= MIN_INTACT_SHARE * len(head.data) else 0.0
        return max((score for kind, score in cls.certainty.items() if kind in kinds), default=possible)

    @abstractmethod
    def _epochs(self, messages: Mapping[int, Messages], name: str, place: Callable[[int], str]) -> LoggedPositions:
        """The positions in the messages."""

    @classmethod
    @abstractmethod
    def _name_of(cls, kind: int) -> str:
        """Name of a kind of message."""

    @abstractmethod
    def _no_position_messages(self, name: str, frames: Words, counts: MessageCounts[int]) -> InputError:
        """The error of a log without messages with positions; `frames` describes those it has."""

    def _read(self, paths: list[Path]) -> LoggedPositions:
        counts = MessageCounts[int]()
        parts: dict[int, list[Messages]] = {kind: [] for kind in self.layouts}
        ends: list[int] = []
        for source in self._sources(paths):
            for kind, pieces in read_messages(source, self.framing, self.layouts, counts).items():
                parts[kind] += pieces
            ends.append(counts.stream_bytes)
        name = recording_name(paths)
        messages = {kind: Messages.joined(pieces, self.layouts[kind]) for kind, pieces in parts.items()}
        if any(len(messages[kind]) for kind in self.certainty):
            positions = self._epochs(messages, name, byte_place(paths, ends))
        else:
            names = [self._name_of(kind) for kind, _ in counts.kinds.most_common(4)]
            frames = Text("{names:its {title} are {names}|no intact {title}}", names=names, title=self.frames_title)
            positions = LoggedPositions.none(name, self._no_position_messages(name, frames, counts))
        self.notices += damage_notices(counts, name)
        facts = log_facts(counts, self.frames_title, self._name_of) | dict(positions.facts)
        return replace(positions, facts=facts, scale="UTC from its messages")


def damage_notices(counts: MessageCounts[Kind], name: str) -> Iterator[Notice]:
    """A notice of the messages of a log that are damaged, if any are."""
    if counts.bad or counts.cut or counts.foreign_bytes:
        yield Notice(
            "messages-damaged",
            name=name,
            bad=counts.bad,
            cut=counts.cut,
            foreign_bytes=counts.foreign_bytes,
            intact=counts.intact,
        )


def log_facts(counts: MessageCounts[Kind], title: str, name_of: Callable[[Kind], str]) -> dict[str, Any]:
    """Facts of the messages of a log, called `title`."""
    return {
        title: {name_of(kind): count for kind, count in counts.kinds.most_common()},
        "intact": counts.intact,
        "bad_checksums": counts.bad,
        "cut": counts.cut,
        "other_bytes": counts.other_bytes,
    }


def has_position(columns: Mapping[str, NDArray[Any]]) -> NDArray[np.bool_]:
    """Which epochs (n,) have a fix and a place."""
    has: NDArray[np.bool_] = np.isfinite(columns["lon_deg"] + columns["lat_deg"]) & (columns["fix"] != Fix.NONE)
    return has


def dated_positions(
    columns: Mapping[str, NDArray[Any]],
    at: NDArray[np.int64],
    place: Callable[[int], str],
    *,
    name: str,
    what: Words,
    facts: Mapping[str, Any],
    service: str = "",
    notices: Sequence[Notice] = (),
) -> LoggedPositions:
    """The positions of epochs with a fix, a place and a time.

    Args:
        columns: (n,) each, as in :meth:`LoggedPositions.in_order`; times are UTC, nan if unknown.
        at: (n,) offset of each epoch in the stream.
        what: the messages that the epochs come from, for an error.
    """
    stated = has_position(columns) & np.isfinite(columns["t_s"])
    without = int(np.sum(~stated))
    if not stated.any():
        fault = no_valid_positions(name, len(at), what)
        return replace(LoggedPositions.none(name, fault, without_position=without), facts=facts)
    at = at[stated]
    positions = LoggedPositions.in_order(
        {column: values[stated] for column, values in columns.items()},
        lambda k: place(int(at[k])),
        name=name,
        service=service,
        without_position=without,
        notices=notices,
    )
    return replace(positions, facts=facts, scale="UTC from its messages")


def no_valid_positions(name: str, count: int, frames: Words) -> InputError:
    """The error of a log whose position messages are all without a valid position."""
    return InputError("no-positions.none-valid", name=name, count=count, frames=frames)


def in_order(
    t_s: FloatArray, lon_deg: FloatArray, lat_deg: FloatArray, name: str, place: Callable[[int], str]
) -> tuple[NDArray[np.bool_], list[Notice]]:
    """Which epochs (n,) are later than all before, and notices about the others; `place` describes where epoch k is.

    An epoch that repeats time and position of the one before was written twice and is not out of order. InputError if
    more than a twentieth of the epochs are out of order.
    """
    forward = runs_forward(t_s)
    repeated = np.zeros(len(t_s), bool)
    repeated[1:] = (np.diff(t_s) == 0) & (np.diff(lon_deg) == 0) & (np.diff(lat_deg) == 0)
    backward = ~forward & ~repeated
    if backward.sum() > MAX_BACKWARD_SHARE * len(t_s):
        first = place(int(np.flatnonzero(backward)[0]))
        steps_back = int(np.sum(np.diff(t_s) <= 0))
        if steps_back > max(MAX_SPLICES, 0.01 * len(t_s)):
            raise InputError("receivers-interleaved", first=first, steps_back=steps_back, positions=len(t_s))
        raise InputError("time-disorder.disorder", first=first, backward=int(backward.sum()), positions=len(t_s))
    notices = []
    if backward.any():
        widest_s = float(-np.diff(t_s).min(initial=0.0))
        notices.append(
            Notice(
                "time-runs-back.repeated-positions",
                name=name,
                backward=int(backward.sum()),
                positions=len(t_s),
                widest_s=widest_s,
            )
        )
    if repeated.any():
        notices.append(Notice("positions-repeated", name=name, repeated=int(repeated.sum())))
    return forward, notices
