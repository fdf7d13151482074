"""Tool states from a table of times or a machine log, and their comparison with those seen by the scanner."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from furrowmap.core.readers.reader import GivesStates, ReadOptions, open_recording
from furrowmap.core.runtime.arrays import FloatArray
from furrowmap.core.runtime.errors import InputError, Notice
from furrowmap.core.runtime.languages.texts import Text
from furrowmap.core.values.clock import iso_utc
from furrowmap.core.values.scan import Clock, ClockReading, likely_offset
from furrowmap.core.values.session import Implement
from furrowmap.core.values.tool_states import ToolState, ToolStates
from furrowmap.core.values.trajectory import Trajectory

NEAR_S: Final = 0.5
"""Shorter differences come from different thresholds of a transition."""
MAX_LISTED: Final = 5
MIN_AGREEING_SHARE: Final = 0.98
SAME_WIDTH: Final = 0.02
"""Share of its width by which an implement and the line of its sections may differ."""


@dataclass(frozen=True)
class StateComparison:
    """Comparison of external states with those seen, over the time in which both are known.

    Attributes:
        share: of it in which they are equal; nan where there is none.
        differing_s: (m, 2) intervals in which they differ.
        seen_down: (m,) whether the tool is seen down in each of these.
    """

    compared_s: float
    share: float
    differing_s: FloatArray
    seen_down: NDArray[np.bool_]

    def notices(self, *, replaced: bool) -> list[Notice]:
        """Notices where states differ for longer than a transition; `replaced`: external states were used."""
        if not self.compared_s:
            return [Notice("states-not-compared", replaced=replaced)]
        length_s = self.differing_s[:, 1] - self.differing_s[:, 0]
        long = np.flatnonzero(length_s > NEAR_S)
        if not len(long) and self.share >= MIN_AGREEING_SHARE:
            return []
        longest = sorted(long[np.argsort(-length_s[long], kind="stable")][:MAX_LISTED].tolist())
        places = tuple(
            Text(
                "{time} for {length_s:.1f} s (seen {down:down|up})",
                time=iso_utc(float(self.differing_s[k, 0])),
                length_s=length_s[k],
                down=bool(self.seen_down[k]),
            )
            for k in longest
        )
        return [
            Notice(
                "states-differ",
                share=self.share,
                compared_s=self.compared_s,
                replaced=replaced,
                near_s=NEAR_S,
                long=len(long),
                places=places or None,
            )
        ]


def compare_states(seen: ToolStates, external: ToolStates) -> StateComparison:
    """Compare two histories of states."""
    cuts = np.unique(np.concatenate([seen.begin_s, seen.end_s, external.begin_s, external.end_s]))
    cuts = cuts[np.isfinite(cuts)]
    begin = cuts[:-1]
    end = cuts[1:]
    middle = 0.5 * (begin + end)
    mine = seen.at(middle)[0]
    theirs = external.at(middle)[0]
    both = (mine != ToolState.UNKNOWN) & (theirs != ToolState.UNKNOWN)
    compared_s = float((end - begin)[both].sum())
    differ = both & (mine != theirs)
    share = 1.0 - float((end - begin)[differ].sum()) / compared_s if compared_s else float("nan")
    rows = np.flatnonzero(differ)
    joins = np.append(False, (np.diff(rows) == 1) & (mine[rows][1:] == mine[rows][:-1]))[: len(rows)]
    first = np.flatnonzero(~joins)
    last = np.append(first[1:], len(rows)) - 1
    spans = np.column_stack([begin[rows[first]], end[rows[last]]]) if len(rows) else np.zeros((0, 2))
    return StateComparison(compared_s, share, spans, mine[rows[first]] == ToolState.DOWN)


def _section_notices(states: ToolStates, implement: Implement) -> Iterator[Notice]:
    """Where the sections do not fit the implement that the session states: their line lies on the tool's line there."""
    for one in states.sections:
        if abs(one.width_m - implement.width_m) > SAME_WIDTH * implement.width_m:
            yield Notice("sections-width", span_m=one.width_m, width_m=implement.width_m)
        if one.is_drawn:
            yield Notice("sections-drawn")


def external_states(
    paths: Sequence[Path], implement: Implement | None, task: str | None, trajectory: Trajectory
) -> tuple[ToolStates | None, tuple[Notice, ...]]:
    """States of an implement from the files that the session names, by the clock of the positions, and warnings.

    `task` is which of several in task data; a state that lasts to the end of the drive ends with the trajectory. Raises
    InputError if the files cannot be read, hold no states, or none in the time of the trajectory.
    """
    if not paths:
        return None, ()
    assert implement is not None
    reader = open_recording(paths, ReadOptions(task=task))
    if not isinstance(reader, GivesStates):
        raise InputError("wrong-kind-of-file.no-tool-states", paths=paths[0], title=reader.title)
    states = reader.states()
    ahead_s = implement.states_minus_gnss_s
    begin_s = states.begin_s - ahead_s
    end_s = states.end_s - ahead_s
    open_end = ~np.isfinite(end_s)
    end_s = np.where(open_end, np.maximum(trajectory.t_s[-1], np.nextafter(begin_s, np.inf)), end_s)
    sections = tuple(one.later(-ahead_s) for one in states.sections)
    states = replace(states, begin_s=begin_s, end_s=end_s, sections=sections)
    first_s, last_s = trajectory.span_s
    if not len(states):
        raise InputError("no-states", path=paths[0])
    if states.begin_s[0] < last_s and states.end_s[-1] > first_s:
        return states, (*reader.notices, *_section_notices(states, implement))
    stated = ClockReading(Clock.GNSS, float(states.begin_s[0]), float(states.end_s[-1]))
    likely = likely_offset(stated, ClockReading(Clock.GNSS, first_s, last_s))
    raise InputError(
        "no-common-time.expect-common-time",
        path=paths[0],
        states_first=iso_utc(stated.first_s),
        states_last=iso_utc(stated.last_s),
        positions_first=iso_utc(first_s),
        positions_last=iso_utc(last_s),
        likely=likely[1] if likely is not None else None,
        ahead_s=ahead_s + likely[0] if likely is not None else None,
    )
