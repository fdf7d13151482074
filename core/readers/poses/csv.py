"""Trajectories in CSV files whose header names say the units."""

from __future__ import annotations

import difflib
import io
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, ClassVar, Final

import numpy as np
from numpy.typing import NDArray

from furrowmap.core.readers.csv_header import columns_of, head_columns
from furrowmap.core.readers.poses.file import RawPoses, joined, too_few
from furrowmap.core.readers.reader import FileReader, Inspection
from furrowmap.core.readers.source import Head, Source, cut_notice
from furrowmap.core.values.errors import InputError, Notice
from furrowmap.core.values.pose_track import PoseTrack

FloatArray = NDArray[np.float64]

CHUNK_BYTES: Final = 1 << 23

TIMES: Final = {"time_unix_s": "unix", "time_gps_s": "gps"}
PROJECTED: Final = ("e_m", "n_m", "h_m")
GEOGRAPHIC: Final = ("lon_deg", "lat_deg", "h_m")
ATTITUDE: Final = ("roll_deg", "pitch_deg", "heading_deg")
SIGMAS: Final = ("sigma_e_m", "sigma_n_m", "sigma_h_m", "sigma_roll_deg", "sigma_pitch_deg", "sigma_heading_deg")
KNOWN: Final = frozenset((*TIMES, *PROJECTED, *GEOGRAPHIC, *ATTITUDE, *SIGMAS))
NEEDED: Final = 7
"""Number of columns that no trajectory can do without: time, three of position, three of attitude."""

WITHIN: Final = {
    "time_unix_s": (315_964_800.0, 4_102_444_800.0),
    "lon_deg": (-180.0, 360.0),
    "lat_deg": (-90.0, 90.0),
    "roll_deg": (-180.0, 180.0),
    "pitch_deg": (-90.0, 90.0),
    "heading_deg": (-360.0, 720.0),
}
"""What the values of a column can be; anything else is another unit or another column."""


class PoseCsv(FileReader):
    """Poses from CSV files with the columns of :data:`KNOWN`.

    `time_unix_s` is UTC in POSIX seconds. `time_gps_s` is GPS time since 1980-01-06, or seconds of a GPS week that
    `ReadOptions.week` or `ReadOptions.near_s` tells. Positions are easting, northing and height in the session's map
    frame, or longitude, latitude and ellipsoidal height; where both are there, the former count. Heading is clockwise
    from grid north. Rows that lack a number are left out and told.

    Args:
        paths: the files of one trajectory, in the order of time.
        options: `time`, `week` and `near_s` are used.
    """

    format: ClassVar[str] = "pose-csv"
    title: ClassVar[str] = "trajectory in CSV"

    @classmethod
    def recognise(cls, head: Head) -> float:
        """Certain with time and attitude in its header; possible where a header speaks of roll and pitch otherwise."""
        names = set(head_columns(head) or ())
        known = names & KNOWN
        if known & set(TIMES) and known & set(ATTITUDE):
            return 1.0
        if len(known) >= 3:
            return 0.6
        words = " ".join(names).lower()
        return 0.2 if len(names) >= 6 and "roll" in words and "pitch" in words else 0.0

    def poses(self) -> PoseTrack:
        """All poses of all files.

        Raises:
            InputError: if a column is missing, a row is no row of numbers, a value cannot be of its unit, the week is
                unknown, or the rows are out of order.
        """
        self.notices = []
        return joined([self._read(path)[1] for path in self.paths]).track(self.options, self.notices)

    def inspect(self) -> Inspection:
        """Read the first file through and say what it is and holds.

        Raises:
            InputError: as :meth:`poses`, but an unknown week is only told.
        """
        self.notices = []
        header, raw = self._read(self.paths[0])
        told, clocks = raw.tell(self.options, self.notices)
        unused = [name for name in header.names if name not in header.columns]
        facts: dict[str, Any] = {"columns": list(header.columns), "unused_columns": unused, **told}
        place = _place(header, self.paths[0]) if header.projected else None
        if place is not None:
            facts["place"] = place
        return Inspection(self.paths[0], self.format, self.title, facts, clocks, tuple(self.notices))

    def _read(self, path: Path) -> tuple[_Header, RawPoses]:
        with Source(path) as source:
            pieces = _pieces(source)
            header = _Header.of(next(pieces, b""))
            header.check(path)
            blocks = [np.empty((0, len(header.columns)))]
            line = 2
            for piece in pieces:
                blocks.append(_parse(piece, header, path, line))
                line += piece.count(b"\n")
            if source.fault:
                self.notices.append(cut_notice(path, source.fault))
        read = np.concatenate(blocks)
        whole = np.all(np.isfinite(read[:, :NEEDED]), axis=1)
        lacking = int(np.sum(~whole))
        if lacking:
            text = f"{path}: {lacking} of {len(whole)} rows lack a number and are left out."
            self.notices.append(Notice("rows-incomplete", text))
        read = read[whole]
        if len(read) < 2:
            raise too_few(path, f"{len(read)} whole rows below the header")
        _check_units(header, read, path)
        values = np.full((len(read), NEEDED - 1 + len(SIGMAS)), np.nan)
        values[:, : NEEDED - 1] = read[:, 1:NEEDED]
        for k, name in enumerate(header.columns[NEEDED:], start=NEEDED):
            values[:, NEEDED - 1 + SIGMAS.index(name)] = read[:, k]
        scale = TIMES[header.columns[0]]
        self._check_scale(header.columns[0], path)
        note = f"as its column `{header.columns[0]}` says"
        raw = RawPoses(read[:, 0], scale, note, values, projected=header.projected, true_north=False, name=str(path))
        return header, raw

    def _check_scale(self, column: str, path: Path) -> None:
        stated = self.options.time
        if stated is not None and stated != ("utc" if column == "time_unix_s" else "gps"):
            raise InputError(
                f'{path}: its times stand in the column `{column}`, but `time = "{stated}"` was stated.',
                "One of the two is wrong, and the difference is 18 s.",
                "Take `time` out of `[trajectory]`, or rename the column.",
                code="time-contradicted",
            )


@dataclass(frozen=True)
class _Header:
    """A CSV file's first line: its column names and what separates them."""

    names: tuple[str, ...]
    separator: str

    @classmethod
    def of(cls, line: bytes) -> _Header:
        names, separator = columns_of(line.decode("utf-8", "replace"))
        return cls(tuple(names), separator)

    @cached_property
    def projected(self) -> bool:
        """Whether positions are easting and northing: these are preferred where longitude and latitude stand too."""
        names = set(self.names)
        return names >= {"e_m", "n_m"} or not {"lon_deg", "lat_deg"} & names

    @cached_property
    def columns(self) -> tuple[str, ...]:
        """The columns to read: time, three of position, three of attitude, and the sigmas that are there."""
        time = "time_gps_s" if "time_gps_s" in self.names and "time_unix_s" not in self.names else "time_unix_s"
        sigmas = tuple(name for name in SIGMAS if name in self.names)
        return (time, *(PROJECTED if self.projected else GEOGRAPHIC), *ATTITUDE, *sigmas)

    def check(self, path: Path) -> None:
        """Refuse a header that lacks what a trajectory needs, or names it twice.

        Raises:
            InputError: naming the column, and the one that might have been meant for it.
        """
        for name in self.columns:
            count = self.names.count(name)
            if count > 1:
                raise InputError(
                    f"{path}, line 1: the column `{name}` is there {count} times.",
                    "Which of them is meant cannot be known.",
                    "Take the others out, or give them other names.",
                    code="column-twice",
                )
            if count == 0:
                near = _nearest(name, self.names)
                other = {"time_unix_s": "time_gps_s", "e_m": "lon_deg", "n_m": "lat_deg"}.get(name)
                raise InputError(
                    f"{path}, line 1: there is no column `{name}`{f' or `{other}`' if other else ''}"
                    f"{f'; the nearest is `{near}`' if near else ''}.",
                    "A trajectory needs time, position and attitude, and the names in the header say their units.",
                    f"Name the columns {', '.join(('time_unix_s', *PROJECTED, *ATTITUDE))}; "
                    "time_gps_s, lon_deg and lat_deg may take the place of the first three.",
                    code="missing-column",
                )


def _nearest(wanted: str, names: Sequence[str]) -> str:
    """The column that might have been meant: with the same word in its name, or spelt alike; "" if there is none."""
    word = {"time_unix_s": "time|tow|epoch", "e_m": "east|^x$", "n_m": "north|^y$", "h_m": "height|alt|^z$"}.get(
        wanted, wanted.split("_")[0]
    )
    strangers = [name for name in names if name not in KNOWN]
    same = [name for name in strangers if re.search(word, name.lower())]
    return next(iter(same + difflib.get_close_matches(wanted, strangers, 1, 0.5)), "")


def _pieces(source: Source) -> Iterator[bytes]:
    """The first line, then whole lines in pieces of bounded size; the cut last line of a damaged stream is left out."""
    rest = b""
    first = True
    while block := source.read(CHUNK_BYTES):
        rest += block
        if first and b"\n" in rest:
            line, _, rest = rest.partition(b"\n")
            first = False
            yield line
        end = rest.rfind(b"\n") + 1
        if end and not first:
            yield rest[:end]
            rest = rest[end:]
    if rest.strip() and not source.fault:
        yield rest


def _parse(piece: bytes, header: _Header, path: Path, line: int) -> FloatArray:
    """Rows (n, k) of the numbers in :attr:`_Header.columns`; nan where a field is empty.

    Args:
        piece: whole lines.
        header: of the file.
        path: of the file, for messages.
        line: number of the first line.

    Raises:
        InputError: with the line, if a field is something else.
    """
    import pandas as pd  # half of the time that importing all readers would take

    index = [header.names.index(name) for name in header.columns]
    try:
        frame = pd.read_csv(
            io.BytesIO(piece),
            sep=header.separator,
            header=None,
            names=list(range(len(header.names))),
            usecols=index,
            index_col=False,
            dtype=np.float64,
            skipinitialspace=True,
            encoding="latin-1",
        )
    except pd.errors.EmptyDataError:
        return np.empty((0, len(index)))
    except (ValueError, OverflowError, pd.errors.ParserError):
        raise _bad_field(piece, header, path, line) from None
    values: FloatArray = frame[index].to_numpy()
    return values


def _place(header: _Header, path: Path) -> dict[str, float] | None:
    """Longitude and latitude of the first row, where they stand beside easting and northing."""
    if not {"lon_deg", "lat_deg"} <= set(header.names):
        return None
    with Source(path) as source:
        pieces = _pieces(source)
        next(pieces)
        row = next(pieces, b"").partition(b"\n")[0].decode("latin-1").split(header.separator)
    try:
        place = {name: float(row[header.names.index(name)]) for name in ("lat_deg", "lon_deg")}
    except (ValueError, IndexError):
        return None
    plausible = all(WITHIN[name][0] <= value <= WITHIN[name][1] for name, value in place.items())
    return place if plausible else None


def _bad_field(piece: bytes, header: _Header, path: Path, line: int) -> InputError:
    """What is wrong with lines that are no table of numbers, and where."""
    where, what = f"{path}, from line {line} on", "the lines are no table of numbers"
    wanted = [(name, header.names.index(name)) for name in header.columns]
    for k, text in enumerate(piece.decode("latin-1").split("\n")):
        fields = [field.strip().strip('"') for field in text.split(header.separator)]
        bad = [(name, fields[i]) for name, i in wanted if i < len(fields) and not _is_number(fields[i])]
        if bad:
            where, what = f"{path}, line {line + k}", f"column `{bad[0][0]}` holds {bad[0][1][:40]!r}"
            break
    return InputError(
        f"{where}: {what}.",
        "A trajectory's columns hold numbers with a decimal point; an empty field is a number that is unknown.",
        "Mend or take out that line.",
        code="not-a-number",
    )


def _is_number(field: str) -> bool:
    try:
        float(field or "nan")
    except ValueError:
        return field.lower() in ("na", "n/a", "null", "none")
    return True


def _check_units(header: _Header, rows: FloatArray, path: Path) -> None:
    for k, name in enumerate(header.columns[:NEEDED]):
        low, high = WITHIN.get(name, (-np.inf, np.inf))
        outside = (rows[:, k] < low) | (rows[:, k] > high)
        if outside.any():
            row = int(np.flatnonzero(outside)[0])
            raise InputError(
                f"{path}, pose {row + 1}: column `{name}` holds {rows[row, k]:.10g}.",
                f"That is outside {low:.10g} to {high:.10g}, so it is another unit, another column or damage.",
                "Write times in seconds and angles in degrees, each in the column that its name says.",
                code="value-out-of-range",
            )
