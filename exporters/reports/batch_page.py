"""The page of a batch: what was done, what failed and why, and a link to the report of each session."""

from __future__ import annotations

import datetime as dt
from collections.abc import Mapping, Sequence
from importlib.metadata import version
from pathlib import Path
from typing import Any, Final
from urllib.parse import quote

from furrowmap.core.runtime.languages.choice import language_of_user
from furrowmap.exporters.files.atomic import atomic_output
from furrowmap.exporters.files.result_folder import PAGE
from furrowmap.exporters.reports.area_units import HECTARE, area, filled_in
from furrowmap.exporters.reports.page_language import in_language
from furrowmap.exporters.reports.page_parts import (
    days_words,
    duration_words,
    escape,
    filled,
    key_figure,
    remark,
    section,
    table,
    table_of_cells,
)
from furrowmap.exporters.vectors.batch_table import LAYERS, TABLE, Row

BATCH_PAGE: Final = "batch.html"
MOST_ROWS: Final = 2000
"""Sessions that the page lists; the table has all."""


def write_batch_page(folder: Path, rows: Sequence[Row]) -> None:
    """Write :data:`BATCH_PAGE` in the user's language.

    Raises:
        OSError: if it cannot be written.
    """
    text = in_language(filled_in(page(rows), HECTARE), language_of_user())
    with atomic_output(folder / BATCH_PAGE) as unfinished:
        unfinished.write_text(text, encoding="utf-8", errors="xmlcharrefreplace")


def page(rows: Sequence[Row]) -> str:
    """The page in English, as HTML; its areas have no unit yet."""
    failed = [row for row in rows if row.outcome.failure is not None]
    done = [row for row in rows if row.outcome.failure is None]
    days = sorted(_start(row.outcome.figures)[:10] for row in done if "start" in row.outcome.figures)
    figures = [
        key_figure(f"{len(done):,}", "sessions with a result"),
        key_figure(f"{len(failed):,}", "sessions that failed", loud=bool(failed)),
        key_figure(area(_sum(done, "worked_area_m2")), "ground worked, sum of the sessions"),
        key_figure(duration_words(_sum(done, "duration_s")), "recorded"),
        key_figure(f"{_sum(done, 'points') / 1e6:,.1f} million", "points in the clouds"),
        key_figure(duration_words(sum(row.outcome.seconds for row in done)), "of processing"),
    ]
    sections = [*([section("Failed", _failures(failed))] if failed else []), section("Sessions", _sessions(done))]
    return filled(
        title="Batch of sessions",
        when=escape(days_words(days[0], days[-1])) if days else "",
        summary=escape(f"{len(rows):,} sessions."),
        figures=figures,
        sections=sections,
        provenance=escape(f"furrowmap {version('furrowmap')}. Tables: {TABLE}, {LAYERS}."),
    )


def _failures(rows: Sequence[Row]) -> str:
    lines = []
    for row in rows[:MOST_ROWS]:
        assert row.outcome.failure is not None
        lines.append((row.name, *row.outcome.failure.lines, row.outcome.failure.code))
    shown = table(("session", "what", "consequence", "remedy", "code"), lines, texts=range(5))
    return f'<div class="scroll">{shown}</div>{_more(rows)}'


def _sessions(rows: Sequence[Row]) -> str:
    by_field = any(row.field for row in rows)
    head = ["session", "folder", *(["field"] if by_field else []), "start", "duration", "worked", "passes", "warnings"]
    lines = []
    for row in rows[:MOST_ROWS]:
        figures = row.outcome.figures
        worked_m2 = figures.get("worked_area_m2")
        link = f'<a href="{quote(row.name)}/{PAGE}">{escape(str(figures.get("session") or row.name))}</a>'
        cells = [
            row.name,
            *([row.field] if by_field else []),
            _start(figures),
            duration_words(float(figures.get("duration_s") or 0.0)),
            area(worked_m2) if worked_m2 is not None else "",
            str(figures.get("passes", "")),
            str(figures.get("warnings", "")),
        ]
        lines.append([link, *map(escape, cells)])
    texts = range(len(head) - 4)
    return f'<div class="scroll">{table_of_cells(head, lines, texts)}</div>{_more(rows)}'


def _start(figures: Mapping[str, Any]) -> str:
    """Local time at the field with its zone; UTC for a result that states no zone."""
    zone = figures.get("time_zone")
    text = str(figures.get("start_local" if zone else "start", ""))
    return f"{dt.datetime.fromisoformat(text):%Y-%m-%d %H:%M} ({zone or 'UTC'})" if text else ""


def _more(rows: Sequence[Row]) -> str:
    return remark(f"{len(rows) - MOST_ROWS:,} more sessions are in {TABLE}.") if len(rows) > MOST_ROWS else ""


def _sum(rows: Sequence[Row], name: str) -> float:
    return sum(float(row.outcome.figures.get(name) or 0.0) for row in rows)
