"""Tables by survey software and spreadsheets (text, xlsx, xls, ods): encodings, separators, decimal commas."""

import csv
import re
import zipfile
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from importlib.util import find_spec
from io import StringIO
from pathlib import Path, PurePosixPath
from typing import Final

import numpy as np

from furrowmap.core.readers.column_names import (
    ambiguous,
    length_unit_m,
    means,
    standard_name,
    states_unit,
    with_units,
    without_unit,
)
from furrowmap.core.readers.csv_text import SEPARATORS, has_decimal_commas, header_of, separator_of_line
from furrowmap.core.readers.las.las_decoder import Decoder, Undecodable
from furrowmap.core.readers.source import Source, cut_notice
from furrowmap.core.readers.text_encoding import decoded
from furrowmap.core.runtime.arrays import FloatArray
from furrowmap.core.runtime.errors import InputError, MissingExtraError, Notice
from furrowmap.core.runtime.file_signatures import binary_kind, file_kind
from furrowmap.core.runtime.languages.texts import Text, Words, reason
from furrowmap.core.runtime.memory import expect_disk, expect_growth, expect_memory
from furrowmap.core.runtime.plain_reads import open_plain

ZIP: Final = b"PK\3\4"
_SHAPEFILE_PARTS: Final = (".shp", ".shx", ".dbf", ".prj", ".cpg")
_MAINS: Final = (".shp", ".kml")
MAX_FILES: Final = 1000


def unpacked_layer(path: Path, folder: Path) -> Path:
    """Unpack the only Shapefile or KML of an archive into a folder, under names of its own.

    Raises:
        ValueError: if the archive has no or several layers.
        RefusedError: if it unpacks to far more than its size.
        Exception: of any family, if it is damaged.
    """
    with zipfile.ZipFile(path) as archive:
        files = archive.infolist()
        mains = [
            file
            for file in files
            if PurePosixPath(file.filename).suffix.lower() in _MAINS and "__MACOSX" not in file.filename
        ]
        if len(files) > MAX_FILES:
            raise ValueError(Text("it has {files:,} files", files=len(files)))
        if len(mains) != 1:
            raise ValueError(
                Text(
                    "it holds {count} Shapefiles and KML files{names:: {names}|}, not one",
                    count=len(mains),
                    names=tuple(file.filename for file in mains[:3]),
                )
            )
        stem = PurePosixPath(mains[0].filename).with_suffix("").as_posix().casefold()
        parts = [file for file in files if PurePosixPath(file.filename).with_suffix("").as_posix().casefold() == stem]
        wanted = [file for file in parts if PurePosixPath(file.filename).suffix.lower() in (*_SHAPEFILE_PARTS, ".kml")]
        whole = sum(file.file_size for file in wanted)
        expect_growth(path, path.stat().st_size, whole)
        expect_memory(path, max(file.file_size for file in wanted))
        expect_disk(path, folder, whole)
        for file in wanted:
            with archive.open(file) as stream:
                data = stream.read(file.file_size + 1)
            (folder / f"layer{PurePosixPath(file.filename).suffix.lower()}").write_bytes(data)
        return folder / f"layer{PurePosixPath(mains[0].filename).suffix.lower()}"


MAX_SHEET_BYTES: Final = 20_000_000
_SHEET_PARTS: Final = frozenset({"xl/workbook.xml", "xl/workbook.bin", "content.xml"})
"""One of them is in every archive that is a spreadsheet."""
_TABLE_HEAD_BYTES: Final = 4096
_MOST_TEXT_BYTES: Final = 100_000_000
_MOST_SHEET_TEXT: Final = 1 << 26
"""Bytes of the cells, as JSON."""
_OLE: Final = b"\xd0\xcf\x11\xe0"
"""The first bytes of an xls."""
_BYTES_PER_UNPACKED: Final = 40
"""Bytes of memory for each byte of an unpacked sheet, at most."""
_MOST_CELLS: Final = 1_000_000
_PADDED_TIMES: Final = 10
"""Cells of short rows that are filled up, and those for each cell that is there."""
_UNIT: Final = re.compile(r"\s*[(\[（].*?[)\]）]\s*$")


@dataclass(frozen=True)
class TextTable:
    """Rows of text under names of columns in lower case, without a unit in brackets.

    Attributes:
        written: the names as they stand in the file, by those of `columns`.
        twice: names of several columns with different cells, of which `columns` has the first.
    """

    columns: dict[str, list[str]]
    lines: list[int]
    decimal_comma: bool
    notices: tuple[Notice, ...] = ()
    written: Mapping[str, str] = field(default_factory=dict)
    twice: frozenset[str] = frozenset()
    path: Path = Path()

    @property
    def names(self) -> str:
        """The names of the columns, for messages."""
        return ", ".join(self.columns)[:200]

    def find(self, names: Iterable[str]) -> str | None:
        """The column that has one of some names, the first of them that one has, or means it (:mod:`.column_names`).

        It may be a length in another unit, which :meth:`unit_m` tells.

        InputError if several mean it and differ.
        """
        wanted = list(names)
        found = next((name for name in wanted if name in self.columns), None)
        if found is not None:
            if found in self.twice:
                raise ambiguous(self.path, found, [self.written.get(found, found)] * 2)
            return found
        titles = {self.written.get(name, name): name for name in self.columns}
        for name in wanted:
            standard = standard_name(name)
            of_length = [title for title in titles if standard is not None and without_unit(title) == standard]
            same = [title for title in titles if means(title, name)] or of_length
            if len({tuple(self.columns[titles[title]]) for title in same}) > 1:
                raise ambiguous(self.path, name, same)
            if same:
                return titles[same[0]]
        return None

    def unit_m(self, name: str) -> float | None:
        """The unit of length that the name of a column states in brackets or at its end, in metres."""
        return length_unit_m(self.written.get(name, name))

    def numbers(self, name: str) -> FloatArray:
        """A column (n,); nan where a cell holds no number."""
        cells = [cell.strip() for cell in self.columns[name]]
        if self.decimal_comma:
            cells = [cell.replace(",", ".") for cell in cells]
        return np.array([value if isinstance(value := number_or_text(cell), float) else np.nan for cell in cells])

    def first_fault(self, names: Iterable[str]) -> Text | None:
        """The first cell of some columns that is not a number, in words; None if there is none."""
        for name in names:
            known = np.isfinite(self.numbers(name))
            for line, cell, is_number in zip(self.lines, self.columns[name], known, strict=True):
                if cell.strip() and not is_number:
                    return Text("line {line} holds {text!r} under {name}", line=line, text=cell.strip(), name=name)
        return None


def number_or_text(text: str) -> float | str | None:
    """A cell as a number, else as text; None if it is empty."""
    text = text.strip()
    try:
        return float(text)
    except ValueError:
        return text or None


def column_names(path: Path) -> list[str]:
    """The names of the columns of a table in a text file, as of :class:`TextTable`; none of what is no text."""
    with Source(path) as source:
        head = source.read(_TABLE_HEAD_BYTES)
    if b"\0" in head or head.lstrip(b"\xef\xbb\xbf \t\r\n")[:1] in (b"{", b"<", b"["):
        return []
    return _plain_names(header_of(head.split(b"\n")).names)


def is_spreadsheet(path: Path) -> bool:
    """Whether a file is a spreadsheet (xlsx, xls, ods)."""
    with open_plain(path) as file:
        head = file.read(4)
    if head != ZIP:
        return head == _OLE
    try:
        with zipfile.ZipFile(path) as archive:
            return not _SHEET_PARTS.isdisjoint(archive.namelist())
    except Exception:  # noqa: BLE001 damage ends in errors of many families
        return False


def read_table(path: Path, unreadable: Callable[[Words], InputError]) -> TextTable:
    """A table in a text file, without comments (#), or the first sheet of a spreadsheet.

    The first row that is not empty has the names of the columns.

    Raises:
        InputError: that of `unreadable` if the file cannot be read or is no table, or a large or damaged spreadsheet;
            another if python-calamine is needed and not installed.
        RefusedError: if a file unpacks to far more than its size.
    """
    try:
        if not path.is_file() and path.exists():  # reading a pipe would wait for ever
            raise unreadable(Text("it is no file"))
        with open_plain(path) as file:
            head = file.read(4)
        return _sheet(path, unreadable) if head in (ZIP, _OLE) else _parse_table(path)
    except (ValueError, OSError) as error:
        raise unreadable(reason(error)) from None


def _sheet(path: Path, unreadable: Callable[[Words], InputError]) -> TextTable:
    size = path.stat().st_size
    if size > MAX_SHEET_BYTES:
        raise unreadable(Text("{size:,} bytes is too large for a spreadsheet", size=size))
    if zipfile.is_zipfile(path):
        try:
            with zipfile.ZipFile(path) as archive:
                whole = sum(file.file_size for file in archive.infolist())
        except Exception as error:  # noqa: BLE001 damage ends in errors of many families
            raise unreadable(Text("it is a damaged spreadsheet ({why})", why=reason(error))) from None
        expect_growth(path, size, whole)
        expect_memory(path, _BYTES_PER_UNPACKED * whole)
    rows = [row for row in _sheet_rows(path) if any(cell.strip() for cell in row)]
    if not rows:
        raise unreadable(Text("its first sheet is empty"))
    return replace(_table_of(rows, list(range(2, 1 + len(rows))), decimal_comma=False), path=path)


def _plain_names(cells: Sequence[str]) -> list[str]:
    """Names in lower case; without what stands in brackets, unless it changes the meaning or tells columns apart."""
    short = [_UNIT.sub("", cell.strip()) for cell in cells]
    times = Counter(short)
    return [
        (whole.strip() if _means_other(whole, plain) or times[plain] > 1 else plain).casefold()
        for whole, plain in zip(cells, short, strict=True)
    ]


def _means_other(written: str, plain: str) -> bool:
    """Whether a name means something else without its brackets: `Height (ellipsoidal)`, `X (Northing)`, `lon (rad)`."""
    standard = standard_name(written) or without_unit(written)
    if standard is not None:
        return standard != standard_name(plain)
    return states_unit(written) and standard_name(plain) is not None


def _table_of(rows: list[list[str]], lines: list[int], *, decimal_comma: bool) -> TextTable:
    """The rows below the first, which has the names of the columns, and below those of the second if it has units."""
    titles = with_units(rows[0], rows[1]) if len(rows) > 1 else None
    if titles is not None:
        rows = [titles, *rows[2:]]
        lines = lines[1:]
    names = _plain_names(rows[0])
    if len(names) * len(rows) > _MOST_CELLS + _PADDED_TIMES * sum(map(len, rows)):
        raise ValueError(f"it has {len(names):,} columns, of which most rows have only the first")
    body = [[*row, *[""] * (len(names) - len(row))] for row in rows[1:]]
    columns: dict[str, list[str]] = {}
    twice = set()
    for k, name in enumerate(names):
        cells = [row[k] for row in body]
        if name and columns.setdefault(name, cells) != cells:
            twice.add(name)
    written = dict(zip(names, (cell.strip() for cell in rows[0]), strict=True))
    return TextTable(columns, lines, decimal_comma, written=written, twice=frozenset(twice))


def _parse_table(path: Path) -> TextTable:
    raw, notices = _decoded(path)
    lines = [(k, line) for k, line in enumerate(raw, start=1)]
    told = next((told for _, line in lines[:1] if (told := separator_of_line(line.encode()))), "")
    lines = [(k, line) for k, line in lines[bool(told) :] if line.strip() and not line.startswith("#")]
    if not lines:
        raise ValueError("it is empty")
    head = lines[0][1]
    separator = told or max(SEPARATORS, key=head.count)
    if separator not in head:
        raise ValueError(Text("its first line has no comma, semicolon or tab"))
    text = StringIO("\n".join(line for _, line in lines))
    try:
        rows = list(csv.reader(text, delimiter=separator, skipinitialspace=True))
    except csv.Error as error:  # such as a cell without an end
        raise ValueError(Text("it is no table of cells ({why})", why=error)) from None
    # Spreadsheets write rows of separators alone below a table.
    kept = [k for k, row in enumerate(rows) if k == 0 or any(cell.strip() for cell in row)]
    rows = [rows[k] for k in kept]
    numbers = [lines[k][0] for k in kept[1:]]
    table = _table_of(rows, numbers, decimal_comma=has_decimal_commas(rows[1:], separator))
    return replace(table, notices=tuple(notices), path=path)


def _decoded(path: Path) -> tuple[list[str], list[Notice]]:
    """The lines of a file, and notices that it is cut, or leaves its code page open."""
    with Source(path) as source:
        content = source.read(_MOST_TEXT_BYTES + 1)
        fault = source.fault
    if len(content) > _MOST_TEXT_BYTES:
        raise ValueError(Text("it has more than {max_bytes:,} bytes", max_bytes=_MOST_TEXT_BYTES))
    if (kind := binary_kind(content)) is not None:
        raise ValueError(Text("it is {kind}, not text", kind=kind))
    if content.lstrip(b"\xef\xbb\xbf \t\r\n")[:1] in (b"<", b"{") and (named := file_kind(content)) is not None:
        raise ValueError(Text("it is {kind}, not a table", kind=named.name))
    found = decoded(content.removeprefix(b"\xef\xbb\xbf").splitlines())
    if found is None:
        raise ValueError(Text("its text is neither UTF-8 nor Shift-JIS nor Windows-1252"))
    notices = [cut_notice(path, fault)] if fault else []
    return found.texts, [*notices, *([found.notice("code-page", path.name)] if found.open else [])]


def _sheet_rows(path: Path) -> list[list[str]]:
    """The first sheet, read in a process that may die of it: a library panics on damage, or takes all memory."""
    if find_spec("python_calamine") is None:
        raise MissingExtraError(
            "python-calamine",
            "trials",
            Text("{path} is a spreadsheet, which is read by it.", path=path),
            otherwise=Text("save the table as CSV"),
        )
    process = Decoder()
    try:
        return process.sheet(path, _MOST_SHEET_TEXT)
    except Undecodable as error:
        raise ValueError(Text("it is a damaged or locked spreadsheet ({why})", why=reason(error))) from None
    finally:
        process.close()
