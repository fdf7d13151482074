"""Clocks and calendars: UTC, GPS time, and the leap seconds between them.

``t_s`` everywhere means UTC in POSIX seconds: 86,400 a day, leap seconds not counted. GPS time runs through from
1980-01-06T00:00:00Z and is ahead of UTC by the leap seconds inserted since.
"""

from __future__ import annotations

import datetime as dt
from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

FloatArray = NDArray[np.float64]

GPS_EPOCH_S: Final = 315_964_800
"""1980-01-06T00:00:00Z in POSIX seconds."""
WEEK_S: Final = 604_800
DAY_S: Final = 86_400
HOUR_S: Final = 3_600
LAS_STANDARD_OFFSET_S: Final = 1_000_000_000
"""What LAS takes off GPS seconds to make 'adjusted standard GPS time' (LAS 1.4 R15, section 2.4)."""

_LEAP_DATES: Final = (
    (1981, 7), (1982, 7), (1983, 7), (1985, 7), (1988, 1), (1990, 1), (1991, 1), (1992, 7), (1993, 7),
    (1994, 7), (1996, 1), (1997, 7), (1999, 1), (2006, 1), (2009, 1), (2012, 7), (2015, 7), (2017, 1),
)  # fmt: skip
"""Year and month on whose first day a new GPS − UTC took effect (IERS Bulletin C; none announced since)."""

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

    Inside an inserted leap second, which POSIX cannot name, the first second of the new day is returned.
    """
    gps = np.asarray(gps_s, np.float64)
    leap = np.searchsorted(_LEAP_GPS_S, gps, side="right")
    return gps + GPS_EPOCH_S - leap


def utc_to_las_time(t_s: ArrayLike) -> FloatArray:
    """Adjusted standard GPS time, as LAS 1.4 files carry it, of UTC POSIX seconds."""
    return utc_to_gps_s(t_s) - LAS_STANDARD_OFFSET_S


def las_time_to_utc(las_time: ArrayLike) -> FloatArray:
    """UTC POSIX seconds of adjusted standard GPS time."""
    return gps_to_utc_s(np.asarray(las_time, np.float64) + LAS_STANDARD_OFFSET_S)


def nearest_in_cycle(within_s: ArrayLike, near_s: ArrayLike, cycle_s: float) -> FloatArray:
    """The time nearest to `near_s` of a clock that shows only its place within a cycle (hour, day, week).

    Args:
        within_s: what the clock shows, any shape, seconds since the cycle began.
        near_s: a time of whose cycle or neighbouring cycle the clock is known to be, in the result's scale; one for all
            readings, or one for each.
        cycle_s: length of the cycle; a multiple of it lies at 0 of the result's scale.
    """
    within = np.asarray(within_s, np.float64)
    return within + cycle_s * np.round((np.asarray(near_s, np.float64) - within) / cycle_s)


def unroll(within_s: ArrayLike, cycle_s: float) -> FloatArray:
    """A clock's readings (n,) in the order in which they were made, with the roll-overs of its cycle taken out.

    A step back by more than half a cycle is a roll-over; a smaller one is a disorder and stays as it is.
    """
    within = np.asarray(within_s, np.float64)
    turns = np.cumsum(np.round(np.diff(within, prepend=within[:1]) / cycle_s))
    return within - turns * cycle_s


def runs_forward(t_s: ArrayLike) -> NDArray[np.bool_]:
    """Which of the times (n,) are later than all before them: those that a clock running backwards leaves usable."""
    t = np.asarray(t_s, np.float64)
    latest = np.fmax.accumulate(np.concatenate([[-np.inf], t[:-1]])) if len(t) else t
    return np.asarray(t > latest)


def iso_utc(t_s: float) -> str:
    """ISO 8601 in UTC with milliseconds, such as ``2026-06-11T01:23:40.300Z``."""
    moment = dt.datetime.fromtimestamp(round(t_s * 1000.0) / 1000.0, tz=dt.UTC)
    return moment.isoformat(timespec="milliseconds").replace("+00:00", "Z")


def decimal_year(t_s: float) -> float:
    """The epoch as geodesy writes it: the year and the share of it that has passed, such as 2026.44."""
    moment = dt.datetime.fromtimestamp(t_s, tz=dt.UTC)
    begin, end = (dt.datetime(year, 1, 1, tzinfo=dt.UTC) for year in (moment.year, moment.year + 1))
    return moment.year + (moment - begin) / (end - begin)
