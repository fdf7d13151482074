"""The page of a batch: what was done, what failed and why, and a link to the report of each session."""

from __future__ import annotations

from collections.abc import Sequence
from importlib.metadata import version
from pathlib import Path
from typing import Final
from urllib.parse import quote

from furrowmap.exporters.files.atomic import atomic_output
from furrowmap.exporters.files.result_folder import PAGE
from furrowmap.exporters.reports.page_parts import duration_words, escape, filled, key_figure, remark, section, table
from furrowmap.exporters.vectors.batch_table import LAYERS, TABLE, Row

BATCH_PAGE: Final = "batch.html"
MOST_ROWS: Final = 2000
"""Sessions that the page lists; the table has all."""


def write_batch_page(folder: Path, rows: Sequence[Row]) -> None:
    """Write :data:`BATCH_PAGE`.

    Raises:
        OSError: if it cannot be written.
    """
    with atomic_output(folder / BATCH_PAGE) as unfinished:
        unfinished.write_text(page(rows), encoding="utf-8", errors="xmlcharrefreplace")


def page(rows: Sequence[Row]) -> str:
    """The page, as HTML."""
    failed = [row for row in rows if row.outcome.failure is not None]
    done = [row for row in rows if row.outcome.failure is None]
    starts = sorted(str(row.outcome.figures["start"]) for row in done if "start" in row.outcome.figures)
    worked_ha = _sum(done, "worked_area_m2") / 1e4
    figures = [
        key_figure(f"{len(done):,}", "sessions with a result"),
        key_figure(f"{len(failed):,}", "failed", loud=bool(failed)),
        key_figure(f"{worked_ha:,.2f} ha", "ground worked, sum of the sessions"),
        key_figure(duration_words(_sum(done, "duration_s")), "recorded"),
        key_figure(f"{_sum(done, 'points') / 1e6:,.1f}", "million points"),
        key_figure(duration_words(sum(row.outcome.seconds for row in done)), "of processing"),
    ]
    sections = [*([section("Failed", _failures(failed))] if failed else []), section("Sessions", _sessions(done))]
    return filled(
        title="Batch of sessions",
        when=f"{starts[0]} to {starts[-1]}" if starts else "",
        summary=escape(f"{len(rows):,} sessions."),
        figures=figures,
        sections=sections,
        provenance=escape(f"furrowmap {version('furrowmap')}. Tables: {TABLE}, {LAYERS}."),
    )


def _failures(rows: Sequence[Row]) -> str:
    lines = []
    for row in rows[:MOST_ROWS]:
        assert row.outcome.failure is not None
        lines.append((row.name, row.outcome.failure.code, *row.outcome.failure.lines))
    return f'<div class="scroll">{table(("Session", "Code", "What", "Consequence", "Remedy"), lines)}</div>'


def _sessions(rows: Sequence[Row]) -> str:
    head = ("Session", "Field", "Start", "Duration", "Worked [ha]", "Passes", "Warnings")
    lines = []
    for row in rows[:MOST_ROWS]:
        figures = row.outcome.figures
        area = figures.get("worked_area_m2")
        link = f'<a href="{quote(row.name)}/{PAGE}">{escape(row.name)}</a>'
        cells = (
            row.field,
            str(figures.get("start", "")),
            duration_words(float(figures.get("duration_s") or 0.0)),
            f"{area / 1e4:.3f}" if area is not None else "",
            str(figures.get("passes", "")),
            str(figures.get("warnings", "")),
        )
        lines.append(f"<tr><td>{link}</td>{''.join(f'<td>{escape(cell)}</td>' for cell in cells)}</tr>")
    more = remark(f"{len(rows) - MOST_ROWS:,} more are in {TABLE}.") if len(rows) > MOST_ROWS else ""
    top = "".join(f"<th>{escape(cell)}</th>" for cell in head)
    return (
        f'<div class="scroll"><table><thead><tr>{top}</tr></thead><tbody>{"".join(lines)}</tbody></table></div>{more}'
    )


def _sum(rows: Sequence[Row], name: str) -> float:
    return sum(float(row.outcome.figures.get(name) or 0.0) for row in rows)
