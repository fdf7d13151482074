"""The figures of parcels as a layer, and as a table for spreadsheets."""

from __future__ import annotations

import csv
from collections.abc import Sequence
from dataclasses import fields
from importlib.util import find_spec
from pathlib import Path
from typing import Any, Final

import numpy as np

from furrowmap.core.crops.measure import MeasuredParcel, ParcelFigures
from furrowmap.core.values.parcel import Parcel
from furrowmap.exporters.files.atomic import atomic_output
from furrowmap.exporters.files.csv_cells import cell
from furrowmap.exporters.files.workbook import write_workbook
from furrowmap.exporters.vectors.field_layers import Columns, Layer, geometry_array

LAYER: Final = "parcels"
_DIGITS: Final = {"m": 4, "m2": 2, "m3": 4, "cv": 4, "day": 6}
"""Decimals in the table by the unit at the end of a name."""


def parcel_layer(found: Sequence[MeasuredParcel]) -> Layer:
    """A feature per parcel: its net polygon, its figures, and what else is known of it."""
    columns: Columns = {"id": text_column([row.parcel.id for row in found])}
    if any(row.parcel.block is not None for row in found):
        columns["block"] = text_column([row.parcel.block for row in found])
    for field in fields(ParcelFigures)[1:]:
        columns[field.name] = np.array([getattr(row.figures, field.name) for row in found])
    if any(np.isfinite(row.published_height_m) for row in found):
        columns["published_height_m"] = np.array([row.published_height_m for row in found])
        columns["published_volume_m3"] = np.array([row.published_volume_m3 for row in found])
    columns |= attribute_columns([row.parcel for row in found], columns)
    shapes = geometry_array([row.parcel.net for row in found])
    return Layer(LAYER, "Polygon", "Net parcels: height and volume of the crop", shapes, columns)


def attribute_columns(parcels: Sequence[Parcel], columns: Columns) -> Columns:
    """What else is known of parcels; not what has the name of one of the columns."""
    taken = {known.casefold() for known in (*columns, "fid", "geom")}
    names = dict.fromkeys(name for parcel in parcels for name in parcel.attributes)
    return {
        name: _values([parcel.attributes.get(name) for parcel in parcels])
        for name in names
        if name.casefold() not in taken
    }


def write_parcel_table(path: Path, layer: Layer) -> None:
    """Write the columns of a layer of parcels as CSV; what is not known is empty.

    Raises:
        OSError: if the file cannot be written.
    """
    with atomic_output(path) as unfinished, unfinished.open("w", encoding="utf-8", newline="") as file:
        table = csv.writer(file, lineterminator="\n")
        table.writerow([cell(name) for name in layer.columns])
        for row in range(len(layer.shapes)):
            table.writerow([_written(name, values[row]) for name, values in layer.columns.items()])


def write_parcel_sheet(path: Path, layer: Layer) -> None:
    """Write the columns of a layer of parcels as a spreadsheet (xlsx), numbers as numbers, if openpyxl is installed.

    Raises:
        OSError: if the file cannot be written.
    """
    if find_spec("openpyxl") is None:
        return
    rows = [
        {name: _written(name, values[row]) for name, values in layer.columns.items()}
        for row in range(len(layer.shapes))
    ]
    write_workbook(path, {LAYER: [{name: None if v == "" else v for name, v in row.items()} for row in rows]})


def _written(name: str, value: Any) -> object:
    """A value for a cell."""
    if value is None or (isinstance(value, float) and not np.isfinite(value)):
        return ""
    if isinstance(value, np.bool_):
        return "yes" if value else "no"
    if isinstance(value, np.floating):
        return round(float(value), _DIGITS.get(name.rpartition("_")[2], 4))
    return cell(value.item() if isinstance(value, np.generic) else value)


def text_column(values: Sequence[str | None]) -> Any:
    """Texts (n,) as a column; None where there is none."""
    return np.array(values, dtype=object)


def _values(values: Sequence[str | float | None]) -> Any:
    """Numbers where all are, with nan where there is none; else texts."""
    if all(value is None or isinstance(value, int | float) for value in values):
        return np.array([np.nan if value is None else float(value) for value in values])
    return text_column([None if value is None else str(value) for value in values])
