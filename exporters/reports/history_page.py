"""The history of a field as an HTML page: its map, its seasons and all sessions in it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Final

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely.geometry.base import BaseGeometry

from furrowmap.exporters.reports.drawings import MAP_MARGIN_M, padded_bounds
from furrowmap.exporters.reports.pages import days_words, render
from furrowmap.exporters.reports.svg import Sheet

SHADES: Final = ("#f7fcb9", "#addd8e", "#41ab5d", "#006837", "#00331b")
"""Ground worked by one, two, three, four, and five or more sessions."""
MAX_VISITS: Final = 500
"""Sessions that the page lists; the table has all."""


def history_page(
    field: Mapping[str, Any],
    outline: BaseGeometry,
    seasons: Sequence[Mapping[str, Any]],
    visits: Sequence[Mapping[str, Any]],
    grounds: NDArray[np.object_],
) -> str:
    """The page, in English; its areas have no unit yet.

    Args:
        seasons: rows of `seasons`, the last one first.
        visits: rows of `visits`, the last one first.
        grounds: (n,) the ground that each of them worked.
    """
    sheet = Sheet(padded_bounds([outline, *grounds], MAP_MARGIN_M))
    parts = [
        sheet.area(ground, "pass", fill=SHADES[level], stroke="none")
        for level, ground in enumerate(_layers(grounds))
        if not ground.is_empty
    ]
    parts.append(sheet.area(outline, "boundary"))
    return render(
        "history.html",
        title=str(field["name"]),
        when=days_words(field["first_date"], field["last_date"]) if field["first_date"] else "not worked yet",
        field=field,
        seasons=seasons,
        visits=visits,
        shades=SHADES,
        map=sheet.svg(parts, "Map of the field by number of sessions"),
        max_rows=MAX_VISITS,
    )


def _layers(grounds: NDArray[np.object_]) -> list[BaseGeometry]:
    """Ground that at least one, two, … sessions worked."""
    levels: list[BaseGeometry] = [shapely.Polygon()] * len(SHADES)
    for ground in grounds:
        rest = shapely.make_valid(ground)
        for k, level in enumerate(levels):
            again = shapely.intersection(level, rest)
            levels[k] = shapely.union(level, rest)
            rest = again
            if rest.is_empty:
                break
    return levels
