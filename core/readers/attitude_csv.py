"""Attitudes of an AHRS in CSV, with units and the kind of north in the column names."""

from pathlib import Path
from typing import ClassVar, Final

import numpy as np

from furrowmap.core.readers.csv_file import TIME_COLUMN, TIMES, Column, CsvFile, head_columns, names_a_position
from furrowmap.core.readers.epochs import utc_of
from furrowmap.core.readers.inertial_rows import attitude_facts, attitude_track
from furrowmap.core.readers.reader import FileReader, Inspection
from furrowmap.core.readers.source import Head
from furrowmap.core.runtime.arrays import FloatArray
from furrowmap.core.runtime.errors import InputError
from furrowmap.core.runtime.languages.texts import Text
from furrowmap.core.values.pose_track import GRID_NORTH, MAGNETIC_NORTH, TRUE_NORTH, UNSTATED_NORTH, AttitudeTrack
from furrowmap.core.values.scan import Clock, ClockReading

LEVEL_COLUMNS: Final = ("roll_deg", "pitch_deg")
NORTHS: Final = {
    "heading_true_deg": TRUE_NORTH,
    "heading_grid_deg": GRID_NORTH,
    "heading_deg": GRID_NORTH,
    "heading_magnetic_deg": MAGNETIC_NORTH,
}
"""Columns of headings, in the order of preference, and the north from which they count."""
_LEVEL_RANGES: Final = {"roll_deg": (-720.0, 720.0), "pitch_deg": (-90.5, 90.5)}
_HEADING: Final = Column(dict.fromkeys(NORTHS, 1.0), (-720.0, 720.0), optional=True)


class AttitudeCsv(FileReader):
    """Roll and pitch, heading, or all of them, from CSV files.

    The columns are `time_unix_s` (UTC) or `time_gps_s`, `roll_deg` (positive right side down), `pitch_deg` (positive
    nose up), and one of :data:`NORTHS`. Rows with an empty field are dropped with a notice.
    """

    format: ClassVar[str] = "attitude-csv"
    title: ClassVar[Text] = Text("attitudes in CSV")

    @classmethod
    def recognise(cls, head: Head) -> float:
        """Certain with columns of time and of roll and pitch or a heading, and none of a position."""
        names = set(head_columns(head))
        if not names & set(TIMES) or not (names >= set(LEVEL_COLUMNS) or names & set(NORTHS)):
            return 0.0
        return 0.3 if any(map(names_a_position, names)) else 0.9

    def attitude(self) -> AttitudeTrack:
        """All attitudes of all files.

        InputError if columns are missing, fields are no angles, or times do not increase.
        """
        parts = [self._read(path) for path in self.paths]
        t_s, angles = (np.concatenate([part[k] for part in parts]) for k in range(2))
        norths = {part[2] for part in parts}
        north = norths.pop() if len(norths) == 1 else UNSTATED_NORTH
        track, late = attitude_track(t_s, angles, north, self.name)
        self.notices += late
        return track

    def inspect(self) -> Inspection:
        """Read the whole first file and report rate, span, and what it holds."""
        reader = AttitudeCsv(self.paths[:1], self.options)
        track = reader.attitude()
        clock = ClockReading(Clock.STATED, float(track.t_s[0]), float(track.t_s[-1]), "from its time column")
        facts = attitude_facts(track)
        return Inspection(self.paths[0], self.format, self.title, facts, (clock,), tuple(reader.notices))

    def _read(self, path: Path) -> tuple[FloatArray, FloatArray, str]:
        """UTC (n,), angles (n, 3), and the north of the headings."""
        with CsvFile(path) as file:
            north = file.find(NORTHS)
            has_level = set(LEVEL_COLUMNS) <= set(file.names)
            if file.find(TIMES) is None or not (has_level or north):
                raise InputError("missing-column", path=path, norths=", ".join(NORTHS))
            level = [
                Column({name: 1.0} if has_level else {}, _LEVEL_RANGES[name], optional=True) for name in LEVEL_COLUMNS
            ]
            rows = file.rows([TIME_COLUMN, *level, _HEADING])
        self._add_notices(*file.notices)
        t_s = utc_of(rows[:, 0], file.time_scale, str(path), self.options)
        return t_s, rows[:, 1:], NORTHS.get(north or "", UNSTATED_NORTH)
