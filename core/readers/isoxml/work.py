"""Work in a time log: working state, working width, and the machine's area counters."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

import numpy as np
from numpy.typing import NDArray

from furrowmap.core.readers.isoxml.content import PARALLEL, DeviceElement
from furrowmap.core.readers.isoxml.time_log import TimeLog
from furrowmap.core.runtime.arrays import FloatArray
from furrowmap.core.runtime.errors import Notice
from furrowmap.core.values.session import MAX_IMPLEMENT_WIDTH_M
from furrowmap.core.values.tool_states import ToolState

ACTUAL_WIDTH: Final = 67
"""Actual working width, mm; the numbers are those of ISO 11783-11's data dictionary."""
WORK_STATE: Final = 141
"""Actual work state: 0 off, 1 on, 2 error, 3 not installed."""
CONDENSED_STATES: Final = range(161, 177)
"""Actual condensed work state of sections 1 to 16, 17 to 32 and so on: two bits each, with the same meaning."""
SECTIONS_EACH: Final = 16
TOTAL_AREA: Final = 116
"""m²"""
EFFECTIVE_DISTANCE: Final = 117
"""mm, as 118, the ineffective one."""
EFFECTIVE_TIME: Final = 119
"""s, as 120, the ineffective one."""


def logged_work(
    log: TimeLog, elements: Mapping[str, DeviceElement], notices: list[Notice]
) -> tuple[NDArray[np.int8], FloatArray, float]:
    """The work in a time log of n records.

    The states of the smallest device elements are used, because a boom may be on while its sections are off. The
    machine works if any of them works.

    Args:
        log: the time log.
        elements: device elements by id; a log may refer to others.
        notices: extended with what is doubtful.

    Returns:
        (n,) values of :class:`ToolState`; (n,) working width, nan where it is not logged; increase of the machine's
        area counter, nan if it has none.
    """
    states = _states(log, elements, notices)
    state = np.full(len(log), ToolState.UNKNOWN, np.int8)
    if states:
        table = np.stack(list(states.values()))
        state[(table == ToolState.UP).any(axis=0)] = ToolState.UP
        state[(table == ToolState.DOWN).any(axis=0)] = ToolState.DOWN
    width = _width(log, elements, states, state == ToolState.DOWN, notices)
    state[(state == ToolState.DOWN) & (width == 0.0)] = ToolState.UP
    gains = {
        element: np.nanmax(values) - np.nanmin(values)
        for element, values in log.values_of(TOTAL_AREA)
        if np.isfinite(values).any()
    }
    topmost = [gain for element, gain in gains.items() if not set(ancestors(element, elements)) & gains.keys()]
    return state, width, float(max(topmost, default=np.nan))


def _states(log: TimeLog, elements: Mapping[str, DeviceElement], notices: list[Notice]) -> dict[str, NDArray[np.int8]]:
    """The state (n,) of each of the smallest device elements that have one."""
    own = {
        element: np.select([raw == 0, raw == 1], [ToolState.UP, ToolState.DOWN], ToolState.UNKNOWN).astype(np.int8)
        for element, raw in log.values_of(WORK_STATE)
    }
    sections = _section_states(log)
    for element, any_on in sections.items():
        if not (any_on == ToolState.DOWN).any() and (own.get(element, any_on) == ToolState.DOWN).any():
            notices.append(Notice("sections-contradicted", log=log.name, element=element))
        elif element in own:
            own[element] = np.where(any_on == ToolState.UP, ToolState.UP, own[element]).astype(np.int8)
        else:
            own[element] = any_on
    above = {parent for element in own for parent in ancestors(element, elements)}
    return {element: state for element, state in own.items() if element not in above}


def _section_states(log: TimeLog) -> dict[str, NDArray[np.int8]]:
    """For each element with condensed states, whether any of its sections works (n,)."""
    found: dict[str, NDArray[np.int8]] = {}
    for ddi in CONDENSED_STATES:
        for element, bits in log.values_of(ddi):
            known = np.isfinite(bits)
            pairs = np.where(known, bits, 0).astype(np.int64)[:, None] >> (2 * np.arange(SECTIONS_EACH)) & 3
            state = np.where((pairs == 1).any(axis=1), ToolState.DOWN, ToolState.UP)
            state = np.where(known, state, ToolState.UNKNOWN).astype(np.int8)
            found[element] = np.maximum(found[element], state) if element in found else state
    return found


def _width(
    log: TimeLog,
    elements: Mapping[str, DeviceElement],
    states: Mapping[str, NDArray[np.int8]],
    at_work: NDArray[np.bool_],
    notices: list[Notice],
) -> FloatArray:
    """The working width (n,), from the largest device elements that have one.

    Sections are side by side, so the widths of those that work are added; functions are one after the other, so the
    largest width is used. Sections without a state work where the machine is `at_work`.
    """
    widths = {element: raw / 1000.0 for element, raw in log.values_of(ACTUAL_WIDTH)}
    wrong = sum(int(np.sum((values < 0.0) | (values > MAX_IMPLEMENT_WIDTH_M))) for values in widths.values())
    if wrong:
        notices.append(Notice("width-implausible", log=log.name, wrong=wrong, widest_m=MAX_IMPLEMENT_WIDTH_M))
    widths = {
        element: np.where((values >= 0.0) & (values <= MAX_IMPLEMENT_WIDTH_M), values, np.nan)
        for element, values in widths.items()
    }
    topmost = [element for element in widths if not set(ancestors(element, elements)) & widths.keys()]
    sections = [e for e in topmost if e in elements and elements[e].kind in PARALLEL]
    width = np.full(len(log), np.nan)
    parallel = np.zeros(len(log))
    for element in topmost:
        if element in sections:
            working = states[element] == ToolState.DOWN if element in states else at_work
            parallel += np.where(working & np.isfinite(widths[element]), widths[element], 0.0)
        else:
            width = np.fmax(width, widths[element])
    return np.fmax(width, parallel) if sections else width


def ancestors(element: str, elements: Mapping[str, DeviceElement]) -> list[str]:
    """Ids of the parents of an element, the direct one first."""
    found: list[str] = []
    while element in elements and (element := elements[element].parent) and element not in found:
        found.append(element)
    return found
