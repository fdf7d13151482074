"""`report.html`: the result of a run on one page without external resources."""

import math
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Final

import numpy as np
from markupsafe import Markup
from numpy.typing import NDArray

from furrowmap.core.crops.measure import MeasuredParcel
from furrowmap.core.crops.response import Response, column_words, dose_name, parcel_doses
from furrowmap.core.geodesy.local_time import span_words
from furrowmap.core.pipeline.run_result import RunResult
from furrowmap.core.runtime.settings import language_of_user
from furrowmap.core.values.gnss import Fix
from furrowmap.core.values.scan import PointClass
from furrowmap.exporters.cloud.writer import CopcSummary
from furrowmap.exporters.files.atomic import atomic_output
from furrowmap.exporters.rasters.field_rasters import RasterFigures
from furrowmap.exporters.rasters.relief import shaded_ground
from furrowmap.exporters.reports import drawings
from furrowmap.exporters.reports.area_units import in_area_unit
from furrowmap.exporters.reports.drawings import padded_bounds
from furrowmap.exporters.reports.page_language import in_language
from furrowmap.exporters.reports.pages import render
from furrowmap.exporters.reports.range_images import range_images
from furrowmap.exporters.reports.run_report import points_by_class, scanners, verdict
from furrowmap.exporters.reports.svg import Sheet, mixed_colour
from furrowmap.exporters.reports.trial_charts import ParcelValues, response_chart
from furrowmap.exporters.vectors.labels import VALUES

MAX_ROWS: Final = 60
"""Maximum length of the tables of passes and strips."""


def write_page(
    path: Path,
    found: RunResult,
    cloud: Path,
    summary: CopcSummary | None,
    rasters: RasterFigures | None,
    parcels: Sequence[MeasuredParcel] = (),
    response: Response | None = None,
    features: Mapping[str, int] | None = None,
) -> None:
    """Write `report.html`.

    Args:
        cloud: its COPC file, for the relief of the map.
        summary: of the cloud; None for no cloud.
        rasters: figures of the surfaces; None for no surfaces.
        response: of their heights to a dose; None where they have none.
        features: numbers of planes, lines and plants; None where they were not looked for.
    """
    poses, work = found.placement.poses, found.work
    box_m = drawings.map_box(poses, work)
    said = verdict(found)
    east, north, up, roll, pitch, heading = (_median(column) for column in poses.sigma.T)
    lowering = _median(work.states.begin_sigma_s[1:]) if work.states is not None and len(work.states) > 1 else None
    fixes = [
        (drawings.fix_colour(fix), f"{_fix_name(fix)} {count / len(poses):.0%}")
        for fix, count in Counter(poses.fix.tolist()).most_common()
    ]
    active = set(drawings.activities(poses, work).tolist())
    page = render(
        "report.html",
        title=found.session.name or "Field report",
        when=span_words(found.placement.first_s, found.placement.last_s, found.zone),
        alarms=[text for text in (said["text"], *said["doubts"]) if text],
        found=found,
        scanners=scanners(found),
        zone=found.zone,
        poses=poses,
        draw=drawings,
        range_images=range_images,
        box_m=box_m,
        relief=shaded_ground(cloud, summary.points_by_level, box_m) if summary is not None else None,
        heights_m=[row.figures.mean_height_m for row in parcels if math.isfinite(row.figures.mean_height_m)],
        parcels=Markup(parcel_sections(parcels, response)),  # noqa: S704 (of a template)
        features=features,
        activities=[(colour, name) for k, (name, colour) in enumerate(drawings.ACTIVITIES.items()) if k in active],
        fixes=fixes,
        sigma={
            "across": float(np.hypot(east, north)),
            "up": up,
            "roll": roll,
            "pitch": pitch,
            "heading": heading,
            "lowering": lowering,
        },
        swaths=rasters.swaths if rasters is not None else None,
        strips=rasters.strips if rasters is not None else (),
        strip_graphs=_strip_graphs(found),
        classes=points_by_class(summary) if summary is not None and summary.points else {},
        points=summary.points if summary is not None else 0,
        class_number=lambda name: PointClass[name.upper()].value,
        max_rows=MAX_ROWS,
    )
    report = found.session.report
    page = in_language(in_area_unit(page, report.area_unit), language_of_user(report.language))
    with atomic_output(path) as unfinished:
        unfinished.write_text(page, encoding="utf-8", errors="xmlcharrefreplace")


def _strip_graphs(found: RunResult) -> Iterator[tuple[Markup, str]]:
    """Histograms of the differences of strips before and after the mounting was estimated, in one scale."""
    if found.strip_differences is None:
        return
    both = found.strip_differences.figures()
    reach_m = max((drawings.half_width_m(figures) for figures in both if figures is not None), default=0.0)
    for figures, title in zip(
        both, ("as the session states the mounting", "with the mounting that was used"), strict=True
    ):
        if figures is not None:
            yield drawings.swath_histogram(figures, reach_m), title


def _fix_name(fix: int) -> str:
    return VALUES["fix"].get(Fix(fix).label, "other") if fix in list(Fix) else "from a file"


def _median(values: NDArray[np.float64]) -> float:
    known = values[np.isfinite(values)]
    return float(np.median(known)) if len(known) else float("nan")


HEIGHT_COLOURS: Final = np.array([[247, 252, 185], [120, 198, 121], [0, 69, 41]])
"""From the shortest parcel over the middle to the tallest, as in the layer's style."""
UNKNOWN_COLOUR: Final = "#d9d9d9"
MAX_TABLE_PARCELS: Final = 200
"""Maximum length of the table."""
MAX_NAMED_PARCELS: Final = 150
"""Parcels with their names on the map."""
PARCEL_MARGIN_M: Final = 1.0


def parcel_sections(found: Sequence[MeasuredParcel], response: Response | None = None) -> str:
    """The sections as HTML: height and, where there is one, the response to a dose; nothing without parcels."""
    if not found:
        return ""
    heights_m = np.array([row.figures.mean_height_m for row in found])
    known = heights_m[np.isfinite(heights_m)]
    low, high = (float(known.min()), float(known.max())) if len(known) else (0.0, 1.0)

    def colour(height_m: float) -> str:
        if not math.isfinite(height_m):
            return UNKNOWN_COLOUR
        return mixed_colour((height_m - low) / (high - low) if high > low else 0.5, HEIGHT_COLOURS)

    sheet = Sheet(padded_bounds([row.parcel.gross for row in found], PARCEL_MARGIN_M))
    parts = []
    for row, height_m in zip(found, heights_m.tolist(), strict=True):
        parts.append(sheet.area(row.parcel.gross, "boundary"))
        parts.append(sheet.area(row.parcel.net, "pass", fill=colour(height_m)))
    if len(found) <= MAX_NAMED_PARCELS:
        parts += [sheet.text(row.parcel.net.representative_point(), row.parcel.id) for row in found]
    parcels, chart = [row.parcel for row in found], None
    if response is not None and (name := dose_name(parcels)) is not None:
        blocks = [parcel.block or "" for parcel in parcels]
        values = ParcelValues(heights_m, blocks, column_words("mean_height_m"), "block")
        chart = response_chart(parcel_doses(parcels, name), values, response, column_words(name))
    return render(
        "parcels.html",
        parcels=found,
        max_parcels=MAX_TABLE_PARCELS,
        published=any(math.isfinite(row.published_height_m) for row in found),
        map=sheet.svg(parts, "Map of the parcels by height"),
        colours=[(colour(value), f"{100.0 * value:.1f} cm") for value in np.linspace(low, high, 5).tolist()],
        response=response,
        chart=chart,
    )
