"""Readings of the clocks in recordings, offsets between them, and their common causes."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

from furrowmap.core.values.clock import DAY_S, HOUR_S, WEEK_S
from furrowmap.core.values.scan import Clock

_OFFSETS: Final = (
    (18.0, 1, "leap seconds: GPS time taken for UTC"),
    (HOUR_S, 14, "a local time taken for UTC"),
    (HOUR_S / 4, 56, "a local time taken for UTC"),
    (DAY_S, 7, "a wrong date"),
    (1024 * WEEK_S, 2, "a GPS week rollover"),
)
"""Step, largest multiple and cause of common clock offsets, most likely first."""
_NAMED_S: Final = 0.6
"""Tolerance of a common offset: clocks without a receiver are up to half a second off."""
_ENOUGH: Final = 0.5
"""Share of the shorter recording that must overlap after an offset for it to be proposed."""


@dataclass(frozen=True)
class ClockReading:
    """The readings of one clock in a file; `note` is its source, and its difference from other clocks."""

    clock: Clock
    first_s: float
    last_s: float
    note: str = ""


def likely_offset(first: ClockReading, second: ClockReading) -> tuple[float, str] | None:
    """The likely offset of the first clock relative to the second, and its cause, if the recordings do not overlap.

    Returns:
        The most likely cause with which at least half of the shorter recording overlaps, with the multiple that gives
        the largest overlap; None if there is none.
    """
    shorter_s = min(first.last_s - first.first_s, second.last_s - second.first_s)
    for step_s, largest, cause in _OFFSETS:
        # Offsets outside this range give no overlap.
        low_s, high_s = first.first_s - second.last_s, first.last_s - second.first_s
        numbers = range(max(-largest, math.ceil(low_s / step_s)), min(largest, math.floor(high_s / step_s)) + 1)
        meeting = [n * step_s for n in numbers if n != 0]
        best_s = max(meeting, key=lambda offset_s: (overlap_s(first, second, offset_s), -abs(offset_s)), default=None)
        if best_s is not None and overlap_s(first, second, best_s) >= _ENOUGH * shorter_s:
            return best_s, cause
    return None


def named_offset(offset_s: float) -> str:
    """The common cause of a clock offset, such as leap seconds; empty where there is none."""
    for step_s, largest, cause in _OFFSETS:
        number = round(offset_s / step_s)
        if 0 < abs(number) <= largest and abs(offset_s - number * step_s) < _NAMED_S:
            return cause
    return ""


def overlap_s(first: ClockReading, second: ClockReading, offset_s: float = 0.0) -> float:
    """Duration of the overlap if the first clock is ahead by `offset_s`; negative: duration of the gap."""
    return min(first.last_s - offset_s, second.last_s) - max(first.first_s - offset_s, second.first_s)
