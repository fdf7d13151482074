"""`report.json`: inputs, figures and accuracy of a run."""

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from importlib.metadata import version
from pathlib import Path
from typing import Any, Final
from zoneinfo import ZoneInfo

import msgspec
import numpy as np
from numpy.typing import NDArray

from furrowmap.core.coverage.field_work import FieldWork
from furrowmap.core.coverage.strip_outlines import StripGround
from furrowmap.core.coverage.worked_ground import AreaFigure, WorkedGround
from furrowmap.core.geodesy.local_time import in_local_time, local_time
from furrowmap.core.implement.external_states import NEAR_S
from furrowmap.core.matching.consistency import Cause
from furrowmap.core.pipeline.causes import AT_TOP, DAMAGED, Finding, cause_of, findings, is_one_of
from furrowmap.core.pipeline.notices import fix_shares
from furrowmap.core.pipeline.run_result import RunResult
from furrowmap.core.runtime.errors import CHECK_POINTS_OFF, CONTRADICTION, Notice
from furrowmap.core.runtime.json_text import json_text, plain
from furrowmap.core.runtime.languages.texts import LANGUAGES
from furrowmap.core.strips.boresight import BORESIGHT_NAMES, Boresight
from furrowmap.core.trajectory.vehicle_motion import distance_and_standing
from furrowmap.core.values.clock import iso_utc
from furrowmap.core.values.images import CONTRADICTING
from furrowmap.core.values.scan import PointClass, named_offset
from furrowmap.core.values.tool_states import SectionStates, ToolState
from furrowmap.core.values.trajectory import SIGMA_NAMES
from furrowmap.exporters.cloud.writer import CopcSummary
from furrowmap.exporters.files.atomic import atomic_output
from furrowmap.exporters.files.file_records import FileRecord
from furrowmap.exporters.files.provenance import Origin
from furrowmap.exporters.rasters.field_rasters import RasterFigures

REPORT_SCHEMA: Final = 1
_SIGMA_DIGITS: Final = 6
"""Decimals of standard deviations, of which two digits are shown as a margin everywhere."""


def run_report(
    found: RunResult,
    session_file: str,
    cloud: CopcSummary | None,
    rasters: RasterFigures | None,
    inputs: Sequence[FileRecord],
    timings_s: dict[str, float],
    products: Sequence[str],
) -> dict[str, Any]:
    """The content of `report.json`; `session_file` is the path to the session from the products."""
    calibration = {"lidar": _scanner_mounting(found.boresight)} if found.boresight is not None else {}
    if found.further_scanners:
        calibration["scanners"] = {name: mounting.plain() for name, mounting in found.further_scanners.items()}
    calibration |= {"camera": found.image_aid.calibration()} if found.image_aid is not None else {}
    return {
        "session_file": session_file,
        "verdict": verdict(found),
        "session": msgspec.to_builtins(found.session),
        "inputs": inputs,
        "figures": _figures(found, cloud) | (rasters.plain() if rasters is not None else {}),
        "coordinates": found.located.transformed.account(found.frame),
        "accuracy": _accuracy(found) | {"swaths": rasters.swaths.plain() if rasters and rasters.swaths else None},
        "observability": _observability(found),
        "inertial": found.located.inertial,
        "calibration": calibration or None,
        "strips": [_strip(ground) for ground in rasters.strips] if rasters is not None else [],
        "strip_differences": found.strip_differences.plain() if found.strip_differences is not None else None,
        "image_adjustment": found.image_aid.plain() if found.image_aid is not None else None,
        "strip_adjustment": found.strip_adjustment.plain() if found.strip_adjustment is not None else None,
        "live": None,
        "clocks": _clocks(found),
        "warnings": [
            in_all_languages(notice, found.zone)
            | {"follows": cause.code if cause is not None else None, "damaged": is_one_of(notice, DAMAGED)}
            for notice in found.notices
            for cause in [cause_of(notice, found.notices)]
        ],
        "timings": timings_s,
        "products": products,
        "colours": None,
    }


def _scanner_mounting(found: Boresight) -> dict[str, Any]:
    """What the recording shows of the mounting of the scanner."""
    return {
        "rpy_deg": [round(angle, 5) for angle in found.mounting.rpy_deg],
        "sigma_deg": [round(sigma, 5) for sigma in found.sigma_deg],
        "correction_deg": [round(angle, 5) for angle in found.correction_deg],
        "xyz_m": [round(place, 4) for place in found.mounting.xyz_m],
        "time_offset_s": [round(value, 6) for value in found.time_offset_s],
        "time_offset_used_s": round(found.clock_used_s if found.certain else 0.0, 6),
        "scatter_m": [round(value, 4) for value in found.scatter_m],
        "cells": found.cells,
        "used": found.certain,
        "together": {
            "parameters": BORESIGHT_NAMES,
            "value": [round(value, 6) for value in found.free.value.tolist()],
            "sigma": [round(value, 6) for value in found.free.sigma.tolist()],
            "correlation": found.free.correlation.round(3).tolist(),
            "not_observed": [name for name, seen in zip(BORESIGHT_NAMES, found.free.observed, strict=True) if not seen],
        },
    }


def _strip(ground: StripGround) -> dict[str, Any]:
    strip = ground.strip
    return {
        "strip": strip.number,
        "start": iso_utc(strip.begin_s),
        "end": iso_utc(strip.end_s),
        "heading_deg": round(strip.heading_deg, 1),
        "length_m": round(strip.length_m, 2),
        "speed_mps": round(strip.speed_mps, 2),
        "points": ground.points,
        "area_m2": round(ground.area_m2, 1),
        "points_m2": round(ground.points_m2, 1),
    }


FLIGHT_CAUSES: Final = {
    "contradiction.scans-and-positions": "mounting",
    "contradiction.scattered-ground": "unknown",
    "contradiction.height-creep": "creep",
    "contradiction.scatter": "positions",
    "contradiction.positions-late": "clock",
    "contradiction.elevations-of-another": "model",
    "contradiction.turned-scanner": "mounting",
    "contradiction.positions-err": "positions",
    "contradiction.force-scatters": "unknown",
    "imu-turned": "mounting",
    "geoid-separation": "geoid",
    "gnss-height-steps": "positions",
    "control-points-contradict": "control-points",
    "ground-control-contradicts": "control-points",
    "parcels-beside-crop": "parcels",
    "treatments-order": "treatments",
    CONTRADICTING: "camera",
    CHECK_POINTS_OFF: "check-points",
}
"""Codes of contradictions without matching beside those of CONTRADICTION, and the cause that each names."""


_BESIDE_MATCHING: Final = ("gnss-height-steps", "ground-control-contradicts", CHECK_POINTS_OFF)
MATCHED_CAUSES: Final = {code: FLIGHT_CAUSES[code] for code in _BESIDE_MATCHING}
"""Those that scan matching leaves standing."""


def verdict(found: RunResult) -> dict[str, Any]:
    """Whether the results agree with each other, and what was corrected or assumed.

    `consistent` is null where nothing was matched, and there is no IMU whose measurements could contradict positions.
    """
    contradictions = _contradictions(found)
    text = next((in_local_time(notice.text, found.zone) for notice in contradictions), None)
    if found.matched is not None:
        seen = found.matched.seen.plain()
        if contradictions:
            beside = next((MATCHED_CAUSES[n.code] for n in contradictions if n.code in MATCHED_CAUSES), None)
            known = seen["cause"] not in (None, Cause.UNKNOWN)
            seen |= {"consistent": False, "cause": seen["cause"] if known else beside or seen["cause"]}
    else:
        kinds = [FLIGHT_CAUSES.get(n.code, FLIGHT_CAUSES.get(n.key, n.key.partition(".")[2])) for n in contradictions]
        seen = {"consistent": not kinds if found.located.source == "imu" or kinds else None}
        seen |= {"cause": kinds[0] if kinds else None, "causes": kinds} if seen["consistent"] is not None else {}
    doubtful = [*contradictions[1:], *(notice for notice in found.notices if is_one_of(notice, AT_TOP))]
    doubts = [in_local_time(notice.text, found.zone) for notice in doubtful]
    others: dict[str, Any] = {}
    for language in LANGUAGES[1:]:
        first = contradictions[0].text_in(language) if contradictions else None
        others[f"text_{language}"] = in_local_time(first, found.zone) if first is not None else None
        others[f"doubts_{language}"] = [in_local_time(doubt.text_in(language), found.zone) for doubt in doubtful]
    shown = [
        in_all_languages(finding.notice, found.zone)
        | {"follows": [in_all_languages(notice, found.zone) for notice in finding.follows]}
        for finding in top_findings(found)
    ]
    seen = {"consistent": False if text else None, **seen, "text": text, "doubts": doubts, **others}
    return seen | {"findings": shown}


def _contradictions(found: RunResult) -> list[Notice]:
    """The contradictions in the results, the first of which the verdict states."""
    codes = [CONTRADICTION, *(FLIGHT_CAUSES if found.matched is None else MATCHED_CAUSES)]
    return sorted((n for n in found.notices if n.code in codes), key=lambda notice: codes.index(notice.code))


def top_findings(found: RunResult) -> list[Finding]:
    """What stands at the top of reports, each cause with what follows from it: what to do first comes first."""
    contradictions = _contradictions(found)
    return [
        finding
        for finding in findings(found.notices)
        if any(is_one_of(notice, AT_TOP) or notice in contradictions for notice in finding.all)
    ]


def in_all_languages(notice: Notice, zone: ZoneInfo) -> dict[str, Any]:
    """A warning for a report: its code and values, its text, and that in every other language, such as `text_ja`."""
    texts = {key: in_local_time(text, zone) for key, text in notice.texts.items()}
    return {"code": notice.code, "values": dict(notice.values), **texts}


def write_report(path: Path, report: Mapping[str, Any]) -> dict[str, Any]:
    """Write a report with the versions of program and schema; returns the content of the file."""
    content = {"furrowmap": version("furrowmap"), "schema": REPORT_SCHEMA, **plain(report)}
    with atomic_output(path) as unfinished:
        unfinished.write_text(json_text(content), encoding="utf-8")
    return content


def run_origin(found: RunResult, inputs: Sequence[FileRecord]) -> Origin:
    """Provenance of the products of a run."""
    frame = found.frame
    session = found.session
    parameters = {"coordinates": session.crs.coordinates, "heights": frame.heights.name}
    if frame.heights.vertical is not None:
        parameters["geoid"] = frame.heights.source
    if frame.parameters is not None:
        parameters["epoch_parameters"] = frame.parameters.name
    if session.field.within is not None:
        parameters["within"] = session.field.within
    if session.unstated:
        parameters["not_stated"] = f"{', '.join(session.unstated)}: assumed to be zero, so the accuracy is unknown"
    if frame.stated is not None:
        parameters["coordinate_epoch"] = f"{frame.stated.epoch:.10g}"
    return Origin(
        session.name,
        session.name,
        [(record.name, record.sha256) for record in inputs],
        (found.placement.first_s, found.placement.last_s),
        parameters,
    )


def _figures(found: RunResult, cloud: CopcSummary | None) -> dict[str, Any]:
    """Counts, times and lengths."""
    placement = found.placement
    xyz_m = placement.poses.xyz_m
    bounds_m = (
        (cloud.low_m, cloud.high_m) if cloud is not None else (xyz_m.min(axis=0).tolist(), xyz_m.max(axis=0).tolist())
    )
    distance_m, standing_s = distance_and_standing(found.located.trajectory, placement.first_s, placement.last_s)
    return {
        "points": placement.points,
        "points_by_class": points_by_class(cloud) if cloud is not None else {},
        "points_read": placement.points_read,
        "points_without_pose": placement.points_without_pose,
        "points_standing_left_out": placement.points_standing,
        "points_elsewhere_left_out": placement.points_elsewhere,
        "scans": placement.scans,
        "scans_whole": placement.scans_whole,
        "scans_without_pose": placement.scans_without_pose,
        **({"scanners": scanners(found)} if found.further_scanners else {}),
        "start": iso_utc(placement.first_s),
        "end": iso_utc(placement.last_s),
        "time_zone": found.zone.key,
        "start_local": local_time(placement.first_s, found.zone).isoformat(timespec="milliseconds"),
        "end_local": local_time(placement.last_s, found.zone).isoformat(timespec="milliseconds"),
        "duration_s": round(placement.last_s - placement.first_s, 3),
        "distance_m": round(distance_m, 2),
        "standing_s": round(standing_s, 1),
        "fix": fix_shares(placement.poses),
        "crs": found.frame.name,
        "heights": found.session.crs.heights,
        "bounds_m": [[round(v, 3) for v in corner] for corner in bounds_m],
        "implement": _implement(found.work),
        **_worked(found.work.ground),
        **(
            {
                "tools": [
                    {"name": work.tool, "implement": _implement(work), **_worked(work.ground)}
                    for work in found.work.each
                ]
            }
            if found.work.others
            else {}
        ),
    }


def scanners(found: RunResult) -> list[dict[str, Any]]:
    """Name, files, number of scans and of points in the cloud of each scanner; in whose scans the implement is seen."""
    placement = found.placement
    seeing = found.work.scanner if found.work.seen is not None else None
    lidars = found.session.lidars if placement.scans_of else ()  # positions alone have none
    return [
        {"name": lidar.name, "files": list(lidar.files), "scans": n, "points": points, "shows_implement": k == seeing}
        for k, (lidar, n, points) in enumerate(zip(lidars, placement.scans_of, placement.points_of, strict=True))
    ]


def points_by_class(cloud: CopcSummary) -> dict[str, int]:
    """Number of points by the name of their class: "ground", "other", "noise", "vehicle", "implement"."""
    return {kind.name.lower(): cloud.points_by_class.get(kind, 0) for kind in PointClass}


def _implement(work: FieldWork) -> dict[str, Any] | None:
    """Figures of the implement; None where its states are unknown."""
    history = work.history
    states = work.states
    agreed = work.state_comparison
    if states is None:
        return None
    length_s = states.end_s - states.begin_s
    sigma_s = states.begin_sigma_s[1:][states.begin_s[1:] == states.end_s[:-1]]
    return {
        **{f"{s.label}_s": round(float(length_s[states.state == s].sum()), 1) for s in (ToolState.DOWN, ToolState.UP)},
        "transitions": len(sigma_s),
        "transition_sigma_s": round(float(np.median(sigma_s)), 3) if len(sigma_s) else None,
        "threshold_m": round(history.threshold_m, 3) if history is not None else None,
        "lifted_m": round(history.lifted_m, 3) if history is not None else None,
        "states_from": "elsewhere" if work.external is not None else "scans",
        "sections": [figures for one in states.sections for figures in _sections(one)] or None,
        "agreement": {
            "compared_s": round(agreed.compared_s, 1),
            "share": round(agreed.share, 4),
            "differing": [[iso_utc(a), iso_utc(b)] for a, b in agreed.differing_s.tolist() if b - a > NEAR_S],
        }
        if agreed is not None
        else None,
    }


def _sections(states: SectionStates) -> list[dict[str, Any]]:
    """The sections of one implement from left to right, the places of their middles from the middle of all."""
    return [
        {
            "name": section.name,
            "left_m": round(section.y_m - states.middle_m[1], 3),
            "width_m": round(section.width_m, 3),
            "working_s": round(working_s, 1),
        }
        for section, working_s in zip(states.sections, states.working_s.tolist(), strict=True)
    ]


def _worked(ground: WorkedGround | None) -> dict[str, Any]:
    """Figures of the worked ground; none where work is unknown."""
    if ground is None:
        return {}
    worked = ground.figures
    hours = ground.figures.hours
    zones = {
        kind: sum(zone.area.grid_m2 for zone in ground.zones if zone.kind == kind) for kind in ("headland", "body")
    }
    field = {}
    if worked.field is not None:
        share = {"worked_share": round(worked.field.worked_share, 4)}
        field = _area("field_area", worked.field.area) | share | _area("unworked_area", worked.field.unworked)
    return {
        **_area("worked_area", worked.worked),
        **_area("overlap_area", worked.overlap),
        **_area("missed_area", worked.missed),
        **field,
        "swept_area_m2": round(worked.swept_m2, 3),
        **{f"{kind}_area_m2": round(area_m2, 3) for kind, area_m2 in zones.items()},
        "passes": worked.passes,
        "unplaced_passes": worked.unplaced_passes,
        "worked_length_m": round(worked.length_m, 2),
        "working_speed_mps": round(worked.speed_mps, 3),
        "work_rate_ha_h": round(worked.work_rate_ha_h, 4),
        "hours": {name: round(value, 1) for name, value in asdict(hours).items()},
    }


def _area(name: str, area: AreaFigure) -> dict[str, float]:
    """An area in the map's plane, on the ellipsoid, and its standard deviation."""
    return {
        f"{name}_m2": round(area.grid_m2, 3),
        f"{name}_ellipsoid_m2": round(area.ellipsoid_m2, 3),
        f"{name}_sigma_m2": round(area.sigma_m2, _SIGMA_DIGITS),
    }


def _accuracy(found: RunResult) -> dict[str, Any]:
    """Median and 95th percentile of the poses' sigmas, None where unknown; which of them are assumed."""
    out: dict[str, Any] = {}
    for name, sigma in zip(SIGMA_NAMES, found.placement.poses.sigma.T, strict=True):
        known = sigma[np.isfinite(sigma)]
        quantiles = np.quantile(known, (0.5, 0.95)).round(_SIGMA_DIGITS).tolist() if len(known) else (None, None)
        out[f"sigma_{name}"] = dict(zip(("median", "p95"), quantiles, strict=True))
    level_assumed = found.located.source == "gnss" and found.matched is None
    assumed = ["sigma_roll_deg", "sigma_pitch_deg"] if level_assumed else []
    out |= {"assumed": assumed, "unstated": found.session.unstated, "unconfirmed": found.unconfirmed}
    return out | {"matching": found.matched.figures if found.matched is not None else None}


def _observability(found: RunResult) -> dict[str, Any]:
    """Source of each component of the poses, as shares of the scans."""
    poses = found.placement.poses

    def shares(words: NDArray[np.str_]) -> dict[str, float]:
        return {word: round(count / len(poses), 4) for word, count in Counter(words.tolist()).most_common()}

    level = shares(poses.level_from)
    return {
        "position": shares(poses.position_from),
        "height": shares(poses.height_from),
        "roll": level,
        "pitch": level,
        "heading": shares(poses.heading_from),
        "positions": found.located.positions,
        "gaps": [[iso_utc(a), iso_utc(b)] for a, b in found.located.trajectory.gaps_s.tolist()],
    }


def _clocks(found: RunResult) -> dict[str, Any]:
    """First and last time by each clock, and their offset: stated, estimated, used."""
    stated_s = found.session.recording.lidar_minus_gnss_s
    estimate = None
    used_s = 0.0
    if found.matched is not None:
        constants = found.matched.seen.constants
        used_s = found.matched.clock_used_s
        if math.isfinite(constants.clock_sigma_s):
            estimate = [round(stated_s + used_s + constants.clock_s, 4), round(constants.clock_sigma_s, 4)]
    if found.boresight is not None and found.boresight.certain:
        used_s -= found.boresight.clock_used_s
    track = found.located.trajectory.t_s
    inertial = found.located.inertial
    return {
        "lidar": [
            {"clock": c.clock, "first": iso_utc(c.first_s), "last": iso_utc(c.last_s), "note": c.note}
            for c in found.clocks
        ],
        "positions": {"first": iso_utc(float(track[0])), "last": iso_utc(float(track[-1]))},
        "lidar_minus_gnss_s": stated_s,
        "lidar_minus_gnss_estimated_s": estimate,
        "lidar_minus_gnss_used_s": round(stated_s + used_s, 4),
        "offset_cause": named_offset(used_s) or None,
        "imu_minus_gnss_used_s": inertial.minus_gnss_s if inertial is not None else None,
        "imu_minus_gnss_estimated_s": inertial.clock_estimate_s if inertial is not None else None,
    }
