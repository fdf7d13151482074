"""Trajectories in CSV, with units in the column names."""

from __future__ import annotations

import difflib
import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any, ClassVar, Final

import numpy as np
from numpy.typing import NDArray

from furrowmap.core.readers.csv_header import columns_of, head_columns, names_a_position
from furrowmap.core.readers.csv_numbers import complete_rows, pieces
from furrowmap.core.readers.poses.file import PoseFile, RawPoses, too_few
from furrowmap.core.readers.reader import Inspection
from furrowmap.core.readers.source import Head, Source
from furrowmap.core.runtime.errors import InputError

FloatArray = NDArray[np.float64]

TIMES: Final = {"time_unix_s": "unix", "time_gps_s": "gps"}
PROJECTED: Final = ("e_m", "n_m", "h_m")
GEOGRAPHIC: Final = ("lon_deg", "lat_deg", "h_m")
ATTITUDE: Final = ("roll_deg", "pitch_deg", "heading_deg")
SIGMAS: Final = ("sigma_e_m", "sigma_n_m", "sigma_h_m", "sigma_roll_deg", "sigma_pitch_deg", "sigma_heading_deg")
KNOWN: Final = frozenset((*TIMES, *PROJECTED, *GEOGRAPHIC, *ATTITUDE, *SIGMAS))
NEEDED: Final = 7
"""Number of required columns: time, three of position, three of attitude."""

WITHIN: Final = {
    "time_unix_s": (315_964_800.0, 4_102_444_800.0),
    "lon_deg": (-180.0, 360.0),
    "lat_deg": (-90.0, 90.0),
    "roll_deg": (-180.0, 180.0),
    "pitch_deg": (-90.0, 90.0),
    "heading_deg": (-360.0, 720.0),
}
"""Valid range of a column; other values are in another unit or belong to another column."""


class PoseCsv(PoseFile):
    """Poses from CSV files with the columns of :data:`KNOWN`.

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
        names = set(head_columns(head) or ())
        known = names & KNOWN
        if known & set(TIMES) and known & set(ATTITUDE):
            return 1.0 if any(map(names_a_position, names)) else 0.6
        if len(known) >= 3:
            return 0.6
        words = " ".join(names).lower()
        return 0.2 if len(names) >= 6 and "roll" in words and "pitch" in words else 0.0

    def inspect(self) -> Inspection:
        """Read the whole first file and report what it contains, its columns and where it is.

        Raises:
            InputError: as :meth:`poses`, but an unknown week is only a notice.
        """
        inspection = super().inspect()
        with Source(self.paths[0]) as source:
            lines = pieces(source, [])
            header = _Header.of(next(lines, b""))
            place = header.place(next(lines, b"").partition(b"\n")[0]) if header.projected else {}
        unused = [name for name in header.names if name not in header.columns]
        facts: dict[str, Any] = {"columns": list(header.columns), "unused_columns": unused, **inspection.facts}
        return replace(inspection, facts=facts | ({"place": place} if place else {}))

    def _read(self, path: Path) -> RawPoses:
        with Source(path) as source:
            lines = pieces(source, self.notices)
            header = _Header.of(next(lines, b""))
            header.check(path)
            names = (header.names, header.separator)
            read = complete_rows(source, lines, names, header.columns, self.notices, NEEDED)
        if len(read) < 2:
            raise too_few(path, f"{len(read)} complete rows below the header")
        _check_units(header, read, path)
        values = np.full((len(read), NEEDED - 1 + len(SIGMAS)), np.nan)
        values[:, : NEEDED - 1] = read[:, 1:NEEDED]
        for k, name in enumerate(header.columns[NEEDED:], start=NEEDED):
            values[:, NEEDED - 1 + SIGMAS.index(name)] = read[:, k]
        scale = TIMES[header.columns[0]]
        self._check_scale(header.columns[0], path)
        note = f"from its column `{header.columns[0]}`"
        return RawPoses(read[:, 0], scale, note, values, projected=header.projected, true_north=False, name=str(path))

    def _check_scale(self, column: str, path: Path) -> None:
        stated = self.options.time
        if stated is not None and stated != ("utc" if column == "time_unix_s" else "gps"):
            raise InputError("time-contradicted", path=path, column=column, stated=stated)


@dataclass(frozen=True)
class _Header:
    """The first line of a CSV file: column names and separator."""

    names: tuple[str, ...]
    separator: str

    @classmethod
    def of(cls, line: bytes) -> _Header:
        names, separator = columns_of(line.decode("utf-8", "replace"))
        return cls(tuple(names), separator)

    @cached_property
    def projected(self) -> bool:
        """Whether positions are easting and northing, which are preferred to longitude and latitude."""
        names = set(self.names)
        return names >= {"e_m", "n_m"} or not {"lon_deg", "lat_deg"} & names

    @cached_property
    def columns(self) -> tuple[str, ...]:
        """The columns to read: time, three of position, three of attitude, and the standard deviations, if any."""
        time = "time_gps_s" if "time_gps_s" in self.names and "time_unix_s" not in self.names else "time_unix_s"
        sigmas = tuple(name for name in SIGMAS if name in self.names)
        return (time, *(PROJECTED if self.projected else GEOGRAPHIC), *ATTITUDE, *sigmas)

    def check(self, path: Path) -> None:
        """Check that each required column is there once."""
        for name in self.columns:
            count = self.names.count(name)
            if count > 1:
                raise InputError("column-twice", path=path, count=count, name=name)
            if count == 0:
                near = _nearest(name, self.names)
                other = {"time_unix_s": "time_gps_s", "e_m": "lon_deg", "n_m": "lat_deg"}.get(name)
                raise InputError(
                    "missing-column.check",
                    path=path,
                    name=name,
                    other=other or None,
                    near=near or None,
                    values=", ".join(("time_unix_s", *PROJECTED, *ATTITUDE)),
                )

    def place(self, row: bytes) -> dict[str, float]:
        """Longitude and latitude in a row, if the file has them in addition to easting and northing."""
        fields = row.decode("latin-1").split(self.separator)
        try:
            place = {name: float(fields[self.names.index(name)]) for name in ("lat_deg", "lon_deg")}
        except (ValueError, IndexError):
            return {}
        return place if all(WITHIN[name][0] <= value <= WITHIN[name][1] for name, value in place.items()) else {}


def _nearest(wanted: str, names: Sequence[str]) -> str:
    """The column that may be meant: one with the same word in its name, or spelt similarly; "" if there is none."""
    word = {"time_unix_s": "time|tow|epoch", "e_m": "east|^x$", "n_m": "north|^y$", "h_m": "height|alt|^z$"}.get(
        wanted, wanted.split("_")[0]
    )
    strangers = [name for name in names if name not in KNOWN]
    same = [name for name in strangers if re.search(word, name.lower())]
    return next(iter(same + difflib.get_close_matches(wanted, strangers, 1, 0.5)), "")


def _check_units(header: _Header, rows: FloatArray, path: Path) -> None:
    for k, name in enumerate(header.columns[:NEEDED]):
        low, high = WITHIN.get(name, (-np.inf, np.inf))
        outside = (rows[:, k] < low) | (rows[:, k] > high)
        if outside.any():
            row = int(np.flatnonzero(outside)[0])
            raise InputError(
                "value-out-of-range.check-units",
                path=path,
                row=row + 1,
                name=name,
                rows=rows[row, k],
                low=low,
                high=high,
            )
