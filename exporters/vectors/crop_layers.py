"""Parcels and stands: layers of heights, growth and canopy, their tables, and the gross parcels as a file."""

import datetime as dt
import io
from collections.abc import Sequence
from dataclasses import fields
from pathlib import Path
from typing import Any, Final

import numpy as np
import shapely
from pyproj import CRS, Transformer

from furrowmap.core.crops.growth_between import GrownParcel, Growth
from furrowmap.core.crops.measure import MeasuredParcel, ParcelFigures
from furrowmap.core.crops.stand import PERCENTILES, Stand
from furrowmap.core.readers.vector_file import VectorLayer
from furrowmap.core.runtime.errors import UsageError
from furrowmap.core.values.parcel import Parcel
from furrowmap.exporters.files.atomic import atomic_output
from furrowmap.exporters.files.csv_cells import write_csv, write_csv_table
from furrowmap.exporters.files.whole_layers import write_vector_layer
from furrowmap.exporters.files.workbooks import write_workbook
from furrowmap.exporters.vectors.field_layers import Columns, Layer, geometry_array, texts

PARCELS_LAYER: Final = "parcels"
GROWTH_LAYER: Final = "growth"
CANOPY_LAYER: Final = "canopy"
_TABLE_DIGITS: Final = {"m": 4, "m2": 2, "m3": 4, "cv": 4, "day": 6}
"""Decimals in a table by the unit at the end of a column's name."""


def parcel_layer(found: Sequence[MeasuredParcel]) -> Layer:
    """A feature per parcel: its net polygon, its figures, and what else is known of it."""
    columns = {name: np.array([getattr(row.figures, name) for row in found]) for name in _names(ParcelFigures)[1:]}
    if any(np.isfinite(row.published_height_m) for row in found):
        columns["published_height_m"] = np.array([row.published_height_m for row in found])
        columns["published_volume_m3"] = np.array([row.published_volume_m3 for row in found])
    return _layer_of_parcels(
        PARCELS_LAYER, "Net parcels: height and volume of the crop", [row.parcel for row in found], columns
    )


def growth_layer(found: Sequence[GrownParcel], days: Sequence[dt.date]) -> Layer:
    """A feature per parcel: its net polygon, what it grew, its heights by day, and what else is known of it."""
    columns = _growth_columns([row.growth for row in found])
    columns["days"] = np.array([row.growth.days if row.growth is not None else 0 for row in found], np.int32)
    for k, day in enumerate(days):
        columns[f"mean_height_m_{day}"] = np.array([row.height_m[k] for row in found])
        columns[f"height_sigma_m_{day}"] = np.array([row.height_sigma_m[k] for row in found])
    for k in range(len(days) - 1 if len(days) > 2 else 0):
        step = _growth_columns([row.steps[k] for row in found])
        columns |= {f"{name}_{days[k]}_{days[k + 1]}": values for name, values in step.items()}
    text = f"Net parcels: growth of the crop from {days[0]} to {days[-1]}"
    return _layer_of_parcels(GROWTH_LAYER, text, [row.parcel for row in found], columns)


def _growth_columns(found: Sequence[Growth | None]) -> Columns:
    """What each grew, and by day; nan where it is not known."""
    known = [each or Growth("", 0, np.nan, np.nan, 0) for each in found]
    return {
        "growth_m": np.array([each.rate_m_day * each.span_days for each in known]),
        "growth_sigma_m": np.array([each.sigma_m_day * each.span_days for each in known]),
        "rate_m_day": np.array([each.rate_m_day for each in known]),
        "rate_sigma_m_day": np.array([each.sigma_m_day for each in known]),
    }


def canopy_layer(stands: Sequence[Stand], shapes: Sequence[shapely.Geometry], areas: Sequence[Parcel]) -> Layer:
    """A feature per area; those of the user's file (none for cells) give what else is known of them."""
    columns: Columns = {"id": texts([stand.id for stand in stands])}
    for name in _names(Stand):
        if name not in ("id", "percentiles_m", "profile"):
            columns[name] = np.array([getattr(stand, name) for stand in stands])
    for k, percent in enumerate(PERCENTILES):
        columns[f"p{percent:02}_m"] = np.array([stand.percentiles_m[k] for stand in stands])
    columns |= _attribute_columns(areas, columns)
    return Layer(CANOPY_LAYER, "Polygon", "Heights and gaps of the canopy", geometry_array(shapes), columns)


def _names(kind: type) -> list[str]:
    return [field.name for field in fields(kind)]


def _layer_of_parcels(name: str, text: str, parcels: Sequence[Parcel], columns: Columns) -> Layer:
    """A layer of net polygons: id, block where one has it, columns, and attributes of the user's file."""
    own: Columns = {"id": texts(parcel.id for parcel in parcels)}
    if any(parcel.block is not None for parcel in parcels):
        own["block"] = texts(parcel.block for parcel in parcels)
    own |= columns
    own |= _attribute_columns(parcels, own)
    return Layer(name, "Polygon", text, geometry_array([parcel.net for parcel in parcels]), own)


def _attribute_columns(parcels: Sequence[Parcel], columns: Columns) -> Columns:
    """Attributes of parcels as columns of other names: numbers (nan for none) where all values are, else texts."""
    taken = {known.casefold() for known in (*columns, "fid", "geom")}
    own: Columns = {}
    for name in dict.fromkeys(name for parcel in parcels for name in parcel.attributes):
        if name.casefold() not in taken:
            values = [parcel.attributes.get(name) for parcel in parcels]
            if all(value is None or isinstance(value, int | float) for value in values):
                own[name] = np.array([np.nan if value is None else float(value) for value in values])
            else:
                own[name] = texts(None if value is None else str(value) for value in values)
    return own


def write_parcel_table(path: Path, layer: Layer) -> None:
    """Write the columns of a layer of parcels as CSV; what is not known is empty."""
    write_csv_table(path, list(layer.columns), (_cells(layer, row) for row in range(len(layer.shapes))))


def write_parcel_sheet(path: Path, layer: Layer) -> None:
    """Write the columns of a layer of parcels as a spreadsheet (xlsx), numbers as numbers, if openpyxl is installed."""
    write_workbook(path, {PARCELS_LAYER: [_cells(layer, row) for row in range(len(layer.shapes))]})


def write_profiles(path: Path, stands: Sequence[Stand], layer_m: float) -> None:
    """Write the share of returns by layer as CSV: a row per layer of each stand."""
    rows = [
        (stand.id, f"{k * layer_m:.10g}", f"{(k + 1) * layer_m:.10g}", f"{share:.6f}")
        for stand in stands
        for k, share in enumerate(stand.profile)
    ]
    write_csv(path, ("id", "from_m", "to_m", "share"), rows)


def _cells(layer: Layer, row: int) -> dict[str, object]:
    """The values of a row for a table, by column."""
    cells: dict[str, object] = {}
    for name, values in layer.columns.items():
        value: Any = values[row]
        if isinstance(value, np.bool_):
            cells[name] = "yes" if value else "no"
        elif isinstance(value, np.floating):
            cells[name] = round(float(value), _TABLE_DIGITS.get(name.rpartition("_")[2], 4))
        else:
            cells[name] = value.item() if isinstance(value, np.generic) else value
    return cells


_PLOT_SUFFIXES: Final = (".gpkg", ".geojson")
_PLOTS: Final = "plots"
_CORNER_DIGITS: Final = 10
"""A hundredth of a millimetre: net parcels are computed from these corners."""


def expect_suffix(path: Path) -> None:
    """Raises UsageError if a file's name states neither GeoPackage nor GeoJSON."""
    if path.suffix.lower() not in _PLOT_SUFFIXES:
        example = path.with_suffix(_PLOT_SUFFIXES[0]).name
        raise UsageError("usage.suffix", path=path, suffixes=_PLOT_SUFFIXES, example=example)


def write_parcels(path: Path, parcels: Sequence[Parcel], crs: CRS) -> None:
    """Write the gross parcels with id, block and attributes; GeoJSON in degrees of the CRS's own datum."""
    expect_suffix(path)
    columns: Columns = {"id": texts(each.id for each in parcels), "block": texts(each.block for each in parcels)}
    columns |= _attribute_columns(parcels, columns)
    columns |= {name: columns[name].astype(np.int64) for name in ("row", "column") if name in columns}
    shapes = geometry_array([each.gross for each in parcels])
    with atomic_output(path) as unfinished:
        if path.suffix.lower() == ".gpkg":
            write_vector_layer(unfinished, VectorLayer(shapes, columns, crs), _PLOTS, "GPKG")
            return
        change = Transformer.from_crs(crs, (crs.geodetic_crs or crs).to_2d(), always_xy=True)
        degrees = shapely.transform(shapes, lambda xy: np.column_stack(change.transform(*xy.T)))
        content = io.BytesIO()
        layer = VectorLayer(degrees, columns, CRS("EPSG:4326"))
        write_vector_layer(content, layer, _PLOTS, "GeoJSON", COORDINATE_PRECISION=_CORNER_DIGITS)
        unfinished.write_bytes(content.getbuffer())
