"""Local times in the map tips of QGIS styles, where the layers hold UTC."""

from __future__ import annotations

import datetime as dt
import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final
from zoneinfo import ZoneInfo

from furrowmap.core.geodesy.local_time import local_time

DAY_S: Final = 86_400.0
_FORMATTED: Final = re.compile(r'format_date\("(start|end|time)",')


@dataclass(frozen=True)
class Clock:
    """The clocks of a place over some time.

    Attributes:
        zone: of the place.
        first_s: UTC of the first of the times.
        last_s: UTC of the last.
        sessions: identities of those that have these times, in the field `session` of their features.
    """

    zone: ZoneInfo
    first_s: float
    last_s: float
    sessions: tuple[str, ...] = ()


def in_local_time(style: str, zone: ZoneInfo, first_s: float, last_s: float) -> str:
    """A style whose map tips show the local time of a zone, which they name, instead of UTC.

    Args:
        style: QML, in whose map tips `format_date` formats the fields `start`, `end` and `time`.
        zone: of the place.
        first_s: UTC of the first of the times.
        last_s: UTC of the last.
    """
    return in_local_times(style, [Clock(zone, first_s, last_s)])


def in_local_times(style: str, clocks: Sequence[Clock]) -> str:
    """The same where sessions have clocks of different zones: each feature shows and names that of its session.

    Args:
        style: QML, in whose map tips `format_date` formats the fields `start`, `end` and `time`.
        clocks: a zone each. Features of sessions that none of the others names have the first one.
    """
    usual, *others = clocks

    def of_session(values: Sequence[str], usual_value: str) -> str:
        if not others:
            return usual_value
        cases = "".join(
            f' WHEN "session" IN ({", ".join(map(_quoted, clock.sessions))}) THEN {value}'
            for clock, value in zip(others, values, strict=True)
        )
        return f"(CASE{cases} ELSE {usual_value} END)"

    def shifted(found: re.Match[str]) -> str:
        field = found[1]
        shift = of_session([_shift(clock, field) for clock in others], _shift(usual, field))
        return f'format_date("{field}" + {shift},'

    names = of_session([_quoted(clock.zone.key) for clock in others], _quoted(usual.zone.key))
    name = f"[% {names} %]" if others else usual.zone.key
    return _FORMATTED.sub(shifted, style).replace(" UTC", f" ({name})")


def _shift(clock: Clock, field: str) -> str:
    """Expression of QGIS: what a clock is ahead of the UTC in a field."""
    shift = f"to_interval('{offset_at(clock.zone, clock.first_s)} seconds')"
    changes = offset_changes(clock.zone, clock.first_s, clock.last_s)
    if not changes:
        return shift
    # The last change before a time is the one that counts, so the latest stands first.
    cases = "".join(
        f" WHEN epoch(\"{field}\") &gt;= {1000.0 * at_s:.0f} THEN to_interval('{after_s} seconds')"
        for at_s, after_s in reversed(changes)
    )
    return f"(CASE{cases} ELSE {shift} END)"


def _quoted(text: str) -> str:
    """A text in an expression of QGIS; identities and zones have no quotes."""
    return f"'{text}'"


def offset_at(zone: ZoneInfo, t_s: float) -> int:
    """Seconds by which the clocks of a zone are ahead of UTC."""
    offset = local_time(t_s, zone).utcoffset() or dt.timedelta(0)
    return round(offset.total_seconds())


def offset_changes(zone: ZoneInfo, first_s: float, last_s: float) -> list[tuple[int, int]]:
    """Changes of a zone's offset within a span: (UTC of the change, seconds ahead of UTC from then on)."""
    changes = []
    day, offset = first_s, offset_at(zone, first_s)
    while day < last_s:
        later = min(day + DAY_S, last_s)
        if (after := offset_at(zone, later)) != offset:
            low, high = int(day), int(later) + 1
            while high - low > 1:
                middle = (low + high) // 2
                low, high = (middle, high) if offset_at(zone, middle) == offset else (low, middle)
            changes.append((high, after))
            offset = after
        day = later
    return changes
