"""The parts of the tool's line that work, from the states of its sections."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np
from numpy.typing import NDArray

from furrowmap.core.coverage.sweep import LinePart, PassTimes
from furrowmap.core.runtime.arrays import FloatArray
from furrowmap.core.values.sections import Section
from furrowmap.core.values.session import Implement
from furrowmap.core.values.tool_states import SectionStates, ToolState

JOINED_M: Final = 0.02
"""Sections whose ends are so near side by side leave no gap between them: offsets are in whole millimetres."""
IN_LINE_M: Final = 0.05
"""Sections that are so little ahead of each other are one line."""
Stretch = tuple[float, float, float]
"""How far ahead of the middle, and the right and the left end, to the left of it."""


@dataclass(frozen=True)
class LineParts:
    """Parts of the tool's line in the order of time: those of one interval together, and no two intervals overlap."""

    parts: tuple[LinePart, ...]

    @cached_property
    def _begin_s(self) -> FloatArray:
        return np.array([part.begin_s for part in self.parts])

    def within(self, times: PassTimes) -> list[LinePart]:
        """The parts of the intervals that reach into a pass."""
        behind = int(np.searchsorted(self._begin_s, times.end_s))
        before = int(np.searchsorted(self._begin_s, times.begin_s, side="right")) - 1
        first = int(np.searchsorted(self._begin_s, self._begin_s[before])) if before >= 0 else 0
        return [part for part in self.parts[first:behind] if part.end_s > times.begin_s]


def line_parts(sections: Sequence[SectionStates], implement: Implement, state: ToolState) -> LineParts | None:
    """The parts of the tool's line with a state; None without sections.

    Sections that are side by side and switched together are one part. While no states of sections are known, the whole
    line has the state of the tool if that is `down`, and no part otherwise.
    """
    if not sections:
        return None
    parts = [part for states in sections for part in _parts(states, state)]
    if state == ToolState.DOWN:
        begin_s = np.concatenate([[-np.inf], *(states.end_s for states in sections)])
        end_s = np.concatenate([*(states.begin_s for states in sections), [np.inf]])
        half_m = 0.5 * implement.width_m
        parts += [
            LinePart(begin, end, 0.0, half_m, -half_m, 0.0, 0.0)
            for begin, end in zip(begin_s.tolist(), end_s.tolist(), strict=True)
            if begin < end
        ]
    return LineParts(tuple(sorted(parts, key=lambda part: part.begin_s)))


def _parts(states: SectionStates, wanted: ToolState) -> Iterator[LinePart]:
    """The parts of one implement's line in each interval."""
    x_m, y_m = states.middle_m
    stretches: dict[bytes, list[Stretch]] = {}
    for k, row in enumerate(states.state == wanted):
        key = row.tobytes()
        if key not in stretches:
            stretches[key] = _stretches(states.sections, row)
        for ahead_m, right_m, left_m in stretches[key]:
            yield LinePart(
                begin_s=float(states.begin_s[k]),
                end_s=float(states.end_s[k]),
                ahead_m=ahead_m - x_m,
                left_m=left_m - y_m,
                right_m=right_m - y_m,
                begin_sigma_s=float(states.begin_sigma_s[k]),
                end_sigma_s=float(states.end_sigma_s[k]),
            )


def _stretches(sections: Sequence[Section], chosen: NDArray[np.bool_]) -> list[Stretch]:
    """The chosen sections, those that join as one."""
    found: list[Stretch] = []
    for section in sorted(
        (sections[k] for k in np.flatnonzero(chosen).tolist()), key=lambda one: (round(one.x_m, 2), one.y_m)
    ):
        right_m = section.y_m - 0.5 * section.width_m
        left_m = section.y_m + 0.5 * section.width_m
        if found:
            ahead_m, first_m, last_m = found[-1]
            if abs(section.x_m - ahead_m) <= IN_LINE_M and right_m <= last_m + JOINED_M:
                found[-1] = (ahead_m, first_m, max(last_m, left_m))
                continue
        found.append((section.x_m, right_m, left_m))
    return found
