"""The section of a report page on crops: a map of the parcels by height, and the table of their figures."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import Final

import numpy as np
import shapely

from furrowmap.core.crops.measure import MeasuredParcel
from furrowmap.core.crops.response import dose_name, dose_unit, fit_response, parcel_doses
from furrowmap.exporters.reports.page_parts import figure, key, remark, section, table
from furrowmap.exporters.reports.svg import Sheet
from furrowmap.exporters.reports.trial_charts import Points, response_chart

COLOURS: Final = np.array([[247, 252, 185], [120, 198, 121], [0, 69, 41]])
"""From the shortest parcel over the middle to the tallest, as in the layer's style."""
UNKNOWN: Final = "#d9d9d9"
MOST_ROWS: Final = 200
MOST_NAMES: Final = 150
"""Parcels with their names on the map."""
MARGIN_M: Final = 1.0


def parcel_sections(found: Sequence[MeasuredParcel]) -> Iterator[str]:
    """The section; nothing without parcels."""
    if found:
        yield section("Crops by parcel", _map(found) + _table(found))
        yield from _response(found)


def _response(found: Sequence[MeasuredParcel]) -> Iterator[str]:
    """What the dose did, where the parcels have one."""
    parcels = [row.parcel for row in found]
    name = dose_name(parcels)
    if name is None:
        return
    dose, blocks = parcel_doses(parcels, name), [parcel.block or "" for parcel in parcels]
    heights = Points(np.array([row.figures.mean_height_m for row in found]), blocks, "mean height, m", "block")
    response = fit_response(dose, heights.value, blocks, dose_unit(name))
    yield section("Response to treatments", figure(response_chart(dose, heights, response, name), response.words))


def _map(found: Sequence[MeasuredParcel]) -> str:
    heights = np.array([row.figures.mean_height_m for row in found])
    west, south, east, north = shapely.total_bounds([row.parcel.gross for row in found]).tolist()
    sheet = Sheet.of((west - MARGIN_M, south - MARGIN_M, east + MARGIN_M, north + MARGIN_M))
    known = heights[np.isfinite(heights)]
    low, high = (float(known.min()), float(known.max())) if len(known) else (0.0, 1.0)
    parts = []
    for row, height in zip(found, heights.tolist(), strict=True):
        parts.append(sheet.area(row.parcel.gross, "boundary"))
        parts.append(sheet.area(row.parcel.net, "pass", f'fill="{_colour(height, low, high)}"'))
    if len(found) <= MOST_NAMES:
        parts += [sheet.text(row.parcel.net.representative_point(), row.parcel.id) for row in found]
    rows = [(_colour(value, low, high), f"{100.0 * value:.1f} cm") for value in np.linspace(low, high, 5).tolist()]
    return figure(sheet.svg(parts, "Map of the parcels by height"), "Mean height of the crop.") + key(rows)


def _colour(height_m: float, low_m: float, high_m: float) -> str:
    if not math.isfinite(height_m):
        return UNKNOWN
    at = 2.0 * (height_m - low_m) / (high_m - low_m) if high_m > low_m else 1.0
    return "#" + "".join(f"{round(float(np.interp(at, (0, 1, 2), channel))):02x}" for channel in COLOURS.T)


def _table(found: Sequence[MeasuredParcel]) -> str:
    published = any(math.isfinite(row.published_height_m) for row in found)
    head = ["parcel", "height", "± (1 sigma)", "95th percentile", "volume", "± (1 sigma)", "cover", "points/m²", "note"]
    rows = []
    for row in found[:MOST_ROWS]:
        f = row.figures
        note = "may be lodged" if f.lodging else ""
        cells = [
            row.parcel.id,
            _cm(f.mean_height_m),
            _cm(f.height_sigma_m),
            _cm(f.p95_m),
            _number(f.volume_m3, "{:.2f} m³"),
            _number(f.volume_sigma_m3, "{:.2f} m³"),
            _number(100.0 * f.cover, "{:.1f} %"),
            f"{f.points_m2:,.0f}",
            note,
        ]
        if published:
            cells[-1:-1] = [_cm(row.published_height_m), _number(row.published_volume_m3, "{:.2f} m³")]
        rows.append(cells)
    if published:
        head[-1:-1] = ["published method", "its volume"]
    text = (
        "Height of the canopy's top above the soil, mean over the net parcel, gaps included; volume is its sum. Every "
        "figure: layer parcels of field.gpkg, parcels.csv; pixels: crop_height.tif."
    )
    if len(found) > len(rows):
        text = f"{len(found) - len(rows)} more parcels are in parcels.csv. {text}"
    return f'<div class="scroll">{table(head, rows)}</div>{remark(text)}'


def _cm(value_m: float) -> str:
    return _number(100.0 * value_m, "{:.1f} cm")


def _number(value: float, form: str) -> str:
    return form.format(value) if math.isfinite(value) else "unknown"
