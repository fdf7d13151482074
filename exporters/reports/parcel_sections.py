"""The sections of a run's page on its parcels: heights, and the response to a dose."""

import math
from collections.abc import Sequence
from typing import Final

import numpy as np

from furrowmap.core.crops.dose_columns import column_words, dose_name, parcel_doses
from furrowmap.core.crops.measure import MeasuredParcel
from furrowmap.core.crops.response_values import Response
from furrowmap.core.runtime.languages.texts import Text, figure_text
from furrowmap.exporters.reports.drawings import padded_bounds
from furrowmap.exporters.reports.html_pages import render
from furrowmap.exporters.reports.svg import Sheet, mixed_colour
from furrowmap.exporters.reports.trial_charts import ParcelValues, response_chart

HEIGHT_COLOURS: Final = np.array([[247, 252, 185], [120, 198, 121], [0, 69, 41]])
"""From the shortest parcel over the middle to the tallest, as in the layer's style."""
UNKNOWN_COLOUR: Final = "#d9d9d9"
MAX_TABLE_PARCELS: Final = 200
"""Maximum length of the table."""
MAX_NAMED_PARCELS: Final = 150
"""Parcels with their names on the map."""
PARCEL_MARGIN_M: Final = 1.0


def parcel_sections(found: Sequence[MeasuredParcel], response: Response | None = None) -> str:
    """The sections as HTML: height and, where there is one, the response to a dose; nothing without parcels."""
    if not found:
        return ""
    heights_m = np.array([row.figures.mean_height_m for row in found])
    known = heights_m[np.isfinite(heights_m)]
    low, high = (float(known.min()), float(known.max())) if len(known) else (0.0, 1.0)

    def colour(height_m: float) -> str:
        if not math.isfinite(height_m):
            return UNKNOWN_COLOUR
        return mixed_colour((height_m - low) / (high - low) if high > low else 0.5, HEIGHT_COLOURS)

    sheet = Sheet(padded_bounds([row.parcel.gross for row in found], PARCEL_MARGIN_M))
    parts = []
    for row, height_m in zip(found, heights_m.tolist(), strict=True):
        parts.append(sheet.area(row.parcel.gross, "boundary"))
        parts.append(sheet.area(row.parcel.net, "pass", fill=colour(height_m)))
    if len(found) <= MAX_NAMED_PARCELS:
        parts += [sheet.text(row.parcel.net.representative_point(), row.parcel.id) for row in found]
    parcels = [row.parcel for row in found]
    chart = None
    if response is not None and (name := dose_name(parcels)) is not None:
        blocks = [parcel.block or "" for parcel in parcels]
        values = ParcelValues(heights_m, blocks, column_words("mean_height_m"), Text("block"))
        chart = response_chart(parcel_doses(parcels, name), values, response, column_words(name))
    return render(
        "parcels.html",
        parcels=found,
        max_parcels=MAX_TABLE_PARCELS,
        published=any(math.isfinite(row.published_height_m) for row in found),
        map=sheet.svg(parts, Text("Map of the parcels by height")),
        colours=[
            (colour(value), figure_text(f"{100.0 * value:.1f} cm")) for value in np.linspace(low, high, 5).tolist()
        ],
        response=response,
        chart=chart,
    )
