"""Drawings of a run as SVG: maps and graphs over time."""

from __future__ import annotations

from itertools import pairwise
from typing import Final

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely.geometry.base import BaseGeometry

from furrowmap.core.values.gnss import Fix
from furrowmap.core.values.scan_poses import ScanPoses
from furrowmap.core.values.tool_states import ToolState
from furrowmap.core.values.trajectory import Motion
from furrowmap.core.work.field_work import FieldWork
from furrowmap.exporters.rasters.relief import Box, Relief
from furrowmap.exporters.reports.svg import WIDTH, Axis, Sheet, TimeAxis, curve, drawing

FloatArray = NDArray[np.float64]

MARGIN_M: Final = 2.0
PASS_COLOURS: Final = np.array([[253, 212, 158], [120, 198, 121], [34, 94, 168]])
FIX_COLOURS: Final = {
    Fix.FIXED: "#1a9850",
    Fix.FLOAT: "#f4a528",
    Fix.PPP: "#4575b4",
    Fix.DGPS: "#d6604d",
    Fix.SINGLE: "#b2182b",
    Fix.NONE: "#222222",
}
OTHER_COLOUR: Final = "#888888"


def pass_colour(number: int, passes: int) -> str:
    """From the first pass (orange) over green to the last (blue)."""
    at = (number - 1) / (passes - 1) * 2.0 if passes > 1 else 1.0
    return "#" + "".join(f"{round(np.interp(at, (0, 1, 2), channel)):02x}" for channel in PASS_COLOURS.T)


def fix_colour(fix: int) -> str:
    """Colour of a kind of fix."""
    return FIX_COLOURS.get(Fix(fix), OTHER_COLOUR) if fix in list(Fix) else OTHER_COLOUR


def map_box(poses: ScanPoses, work: FieldWork) -> Box:
    """Bounds of the vehicle's path, the worked ground and the boundary."""
    shapes: list[BaseGeometry] = [shapely.MultiPoint(poses.xyz_m[:, :2])]
    shapes += [one.ground.coverage for one in work.each if one.ground is not None]
    if work.boundary is not None:
        shapes.append(work.boundary)
    west, south, east, north = shapely.total_bounds(shapes)
    return west - MARGIN_M, south - MARGIN_M, east + MARGIN_M, north + MARGIN_M


def work_map(box_m: Box, poses: ScanPoses, work: FieldWork, relief: Relief | None) -> str:
    """The worked ground over the relief; the vehicle's path where the tool's is unknown."""
    sheet = Sheet.of(box_m)
    parts = [sheet.image(relief)] if relief is not None else []
    if work.boundary is not None:
        parts.append(sheet.area(work.boundary, "boundary"))
    if work.ground is not None:
        ground = work.ground
        for one in ground.passes:
            colour = pass_colour(one.number, len(ground.passes))
            parts.append(sheet.area(one.ground, "pass", f'fill="{colour}"'))
        parts += [sheet.area(overlap.ground, "overlap") for overlap in ground.overlaps]
        parts += [sheet.area(miss.ground, "miss") for miss in ground.misses]
        for path in work.paths:
            parts.append(sheet.line(shapely.get_coordinates(path.line), f"tool {path.state.label}"))
        if len(ground.passes) <= 60:
            parts += [
                sheet.text(one.ground.representative_point(), str(one.number))
                for one in ground.passes
                if not one.ground.is_empty
            ]
    if not work.paths:
        parts += [sheet.line(part, "way") for _, part in _runs(poses, np.zeros(len(poses), np.int8))]
    return sheet.svg(parts, "Map of the ground worked")


def quality_map(poses: ScanPoses) -> str:
    """The vehicle's path, coloured by the quality of the positions."""
    sheet = Sheet.of(map_box(poses, FieldWork()))
    parts = [sheet.line(part, "fix", f'stroke="{fix_colour(fix)}"') for fix, part in _runs(poses, poses.fix)]
    return sheet.svg(parts, "The vehicle's path, coloured by the quality of the positions")


def tool_graph(work: FieldWork) -> str:
    """The tool's height over time with its states and passes."""
    history = work.history
    assert history is not None
    time = TimeAxis(float(history.t_s[0]), float(history.t_s[-1]), left=86.0)
    known = history.tool_height_m[np.isfinite(history.tool_height_m)]
    low = min(-0.05, float(known.min(initial=0.0)))
    high = max(history.lifted_m, float(known.max(initial=0.0))) + 0.05
    heights = Axis(low, high, 190.0, 22.0)
    states = history.states
    parts = []
    for k in range(len(states)):
        left, right = time.at(states.begin_s[k]), time.at(states.end_s[k])
        label = ToolState(int(states.state[k])).label
        parts.append(f'<rect class="{label}" x="{left:.1f}" y="22" width="{right - left:.1f}" height="168"/>')
    for number, when in enumerate(work.passes, start=1):
        if len(work.passes) <= 40:
            middle = time.at(0.5 * (when.begin_s + when.end_s))
            parts.append(f'<text class="number" x="{middle:.1f}" y="16">{number}</text>')
    parts += heights.grid(time.left, lambda v: f"{100 * v:.0f} cm", "height of the tool")
    y = heights.at(history.threshold_m)
    parts.append(f'<line class="threshold" x1="{time.left}" x2="{WIDTH}" y1="{y:.1f}" y2="{y:.1f}"/>')
    parts += curve(time.at(history.t_s), heights.at(history.tool_height_m))
    parts += time.labels(190.0)
    return drawing(WIDTH, 228.0, parts, "Height of the tool above its working position over time")


ACTIVITIES: Final = {
    "working": "#8c460a",
    "turning or reversing": "#4292c6",
    "standing": "#bdbdbd",
    "driving, state of the tool unknown": "#9e9ac8",
}
"""What a vehicle does, and its colour; the classes of the hours of a report."""


def activities(poses: ScanPoses, work: FieldWork) -> NDArray[np.int8]:
    """The number of the activity in :data:`ACTIVITIES` at each scan (n,): by motion, and the state of the tool."""
    state = work.states.at(poses.t_s)[0] if work.states is not None else np.full(len(poses), ToolState.UNKNOWN)
    forward, back = poses.motion == Motion.FORWARD, poses.motion == Motion.REVERSE
    chosen = [forward & (state == ToolState.DOWN), back | (forward & (state == ToolState.UP)), ~forward & ~back]
    found: NDArray[np.int8] = np.select(chosen, [0, 1, 2], 3).astype(np.int8)
    return found


def activity_graph(poses: ScanPoses, work: FieldWork) -> str:
    """What the vehicle does over time, a row for each activity."""
    time = TimeAxis(float(poses.t_s[0]), float(poses.t_s[-1]))
    seen = activities(poses, work)
    names = list(ACTIVITIES)
    rows = [kind for kind in range(len(names)) if (seen == kind).any()]
    step_s = np.diff(poses.t_s)
    pause = np.append(step_s > max(1.0, 3.0 * float(np.median(step_s))), True) if len(step_s) else np.ones(1, bool)
    edges = np.flatnonzero(np.diff(seen, prepend=np.int8(-9), append=np.int8(-9)) != 0)
    cuts = np.unique(np.concatenate([edges, 1 + np.flatnonzero(pause)]))
    parts = []
    for first, behind in pairwise(cuts.tolist()):
        last = behind - 1 if pause[behind - 1] else behind
        left, right = float(time.at(poses.t_s[first])), float(time.at(poses.t_s[last]))
        y = 4.0 + 18.0 * rows.index(int(seen[first]))
        colour = ACTIVITIES[names[int(seen[first])]]
        parts.append(f'<rect x="{left:.1f}" y="{y}" width="{max(right - left, 0.3):.1f}" height="14" fill="{colour}"/>')
    bottom = 6.0 + 18.0 * len(rows)
    return drawing(WIDTH, bottom + 38.0, [*parts, *time.labels(bottom)], "Activity over time")


def quality_graph(poses: ScanPoses) -> str:
    """The quality of the positions and the stated accuracy over time."""
    time = TimeAxis(float(poses.t_s[0]), float(poses.t_s[-1]), left=86.0)
    sigma_m = np.hypot(poses.sigma[:, 0], poses.sigma[:, 1])
    edges = np.flatnonzero(np.diff(poses.fix, prepend=np.int8(-99), append=np.int8(-99)))
    parts = []
    for first, behind in pairwise(edges.tolist()):
        left, right = time.at(poses.t_s[first]), time.at(poses.t_s[min(behind, len(poses) - 1)])
        colour = fix_colour(int(poses.fix[first]))
        parts.append(f'<rect x="{left:.1f}" y="0" width="{right - left:.1f}" height="12" fill="{colour}"/>')
    if not np.isfinite(sigma_m).any():
        return drawing(WIDTH, 52.0, [*parts, *time.labels(14.0)], "Quality of the positions over time")
    axis = Axis(0.0, max(0.01, float(np.nanquantile(sigma_m, 0.99)) * 1.3), 130.0, 20.0)
    parts += axis.grid(time.left, lambda v: f"{100 * v:g} cm", "standard deviation")
    parts += curve(time.at(poses.t_s), np.maximum(axis.at(sigma_m), 20.0))
    parts += time.labels(130.0)
    return drawing(WIDTH, 168.0, parts, "Quality and accuracy of the positions over time")


def _runs(poses: ScanPoses, values: NDArray[np.int8]) -> list[tuple[int, FloatArray]]:
    """(value, positions (k, 2)) of each run of poses with one value and no pause; it includes the next run's first."""
    if len(poses) < 2:
        return []
    step_s = np.diff(poses.t_s)
    pause = step_s > max(1.0, 3.0 * float(np.median(step_s)))
    cuts = 1 + np.flatnonzero(pause | (np.diff(values) != 0))
    firsts, ends = np.append(0, cuts), np.append(cuts, len(poses))
    reach = [end + int(end < len(poses) and not pause[end - 1]) for end in ends.tolist()]
    return [(int(values[a]), poses.xyz_m[a:b, :2]) for a, b in zip(firsts.tolist(), reach, strict=True)]
