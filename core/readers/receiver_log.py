"""Binary logs of GNSS receivers: what UBX and SBF have in common."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, ClassVar, Final

import numpy as np
from numpy.typing import NDArray

from furrowmap.core.readers.messages import Framing, Kind, MessageCounts, Messages, find_frames, read_messages
from furrowmap.core.readers.position_log import LoggedPositions, PositionLog, byte_place
from furrowmap.core.readers.reader import recording_name
from furrowmap.core.readers.source import Head
from furrowmap.core.runtime.errors import InputError, Notice
from furrowmap.core.values.gnss import Fix

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
    def _no_position_messages(self, name: str, frames: str, counts: MessageCounts[int]) -> InputError:
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
            frames = f"its {self.frames_title} are {', '.join(names)}" if names else f"no intact {self.frames_title}"
            positions = LoggedPositions.none(name, self._no_position_messages(name, frames, counts))
        facts = log_facts(counts, self.frames_title, self._name_of, name, self.notices) | dict(positions.facts)
        return replace(positions, facts=facts, scale="UTC from its messages")


def log_facts(
    counts: MessageCounts[Kind], title: str, name_of: Callable[[Kind], str], name: str, notices: list[Notice]
) -> dict[str, Any]:
    """Facts of the messages of a log, called `title`; damage is added to `notices`."""
    if counts.bad or counts.cut or counts.foreign_bytes:
        notices.append(
            Notice(
                "messages-damaged",
                name=name,
                bad=counts.bad,
                cut=counts.cut,
                foreign_bytes=counts.foreign_bytes,
                intact=counts.intact,
            )
        )
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
    what: str,
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


def no_valid_positions(name: str, count: int, frames: str) -> InputError:
    """The error of a log whose position messages are all without a valid position."""
    return InputError("no-positions.no-valid-positions", name=name, count=count, frames=frames)
