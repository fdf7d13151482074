"""`report.html`: the result of a run on one page without external resources."""

from collections import Counter
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, Final

import numpy as np
from markupsafe import Markup
from numpy.typing import NDArray

from furrowmap.core.coverage.worked_ground import WorkFigures
from furrowmap.core.geodesy.local_time import span_words
from furrowmap.core.implement.seen_implement import SeenImplement
from furrowmap.core.pipeline.causes import Finding, findings
from furrowmap.core.pipeline.run_result import RunResult
from furrowmap.core.runtime.languages.texts import Text, Words, figure_text, label_text
from furrowmap.core.runtime.settings import language_of_user
from furrowmap.core.values.gnss import Fix
from furrowmap.core.values.scan import PointClass
from furrowmap.exporters.cloud.writer import CopcSummary
from furrowmap.exporters.rasters.field_rasters import RasterFigures
from furrowmap.exporters.rasters.relief import shaded_ground
from furrowmap.exporters.reports import drawings
from furrowmap.exporters.reports.area_units import area
from furrowmap.exporters.reports.html_pages import notice_in_page, render, write_html
from furrowmap.exporters.reports.quantity_words import number
from furrowmap.exporters.reports.run_report import points_by_class, scanners, top_findings
from furrowmap.exporters.reports.svg import WIDTH, drawing, element, image, label, turned_label
from furrowmap.exporters.vectors.labels import VALUES

LEFT: Final = 58.0
TOP: Final = 4.0
BOTTOM: Final = 84.0
MAX_TICKS: Final = 9
_NEAR_TO_FAR: Final = np.array([[253.0, 231.0, 37.0], [33.0, 145.0, 140.0], [68.0, 1.0, 84.0]])
_NO_RETURN: Final = np.array([238.0, 238.0, 235.0])
_STEPS_DEG: Final = (1, 2, 5, 10, 15, 20, 30, 45, 60, 90)


def range_images(seen: SeenImplement) -> Iterator[tuple[Text, Markup]]:
    """The implement up and down, and what does not move in the scanner's frame: captions and images."""
    images = seen.images
    still_m = seen.region.still_m
    around_deg = (np.arange(still_m.shape[1]) + 0.5) * (360.0 / still_m.shape[1])
    for text, range_m, azimuth_deg, shown in (
        (Text("The implement lifted"), images.up_m, images.azimuth_deg, images.implement),
        (Text("The implement in the ground"), images.down_m, images.azimuth_deg, images.implement),
        (Text("Static returns: the vehicle itself, all around"), still_m, around_deg, None),
    ):
        if range_m.size:  # an implement that was learned elsewhere may have none
            yield text, range_image(range_m, azimuth_deg, shown, text)


def range_image(
    range_m: NDArray[np.float32], azimuth_deg: NDArray[np.float64], shown: NDArray[np.bool_] | None, title: Words
) -> Markup:
    """A range image (lasers, n), the lowest laser first, nan for nothing, as SVG; what is not `shown` is pale.

    The azimuths (n,) of the columns increase, and may go on beyond 360.
    """
    lasers, columns = range_m.shape
    parts = [image(LEFT, TOP, WIDTH, BOTTOM, range_picture(range_m, shown), class_="depth")]
    row = (BOTTOM - TOP) / lasers
    parts += [
        label(LEFT - 7, BOTTOM - (number - 0.5) * row + 4, str(number), "right")
        for number in sorted({1, (lasers + 1) // 2, lasers})
    ]
    parts.append(turned_label(Text("laser"), 0.5 * (TOP + BOTTOM)))
    half_deg = 0.5 * float(azimuth_deg[-1] - azimuth_deg[0]) / max(columns - 1, 1)
    first = float(azimuth_deg[0]) - half_deg
    last = float(azimuth_deg[-1]) + half_deg
    step = next((s for s in _STEPS_DEG if (last - first) / s <= MAX_TICKS), _STEPS_DEG[-1])
    marks = np.arange(np.ceil(first / step - 1e-6) * step, last + 1e-6, step)
    places = (LEFT + (marks - first) / max(last - first, 1e-9) * (WIDTH - LEFT)).tolist()
    ticks = "".join(f"M{x:.1f} {BOTTOM}v5" for x in places)
    parts.append(element("path", class_="ticks", d=f"M{LEFT} {TOP}V{BOTTOM}H{WIDTH}{ticks}"))
    parts += [
        label(x, BOTTOM + 18, f"{mark % 360:.0f}°", "right" if x > WIDTH - 14.0 else "middle")
        for x, mark in zip(places, marks.tolist(), strict=True)
    ]
    parts.append(label(LEFT, BOTTOM + 36, Text("azimuth")))
    low, high = range_limits_m(range_m, shown)
    if np.isfinite(low):
        left = WIDTH - 250.0
        right = WIDTH - 110.0
        y = BOTTOM + 26.0
        colours = _colours(np.linspace(0.0, 1.0, 64))[None].astype(np.uint8)
        parts.append(label(left - 6, y + 10, Text("range {low:.1f} m", low=low), "right"))
        parts.append(image(left, y, right, y + 11, colours))
        parts.append(label(right + 6, y + 10, figure_text(f"{high:.1f} m")))
    return drawing(WIDTH, BOTTOM + 42.0, parts, title)


def range_limits_m(range_m: NDArray[np.float32], shown: NDArray[np.bool_] | None) -> tuple[float, float]:
    """The ranges of the first and the last colour: the 2nd and 98th percentile of what is shown; nan for nothing."""
    known = np.isfinite(range_m)
    if not known.any():
        return float("nan"), float("nan")
    chosen = shown & known if shown is not None else known
    low, high = np.quantile(range_m[chosen if chosen.any() else known], (0.02, 0.98))
    return float(low), float(high)


def range_picture(range_m: NDArray[np.float32], shown: NDArray[np.bool_] | None) -> NDArray[np.uint8]:
    """Colours (lasers, n, 3) by range, the highest laser on top; what is not shown is pale."""
    known = np.isfinite(range_m)
    low, high = range_limits_m(range_m, shown)
    if not known.any():
        return np.full((*range_m.shape, 3), 238, np.uint8)
    chosen = shown & known if shown is not None else known
    share = np.clip((np.where(known, range_m, high) - low) / max(high - low, 1e-3), 0.0, 1.0)
    colour = _colours(share)
    colour = np.where(chosen[..., None], colour, 0.25 * colour + 0.75 * _NO_RETURN)
    picture: NDArray[np.uint8] = np.where(known[..., None], colour, _NO_RETURN)[::-1].astype(np.uint8)
    return picture


def _colours(share: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.stack([np.interp(share, (0.0, 0.5, 1.0), channel) for channel in _NEAR_TO_FAR.T], axis=-1)


MAX_ROWS: Final = 60
"""Maximum length of the tables of passes and strips."""


def write_page(
    path: Path,
    found: RunResult,
    cloud: Path,
    summary: CopcSummary | None,
    rasters: RasterFigures | None,
    of_tools: Mapping[str, Any],
) -> None:
    """Write `report.html`.

    Args:
        cloud: its COPC file, for the relief of the map.
        summary: of the cloud; None for no cloud.
        rasters: figures of the surfaces; None for no surfaces.
        of_tools: values for the template: `heights_m` of the parcels and `parcels`, their section; `features`, the
            numbers of planes, lines and plants; `control`, the section of control points; `live`.
    """
    poses = found.placement.poses
    work = found.work
    box_m = drawings.map_box(poses, work)

    def texts(finding: Finding) -> tuple[str, list[str]]:
        first, *follows = (notice_in_page(notice, found.zone) for notice in finding.all)
        return first, follows

    east, north, up, roll, pitch, heading = (_median(column) for column in poses.sigma.T)
    lowering = _median(work.states.begin_sigma_s[1:]) if work.states is not None and len(work.states) > 1 else None
    fixes = [
        (drawings.fix_colour(fix), Text("{fix} {share:.0%}", fix=_fix_words(fix), share=count / len(poses)))
        for fix, count in Counter(poses.fix.tolist()).most_common()
    ]
    working = drawings.poses_at_work(poses, work)
    active = set(drawings.activities(working, work).tolist()) if working is not None else set()
    page = render(
        "report.html",
        summary=summary_words,
        title=found.session.name or Text("Field report"),
        when=span_words(found.placement.first_s, found.placement.last_s, found.zone),
        alarms=[texts(finding) for finding in top_findings(found)],
        warnings=[texts(finding) for finding in findings(found.notices)],
        found=found,
        scanners=scanners(found),
        zone=found.zone,
        poses=poses,
        working=working,
        draw=drawings,
        range_images=range_images,
        box_m=box_m,
        relief=shaded_ground(cloud, summary.points_by_level, box_m) if summary is not None else None,
        **{"heights_m": (), "parcels": "", "features": None, "control": "", "live": None, **of_tools},
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
        PointClass=PointClass,
        max_rows=MAX_ROWS,
    )
    report = found.session.report
    write_html(path, page, language_of_user(report.language), report.area_unit)


def summary_words(figures: WorkFigures) -> Text:
    """What was worked, worked twice and missed, in a sentence."""
    area_m2 = figures.worked.grid_m2
    worked = area(area_m2)
    parts = [
        Text("{area} worked in {passes} pass", area=worked, passes=figures.passes)
        if figures.passes == 1
        else Text("{area} worked in {passes} passes", area=worked, passes=figures.passes)
    ]
    if area_m2 > 0.0:
        parts.append(Text("{share} of it twice", share=number(figures.overlap.grid_m2 / area_m2, "{:.1%}")))
    if figures.missed.grid_m2 > 0.0:
        parts.append(Text("{area} missed between", area=area(figures.missed.grid_m2)))
    else:
        parts.append(Text("no strip missed"))
    if figures.field is not None:
        share = number(figures.field.worked_share, "{:.1%}")
        field = area(figures.field.area.grid_m2)
        parts.append(Text("{share} of the field ({field}) worked", share=share, field=field))
        if figures.field.unworked.grid_m2 > 0.0:
            parts.append(Text("{area} of it not worked yet", area=area(figures.field.unworked.grid_m2)))
    return Text("{parts}.", parts=parts)


def _strip_graphs(found: RunResult) -> Iterator[tuple[Markup, Text]]:
    """Histograms of the differences of strips before and after the mounting was estimated, in one scale."""
    if found.strip_differences is None:
        return
    both = found.strip_differences.figures()
    reach_m = max((drawings.half_width_m(figures) for figures in both if figures is not None), default=0.0)
    titles = (
        Text("Share of the ground by difference, as the session states the mounting."),
        Text("Share of the ground by difference, with the mounting that was used."),
    )
    for figures, title in zip(both, titles, strict=True):
        if figures is not None:
            yield drawings.swath_histogram(figures, reach_m), title


def _fix_words(fix: int) -> Text:
    return label_text(VALUES["fix"].get(Fix(fix).label, "other") if fix in list(Fix) else "from a file")


def _median(values: NDArray[np.float64]) -> float:
    known = values[np.isfinite(values)]
    return float(np.median(known)) if len(known) else float("nan")
