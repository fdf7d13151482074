"""Line scanners in CSV: a time, an angle and a range in each row."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path
from typing import Any, ClassVar, Final

import numpy as np
from numpy.typing import NDArray

from furrowmap.core.readers.csv_file import TIME_COLUMN, TIMES, Column, CsvFile, head_columns
from furrowmap.core.readers.epochs import utc_facts, utc_of
from furrowmap.core.readers.reader import FileReader, Inspection, ReadOptions
from furrowmap.core.readers.source import Head
from furrowmap.core.runtime.arrays import FloatArray
from furrowmap.core.runtime.errors import InputError, Notice
from furrowmap.core.runtime.iteration import concluded
from furrowmap.core.runtime.languages.texts import Text
from furrowmap.core.values.scan import Clock, ClockReading, Scan

MAX_RANGE_M: Final = 2000.0
"""No scanner on a machine sees as far; farther ranges are damaged or not metres."""


def sweep(
    number: int,
    t_s: FloatArray,
    angle_rad: FloatArray,
    range_m: FloatArray,
    intensity: FloatArray,
    column: NDArray[Any],
) -> Scan:
    """The returns (n,) of one sweep in the plane z = 0, angles counter-clockwise from the x axis.

    Fractions of 1 as intensity are scaled to 255; `column` is the index of the firing in the sweep.
    """
    n = len(t_s)
    known = np.nan_to_num(intensity, nan=0.0, posinf=0.0, neginf=0.0)
    if n and 0.0 < known.max() <= 1.0:
        known = 255.0 * known
    xyz = np.column_stack([range_m * np.cos(angle_rad), range_m * np.sin(angle_rad), np.zeros(n)])
    return Scan(
        number=number,
        t_s=t_s,
        xyz_m=xyz.astype(np.float32),
        intensity=np.rint(np.clip(known, 0, 65535)).astype(np.uint16),
        laser=np.zeros(n, np.uint8),
        column=column.astype(np.uint16),
        return_number=np.ones(n, np.uint8),
        returns=np.ones(n, np.uint8),
    )


def mostly_invalid(source: str, wrong: int, everything: int) -> InputError:
    """The error of ranges that are not metres."""
    return InputError(
        "points-mostly-invalid", source=source, wrong=wrong, everything=everything, farthest_m=MAX_RANGE_M
    )


ANGLE: Final = Column({"angle_deg": np.pi / 180.0, "angle_rad": 1.0})
RANGE: Final = Column({"range_m": 1.0, "range_mm": 1e-3}, sparse=True)
LINE_SCHEMA: Final = (TIME_COLUMN, ANGLE, RANGE, Column({"intensity": 1.0}, optional=True))
MAX_SWEEP_GAP_S: Final = 1.0
"""A sweep does not last longer; after a longer pause a new one begins."""
MIN_SWING_SHARE: Final = 0.2
"""Share of steps against the usual direction from which the mirror swings instead of turning."""
MAX_SWEEP_RETURNS: Final = 65_535
MAX_LATE_SHARE: Final = 0.01


class LineCsv(FileReader):
    """A line scanner's returns from CSV files, in the order of time, cut into sweeps where the angle begins anew.

    The columns are `time_unix_s` (UTC) or `time_gps_s`, `angle_deg` or `angle_rad` (counter-clockwise from the
    scanner's x axis, about its z axis), `range_m` or `range_mm`, and optionally `intensity`. Rows without a range, or
    with a range of 0, are firings without a return.
    """

    format: ClassVar[str] = "line-csv"
    title: ClassVar[Text] = Text("line scanner in CSV")

    def __init__(self, paths: Sequence[Path], options: ReadOptions) -> None:
        super().__init__(paths, options)
        self.clock = Clock.STATED
        self.clocks: tuple[ClockReading, ...] = ()
        self.share_read = 0.0
        self.counts = _LineCounts()

    @classmethod
    def recognise(cls, head: Head) -> float:
        """Certain with columns of time, angle and range."""
        names = set(head_columns(head))
        found = [bool(names & kind.keys()) for kind in (TIMES, ANGLE.names, RANGE.names)]
        return {3: 1.0, 2: 0.5 if found[2] and found[1] else 0.0}.get(sum(found), 0.0)

    def scans(self) -> Iterator[Scan]:
        """The sweeps of all files.

        InputError if a file has no such columns, a field is no number, times do not increase, or most ranges are not in
        the stated unit.
        """
        self.notices.clear()
        self.counts = _LineCounts()
        yield from concluded(self._all_sweeps(), self._conclude)

    def _all_sweeps(self) -> Iterator[Scan]:
        for i, path in enumerate(self.paths):
            with CsvFile(path) as file:
                file.require(LINE_SCHEMA, "missing-column.of-line-scanner")
                try:
                    for scan in self._sweeps(file):
                        self.share_read = (i + file.share_read) / len(self.paths)
                        yield scan
                finally:  # also where no more scans are taken
                    self._add_notices(*file.notices)

    def _conclude(self) -> None:
        """Set notices and clocks to what was read; InputError if it is implausible."""
        counts = self.counts
        name = str(self.paths[0])
        if counts.far > counts.points:
            raise mostly_invalid(name, counts.far, counts.far + counts.points)
        if counts.late > MAX_LATE_SHARE * counts.rows:
            raise InputError("time-disorder.judge", name=name, late=counts.late, rows=counts.rows)
        if counts.late:
            self.notices.append(Notice("time-runs-back.judge", name=name, late=counts.late, rows=counts.rows))
        if counts.far:
            self.notices.append(Notice("points-invalid.far", source=name, far=counts.far, farthest_m=MAX_RANGE_M))
        if counts.scans:
            self.clocks = (ClockReading(self.clock, counts.first_s, counts.last_s, "from its time column"),)

    def inspect(self) -> Inspection:
        """Read the whole first file and report what it contains."""
        reader = LineCsv(self.paths[:1], self.options)
        for _ in reader.scans():
            pass
        counts = reader.counts
        facts: dict[str, Any] = {"scans": counts.scans or "none", "firings": counts.firings, "points": counts.points}
        if counts.scans:
            span_s = counts.last_s - counts.first_s
            facts |= {**utc_facts(np.array([counts.first_s, counts.last_s])), "span_s": round(span_s, 3)}
            facts["angles_deg"] = np.degrees(counts.angles_rad).round(2).tolist()
            facts["sweeps_per_s"] = round((counts.scans - 1) / span_s, 2) if span_s > 0 else None
        return Inspection(self.paths[0], self.format, self.title, facts, reader.clocks, tuple(reader.notices))

    def _sweeps(self, file: CsvFile) -> Iterator[Scan]:
        """The sweeps of one file; the last one of each piece is continued in the next."""
        rest = np.empty((0, 4))
        swings = None
        for piece in file.pieces(LINE_SCHEMA):
            rows = piece[np.isfinite(piece[:, :2]).all(axis=1)]
            if not len(rows):
                continue
            rows[:, 0] = utc_of(rows[:, 0], file.time_scale, str(file.path), self.options)
            counts = self.counts
            latest = np.maximum.accumulate(np.concatenate([[counts.latest_s], rows[:, 0]]))
            forward = rows[:, 0] >= latest[:-1]
            counts.latest_s = latest[-1]
            counts.rows = counts.rows + len(rows)
            counts.late += int((~forward).sum())
            rows = np.concatenate([rest, rows[forward]])
            if len(rows) < 2:
                rest = rows
                continue
            swings = _swings(rows[:, 1]) if swings is None else swings
            begins = _begins(rows, swings=swings)
            for first, last in pairwise(begins):
                yield from self._sweep(rows[first:last])
            rest = rows[begins[-1] :]
        yield from self._sweep(rest)

    def _sweep(self, rows: FloatArray) -> Iterator[Scan]:
        counts = self.counts
        counts.firings += len(rows)
        with np.errstate(invalid="ignore"):
            far = rows[:, 2] > MAX_RANGE_M
            returned = (rows[:, 2] > 0.0) & (rows[:, 2] <= MAX_RANGE_M)
        counts.far += int(far.sum())
        if not returned.any():
            return
        t_s, angle, distance, intensity = rows[returned].T
        counts.take(t_s, angle)
        yield sweep(counts.scans - 1, t_s, angle, distance, intensity, np.flatnonzero(returned))


@dataclass
class _LineCounts:
    """What was read so far."""

    scans: int = 0
    firings: int = 0
    points: int = 0
    far: int = 0
    rows: int = 0
    late: int = 0
    latest_s: float = -np.inf
    first_s: float = np.inf
    last_s: float = -np.inf
    angles_rad: FloatArray = field(default_factory=lambda: np.array([np.inf, -np.inf]))

    def take(self, t_s: FloatArray, angle_rad: FloatArray) -> None:
        """Count the returns (n,) of a sweep."""
        self.scans = self.scans + 1
        self.points = self.points + len(t_s)
        self.first_s, self.last_s = min(self.first_s, float(t_s[0])), max(self.last_s, float(t_s[-1]))
        low, high = self.angles_rad
        self.angles_rad = np.array([min(low, angle_rad.min()), max(high, angle_rad.max())])


def _swings(angle: FloatArray) -> bool:
    """Whether the mirror swings back and forth instead of turning on."""
    step = np.diff(angle)
    step = step[step != 0.0]
    against = min(np.mean(step > 0), np.mean(step < 0)) if len(step) else 0.0
    return bool(against > MIN_SWING_SHARE)


def _begins(rows: FloatArray, *, swings: bool) -> list[int]:
    """Indices of the rows with which sweeps begin, 0 first."""
    step = np.diff(rows[:, 1])
    usual = 1.0 if np.median(step[step != 0.0] if (step != 0.0).any() else [1.0]) > 0 else -1.0
    if swings:
        sign = np.sign(step)
        known = np.maximum.accumulate(np.where(sign != 0, np.arange(len(sign)), 0))
        sign = sign[known]
        new = np.concatenate([[False, False], sign[1:] * sign[:-1] < 0])
    else:
        new = np.concatenate([[False], step * usual < 0])
    new[1:] |= np.diff(rows[:, 0]) > MAX_SWEEP_GAP_S
    begins = [0]
    for k in [*np.flatnonzero(new).tolist(), len(rows)]:
        while k - begins[-1] > MAX_SWEEP_RETURNS:
            begins.append(begins[-1] + MAX_SWEEP_RETURNS)
        if k < len(rows) and k > begins[-1]:
            begins.append(k)
    return begins
