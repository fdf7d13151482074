"""Sections in task data: where each lies across the implement, and when it worked.

ISO 11783-11: the actual work state (141) of sections and units; the actual condensed work states (161 to 176) of their
parent, two bits a section, the leftmost in driving direction in the lowest bits. Offsets (134, 135) are those of a
device element's middle from the reference point of its machine, forward and to the right.
"""

from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import accumulate
from typing import Final

import numpy as np
from numpy.typing import NDArray

from furrowmap.core.readers.isoxml.devices import PARALLEL, SECTION, UNIT, DeviceElement, ancestors
from furrowmap.core.readers.isoxml.time_log import NOT_AVAILABLE, TimeLog
from furrowmap.core.runtime.arrays import FloatArray
from furrowmap.core.runtime.errors import Notice
from furrowmap.core.values.sections import Section
from furrowmap.core.values.session import MAX_IMPLEMENT_WIDTH_M
from furrowmap.core.values.tool_states import ToolState

WORK_STATE: Final = 141
"""Actual work state: 0 off, 1 on, 2 error, 3 not installed."""
CONDENSED_STATES: Final = range(161, 177)
"""Actual condensed work state of sections 1 to 16, 17 to 32 and so on: two bits each, with the same meaning."""
SECTIONS_EACH: Final = 16
OFFSET_X: Final = 134
OFFSET_Y: Final = 135
WIDTHS: Final = (67, 70, 68)
"""Actual, maximum and default working width, mm."""
MAX_ELEMENT_OFFSET_M: Final = 100.0
SAME_OFFSET_M: Final = 0.02
"""Offsets of an element that vary by more are of an implement that is shifted or folded on its way."""

StateArray = NDArray[np.int8]


@dataclass(frozen=True)
class LoggedSections:
    """The k sections of an implement, from left to right, and their states (n, k) in the n records of each log."""

    sections: tuple[Section, ...]
    states: tuple[StateArray, ...]
    device: str


class StatedValues:
    """What logs and device descriptions state once, or rarely, about device elements."""

    def __init__(self, logs: Sequence[TimeLog], elements: Mapping[str, DeviceElement]) -> None:
        self._elements = elements
        self._logged: defaultdict[tuple[str, int], list[FloatArray]] = defaultdict(list)
        for log in logs:
            for k, (ddi, element) in enumerate(log.header.channels):
                values = log.value[log.channel == k]
                if not len(values) and k in log.header.constants:
                    values = np.array([log.header.constants[k]], np.int32)
                values = values[np.abs(values.astype(np.int64)) < NOT_AVAILABLE]
                if len(values):
                    self._logged[element, ddi].append(values.astype(np.float64))

    def logged(self, element: str, ddi: int) -> FloatArray:
        """All raw values of the logs, of which there may be none."""
        return np.concatenate([np.zeros(0), *self._logged.get((element, ddi), [])])

    def number(self, element: str, ddi: int) -> float | None:
        """The raw value that is logged most often, else that of the description."""
        values = self.logged(element, ddi)
        if len(values):
            numbers, counts = np.unique(values, return_counts=True)
            return float(numbers[np.argmax(counts)])
        return self._elements[element].properties.get(ddi) if element in self._elements else None

    def offset_m(self, element: str, ddi: int) -> float | None:
        """An offset in metres; None where it is not stated, or no machine reaches so far."""
        raw = self.number(element, ddi)
        return raw / 1000.0 if raw is not None and abs(raw) <= 1000.0 * MAX_ELEMENT_OFFSET_M else None

    def ahead_m(self, element: str) -> float:
        """How far an element, or what it is part of, is ahead of its machine's reference point."""
        for one in (element, *ancestors(element, self._elements)):
            offset_m = self.offset_m(one, OFFSET_X)
            if offset_m is not None:
                return offset_m
        return 0.0

    def width_m(self, element: str) -> float | None:
        """The widest that an element is: a section that is off may have the actual width 0."""
        for ddi in WIDTHS:
            stated = self._elements[element].properties.get(ddi, 0) if element in self._elements else 0
            values = np.append(self.logged(element, ddi), stated) / 1000.0
            values = values[(values > 0.0) & (values <= MAX_IMPLEMENT_WIDTH_M)]
            if len(values):
                return float(values.max())
        return None

    def varies(self, element: str) -> bool:
        """Whether the place of an element across the machine changes."""
        values = self.logged(element, OFFSET_Y)
        return len(values) > 0 and bool(np.ptp(values) > 1000.0 * SAME_OFFSET_M)


def read_sections(
    logs: Sequence[TimeLog], elements: Mapping[str, DeviceElement], stated: StatedValues
) -> tuple[LoggedSections | None, list[Notice]]:
    """The sections of the implement in a task's logs; None where fewer than two have states and a known place.

    Of several parts of a machine that have sections the widest counts, with a notice: each works the ground of the
    others again.
    """
    states, notices = _states_of_sections(logs, elements, stated)
    parts: defaultdict[str, list[str]] = defaultdict(list)
    for section in states:
        parts[next((one for one in ancestors(section, elements) if elements[one].kind not in PARALLEL), "")].append(
            section
        )
    found: dict[str, list[tuple[str, Section]]] = {}
    for part, ids in parts.items():
        if not any((one != ToolState.UNKNOWN).any() for section in ids for one in states[section]):
            continue
        for section in _silent_sections(part, ids, elements, stated):
            ids.append(section)
            states[section] = [np.full(len(log), ToolState.UNKNOWN, np.int8) for log in logs]
        if len(ids) < 2:
            continue
        placed, assumed = _placed(ids, elements, stated)
        notices += assumed
        if placed is None:
            notices.append(Notice("sections-not-placed", part=_name(part, elements), sections=len(ids)))
        else:
            found[part] = placed
    if not found:
        return None, notices
    chosen = max(found, key=lambda part: (round(_span_m(found[part]), 2), len(found[part])))
    device = elements[found[chosen][0][0]].device
    others = [_name(part, elements) for part in found if part != chosen]
    working = [part for part in _working_parts(logs, elements) if elements[part].device != device]
    others += [elements[part].name for part in working if stated.width_m(part) is not None]
    if others:
        notices.append(
            Notice("sections-of-others", part=_name(chosen, elements), others=", ".join(dict.fromkeys(others)))
        )
    ids = [section for section, _ in found[chosen]]
    shifted = [elements[section].name for section in ids if stated.varies(section)]
    if shifted:
        notices.append(Notice("sections-shift", names=", ".join(shifted[:4])))
    sections = LoggedSections(
        sections=tuple(section for _, section in found[chosen]),
        states=tuple(np.column_stack([states[section][k] for section in ids]) for k in range(len(logs))),
        device=device,
    )
    return sections, notices


def _silent_sections(
    part: str, ids: Sequence[str], elements: Mapping[str, DeviceElement], stated: StatedValues
) -> list[str]:
    """Sections of a part of a machine with a place, but without a state, beside those with one."""
    return [
        section
        for section in _children(part, elements, stated)
        if section not in ids
        and elements[section].kind == elements[ids[0]].kind
        and stated.width_m(section) is not None
        and stated.offset_m(section, OFFSET_Y) is not None
    ]


def _working_parts(logs: Sequence[TimeLog], elements: Mapping[str, DeviceElement]) -> list[str]:
    """Parts of machines, other than sections, whose own state says that they worked at some time."""
    own = [_own_states(log) for log in logs]
    working = {part for one in own for part, state in one.items() if (state == ToolState.DOWN).any()}
    return sorted(part for part in working if part in elements and not _is_parallel(part, elements))


def _name(part: str, elements: Mapping[str, DeviceElement]) -> str:
    return elements[part].name if part in elements else part


def _span_m(placed: Sequence[tuple[str, Section]]) -> float:
    left_m = max(section.y_m + 0.5 * section.width_m for _, section in placed)
    return left_m - min(section.y_m - 0.5 * section.width_m for _, section in placed)


def _placed(
    ids: Sequence[str], elements: Mapping[str, DeviceElement], stated: StatedValues
) -> tuple[list[tuple[str, Section]] | None, list[Notice]]:
    """The sections from left to right, with their ids; None if a width or a place is not stated, or cannot be.

    Where all widths but no places are stated, sections lie side by side in the order of their numbers, the middle of
    all on the machine's axis.
    """
    widths_m = [stated.width_m(section) for section in ids]
    right_m = [stated.offset_m(section, OFFSET_Y) for section in ids]
    known_m = [width_m for width_m in widths_m if width_m is not None]
    if len(known_m) < len(ids):
        return None, []
    notices = []
    placed_m = [offset_m for offset_m in right_m if offset_m is not None]
    order = sorted(range(len(ids)), key=lambda k: elements[ids[k]].number)
    if not placed_m:
        ends_m = np.array([0.0, *accumulate(known_m[k] for k in order)]) - 0.5 * sum(known_m)
        placed_m = [0.0] * len(ids)
        for k, middle_m in zip(order, (0.5 * (ends_m[1:] + ends_m[:-1])).tolist(), strict=True):
            placed_m[k] = middle_m
        notices.append(Notice("sections-side-by-side", names=", ".join(elements[ids[k]].name for k in order[:4])))
    if len(placed_m) < len(ids):
        return None, notices
    found = [
        (ids[k], Section(elements[ids[k]].name, stated.ahead_m(ids[k]), 0.0 - placed_m[k], known_m[k]))
        for k in sorted(order, key=lambda k: placed_m[k])
    ]
    if _span_m(found) > MAX_IMPLEMENT_WIDTH_M or len({section.y_m for _, section in found}) < len(found):
        return None, notices
    return found, notices


def _states_of_sections(
    logs: Sequence[TimeLog], elements: Mapping[str, DeviceElement], stated: StatedValues
) -> tuple[dict[str, list[StateArray]], list[Notice]]:
    """The states (n,) in each log of the smallest sections and units that have one."""
    notices = []
    own = [_own_states(log) for log in logs]
    condensed = [_condensed_states(log) for log in logs]
    states: dict[str, list[StateArray]] = {}
    for parent in sorted({parent for one in condensed for parent in one}):
        pairs = [one.get(parent) for one in condensed]
        children = _children(parent, elements, stated)
        if _is_contradicted(parent, pairs, own):
            continue
        if len(children) < 2:
            if any(one is not None and _is_switched(one) for one in pairs):
                notices.append(Notice("sections-not-matched", part=_name(parent, elements), children=len(children)))
            continue
        if any(one is not None and (one[:, len(children) :] == 1).any() for one in pairs):
            notices.append(Notice("sections-not-matched", part=_name(parent, elements), children=len(children)))
            continue
        for k, child in enumerate(children):
            states[child] = [_state_of_pairs(one, k, len(log)) for one, log in zip(pairs, logs, strict=True)]
    for section in sorted({element for one in own for element in one if _is_parallel(element, elements)}):
        logged = [one.get(section) for one in own]
        before = states.get(section, [np.full(len(log), ToolState.UNKNOWN, np.int8) for log in logs])
        states[section] = [
            old if new is None else np.where(new == ToolState.UNKNOWN, old, new)
            for new, old in zip(logged, before, strict=True)
        ]
    above = {parent for section in states for parent in ancestors(section, elements)}
    smallest = {
        section: [_under_parents(section, elements, *pair) for pair in zip(own, found, strict=True)]
        for section, found in states.items()
        if section not in above
    }
    return smallest, notices


def _is_parallel(element: str, elements: Mapping[str, DeviceElement]) -> bool:
    return element in elements and elements[element].kind in PARALLEL


def _own_states(log: TimeLog) -> dict[str, StateArray]:
    return {
        element: np.select([raw == 0, raw == 1], [ToolState.UP, ToolState.DOWN], ToolState.UNKNOWN).astype(np.int8)
        for element, raw in log.values_of(WORK_STATE)
    }


def _condensed_states(log: TimeLog) -> dict[str, StateArray]:
    """The pairs of bits (n, 256) of each element with condensed states, −1 before the first."""
    found: dict[str, StateArray] = {}
    for block, ddi in enumerate(CONDENSED_STATES):
        for element, raw in log.values_of(ddi):
            pairs = found.setdefault(element, np.full((len(log), SECTIONS_EACH * len(CONDENSED_STATES)), -1, np.int8))
            known = np.isfinite(raw)
            bits = np.where(known, raw, 0.0).astype(np.int64)[:, None] >> (2 * np.arange(SECTIONS_EACH)) & 3
            first = block * SECTIONS_EACH
            pairs[:, first : first + SECTIONS_EACH] = np.where(known[:, None], bits, -1)
    return found


def _state_of_pairs(pairs: StateArray | None, section: int, records: int) -> StateArray:
    """The state (n,) of a section; one that is not installed does not work."""
    if pairs is None:
        return np.full(records, ToolState.UNKNOWN, np.int8)
    mine = pairs[:, section]
    is_off = (mine == 0) | (mine == 3)
    return np.select([mine == 1, is_off], [ToolState.DOWN, ToolState.UP], ToolState.UNKNOWN).astype(np.int8)


def _is_switched(pairs: StateArray) -> bool:
    """Whether some sections worked while others did not, of those that ever worked."""
    used = pairs[:, (pairs == 1).any(axis=0)]
    return bool(((used == 1).any(axis=1) & (used == 0).any(axis=1)).any())


def _is_contradicted(parent: str, pairs: Sequence[StateArray | None], own: Sequence[Mapping[str, StateArray]]) -> bool:
    """Whether no section of an element ever works while the element itself does."""
    never = not any(one is not None and (one == 1).any() for one in pairs)
    return never and any(parent in one and (one[parent] == ToolState.DOWN).any() for one in own)


def _children(parent: str, elements: Mapping[str, DeviceElement], stated: StatedValues) -> list[str]:
    """The sections below an element, or where it has none its units, from left to right."""
    for kind in (SECTION, UNIT):
        found = list(_nearest(parent, kind, elements))
        if found:
            right_m = [stated.offset_m(one, OFFSET_Y) for one in found]
            if all(offset_m is not None for offset_m in right_m):
                return [one for _, one in sorted(zip(right_m, found, strict=True))]
            return sorted(found, key=lambda one: elements[one].number)
    return []


def _nearest(parent: str, kind: str, elements: Mapping[str, DeviceElement]) -> Iterator[str]:
    """The elements of a kind below another, without those below one of this kind."""
    for one in elements.values():
        if one.kind != kind:
            continue
        above = ancestors(one.id, elements)
        if parent in above and not any(elements[a].kind == kind for a in above[: above.index(parent)] if a in elements):
            yield one.id


def _under_parents(
    section: str, elements: Mapping[str, DeviceElement], own: Mapping[str, StateArray], state: StateArray
) -> StateArray:
    """The state (n,) of a section, which is off while what it is part of is."""
    for parent in ancestors(section, elements):
        if parent in own:
            state = np.where(own[parent] == ToolState.UP, ToolState.UP, state).astype(np.int8)
    return state
