"""What each parcel of a trial was given: a table of treatments, with doses summed up to a day."""

from __future__ import annotations

import datetime as dt
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

from furrowmap.core.crops.parcels import BLOCKS, listed
from furrowmap.core.readers.areas.corner_table import IDS
from furrowmap.core.readers.sheet import read_sheet
from furrowmap.core.readers.survey_table import SurveyTable
from furrowmap.core.runtime.errors import InputError, Notice, UsageError
from furrowmap.core.values.parcel import Attribute, Parcel

TREATMENT: Final = "treatment"
DATE: Final = "date"
DOSE: Final = "dose"
"""Name of the sum of columns that are named by a day alone."""
_DAY: Final = re.compile(r"^(?P<what>.*?)[\s_]*(?P<day>\d{4}-\d{2}-\d{2})(?: 00:00:00)?$")


@dataclass(frozen=True)
class Treatments:
    """Attributes of parcels, or of treatments that parcels name.

    Attributes:
        by: "id", or "treatment" where the table describes treatments.
        rows: the attributes of each, by identifier.
        notices: what is unusual.
    """

    path: Path
    by: str
    rows: Mapping[str, Mapping[str, Attribute]]
    notices: tuple[Notice, ...] = ()


def read_treatments(path: Path, day: dt.date | None = None) -> Treatments:
    """A table of treatments from a CSV or spreadsheet.

    It has a row for each parcel (column id, parcel or plot) or each treatment (column treatment). Doses at several days
    are columns named by a day (2017-03-16, or n_kg_ha 2017-03-16), or rows with a column date; both are summed up to
    and including `day`.

    Args:
        day: of the flight.

    Raises:
        InputError: if the file cannot be read, has neither column, states an identifier twice (without dates) or a
            day that is none, or has doses by date and `day` is not known.
    """
    try:
        table = read_sheet(path)
    except (ValueError, OSError) as error:
        text = error.strerror if isinstance(error, OSError) else str(error)
        raise _unreadable(path, str(text)) from None
    column = next((name for name in (*IDS, TREATMENT) if name in table.columns), None)
    if column is None or not table.lines:
        raise _unreadable(path, f"no rows under a column id or treatment (its columns: {_names(table)})")
    columns = _Columns.of(path, table, column)
    if columns.dated and day is None:
        raise InputError("treatments-day", path=path)
    rows: dict[str, dict[str, Attribute]] = {}
    for k, cell in enumerate(table.columns[column]):
        key = _label(cell)
        if not key:
            raise _unreadable(path, f"line {table.lines[k]} has no {column}")
        if key in rows and not columns.by_row:
            raise InputError("treatments-twice", path=path, lines=table.lines[k], column=column, key=key)
        rows[key] = columns.merged(rows.get(key), k, day)
    return Treatments(path, TREATMENT if column == TREATMENT else "id", rows)


def with_treatments(parcels: Sequence[Parcel], treatments: Treatments) -> tuple[tuple[Parcel, ...], list[Notice]]:
    """The parcels with the attributes of their treatments, and which have none.

    Raises:
        InputError: if the table names a parcel, or a treatment, that none of the parcels has.
    """
    keys = [
        parcel.id if treatments.by == "id" else _label(str(_attribute(parcel, TREATMENT) or "")) for parcel in parcels
    ]
    unknown = [name for name in treatments.rows if name not in set(keys)]
    if unknown:
        what = "parcel" if treatments.by == "id" else TREATMENT
        raise InputError(
            "treatments-unknown",
            path=treatments.path,
            unknown=listed(unknown, what),
            keys=", ".join(list(dict.fromkeys(keys))[:5]),
        )
    done = tuple(
        _treated(parcel, treatments.rows[key]) if key in treatments.rows else parcel
        for parcel, key in zip(parcels, keys, strict=True)
    )
    bare = [parcel.id for parcel, key in zip(parcels, keys, strict=True) if key not in treatments.rows]
    notices = list(treatments.notices)
    if bare:
        notices.append(Notice("treatments-missing", treatments=treatments.path.name, bare=listed(bare, "parcel")))
    return done, notices


def day_of(text: str | None) -> dt.date | None:
    """The day of a flight as stated; None for none.

    Raises:
        UsageError: if it is no date.
    """
    try:
        return dt.date.fromisoformat(text) if text is not None else None
    except ValueError:
        raise UsageError("usage.day-of", text=text) from None


def _treated(parcel: Parcel, row: Mapping[str, Attribute]) -> Parcel:
    rest = dict(row)
    block = next((rest.pop(name) for name in list(rest) if name in BLOCKS), None)
    stated = parcel.block if parcel.block is not None or block is None else _label(str(block))
    return replace(parcel, block=stated, attributes={**parcel.attributes, **rest})


def _attribute(parcel: Parcel, name: str) -> Attribute | None:
    return next((value for key, value in parcel.attributes.items() if key.casefold() == name), None)


@dataclass(frozen=True)
class _Columns:
    """The columns of a table of treatments."""

    table: SurveyTable
    plain: tuple[str, ...]
    doses: tuple[tuple[str, dt.date, str], ...]
    days: tuple[dt.date, ...] | None
    numeric: frozenset[str]

    @classmethod
    def of(cls, path: Path, table: SurveyTable, column: str) -> _Columns:
        doses, plain = [], []
        for name in table.columns:
            found = _DAY.match(name)
            if found is not None:
                doses.append((found["what"].strip() or DOSE, _day(path, found["day"], 1), name))
            elif name not in (column, DATE):
                plain.append(name)
        days = None
        if DATE in table.columns:
            days = tuple(_day(path, cell, line) for cell, line in zip(table.columns[DATE], table.lines, strict=True))
        for _, _, name in doses:
            fault = table.first_fault(name)
            if fault is not None:
                raise _unreadable(path, f"line {fault[0]} holds {fault[1]!r} under {name}")
        numeric = frozenset(name for name in plain if table.first_fault(name) is None)
        return cls(table, tuple(plain), tuple(doses), days, numeric)

    @property
    def by_row(self) -> bool:
        """Whether each row is a dose at a day."""
        return self.days is not None

    @property
    def dated(self) -> bool:
        """Whether doses have days."""
        return self.by_row or bool(self.doses)

    def merged(self, before: Mapping[str, Attribute] | None, k: int, day: dt.date | None) -> dict[str, Attribute]:
        """The attributes of an identifier with those of row k."""
        merged = dict(before or {})
        counts = self.days is None or (day is not None and self.days[k] <= day)
        for name in self.plain:
            text = self.table.columns[name][k].strip()
            if not text:
                continue
            if name not in self.numeric or name in BLOCKS:
                merged.setdefault(name, text)
            elif self.by_row:
                merged[name] = float(merged.get(name, 0.0)) + (self._number(name, k) if counts else 0.0)
            else:
                merged[name] = self._number(name, k)
        for what, when, name in self.doses:
            given = self._number(name, k) if self.table.columns[name][k].strip() else 0.0
            merged[what] = float(merged.get(what, 0.0)) + (given if day is not None and when <= day else 0.0)
        return merged

    def _number(self, name: str, k: int) -> float:
        cell = self.table.columns[name][k].strip()
        return float(cell.replace(",", ".") if self.table.decimal_comma else cell)


def _day(path: Path, text: str, line: int) -> dt.date:
    try:
        return dt.date.fromisoformat(text.strip()[:10])
    except ValueError:
        raise _unreadable(path, f"line {line}: {text.strip()[:40]!r} is no date such as 2017-03-16") from None


def _label(text: str) -> str:
    """An identifier as those of parcels are written."""
    text = text.strip()
    return text[:-2] if text.endswith(".0") and text[:-2].isdigit() else text


def _names(table: SurveyTable) -> str:
    return ", ".join(table.columns)[:200]


def _unreadable(path: Path, why: str) -> InputError:
    return InputError("treatments-unreadable", path=path, why=why)
