"""Text tables as written by survey software and spreadsheets: encodings, separators, decimal commas."""

from __future__ import annotations

import csv
import re
from dataclasses import dataclass
from io import StringIO
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from furrowmap.core.runtime.foreign_content import binary_kind

FloatArray = NDArray[np.float64]

_ENCODINGS: Final = ("utf-8-sig", "cp932")
"""Without a byte order mark: UTF-8, or Shift-JIS from Japanese spreadsheets."""
_SEPARATORS: Final = ",;\t"
_UNIT: Final = re.compile(r"\s*[(\[（].*?[)\]）]\s*$")
_DECIMAL_COMMA: Final = re.compile(r"\s*[+-]?\d+,\d+\s*")


@dataclass(frozen=True)
class SurveyTable:
    """Rows of text under names of columns.

    Attributes:
        columns: each column's cells by its name in lower case, without a unit in brackets.
        lines: number in the file of each row.
        decimal_comma: whether numbers have a decimal comma.
    """

    columns: dict[str, list[str]]
    lines: list[int]
    decimal_comma: bool

    def numbers(self, name: str) -> FloatArray:
        """A column (n,); nan where a cell holds no number."""
        cells = [cell.strip() for cell in self.columns[name]]
        if self.decimal_comma:
            cells = [cell.replace(",", ".") for cell in cells]
        return np.array([_number(cell) for cell in cells])

    def first_fault(self, name: str) -> tuple[int, str] | None:
        """Line and text of the first cell of a column that is not a number; None if there is none."""
        known = np.isfinite(self.numbers(name))
        at = (k for k, cell in enumerate(self.columns[name]) if cell.strip() and not known[k])
        found = next(at, None)
        return None if found is None else (self.lines[found], self.columns[name][found].strip())


def read_table(path: Path) -> SurveyTable:
    """A table in a text file; lines that begin with # are comments.

    Raises:
        ValueError: if it is no table; its text says why.
        OSError: if it cannot be read.
    """
    lines = [(k, line) for k, line in enumerate(_text(path.read_bytes()).splitlines(), start=1)]
    lines = [(k, line) for k, line in lines if line.strip() and not line.startswith("#")]
    if not lines:
        raise ValueError("it is empty")
    head = lines[0][1]
    separator = max(_SEPARATORS, key=head.count)
    if separator not in head:
        raise ValueError("its first line has no comma, semicolon or tab")
    text = StringIO("\n".join(line for _, line in lines))
    try:
        rows = list(csv.reader(text, delimiter=separator, skipinitialspace=True))
    except csv.Error as error:  # such as a cell without an end
        raise ValueError(f"it is no table of cells ({error})") from None
    names = [column_name(name) for name in rows[0]]
    body = [[*row, *[""] * (len(names) - len(row))] for row in rows[1:]]
    columns = {name: [row[k] for row in body] for k, name in enumerate(names) if name}
    cells = [cell for row in body for cell in row]
    comma = separator != "," and any(_DECIMAL_COMMA.fullmatch(cell) for cell in cells)
    return SurveyTable(columns, [k for k, _ in lines[1 : 1 + len(body)]], comma)


def column_name(cell: str) -> str:
    """A column's name in lower case, without a unit in brackets."""
    return _UNIT.sub("", cell.strip()).casefold()


def _text(content: bytes) -> str:
    if content[:2] in (b"\xff\xfe", b"\xfe\xff"):
        try:
            return content.decode("utf-16")
        except UnicodeDecodeError:
            raise ValueError("it begins as text in UTF-16, but is none") from None
    if (kind := binary_kind(content)) is not None:
        raise ValueError(f"it is {kind}, not text")
    for encoding in _ENCODINGS:
        try:
            return content.decode(encoding)
        except UnicodeDecodeError:
            continue
    raise ValueError("its text is neither UTF-8 nor Shift-JIS")


def _number(cell: str) -> float:
    try:
        return float(cell)
    except ValueError:
        return float("nan")
