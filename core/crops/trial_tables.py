"""Tables of a trial: what each parcel was given, with doses summed up to a day, and figures measured on parcels."""

import datetime as dt
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

import numpy as np
import shapely

from furrowmap.core.crops.dose_columns import stated_column
from furrowmap.core.crops.number_cells import checked_numbers, number_cells
from furrowmap.core.crops.parcel_areas import BLOCK_COLUMNS, list_names
from furrowmap.core.readers.areas.polygons import IDS
from furrowmap.core.readers.text_table import TextTable, read_table
from furrowmap.core.runtime.arrays import FloatArray
from furrowmap.core.runtime.errors import InputError, Notice, OptionError
from furrowmap.core.runtime.languages.texts import Text, Words
from furrowmap.core.values.parcel import Attribute, Parcel

TREATMENT: Final = "treatment"
DATE: Final = "date"
DOSE: Final = "dose"
"""Name of the sum of columns that are named by a day alone."""
SPLIT: Final = "{}_by_day"
"""Name of the attribute with the single doses of a sum, such as "03-16: 50, 04-20: 100"."""
SITE: Final = "site"
"""Attribute with the site and year of a parcel in a table of several."""
MEASURE: Final = "mean_height_m"
SIGMA_COLUMNS: Final = {
    MEASURE: "height_sigma_m",
    "volume_m3": "volume_sigma_m3",
    "rate_m_day": "rate_sigma_m_day",
    "growth_m": "growth_sigma_m",
}
"""Column with the standard deviation of a quantity."""
_DAY: Final = re.compile(r"^(?P<what>.*?)[\s_]*(?P<day>\d{4}-\d{2}-\d{2})(?: 00:00:00)?$")


@dataclass(frozen=True)
class Treatments:
    """Attributes of parcels (by "id"), or of treatments that parcels name (by "treatment")."""

    path: Path
    by: str
    rows: Mapping[str, Mapping[str, Attribute]]
    notices: tuple[Notice, ...] = ()


def read_treatments(path: Path, day: dt.date | None = None) -> Treatments:
    """A table of treatments from a CSV or spreadsheet.

    It has a row for each parcel (column id, parcel or plot) or each treatment (column treatment). Doses at several days
    are columns named by a day (2017-03-16, or n_kg_ha 2017-03-16), or rows with a column date; both are summed up to
    and including `day`, and listed as SPLIT. Raises InputError if the file cannot be read, has neither column, states
    an identifier twice (without dates) or a day that is none, or has doses by date and `day` is not known.
    """

    def unreadable(why: Words) -> InputError:
        return InputError("treatments-unreadable", path=path, why=why)

    table = read_table(path, unreadable)
    column = table.find((*IDS, TREATMENT))
    if column is None or not table.lines:
        raise unreadable(Text("no rows under a column id or treatment (its columns: {names})", names=table.names))
    dated = {name: found for name in table.columns if (found := _DAY.match(name)) is not None}
    doses = [(found["what"].strip() or DOSE, _day(found["day"], 1, unreadable), name) for name, found in dated.items()]
    by_row = DATE in table.columns
    row_days = [_day(*row, unreadable) for row in zip(table.columns[DATE], table.lines, strict=True)] if by_row else []
    if (by_row or doses) and day is None:
        raise InputError("treatments-day", path=path)
    plain = [name for name in table.columns if name not in dated and name not in (column, DATE)]
    numbers = {name: table.numbers(name) for name in plain}
    for name in (*dated, *(plain if by_row else ())):
        numbers[name] = _summed(table, name, unreadable, is_dose=name in dated)
    rows: dict[str, dict[str, Attribute]] = {}
    for k, cell in enumerate(table.columns[column]):
        key = _label(cell)
        if not key:
            raise unreadable(Text("line {line} has no {column}", line=table.lines[k], column=column))
        if key in rows and not by_row:
            raise InputError("treatments-twice", path=path, lines=table.lines[k], column=column, key=key)
        row = rows.setdefault(key, {})
        texts = {name: text for name, cells in table.columns.items() if (text := cells[k].strip())}
        for name in plain:
            if name not in texts:
                continue
            if not np.isfinite(numbers[name][k]) or name in BLOCK_COLUMNS:
                row.setdefault(name, texts[name])
            elif by_row:
                _add_dose(row, name, row_days[k], float(numbers[name][k]), day)
            else:
                row[name] = float(numbers[name][k])
        for what, when, name in doses:
            _add_dose(row, what, when, float(numbers[name][k]) if name in texts else 0.0, day)
    return Treatments(path, TREATMENT if column == TREATMENT else "id", rows, table.notices)


def _summed(table: TextTable, name: str, unreadable: Callable[[Words], InputError], *, is_dose: bool) -> FloatArray:
    """Doses (n,) of a column to be summed up; nan throughout if it holds texts, unless it `is_dose`."""
    found = number_cells(table.columns[name], decimal_comma=table.decimal_comma)
    if not (is_dose or found.mostly):
        return np.full(len(table.lines), np.nan)
    wrong = [*found.faults, *found.codes, *([] if found.unclear is None else [found.unclear])]
    if wrong:
        text = table.columns[name][wrong[0]].strip()
        raise unreadable(
            Text("line {line} holds {text!r} under {name}", line=table.lines[wrong[0]], text=text, name=name)
        )
    return found.values


def _add_dose(row: dict[str, Attribute], what: str, when: dt.date, dose: float, day: dt.date | None) -> None:
    """A dose of a day in the sum up to another, and in the list of its single doses."""
    counted = dose if day is not None and when <= day else 0.0
    row[what] = float(row.get(what, 0.0)) + counted
    split = SPLIT.format(what)
    if counted:
        row[split] = ", ".join(filter(None, [str(row.get(split, "")), f"{when:%m-%d}: {dose:g}"]))
    else:
        row.setdefault(split, "")


def with_treatments(parcels: Sequence[Parcel], treatments: Treatments) -> tuple[tuple[Parcel, ...], list[Notice]]:
    """The parcels with their treatments' attributes, and those without; raises InputError if the table names others."""
    named = [
        next((value for name, value in parcel.attributes.items() if name.casefold() == TREATMENT), "")
        for parcel in parcels
    ]
    keys = [parcel.id for parcel in parcels] if treatments.by == "id" else [_label(str(name or "")) for name in named]
    unknown = [name for name in treatments.rows if name not in set(keys)]
    if unknown:
        what = "parcel" if treatments.by == "id" else TREATMENT
        raise InputError(
            "treatments-unknown",
            path=treatments.path,
            unknown=list_names(unknown, what),
            keys=", ".join(list(dict.fromkeys(keys))[:5]),
        )
    treated = []
    bare = []
    for parcel, key in zip(parcels, keys, strict=True):
        if key not in treatments.rows:
            treated.append(parcel)
            bare.append(parcel.id)
            continue
        rest = dict(treatments.rows[key])
        block = next((rest.pop(name) for name in list(rest) if name in BLOCK_COLUMNS), None)
        stated = parcel.block if parcel.block is not None or block is None else _label(str(block))
        treated.append(replace(parcel, block=stated, attributes={**parcel.attributes, **rest}))
    notice = Notice("treatments-missing", treatments=treatments.path.name, bare=list_names(bare, "parcel"))
    return tuple(treated), [*treatments.notices, *([notice] if bare else [])]


def day_of(text: str | None) -> dt.date | None:
    """The day of a flight as stated; None for none. Raises UsageError if it is no date."""
    try:
        return dt.date.fromisoformat(text) if text is not None else None
    except ValueError:
        raise OptionError("--day", text, Text("a day"), "2017-05-23") from None


@dataclass(frozen=True)
class MeasuredTable:
    """A quantity of n parcels, without their outlines, on a day, and its standard deviation; nan where unknown."""

    parcels: tuple[Parcel, ...]
    value: FloatArray
    sigma: FloatArray
    notices: tuple[Notice, ...] = ()


def read_measured(path: Path, measure: str, sites: Sequence[str] = ()) -> MeasuredTable:
    """Rows by parcel, such as the parcels.csv of a run: an identifier, the quantity, and more.

    Without a column of identifiers parcels have the numbers of their rows. Of several `sites` (columns, such as
    location and year) identifiers count within each; their labels are the attribute SITE. Cells that are no number, or
    a code of no data, are left out with a notice. Raises InputError if the file cannot be read, has no such column, no
    number in it, or an identifier twice.
    """

    def unreadable(why: Words) -> InputError:
        return InputError("parcel-table-unreadable", path=path, why=why)

    table = read_table(path, unreadable)
    if not table.lines:
        raise unreadable(Text("it has no rows below the names of its columns"))
    wanted = _stated(table, measure, is_measure=True)
    site_columns = [_stated(table, name, is_measure=False) for name in sites]
    column = table.find(IDS)
    labels = [" ".join(_label(table.columns[name][k]) for name in site_columns) for k in range(len(table.lines))]
    cells = table.columns[column] if column is not None else [str(k + 1) for k in range(len(table.lines))]
    names = [f"{label} {cell.strip()}".strip() for label, cell in zip(labels, cells, strict=True)]
    twice = next((name for k, name in enumerate(names) if name in set(names[:k]) or not cells[k].strip()), None)
    if twice is not None:
        raise InputError("parcel-table-unreadable.identifiers", path=path, twice=twice, column=column)
    block = table.find(BLOCK_COLUMNS)
    others = [name for name in table.columns if name not in (column, block, wanted)]
    numbers = {name: table.numbers(name) for name in others}
    parcels = []
    for k, name in enumerate(names):
        attributes: dict[str, Attribute] = {
            other: float(numbers[other][k]) if np.isfinite(numbers[other][k]) else table.columns[other][k].strip()
            for other in others
            if table.columns[other][k].strip()
        }
        if sites:
            attributes[SITE] = labels[k]
        label = table.columns[block][k].strip() if block is not None else ""
        parcels.append(Parcel(name, shapely.Polygon(), shapely.Polygon(), label or None, attributes))
    sigma = numbers.get(SIGMA_COLUMNS.get(wanted, ""), np.full(len(names), np.nan))
    value, left_out = checked_numbers(table.columns[wanted], wanted, names, decimal_comma=table.decimal_comma)
    if not np.isfinite(value).any():
        raise _column_error(table, measure, is_measure=True, is_there=True)
    return MeasuredTable(tuple(parcels), value, sigma, (*table.notices, *left_out))


def _stated(table: TextTable, name: str, *, is_measure: bool) -> str:
    """The column that is stated as the measure, or as a site."""
    column = stated_column(table.columns, name)
    if column is None:
        raise _column_error(table, name, is_measure=is_measure, is_there=False)
    return column


def _column_error(table: TextTable, name: str, *, is_measure: bool, is_there: bool) -> InputError:
    known = table.columns
    if is_measure:
        known = {
            each: cells
            for each, cells in known.items()
            if each not in (*IDS, *BLOCK_COLUMNS) and number_cells(cells, decimal_comma=table.decimal_comma).mostly
        }
    return InputError(
        "parcel-table-unreadable.column",
        path=table.path,
        column=name,
        is_there=is_there,
        is_measure=is_measure,
        names=", ".join(known)[:200] or None,
    )


def _day(text: str, line: int, unreadable: Callable[[Words], InputError]) -> dt.date:
    try:
        return dt.date.fromisoformat(text.strip()[:10])
    except ValueError:
        raise unreadable(
            Text("line {line}: {text!r} is no date such as 2017-03-16", line=line, text=text.strip()[:40])
        ) from None


def _label(text: str) -> str:
    """An identifier as those of parcels are written."""
    text = text.strip()
    return text[:-2] if text.endswith(".0") and text[:-2].isdigit() else text
