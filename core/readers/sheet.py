"""Tables from spreadsheets (xlsx, xls, ods) and text files, as rows of text under names of columns."""

from __future__ import annotations

import datetime as dt
import zipfile
from pathlib import Path
from typing import Any, Final

from furrowmap.core.readers.survey_table import SurveyTable, column_name, read_table
from furrowmap.core.readers.zipped_layer import ZIP
from furrowmap.core.runtime.allowances import expect_growth, expect_memory
from furrowmap.core.runtime.errors import InputError

LARGEST_BYTES: Final = 20_000_000
_OLE: Final = b"\xd0\xcf\x11\xe0"
"""The first bytes of an xls."""
_ROOM: Final = 40
"""Bytes of memory for each byte of an unpacked sheet, at most."""


def read_sheet(path: Path) -> SurveyTable:
    """The first sheet of a spreadsheet, or a CSV. The first row that is not empty has the names of the columns.

    Raises:
        InputError: if python-calamine is needed and not installed.
        RefusedError: if a spreadsheet unpacks to far more than its size.
        ValueError: if it is no table, or a damaged one; the text says why.
        OSError: if it cannot be read.
    """
    with path.open("rb") as file:
        head = file.read(4)
    size = path.stat().st_size
    if size > LARGEST_BYTES:
        raise ValueError(f"{size:,} bytes is too large for a table of a trial")
    if not head.startswith((ZIP, _OLE)):
        return read_table(path)
    if head.startswith(ZIP):
        _expect_plain(path, size)
    rows = [row for row in _rows(path) if any(cell.strip() for cell in row)]
    if not rows:
        raise ValueError("its first sheet is empty")
    names = [column_name(cell) for cell in rows[0]]
    body = [[*row, *[""] * (len(names) - len(row))] for row in rows[1:]]
    columns = {name: [row[k] for row in body] for k, name in enumerate(names) if name}
    return SurveyTable(columns, list(range(2, 2 + len(body))), decimal_comma=False)


def _expect_plain(path: Path, size: int) -> None:
    try:
        with zipfile.ZipFile(path) as archive:
            whole = sum(file.file_size for file in archive.infolist())
    except Exception as error:  # noqa: BLE001 damage ends in errors of many families
        raise ValueError(f"it is a damaged spreadsheet ({str(error)[:100]})") from None
    expect_growth(path, size, whole)
    expect_memory(path, _ROOM * whole)


def _rows(path: Path) -> list[list[str]]:
    try:
        from python_calamine import CalamineWorkbook
    except ImportError:
        raise InputError("extra-missing.rows", path=path) from None
    try:
        sheet = CalamineWorkbook.from_path(path).get_sheet_by_index(0)
        return [[_text(cell) for cell in row] for row in sheet.to_python()]
    except (KeyboardInterrupt, SystemExit, MemoryError):
        raise
    except BaseException as error:  # noqa: BLE001 the library panics on damage, and its panic is no Exception
        raise ValueError(f"it is a damaged or locked spreadsheet ({str(error)[:100]})") from None


def _text(cell: Any) -> str:
    if isinstance(cell, dt.datetime):
        return cell.date().isoformat() if cell.time() == dt.time() else cell.isoformat()
    if isinstance(cell, dt.date):
        return cell.isoformat()
    if isinstance(cell, float) and cell.is_integer() and abs(cell) < 1e15:
        return str(int(cell))
    return str(cell)
