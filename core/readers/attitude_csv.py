"""Attitudes of an AHRS in CSV, with units and the kind of north in the column names."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import ClassVar, Final

import numpy as np
from numpy.typing import NDArray

from furrowmap.core.readers.attitude_rows import attitude_facts, attitude_track
from furrowmap.core.readers.csv_header import columns_of, head_columns, names_a_position
from furrowmap.core.readers.csv_numbers import complete_rows, pieces
from furrowmap.core.readers.inertial_rows import joined_name
from furrowmap.core.readers.reader import FileReader, Inspection
from furrowmap.core.readers.source import Head, Source
from furrowmap.core.readers.time_scale import utc_of
from furrowmap.core.runtime.errors import InputError
from furrowmap.core.values.attitude import GRID, MAGNETIC, TRUE, UNSTATED, AttitudeTrack
from furrowmap.core.values.clock_readings import ClockReading
from furrowmap.core.values.scan import Clock

FloatArray = NDArray[np.float64]

TIMES: Final = {"time_unix_s": "unix", "time_gps_s": "gps"}
LEVEL: Final = ("roll_deg", "pitch_deg")
NORTHS: Final = {
    "heading_true_deg": TRUE,
    "heading_grid_deg": GRID,
    "heading_deg": GRID,
    "heading_magnetic_deg": MAGNETIC,
}
"""Columns of headings, in the order of preference, and the north from which they count."""
LARGEST_DEG: Final = 720.0


class AttitudeCsv(FileReader):
    """Roll and pitch, heading, or all of them, from CSV files.

    The columns are `time_unix_s` (UTC) or `time_gps_s`, `roll_deg` (positive right side down), `pitch_deg` (positive
    nose up), and one of :data:`NORTHS`. Rows with an empty field are dropped with a notice.
    """

    format: ClassVar[str] = "attitude-csv"
    title: ClassVar[str] = "attitudes in CSV"

    @classmethod
    def recognise(cls, head: Head) -> float:
        """Certain with columns of time and of roll and pitch or a heading, and none of a position."""
        names = set(head_columns(head) or ())
        if not names & set(TIMES) or not (names >= set(LEVEL) or names & set(NORTHS)):
            return 0.0
        return 0.3 if any(map(names_a_position, names)) else 0.9

    def attitude(self) -> AttitudeTrack:
        """All attitudes of all files.

        Raises:
            InputError: if a file has no such columns, a field is no number or no angle, or the times do not increase.
        """
        parts = [self._read(path) for path in self.paths]
        t_s, angles = (np.concatenate([part[k] for part in parts]) for k in range(2))
        norths = {part[2] for part in parts}
        north = norths.pop() if len(norths) == 1 else UNSTATED
        return attitude_track(t_s, angles, north, joined_name(self.paths), self.notices)

    def inspect(self) -> Inspection:
        """Read the whole first file and report rate, span, and what it holds.

        Raises:
            InputError: as :meth:`attitude`.
        """
        reader = AttitudeCsv(self.paths[:1], self.options)
        track = reader.attitude()
        clock = ClockReading(Clock.STATED, float(track.t_s[0]), float(track.t_s[-1]), "from its time column")
        facts = attitude_facts(track)
        return Inspection(self.paths[0], self.format, self.title, facts, (clock,), tuple(reader.notices))

    def _read(self, path: Path) -> tuple[FloatArray, FloatArray, str]:
        """UTC (n,), angles (n, 3), and the north of the headings."""
        with Source(path) as source:
            lines = pieces(source, self.notices)
            names, separator = columns_of(next(lines, b"").decode("utf-8", "replace"))
            columns = _columns(names, path)
            rows = complete_rows(source, lines, (names, separator), columns, self.notices)
        angles = np.full((len(rows), 3), np.nan)
        for k, name in enumerate(columns[1:], start=1):
            angles[:, LEVEL.index(name) if name in LEVEL else 2] = rows[:, k]
        _check(rows, columns, path)
        north = next((NORTHS[name] for name in columns if name in NORTHS), UNSTATED)
        return utc_of(rows[:, 0], TIMES[columns[0]], str(path), self.options), angles, north


def _columns(names: Sequence[str], path: Path) -> tuple[str, ...]:
    """The columns to read: time, roll and pitch, heading."""
    time = next((name for name in TIMES if name in names), None)
    level = LEVEL if set(LEVEL) <= set(names) else ()
    heading = next(((name,) for name in NORTHS if name in names), ())
    if time is None or not (level or heading):
        raise InputError("missing-column", path=path, norths=", ".join(NORTHS))
    return (time, *level, *heading)


def _check(rows: FloatArray, columns: Sequence[str], path: Path) -> None:
    for k, name in enumerate(columns[1:], start=1):
        largest = 90.5 if name == "pitch_deg" else LARGEST_DEG
        wrong = np.flatnonzero(np.abs(rows[:, k]) > largest)
        if len(wrong):
            raise InputError(
                "value-out-of-range",
                path=path,
                wrong=int(wrong[0]) + 1,
                name=name,
                rows=rows[wrong[0], k],
                largest=largest,
            )
