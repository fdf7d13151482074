"""The page of a batch: what was done, what failed and why, and a link to the report of each session."""

from __future__ import annotations

import datetime as dt
from collections.abc import Sequence
from pathlib import Path
from typing import Final

from furrowmap.core.runtime.settings import language_of_user
from furrowmap.exporters.files.atomic import atomic_output
from furrowmap.exporters.files.result_folder import REPORT_PAGE
from furrowmap.exporters.reports.area_units import HECTARE, in_area_unit
from furrowmap.exporters.reports.page_language import in_language
from furrowmap.exporters.reports.pages import days_words, render
from furrowmap.exporters.vectors.batch_table import BATCH_LAYERS, BATCH_TABLE, Row

BATCH_PAGE: Final = "batch.html"
MAX_SESSIONS: Final = 2000
"""Sessions that the page lists; the table has all."""


def write_batch_page(folder: Path, rows: Sequence[Row]) -> None:
    """Write :data:`BATCH_PAGE` in the user's language."""
    text = in_language(in_area_unit(page(rows), HECTARE), language_of_user())
    with atomic_output(folder / BATCH_PAGE) as unfinished:
        unfinished.write_text(text, encoding="utf-8", errors="xmlcharrefreplace")


def page(rows: Sequence[Row]) -> str:
    """The page in English, as HTML; its areas have no unit yet."""
    done = [row for row in rows if row.outcome.failure is None]
    days = sorted(_start(row)[:10] for row in done if "start" in row.outcome.figures)
    return render(
        "batch.html",
        title="Batch of sessions",
        when=days_words(days[0], days[-1]) if days else "",
        done=done,
        failed=[row for row in rows if row.outcome.failure is not None],
        sums={
            name: sum(float(row.outcome.figures.get(name) or 0.0) for row in done)
            for name in ("worked_area_m2", "duration_s", "points")
        },
        start=_start,
        page=REPORT_PAGE,
        table=BATCH_TABLE,
        layers=BATCH_LAYERS,
        max_rows=MAX_SESSIONS,
    )


def _start(row: Row) -> str:
    """Local time at the field with its zone; UTC for a result that states no zone."""
    figures = row.outcome.figures
    zone = figures.get("time_zone")
    text = str(figures.get("start_local" if zone else "start", ""))
    return f"{dt.datetime.fromisoformat(text):%Y-%m-%d %H:%M} ({zone or 'UTC'})" if text else ""
