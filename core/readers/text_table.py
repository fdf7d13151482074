"""Tables by survey software and spreadsheets (text, xlsx, xls, ods): encodings, separators, decimal commas."""

import csv
import re
import zipfile
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from importlib.util import find_spec
from io import StringIO
from pathlib import Path, PurePosixPath
from typing import Final

import numpy as np

from furrowmap.core.readers.las.decoder import Decoder, Undecodable
from furrowmap.core.readers.text_encoding import decoded
from furrowmap.core.runtime.arrays import FloatArray
from furrowmap.core.runtime.errors import InputError, Notice
from furrowmap.core.runtime.file_signatures import binary_kind
from furrowmap.core.runtime.memory import expect_disk, expect_growth, expect_memory

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
            raise ValueError(f"it has {len(files):,} files")
        if len(mains) != 1:
            names = ", ".join(file.filename for file in mains[:3])
            raise ValueError(f"it holds {len(mains)} Shapefiles and KML files{': ' + names if names else ''}, not one")
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
_MOST_SHEET_TEXT: Final = 1 << 26
"""Bytes of the cells, as JSON."""
_OLE: Final = b"\xd0\xcf\x11\xe0"
"""The first bytes of an xls."""
_BYTES_PER_UNPACKED: Final = 40
"""Bytes of memory for each byte of an unpacked sheet, at most."""
_MOST_CELLS: Final = 1_000_000
_PADDED_TIMES: Final = 10
"""Cells of short rows that are filled up, and those for each cell that is there."""
_SEPARATOR_LINE: Final = re.compile(r'"?sep=(.)"?', re.IGNORECASE)
"""The first line of tables that tell spreadsheets their separator."""
_SEPARATORS: Final = ",;\t"
_UNIT: Final = re.compile(r"\s*[(\[（].*?[)\]）]\s*$")
_DECIMAL_POINT: Final = re.compile(r"\s*[+-]?\d+\.\d+\s*")
_THOUSANDS: Final = re.compile(r"\s*[+-]?\d{1,3},\d{3}\s*")
_DECIMAL_COMMA: Final = re.compile(r"\s*[+-]?\d+,\d+\s*")


@dataclass(frozen=True)
class TextTable:
    """Rows of text under names of columns in lower case, without a unit in brackets."""

    columns: dict[str, list[str]]
    lines: list[int]
    decimal_comma: bool
    notices: tuple[Notice, ...] = ()

    @property
    def names(self) -> str:
        """The names of the columns, for messages."""
        return ", ".join(self.columns)[:200]

    def find(self, names: Iterable[str]) -> str | None:
        """The first of some names that a column has."""
        return next((name for name in names if name in self.columns), None)

    def numbers(self, name: str) -> FloatArray:
        """A column (n,); nan where a cell holds no number."""
        cells = [cell.strip() for cell in self.columns[name]]
        if self.decimal_comma:
            cells = [cell.replace(",", ".") for cell in cells]
        return np.array([value if isinstance(value := number_or_text(cell), float) else np.nan for cell in cells])

    def first_fault(self, name: str) -> tuple[int, str] | None:
        """Line and text of the first cell of a column that is not a number; None if there is none."""
        known = np.isfinite(self.numbers(name))
        at = (k for k, cell in enumerate(self.columns[name]) if cell.strip() and not known[k])
        found = next(at, None)
        return None if found is None else (self.lines[found], self.columns[name][found].strip())


def number_or_text(text: str) -> float | str | None:
    """A cell as a number, else as text; None if it is empty."""
    text = text.strip()
    try:
        return float(text)
    except ValueError:
        return text or None


def is_separator_line(line: str) -> bool:
    """Whether the first line of a table only tells its separator, as spreadsheets write it: `sep=;`."""
    return _SEPARATOR_LINE.fullmatch(line.strip()) is not None


def read_table(path: Path, unreadable: Callable[[str], InputError]) -> TextTable:
    """A table in a text file, without comments (#); the error of `unreadable` if it cannot be read or is no table."""
    try:
        if not path.is_file() and path.exists():  # reading a pipe would wait for ever
            raise unreadable("it is no file")
        return _parse_table(path)
    except (ValueError, OSError) as error:
        raise unreadable(_reason(error)) from None


def read_sheet(path: Path, unreadable: Callable[[str], InputError]) -> TextTable:
    """The first sheet of a spreadsheet, or a CSV. The first row that is not empty has the names of the columns.

    The error of `unreadable` if the file cannot be read or is no table, or a large or damaged one; InputError if
    python-calamine is needed and not installed, RefusedError if a spreadsheet unpacks to far more than its size.
    """
    try:
        if not path.is_file() and path.exists():  # reading a pipe would wait for ever
            raise unreadable("it is no file")
        with path.open("rb") as file:
            head = file.read(4)
        size = path.stat().st_size
        if size > MAX_SHEET_BYTES:
            raise unreadable(f"{size:,} bytes is too large for a table of a trial")
        if not head.startswith((ZIP, _OLE)):
            return _parse_table(path)
        if head.startswith(ZIP):
            try:
                with zipfile.ZipFile(path) as archive:
                    whole = sum(file.file_size for file in archive.infolist())
            except Exception as error:  # noqa: BLE001 damage ends in errors of many families
                raise unreadable(f"it is a damaged spreadsheet ({str(error)[:100]})") from None
            expect_growth(path, size, whole)
            expect_memory(path, _BYTES_PER_UNPACKED * whole)
        rows = [row for row in _sheet_rows(path) if any(cell.strip() for cell in row)]
    except (ValueError, OSError) as error:
        raise unreadable(_reason(error)) from None
    if not rows:
        raise unreadable("its first sheet is empty")
    return _table_of(rows, list(range(2, 1 + len(rows))), decimal_comma=False)


def _reason(error: ValueError | OSError) -> str:
    return str(error.strerror if isinstance(error, OSError) else error)


def _table_of(rows: list[list[str]], lines: list[int], *, decimal_comma: bool) -> TextTable:
    """The rows below the first, which has the names of the columns."""
    names = [_UNIT.sub("", cell.strip()).casefold() for cell in rows[0]]
    if len(names) * len(rows) > _MOST_CELLS + _PADDED_TIMES * sum(map(len, rows)):
        raise ValueError(f"it has {len(names):,} columns, of which most rows have only the first")
    body = [[*row, *[""] * (len(names) - len(row))] for row in rows[1:]]
    columns = {name: [row[k] for row in body] for k, name in enumerate(names) if name}
    return TextTable(columns, lines, decimal_comma)


def _parse_table(path: Path) -> TextTable:
    content, notices = _decoded(path)
    lines = [(k, line) for k, line in enumerate(content.splitlines(), start=1)]
    lines = [(k, line) for k, line in lines if line.strip() and not line.startswith("#")]
    if not lines:
        raise ValueError("it is empty")
    head = lines[0][1]
    told = _SEPARATOR_LINE.fullmatch(head.strip())
    if told is not None and len(lines) > 1:
        lines = lines[1:]
        head = lines[0][1]
    separator = max(_SEPARATORS, key=head.count) if told is None else told[1]
    if separator not in head:
        raise ValueError("its first line has no comma, semicolon or tab")
    text = StringIO("\n".join(line for _, line in lines))
    try:
        rows = list(csv.reader(text, delimiter=separator, skipinitialspace=True))
    except csv.Error as error:  # such as a cell without an end
        raise ValueError(f"it is no table of cells ({error})") from None
    table = _table_of(
        rows, [k for k, _ in lines[1 : len(rows)]], decimal_comma=_has_decimal_commas(rows[1:], separator)
    )
    return replace(table, notices=tuple(notices))


def _has_decimal_commas(rows: list[list[str]], separator: str) -> bool:
    """Whether cells have commas for points; between commas they are quoted, and may be of thousands instead."""
    cells = [cell for row in rows for cell in row if _DECIMAL_COMMA.fullmatch(cell)]
    if separator != "," or not cells:
        return bool(cells)
    points = any(_DECIMAL_POINT.fullmatch(cell) for row in rows for cell in row)
    return not points and not all(_THOUSANDS.fullmatch(cell) for cell in cells)


def _decoded(path: Path) -> tuple[str, list[Notice]]:
    """The text of a file, and a notice where it leaves its code page open."""
    content = path.read_bytes()
    if content[:2] in (b"\xff\xfe", b"\xfe\xff"):
        try:
            return content.decode("utf-16"), []
        except UnicodeDecodeError:
            raise ValueError("it begins as text in UTF-16, but is none") from None
    if (kind := binary_kind(content)) is not None:
        raise ValueError(f"it is {kind}, not text")
    found = decoded(content.removeprefix(b"\xef\xbb\xbf").split(b"\n"))
    if found is None:
        raise ValueError("its text is neither UTF-8 nor Shift-JIS nor Windows-1252")
    return "\n".join(found.texts), [found.notice("code-page", path.name)] if found.open else []


def _sheet_rows(path: Path) -> list[list[str]]:
    """The first sheet, read in a process that may die of it: a library panics on damage, or takes all memory."""
    if find_spec("python_calamine") is None:
        raise InputError("extra-missing.rows", path=path)
    process = Decoder()
    try:
        return process.sheet(path, _MOST_SHEET_TEXT)
    except Undecodable as error:
        raise ValueError(f"it is a damaged or locked spreadsheet ({str(error)[:100]})") from None
    finally:
        process.close()
