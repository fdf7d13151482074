"""`report.html`: the result of a run on one page without external resources."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Final

import numpy as np
from markupsafe import Markup
from numpy.typing import NDArray

from furrowmap.core.crops.measure import MeasuredParcel
from furrowmap.core.crops.response import Response
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
from furrowmap.exporters.reports.page_language import in_language
from furrowmap.exporters.reports.pages import render
from furrowmap.exporters.reports.parcel_section import parcel_sections
from furrowmap.exporters.reports.range_images import range_images
from furrowmap.exporters.reports.run_report import points_by_class, scanners, verdict
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
