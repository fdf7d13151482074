"""The growth of parcels as a layer and a table."""

from __future__ import annotations

import datetime as dt
from collections.abc import Sequence
from typing import Final

import numpy as np

from furrowmap.core.crops.growth import GrownParcel, Growth
from furrowmap.exporters.vectors.field_layers import Columns, Layer, geometry_array
from furrowmap.exporters.vectors.parcel_table import attribute_columns, text_column

LAYER: Final = "growth"


def growth_layer(found: Sequence[GrownParcel], days: Sequence[dt.date]) -> Layer:
    """A feature per parcel: its net polygon, what it grew, its heights by day, and what else is known of it."""
    columns: Columns = {"id": text_column([row.parcel.id for row in found])}
    if any(row.parcel.block is not None for row in found):
        columns["block"] = text_column([row.parcel.block for row in found])
    columns |= _columns([row.growth for row in found])
    columns["days"] = np.array([row.growth.days if row.growth is not None else 0 for row in found], np.int32)
    for k, day in enumerate(days):
        columns[f"mean_height_m_{day}"] = np.array([row.height_m[k] for row in found])
        columns[f"height_sigma_m_{day}"] = np.array([row.height_sigma_m[k] for row in found])
    for k in range(len(days) - 1 if len(days) > 2 else 0):
        step = _columns([row.steps[k] for row in found])
        columns |= {f"{name}_{days[k]}_{days[k + 1]}": values for name, values in step.items()}
    columns |= attribute_columns([row.parcel for row in found], columns)
    shapes = geometry_array([row.parcel.net for row in found])
    words = f"Net parcels: growth of the crop from {days[0]} to {days[-1]}"
    return Layer(LAYER, "Polygon", words, shapes, columns)


def _columns(found: Sequence[Growth | None]) -> Columns:
    """What each grew, and by day; nan where it is not known."""
    known = [each or Growth("", 0, np.nan, np.nan, 0) for each in found]
    return {
        "growth_m": np.array([each.rate_m_day * each.span_days for each in known]),
        "growth_sigma_m": np.array([each.sigma_m_day * each.span_days for each in known]),
        "rate_m_day": np.array([each.rate_m_day for each in known]),
        "rate_sigma_m_day": np.array([each.sigma_m_day for each in known]),
    }
