"""The page of ties between dates."""

from __future__ import annotations

from collections.abc import Mapping
from importlib.metadata import version
from typing import Any, Final

from furrowmap.exporters.reports.area_units import area
from furrowmap.exporters.reports.page_parts import days_words, escape, filled, key_figure, remark, section, table

_MOVES: Final = (
    "east (mm)", "north (mm)", "height (mm)", "tilt east (°)", "tilt north (°)", "turn (°)",
)  # fmt: skip


def tie_page(account: Mapping[str, Any]) -> str:
    """The page of `tie.json` in English: dates and their moves, ties, soil moved; its areas have no unit yet."""
    dates, ties, changes = account["dates"], account["ties"], account["changes"]
    tied = sum(date["tied"] for date in dates)
    medians = [abs(change["untouched_median_m"]) for change in changes if change["untouched_median_m"] is not None]
    figures = [key_figure(f"{tied} / {len(dates)}", "dates tied")]
    if medians:
        figures.append(key_figure(f"{1000 * max(medians):.1f} mm", "change of untouched ground, at most (median)"))
    sections = [section("Dates", _dates(dates)), section("Ties", _ties(ties))]
    if changes:
        sections.append(section("Soil moved between dates", _changes(changes)))
    if account["warnings"]:
        items = "".join(f"<li>{escape(notice['text'])}</li>" for notice in account["warnings"])
        sections.append(section("Warnings", f"<ul>{items}</ul>"))
    return filled(
        title="Dates of one field",
        when=escape(days_words(dates[0]["start_local"][:10], dates[-1]["start_local"][:10])),
        summary=escape("Surfaces of several dates, moved such that ground that no tool touched agrees."),
        figures=figures,
        sections=sections,
        provenance=escape(f"furrowmap {version('furrowmap')}; inputs with their SHA-256 are in tie.json."),
    )


def _dates(dates: Any) -> str:
    head = ("", "date", *_MOVES)
    rows = [(str(date["date"]), f"{date['name']}, {_start(date)}", *_moves(date)) for date in dates]
    note = (
        "What moves each surface, ± its standard deviation, which includes the error that all dates have in common. "
        "Tilt east and north: rise towards there. Turn: counter-clockwise."
    )
    return f'<div class="scroll">{table(head, rows, texts=(1,))}</div>{remark(note)}'


def _ties(ties: Any) -> str:
    moves = [(_pair(tie), *_moves(tie)) for tie in ties]
    quality = [
        (
            _pair(tie),
            f"{tie['patches']:,}",
            f"{tie['upright']:,}",
            f"{1000 * tie['departures_m']:.1f} mm in {tie['range_m']:.0f} m",
            f"{tie['tension']:.1f}",
        )
        for tie in ties
    ]
    note = (
        "Dates by their numbers. What moves the second onto the first, ± its standard deviation. Patches: square "
        "metres of common ground. Walls, posts: pieces of walls, and posts. Departures: how much the difference of "
        "the two surfaces bends from place to place, which the standard deviations include. Tension: what a tie "
        "departs from all ties together, over its standard deviations."
    )
    tables = table(("dates", *_MOVES), moves) + table(
        ("dates", "patches", "walls, posts", "departures", "tension"), quality
    )
    return f'<div class="scroll">{tables}</div>{remark(note)}'


def _changes(changes: Any) -> str:
    head = ("dates", "worked", "seen on both", "mean change", "volume", "untouched ground")
    rows = [
        (
            _pair(change),
            area(change["worked_m2"]),
            area(change["compared_m2"]),
            _with_sigma(change, "mean_change_m", "mean_change_sigma_m", 1000.0, "mm", 1),
            _with_sigma(change, "volume_m3", "volume_sigma_m3", 1.0, "m³", 3),
            "" if change["untouched_median_m"] is None else f"{1000 * change['untouched_median_m']:+.1f} mm",
        )
        for change in changes
    ]
    note = (
        "Change upward positive, ± its standard deviation. The volume is the mean change of what both dates saw, for "
        "all ground worked."
    )
    return f'<div class="scroll">{table(head, rows)}</div>{remark(note)}'


def _pair(row: Any) -> str:
    """Two dates by their numbers; 0 is the reference."""
    return f"{row['date_a'] or 'reference'} → {row['date_b']}"


def _start(date: Any) -> str:
    """Local time at the field with its zone."""
    return f"{date['start_local'][:16].replace('T', ' ')} ({date['time_zone']})"


def _with_sigma(row: Any, name: str, sigma: str, factor: float, unit: str, digits: int) -> str:
    if row[name] is None or row[sigma] is None:
        return "unknown"
    return f"{factor * row[name]:+.{digits}f} ± {factor * row[sigma]:.{digits}f} {unit}".rstrip()


def _moves(row: Any) -> list[str]:
    """The six figures of a move."""
    lengths = [_with_sigma(row, name, f"{name}_sigma", 1000.0, "", 1) for name in ("east_m", "north_m", "height_m")]
    angles = [
        _with_sigma(row, name, f"{name}_sigma", 1.0, "", 3) for name in ("tilt_east_deg", "tilt_north_deg", "turn_deg")
    ]
    return [*lengths, *angles] if row["east_m"] is not None else ["not tied", *5 * [""]]
