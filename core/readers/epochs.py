"""What the readers of GNSS logs have in common: days that are stated elsewhere, and the order of time.

Nothing is ever sorted: epochs whose time does not run forward are dropped and counted, and a log with many of them is
refused, for two receivers wrote it or it was put together wrongly.
"""

from __future__ import annotations

import datetime as dt
from collections.abc import Callable
from typing import Final

import numpy as np
from numpy.typing import NDArray

from furrowmap.core.readers.reader import ReadOptions
from furrowmap.core.values.clock import DAY_S, WEEK_S, iso_utc, nearest_in_cycle, runs_forward, unroll, utc_to_gps_s
from furrowmap.core.values.errors import InputError, Notice

FloatArray = NDArray[np.float64]

MOST_DISORDER: Final = 0.05
"""Share of epochs running backwards from which on a log is not taken for one receiver's."""
MOST_SPLICES: Final = 4
"""Steps back up to which a log in disorder is taken for pieces put together wrongly."""
_DAYS: Final = ("Sunday", "Monday", "Tuesday", "Wednesday", "Thursday", "Friday", "Saturday")


def midnight_utc_s(date: str) -> float:
    """UTC of the beginning of a day (YYYY-MM-DD).

    Raises:
        InputError: if `date` is no date.
    """
    try:
        return dt.datetime.fromisoformat(date).replace(tzinfo=dt.UTC, hour=0, minute=0, second=0).timestamp()
    except ValueError:
        raise InputError(
            f"{date!r} is not a date.",
            "The day of the log's first position is needed as year, month and day.",
            'Write it as `date = "2026-06-11"` under `[recording]`.',
            code="bad-date",
        ) from None


def midnights_utc_s(year: NDArray[np.integer], month: NDArray[np.integer], day: NDArray[np.integer]) -> FloatArray:
    """UTC (n,) of the beginning of days in the years 1980 to 2099; nan where the calendar has no such day.

    Args:
        year: (n,) integers of any size.
        month: (n,) likewise; January is 1.
        day: (n,) likewise; the first is 1.
    """
    year, month, day = (np.asarray(part, np.int64) for part in (year, month, day))
    usable = (year >= 1980) & (year < 2100) & (month >= 1) & (month <= 12) & (day >= 1)
    months = np.where(usable, (year - 1970) * 12 + month - 1, 0).astype("datetime64[M]")
    days = months.astype("datetime64[D]") + np.where(usable, day - 1, 0)
    usable &= days.astype("datetime64[M]") == months
    return np.where(usable, days.astype(np.float64) * DAY_S, np.nan)


def in_order(
    t_s: FloatArray, lon_deg: FloatArray, lat_deg: FloatArray, name: str, place: Callable[[int], str]
) -> tuple[NDArray[np.bool_], list[Notice]]:
    """Which epochs (n,) run forward in time, and what is to be told of the others.

    An epoch that repeats time and place of the one before it was written twice; that is no disorder.

    Args:
        t_s: (n,) times in the order in which they stand.
        lon_deg: (n,) longitudes.
        lat_deg: (n,) latitudes.
        name: of the log, for messages.
        place: words for where epoch k stands.

    Raises:
        InputError: if more than a twentieth of the epochs do not run forward.
    """
    forward = runs_forward(t_s)
    repeated = np.zeros(len(t_s), bool)
    repeated[1:] = (np.diff(t_s) == 0) & (np.diff(lon_deg) == 0) & (np.diff(lat_deg) == 0)
    backward = ~forward & ~repeated
    if backward.sum() > MOST_DISORDER * len(t_s):
        raise _disorder(t_s, backward, place(int(np.flatnonzero(backward)[0])))
    notices = []
    if backward.any():
        widest_s = float(-np.diff(t_s).min(initial=0.0))
        notices.append(
            Notice(
                "time-runs-back",
                f"{name}: {int(backward.sum())} of {len(t_s)} positions are not later than all before them (time runs "
                f"back by up to {widest_s:.3f} s); they are left out.",
            )
        )
    if repeated.any():
        notices.append(
            Notice("positions-repeated", f"{name}: {int(repeated.sum())} positions are written twice and count once.")
        )
    return forward, notices


def _disorder(t_s: FloatArray, backward: NDArray[np.bool_], first: str) -> InputError:
    steps_back = int(np.sum(np.diff(t_s) <= 0))
    if steps_back > max(MOST_SPLICES, 0.01 * len(t_s)):
        return InputError(
            f"{first}: time runs back or stands here and {steps_back} times in all, over {len(t_s)} positions.",
            "Two receivers wrote into this log, and it does not say which position is whose.",
            "Record each receiver in a file of its own; of NMEA, another talker for each serves as well.",
            code="receivers-interleaved",
        )
    return InputError(
        f"{first}: time runs back here; {int(backward.sum())} of {len(t_s)} positions are not later than all before.",
        "The log is pieced together in the wrong order, and what lies behind this place would be lost.",
        "Give the pieces as files of their own, in the order of time.",
        code="time-disorder",
    )


def week_times(tow_s: FloatArray, options: ReadOptions, name: str) -> FloatArray | None:
    """GPS seconds (n,) of seconds of the week (n,) in a log without dates; None where nobody states the week.

    Raises:
        InputError: if the stated date is none, or is another day of the week than the log's.
    """
    if options.week is not None:
        return unroll(tow_s, WEEK_S) + options.week * WEEK_S
    if options.date is not None:
        stated_s = midnight_utc_s(options.date)
        gps_s = unroll(tow_s, WEEK_S)
        gps_s = gps_s + float(nearest_in_cycle(tow_s[0], utc_to_gps_s(stated_s + DAY_S / 2), WEEK_S) - tow_s[0])
        begin_s = float(utc_to_gps_s(stated_s))
        if not begin_s <= gps_s[0] < begin_s + DAY_S:
            said = dt.datetime.fromtimestamp(stated_s, dt.UTC).isoweekday() % 7
            raise InputError(
                f"{name}: its first position is of a {day_of_week(tow_s[0])} (GPS time of the week), and the date "
                f"stated, {options.date}, is a {_DAYS[said]}.",
                "The log carries the day of the week but no date, so that one of the two is of another day.",
                "State the UTC date of the log's first position.",
                code="date-contradicted",
            )
        return gps_s
    if options.near_s is not None:
        near_s = utc_to_gps_s(options.near_s)
        return unroll(tow_s, WEEK_S) + float(nearest_in_cycle(tow_s[0], near_s, WEEK_S) - tow_s[0])
    return None


def no_week(tow_s: FloatArray, name: str) -> InputError:
    """The error of a log that shows only the time of the week."""
    return InputError(
        f"{name}: none of its messages says the date, only times of the GPS week ({week_face(tow_s[0])} to "
        f"{week_face(tow_s[-1])}).",
        "Without the day the positions cannot be set beside scans, nor their coordinates beside an epoch.",
        'Write `date = "YYYY-MM-DD"` under `[recording]`: the UTC date of the first position.',
        code="no-date",
    )


def day_of_week(tow_s: float) -> str:
    """Name of the day of a time of the GPS week."""
    return _DAYS[int(tow_s // DAY_S) % 7]


def week_face(tow_s: float) -> str:
    """Day and time of day of a time of the GPS week, such as ``Tuesday 18:58:59.950``."""
    return f"{day_of_week(tow_s)} {iso_utc(float(tow_s) % DAY_S)[11:23]}"
