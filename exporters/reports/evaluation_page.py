"""GNSS evaluations as a folder: figures, tables, layers and an HTML page."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from importlib.metadata import version
from itertools import pairwise
from pathlib import Path
from typing import Final
from zoneinfo import ZoneInfo

import numpy as np
from numpy.typing import NDArray

from furrowmap.core.checking.evaluation import Evaluation
from furrowmap.core.checking.statistics import DEFINITIONS, QUANTILES, Table
from furrowmap.core.geodesy.local_time import in_local_time, span_words, zone_at
from furrowmap.core.runtime.json_text import json_text
from furrowmap.core.values.gnss import Fix
from furrowmap.exporters.files.staging import refuse_products, staged_folder
from furrowmap.exporters.reports.drawings import fix_colour
from furrowmap.exporters.reports.evaluation_figures import evaluation_figures, write_epochs, write_table
from furrowmap.exporters.reports.page_parts import escape, figure, filled, key, key_figure, remark, section
from furrowmap.exporters.reports.services_section import PAPER, service_sections
from furrowmap.exporters.reports.svg import WIDTH, Axis, Sheet, TimeAxis, curve, drawing
from furrowmap.exporters.vectors.geopackage import write_layer, write_styles
from furrowmap.exporters.vectors.gnss_layers import gnss_layers

FloatArray = NDArray[np.float64]

PRODUCTS: Final = ("evaluation.json", "evaluation.html", "evaluation.gpkg", "services.csv", "epochs.csv")
_MARGIN: Final = 0.05


def write_evaluation(folder: Path, evaluations: Mapping[str, Evaluation], *, overwrite: bool) -> None:
    """Write :data:`PRODUCTS`, all of them or none.

    Args:
        folder: to write to; created where missing.
        evaluations: by the name of the service or receiver, all against the same reference.
        overwrite: replace those of another evaluation.

    Raises:
        RefusedError: if they exist and may not be replaced.
        InputError: if the folder cannot be written to.
    """
    refuse_products(folder, PRODUCTS, overwrite=overwrite)
    with staged_folder(folder) as staging:
        (staging / "evaluation.json").write_text(json_text(evaluation_figures(evaluations)), encoding="utf-8")
        write_table(staging / "services.csv", evaluations)
        write_epochs(staging / "epochs.csv", evaluations)
        layers = gnss_layers(evaluations)
        for layer in layers:
            write_layer(staging / "evaluation.gpkg", layer, "EPSG:4326", indexed=True)
        clock = (_zone(evaluations), *_span_s(evaluations))
        write_styles(staging / "evaluation.gpkg", [layer.name for layer in layers], clock)
        (staging / "evaluation.html").write_text(page(evaluations), encoding="utf-8", errors="xmlcharrefreplace")


def page(evaluations: Mapping[str, Evaluation]) -> str:
    """The page, as HTML, with the times of the place; it names their zone."""
    found = list(evaluations.values())
    zone = _zone(evaluations)
    one = len(found) == 1
    notices = list(dict.fromkeys(in_local_time(notice.text, zone) for each in found for notice in each.notices))
    references = list(dict.fromkeys(each.reference for each in found))
    sections = [
        *(service_sections(evaluations) if not one else []),
        *(part for name, each in evaluations.items() for part in _sections(each, "" if one else f"{name}: ")),
        section("Definitions", _list([f"{name}: {text}" for name, text in DEFINITIONS.items()])),
        *([section("Warnings", _list(notices))] if notices else []),
    ]
    figures = (
        _figures(found[0]) if one else [figure for name, each in evaluations.items() for figure in _short(name, each)]
    )
    return filled(
        title="Accuracy of a GNSS log" if one else "Accuracy of GNSS services",
        when=span_words(*_span_s(evaluations), zone),
        summary=escape(" ".join(_summary(each) for each in found)),
        figures=figures,
        sections=sections,
        provenance=escape(
            f"furrowmap {version('furrowmap')}. Test: {', '.join(each.test for each in found)}. "
            f"Reference: {', '.join(references)}."
        ),
    )


def _zone(evaluations: Mapping[str, Evaluation]) -> ZoneInfo:
    """The time zone of the place where the first service was in the middle of its log."""
    first = next(iter(evaluations.values()))
    middle = len(first.lon_deg) // 2
    return zone_at(float(first.lon_deg[middle]), float(first.lat_deg[middle]))


def _span_s(evaluations: Mapping[str, Evaluation]) -> tuple[float, float]:
    """UTC of the first and the last of the compared epochs."""
    times = [each.matched.t_s for each in evaluations.values()]
    return float(min(t_s[0] for t_s in times)), float(max(t_s[-1] for t_s in times))


def _summary(found: Evaluation) -> str:
    return (
        f"{_name(found.test, found.service)} against {_name(found.reference, found.reference_service)}: "
        f"{len(found.matched):,} of {found.continuity.epochs:,} positions compared."
    )


def _sections(found: Evaluation, before: str) -> list[str]:
    """The sections of one service; `before` begins their titles."""
    return [
        *(
            section(f"{before}{_kind(kind)}: {next(iter(rows.values())).n:,} epochs", _table(rows))
            for kind, rows in found.tables.items()
        ),
        section(f"{before}Errors over time", _graphs(found)),
        section(f"{before}Trajectories", f'<div class="maps">{_map(found)}</div>{_key(found)}'),
        section(f"{before}Continuity", _continuity(found)),
    ]


def _short(name: str, found: Evaluation) -> list[str]:
    """The figures of one of several services."""
    rows = found.tables["all"]
    return [key_figure(_metres(rows[axis].rmse_m), f"RMSE {axis}, {name}") for axis in ("2D", "Z")]


def _name(file: str, service: str) -> str:
    return f"{Path(file).name} ({service.upper()})" if service else Path(file).name


def _kind(kind: str) -> str:
    if kind == "all":
        return "All kinds of fix"
    return kind.upper() if kind in ("ppp", "dgps", "pps") else kind.capitalize()


def _figures(found: Evaluation) -> list[str]:
    best = found.tables.get(Fix.FIXED.label, found.tables["all"])
    word = "fixed" if Fix.FIXED.label in found.tables else "all epochs"
    rows = [
        (f"RMSE 2D, {word}", _metres(best["2D"].rmse_m)),
        (f"RMSE Z, {word}", _metres(best["Z"].rmse_m)),
        (f"median 2D, {word}", _metres(best["2D"].percentiles_m[0])),
        ("95 % 2D, all epochs", _metres(found.tables["all"]["2D"].percentiles_m[QUANTILES.index(0.95)])),
        ("fixed", f"{found.continuity.share_by_fix.get(Fix.FIXED.label, 0.0):.1%}"),
        ("outliers", f"{found.outlier.mean():.1%}"),
    ]
    return [key_figure(value, name) for name, value in rows]


def _table(rows: Table) -> str:
    """The table of the paper, with percentiles and the components along and across the track."""
    names = [name for name, row in rows.items() if name in PAPER or row.n]
    head = "".join(f"<th>{name} [m]</th>" for name in names)
    lines = [
        ("Average", [rows[name].average_m for name in names]),
        ("Standard deviation", [rows[name].standard_deviation_m for name in names]),
        ("RMSE", [rows[name].rmse_m for name in names]),
        *((f"{100 * q:.0f} % below", [rows[name].percentiles_m[k] for name in names]) for k, q in enumerate(QUANTILES)),
        ("Greatest", [rows[name].greatest_m for name in names]),
    ]
    body = "".join(
        f"<tr><td>{title}</td>{''.join(f'<td>{_number(value)}</td>' for value in values)}</tr>"
        for title, values in lines
    )
    return f'<div class="scroll"><table><tr><th></th>{head}</tr>{body}</table></div>'


def _graphs(found: Evaluation) -> str:
    error = found.matched.error_m
    graphs = [
        ("Horizontal error (2D)", np.hypot(error[:, 0], error[:, 1]), 0.0),
        ("X, towards east", error[:, 0], None),
        ("Y, towards north", error[:, 1], None),
        ("Z, up", error[:, 2], None),
    ]
    shown = [
        figure(_graph(found, values, low, title), title) for title, values, low in graphs if np.isfinite(values).any()
    ]
    note = "The bars show the kind of fix. Values beyond the axis (1 % of the epochs) are drawn at its edge."
    return f"{''.join(shown)}{remark(note)}{_key(found)}"


def _graph(found: Evaluation, values: FloatArray, low: float | None, title: str) -> str:
    t_s = found.matched.t_s
    time = TimeAxis(float(t_s[0]), float(t_s[-1]))
    known = values[np.isfinite(values)]
    reach = max(1e-3, float(np.quantile(np.abs(known), 0.99)) * 1.15)
    axis = Axis(-reach if low is None else low, reach, 150.0, 20.0)
    edges = _edges(found)
    parts = [
        f'<rect x="{time.at(t_s[a]):.1f}" y="0" width="{float(time.at(t_s[b - 1]) - time.at(t_s[a])) + 0.5:.1f}" '
        f'height="12" fill="{fix_colour(int(found.fix[a]))}"/>'
        for a, b in pairwise(edges)
    ]
    parts += axis.grid(time.left, lambda v: f"{v:.3g} m")
    for a, b in pairwise(found.matched.unbroken):
        parts += curve(time.at(t_s[a:b]), np.clip(axis.at(values[a:b]), 20.0, 150.0))
    parts += time.labels(150.0)
    return drawing(WIDTH, 188.0, parts, f"{title} over time")


def _edges(found: Evaluation) -> list[int]:
    """Indices at which the kind of fix changes or a gap begins, with both ends."""
    cuts = np.flatnonzero(np.diff(found.fix) != 0) + 1
    return sorted({0, *cuts.tolist(), *found.matched.unbroken})


def _map(found: Evaluation) -> str:
    test, reference = found.matched.test_m[:, :2], found.matched.reference_m[:, :2]
    whole = np.concatenate([test, reference])
    west, south = np.quantile(whole, 0.001, axis=0)
    east, north = np.quantile(whole, 0.999, axis=0)
    margin = max(_MARGIN * max(east - west, north - south), 0.05)
    sheet = Sheet.of((west - margin, south - margin, east + margin, north + margin))
    parts = [sheet.line(reference[a:b], "way") for a, b in pairwise(found.matched.unbroken) if b - a > 1]
    for a, b in pairwise(_edges(found)):
        part = np.clip(test[a : b + 1 if b in _within(found) else b], sheet.box_m[:2], sheet.box_m[2:])
        if len(part) > 1:
            parts.append(sheet.line(part, "track", f'stroke="{fix_colour(int(found.fix[a]))}"'))
    return sheet.svg(parts, "Trajectories: the reference in brown, the test by its kind of fix")


def _within(found: Evaluation) -> set[int]:
    """Indices at which the kind of fix changes without a gap: a line continues to the next part."""
    return set(_edges(found)[1:-1]) - set(found.matched.unbroken)


def _key(found: Evaluation) -> str:
    kinds = [(fix_colour(int(code)), Fix(int(code)).label) for code in np.unique(found.fix)]
    return key([("#8c460a", "reference (map)"), *kinds])


def _continuity(found: Evaluation) -> str:
    log = found.continuity
    shares = ", ".join(f"{kind} {share:.1%}" for kind, share in log.share_by_fix.items())
    firsts = ", ".join(f"{kind} after {seconds:.1f} s" for kind, seconds in log.first_by_fix_s.items())
    age = (
        f"median {log.age.median_s:.1f} s, 95 % below {log.age.p95_s:.1f} s, greatest {log.age.greatest_s:.1f} s"
        if log.age
        else "not stated"
    )
    sigmas = found.within_sigmas
    rows = [
        (
            "positions",
            f"{log.epochs:,}, every {log.interval_s:.3g} s; availability {log.availability:.1%}",
        ),
        ("kinds of fix", shares),
        ("first fix, from the log's first position", firsts),
        ("gaps", f"{log.gaps}; longest {log.longest_gap_s:.1f} s, sum {log.all_gaps_s:.1f} s"),
        ("age of corrections", age),
        (
            "errors within 1, 2, 3 stated sigmas (expected: 68.3, 95.4, 99.7 %)",
            ", ".join(f"{share:.1%}" for share in sigmas.values()) if sigmas else "no sigmas stated",
        ),
        (
            "test ahead in time (slope of the error along the track over speed)",
            f"{found.time_ahead_s[0]:+.3f} s ± {found.time_ahead_s[1]:.3f}" if found.time_ahead_s else "unknown",
        ),
        ("outliers", f"{int(found.outlier.sum())} of {len(found.outlier)} epochs"),
    ]
    texts = (
        f'<tr><td class="text">{escape(name)}</td><td class="text">{escape(value)}</td></tr>' for name, value in rows
    )
    body = "".join(texts)
    return f'<div class="scroll"><table>{body}</table></div>'


def _list(texts: Sequence[str]) -> str:
    return f"<ul>{''.join(f'<li>{escape(text)}</li>' for text in texts)}</ul>"


def _number(value: float) -> str:
    return f"{value:.4f}" if math.isfinite(value) else "–"


def _metres(value: float) -> str:
    return f"{value:.3f} m" if math.isfinite(value) else "unknown"
