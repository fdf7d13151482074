"""What all files with trajectories from elsewhere have in common: their times, and the order of their poses."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from furrowmap.core.readers.facts import pose_facts, timing_facts, utc_facts
from furrowmap.core.readers.reader import ClockReading, ReadOptions
from furrowmap.core.values.clock import (
    GPS_EPOCH_S,
    WEEK_S,
    gps_to_utc_s,
    nearest_in_cycle,
    runs_forward,
    unroll,
    utc_to_gps_s,
)
from furrowmap.core.values.errors import InputError, Notice
from furrowmap.core.values.pose_track import PoseTrack
from furrowmap.core.values.rotation import heading_deg
from furrowmap.core.values.scan import Clock

FloatArray = NDArray[np.float64]

MOST_DISORDER: Final = 0.01
"""Share of poses running backwards from which on a trajectory is refused instead of thinned."""
EARLIEST_S: Final = 10 * 365.25 * 86_400.0
"""Seconds since 1980-01-06 below which a time is no whole one: there was no complete GPS before 1990."""


@dataclass(frozen=True)
class RawPoses:
    """Poses of one or more files, with times as the files have them and rows in their order.

    Attributes:
        seconds: (n,) in the scale of `scale`.
        scale: "unix" (UTC since 1970), "gps" or "utc" (both since 1980-01-06 or since the week began, Sunday 0 h).
        scale_note: who says so.
        values: (n, 12): position, roll, pitch, heading, and the six standard deviations of :class:`PoseTrack`.
        projected: as in :class:`PoseTrack`.
        true_north: as in :class:`PoseTrack`.
        name: of the files, for messages.
    """

    seconds: FloatArray
    scale: str
    scale_note: str
    values: FloatArray
    projected: bool
    true_north: bool
    name: str

    def track(self, options: ReadOptions, notices: list[Notice]) -> PoseTrack:
        """The poses in UTC; those out of order are left out and told in `notices`.

        Args:
            options: `week`, else `near_s`, tells the week of times that count from its beginning.
            notices: grows.

        Raises:
            InputError: if the week is unknown, the times are of no known kind, or the poses are out of order.
        """
        return self._in_order(self._utc_s(options), notices)

    def tell(self, options: ReadOptions, notices: list[Notice]) -> tuple[dict[str, Any], tuple[ClockReading, ...]]:
        """Facts and clock for an inspection; an unknown week is only told.

        Raises:
            InputError: as :meth:`track`, but for an unknown week.
        """
        try:
            track = self.track(options, notices)
        except InputError as error:
            if error.code != "no-gps-week":
                raise
            notices.append(Notice.of(error))
            track = self._in_order(unroll(self.seconds, WEEK_S), notices)
            first, last = round(float(track.t_s[0]), 3), round(float(track.t_s[-1]), 3)
            return {"seconds_of_week": [first, last], **timing_facts(track.t_s), **pose_facts(track)}, ()
        clock = ClockReading(Clock.STATED, float(track.t_s[0]), float(track.t_s[-1]), self.scale_note)
        return {**utc_facts(track.t_s), **timing_facts(track.t_s), **pose_facts(track)}, (clock,)

    def _utc_s(self, options: ReadOptions) -> FloatArray:
        if self.scale == "unix":
            return self.seconds
        since_1980 = self.seconds
        if bool(np.all((self.seconds >= 0) & (self.seconds < 2 * WEEK_S))):
            # Some processors let the seconds run on into the next week, others begin it anew.
            since_1980 = self._of_week(unroll(self.seconds, WEEK_S), options)
        elif not bool(np.all(self.seconds >= EARLIEST_S)):
            raise InputError(
                f"{self.name}: times of {self.seconds.min():.3f} to {self.seconds.max():.3f} s are of no known kind.",
                "They count neither from a week's beginning nor from 1980-01-06, so they cannot be brought to UTC.",
                "Write GPS seconds of the week, or since 1980-01-06 (adjusted standard GPS time plus 1e9).",
                code="unknown-time-scale",
            )
        return since_1980 + GPS_EPOCH_S if self.scale == "utc" else gps_to_utc_s(since_1980)

    def _of_week(self, within: FloatArray, options: ReadOptions) -> FloatArray:
        if options.week is not None:
            return within + options.week * WEEK_S
        if options.near_s is not None:
            near = options.near_s - GPS_EPOCH_S if self.scale == "utc" else float(utc_to_gps_s(options.near_s))
            return within + float(nearest_in_cycle(within[0], near, WEEK_S) - within[0])
        raise InputError(
            f"{self.name}: its times, {within[0]:.3f} to {within[-1]:.3f} s, count from an unknown week's beginning.",
            "Without the week the poses cannot be set beside scans.",
            "Write `week = N` under `[trajectory]`: weeks since 1980-01-06, as 2422 for the one begun on 2026-06-07.",
            code="no-gps-week",
        )

    def _in_order(self, t_s: FloatArray, notices: list[Notice]) -> PoseTrack:
        keep = runs_forward(t_s)
        repeated = np.zeros(len(t_s), bool)
        repeated[1:] = np.diff(t_s) == 0
        backward = ~keep & ~repeated
        if backward.sum() > MOST_DISORDER * len(t_s):
            row = int(np.flatnonzero(backward)[0])
            raise InputError(
                f"{self.name}: pose {row + 1} and {int(backward.sum()) - 1} more of {len(t_s)} come after later ones.",
                "A trajectory is one way through time; this is two, or one that was shuffled.",
                "Sort the file by time, or give its pieces as files of their own in the order of time.",
                code="time-disorder",
            )
        for code, rows, words in (
            ("poses-repeated", repeated, "repeat the time before them"),
            ("time-runs-back", backward, "are not later than all before them"),
        ):
            if rows.any():
                text = f"{self.name}: {int(rows.sum())} of {len(t_s)} poses {words} and are left out."
                notices.append(Notice(code, text))
        values = self.values[keep]
        return PoseTrack(
            t_s=t_s[keep],
            position=values[:, 0:3],
            projected=self.projected,
            roll_deg=values[:, 3],
            pitch_deg=values[:, 4],
            heading_deg=heading_deg(values[:, 5]),
            true_north=self.true_north,
            sigma=values[:, 6:12],
            source=self.name,
        )


def joined(parts: list[RawPoses]) -> RawPoses:
    """The poses of several files, one after the other.

    Raises:
        InputError: if time or position mean different things in them.
    """
    first = parts[0]
    for part in parts[1:]:
        if (part.scale, part.projected, part.true_north) != (first.scale, first.projected, first.true_north):
            raise InputError(
                f"{part.name} has other times or positions than {first.name}.",
                "The files of one trajectory are read as one, so these must mean the same in all.",
                "Export them alike.",
                code="mixed-trajectories",
            )
    if len(parts) == 1:
        return first
    return RawPoses(
        np.concatenate([part.seconds for part in parts]),
        first.scale,
        first.scale_note,
        np.concatenate([part.values for part in parts]),
        first.projected,
        first.true_north,
        f"{first.name} and {len(parts) - 1} more",
    )


def too_few(path: Path, found: str) -> InputError:
    """The error of a file that holds fewer than two poses; `found` says what it does hold."""
    return InputError(
        f"{path}: {found}.",
        "A trajectory needs at least two poses.",
        "Export it again, or copy the file again; perhaps the writing was stopped at once.",
        code="no-poses",
    )
