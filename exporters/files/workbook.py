"""Tables as a spreadsheet (xlsx), by openpyxl."""

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from furrowmap.core.runtime.errors import InputError
from furrowmap.exporters.files.atomic import atomic_output
from furrowmap.exporters.files.csv_cells import cell

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
            sheet.append([_value(row.get(column)) for column in columns])
        for head in sheet[1]:
            head.font = Font(bold=True)
            sheet.column_dimensions[head.column_letter].width = max(10, len(str(head.value)) + 2)
        sheet.freeze_panes = "A2"
    with atomic_output(path) as unfinished:
        book.save(unfinished)


def _value(value: Any) -> object:
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return cell(value)
