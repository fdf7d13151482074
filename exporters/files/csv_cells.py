"""CSV files whose texts no program takes for a formula."""

import csv
import math
import re
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np

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


def write_csv(path: Path, columns: Iterable[str], rows: Iterable[Iterable[object]]) -> None:
    """Write a CSV in place of an older file; None and a number that is not known are empty cells."""
    with atomic_output(path) as unfinished, unfinished.open("w", newline="", encoding="utf-8") as file:
        table = csv.writer(file, lineterminator="\n")
        table.writerow(map(cell, columns))
        table.writerows(map(known_or_empty, row) for row in rows)


def write_csv_table(path: Path, columns: Sequence[str], rows: Iterable[Mapping[str, Any]]) -> None:
    """Write these columns of rows as :func:`write_csv`."""
    write_csv(path, columns, ([row.get(name) for name in columns] for row in rows))


def known_or_empty(value: object) -> object:
    """A value for a cell; None for a number that is not known."""
    return None if isinstance(value, float | np.floating) and not math.isfinite(value) else cell(value)
