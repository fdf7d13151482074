"""The page of ties between dates."""

from __future__ import annotations

from collections.abc import Mapping
from importlib.metadata import version
from typing import Any

from furrowmap.exporters.reports.page_parts import escape, filled, key_figure, remark, section, table


def tie_page(account: Mapping[str, Any]) -> str:
    """The page of `tie.json`: dates and their moves, ties, soil moved."""
    dates, ties, changes = account["dates"], account["ties"], account["changes"]
    tied = sum(date["tied"] for date in dates)
    medians = [abs(change["untouched_median_m"]) for change in changes if change["untouched_median_m"] is not None]
    figures = [key_figure(f"{tied} of {len(dates)}", "dates tied")]
    if medians:
        figures.append(key_figure(f"{1000 * max(medians):.1f} mm", "change of untouched ground, at most (median)"))
    names = {date["date"]: date["name"] for date in dates} | {0: "reference"}
    sections = [section("Dates", _dates(dates)), section("Ties", _ties(ties, names))]
    if changes:
        sections.append(section("Soil moved between dates", _changes(changes, names)))
    if account["warnings"]:
        items = "".join(f"<li>{escape(notice['text'])}</li>" for notice in account["warnings"])
        sections.append(section("Warnings", f"<ul>{items}</ul>"))
    return filled(
        title="Dates of one field",
        when=escape(f"{dates[0]['start'][:10]} to {dates[-1]['start'][:10]}"),
        summary=escape("Surfaces of several dates, moved such that ground that no tool touched agrees."),
        figures=figures,
        sections=sections,
        provenance=escape(f"furrowmap {version('furrowmap')}; inputs with their SHA-256 are in tie.json."),
    )


def _dates(dates: Any) -> str:
    head = ("", "name", "start", "east", "north", "height", "tilt east", "tilt north", "turn")
    rows = [(str(date["date"]), date["name"], date["start"][:16].replace("T", " "), *_moves(date)) for date in dates]
    note = "What moves each surface; its standard deviation includes the error that all dates have in common."
    return f'<div class="scroll">{table(head, rows)}</div>{remark(note)}'


def _ties(ties: Any, names: Mapping[int, str]) -> str:
    head = ("dates", "patches", "east", "north", "height", "tilt east", "tilt north", "turn", "departures", "tension")
    rows = [
        (
            f"{names[tie['date_a']]}, {names[tie['date_b']]}",
            f"{tie['patches']:,}",
            *_moves(tie),
            f"{1000 * tie['departures_m']:.1f} mm in {tie['range_m']:.0f} m",
            f"{tie['tension']:.1f}",
        )
        for tie in ties
    ]
    note = (
        "What moves the second date onto the first. Departures: how much the difference of the two surfaces bends from "
        "place to place, which the standard deviations include. Tension: what a tie departs from all ties together, "
        "over its standard deviations."
    )
    return f'<div class="scroll">{table(head, rows)}</div>{remark(note)}'


def _changes(changes: Any, names: Mapping[int, str]) -> str:
    head = ("dates", "worked", "seen on both", "mean change", "volume", "untouched ground")
    rows = [
        (
            f"{names[change['date_a']]} to {names[change['date_b']]}",
            f"{change['worked_m2']:.1f} m²",
            f"{change['compared_m2']:.1f} m²",
            _with_sigma(change, "mean_change_m", "mean_change_sigma_m", 1000.0, "mm", 1),
            _with_sigma(change, "volume_m3", "volume_sigma_m3", 1.0, "m³", 3),
            "" if change["untouched_median_m"] is None else f"{1000 * change['untouched_median_m']:+.1f} mm",
        )
        for change in changes
    ]
    note = "Change upward positive. The volume is the mean change of what both dates saw, for all ground worked."
    return f'<div class="scroll">{table(head, rows)}</div>{remark(note)}'


def _with_sigma(row: Any, name: str, sigma: str, factor: float, unit: str, digits: int) -> str:
    if row[name] is None or row[sigma] is None:
        return "unknown"
    return f"{factor * row[name]:+.{digits}f} ± {factor * row[sigma]:.{digits}f} {unit}"


def _moves(row: Any) -> list[str]:
    """The six figures of a move."""
    lengths = [_with_sigma(row, name, f"{name}_sigma", 1000.0, "mm", 1) for name in ("east_m", "north_m", "height_m")]
    angles = [
        _with_sigma(row, name, f"{name}_sigma", 1.0, "°", 4) for name in ("tilt_east_deg", "tilt_north_deg", "turn_deg")
    ]
    return [*lengths, *angles] if row["east_m"] is not None else ["not tied", *5 * [""]]
