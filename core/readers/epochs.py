"""Times of logs: weeks and dates that are not in the files, and the order of time.

Epochs are never sorted: those that are not later than all before are dropped and counted. A log with many of them is
rejected, because two receivers wrote it or its parts are in the wrong order.
"""

import datetime as dt
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from furrowmap.core.readers.reader import ReadOptions
from furrowmap.core.runtime.arrays import FloatArray
from furrowmap.core.runtime.errors import InputError
from furrowmap.core.values.clock import (
    DAY_S,
    GPS_EPOCH_S,
    WEEK_S,
    gps_minus_utc_s,
    gps_to_utc_s,
    iso_utc,
    nearest_in_cycle,
    unroll,
    utc_to_gps_s,
)

GAP_INTERVALS: Final = 1.5
"""A step of so many usual ones is a gap."""
MAX_BACKWARD_SHARE: Final = 0.05
"""Largest share of epochs out of order in the log of one receiver."""
EARLIEST_SINCE_1980_S: Final = 10 * 365.25 * DAY_S
"""Seconds since 1980-01-06 that are below this are not absolute times: GPS was not complete before 1990."""
_DAYS: Final = ("Sunday", "Monday", "Tuesday", "Wednesday", "Thursday", "Friday", "Saturday")


def utc_of(seconds: FloatArray, scale: str, name: str, options: ReadOptions) -> FloatArray:
    """UTC (n,) of times (n,).

    Args:
        seconds: in the order of the file.
        scale: "unix" (UTC since 1970), "gps" or "utc" (both since 1980-01-06 or since the start of the week, Sunday
            0 h).
        options: `week`, else `near_s`, gives the week of times that count from its start.

    Raises:
        InputError: if the week or the time scale is unknown.
    """
    if scale == "unix" or not len(seconds):
        return seconds
    if bool(np.all((seconds >= 0) & (seconds < 2 * WEEK_S))):
        # Some processors continue the seconds into the next week, others restart them.
        within = unroll(seconds, WEEK_S)
        if options.week is not None:
            seconds = within + options.week * WEEK_S
        elif options.near_s is not None:
            near_s = options.near_s - GPS_EPOCH_S if scale == "utc" else float(utc_to_gps_s(options.near_s))
            seconds = within + float(nearest_in_cycle(within[0], near_s, WEEK_S) - within[0])
        else:
            raise InputError("no-gps-week", name=name, within=within[0], within_last=within[-1])
    elif not bool(np.all(seconds >= EARLIEST_SINCE_1980_S)):
        raise InputError("unknown-time-scale", name=name, first_s=seconds.min(), last_s=seconds.max())
    return seconds + GPS_EPOCH_S if scale == "utc" else gps_to_utc_s(seconds)


def midnight_utc_s(date: str) -> float:
    """UTC of the start of a day (YYYY-MM-DD); InputError if `date` is not a date."""
    try:
        return dt.datetime.fromisoformat(date).replace(tzinfo=dt.UTC, hour=0, minute=0, second=0).timestamp()
    except ValueError:
        raise InputError("bad-date", date=date) from None


def midnights_utc_s(year: NDArray[np.integer], month: NDArray[np.integer], day: NDArray[np.integer]) -> FloatArray:
    """UTC (n,) of the start of days in the years 1980 to 2099; nan for invalid dates."""
    year, month, day = (np.asarray(part, np.int64) for part in (year, month, day))
    usable = (year >= 1980) & (year < 2100) & (month >= 1) & (month <= 12) & (day >= 1)
    months = np.where(usable, (year - 1970) * 12 + month - 1, 0).astype("datetime64[M]")
    days = months.astype("datetime64[D]") + np.where(usable, day - 1, 0)
    usable &= days.astype("datetime64[M]") == months
    return np.where(usable, days.astype(np.float64) * DAY_S, np.nan)


def no_week(tow_s: FloatArray, name: str) -> InputError:
    """The error of a log with only the time of the week."""
    return InputError("no-date", name=name, first_tow=week_time(tow_s[0]), last_tow=week_time(tow_s[-1]))


def day_of_week(tow_s: float) -> str:
    """Name of the day of a time of the GPS week."""
    return _DAYS[int(tow_s // DAY_S) % 7]


def week_time(tow_s: float) -> str:
    """Day and time of day of a time of the GPS week, such as ``Tuesday 18:58:59.950``."""
    return f"{day_of_week(tow_s)} {iso_utc(float(tow_s) % DAY_S)[11:23]}"


def week_times(tow_s: FloatArray, options: ReadOptions, name: str) -> FloatArray | None:
    """GPS seconds (n,) of seconds of the week (n,) in a log without dates; None if the week is unknown.

    InputError if the stated date is invalid, or is not on the log's day of the week.
    """
    if options.week is not None:
        return unroll(tow_s, WEEK_S) + options.week * WEEK_S
    if options.date is not None:
        stated_s = midnight_utc_s(options.date)
        gps_s = unroll(tow_s, WEEK_S)
        gps_s = gps_s + float(nearest_in_cycle(tow_s[0], utc_to_gps_s(stated_s + DAY_S / 2), WEEK_S) - tow_s[0])
        begin_s = float(utc_to_gps_s(stated_s))
        if not begin_s <= gps_s[0] < begin_s + DAY_S:
            stated = dt.datetime.fromtimestamp(stated_s, dt.UTC).isoweekday() % 7
            raise InputError(
                "date-contradicted", name=name, first_tow=day_of_week(tow_s[0]), date=options.date, days=_DAYS[stated]
            )
        return gps_s
    if options.near_s is not None:
        near_s = utc_to_gps_s(options.near_s)
        return unroll(tow_s, WEEK_S) + float(nearest_in_cycle(tow_s[0], near_s, WEEK_S) - tow_s[0])
    return None


def timing_facts(t_s: NDArray[np.float64]) -> dict[str, Any]:
    """Span, rate and gaps of increasing times (n,); a gap is longer than 1.5 times the median interval."""
    if len(t_s) < 2:
        return {}
    step = np.diff(t_s)
    interval = float(np.median(step))
    gaps = step[step > GAP_INTERVALS * interval]
    return {
        "span_s": round(float(t_s[-1] - t_s[0]), 3),
        "rate_hz": round(1.0 / interval, 2),
        "gaps": {
            "longer_than_s": round(GAP_INTERVALS * interval, 3),
            "count": len(gaps),
            "longest_s": round(float(gaps.max()), 3) if len(gaps) else 0.0,
        },
    }


def utc_facts(t_s: NDArray[np.float64]) -> dict[str, Any]:
    """First and last of the UTC times (n,), and the leap seconds then."""
    if not len(t_s):
        return {}
    return {
        "first": iso_utc(float(t_s[0])),
        "last": iso_utc(float(t_s[-1])),
        "gps_minus_utc_s": int(gps_minus_utc_s(t_s[0])),
    }
