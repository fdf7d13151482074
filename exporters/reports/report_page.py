"""`report.html`: the result of a run on one page without external resources."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from importlib.metadata import version
from pathlib import Path
from typing import Final
from zoneinfo import ZoneInfo

import numpy as np
from numpy.typing import NDArray

from furrowmap.core.crops.measure import MeasuredParcel
from furrowmap.core.geodesy.local_time import clock_words, in_local_time, span_words
from furrowmap.core.geodesy.projection import MapFrame
from furrowmap.core.pipeline.run_result import RunResult
from furrowmap.core.runtime.languages.choice import language_of_user
from furrowmap.core.surfaces.visits import SwathDifferences
from furrowmap.core.values.gnss import Fix
from furrowmap.core.values.point_classes import PointClass
from furrowmap.core.values.scan_poses import ScanPoses
from furrowmap.core.work.field_work import FieldWork
from furrowmap.core.work.ground import Area, FieldFigures
from furrowmap.exporters.cloud.writer import CopcSummary
from furrowmap.exporters.files.atomic import atomic_output
from furrowmap.exporters.rasters.field_rasters import RasterFigures
from furrowmap.exporters.rasters.relief import Box, Relief, shaded_ground
from furrowmap.exporters.reports.area_units import area, filled_in, work_rate
from furrowmap.exporters.reports.drawings import (
    ACTIVITIES,
    activities,
    activity_graph,
    fix_colour,
    map_box,
    pass_colour,
    quality_graph,
    quality_map,
    tool_graph,
    work_map,
)
from furrowmap.exporters.reports.flight_page import flight_sections
from furrowmap.exporters.reports.image_section import image_sections
from furrowmap.exporters.reports.page_language import in_language
from furrowmap.exporters.reports.page_parts import (
    alarm,
    duration_words,
    escape,
    figure,
    filled,
    key,
    key_figure,
    remark,
    section,
    table,
)
from furrowmap.exporters.reports.parcel_section import parcel_sections
from furrowmap.exporters.reports.range_images import range_images
from furrowmap.exporters.reports.run_report import points_by_class, verdict
from furrowmap.exporters.reports.swath_drawing import swath_histogram

MOST_PASSES: Final = 60
"""Maximum length of the table of passes."""
_FIX_WORDS: Final = {
    Fix.FIXED: "RTK fixed",
    Fix.FLOAT: "RTK float",
    Fix.PPP: "PPP",
    Fix.DGPS: "differential",
    Fix.SINGLE: "single",
    Fix.NONE: "no position",
}


def write_page(
    path: Path,
    found: RunResult,
    cloud: Path,
    summary: CopcSummary | None,
    rasters: RasterFigures | None,
    parcels: Sequence[MeasuredParcel] = (),
    features: Mapping[str, int] | None = None,
) -> None:
    """Write `report.html`.

    Args:
        found: result of the run.
        cloud: its COPC file, for the relief of the map.
        summary: of the cloud; None for no cloud.
        rasters: figures of the surfaces; None for no surfaces.
        parcels: with their crops.
        features: numbers of planes, lines and plants; None where they were not looked for.

    Raises:
        OSError: if a file cannot be read or written.
    """
    poses, work = found.placement.poses, found.work
    box_m = map_box(poses, work)
    relief = shaded_ground(cloud, summary.points_by_level, box_m) if summary is not None else None
    sections = [
        *_maps(found, box_m, relief),
        *_tools(work),
        *parcel_sections(parcels),
        *_features(features),
        *(part for one in work.each for part in _tool(one, alone=not work.others)),
        *_activity(poses, work),
        *(part for one in work.each for part in _passes(one, found.zone, alone=not work.others)),
        section("GNSS", _quality(poses, found.frame)),
        section("Accuracy and warnings", _accuracy(found)),
        *image_sections(found.image_aid),
        *(flight_sections(rasters.strips, found) if rasters is not None and rasters.strips else ()),
        *_swaths(rasters.swaths if rasters is not None else None),
        *(part for one in work.each for part in _views(one, alone=not work.others)),
        *_classes(summary),
    ]
    page = filled(
        title=escape(found.session.name or "Field report"),
        when=escape(span_words(found.placement.first_s, found.placement.last_s, found.zone)),
        summary=_summary(found),
        figures=_figures(found),
        sections=sections,
        provenance=_provenance(found),
        alarm="".join(alarm(text) for text in (verdict(found)["text"] or "", *verdict(found)["doubts"])),
    )
    report = found.session.report
    page = in_language(filled_in(page, report.area_unit), language_of_user(report.language))
    with atomic_output(path) as unfinished:
        unfinished.write_text(page, encoding="utf-8", errors="xmlcharrefreplace")


def _maps(found: RunResult, box_m: Box, relief: Relief | None) -> Iterator[str]:
    """A map of the ground that each tool worked."""
    for work in found.work.each:
        sheet = f'<div class="maps">{work_map(box_m, found.placement.poses, work, relief)}</div>'
        yield section(_of("Map", work, alone=not found.work.others), sheet + _map_key(work, relief))


def _tools(work: FieldWork) -> Iterator[str]:
    """The tools side by side, where there are several."""
    if not work.others:
        return
    head = ("tool", "worked", "±", "worked twice", "missed", "passes", "states")
    rows = []
    for one in work.each:
        states = "unknown" if one.states is None else "from files" if one.external is not None else "from the scans"
        figures = one.ground.figures if one.ground is not None else None
        areas = ["unknown"] * 5
        if figures is not None:
            measured = (area(found.grid_m2) for found in (figures.overlap, figures.missed))
            worked = (area(figures.worked.grid_m2), area(2.0 * figures.worked.sigma_m2))
            areas = [*worked, *measured, str(figures.passes)]
        rows.append((one.tool, *areas, states))
    note = (
        "Each tool works with its own width and place, and is lowered and lifted at its own times. The first moves the "
        "soil: change, depth and the figures at the top of the page are of it."
    )
    yield section("Tools", f'<div class="scroll">{table(head, rows)}</div>{remark(note)}')


def _of(title: str, work: FieldWork, *, alone: bool) -> str:
    """The title of a section, with the name of the tool where there are several."""
    return title if alone else f"{title}: {work.tool}"


def _features(counts: Mapping[str, int] | None) -> Iterator[str]:
    if counts is None:
        return
    rows = [[name.replace("_", " "), f"{count:,}"] for name, count in counts.items()]
    words = "Found in the cloud by the shape around each point: layers planes, lines and plants of field.gpkg."
    yield section("Features", table(["feature", "number"], rows) + remark(words))


def _summary(found: RunResult) -> str:
    """The session in a sentence or two."""
    ground = found.work.ground
    if ground is None:
        reason = " Whether an implement worked it is unknown; the warnings below give the reason."
        return f"The ground is mapped.{reason if found.work.notices else ''}"
    worked, missed = ground.figures.worked, ground.figures.missed
    if not ground.passes:
        return "The implement was never in the ground."
    parts = [f"{area(worked.grid_m2)} worked in {ground.figures.passes} passes"]
    if worked.grid_m2 > 0.0:
        parts.append(f"{ground.figures.overlap.grid_m2 / worked.grid_m2:.1%} of it twice")
    parts.append(f"{area(missed.grid_m2)} missed between" if missed.grid_m2 > 0.0 else "no strip missed")
    parts += _of_field(ground.figures.field)
    return f"<b>{escape(', '.join(parts))}.</b>"


def _of_field(field: FieldFigures | None) -> Iterable[str]:
    """How much of the field was worked, where its boundary is known."""
    if field is not None:
        yield f"{field.worked_share:.1%} of the field ({area(field.area.grid_m2)}) worked"
        if field.unworked.grid_m2 > 0.0:
            yield f"{area(field.unworked.grid_m2)} of it not worked yet"


def _figures(found: RunResult) -> Iterable[str]:
    ground = found.work.ground
    if ground is not None:
        figures = ground.figures
        yield key_figure(area(figures.worked.grid_m2), f"worked {_margin(figures.worked)}")
        yield key_figure(area(figures.overlap.grid_m2), f"worked twice {_margin(figures.overlap)}")
        missed = figures.missed.grid_m2 > 0.0
        yield key_figure(area(figures.missed.grid_m2), f"missed {_margin(figures.missed)}", loud=missed)
        if figures.field is not None:
            field, left = figures.field.area, figures.field.unworked
            yield key_figure(area(left.grid_m2), f"not worked {_margin(left)}, of {area(field.grid_m2)} of field")
        yield key_figure(str(figures.passes), "passes")
        yield key_figure(duration_words(figures.hours.field_s), "in the field")
        yield key_figure(work_rate(figures.work_rate_ha_h), "work rate, turns and stops included")
        yield key_figure(_number(3.6 * figures.speed_mps, 1, " km/h"), "mean speed at work")
        yield key_figure(duration_words(figures.hours.turning_s), "turning and reversing")
        yield key_figure(duration_words(figures.hours.idle_s), "standing")
    else:
        yield key_figure(duration_words(found.placement.last_s - found.placement.first_s), "recorded")
    if found.placement.points:
        yield key_figure(f"{found.placement.points / 1e6:.1f} million", "points in the cloud")


def _map_key(work: FieldWork, relief: Relief | None) -> str:
    if work.ground is None:
        return key([("#8c460a", "path of the vehicle")])
    count = len(work.ground.passes)
    rows = [(pass_colour(1, count), "first pass"), (pass_colour(count, count), "last pass")] if count > 1 else []
    rows += [("#e31a1c", "worked twice"), ("#ffed00", "missed"), ("#8c460a", "tool down"), ("#4292c6", "tool up")]
    note = "Areas in the map's plane."
    if relief is not None:
        note += " The relief is lit from the north-west."
    return key(rows) + remark(note)


def _tool(work: FieldWork, *, alone: bool) -> Iterable[str]:
    """The implement over time."""
    history = work.history
    if history is None or not len(history.t_s):
        return
    note = (
        f"Height of the tool above its working position, measured by the scanner. Below the red line "
        f"({100 * history.threshold_m:.0f} cm) it is in the ground; lifted, it is {100 * history.lifted_m:.0f} cm up. "
        "Brown: in the ground. Blue: lifted. Grey: unknown. Numbers: passes."
    )
    yield section(_of("The implement", work, alone=alone), figure(tool_graph(work), note))


def _activity(poses: ScanPoses, work: FieldWork) -> Iterable[str]:
    """What the vehicle did over time."""
    if len(poses) < 2:
        return
    seen = set(activities(poses, work).tolist())
    rows = [(colour, name) for number, (name, colour) in enumerate(ACTIVITIES.items()) if number in seen]
    note = "What the vehicle did, by its motion and the state of the tool. Gaps: no position."
    yield section("Activity", figure(activity_graph(poses, work), note) + key(rows))


def _passes(work: FieldWork, zone: ZoneInfo, *, alone: bool) -> Iterable[str]:
    """The table of passes."""
    ground = work.ground
    if ground is None or not ground.passes:
        return
    head = ("pass", "from", "to", "length", "area", "±", "speed", "depth (approximate)", "±")
    rows = [
        (
            str(one.number),
            clock_words(one.times.begin_s, zone),
            clock_words(one.times.end_s, zone),
            _number(one.length_m, 1, " m"),
            area(one.area.grid_m2),
            area(2.0 * one.area.sigma_m2),
            _number(3.6 * one.speed_mps, 1, " km/h"),
            _number(100.0 * depth.depth_m, 0, " cm"),
            _number(200.0 * depth.sigma_m, 0, " cm"),
        )
        for one, depth in zip(ground.passes[:MOST_PASSES], work.depths, strict=False)
    ]
    more = len(ground.passes) - len(rows)
    note = (
        "Depth is approximate: the tool's height relative to the soil beside it; its mean is the session's working "
        "depth, and ± holds if that is right."
    )
    if more:
        note = f"{more} more passes are in the layer passes of field.gpkg. {note}"
    yield section(_of("Passes", work, alone=alone), f'<div class="scroll">{table(head, rows)}</div>{remark(note)}')


def _classes(cloud: CopcSummary | None) -> Iterable[str]:
    """Classes of the cloud's points."""
    if cloud is None or not cloud.points:
        return
    rows = [
        (f"{name} ({PointClass[name.upper()].value})", f"{count:,}", f"{count / cloud.points:.1%}")
        for name, count in points_by_class(cloud).items()
    ]
    note = "In brackets: number of the class in the cloud. Noise: isolated returns in the air, or below the ground."
    yield section("Point classes", table(("class", "points", "share"), rows) + remark(note))


def _quality(poses: ScanPoses, frame: MapFrame) -> str:
    shares = Counter(poses.fix.tolist())
    rows = [
        (fix_colour(fix), f"{_fix_word(fix)} {count / len(poses):.0%}")
        for fix, count in sorted(shares.items(), key=lambda item: -item[1])
    ]
    note = (
        f"Quality of the positions (top bar) and their stated standard deviation over time; below, on the map. "
        f"CRS: {frame.name}."
    )
    return f'{figure(quality_graph(poses), note)}<div class="maps small">{quality_map(poses)}</div>{key(rows)}'


def _fix_word(fix: int) -> str:
    return _FIX_WORDS.get(Fix(fix), "other") if fix in list(Fix) else "from a file"


def _accuracy(found: RunResult) -> str:
    poses, work = found.placement.poses, found.work
    east, north, up, roll, pitch, heading = (_median(column) for column in poses.sigma.T)
    rows = [
        ("position, horizontal", _number(100.0 * math.hypot(east, north), 1, " cm")),
        ("height", _number(100.0 * up, 1, " cm")),
        ("roll, pitch", f"{_number(roll, 2, '°')}, {_number(pitch, 2, '°')}"),
        ("heading", _number(heading, 2, "°")),
    ]
    if work.states is not None and len(work.states) > 1:
        rows.append(("lowering and lifting", _number(_median(work.states.begin_sigma_s[1:]), 3, " s")))
    if work.ground is not None:
        worked = work.ground.figures.worked
        rows.append(("worked, in the map's plane", f"{area(worked.grid_m2)} {_margin(worked)}"))
        rows.append(("worked, on the ellipsoid", area(worked.ellipsoid_m2)))
    sigmas = table(("median standard deviation", ""), rows) + _conditions(found)
    notes = "".join(f"<li>{escape(in_local_time(notice.text, found.zone))}</li>" for notice in found.notices)
    listed = f'<ul class="warnings">{notes}</ul>' if notes else "<p>No warnings.</p>"
    return sigmas + remark("On this page, ± is twice the standard deviation (95 % confidence).") + listed


def _conditions(found: RunResult) -> str:
    """What the standard deviations rest on, and why there are none."""
    missing, unsure = found.session.unstated, found.unconfirmed
    if missing:
        return remark(f"No accuracy is stated, because the session leaves out {', '.join(missing)}.")
    if unsure:
        return remark(
            f"These figures hold if {', '.join(unsure)} in the session is right: the recording does not show it."
        )
    return ""


def _swaths(swaths: SwathDifferences | None) -> Iterable[str]:
    """Height differences between swaths: a check without a survey."""
    if swaths is None:
        return
    rows = [
        ("ground compared", area(swaths.area_m2)),
        ("half of it within", _number(1000.0 * swaths.within_m(0.5), 1, " mm")),
        ("95 % of it within", _number(1000.0 * swaths.within_m(0.95), 1, " mm")),
        ("mean", f"{1000.0 * swaths.mean_m:+.1f} mm"),
        ("root mean square", _number(1000.0 * swaths.rms_m, 1, " mm")),
    ]
    note = (
        "Height differences of ground that the scanner saw several times without the tool passing in between, later "
        "minus earlier. Errors common to all swaths do not show."
    )
    graph = figure(swath_histogram(swaths), "Share of the ground by difference. Map: swaths.tif.")
    yield section("The same ground seen again", table(("later minus earlier", ""), rows) + graph + remark(note))


def _views(work: FieldWork, *, alone: bool) -> Iterable[str]:
    """Range images of the implement and of the vehicle itself."""
    seen = work.seen
    if seen is None:
        return
    note = (
        "Range images: a row for each laser, the highest on top, azimuth from left to right. Yellow is near, violet "
        "far; everything but the implement is pale."
    )
    yield section(_of("What the scanner sees of the implement", work, alone=alone), range_images(seen) + remark(note))


def _provenance(found: RunResult) -> str:
    names = ", ".join(path.name for path in found.inputs)
    cloud = " Cloud: cloud.copc.laz." if found.placement.points else ""
    return (
        f"furrowmap {escape(version('furrowmap'))}, from {escape(names)}. Coordinates: {escape(found.frame.name)}. "
        f"{escape(f'{found.frame.words} ' if found.frame.words else '')}"
        f"All figures and the inputs' checksums: report.json. Layers: field.gpkg.{cloud}"
    )


def _margin(found: Area) -> str:
    return f"± {area(2.0 * found.sigma_m2)}" if found.grid_m2 > 0.0 and math.isfinite(found.sigma_m2) else ""


def _number(value: float, digits: int, unit: str) -> str:
    return f"{value:.{digits}f}{unit}" if math.isfinite(value) else "unknown"


def _median(values: NDArray[np.float64]) -> float:
    known = values[np.isfinite(values)]
    return float(np.median(known)) if len(known) else float("nan")
