"""The sections of a report page that a flight adds: its strips, and how the ground in them agrees."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Final
from zoneinfo import ZoneInfo

from furrowmap.core.adjustment.boresight import Boresight
from furrowmap.core.adjustment.strip_adjustment import StripAdjustment
from furrowmap.core.geodesy.local_time import clock_words
from furrowmap.core.pipeline.run_result import RunResult
from furrowmap.core.surfaces.visits import SwathDifferences
from furrowmap.core.work.strip_differences import StripDifferences
from furrowmap.core.work.strip_outlines import StripGround
from furrowmap.exporters.reports.page_parts import figure, remark, section, table
from furrowmap.exporters.reports.swath_drawing import half_width_m, swath_histogram

_PARAMETERS: Final = ("roll", "pitch", "yaw", "time", "x", "y", "z")
MOST_ROWS: Final = 60
"""Maximum length of a table."""


def flight_sections(grounds: Sequence[StripGround], found: RunResult) -> Iterator[str]:
    """Strips, their differences, and what they show of the scanner's mounting."""
    yield section("Strips", _strips(grounds, found.zone))
    if found.strip_differences is not None:
        yield section("Strips against each other", _differences(found.strip_differences))
    if found.strip_adjustment is not None:
        yield section("Poses adjusted by the strips", _adjusted(found.strip_adjustment))
    if found.boresight is not None:
        yield section("Mounting of the scanner", _mounting(found.boresight))


def _strips(grounds: Sequence[StripGround], zone: ZoneInfo) -> str:
    head = ("strip", "from", "to", "heading", "length", "speed", "points", "points/m²")
    rows = [
        (
            str(ground.strip.number),
            clock_words(ground.strip.begin_s, zone),
            clock_words(ground.strip.end_s, zone),
            f"{ground.strip.heading_deg:.0f}°",
            f"{ground.strip.length_m:.0f} m",
            f"{ground.strip.speed_mps:.1f} m/s",
            f"{ground.points:,}",
            f"{ground.points_m2:,.0f}",
        )
        for ground in grounds[:MOST_ROWS]
    ]
    note = (
        "Straight passes, turns apart. The number is the points' point_source_id; maps: density.tif, strip_overlap.tif."
    )
    if len(grounds) > len(rows):
        note = f"{len(grounds) - len(rows)} more strips are in the layer strips of field.gpkg. {note}"
    return f'<div class="scroll">{table(head, rows)}</div>{remark(note)}'


def _differences(differences: StripDifferences) -> str:
    before, after = differences.figures()
    graphs = ""
    reach_m = max((half_width_m(figures) for figures in (before, after) if figures is not None), default=0.0)
    for figures, title in ((before, "as the session states the mounting"), (after, "with the mounting that was used")):
        if figures is not None:
            graphs += figure(swath_histogram(figures, reach_m), f"Share of the ground by difference, {title}.")
    pairs = differences.pairs
    rows = []
    for a, b in pairs[:MOST_ROWS]:
        one, other = differences.of_pair((a, b)).figures()
        figures = other or one
        area = f"{figures.area_m2:.1f} m²" if figures is not None else ""
        rows.append((f"{a}, {b}", area, *_two(one), *_two(other)))
    head = ("strips", "ground", "mean before", "RMS before", "mean after", "RMS after")
    note = (
        "Height of smooth ground in a strip less that in an earlier one, in cells, before and after the mounting was "
        "estimated. Errors common to all strips do not show. Each cell: layer strip_differences of field.gpkg."
    )
    if len(pairs) > len(rows):
        note = f"{len(pairs) - len(rows)} more pairs are in report.json. {note}"
    return f'{graphs}<div class="scroll">{table(head, rows)}</div>{remark(note)}'


def _adjusted(found: StripAdjustment) -> str:
    """Standard deviations of the poses before and after."""
    told = found.plain()
    names = (("easting", "northing", "height"), ("roll", "pitch", "heading"))
    rows = [
        (name, f"{1000.0 * before:.1f} mm", f"{1000.0 * after:.1f} mm", f"{1000.0 * moved:.1f} mm")
        for name, before, after, moved in zip(
            names[0], told["sigma_before_m"], told["sigma_after_m"], told["moved_rms_m"], strict=True
        )
    ]
    rows += [
        (name, f"{before:.4f}°", f"{after:.4f}°", "")
        for name, before, after in zip(names[1], told["sigma_before_deg"], told["sigma_after_deg"], strict=True)
    ]
    note = (
        "Ground seen by several strips takes part in the adjustment of positions and IMU. Standard deviations are "
        "medians; what is common to all strips stays as the positions have it."
    )
    return f'<div class="scroll">{table(("", "sigma before", "sigma after", "moved (RMS)"), rows)}</div>{remark(note)}'


def _mounting(found: Boresight) -> str:
    """Every parameter together, with sigma and correlation."""
    free = found.free
    units = ("°", "°", "°", " s", " m", " m", " m")
    rows = []
    for name, unit, digits, row in zip(_PARAMETERS, units, (4, 4, 4, 5, 4, 4, 4), range(len(units)), strict=True):
        seen = "yes" if free.observed[row] else "no"
        off = free.value[row] + (found.correction_deg[row] if row < len(found.correction_deg) else 0.0)
        correlation = [f"{value:+.2f}" for value in free.correlation[row].tolist()]
        rows.append((name, f"{off:+.{digits}f}{unit}", f"{free.sigma[row]:.{digits}f}{unit}", seen, *correlation))
    head = ("parameter", "off the stated", "sigma", "observed", *_PARAMETERS)
    angles, sigmas = (", ".join(f"{v:.3f}°" for v in values) for values in (found.mounting.rpy_deg, found.sigma_deg))
    note = (
        f"{'Used' if found.certain else 'Not certain enough to be used'}: rpy_deg {angles}; ± {sigmas} about the axes "
        "of the vehicle, with the errors of its attitude. The table: all parameters estimated together, the sigmas by "
        "the ground alone, and the correlations of the errors. Time: by which the scanner's clock is behind. Clock and "
        "place are corrected only where they are certainly others than stated."
    )
    return f'<div class="scroll">{table(head, rows)}</div>{remark(note)}'


def _two(figures: SwathDifferences | None) -> tuple[str, str]:
    """Mean and RMS in words."""
    if figures is None:
        return "unknown", "unknown"
    return f"{1000.0 * figures.mean_m:+.1f} mm", f"{1000.0 * figures.rms_m:.1f} mm"
