"""Which time a LAS file carries: what it says, and what its first points show."""

from __future__ import annotations

import datetime as dt
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from furrowmap.core.readers.las.header import LasHeader
from furrowmap.core.values.clock import GPS_EPOCH_S, LAS_STANDARD_OFFSET_S, WEEK_S, las_time_to_utc
from furrowmap.core.values.errors import Notice

FloatArray = NDArray[np.float64]

SAMPLE: Final = 1024
"""Points at the beginning of a file that show which time it is."""
_FIRST_STANDARD: Final = -LAS_STANDARD_OFFSET_S
_LAST_UTC: Final = dt.datetime(2100, 1, 1, tzinfo=dt.UTC).timestamp()
_LAST_STANDARD: Final = _LAST_UTC - GPS_EPOCH_S - LAS_STANDARD_OFFSET_S
_EARLIEST_UTC: Final = dt.datetime(1993, 1, 1, tzinfo=dt.UTC).timestamp()
"""Before airborne laser scanning with GPS; a time of 0 is adjusted standard time of September 2011."""


class TimeKind(StrEnum):
    """What the field `gps_time` counts."""

    NONE = "none"
    WEEK = "seconds of a GPS week"
    STANDARD = "adjusted standard GPS time"
    UNKNOWN = "neither week nor standard time"


@dataclass(frozen=True)
class LasClock:
    """How the times of a file are to be read.

    Attributes:
        kind: what they count.
    """

    kind: TimeKind

    def checked(self, las_time: NDArray[np.float64]) -> FloatArray:
        """The times (n,), nan where they cannot be what they are said to be."""
        good = is_week(las_time) if self.kind is TimeKind.WEEK else is_standard(las_time)
        return np.asarray(las_time if good.all() else np.where(good, las_time, np.nan), np.float64)

    def utc(self, checked: FloatArray) -> FloatArray | None:
        """UTC of checked times (n,), nan as they are; None where the file does not tell it."""
        if self.kind is not TimeKind.STANDARD:
            return None
        ends = np.array([np.fmin.reduce(checked), np.fmax.reduce(checked)]) if len(checked) else np.zeros(1)
        shift = las_time_to_utc(ends) - ends
        # No leap second in between: spare looking each time up.
        return checked + shift[0] if shift[0] == shift[-1] else las_time_to_utc(checked)


def is_week(las_time: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Which times can be seconds of a week; a flight over its end may count on for a day."""
    return np.asarray((las_time >= 0.0) & (las_time <= WEEK_S * 8.0 / 7.0))


def is_standard(las_time: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Which times can be adjusted standard GPS time of 1980 to 2100."""
    return np.asarray((las_time >= _FIRST_STANDARD) & (las_time <= _LAST_STANDARD))


def clock_of(path: Path, header: LasHeader, sample: FloatArray) -> tuple[LasClock, tuple[Notice, ...]]:
    """How the file's times are to be read, from what it says and from a sample (n,) of them.

    Times of all zeros say nothing, so the file is believed. Where the sample cannot be what the file says but can be
    the other kind, it is that, and a notice tells.
    """
    if not header.has_time:
        return LasClock(TimeKind.NONE), ()
    said = TimeKind.STANDARD if header.says_standard_time else TimeKind.WEEK
    told = sample[np.isfinite(sample) & (sample != 0.0)]
    if not len(told):
        return LasClock(said), ()
    first, last = float(told.min()), float(told.max())
    week, standard = float(np.mean(is_week(told))), float(np.mean(is_standard(told) & ~is_week(told)))
    if said is TimeKind.WEEK and standard > 0.5 and _plausible(np.median(told)):
        text = (
            f"{path.name}: the header calls its GPS times seconds of a week, which has {WEEK_S:,}; they are "
            f"{first:.3f} to {last:.3f}, so they are taken for adjusted standard GPS time."
        )
        return LasClock(TimeKind.STANDARD), (Notice("gps-time-type", text),)
    if said is TimeKind.STANDARD and week > 0.5 and not _made_in_2011(header):
        text = (
            f"{path.name}: the header calls its GPS times adjusted standard time, but {first:.3f} to {last:.3f} would "
            "be in September 2011; they are taken for seconds of a week, which the file does not name."
        )
        return LasClock(TimeKind.WEEK), (Notice("gps-time-type", text),)
    if week + standard < 0.5:
        text = f"{path.name}: its GPS times ({first:g} to {last:g}) are neither seconds of a week nor of 1980 to 2100."
        return LasClock(TimeKind.UNKNOWN), (Notice("gps-time-impossible", text),)
    if said is TimeKind.WEEK and standard > 0.5:
        text = f"{path.name}: its GPS times ({first:g} to {last:g}) are no seconds of a week, as the header calls them."
        return LasClock(TimeKind.UNKNOWN), (Notice("gps-time-impossible", text),)
    return LasClock(said), ()


def _plausible(las_time: float) -> bool:
    return bool(_EARLIEST_UTC <= las_time_to_utc(las_time) <= dt.datetime.now(dt.UTC).timestamp() + 366 * 86_400)


def _made_in_2011(header: LasHeader) -> bool:
    """Whether it may truly be from that week: then it was made then or later in that year."""
    return header.created is not None and header.created.year in (2011, 2012)
