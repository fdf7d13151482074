"""Local times in the map tips of QGIS styles, where the layers hold UTC."""

from __future__ import annotations

import datetime as dt
import re
from typing import Final
from zoneinfo import ZoneInfo

from furrowmap.core.geodesy.local_time import local_time

DAY_S: Final = 86_400.0
_FORMATTED: Final = re.compile(r'format_date\("(start|end|time)",')


def in_local_time(style: str, zone: ZoneInfo, first_s: float, last_s: float) -> str:
    """A style whose map tips show the local time of a zone, which they name, instead of UTC.

    Args:
        style: QML, in whose map tips `format_date` formats the fields `start`, `end` and `time`.
        zone: of the place.
        first_s: UTC of the first of the times.
        last_s: UTC of the last.
    """
    changes = offset_changes(zone, first_s, last_s)
    offset_s = offset_at(zone, first_s)

    def shifted(found: re.Match[str]) -> str:
        field = found[1]
        shift = f"to_interval('{offset_s} seconds')"
        if changes:
            # The last change before a time is the one that counts, so the latest stands first.
            cases = "".join(
                f" WHEN epoch(\"{field}\") &gt;= {1000.0 * at_s:.0f} THEN to_interval('{after_s} seconds')"
                for at_s, after_s in reversed(changes)
            )
            shift = f"(CASE{cases} ELSE {shift} END)"
        return f'format_date("{field}" + {shift},'

    return _FORMATTED.sub(shifted, style).replace(" UTC", f" ({zone.key})")


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
