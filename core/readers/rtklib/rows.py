"""The rows and the header of a ``.pos`` file.

(RTKLIB 2.4.2 manual, appendix B.1, "Positioning solution file"; its descendants write the same format.)
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from enum import Enum
from typing import Final

import numpy as np
from numpy.typing import NDArray

from furrowmap.core.readers.csv_file import COMPARED_LINES, is_whole
from furrowmap.core.readers.source import Source

CHUNK_BYTES: Final = 1 << 22
LONGEST: Final = 2048
"""Maximum length of a line in bytes."""
FEWEST: Final = 5
"""Minimum number of values after the time: three of position, quality, satellites."""
MOST: Final = 24
CUT: Final = b" (cut)"
"""Makes a last line no row, and so a damaged one."""

_NUMBER = rb"[-+]?(?:\d+(?:\.\d*)?|\.\d+)(?:[eE][-+]?\d{1,3})?"
_BETWEEN = rb"[ \t,;]+"
_CALENDAR = rb"\d{4}/\d\d?/\d\d?" + _BETWEEN + rb"\d\d?:\d\d?:\d\d?(?:\.\d*)?"
_WEEK = rb"\d{1,4}" + _BETWEEN + rb"\d{1,6}(?:\.\d*)?"
_VALUES = rb"((?:" + _BETWEEN + _NUMBER + rb"){5,40})[ \t,;\r]*"
ROWS: Final = {
    6: re.compile(rb"[ \t]*" + _CALENDAR + _VALUES),
    2: re.compile(rb"[ \t]*" + _WEEK + _VALUES),
}
"""Pattern of a row by the number of values of its time: year to second, or week and second of the week."""
_PLAIN: Final = bytes.maketrans(b"/:,;\t\r", b"      ")


class Form(Enum):
    """Form of the coordinates."""

    DEGREES = "latitude, longitude, height"
    SEXAGESIMAL = "latitude, longitude in degrees, minutes, seconds; height"
    CARTESIAN = "earth-centred coordinates"
    BASELINE = "baseline east, north, up"


@dataclass
class Header:
    """The header of a file, from its comments.

    Attributes:
        form: form of the coordinates.
        time: "GPST", "UTC", "JST"; "" if it is not stated.
        geodetic_height: whether heights are above the geoid.
        program: the program that wrote the file.
        mode: its positioning mode.
    """

    form: Form = Form.DEGREES
    time: str = ""
    geodetic_height: bool = False
    program: str = ""
    mode: str = ""

    def take(self, line: str) -> None:
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
                    Form.CARTESIAN
                    if "x-ecef" in text
                    else Form.BASELINE
                    if "baseline" in text
                    else Form.SEXAGESIMAL
                    if "latitude(d'" in text
                    else Form.DEGREES
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
class Rows:
    """The rows of one or more files.

    Attributes:
        header: of the first file.
        time: (n, 6) or (n, 2) values of the time.
        values: (n, 24) values after the time, nan where a row has fewer.
        line: (n,) line number of the row, counted over all files.
        damaged: number of lines that are neither comments nor rows.
    """

    header: Header
    time: NDArray[np.float64]
    values: NDArray[np.float64]
    line: NDArray[np.int64]
    damaged: int = 0
    lines: int = 0


@dataclass
class _Gathering:
    header: Header = field(default_factory=Header)
    style: int = 0
    tables: list[NDArray[np.float64]] = field(default_factory=list)
    numbers: list[NDArray[np.int64]] = field(default_factory=list)
    damaged: int = 0
    lines: int = 0


def read_rows(source: Source, into: _Gathering | None = None) -> _Gathering:
    """Collect the rows of a stream after those of the streams before."""
    gathered = into or _Gathering()
    for lines in _lines(source):
        _gather(lines, gathered)
    return gathered


def finished(gathered: _Gathering) -> Rows:
    """All rows that were collected."""
    style = gathered.style or 6
    table = np.concatenate([np.empty((0, style + MOST)), *gathered.tables])
    line = np.concatenate([np.empty(0, np.int64), *gathered.numbers])
    return Rows(gathered.header, table[:, :style], table[:, style:], line, gathered.damaged, gathered.lines)


def _lines(source: Source) -> Iterator[list[bytes]]:
    """Lists of lines; a last line that may be cut ends with :data:`CUT`."""
    rest, before = b"", [b""]
    while True:
        block = source.read(CHUNK_BYTES)
        if not block:
            if rest:
                yield [rest if is_whole(rest, before) and not source.fault else rest + CUT]
            return
        *whole, rest = (rest + block).split(b"\n")
        rest = rest[: LONGEST + 1]  # a longer line is not a row and need not be kept
        before = (before + [line for line in whole[-COMPARED_LINES:] if not line.startswith(b"%")])[-COMPARED_LINES:]
        yield whole


def _gather(lines: list[bytes], gathered: _Gathering) -> None:
    """Collect the rows among the lines; the first one determines the form of the times."""
    rows: list[bytes] = []
    numbers: list[int] = []
    for number, line in enumerate(lines, start=gathered.lines + 1):
        text = line.strip()
        if not text:
            continue
        if text.startswith(b"%"):
            gathered.header.take(text[:LONGEST].decode("latin-1"))
            continue
        if len(text) <= LONGEST and not gathered.style:
            gathered.style = next((style for style, row in ROWS.items() if row.fullmatch(text)), 0)
        if len(text) <= LONGEST and gathered.style and ROWS[gathered.style].fullmatch(text):
            rows.append(text.translate(_PLAIN))
            numbers.append(number)
        else:
            gathered.damaged += 1
    gathered.lines += len(lines)
    if rows:
        gathered.tables.append(_table(rows, gathered.style + MOST))
        gathered.numbers.append(np.array(numbers, np.int64))


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
