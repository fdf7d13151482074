"""CSV files with a header line: the columns of a format's schema as numbers, read in pieces."""

import csv
import datetime as dt
import io
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np

from furrowmap.core.readers.column_names import ambiguous, standard_names, with_units
from furrowmap.core.readers.csv_text import before_header, has_decimal_commas, header_of, row_cells, with_points
from furrowmap.core.readers.source import Head, Source, cut_notice
from furrowmap.core.readers.text_encoding import decoded
from furrowmap.core.runtime.arrays import FloatArray
from furrowmap.core.runtime.errors import InputError, Notice
from furrowmap.core.runtime.file_signatures import binary_kind
from furrowmap.core.runtime.languages.texts import Text
from furrowmap.core.runtime.memory import expect_rows

TIMES: Final = {"time_unix_s": "unix", "time_gps_s": "gps"}
"""Columns of time, the preferred one first, and their time scales."""
CSV_CHUNK_BYTES: Final = 1 << 23
MAX_HEADER_BYTES: Final = 4096
_LOOKED_AT_ROWS: Final = 1000
"""That show whether a comma stands for the point of numbers."""
MAX_TAIL_BYTES: Final = 8192
LONGEST_LINE_BYTES: Final = 1 << 24
COMPARED_LINES: Final = 8
"""Lines that the last one is compared with."""
_POSITION_NAME: Final = re.compile(
    r"^(e|n|h|x|y|z|east|north|easting|northing)(_m)?$|lon|lat(_|$|itude)|east|north|alt|height"
)
_FIELD_PATTERN: Final = re.compile(rb"[^,;\s]+")
_FIELD_WITH_COMMAS: Final = re.compile(rb"[^;\s]+")
"""Of lines that commas do not separate."""
_WHOLE_DIGITS: Final = re.compile(rb'^"?[-+]?\d*')
_NO_VALUE: Final = frozenset(
    {"", "na", "n/a", "#n/a", "#na", "<na>", "null", "none", "1.#ind", "-1.#ind", "1.#qnan", "-1.#qnan"}
)
"""What programs write in an empty field, in lower case; float() knows `nan`."""


@dataclass(frozen=True)
class Column:
    """A column of numbers in the schema of a format.

    Attributes:
        names: accepted names, the preferred one first, with the factors from their units to that of the result.
        within: valid range, in the unit of the result.
        optional: whether a file may have no such column.
        sparse: whether fields may be empty; otherwise rows with an empty field are dropped.
        iso: whether fields are ISO 8601 date and time, which become seconds since 1970; UTC without a zone.
    """

    names: Mapping[str, float]
    within: tuple[float, float] = (-np.inf, np.inf)
    optional: bool = False
    sparse: bool = False
    iso: bool = False


TIME_COLUMN: Final = Column(dict.fromkeys(TIMES, 1.0))


class CsvFile(Source):
    """An open CSV file whose header has been read (:mod:`.csv_text`): of any code page, with points or decimal commas.

    InputError if it is no text, or has a line without an end. Notices that the file is cut, that rows are dropped, or
    that columns are read by what their names mean (:mod:`.column_names`) are added while rows are read.

    Attributes:
        notices: complete when the last row has been read, since rows are read in pieces.
        written: the names of the columns as they stand in the file.
        names: the same by the names that furrowmap gives them.
    """

    def __init__(self, path: Path) -> None:
        super().__init__(path)
        self.notices: list[Notice] = []
        self._in_header = True
        self._unread = b""
        self._separator = ","  # until the header has been read: it may lack an end
        self._lines = self._complete_lines()
        lines = [next(self._lines, b"")]
        if (kind := binary_kind(lines[0])) is not None:
            self.close()
            raise InputError("not-a-table.binary", path=path, kind=kind)
        while before_header(lines[-1]) and (line := next(self._lines, None)) is not None:
            lines.append(line)
        self._in_header = False
        below, _, data = self._unread.partition(b"\n")
        header = header_of([*lines, below])
        if header.has_units:
            self._unread = data
        self.written = header.names
        self.names = standard_names(self.written)
        self._decimal_comma: bool | None = None
        self._separator = header.separator
        self._header_lines = header.lines
        if header.text.open:
            self.notices.append(header.text.notice("code-page", path.name))

    def find(self, column: Iterable[str]) -> str | None:
        """The first of the accepted names of a column that the file has; InputError if several columns mean it."""
        found = next((name for name in column if name in self.written or name in self.names), None)
        if found is not None and found not in self.written and self.names.count(found) > 1:
            same = [own for own, name in zip(self.written, self.names, strict=True) if name == found]
            raise ambiguous(self.path, found, same)
        return found

    def place(self, name: str) -> int:
        """The number of a column, by its name as it stands in the file or as furrowmap gives it."""
        return (self.written if name in self.written else self.names).index(name)

    def require(self, schema: Sequence[Column], missing_key: str) -> None:
        """Raise the error of this key if columns are missing that are not optional."""
        missing = [next(iter(c.names)) for c in schema if not (c.optional or self.find(c.names))]
        if missing:
            there = ", ".join(self.written)[:200]
            raise InputError(missing_key, path=self.path, missing=", ".join(missing), there=there)

    @property
    def time_scale(self) -> str:
        """Scale of the column of time: "gps", or "unix", which is UTC."""
        return TIMES.get(self.find(TIMES) or "", "unix")

    def rows(
        self, schema: Sequence[Column], missing_key: str = "missing-column", outside_key: str = "value-out-of-range"
    ) -> FloatArray:
        """All rows (n, k) of k columns, without those in which a field is empty that must not be.

        InputError if a column is missing, a field is no number or a number is out of the range of its column.
        """
        self.require(schema, missing_key)
        found = [self.find(column.names) for column in schema]
        parts = [np.empty((0, len(schema)))]
        row_bytes = 0
        for piece in self.pieces(schema):
            parts.append(piece)
            row_bytes += piece.nbytes
            expect_rows(self.path, self.size_bytes, row_bytes)
        rows: FloatArray = np.concatenate(parts)
        whole = np.ones(len(rows), np.bool_)
        for k, (column, name) in enumerate(zip(schema, found, strict=True)):
            if name and not column.sparse:
                whole &= np.isfinite(rows[:, k])
        if not whole.all():
            self.notices.append(Notice("rows-incomplete", source=self.path, whole=int((~whole).sum()), rows=len(rows)))
        rows = rows[whole]
        for k, (column, name) in enumerate(zip(schema, found, strict=True)):
            low, high = column.within
            outside = np.flatnonzero((rows[:, k] < low) | (rows[:, k] > high))
            if name and len(outside):
                unit = column.names[name]
                low, high = sorted((low / unit, high / unit))
                raise InputError(
                    outside_key,
                    path=self.path,
                    row=int(outside[0]) + 1,
                    name=self.written[self.place(name)],
                    value=rows[outside[0], k] / unit,
                    low=low,
                    high=high,
                )
        return rows

    def pieces(self, schema: Sequence[Column]) -> Iterator[FloatArray]:
        """Rows (n, k) of k columns in pieces; nan without a field or column; InputError if a field is no number."""
        found = {k: name for k, column in enumerate(schema) if (name := self.find(column.names)) is not None}
        self._notice_meanings(list(found.values()))
        iso = [name for k, name in found.items() if schema[k].iso]
        factors = [schema[k].names[name] for k, name in found.items()]
        line = self._header_lines + 1
        for piece in self._lines:
            if self._decimal_comma is None:
                self._decimal_comma = self._has_decimal_commas(piece)
            text = piece.replace(b",", b".") if self._decimal_comma and self._separator != "," else piece
            text = self._with_unix_times(text, iso, line) if iso else text
            numbers = self._numbers(text, list(found.values()), line)
            rows = np.full((len(numbers), len(schema)), np.nan)
            rows[:, list(found)] = numbers * factors
            yield rows
            line += piece.count(b"\n")
        if self.fault:
            self.notices.append(cut_notice(self.path, self.fault))

    def _notice_meanings(self, names: Sequence[str]) -> None:
        """Say which columns are read that are written otherwise than furrowmap names them."""
        told = [f"`{self.written[self.place(name)]}` → {name}" for name in names if name not in self.written]
        notice = Notice("columns-by-meaning", path=self.path.name, columns=", ".join(told))
        if told and notice not in self.notices:
            self.notices.append(notice)

    def _has_decimal_commas(self, piece: bytes) -> bool:
        """Whether the first complete lines of a file have commas for points."""
        lines = piece.decode("latin-1").split("\n", _LOOKED_AT_ROWS)[:_LOOKED_AT_ROWS]
        try:
            rows = list(csv.reader(lines, delimiter=self._separator, skipinitialspace=True))
        except csv.Error:
            return False
        return has_decimal_commas(rows, self._separator)

    def _complete_lines(self) -> Iterator[bytes]:
        """The lines of the header, then pieces of complete lines; a last line that may be cut is dropped."""
        tail = b""
        while block := self.read(CSV_CHUNK_BYTES):
            self._unread += block
            while self._in_header and b"\n" in self._unread:
                line, _, self._unread = self._unread.partition(b"\n")
                yield line
            end = self._unread.rfind(b"\n") + 1
            if end and not self._in_header:
                yield self._unread[:end]
                tail = self._unread[max(0, end - MAX_TAIL_BYTES) : end]
                self._unread = self._unread[end:]
            if len(self._unread) > LONGEST_LINE_BYTES:
                raise InputError("not-a-table.endless-line", path=self.path, most_mb=LONGEST_LINE_BYTES / 1e6)
        if not self._unread.strip() or self.fault:
            return
        if is_whole(self._unread, tail.splitlines(), self._separator):
            yield self._unread
        else:
            self.notices.append(Notice("last-line-cut", path=self.path))

    def _with_unix_times(self, piece: bytes, columns: Sequence[str], line: int) -> bytes:
        """Complete lines with the ISO 8601 times in some columns as seconds since 1970."""
        places = [self.place(name) for name in columns]
        mark = self._separator.encode()
        lines = piece.split(b"\n")
        for k, text in enumerate(lines):
            fields = text.rstrip(b"\r").split(mark)
            if len(fields) <= max(places):
                continue
            for place in places:
                cell = fields[place].decode("latin-1").strip().strip('"').strip()
                try:
                    fields[place] = b"%.6f" % unix_time(cell) if cell else b""
                except ValueError:
                    where = f"{self.path}, line {line + k}"
                    raise InputError(
                        "not-a-time.unix", where=where, column=self.written[place], text=cell[:40]
                    ) from None
            lines[k] = mark.join(fields)
        return b"\n".join(lines)

    def _numbers(self, piece: bytes, columns: Sequence[str], line: int) -> FloatArray:
        """Rows (n, k) of the numbers in some columns of complete lines; nan where a field is empty."""
        places = {self.written[self.place(name)]: self.place(name) for name in columns}
        if not piece.strip():
            return np.empty((0, len(places)))
        try:
            numbers: FloatArray = np.loadtxt(
                io.TextIOWrapper(io.BytesIO(self._with_nan(piece)), "latin-1"),
                np.float64,
                comments=None,
                delimiter=self._separator,
                quotechar='"',
                usecols=list(places.values()),
                ndmin=2,
            )
        except ValueError:  # a word for an empty field, a line with too few fields, or no number
            return np.array(list(self._rows_by_field(piece, places, line))).reshape(-1, len(places))
        return numbers

    def _with_nan(self, piece: bytes) -> bytes:
        """Complete lines with `nan` in empty fields, which numpy would refuse."""
        mark = self._separator.encode()
        piece = piece.replace(mark + mark, mark + b"nan" + mark).replace(mark + mark, mark + b"nan" + mark)
        piece = piece.replace(mark + b"\n", mark + b"nan\n").replace(mark + b"\r\n", mark + b"nan\r\n")
        piece = piece.replace(b"\n" + mark, b"\nnan" + mark)
        return b"nan" * piece.startswith(mark) + piece + b"nan" * piece.endswith(mark)

    def _rows_by_field(self, piece: bytes, places: Mapping[str, int], line: int) -> Iterator[list[float]]:
        """Rows of the numbers in some columns, nan where a field is empty or missing; InputError if it is no number."""
        for k, text in enumerate(piece.decode("latin-1").split("\n")):
            where = f"{self.path}, line {line + k}"
            try:
                fields = next(csv.reader([text.strip(" \r")], delimiter=self._separator, skipinitialspace=True))
            except csv.Error:
                raise InputError("not-a-number", where=where, what=Text("the line is no row of numbers")) from None
            row = []
            for name, place in places.items():
                field = fields[place].strip() if place < len(fields) else ""
                try:
                    plain = field.replace(",", ".") if self._decimal_comma else field
                    # float() would take 1_0 for ten
                    row.append(np.nan if field.lower() in _NO_VALUE else float(plain.replace("_", "?")))
                except ValueError:
                    what = f"column `{name}` holds {field[:40]!r}"
                    raise InputError("not-a-number", where=where, what=what) from None
            if any(fields):
                yield row


def head_columns(head: Head) -> list[str]:
    """The columns by the names that furrowmap gives them; none if it is not text with a line below a header."""
    if b"\0" in head.data:
        return []
    lines = head.data.split(b"\n")
    header = header_of(lines[:-1])
    if not any(lines[header.lines :]) or sum(map(len, lines[: header.lines])) > MAX_HEADER_BYTES:
        return []
    return standard_names(header.names)


def names_a_position(name: str) -> bool:
    """Whether a column's name is that of a coordinate."""
    return _POSITION_NAME.search(name.lower()) is not None


def unix_time(text: str) -> float:
    """Seconds since 1970 of an ISO 8601 date and time, UTC without a zone; ValueError if it is none."""
    try:
        stamp = dt.datetime.fromisoformat(text.replace("/", "-"))
        return (stamp if stamp.tzinfo else stamp.replace(tzinfo=dt.UTC)).timestamp()
    except OverflowError as error:
        raise ValueError(text) from error


def read_small(path: Path, max_bytes: int) -> tuple[bytes, list[Notice]]:
    """The content of a small text file, and a notice if it is cut.

    ValueError if it is larger, or no text.
    """
    with Source(path) as source:
        data = source.read(max_bytes + 1)
        fault = source.fault
    if len(data) > max_bytes:
        raise ValueError(Text("more than {max_bytes:,} bytes", max_bytes=max_bytes))
    if (kind := binary_kind(data)) is not None:
        raise ValueError(Text("it is {kind}, not text", kind=kind))
    return data, [cut_notice(path, fault)] if fault else []


@dataclass(frozen=True)
class TextRows:
    """A small CSV: the names of its columns, and of each row the number of its line and its fields by their columns."""

    names: list[str]
    rows: list[tuple[int, dict[str, str]]]
    notices: tuple[Notice, ...]


def text_rows(data: bytes, path: Path) -> TextRows:
    """The fields of a CSV as text, numbers with points; a code page that it leaves open is noticed."""
    lines = data.splitlines()
    header = header_of(lines)
    found = decoded(lines)
    guessed = (found.notice("code-page", path.name),) if found is not None and found.open else ()
    texts = found.texts if found is not None else [line.decode("utf-8", "replace") for line in lines]
    title = header.lines - 1 - header.has_units
    names = row_cells(texts[title].removeprefix("\ufeff"), header.separator) if texts else []
    if header.has_units:
        names = with_units(names, row_cells(texts[title + 1], header.separator)) or names
    numbers = [k for k in range(header.lines, len(lines)) if texts[k].strip()]
    cells = [row_cells(texts[k], header.separator) for k in numbers]
    if has_decimal_commas(cells, header.separator):
        cells = [[with_points(cell) for cell in row] for row in cells]
    rows = [(k + 1, dict(zip(names, row, strict=False))) for k, row in zip(numbers, cells, strict=True)]
    return TextRows(names, rows, guessed)


def is_whole(line: bytes, before: Sequence[bytes], separator: str = ",") -> bool:
    """Whether a last line without a newline is certainly complete, by the last :data:`COMPARED_LINES` lines before it.

    It is if it has as many fields as each of them, and its last field is a number with as many decimals as theirs:
    81.02 may be cut to 81.0, 81 or 8, which have fewer.
    """
    forms = {_form(other, separator) for other in before[-COMPARED_LINES:]}
    count, decimals = _form(line, separator)
    return forms == {(count, decimals)} and decimals[:1] in (b".", b",") and decimals[1:2] == b"0"


def _form(line: bytes, separator: str) -> tuple[int, bytes]:
    """Number of fields, and the last one without the digits before its point and with 0 for those behind."""
    fields = (_FIELD_PATTERN if separator == "," else _FIELD_WITH_COMMAS).findall(line)
    if not fields:
        return 0, b""
    return len(fields), re.sub(rb"\d", b"0", _WHOLE_DIGITS.sub(b"", fields[-1]))
