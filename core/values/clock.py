"""Clocks and calendars: UTC, GPS time, and the leap seconds between them.

``t_s`` always means UTC in POSIX seconds: 86,400 per day, leap seconds not counted. GPS time counts from
1980-01-06T00:00:00Z without leap seconds and is ahead of UTC by those inserted since.
"""

import datetime as dt
from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from furrowmap.core.runtime.arrays import FloatArray

GPS_EPOCH_S: Final = 315_964_800
"""1980-01-06T00:00:00Z in POSIX seconds."""
FIRST_S: Final = dt.datetime(1, 1, 1, tzinfo=dt.UTC).timestamp()
LAST_S: Final = dt.datetime(9999, 12, 31, tzinfo=dt.UTC).timestamp()
"""The times that ISO 8601 can write."""
WEEK_S: Final = 604_800
DAY_S: Final = 86_400
HOUR_S: Final = 3_600
LAS_STANDARD_OFFSET_S: Final = 1_000_000_000
"""GPS seconds minus 'adjusted standard GPS time' (LAS 1.4 R15, section 2.4)."""

_LEAP_DATES: Final = (
    (1981, 7), (1982, 7), (1983, 7), (1985, 7), (1988, 1), (1990, 1), (1991, 1), (1992, 7), (1993, 7),
    (1994, 7), (1996, 1), (1997, 7), (1999, 1), (2006, 1), (2009, 1), (2012, 7), (2015, 7), (2017, 1),
)  # fmt: skip
"""Year and month on whose first day GPS − UTC changed (IERS Bulletin C; none announced since)."""

_LEAP_UTC_S: Final = np.array([dt.datetime(y, m, 1, tzinfo=dt.UTC).timestamp() for y, m in _LEAP_DATES])
_LEAP_GPS_S: Final = _LEAP_UTC_S - GPS_EPOCH_S + np.arange(1, len(_LEAP_DATES) + 1)


def gps_minus_utc_s(t_s: ArrayLike) -> FloatArray:
    """Leap seconds (GPS − UTC) at UTC times `t_s`; 0 before July 1981."""
    return np.searchsorted(_LEAP_UTC_S, np.asarray(t_s, np.float64), side="right").astype(np.float64)


def utc_to_gps_s(t_s: ArrayLike) -> FloatArray:
    """GPS seconds since 1980-01-06 of UTC POSIX seconds."""
    t = np.asarray(t_s, np.float64)
    return t - GPS_EPOCH_S + gps_minus_utc_s(t)


def gps_to_utc_s(gps_s: ArrayLike) -> FloatArray:
    """UTC POSIX seconds of GPS seconds since 1980-01-06.

    Inside an inserted leap second, which POSIX time cannot represent, the first second of the new day is returned.
    """
    gps = np.asarray(gps_s, np.float64)
    leap = np.searchsorted(_LEAP_GPS_S, gps, side="right")
    return gps + GPS_EPOCH_S - leap


def utc_to_las_time(t_s: ArrayLike) -> FloatArray:
    """Adjusted standard GPS time, as in LAS 1.4 files, of UTC POSIX seconds."""
    return utc_to_gps_s(t_s) - LAS_STANDARD_OFFSET_S


def las_time_to_utc(las_time: ArrayLike) -> FloatArray:
    """UTC POSIX seconds of adjusted standard GPS time."""
    return gps_to_utc_s(np.asarray(las_time, np.float64) + LAS_STANDARD_OFFSET_S)


def nearest_in_cycle(within_s: ArrayLike, near_s: ArrayLike, cycle_s: float) -> FloatArray:
    """The time nearest to `near_s` of a clock that shows only the time within a cycle (hour, day, week).

    Args:
        within_s: readings of the clock, any shape, seconds since the start of the cycle.
        near_s: a time within half a cycle of the reading, in the time scale of the result; one for all readings, or one
            for each.
        cycle_s: length of the cycle; cycles start at multiples of it in the time scale of the result.
    """
    within = np.asarray(within_s, np.float64)
    return within + cycle_s * np.round((np.asarray(near_s, np.float64) - within) / cycle_s)


def unroll(within_s: ArrayLike, cycle_s: float) -> FloatArray:
    """A clock's readings (n,) in their order, without the rollovers of its cycle.

    A step back by more than half a cycle is a rollover; a smaller one is kept.
    """
    within = np.asarray(within_s, np.float64)
    turns = np.cumsum(np.round(np.diff(within, prepend=within[:1]) / cycle_s))
    return within - turns * cycle_s


def runs_forward(t_s: ArrayLike) -> NDArray[np.bool_]:
    """Which of the times (n,) are later than all before them."""
    t = np.asarray(t_s, np.float64)
    latest = np.fmax.accumulate(np.concatenate([[-np.inf], t[:-1]])) if len(t) else t
    return np.asarray(t > latest)


def iso_utc(t_s: float) -> str:
    """ISO 8601 in UTC with milliseconds, such as ``2026-06-11T01:23:40.300Z``.

    A time that no calendar has (beyond the years 1 to 9999, or not finite) is shown in seconds.
    """
    if not FIRST_S <= t_s < LAST_S:
        return f"{t_s:.10g} s"
    moment = dt.datetime.fromtimestamp(round(t_s * 1000.0) / 1000.0, tz=dt.UTC)
    return moment.isoformat(timespec="milliseconds").replace("+00:00", "Z")


def decimal_years(t_s: FloatArray) -> FloatArray:
    """The epochs (n,) of Unix times (n,) as decimal years, whose length of 365.2425 days errs by a day at most."""
    return 1970.0 + t_s / 31_556_952.0


def decimal_year(t_s: float) -> float:
    """The epoch as a decimal year, such as 2026.44."""
    moment = dt.datetime.fromtimestamp(t_s, tz=dt.UTC)
    begin, end = (dt.datetime(year, 1, 1, tzinfo=dt.UTC) for year in (moment.year, moment.year + 1))
    return moment.year + (moment - begin) / (end - begin)
