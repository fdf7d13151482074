"""GNSS evaluations as a folder: figures, tables, layers and an HTML page."""

import math
from collections.abc import Iterator, Mapping, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Final
from zoneinfo import ZoneInfo

import numpy as np
import shapely

from furrowmap.core.accuracy.evaluation import DEFINITIONS, QUANTILES, Age, ErrorTable, Evaluation
from furrowmap.core.geodesy.local_time import span_words, zone_at
from furrowmap.core.geodesy.longitudes import cut_at_antimeridian
from furrowmap.core.runtime.arrays import FloatArray
from furrowmap.core.runtime.json_text import json_text
from furrowmap.core.runtime.languages.texts import Text, Words, figure_text, label_text
from furrowmap.core.values.earth import earth_centred_m, east_north_up, geodetic
from furrowmap.core.values.gnss import Fix
from furrowmap.exporters.files.staging import refuse_products, staged_folder
from furrowmap.exporters.reports import evaluation_drawings
from furrowmap.exporters.reports.evaluation_drawings import fix_words
from furrowmap.exporters.reports.evaluation_figures import evaluation_figures, write_epochs, write_table
from furrowmap.exporters.reports.html_pages import notice_in_page, render, write_html
from furrowmap.exporters.reports.quantity_words import NOT_KNOWN, with_margin_words
from furrowmap.exporters.vectors.field_layers import Columns, Layer, geometry_array, texts, times
from furrowmap.exporters.vectors.geopackage import write_styled_layers
from furrowmap.exporters.vectors.qgis_styles import StyleClock

EVALUATION_PRODUCTS: Final = ("evaluation.json", "evaluation.html", "evaluation.gpkg", "services.csv", "epochs.csv")
PAPER_COLUMNS: Final = ("3D", "2D", "X", "Y", "Z")
"""The columns of tables 1 to 3 of Nakagawa et al."""
DEFINITION_WORDS: Final = tuple(label_text(f"{name}: {text}") for name, text in DEFINITIONS.items())
SERVICE_COLOURS: Final = ("#0072b2", "#e69f00", "#009e73", "#cc79a7", "#56b4e9", "#d55e00")
"""Of the services, told apart by those who confuse red and green (Okabe and Ito 2008); from the seventh on again."""


def write_evaluation(folder: Path, evaluations: Mapping[str, Evaluation], *, overwrite: bool) -> None:
    """Write :data:`EVALUATION_PRODUCTS`, all of them or none."""
    refuse_products(folder, EVALUATION_PRODUCTS, overwrite=overwrite)
    with staged_folder(folder) as staging:
        (staging / "evaluation.json").write_text(json_text(evaluation_figures(evaluations)), encoding="utf-8")
        write_table(staging / "services.csv", evaluations)
        write_epochs(staging / "epochs.csv", evaluations)
        clock = StyleClock(_zone(evaluations), *_span_s(evaluations))
        write_styled_layers(staging / "evaluation.gpkg", gnss_layers(evaluations), "EPSG:4326", clock=clock)
        write_html(staging / "evaluation.html", page(evaluations))


def page(evaluations: Mapping[str, Evaluation]) -> str:
    """The page, as HTML, with the times of the place; it names their zone."""
    found = list(evaluations.values())
    zone = _zone(evaluations)
    return render(
        "evaluation.html",
        title=Text("Accuracy of a GNSS log" if len(found) == 1 else "Accuracy of GNSS services"),
        when=span_words(*_span_s(evaluations), zone),
        services=evaluations,
        alone=found[0] if len(found) == 1 else None,
        colours={name: SERVICE_COLOURS[k % len(SERVICE_COLOURS)] for k, name in enumerate(evaluations)},
        references=list(dict.fromkeys(each.reference for each in found)),
        notices=list(dict.fromkeys(notice_in_page(notice, zone) for each in found for notice in each.notices)),
        definitions=DEFINITION_WORDS,
        quantiles=QUANTILES,
        paper=PAPER_COLUMNS,
        draw=evaluation_drawings,
        statistics=_statistics,
        continuity=_continuity,
        log_name=lambda file, service: f"{Path(file).name} ({service.upper()})" if service else Path(file).name,
        fix_name=_fix_name,
        shown_columns=lambda rows: [name for name, row in rows.items() if name in PAPER_COLUMNS or row.n],
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


def _fix_name(kind: str) -> Words:
    """The title of the table of a kind of fix."""
    known = {
        "all": Text("All kinds of fix"),
        "fixed": Text("Fixed"),
        "float": Text("Float"),
        "single": Text("Single"),
    }
    if kind in known:
        return known[kind]
    return kind.upper() if kind in ("ppp", "dgps", "pps") else kind.capitalize()


def _statistics(
    rows: ErrorTable, names: Sequence[str], shares: Sequence[float], greatest: bool
) -> Iterator[list[Words]]:
    """The rows of the table of the paper, with percentiles."""
    shown = [rows[name] for name in names]
    lines: dict[Words, list[float]] = {
        Text("Average"): [row.average_m for row in shown],
        Text("Standard deviation"): [row.standard_deviation_m for row in shown],
        "RMSE": [row.rmse_m for row in shown],
    }
    for q in shares:
        values = [row.percentiles_m[QUANTILES.index(q)] for row in shown]
        lines[Text("{percent:.0f} % below", percent=100 * q)] = values
    if greatest:
        lines[Text("Greatest")] = [row.greatest_m for row in shown]
    for title, values in lines.items():
        yield [title, *(figure_text(f"{value:.4f}") if math.isfinite(value) else "–" for value in values)]


def _continuity(found: Evaluation) -> list[tuple[Text, Words]]:
    """Names and texts of the figures of a log."""
    log = found.continuity
    fixes = {kind: fix_words(kind) for kind in (*log.share_by_fix, *log.first_by_fix_s)}
    shares = [Text("{fix} {share:.1%}", fix=fixes[kind], share=share) for kind, share in log.share_by_fix.items()]
    firsts = [Text("{fix} {seconds:.1f} s", fix=fixes[kind], seconds=t_s) for kind, t_s in log.first_by_fix_s.items()]
    sigmas = found.within_sigmas
    ahead: Words = NOT_KNOWN
    if found.time_ahead_s:
        ahead = Text("{value} (95 %)", value=with_margin_words(*found.time_ahead_s, " s", sign=True))
    return [
        (
            Text("positions"),
            Text(
                "{epochs:,}, every {interval_s:.3g} s; availability {availability:.1%}",
                epochs=log.epochs,
                interval_s=log.interval_s,
                availability=log.availability,
            ),
        ),
        (Text("kinds of fix"), Text("{items}", items=shares)),
        (Text("first fix, from the log's first position"), Text("{items}", items=firsts)),
        (
            Text("gaps"),
            Text(
                "{gaps}; longest {longest_s:.1f} s, sum {all_s:.1f} s",
                gaps=log.gaps,
                longest_s=log.longest_gap_s,
                all_s=log.all_gaps_s,
            ),
        ),
        (Text("age of corrections"), _age_words(log.age)),
        (
            Text("errors within 1, 2, 3 stated sigmas (expected: 68.3, 95.4, 99.7 %)"),
            figure_text(", ".join(f"{share:.1%}" for share in sigmas.values())) if sigmas else Text("no sigmas stated"),
        ),
        (Text("test ahead in time (slope of the error along the track over speed)"), ahead),
        (
            Text("outliers"),
            Text("{outliers} of {epochs} epochs", outliers=int(found.outlier.sum()), epochs=len(found.outlier)),
        ),
    ]


def _age_words(age: Age | None) -> Text:
    if age is None:
        return Text("not stated")
    return Text(
        "median {median_s:.1f} s, 95 % below {p95_s:.1f} s, greatest {greatest_s:.1f} s",
        median_s=age.median_s,
        p95_s=age.p95_s,
        greatest_s=age.greatest_s,
    )


def gnss_layers(evaluations: Mapping[str, Evaluation]) -> list[Layer]:
    """The layers `gnss_errors` (a point for each compared epoch) and `gnss_tracks`, in geographic coordinates."""
    found = list(evaluations.values())
    error = np.concatenate([one.matched.error_m for one in found])
    labels = {int(fix): fix.label for fix in Fix}
    t_s = np.concatenate([one.matched.t_s for one in found])
    columns: Columns = {
        "service": texts([name for name, one in evaluations.items() for _ in range(len(one.matched))]),
        "time": times(t_s),
        "fix": texts([labels[code] for one in found for code in one.fix.tolist()]),
        "x_m": error[:, 0],
        "y_m": error[:, 1],
        "z_m": error[:, 2],
        "error_2d_m": np.hypot(error[:, 0], error[:, 1]),
        "error_3d_m": np.sqrt(np.sum(error**2, axis=1)),
        "outlier": np.concatenate([one.outlier for one in found]),
    }
    places = np.column_stack(
        [np.concatenate([one.lon_deg for one in found]), np.concatenate([one.lat_deg for one in found])]
    )
    text = "Errors of GNSS positions: test minus reference, X towards east, Y towards north, Z up"
    errors = Layer("gnss_errors", "Point", text, geometry_array(shapely.points(places)), columns)
    # A line for each service and, last, one for the reference under the service with the most epochs.
    most = max(evaluations.values(), key=lambda one: len(one.matched))
    lines = [_line(one, one.lon_deg, one.lat_deg) for one in evaluations.values()]
    lines.append(_line(most, *_reference(most)))
    known = [one.tables["all"] for one in evaluations.values()]
    columns = {
        "service": texts([*evaluations, "reference"]),
        "file": texts([*(one.test for one in evaluations.values()), most.reference]),
        "is_reference": np.append(np.zeros(len(evaluations), bool), True),
        "epochs": np.array([*(len(one.matched) for one in evaluations.values()), len(most.matched)], np.int32),
        "rmse_2d_m": np.array([*(table["2D"].rmse_m for table in known), np.nan]),
        "rmse_z_m": np.array([*(table["Z"].rmse_m for table in known), np.nan]),
    }
    words = "Tracks of GNSS services and of their reference"
    return [errors, Layer("gnss_tracks", "MultiLineString", words, cut_at_antimeridian(geometry_array(lines)), columns)]


def _line(found: Evaluation, lon_deg: FloatArray, lat_deg: FloatArray) -> shapely.MultiLineString:
    """The track without lines across gaps."""
    places = np.column_stack([lon_deg, lat_deg])
    parts = [places[a:b] for a, b in pairwise(found.matched.unbroken) if b - a > 1]
    return shapely.MultiLineString(parts)


def _reference(found: Evaluation) -> tuple[FloatArray, FloatArray]:
    """Longitudes and latitudes of the reference: those of the test without its horizontal errors."""
    error = found.matched.error_m.copy()
    error[:, 2] = 0.0
    axes = east_north_up(found.lon_deg, found.lat_deg)
    moved = np.einsum("nij,ni->nj", axes, error)
    lon, lat, _ = geodetic(earth_centred_m(found.lon_deg, found.lat_deg, np.zeros(len(error))) - moved)
    return lon, lat
