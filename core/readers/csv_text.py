"""How a CSV of anybody is written: its separator line, its separator, its code page, and decimal commas."""

import csv
import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

from furrowmap.core.readers.column_names import with_units
from furrowmap.core.readers.text_encoding import UTF_8, Decoded, decoded

SEPARATORS: Final = ",;\t"
_SEPARATOR_LINE: Final = re.compile(rb'"?sep=(.)"?', re.IGNORECASE)
"""The first line of tables that tell spreadsheets their separator."""
_BYTE_ORDER_MARK: Final = b"\xef\xbb\xbf"
_DECIMAL_POINT: Final = re.compile(r"\s*[+-]?\d+\.\d+\s*")
_THOUSANDS: Final = re.compile(r"\s*[+-]?\d{1,3},\d{3}\s*")
_DECIMAL_COMMA: Final = re.compile(r"\s*[+-]?\d+,\d+\s*")


@dataclass(frozen=True)
class Header:
    """The line with the names of the columns.

    Attributes:
        names: as they stand there, without quotes.
        separator: that of the separator line, else comma, semicolon or tab, whichever is most frequent.
        text: the line in its code page.
        lines: number of lines up to it, with comments (#), empty lines and a separator line before it, and a line of
            units below it.
        has_units: whether there is a line of units, which `names` have then.
    """

    names: list[str]
    separator: str
    text: Decoded
    lines: int
    has_units: bool = False


def header_of(lines: Sequence[bytes]) -> Header:
    """The header among the first lines of a CSV in bytes: the first that is not :func:`before_header`."""
    first = next((k for k, line in enumerate(lines) if not before_header(line)), len(lines) - 1)
    line = lines[first].removeprefix(_BYTE_ORDER_MARK).strip() if lines else b""
    text = decoded([line]) or Decoded([line.decode(UTF_8, "replace")], UTF_8, open=False, example="")
    told = next(filter(None, map(separator_of_line, lines[:first])), "")
    separator = told or max(SEPARATORS, key=text.texts[0].count)
    names = [name.strip().strip('"').strip() for name in text.texts[0].split(separator)]
    below = decoded(lines[first + 1 : first + 2])
    titles = with_units(names, row_cells(below.texts[0], separator)) if below is not None and below.texts else None
    if titles is not None:
        return Header(titles, separator, text, first + 2, has_units=True)
    return Header(names, separator, text, first + 1)


def before_header(line: bytes) -> bool:
    """Whether a first line of a CSV is empty, a comment (#) or a separator line."""
    plain = line.removeprefix(_BYTE_ORDER_MARK).strip()
    return not plain or plain.startswith(b"#") or bool(separator_of_line(plain))


def separator_of_line(line: bytes) -> str:
    """The separator that a line tells spreadsheets, as they write it: `sep=;`; empty for any other line."""
    told = _SEPARATOR_LINE.fullmatch(line.removeprefix(_BYTE_ORDER_MARK).strip(b" \r\n"))
    return told[1].decode("latin-1") if told is not None else ""


def has_decimal_commas(rows: Sequence[Sequence[str]], separator: str) -> bool:
    """Whether cells have commas for points; between commas they are quoted, and may be of thousands instead."""
    cells = [cell for row in rows for cell in row if _DECIMAL_COMMA.fullmatch(cell)]
    if separator != "," or not cells:
        return bool(cells)
    points = any(_DECIMAL_POINT.fullmatch(cell) for row in rows for cell in row)
    return not points and not all(_THOUSANDS.fullmatch(cell) for cell in cells)


def row_cells(line: str, separator: str) -> list[str]:
    """The cells of a line, without quotes and spaces around them."""
    try:
        cells = next(csv.reader([line], delimiter=separator, skipinitialspace=True), [])
    except csv.Error:  # a cell of more than 128 KiB, or a bare carriage return
        cells = line.split(separator)
    return [cell.strip().strip('"').strip() for cell in cells]


def with_points(cell: str) -> str:
    """A cell with a point instead of a decimal comma, if it is such a number."""
    return cell.replace(",", ".") if _DECIMAL_COMMA.fullmatch(cell) else cell
