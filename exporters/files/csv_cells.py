"""Cells and tables of CSV files, whose texts no program takes for a formula."""

import csv
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final

from furrowmap.core.runtime.errors import printable
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
