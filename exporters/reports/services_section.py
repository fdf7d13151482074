"""GNSS services side by side, for the page of an evaluation."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from itertools import pairwise
from typing import Final

import numpy as np
from numpy.typing import NDArray

from furrowmap.core.checking.evaluation import Evaluation
from furrowmap.core.checking.statistics import QUANTILES
from furrowmap.core.values.earth import SEMI_MAJOR_M
from furrowmap.core.values.gnss import Fix
from furrowmap.exporters.reports.page_parts import escape, figure, key, remark, section
from furrowmap.exporters.reports.svg import WIDTH, Axis, Sheet, TimeAxis, curve, drawing

FloatArray = NDArray[np.float64]

PAPER: Final = ("3D", "2D", "X", "Y", "Z")
"""The columns of tables 1 to 3 of Nakagawa et al."""
COLOURS: Final = ("#0072b2", "#e69f00", "#009e73", "#cc79a7", "#56b4e9", "#d55e00")
"""Of the services, told apart by those who confuse red and green (Okabe and Ito 2008); from the seventh on again."""
REFERENCE_COLOUR: Final = "#8c460a"
_DRAWN: Final = 4000
"""Most points of a track on the map."""


def service_sections(evaluations: Mapping[str, Evaluation]) -> list[str]:
    """Table, errors over time and tracks of several services.

    Args:
        evaluations: by the name of the service, all against the same reference.
    """
    colours = {name: COLOURS[k % len(COLOURS)] for k, name in enumerate(evaluations)}
    legend = key([(colour, name) for name, colour in colours.items()])
    graphs = [
        ("Horizontal error (2D)", lambda one: np.hypot(one.matched.error_m[:, 0], one.matched.error_m[:, 1]), 0.0),
        ("Z, up", lambda one: one.matched.error_m[:, 2], None),
    ]
    drawn = [figure(_graph(evaluations, colours, values, low, title), title) for title, values, low in graphs]
    note = "Values beyond the axis (2 % of the epochs) are drawn at its edge."
    return [
        section("Services side by side", _table(evaluations)),
        section("Errors of the services over time", f"{legend}{''.join(drawn)}{remark(note)}"),
        section("Tracks of the services", _map(evaluations, colours)),
    ]


def _table(evaluations: Mapping[str, Evaluation]) -> str:
    """Tables 1 to 3 of the paper in one, with shares and percentiles."""
    head = "".join(f"<th>{name} [m]</th>" for name in PAPER)
    lines = []
    for name, found in evaluations.items():
        rows = found.tables["all"]
        fixed = found.continuity.share_by_fix.get(Fix.FIXED.label, 0.0)
        title = escape(f"{name}: {len(found.matched):,} epochs, {fixed:.1%} fixed")
        lines.append(f'<tr><th class="text" colspan="6">{title}</th></tr>')
        statistics = [
            ("Average", [rows[k].average_m for k in PAPER]),
            ("Standard deviation", [rows[k].standard_deviation_m for k in PAPER]),
            ("RMSE", [rows[k].rmse_m for k in PAPER]),
            ("95 % below", [rows[k].percentiles_m[QUANTILES.index(0.95)] for k in PAPER]),
        ]
        lines += [
            f"<tr><td>{title}</td>{''.join(f'<td>{_number(value)}</td>' for value in values)}</tr>"
            for title, values in statistics
        ]
    note = "All epochs of each service against the same reference; the sections below have them by kind of fix."
    return f'<div class="scroll"><table><tr><th></th>{head}</tr>{"".join(lines)}</table></div>{remark(note)}'


def _graph(
    evaluations: Mapping[str, Evaluation],
    colours: Mapping[str, str],
    values: Callable[[Evaluation], FloatArray],
    low: float | None,
    title: str,
) -> str:
    series = {name: values(found) for name, found in evaluations.items()}
    known = np.abs(np.concatenate([one[np.isfinite(one)] for one in series.values()]))
    reach = max(1e-3, float(np.quantile(known, 0.98)) * 1.15) if len(known) else 1.0
    begin_s = min(float(found.matched.t_s[0]) for found in evaluations.values())
    end_s = max(float(found.matched.t_s[-1]) for found in evaluations.values())
    time, axis = TimeAxis(begin_s, end_s), Axis(-reach if low is None else low, reach, 180.0, 10.0)
    parts = axis.grid(time.left, lambda v: f"{v:.3g} m")
    for name, found in evaluations.items():
        parts.append(f'<g class="service" stroke="{colours[name]}">')
        for a, b in pairwise(found.matched.unbroken):
            parts += curve(time.at(found.matched.t_s[a:b]), np.clip(axis.at(series[name][a:b]), 10.0, 180.0))
        parts.append("</g>")
    parts += time.labels(180.0)
    return drawing(WIDTH, 218.0, parts, f"{title} of each service over time")


def _map(evaluations: Mapping[str, Evaluation], colours: Mapping[str, str]) -> str:
    first = next(iter(evaluations.values()))
    lon, lat = float(first.lon_deg[0]), float(first.lat_deg[0])
    scale = np.radians(1.0) * SEMI_MAJOR_M * np.array([math.cos(math.radians(lat)), 1.0])
    tracks, reference = {}, []
    for name, found in evaluations.items():
        place = np.column_stack([found.lon_deg - lon, found.lat_deg - lat]) * scale
        tracks[name] = place
        reference.append(place - found.matched.error_m[:, :2])
    whole = np.concatenate([*tracks.values(), *reference])
    west, south = np.quantile(whole, 0.001, axis=0)
    east, north = np.quantile(whole, 0.999, axis=0)
    margin = max(0.05 * max(east - west, north - south), 0.05)
    sheet = Sheet.of((west - margin, south - margin, east + margin, north + margin))
    parts: list[str] = []
    for (name, place), true in zip(tracks.items(), reference, strict=True):
        step = -(-len(place) // _DRAWN)
        for a, b in pairwise(evaluations[name].matched.unbroken):
            if b - a > 1:
                parts.insert(0, sheet.line(true[a:b:step], "way"))
                shown = np.clip(place[a:b:step], sheet.box_m[:2], sheet.box_m[2:])
                parts.append(sheet.line(shown, "track", f'stroke="{colours[name]}"'))
    legend = key([(REFERENCE_COLOUR, "reference"), *((colour, name) for name, colour in colours.items())])
    return f'<div class="maps">{sheet.svg(parts, "Tracks of the services and of the reference")}</div>{legend}'


def _number(value: float) -> str:
    return f"{value:.4f}" if math.isfinite(value) else "–"
