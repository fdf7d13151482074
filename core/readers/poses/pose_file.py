"""Trajectories from other software: what all formats have in common, namely time scales and the order of the poses."""

from abc import ABC, abstractmethod
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from furrowmap.core.geodesy.longitudes import west_east_deg
from furrowmap.core.readers.epochs import timing_facts, utc_facts, utc_of
from furrowmap.core.readers.implausible_positions import far_from_middle, is_implausible, strays
from furrowmap.core.readers.reader import FileReader, Inspection, ReadOptions
from furrowmap.core.runtime.arrays import FloatArray
from furrowmap.core.runtime.errors import InputError, Notice
from furrowmap.core.values.clock import WEEK_S, iso_utc, runs_forward, unroll
from furrowmap.core.values.earth import earth_centred_m
from furrowmap.core.values.pose_track import PoseTrack
from furrowmap.core.values.rotation import heading_deg
from furrowmap.core.values.scan import Clock, ClockReading

MAX_LATE_SHARE: Final = 0.01
"""Share of poses out of order above which a trajectory is rejected; below it, they are dropped."""


@dataclass(frozen=True)
class RawPoses:
    """Poses of one or more files, with the times and the order of the files.

    Attributes:
        seconds: (n,) in the time scale `scale`.
        scale: "unix" (UTC since 1970), "gps" or "utc" (both since 1980-01-06 or since the start of the week, Sunday
            0 h).
        values: (n, 12): position, roll, pitch, heading, and the six standard deviations of :class:`PoseTrack`.
    """

    seconds: FloatArray
    scale: str
    scale_note: str
    values: FloatArray
    projected: bool
    true_north: bool
    name: str

    def track(self, options: ReadOptions) -> tuple[PoseTrack, list[Notice]]:
        """The poses in UTC; those out of order are dropped with a notice.

        InputError if the week or the time scale is unknown, or too many poses are out of order.
        """
        return self._in_order(utc_of(self.seconds, self.scale, self.name, options))

    def facts(self, options: ReadOptions) -> tuple[dict[str, Any], tuple[ClockReading, ...], list[Notice]]:
        """Facts, clock and notices for an inspection; an unknown week is only a notice; InputError as :meth:`track`."""
        try:
            track, notices = self.track(options)
        except InputError as error:
            if error.code != "no-gps-week":
                raise
            track, notices = self._in_order(unroll(self.seconds, WEEK_S))
            first = round(float(track.t_s[0]), 3)
            last = round(float(track.t_s[-1]), 3)
            facts: dict[str, Any] = {"seconds_of_week": [first, last], **timing_facts(track.t_s), **pose_facts(track)}
            return facts, (), [Notice.from_error(error), *notices]
        clock = ClockReading(Clock.STATED, float(track.t_s[0]), float(track.t_s[-1]), self.scale_note)
        return {**utc_facts(track.t_s), **timing_facts(track.t_s), **pose_facts(track)}, (clock,), notices

    def _in_order(self, t_s: FloatArray) -> tuple[PoseTrack, list[Notice]]:
        keep = runs_forward(t_s)
        repeated = np.zeros(len(t_s), bool)
        repeated[1:] = np.diff(t_s) == 0
        backward = ~keep & ~repeated
        if backward.sum() > MAX_LATE_SHARE * len(t_s):
            row = int(np.flatnonzero(backward)[0])
            raise InputError(
                "time-disorder.pose-order", name=self.name, backward=int(backward.sum()), poses=len(t_s), row=row + 1
            )
        dropped = (("poses-repeated", repeated), ("time-runs-back.pose-rows", backward))
        notices = [
            Notice(key, name=self.name, rows=int(rows.sum()), count=len(t_s)) for key, rows in dropped if rows.any()
        ]
        far, elsewhere = self._far(t_s[keep], self.values[keep])
        values = self.values[keep][~far]
        track = PoseTrack(
            t_s=t_s[keep][~far],
            position=values[:, 0:3],
            projected=self.projected,
            roll_deg=values[:, 3],
            pitch_deg=values[:, 4],
            heading_deg=heading_deg(values[:, 5]),
            true_north=self.true_north,
            sigma=values[:, 6:12],
            source=self.name,
        )
        return track, notices + elsewhere

    def _far(self, t_s: FloatArray, values: FloatArray) -> tuple[NDArray[np.bool_], list[Notice]]:
        """Which poses, of times (n,) and values (n, 12), lie where the recording cannot have been."""
        x, y, h = values[:, :3].T
        xyz_m = values[:, :2] if self.projected else earth_centred_m(x, y, h)
        far = far_from_middle(xyz_m) if self.projected else is_implausible((x + 180.0) % 360.0 - 180.0, y, h)
        far[~far] = strays(t_s[~far], xyz_m[~far], np.zeros(int((~far).sum())))
        if not far.any():
            return far, []
        count = int(far.sum())
        first = int(np.flatnonzero(far)[0])
        found = {"far": count, "far_count": len(far), "first_pose": first + 1, "first_time": iso_utc(t_s[first])}
        if 2 * count > len(far):
            raise InputError("positions-impossible.stray-poses", name=self.name, **found)
        return far, [Notice("positions-elsewhere.stray-poses", name=self.name, **found)]


class PoseFile(FileReader, ABC):
    """A reader of a trajectory from other software; of the options, `time`, `week` and `near_s` are used."""

    @abstractmethod
    def _read(self, path: Path) -> RawPoses:
        """The poses of a file; damage to it is added to `notices`."""

    def poses(self) -> PoseTrack:
        """All poses of all files; InputError if one cannot be read, the week is unknown, or they are out of order."""
        self.notices = []
        track, dropped = joined([self._read(path) for path in self.paths]).track(self.options)
        self.notices += dropped
        return track

    def inspect(self) -> Inspection:
        """Read the whole first file and report what it contains."""
        self.notices = []
        facts, clocks, dropped = self._read(self.paths[0]).facts(self.options)
        self.notices += dropped
        return Inspection(self.paths[0], self.format, self.title, facts, clocks, tuple(self.notices))


def joined(parts: list[RawPoses]) -> RawPoses:
    """The poses of several files; InputError if their time scales, coordinates or north references differ."""
    first = parts[0]
    for part in parts[1:]:
        if (part.scale, part.projected, part.true_north) != (first.scale, first.projected, first.true_north):
            raise InputError("mixed-trajectories", part=part.name, first=first.name)
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


def pose_facts(track: PoseTrack) -> dict[str, Any]:
    """Number, location and attitude of poses, as [minimum, maximum]; longitudes as [west, east]."""
    names = ("e_m", "n_m", "h_m") if track.projected else ("lon_deg", "lat_deg", "h_m")
    columns = dict(zip(names, track.position.T, strict=True))
    columns |= {"roll_deg": track.roll_deg, "pitch_deg": track.pitch_deg}
    digits = {"lon_deg": 7, "lat_deg": 7}
    ranges = {
        name: [round(float(values.min()), digits.get(name, 3)), round(float(values.max()), digits.get(name, 3))]
        for name, values in columns.items()
    }
    if not track.projected:
        ranges["lon_deg"] = [round(end, digits["lon_deg"]) for end in west_east_deg(track.position[:, 0])]
    return {
        "poses": len(track),
        "coordinates": "map frame" if track.projected else "geographic",
        "north": "true" if track.true_north else "grid",
        **ranges,
        "sigmas_stated": bool(np.isfinite(track.sigma).any()),
    }
