"""Solution files (``.pos``) of RTKLIB, CLASLIB, MADOCALIB and others in the same format.

(RTKLIB 2.4.2 manual, appendix B.1, "Positioning solution file".)
"""

import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from enum import Enum
from pathlib import Path
from typing import Any, ClassVar, Final

import numpy as np
from numpy.typing import NDArray

from furrowmap.core.geodesy.longitudes import signed_deg
from furrowmap.core.readers.csv_file import COMPARED_LINES, is_whole
from furrowmap.core.readers.epochs import midnights_utc_s
from furrowmap.core.readers.framed_messages import MESSAGE_CHUNK_BYTES
from furrowmap.core.readers.position_log import LoggedPositions, PositionLog, file_at
from furrowmap.core.readers.reader import recording_name
from furrowmap.core.readers.source import Head, Source
from furrowmap.core.runtime.arrays import FloatArray
from furrowmap.core.runtime.errors import InputError, Notice
from furrowmap.core.runtime.languages.texts import Text
from furrowmap.core.runtime.memory import expect_rows
from furrowmap.core.values.clock import GPS_EPOCH_S, HOUR_S, WEEK_S, gps_to_utc_s
from furrowmap.core.values.earth import geodetic, variances_enu
from furrowmap.core.values.gnss import Fix

POS_FIXES: Final = {1: Fix.FIXED, 2: Fix.FLOAT, 3: Fix.DGPS, 4: Fix.DGPS, 5: Fix.SINGLE, 6: Fix.PPP, 7: Fix.ESTIMATED}
"""Quality of a position by its flag Q (fix, float, SBAS, DGPS, single, PPP, dead reckoning)."""
REVERSED_SHARE: Final = 0.5
"""Share of steps back in time above which a solution was written from end to start."""
MAX_ROW_BYTES: Final = 2048
MAX_VALUES: Final = 24
"""Number of values after the time that are read; five are required: three of position, quality, satellites."""
_CUT_MARK: Final = b" (cut)"
"""Makes a last line no row, and so a damaged one."""

_NUMBER: Final = rb"[-+]?(?:\d+(?:\.\d*)?|\.\d+)(?:[eE][-+]?\d{1,3})?"
_BETWEEN: Final = rb"[ \t,;]+"
_CALENDAR: Final = rb"\d{4}/\d\d?/\d\d?" + _BETWEEN + rb"\d\d?:\d\d?:\d\d?(?:\.\d*)?"
_WEEK: Final = rb"\d{1,4}" + _BETWEEN + rb"\d{1,6}(?:\.\d*)?"
_NUMBER_ROW: Final = rb"((?:" + _BETWEEN + _NUMBER + rb"){5,40})[ \t,;\r]*"
_ROW_PATTERNS: Final = {
    6: re.compile(rb"[ \t]*" + _CALENDAR + _NUMBER_ROW),
    2: re.compile(rb"[ \t]*" + _WEEK + _NUMBER_ROW),
}
"""Pattern of a row by the number of values of its time: year to second, or week and second of the week."""
_SPACES_FOR: Final = bytes.maketrans(b"/:,;\t\r", b"      ")


class PosForm(Enum):
    """Form of the coordinates."""

    DEGREES = "latitude, longitude, height"
    SEXAGESIMAL = "latitude, longitude in degrees, minutes, seconds; height"
    CARTESIAN = "earth-centred coordinates"
    BASELINE = "baseline east, north, up"


@dataclass
class PosHeader:
    """The header of a file, from its comments: time is "GPST", "UTC", "JST", or "" if it is not stated."""

    form: PosForm = PosForm.DEGREES
    time: str = ""
    geodetic_height: bool = False
    program: str = ""
    mode: str = ""

    def read_comment(self, line: str) -> None:
        """Read one comment line."""
        text = line.lstrip("%").strip()
        name, colon, value = text.partition(":")
        if colon and name.strip() == "program":
            self.program = value.strip()[:200]
        elif colon and name.strip() == "pos mode":
            self.mode = value.strip()[:200]
        elif text.startswith("(") and "/height=" in text:
            self.geodetic_height = "/geodetic" in text
        for scale in ("GPST", "UTC", "JST"):
            if text.startswith(scale):
                self.time = scale
                self.form = (
                    PosForm.CARTESIAN
                    if "x-ecef" in text
                    else PosForm.BASELINE
                    if "baseline" in text
                    else PosForm.SEXAGESIMAL
                    if "latitude(d'" in text
                    else PosForm.DEGREES
                )

    @property
    def service(self) -> str:
        """The correction service, if the header shows it; see :class:`GnssTrack`."""
        words = f"{self.program} {self.mode}".lower()
        for word, service in (("madoca", "madoca"), ("clas", "clas"), ("ppp-rtk", "ppp-rtk"), ("ppp", "ppp")):
            if re.search(rf"\b{word}(?:lib)?\b", words):
                return service
        return "rtk" if re.search(r"\b(?:kinematic|static|moving-base)\b", self.mode.lower()) else ""


@dataclass
class PosRows:
    """The rows of one or more files.

    Attributes:
        style: number of values of a time, 6 (calendar) or 2 (week and seconds); 0 before the first row.
        tables: (n, style + 24) values of the time and after it, nan where a row has fewer; a table each piece.
        numbers: (n,) line numbers of their rows, counted over all files.
        damaged: number of lines that are neither comments nor rows.
    """

    header: PosHeader = field(default_factory=PosHeader)
    style: int = 0
    tables: list[FloatArray] = field(default_factory=list)
    numbers: list[NDArray[np.int64]] = field(default_factory=list)
    damaged: int = 0
    lines: int = 0

    def add(self, source: Source) -> None:
        """Collect the rows of a stream after those of the streams before; the first determines the form of times."""
        row_bytes = 0
        for lines in _split_lines(source):
            rows: list[bytes] = []
            numbers: list[int] = []
            for number, line in enumerate(lines, start=self.lines + 1):
                text = line.strip()
                if not text:
                    continue
                if text.startswith(b"%"):
                    self.header.read_comment(text[:MAX_ROW_BYTES].decode("latin-1"))
                    continue
                if len(text) <= MAX_ROW_BYTES and not self.style:
                    self.style = next((style for style, row in _ROW_PATTERNS.items() if row.fullmatch(text)), 0)
                if len(text) <= MAX_ROW_BYTES and self.style and _ROW_PATTERNS[self.style].fullmatch(text):
                    rows.append(text.translate(_SPACES_FOR))
                    numbers.append(number)
                else:
                    self.damaged += 1
            self.lines += len(lines)
            if rows:
                self.tables.append(_table(rows, self.style + MAX_VALUES))
                self.numbers.append(np.array(numbers, np.int64))
                row_bytes += self.tables[-1].nbytes + self.numbers[-1].nbytes
                expect_rows(source.path, source.size_bytes, row_bytes)


def _split_lines(source: Source) -> Iterator[list[bytes]]:
    """Lists of lines; a last line that may be cut ends with :data:`_CUT_MARK`."""
    rest = b""
    before = [b""]
    while True:
        block = source.read(MESSAGE_CHUNK_BYTES)
        if not block:
            if rest:
                yield [rest if is_whole(rest, before) and not source.fault else rest + _CUT_MARK]
            return
        *whole, rest = (rest + block).split(b"\n")
        rest = rest[: MAX_ROW_BYTES + 1]  # a longer line is not a row and need not be kept
        before = (before + [line for line in whole[-COMPARED_LINES:] if not line.startswith(b"%")])[-COMPARED_LINES:]
        yield whole


def _table(rows: list[bytes], width: int) -> NDArray[np.float64]:
    """The values (n, width) of rows with different numbers of values; nan where a row has fewer."""
    table = np.full((len(rows), width), np.nan)
    counts = np.array([len(row.split()) for row in rows])
    for count in np.unique(counts):
        mine = np.flatnonzero(counts == count)
        text = b"\n".join(rows[k] for k in mine.tolist())
        numbers = np.array(text.split(), dtype="S40").astype(np.float64).reshape(len(mine), count)
        table[mine, : min(count, width)] = numbers[:, :width]
    return table


class RtklibPos(PositionLog):
    """The positions of a solution file, in either of its two time styles.

    Times are GPS time unless the header states UTC or JST. A standard deviation of 0, 0 satellites, and an age that is
    always 0 mean that they are unknown. Heights above the geoid are ignored. A solution that was written in reverse, by
    a backward filter, is reversed.
    """

    format: ClassVar[str] = "rtklib-pos"
    title: ClassVar[Text] = Text("RTKLIB solution (.pos)")

    @classmethod
    def recognise(cls, head: Head) -> float:
        """Certain with a header; likely if the first lines are rows."""
        if b"\0" in head.data[:4096]:
            return 0.0
        lines = [line.strip() for line in head.data.split(b"\n")[:200]]
        header = PosHeader()
        for line in lines:
            if line.startswith(b"%"):
                header.read_comment(line[:MAX_ROW_BYTES].decode("latin-1"))
        if header.time:
            return 0.95
        rows = [line for line in lines[:50] if line and not line.startswith(b"%")][:-1]
        good = sum(any(row.fullmatch(line[:MAX_ROW_BYTES]) for row in _ROW_PATTERNS.values()) for line in rows)
        return 0.7 if good >= 2 and good >= 0.8 * len(rows) else 0.0

    def _read(self, paths: list[Path]) -> LoggedPositions:
        rows = PosRows()
        ends = []
        for source in self._sources(paths):
            rows.add(source)
            ends.append(rows.lines)
        numbers = np.concatenate([np.empty(0, np.int64), *rows.numbers])
        name = recording_name(paths)
        if rows.damaged:
            self.notices.append(Notice("lines-damaged", name=name, damaged=rows.damaged, lines=rows.lines))

        def place(row: int) -> str:
            path, line = file_at(paths, ends, int(numbers[row]) - 1)
            return f"{path}, line {line + 1}"

        header = rows.header
        facts = {
            "program": header.program or "unknown",
            "positioning": header.mode or "unknown",
            "time_style": "week and seconds" if rows.style == 2 else "calendar",
            "time_scale": header.time or "not stated",
            "written_as": header.form.value,
            "lines_damaged": rows.damaged,
        }
        positions = _solutions(rows, name, place)
        return replace(positions, facts=facts, scale=header.time or "assumed to be GPST")


def _solutions(rows: PosRows, name: str, place: Callable[[int], str]) -> LoggedPositions:
    """The positions of the rows; `place` describes where a row is in the files."""
    if rows.header.form is PosForm.BASELINE:
        return LoggedPositions.none(name, InputError("pos-baseline", name=name))
    style = rows.style or 6
    table = np.concatenate([np.empty((0, style + MAX_VALUES)), *rows.tables])
    columns, notices = _columns(rows.header, table[:, :style], table[:, style:], name)
    usable = columns["fix"] != Fix.NONE
    usable &= np.isfinite(columns["t_s"] + columns["lon_deg"] + columns["lat_deg"])
    kept = np.flatnonzero(usable)
    if not len(kept):
        fault = InputError("no-positions.no-positions-2", name=name, line=len(table) or None)
        return replace(LoggedPositions.none(name, fault), notices=tuple(notices))
    if len(kept) > 1 and np.mean(np.diff(columns["t_s"][kept]) < 0) > REVERSED_SHARE:
        kept = kept[::-1]
        notices.append(Notice("written-backward", name=name))
    return LoggedPositions.in_order(
        {column: values[kept] for column, values in columns.items()},
        lambda k: place(int(kept[k])),
        name=name,
        service=rows.header.service,
        without_position=int(np.sum(~usable)),
        notices=notices,
    )


def _columns(
    header: PosHeader, time: FloatArray, values: FloatArray, name: str
) -> tuple[dict[str, NDArray[Any]], list[Notice]]:
    """The columns of a track, and `t_s`; nan where a value is invalid."""
    notices = []
    if len(values) and not header.time:
        notices.append(Notice("time-scale-assumed", name=name))
    if header.form is PosForm.SEXAGESIMAL:
        values = np.column_stack([_sexagesimal(values[:, :3]), _sexagesimal(values[:, 3:6]), values[:, 6:]])
    lat = values[:, 0]
    lon = values[:, 1]
    height = values[:, 2]
    north, east, up = (np.where(values[:, k] > 0.0, values[:, k], np.nan) for k in (5, 6, 7))
    # after age and ratio, if velocities were requested
    vn = values[:, 13]
    ve = values[:, 14]
    if header.form is PosForm.CARTESIAN:
        lon, lat, height = geodetic(values[:, :3])
        north, east, up = _local_sigmas(values, lon, lat)
        vn = ve = np.full(len(values), np.nan)
    with np.errstate(invalid="ignore"):
        speed = np.hypot(vn, ve)
    if header.geodetic_height and len(values):
        height = np.full(len(values), np.nan)
        notices.append(Notice("no-ellipsoidal-height.geodetic-columns", name=name))
    quality = np.where((values[:, 3] >= 0) & (values[:, 3] <= 7), values[:, 3], 0).astype(np.int64)
    satellites = np.where((values[:, 4] >= 1) & (values[:, 4] <= 999), values[:, 4], -1)
    columns: dict[str, NDArray[Any]] = {
        "t_s": _utc_s(time, header.time),
        "lon_deg": signed_deg(lon),
        "lat_deg": lat,
        "height_m": height,
        "fix": np.array([POS_FIXES.get(q, Fix.NONE) for q in range(8)], np.int8)[quality],
        "sigma_e_m": east,
        "sigma_n_m": north,
        "sigma_h_m": up,
        "speed_mps": speed,
        "course_deg": np.where(speed > 0.0, np.degrees(np.arctan2(ve, vn)) % 360.0, np.nan),
        "satellites": satellites.astype(np.int16),
        "age_s": values[:, 11] if np.any(values[:, 11] > 0.0) else np.full(len(values), np.nan),
    }
    return columns, notices


def _utc_s(time: FloatArray, scale: str) -> FloatArray:
    """UTC (n,) of times (n, 6) or (n, 2); nan for invalid dates."""
    if time.shape[1] == 2:
        gps_s = time[:, 0] * WEEK_S + time[:, 1]
    else:
        usable = (time[:, 3] < 24) & (time[:, 4] < 60) & (time[:, 5] < 61)
        midnight_s = midnights_utc_s(*time[:, :3].T.astype(np.int64))
        clock_s = midnight_s + time[:, 3] * HOUR_S + time[:, 4] * 60.0 + time[:, 5]
        gps_s = np.where(usable, clock_s - GPS_EPOCH_S, np.nan)
    if scale in ("UTC", "JST"):
        return gps_s + GPS_EPOCH_S - (9 * HOUR_S if scale == "JST" else 0)
    known = np.isfinite(gps_s)
    return np.where(known, gps_to_utc_s(np.where(known, gps_s, 0.0)), np.nan)


def _sexagesimal(parts: FloatArray) -> FloatArray:
    """Degrees (n,) of degrees, minutes and seconds (n, 3); the degrees have the sign."""
    size = np.abs(parts[:, 0]) + parts[:, 1] / 60.0 + parts[:, 2] / 3600.0
    return np.where(np.signbit(parts[:, 0]), -size, size)


def _local_sigmas(values: FloatArray, lon: FloatArray, lat: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Sigmas north, east, up; those off the diagonal are signed roots of covariances (RTKLIB manual, appendix B.1)."""
    diagonal = values[:, 5:8] ** 2
    xy, yz, zx = (np.sign(values[:, k]) * values[:, k] ** 2 for k in (8, 9, 10))
    matrix = np.stack(
        [
            np.column_stack([diagonal[:, 0], xy, zx]),
            np.column_stack([xy, diagonal[:, 1], yz]),
            np.column_stack([zx, yz, diagonal[:, 2]]),
        ],
        axis=1,
    )
    variance = variances_enu(matrix, lon, lat)
    with np.errstate(invalid="ignore"):
        sigma = np.where(variance > 0.0, np.sqrt(np.abs(variance)), np.nan)
    return sigma[:, 1], sigma[:, 0], sigma[:, 2]
