"""HTML pages of many sessions: a batch, the history of a field, the ties of its dates."""

import datetime as dt
from collections.abc import Mapping, Sequence
from typing import Any, Final

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely.geometry.base import BaseGeometry

from furrowmap.core.runtime.languages.texts import LANGUAGES, Text
from furrowmap.exporters.files.batch_state import Failure
from furrowmap.exporters.files.result_folder import REPORT_PAGE
from furrowmap.exporters.reports.drawings import MAP_MARGIN_M, padded_bounds
from furrowmap.exporters.reports.html_pages import render
from furrowmap.exporters.reports.page_language import said
from furrowmap.exporters.reports.quantity_words import days_words
from furrowmap.exporters.reports.svg import Sheet
from furrowmap.exporters.vectors.batch_table import BATCH_LAYERS, BATCH_TABLE, Row

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
    """The page of seasons and visits, the last one first, with their ground; without a language and a unit of areas."""
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
        when=days_words(field["first_date"], field["last_date"]) if field["first_date"] else Text("not worked yet"),
        field=field,
        seasons=seasons,
        visits=visits,
        shades=SHADES,
        map=sheet.svg(parts, Text("Map of the field by number of sessions")),
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


def tie_page(account: Mapping[str, Any]) -> str:
    """The page of `tie.json`: dates and their moves, ties, soil moved; without a language and a unit of areas."""
    medians = [change["untouched_median_m"] for change in account["changes"]]
    return render(
        "tie.html",
        **account,
        title=Text("Dates of one field"),
        when=days_words(*(account["dates"][k]["start_local"][:10] for k in (0, -1))),
        medians=[abs(median) for median in medians if median is not None],
    )


BATCH_PAGE: Final = "batch.html"
MAX_SESSIONS: Final = 2000
"""Sessions that the page lists; the table has all."""


def batch_page(rows: Sequence[Row]) -> str:
    """The page of a batch: what was done, what failed and why, a link to the report of each session.

    Without a language and a unit of areas.
    """
    done = [row for row in rows if row.outcome.failure is None]
    days = sorted(_start(row)[:10] for row in done if "start" in row.outcome.figures)
    return render(
        "batch.html",
        title=Text("Batch of sessions"),
        when=days_words(days[0], days[-1]) if days else "",
        done=done,
        failed=[row for row in rows if row.outcome.failure is not None],
        damaged=[row for row in done if row.damaged],
        sums={
            name: sum(float(row.outcome.figures.get(name) or 0.0) for row in done)
            for name in ("worked_area_m2", "duration_s", "points")
        },
        start=_start,
        error_lines=_error_lines,
        notice_text=_notice_text,
        page=REPORT_PAGE,
        table=BATCH_TABLE,
        layers=BATCH_LAYERS,
        max_rows=MAX_SESSIONS,
    )


def _error_lines(failure: Failure) -> list[str]:
    """What is wrong, what that means, and what to do."""
    by_language = {language: failure.lines_in(language) for language in LANGUAGES}
    return [said({language: lines[k] for language, lines in by_language.items()}) for k in range(len(failure.lines))]


def _notice_text(notice: Mapping[str, Any]) -> str:
    """A warning of a report."""
    return said({language: str(notice.get(f"text_{language}", notice["text"])) for language in LANGUAGES})


def _start(row: Row) -> str:
    """Local time at the field with its zone; UTC for a result that states no zone."""
    figures = row.outcome.figures
    zone = figures.get("time_zone")
    text = str(figures.get("start_local" if zone else "start", ""))
    return f"{dt.datetime.fromisoformat(text):%Y-%m-%d %H:%M} ({zone or 'UTC'})" if text else ""
