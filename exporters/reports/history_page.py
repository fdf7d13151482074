"""The history of a field as an HTML page: its map, its seasons and all sessions in it."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from importlib.metadata import version
from typing import Any, Final

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely.geometry.base import BaseGeometry

from furrowmap.exporters.reports.area_units import area, work_rate
from furrowmap.exporters.reports.page_parts import (
    days_words,
    duration_words,
    escape,
    figure,
    filled,
    key,
    key_figure,
    remark,
    section,
    table,
)
from furrowmap.exporters.reports.svg import Sheet

Row = Mapping[str, Any]

SHADES: Final = ("#f7fcb9", "#addd8e", "#41ab5d", "#006837", "#00331b")
"""Ground worked by one, two, three, four, and five or more sessions."""
MARGIN_M: Final = 2.0
MOST_ROWS: Final = 500
UNKNOWN: Final = "–"
_SEASON_HEAD: Final = (
    "season", "times worked", "days", "ground, each spot once", "worked", "worked twice", "missed", "hours",
    "work rate", "depth (approximate)", "soil moved",
)  # fmt: skip
_VISIT_HEAD: Final = (
    "day", "session", "machine", "worked", "worked twice", "missed", "hours", "work rate", "depth (approximate)",
    "soil moved",
)  # fmt: skip


def history_page(
    field: Row, outline: BaseGeometry, seasons: Sequence[Row], visits: Sequence[Row], grounds: NDArray[np.object_]
) -> str:
    """The page, in English; its areas have no unit yet.

    Args:
        field: its row in `fields`.
        outline: of the field.
        seasons: rows of `seasons`, the last one first.
        visits: rows of `visits`, the last one first.
        grounds: (n,) the ground that each of them worked.
    """
    last = seasons[0] if seasons else {}
    figures = [
        key_figure(_area(field["area_m2"]), "area of the field"),
        key_figure(str(field["sessions"]), "sessions"),
        key_figure(str(len(seasons)), "seasons"),
    ]
    if last:
        figures += [
            key_figure(str(last["times_worked"]), f"times worked in season {last['season']}"),
            key_figure(_hours(last["hours"]), f"hours in season {last['season']}"),
        ]
    sections = [section("Map", _map(outline, grounds))]
    if seasons:
        sections.append(section("Seasons", _scrolled(_SEASON_HEAD, [_season(row) for row in seasons], texts=(2,))))
    if visits:
        shown = _scrolled(_VISIT_HEAD, [_visit(row) for row in visits[:MOST_ROWS]], texts=(1, 2))
        more = len(visits) - MOST_ROWS
        note = f"{more} earlier sessions are in the table (CSV)." if more > 0 else ""
        sections.append(section("Sessions", shown + (remark(note) if note else "")))
    sections.append(
        section(
            "How to read this page",
            remark(
                "Areas are sums over sessions; ground counts each spot once. Hours run from the first pass to the end "
                "of the last, turns and stops included. Depth is approximate: the mean over the passes whose depth was "
                "measured, which rests on the session's working depth; soil moved is the volume of the change of the "
                "surface."
            ),
        )
    )
    name = escape(str(field["name"]))
    days = days_words(field["first_date"], field["last_date"]) if field["first_date"] else "not worked yet"
    return filled(
        title=name,
        when=escape(days),
        summary=escape("History of the field, from all sessions in the farm map."),
        figures=figures,
        sections=sections,
        provenance=escape(f"furrowmap {version('furrowmap')}"),
    )


def _map(outline: BaseGeometry, grounds: NDArray[np.object_]) -> str:
    west, south, east, north = shapely.total_bounds([outline, *grounds]).tolist()
    sheet = Sheet.of((west - MARGIN_M, south - MARGIN_M, east + MARGIN_M, north + MARGIN_M))
    parts = [
        sheet.area(ground, "pass", f'fill="{SHADES[level]}" stroke="none"')
        for level, ground in enumerate(_layers(grounds))
        if not ground.is_empty
    ]
    parts.append(sheet.area(outline, "boundary"))
    names = ("worked once", "by two sessions", "by three sessions", "by four sessions", "by five sessions or more")
    drawn = f'<div class="maps">{sheet.svg(parts, "Map of the field by number of sessions")}</div>'
    return figure(drawn, "Ground by the number of sessions that worked it.") + key(zip(SHADES, names, strict=True))


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


def _season(row: Row) -> list[str]:
    return [
        str(row["season"]),
        str(row["times_worked"]),
        days_words(row["first_date"], row["last_date"]),
        _area(row["ground_m2"]),
        *_figures(row),
    ]


def _visit(row: Row) -> list[str]:
    return [row["date"], row["name"], row["machine"], *_figures(row)]


def _figures(row: Row) -> list[str]:
    return [
        _area(row["worked_area_m2"]),
        _area(row["overlap_area_m2"]),
        _area(row["missed_area_m2"]),
        _hours(row["hours"]),
        UNKNOWN if row["work_rate_ha_h"] is None else work_rate(row["work_rate_ha_h"]),
        _known(None if row["depth_m"] is None else 100.0 * row["depth_m"], "{:.1f} cm"),
        _known(row["soil_moved_m3"], "{:,.1f} m³"),
    ]


def _scrolled(head: Sequence[str], rows: Sequence[Sequence[str]], texts: Collection[int]) -> str:
    return f'<div class="scroll">{table(head, rows, texts)}</div>'


def _area(area_m2: float | None) -> str:
    return UNKNOWN if area_m2 is None else area(area_m2)


def _hours(hours: float | None) -> str:
    return UNKNOWN if hours is None else duration_words(3600.0 * hours)


def _known(value: float | None, form: str) -> str:
    return form.format(value) if value is not None else UNKNOWN
