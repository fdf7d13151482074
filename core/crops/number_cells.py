"""Numbers in cells as people write them: units behind them, thousands separators, decimal commas, codes of no data."""

import math
import re
import unicodedata
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from furrowmap.core.runtime.arrays import BoolArray, FloatArray
from furrowmap.core.runtime.errors import InputError, Notice
from furrowmap.core.values.parcel import Attribute

NODATA_CODES: Final = frozenset(
    {-99.0, -99.9, -99.99, -999.0, -999.9, -999.99, -9999.0, -9999.9, -32768.0, -99999.0, 999.0, 9999.0, 99999.0}
)
"""Numbers that stand for an unknown value in tables of trials, where they lie far from the others."""
LONGEST: Final = 60
"""Characters of a number with its unit."""
FAR_SPANS: Final = 3.0
"""Spans of the other numbers from which on a code is far from them."""
_CELL: Final = re.compile(
    r"([+-]?\d[\d.,' ]*(?:(?<=\d)e[+-]?\d+)?|[+-]?[.,]\d+)\s*([^\W\d_][\w/*^ .-]*|%)?", re.IGNORECASE
)
_GROUPED: Final = re.compile(r"[+-]?[1-9]\d{0,2}(?:([.,' ])\d{3})(?:\1\d{3})*(?:([.,])\d+)?")
_MANY_GROUPS: Final = re.compile(r"[+-]?[1-9]\d{0,2}([.,' ])\d{3}(?:\1\d{3})+")


@dataclass(frozen=True)
class NumberCells:
    """The numbers of n cells.

    Attributes:
        values: (n,); nan where there is none.
        faults: cells that are neither empty nor a number.
        codes: cells with a code of no data; their values are nan.
        unclear: the first cell whose comma may separate decimals or thousands; None without one.
    """

    values: FloatArray
    faults: tuple[int, ...] = ()
    codes: tuple[int, ...] = ()
    unclear: int | None = None

    @property
    def mostly(self) -> bool:
        """Whether more of the cells are numbers than anything else."""
        return int(np.isfinite(self.values).sum()) > len(self.faults)


def number_cells(cells: Sequence[Attribute | None], *, decimal_comma: bool = False) -> NumberCells:
    """The numbers of a column: with one unit behind all of them (but for a 0) or none, thousands separated or not.

    A comma separates decimals if `decimal_comma`, or if a cell of the column shows it.
    """
    texts = [_plain(cell) if isinstance(cell, str) else "" for cell in cells]
    found = [_CELL.fullmatch(text) if len(text) <= LONGEST else None for text in texts]
    numbers = [match[1].strip() if match is not None else "" for match in found]
    units = ["".join((match[2] or "").casefold().split()) if match is not None else "" for match in found]
    mark = "," if decimal_comma else _decimal_mark([number for number in numbers if number])
    if not mark and any(isinstance(cell, float) and math.isfinite(cell) and cell % 1.0 for cell in cells):
        mark = "."
    dots_group = mark == "," and any("," in number for number in numbers)
    values = np.full(len(cells), np.nan)
    unclear = None
    for k, (cell, number) in enumerate(zip(cells, numbers, strict=True)):
        if number:
            if not mark and "," in number and unclear is None:
                unclear = k
            values[k] = _value(number, mark, dots_group=dots_group)
        elif isinstance(cell, int | float) and math.isfinite(cell):
            values[k] = cell
    stated = {unit for unit, value in zip(units, values.tolist(), strict=True) if unit and math.isfinite(value)}
    bare = any(not unit and math.isfinite(value) and value for unit, value in zip(units, values.tolist(), strict=True))
    if bare or len(stated) > 1:
        values[[bool(unit) for unit in units]] = np.nan
    faults = tuple(k for k, text in enumerate(texts) if text and not np.isfinite(values[k]) and k != unclear)
    is_code = _far_codes(values)
    codes = tuple(np.flatnonzero(is_code).tolist())
    return NumberCells(np.where(is_code, np.nan, values), faults, codes, unclear)


def checked_numbers(
    cells: Sequence[Attribute | None], column: str, names: Sequence[str], *, decimal_comma: bool = False
) -> tuple[FloatArray, list[Notice]]:
    """The numbers (n,) of a column of parcels with `names`, nan where there is none, and what is left out.

    Raises InputError if a comma may separate decimals or thousands.
    """
    found = number_cells(cells, decimal_comma=decimal_comma)
    if found.unclear is not None:
        text = str(cells[found.unclear])[:40]
        raise InputError("trial-cells-unclear", column=column, text=text, first=names[found.unclear])
    return found.values, left_out(found, cells, column, names)


def left_out(found: NumberCells, cells: Sequence[Attribute | None], column: str, names: Sequence[str]) -> list[Notice]:
    """Which cells of a column of parcels with `names` are left out."""
    return [
        Notice(
            code,
            column=column,
            count=len(rows),
            total=len(cells),
            text=f"{cells[rows[0]]:g}" if isinstance(cells[rows[0]], float) else str(cells[rows[0]])[:40],
            first=names[rows[0]],
        )
        for code, rows in (("trial-cells-unread", found.faults), ("trial-cells-nodata", found.codes))
        if rows
    ]


def _plain(text: str) -> str:
    """A text in compatible characters, with plain minus signs and apostrophes."""
    return unicodedata.normalize("NFKC", text).replace("\u2212", "-").replace("\u2019", "'").strip()


def _decimal_mark(numbers: Sequence[str]) -> str:
    """What separates decimals, as the numbers of a column show it; "" if a comma may do so or not."""
    for number in numbers:
        grouped = _GROUPED.fullmatch(number)
        if grouped is not None and grouped[2] and grouped[1] != grouped[2]:
            return grouped[2]
        many = _MANY_GROUPS.fullmatch(number)
        if many is not None and many[1] in ".,":
            return "." if many[1] == "," else ","
    single = [number for number in numbers if _GROUPED.fullmatch(number) is None]
    for mark in ",.":
        if any(mark in number for number in single):
            return mark
    return "" if any("," in number for number in numbers) else "."


def _value(number: str, decimal_mark: str, *, dots_group: bool) -> float:
    """A number with or without thousands separators; nan if it is none."""
    grouped = _GROUPED.fullmatch(number)
    if grouped is not None and grouped[1] != decimal_mark and grouped[2] in (None, decimal_mark):
        number = number if grouped[1] == "." and not dots_group else number.replace(grouped[1], "")
    if decimal_mark == "," and "." not in number:
        number = number.replace(",", ".")
    try:
        return float(number)
    except ValueError:
        return math.nan


def _far_codes(values: FloatArray) -> BoolArray:
    """Which values (n,) are codes of no data, far from all that are none."""
    is_code = np.isin(values, list(NODATA_CODES))
    others = values[np.isfinite(values) & ~is_code]
    if not len(others):
        return np.zeros(len(values), np.bool_)
    low = float(others.min())
    high = float(others.max())
    far = FAR_SPANS * max(high - low, abs(low), abs(high))
    return is_code & ((values < low - far) | (values > high + far))
