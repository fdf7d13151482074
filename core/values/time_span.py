"""The part of a recording between two times, and numbered intervals of time: passes of a tool, strips of a flight."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Final, Protocol, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from furrowmap.core.runtime.errors import InputError
from furrowmap.core.runtime.iteration import close
from furrowmap.core.runtime.kernels import kernel
from furrowmap.core.runtime.languages.texts import Text
from furrowmap.core.values.clock import iso_utc
from furrowmap.core.values.gnss import GnssTrack
from furrowmap.core.values.inertial import InertialTrack
from furrowmap.core.values.pose_track import PoseTrack
from furrowmap.core.values.scan import Scan

Track = TypeVar("Track", GnssTrack, PoseTrack)
Span = tuple[float, float]
"""First and last UTC (POSIX seconds), both included; infinite where open."""
WHOLE_SPAN: Final[Span] = (-math.inf, math.inf)


def scans_within(scans: Iterator[Scan], span_s: Span, minus_s: float = 0.0) -> Iterator[Scan]:
    """The returns of scans in a span, by their times less `minus_s`.

    What follows the end of the span is not read: the scans are closed there, so that their reader says what it found up
    to there, and raises what it raises at the end of its files.
    """
    for scan in scans:
        if minus_s:
            scan = replace(scan, t_s=scan.t_s - minus_s)
        if span_s == WHOLE_SPAN:
            yield scan
            continue
        if not len(scan) or scan.t_s[-1] < span_s[0]:
            continue
        if scan.t_s[0] > span_s[1]:
            close(scans)
            return
        inside = (scan.t_s >= span_s[0]) & (scan.t_s <= span_s[1])
        yield scan if inside.all() else replace(scan[inside], whole=False)


def track_within(track: Track, span_s: Span) -> Track:
    """The positions or poses in a span. Raises InputError if there is none."""
    if span_s == WHOLE_SPAN:
        return track
    inside = (track.t_s >= span_s[0]) & (track.t_s <= span_s[1])
    if inside.any():
        return track[inside]
    first_s, last_s = span_s
    raise InputError(
        "no-such-time",
        source=track.source,
        wanted=Text(
            "{first} to {last}",
            first=Text("the start") if first_s == -math.inf else iso_utc(first_s),
            last=Text("the end") if last_s == math.inf else iso_utc(last_s),
        ),
        first_time=iso_utc(float(track.t_s[0])) if len(track) else None,
        last_time=iso_utc(float(track.t_s[-1])) if len(track) else None,
    )


def inertial_within(measured: InertialTrack, span_s: Span) -> InertialTrack:
    """The measurements of an IMU in a span."""
    first = np.searchsorted(measured.t_s, span_s[0])
    end = np.searchsorted(measured.t_s, span_s[1], side="right")
    return measured.part(slice(int(first), int(end)))


class Interval(Protocol):
    """Something that begins and ends."""

    @property
    def begin_s(self) -> float:
        """UTC of its beginning."""
        ...

    @property
    def end_s(self) -> float:
        """UTC of its end."""
        ...


def interval_numbers(intervals: Sequence[Interval], t_s: ArrayLike) -> NDArray[np.intp]:
    """Number (n,) from 1 of the interval, of several in order of time, at times (n,), ends included; 0 between them."""
    begin_s, end_s = np.array([(when.begin_s, when.end_s) for when in intervals], np.float64).reshape(-1, 2).T.copy()
    out: NDArray[np.intp] = _numbers(np.atleast_1d(np.array(t_s, np.float64)), begin_s, end_s)
    return out


@kernel()
def _numbers(t_s, begin_s, end_s):  # type: ignore[no-untyped-def]
    """Kernel of :func:`interval_numbers`, which steps from the interval of one time to that of the next."""
    out = np.zeros(len(t_s), np.int64)
    number = 0
    for i in range(len(t_s)):
        while number < len(begin_s) and t_s[i] >= begin_s[number]:
            number += 1
        while number > 0 and t_s[i] < begin_s[number - 1]:
            number -= 1
        if number > 0 and t_s[i] <= end_s[number - 1]:
            out[i] = number
    return out
