"""The meaning of GPS times in a LAS file, from its header and its first points."""

from __future__ import annotations

import datetime as dt
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from furrowmap.core.readers.las.header import LasHeader
from furrowmap.core.runtime.arrays import FloatArray
from furrowmap.core.runtime.errors import Notice
from furrowmap.core.values.clock import DAY_S, GPS_EPOCH_S, LAS_STANDARD_OFFSET_S, WEEK_S, las_time_to_utc

TIME_SAMPLE: Final = 1024
"""Number of points at the start of a file from which the meaning of its times is derived."""
_FIRST_STANDARD: Final = -LAS_STANDARD_OFFSET_S
_LAST_UTC: Final = dt.datetime(2100, 1, 1, tzinfo=dt.UTC).timestamp()
_LAST_STANDARD: Final = _LAST_UTC - GPS_EPOCH_S - LAS_STANDARD_OFFSET_S
_EARLIEST_UTC: Final = dt.datetime(1993, 1, 1, tzinfo=dt.UTC).timestamp()
"""Before airborne laser scanning with GPS. (A time of 0 as adjusted standard time is in September 2011.)"""


class TimeKind(StrEnum):
    """Meaning of the field `gps_time`."""

    NONE = "none"
    WEEK = "seconds of a GPS week"
    STANDARD = "adjusted standard GPS time"
    UNKNOWN = "neither week nor standard time"


@dataclass(frozen=True)
class LasClock:
    """The meaning of a file's times.

    Attributes:
        kind: see :class:`TimeKind`.
    """

    kind: TimeKind

    def checked(self, las_time: NDArray[np.float64]) -> FloatArray:
        """The times (n,), nan where they are not valid for their kind."""
        good = is_week(las_time) if self.kind is TimeKind.WEEK else is_standard(las_time)
        return np.asarray(las_time if good.all() else np.where(good, las_time, np.nan), np.float64)

    def utc(self, checked: FloatArray) -> FloatArray | None:
        """UTC of checked times (n,), nan where they are; None for seconds of a week that the file does not state."""
        if self.kind is not TimeKind.STANDARD:
            return None
        ends = np.array([np.fmin.reduce(checked), np.fmax.reduce(checked)]) if len(checked) else np.zeros(1)
        shift = las_time_to_utc(ends) - ends
        # No leap second in between: no need to look up each time.
        return checked + shift[0] if shift[0] == shift[-1] else las_time_to_utc(checked)


def is_week(las_time: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Which times may be seconds of a week; a flight over its end may continue for a day."""
    return np.asarray((las_time >= 0.0) & (las_time <= WEEK_S * 8.0 / 7.0))


def is_standard(las_time: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Which times may be adjusted standard GPS time of 1980 to 2100."""
    return np.asarray((las_time >= _FIRST_STANDARD) & (las_time <= _LAST_STANDARD))


def clock_of(path: Path, header: LasHeader, sample: FloatArray) -> tuple[LasClock, tuple[Notice, ...]]:
    """The meaning of the file's times, from its header and a sample (n,) of them.

    If all times are 0, the header decides. If the sample is not valid for the kind in the header but for the other one,
    the other one is used, with a notice.
    """
    if not header.has_time:
        return LasClock(TimeKind.NONE), ()
    declared = TimeKind.STANDARD if header.is_standard_time else TimeKind.WEEK
    known = sample[np.isfinite(sample) & (sample != 0.0)]
    if not len(known):
        return LasClock(declared), ()
    first, last = float(known.min()), float(known.max())
    week, standard = float(np.mean(is_week(known))), float(np.mean(is_standard(known) & ~is_week(known)))
    latest_s = dt.datetime.now(dt.UTC).timestamp() + 366 * DAY_S
    if declared is TimeKind.WEEK and standard > 0.5 and _EARLIEST_UTC <= las_time_to_utc(np.median(known)) <= latest_s:
        return LasClock(TimeKind.STANDARD), (
            Notice("gps-time-type", path=path.name, week_s=WEEK_S, first=first, last=last),
        )
    of_2011 = header.created is not None and header.created.year in (2011, 2012)  # times of that week, perhaps
    if declared is TimeKind.STANDARD and week > 0.5 and not of_2011:
        return LasClock(TimeKind.WEEK), (Notice("gps-time-type.clock-of", path=path.name, first=first, last=last),)
    if week + standard < 0.5:
        return LasClock(TimeKind.UNKNOWN), (Notice("gps-time-impossible", path=path.name, first=first, last=last),)
    if declared is TimeKind.WEEK and standard > 0.5:
        return LasClock(TimeKind.UNKNOWN), (
            Notice("gps-time-impossible.clock-of", path=path.name, first=first, last=last),
        )
    return LasClock(declared), ()
