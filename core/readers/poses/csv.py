"""Trajectories in CSV, with units in the column names."""

import difflib
import re
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, ClassVar, Final

import numpy as np

from furrowmap.core.readers.column_names import ELLIPSOIDAL_H
from furrowmap.core.readers.csv_file import TIMES, Column, CsvFile, head_columns, names_a_position
from furrowmap.core.readers.poses.pose_file import PoseFile, RawPoses
from furrowmap.core.readers.reader import Inspection
from furrowmap.core.readers.source import Head
from furrowmap.core.runtime.errors import InputError, Notice
from furrowmap.core.runtime.languages.texts import Text

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
    title: ClassVar[Text] = Text("trajectory in CSV")

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
        with CsvFile(self.paths[0]) as file:
            columns = [file.written[file.place(name)] for name in _columns(file)]
            place = _place(file) if file.find(PROJECTED_COLUMNS[:1]) else {}
        unused = [name for name in file.written if name not in columns]
        facts: dict[str, Any] = {"columns": columns, "unused_columns": unused, **inspection.facts}
        return replace(inspection, facts=facts | ({"place": place} if place else {}))

    def _read(self, path: Path) -> RawPoses:
        with CsvFile(path) as file:
            columns = _columns(file)
            _expect_once(file, columns)
            schema = [Column({name: 1.0}, POSE_RANGES.get(name, (-np.inf, np.inf))) for name in columns[:NEEDED]]
            schema += [Column({name: 1.0}, optional=True, sparse=True) for name in POSE_SIGMA_COLUMNS]
            rows = file.rows(schema, outside_key="value-out-of-range.pose-column")
            written = file.written[file.place(columns[3])]
            self._add_notices(*file.notices)
            if columns[1] == GEOGRAPHIC_COLUMNS[0] and columns[3] == "h_m" != written:
                self.notices.append(Notice("columns-by-meaning.height", path=path.name, column=written))
        if len(rows) < 2:
            raise InputError("no-poses", path=path, found=Text("{rows} complete rows below the header", rows=len(rows)))
        time = columns[0]
        stated = self.options.time
        if stated is not None and stated != ("utc" if time == "time_unix_s" else "gps"):
            raise InputError("time-contradicted", path=path, column=time, stated=stated)
        return RawPoses(
            rows[:, 0],
            TIMES[time],
            f"from its column `{time}`",
            rows[:, 1:],
            projected=columns[1] == PROJECTED_COLUMNS[0],
            true_north=False,
            name=str(path),
        )


def _columns(file: CsvFile) -> list[str]:
    """The columns to read: time, position (eastings before longitudes), attitude, and standard deviations, if any."""
    names = set(file.names)
    projected = names >= {"e_m", "n_m"} or not {"lon_deg", "lat_deg"} & names
    sigmas = [name for name in POSE_SIGMA_COLUMNS if name in names]
    h_m = PROJECTED_COLUMNS[2]
    if not projected and h_m not in file.written and file.find([ELLIPSOIDAL_H]):
        h_m = ELLIPSOIDAL_H
    return [
        file.find(TIMES) or "time_unix_s",
        *(PROJECTED_COLUMNS[:2] if projected else GEOGRAPHIC_COLUMNS[:2]),
        h_m,
        *ATTITUDE_COLUMNS,
        *sigmas,
    ]


def _expect_once(file: CsvFile, columns: Sequence[str]) -> None:
    for name in columns:
        count = file.written.count(name)
        if count <= 1 and file.find([name]) is not None:
            continue
        if count > 1:
            raise InputError("column-twice", path=file.path, count=count, name=name)
        strangers = [own for own, meant in zip(file.written, file.names, strict=True) if meant not in POSE_CSV_COLUMNS]
        raise InputError(
            "missing-column.of-poses",
            path=file.path,
            name=name,
            other={"time_unix_s": "time_gps_s", "e_m": "lon_deg", "n_m": "lat_deg"}.get(name),
            near=_nearest(name, strangers) or None,
            values=", ".join(("time_unix_s", *PROJECTED_COLUMNS, *ATTITUDE_COLUMNS)),
        )


def _nearest(wanted: str, strangers: Sequence[str]) -> str:
    """The column that may be meant: one with the same word in its name, or spelt similarly; "" if there is none."""
    word = {"time_unix_s": "time|tow|epoch", "e_m": "east|^x$", "n_m": "north|^y$", "h_m": "height|alt|^z$"}.get(
        wanted, wanted.split("_")[0]
    )
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
