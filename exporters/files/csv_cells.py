"""CSV files and spreadsheets whose texts no program takes for a formula."""

import csv
import math
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final

from furrowmap.core.runtime.errors import InputError, printable
from furrowmap.exporters.files.atomic import atomic_output

_FORMULA: Final = frozenset("=+-@＝＋－＠")
"""Spreadsheets evaluate a cell that begins with one of these (OWASP: CSV injection); the wide ones in East Asia."""
_PLAIN_NUMBER: Final = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?")


def cell(value: object) -> object:
    """A value for a cell that no program takes for a formula or a control sequence.

    A text is one line with escapes for control characters, and begins with an apostrophe where it would be evaluated;
    everything else, and a text that is a number, is as it was.
    """
    if not isinstance(value, str):
        return value
    text = printable(value)
    return f"'{text}" if text[:1] in _FORMULA and not _PLAIN_NUMBER.fullmatch(text) else text


def write_csv_table(path: Path, columns: Sequence[str], rows: Sequence[Mapping[str, Any]]) -> None:
    """Write these columns of rows as a CSV, in place of an older file."""
    with atomic_output(path) as unfinished, unfinished.open("w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, columns, extrasaction="ignore")
        writer.writeheader()
        writer.writerows({name: cell(value) for name, value in row.items()} for row in rows)


Rows = Sequence[Mapping[str, Any]]


def require_workbook() -> None:
    """Raises InputError if openpyxl is not installed."""
    try:
        import openpyxl  # noqa: F401 only whether it is there
    except ImportError:
        raise InputError("extra-missing.require-workbook") from None


def write_workbook(path: Path, sheets: Mapping[str, Rows]) -> None:
    """Write a spreadsheet with a sheet of rows for each name; a number that is not known is an empty cell."""
    require_workbook()
    from openpyxl import Workbook
    from openpyxl.styles import Font

    book = Workbook()
    book.remove(book.active)
    for name, rows in sheets.items():
        sheet = book.create_sheet(name)
        columns = list(dict.fromkeys(column for row in rows for column in row))
        sheet.append([cell(column) for column in columns])
        for row in rows:
            values = [row.get(column) for column in columns]
            sheet.append([None if isinstance(v, float) and not math.isfinite(v) else cell(v) for v in values])
        for head in sheet[1]:
            head.font = Font(bold=True)
            sheet.column_dimensions[head.column_letter].width = max(10, len(str(head.value)) + 2)
        sheet.freeze_panes = "A2"
    with atomic_output(path) as unfinished:
        book.save(unfinished)
