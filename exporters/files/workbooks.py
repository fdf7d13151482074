"""Spreadsheets whose texts no program takes for a formula."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from furrowmap.exporters.files.atomic import atomic_output
from furrowmap.exporters.files.csv_cells import cell, known_or_empty

Rows = Sequence[Mapping[str, Any]]


def write_workbook(path: Path, sheets: Mapping[str, Rows]) -> None:
    """Write a spreadsheet with a sheet of rows for each name, if openpyxl is installed; nan is an empty cell."""
    try:
        from openpyxl import Workbook
        from openpyxl.styles import Font
        from openpyxl.worksheet._writer import ALL_TEMP_FILES
    except ImportError:
        return
    book = Workbook()
    book.remove(book.active)
    for name, rows in sheets.items():
        sheet = book.create_sheet(name)
        columns = list(dict.fromkeys(column for row in rows for column in row))
        sheet.append([cell(column) for column in columns])
        for row in rows:
            sheet.append([known_or_empty(row.get(column)) for column in columns])
        for head in sheet[1]:
            head.font = Font(bold=True)
            sheet.column_dimensions[head.column_letter].width = max(10, len(str(head.value)) + 2)
        sheet.freeze_panes = "A2"
    try:
        with atomic_output(path) as unfinished:
            book.save(unfinished)
    except BaseException:
        for name in ALL_TEMP_FILES:  # openpyxl itself removes those of a failed write when the process ends
            Path(name).unlink(missing_ok=True)
        raise
