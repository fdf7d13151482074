"""Trajectories from other software: time scales and order of the poses in all formats, and the reader of CSV."""

import difflib
import re
from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, ClassVar, Final

import numpy as np

from furrowmap.core.readers.csv_file import TIMES, Column, CsvFile, head_columns, names_a_position
from furrowmap.core.readers.epochs import utc_of
from furrowmap.core.readers.facts import pose_facts, timing_facts, utc_facts
from furrowmap.core.readers.implausible_positions import far_from_middle, is_implausible, strays
from furrowmap.core.readers.reader import FileReader, Inspection, ReadOptions
from furrowmap.core.readers.source import Head
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

    def track(self, options: ReadOptions, notices: list[Notice]) -> PoseTrack:
        """The poses in UTC; those out of order are dropped with a notice.

        InputError if the week or the time scale is unknown, or too many poses are out of order.
        """
        return self._in_order(utc_of(self.seconds, self.scale, self.name, options), notices)

    def facts(self, options: ReadOptions, notices: list[Notice]) -> tuple[dict[str, Any], tuple[ClockReading, ...]]:
        """Facts and clock for an inspection; an unknown week is only a notice; InputError as :meth:`track`."""
        try:
            track = self.track(options, notices)
        except InputError as error:
            if error.code != "no-gps-week":
                raise
            notices.append(Notice.from_error(error))
            track = self._in_order(unroll(self.seconds, WEEK_S), notices)
            first, last = round(float(track.t_s[0]), 3), round(float(track.t_s[-1]), 3)
            return {"seconds_of_week": [first, last], **timing_facts(track.t_s), **pose_facts(track)}, ()
        clock = ClockReading(Clock.STATED, float(track.t_s[0]), float(track.t_s[-1]), self.scale_note)
        return {**utc_facts(track.t_s), **timing_facts(track.t_s), **pose_facts(track)}, (clock,)

    def _in_order(self, t_s: FloatArray, notices: list[Notice]) -> PoseTrack:
        keep = runs_forward(t_s)
        repeated = np.zeros(len(t_s), bool)
        repeated[1:] = np.diff(t_s) == 0
        backward = ~keep & ~repeated
        if backward.sum() > MAX_LATE_SHARE * len(t_s):
            row = int(np.flatnonzero(backward)[0])
            raise InputError(
                "time-disorder.in-order", name=self.name, backward=int(backward.sum()), t_s=len(t_s), row=row + 1
            )
        for key, rows in (("poses-repeated", repeated), ("time-runs-back.poses", backward)):
            if rows.any():
                notices.append(Notice(key, name=self.name, rows=int(rows.sum()), count=len(t_s)))
        t_s, values = self._near(t_s[keep], self.values[keep], notices)
        return PoseTrack(
            t_s=t_s,
            position=values[:, 0:3],
            projected=self.projected,
            roll_deg=values[:, 3],
            pitch_deg=values[:, 4],
            heading_deg=heading_deg(values[:, 5]),
            true_north=self.true_north,
            sigma=values[:, 6:12],
            source=self.name,
        )

    def _near(self, t_s: FloatArray, values: FloatArray, notices: list[Notice]) -> tuple[FloatArray, FloatArray]:
        """Times (n,) and values (n, 12) without the poses that lie where the recording cannot have been."""
        x, y, h = values[:, :3].T
        xyz_m = values[:, :2] if self.projected else earth_centred_m(x, y, h)
        far = far_from_middle(xyz_m) if self.projected else is_implausible((x + 180.0) % 360.0 - 180.0, y, h)
        far[~far] = strays(t_s[~far], xyz_m[~far], np.zeros(int((~far).sum())))
        if not far.any():
            return t_s, values
        count, first = int(far.sum()), int(np.flatnonzero(far)[0])
        found = {"far": count, "far_count": len(far), "far_2": first + 1, "t_s": iso_utc(t_s[first])}
        if 2 * count > len(far):
            raise InputError("positions-impossible.near", name=self.name, **found)
        notices.append(Notice("positions-elsewhere.near", name=self.name, **found))
        return t_s[~far], values[~far]


class PoseFile(FileReader, ABC):
    """A reader of a trajectory from other software; of the options, `time`, `week` and `near_s` are used."""

    @abstractmethod
    def _read(self, path: Path) -> RawPoses:
        """The poses of a file; damage to it is added to `notices`."""

    def poses(self) -> PoseTrack:
        """All poses of all files; InputError if one cannot be read, the week is unknown, or they are out of order."""
        self.notices = []
        return joined([self._read(path) for path in self.paths]).track(self.options, self.notices)

    def inspect(self) -> Inspection:
        """Read the whole first file and report what it contains."""
        self.notices = []
        facts, clocks = self._read(self.paths[0]).facts(self.options, self.notices)
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


PROJECTED_COLUMNS: Final = ("e_m", "n_m", "h_m")
GEOGRAPHIC_COLUMNS: Final = ("lon_deg", "lat_deg", "h_m")
ATTITUDE_COLUMNS: Final = ("roll_deg", "pitch_deg", "heading_deg")
POSE_SIGMA_COLUMNS: Final = (
    "sigma_e_m", "sigma_n_m", "sigma_h_m", "sigma_roll_deg", "sigma_pitch_deg", "sigma_heading_deg",
)  # fmt: skip
POSE_CSV_COLUMNS: Final = frozenset(
    (*TIMES, *PROJECTED_COLUMNS, *GEOGRAPHIC_COLUMNS, *ATTITUDE_COLUMNS, *POSE_SIGMA_COLUMNS)
)
NEEDED: Final = 7
"""Number of required columns: time, three of position, three of attitude."""

POSE_RANGES: Final = {
    "time_unix_s": (315_964_800.0, 4_102_444_800.0),
    "lon_deg": (-180.0, 360.0),
    "lat_deg": (-90.0, 90.0),
    "roll_deg": (-180.0, 180.0),
    "pitch_deg": (-90.0, 90.0),
    "heading_deg": (-360.0, 720.0),
}
"""Valid range of a column; other values are in another unit or belong to another column."""


class PoseCsv(PoseFile):
    """Poses from CSV files with the columns of :data:`POSE_CSV_COLUMNS`.

    `time_unix_s` is UTC in POSIX seconds. `time_gps_s` is GPS time since 1980-01-06, or seconds of the GPS week given
    by `ReadOptions.week` or `ReadOptions.near_s`. Positions are easting, northing and height in the session's map
    frame, or longitude, latitude and ellipsoidal height; if a file has both, the former are used. Heading is clockwise
    from grid north. Rows with an empty field are dropped with a notice.
    """

    format: ClassVar[str] = "pose-csv"
    title: ClassVar[str] = "trajectory in CSV"

    @classmethod
    def recognise(cls, head: Head) -> float:
        """Certain with columns of time, attitude and position; possible if any column names contain roll and pitch."""
        names = set(head_columns(head))
        known = names & POSE_CSV_COLUMNS
        if known & set(TIMES) and known & set(ATTITUDE_COLUMNS):
            return 1.0 if any(map(names_a_position, names)) else 0.6
        if len(known) >= 3:
            return 0.6
        words = " ".join(names).lower()
        return 0.2 if len(names) >= 6 and "roll" in words and "pitch" in words else 0.0

    def inspect(self) -> Inspection:
        """Read the whole first file and report what it contains, its columns and where it is."""
        inspection = super().inspect()
        with CsvFile(self.paths[0], []) as file:
            columns = _columns(file)
            place = _place(file) if PROJECTED_COLUMNS[0] in columns else {}
        unused = [name for name in file.names if name not in columns]
        facts: dict[str, Any] = {"columns": columns, "unused_columns": unused, **inspection.facts}
        return replace(inspection, facts=facts | ({"place": place} if place else {}))

    def _read(self, path: Path) -> RawPoses:
        with CsvFile(path, self.notices) as file:
            columns = _columns(file)
            _expect_once(file, columns)
            schema = [Column({name: 1.0}, POSE_RANGES.get(name, (-np.inf, np.inf))) for name in columns[:NEEDED]]
            schema += [Column({name: 1.0}, optional=True, sparse=True) for name in POSE_SIGMA_COLUMNS]
            rows = file.rows(schema, outside_key="value-out-of-range.poses")
        if len(rows) < 2:
            raise InputError("no-poses", path=path, found=f"{len(rows)} complete rows below the header")
        time, stated = columns[0], self.options.time
        if stated is not None and stated != ("utc" if time == "time_unix_s" else "gps"):
            raise InputError("time-contradicted", path=path, column=time, stated=stated)
        return RawPoses(
            rows[:, 0],
            TIMES[time],
            f"from its column `{time}`",
            rows[:, 1:],
            projected=PROJECTED_COLUMNS[0] in columns,
            true_north=False,
            name=str(path),
        )


def _columns(file: CsvFile) -> list[str]:
    """The columns to read: time, position (eastings before longitudes), attitude, and standard deviations, if any."""
    names = set(file.names)
    projected = names >= {"e_m", "n_m"} or not {"lon_deg", "lat_deg"} & names
    sigmas = [name for name in POSE_SIGMA_COLUMNS if name in names]
    return [
        file.find(TIMES) or "time_unix_s",
        *(PROJECTED_COLUMNS if projected else GEOGRAPHIC_COLUMNS),
        *ATTITUDE_COLUMNS,
        *sigmas,
    ]


def _expect_once(file: CsvFile, columns: Sequence[str]) -> None:
    for name in columns:
        count = file.names.count(name)
        if count > 1:
            raise InputError("column-twice", path=file.path, count=count, name=name)
        if count == 0:
            raise InputError(
                "missing-column.poses",
                path=file.path,
                name=name,
                other={"time_unix_s": "time_gps_s", "e_m": "lon_deg", "n_m": "lat_deg"}.get(name),
                near=_nearest(name, file.names) or None,
                values=", ".join(("time_unix_s", *PROJECTED_COLUMNS, *ATTITUDE_COLUMNS)),
            )


def _nearest(wanted: str, names: Sequence[str]) -> str:
    """The column that may be meant: one with the same word in its name, or spelt similarly; "" if there is none."""
    word = {"time_unix_s": "time|tow|epoch", "e_m": "east|^x$", "n_m": "north|^y$", "h_m": "height|alt|^z$"}.get(
        wanted, wanted.split("_")[0]
    )
    strangers = [name for name in names if name not in POSE_CSV_COLUMNS]
    same = [name for name in strangers if re.search(word, name.lower())]
    return next(iter(same + difflib.get_close_matches(wanted, strangers, 1, 0.5)), "")


def _place(file: CsvFile) -> dict[str, float]:
    """Latitude and longitude of the first row, if the file has them in addition to easting and northing."""
    try:
        first = next(file.pieces([Column({name: 1.0}) for name in ("lat_deg", "lon_deg")]))[0]
    except (InputError, StopIteration, IndexError):
        return {}
    place = dict(zip(("lat_deg", "lon_deg"), first.tolist(), strict=True))
    return place if all(POSE_RANGES[name][0] <= value <= POSE_RANGES[name][1] for name, value in place.items()) else {}
