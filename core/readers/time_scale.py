"""Times of trajectories and of inertial measurements, in UTC."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from furrowmap.core.readers.reader import ReadOptions
from furrowmap.core.runtime.errors import InputError
from furrowmap.core.values.clock import GPS_EPOCH_S, WEEK_S, gps_to_utc_s, nearest_in_cycle, unroll, utc_to_gps_s

FloatArray = NDArray[np.float64]

EARLIEST_S: Final = 10 * 365.25 * 86_400.0
"""Seconds since 1980-01-06 that are below this are not absolute times: GPS was not complete before 1990."""


def utc_of(seconds: FloatArray, scale: str, name: str, options: ReadOptions) -> FloatArray:
    """UTC (n,) of times (n,).

    Args:
        seconds: in the order of the file.
        scale: "unix" (UTC since 1970), "gps" or "utc" (both since 1980-01-06 or since the start of the week, Sunday
            0 h).
        name: of the file, for messages.
        options: `week`, else `near_s`, gives the week of times that count from its start.

    Raises:
        InputError: if the week or the time scale is unknown.
    """
    if scale == "unix":
        return seconds
    since_1980 = seconds
    if bool(np.all((seconds >= 0) & (seconds < 2 * WEEK_S))):
        # Some processors continue the seconds into the next week, others restart them.
        since_1980 = _of_week(unroll(seconds, WEEK_S), scale, name, options)
    elif not bool(np.all(seconds >= EARLIEST_S)):
        raise InputError("unknown-time-scale", name=name, seconds=seconds.min(), seconds_max=seconds.max())
    return since_1980 + GPS_EPOCH_S if scale == "utc" else gps_to_utc_s(since_1980)


def _of_week(within: FloatArray, scale: str, name: str, options: ReadOptions) -> FloatArray:
    if options.week is not None:
        return within + options.week * WEEK_S
    if options.near_s is not None:
        near = options.near_s - GPS_EPOCH_S if scale == "utc" else float(utc_to_gps_s(options.near_s))
        return within + float(nearest_in_cycle(within[0], near, WEEK_S) - within[0])
    raise InputError("no-gps-week", name=name, within=within[0], within_last=within[-1])
