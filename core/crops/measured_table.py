"""Figures of parcels from a table, such as the parcels.csv of a run."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
import shapely
from numpy.typing import NDArray

from furrowmap.core.crops.parcels import BLOCKS
from furrowmap.core.readers.areas.corner_table import IDS
from furrowmap.core.readers.sheet import read_sheet
from furrowmap.core.readers.survey_table import SurveyTable
from furrowmap.core.runtime.errors import InputError
from furrowmap.core.values.parcel import Parcel

FloatArray = NDArray[np.float64]

MEASURE: Final = "mean_height_m"
_SIGMAS: Final = {
    MEASURE: "height_sigma_m",
    "volume_m3": "volume_sigma_m3",
    "rate_m_day": "rate_sigma_m_day",
    "growth_m": "growth_sigma_m",
}
"""Column with the standard deviation of a quantity."""
_NOWHERE: Final = shapely.Polygon()


@dataclass(frozen=True)
class MeasuredTable:
    """A quantity of n parcels on a day.

    Attributes:
        parcels: (n,) their identifiers, blocks and attributes; their outlines are not known.
        value: (n,) of the quantity; nan where it is not known.
        sigma: (n,) its standard deviation; nan where it is not known.
    """

    parcels: tuple[Parcel, ...]
    value: FloatArray
    sigma: FloatArray


def read_measured(path: Path, measure: str) -> MeasuredTable:
    """A table with a row for each parcel: an identifier, the quantity, and what else is known.

    Args:
        path: CSV or spreadsheet.
        measure: name of the column with the quantity.

    Raises:
        InputError: if the file cannot be read, has no such column, or an identifier twice.
    """
    try:
        table = read_sheet(path)
    except (ValueError, OSError) as error:
        raise _unreadable(path, str(error.strerror if isinstance(error, OSError) else error)) from None
    column = next((name for name in IDS if name in table.columns), None)
    wanted = measure.casefold()
    if column is None or wanted not in table.columns or not table.lines:
        raise _unreadable(path, f"no rows with the columns id and {measure} (its columns: {_names(table)})")
    names = [cell.strip() for cell in table.columns[column]]
    twice = next((name for k, name in enumerate(names) if name in names[:k] or not name), None)
    if twice is not None:
        raise _unreadable(path, f"parcel {twice!r} is there twice, or a parcel has no identifier")
    block = next((name for name in BLOCKS if name in table.columns), None)
    others = [name for name in table.columns if name not in (column, block, wanted)]
    numbers = {name: table.numbers(name) for name in others if table.first_fault(name) is None}
    parcels = []
    for k, name in enumerate(names):
        attributes = {
            other: float(numbers[other][k]) if other in numbers else table.columns[other][k].strip()
            for other in others
            if table.columns[other][k].strip()
        }
        label = table.columns[block][k].strip() if block is not None else ""
        parcels.append(Parcel(name, _NOWHERE, _NOWHERE, label or None, attributes))
    sigma = numbers.get(_SIGMAS.get(wanted, ""), np.full(len(names), np.nan))
    return MeasuredTable(tuple(parcels), table.numbers(wanted), sigma)


def _names(table: SurveyTable) -> str:
    return ", ".join(table.columns)[:200]


def _unreadable(path: Path, why: str) -> InputError:
    return InputError("parcel-table-unreadable", path=path, why=why)
