"""The local time of a place: what clocks show there."""

import datetime as dt
import re
from typing import Final
from zoneinfo import ZoneInfo, ZoneInfoNotFoundError

from pyproj import CRS, Transformer

from furrowmap.core.runtime.languages.texts import Text

HOUR_DEG: Final = 15.0
_UTC: Final = re.compile(r"\d{4}-\d\d-\d\dT\d\d:\d\d:\d\d\.\d{3}Z")
"""Times as :func:`~furrowmap.core.values.clock.iso_utc` writes them."""


def zone_at(lon_deg: float, lat_deg: float) -> ZoneInfo:
    """The time zone of a place, from the boundaries of time zones; at sea its nautical zone."""
    import tzfpy  # reads its map when it is imported

    try:
        return ZoneInfo(tzfpy.get_tz(lon_deg, lat_deg))
    except (ZoneInfoNotFoundError, ValueError):  # a zone younger than the system's list
        return ZoneInfo(f"Etc/GMT{-round(lon_deg / HOUR_DEG):+d}")


def local_time(t_s: float, zone: ZoneInfo) -> dt.datetime:
    """The local time of a UTC time in seconds since 1970, to the millisecond."""
    return dt.datetime.fromtimestamp(round(t_s, 3), tz=dt.UTC).astimezone(zone)


def local_day(t_s: float, crs: CRS, xy_m: tuple[float, float]) -> dt.date | None:
    """The day that calendars show at a UTC time at a place on a map; None where its CRS has no geographic base."""
    base = crs.to_2d().geodetic_crs
    if base is None:
        return None
    lon, lat = Transformer.from_crs(crs.to_2d(), base.to_2d(), always_xy=True).transform(*xy_m)
    return local_time(t_s, zone_at(lon, lat)).date()


def clock_words(t_s: float, zone: ZoneInfo) -> str:
    """What a clock shows at a UTC time: "09:23:11"."""
    return f"{local_time(t_s, zone):%H:%M:%S}"


def zone_words(t_s: float, zone: ZoneInfo) -> str:
    """Name of a zone and its offset at a UTC time: "Asia/Tokyo, UTC+09:00"."""
    return f"{zone.key}, {_offset_words(t_s, zone)}"


def _offset_words(t_s: float, zone: ZoneInfo) -> str:
    offset = f"{local_time(t_s, zone):%z}"
    return f"UTC{offset[:3]}:{offset[3:5]}"


def span_words(first_s: float, last_s: float, zone: ZoneInfo) -> Text:
    """Two UTC times in a zone: "2026-06-11, 09:23:11 to 09:41:02 (Asia/Tokyo, UTC+09:00)"."""
    first = local_time(first_s, zone)
    last = local_time(last_s, zone)
    later = "" if last.date() == first.date() else f"{last:%Y-%m-%d}, "
    return Text(
        "{begin} to {end} ({zone}, {offset})",
        begin=f"{first:%Y-%m-%d}, {first:%H:%M:%S}",
        end=f"{later}{last:%H:%M:%S}",
        zone=zone.key,
        offset=_offset_words(first_s, zone),
    )


def in_local_time(text: str, zone: ZoneInfo) -> str:
    """A text of the product with its times in UTC changed to those of a zone, which it names after the last of them."""
    times = list(_UTC.finditer(text))
    parts = []
    behind = 0
    for found in times:
        moment = dt.datetime.fromisoformat(found[0]).astimezone(zone)
        name = f" ({zone.key})" if found is times[-1] else ""
        parts += [text[behind : found.start()], f"{moment:%Y-%m-%d %H:%M:%S}.{moment.microsecond // 100_000}{name}"]
        behind = found.end()
    return "".join([*parts, text[behind:]])
