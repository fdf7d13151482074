"""Drawings as SVG: maps of a run, graphs over time."""

from itertools import pairwise
from typing import Final

import numpy as np
import shapely
from markupsafe import Markup
from numpy.typing import NDArray
from shapely.geometry.base import BaseGeometry

from furrowmap.core.coverage.field_work import FieldWork
from furrowmap.core.runtime.arrays import FloatArray
from furrowmap.core.runtime.languages.texts import Text, figure_text
from furrowmap.core.surfaces.visits import BIN_M, BINS, SwathDifferences
from furrowmap.core.values.gnss import Fix
from furrowmap.core.values.tool_states import ToolState
from furrowmap.core.values.trajectory import Motion, ScanPoses
from furrowmap.exporters.rasters.relief import Box
from furrowmap.exporters.reports.svg import (
    WIDTH,
    Axis,
    Sheet,
    TimeAxis,
    curve,
    drawing,
    element,
    label,
    mixed_colour,
    rectangle,
    segment,
)
from furrowmap.exporters.work_colours import PASS_RAMP, TOOL_DOWN_COLOUR, TOOL_UP_COLOUR

MAP_MARGIN_M: Final = 2.0
SMALL_HEIGHT: Final = 320.0
"""Height of a map beside others, near that of the page: its scale bar stays readable."""
MAX_NUMBERED_PASSES: Final = 60
"""More passes have no numbers on the map."""
PASS_COLOURS: Final = np.array([[int(colour[at : at + 2], 16) for at in (1, 3, 5)] for colour in PASS_RAMP])
FIX_COLOURS: Final = {
    Fix.FIXED: "#1a9850",
    Fix.FLOAT: "#f4a528",
    Fix.PPP: "#4575b4",
    Fix.DGPS: "#d6604d",
    Fix.SINGLE: "#b2182b",
    Fix.NONE: "#222222",
}
OTHER_COLOUR: Final = "#888888"
_HALF_WIDTHS_M: Final = (0.01, 0.02, 0.05, BINS * BIN_M)
"""Possible half widths of a histogram of swaths."""
_SHARE_WITHIN: Final = 0.98
"""Share of the ground within the half width; the rest is in the outermost bars."""


def pass_colour(number: int, passes: int) -> str:
    """From the first pass (pale green) over that of ground worked to the last (dark green)."""
    return mixed_colour((number - 1) / (passes - 1) if passes > 1 else 0.5, PASS_COLOURS)


MAX_KEYED_PASSES: Final = 8
"""Of more passes the legend of a map has the first and the last."""


def pass_key(passes: int) -> list[tuple[str, Text]]:
    """Colours and names of the passes for the legend of a map."""
    if passes <= MAX_KEYED_PASSES:
        return [(pass_colour(number, passes), Text("pass {number}", number=number)) for number in range(1, passes + 1)]
    return [(pass_colour(1, passes), Text("first pass")), (pass_colour(passes, passes), Text("last pass"))]


def fix_colour(fix: int) -> str:
    """Colour of a kind of fix."""
    return FIX_COLOURS.get(Fix(fix), OTHER_COLOUR) if fix in list(Fix) else OTHER_COLOUR


def map_box(poses: ScanPoses, work: FieldWork) -> Box:
    """Bounds of the vehicle's path, the worked ground and the boundary."""
    shapes: list[BaseGeometry] = [shapely.MultiPoint(poses.xyz_m[:, :2])]
    shapes += [one.ground.coverage for one in work.each if one.ground is not None]
    if work.boundary is not None:
        shapes.append(work.boundary)
    return padded_bounds(shapes, MAP_MARGIN_M)


def padded_bounds(shapes: list[BaseGeometry], margin_m: float) -> Box:
    """The bounds of shapes with a margin."""
    west, south, east, north = shapely.total_bounds(shapes).tolist()
    return west - margin_m, south - margin_m, east + margin_m, north + margin_m


def work_map(box_m: Box, poses: ScanPoses, work: FieldWork, relief: NDArray[np.uint8] | None) -> Markup:
    """The worked ground over the relief; the vehicle's path where the tool's is unknown."""
    sheet = Sheet(box_m)
    parts = [sheet.image(relief)] if relief is not None else []
    if work.boundary is not None:
        parts.append(sheet.area(work.boundary, "boundary"))
    if work.ground is not None:
        ground = work.ground
        parts += [
            sheet.area(one.ground, "pass", fill=pass_colour(one.number, len(ground.passes))) for one in ground.passes
        ]
        parts += [sheet.area(overlap.ground, "overlap") for overlap in ground.overlaps]
        parts += [sheet.area(miss.ground, "miss") for miss in ground.misses]
        for path in work.paths:
            parts.append(sheet.line(shapely.get_coordinates(path.line), f"tool {path.state.label}"))
        if len(ground.passes) <= MAX_NUMBERED_PASSES:
            parts += [
                sheet.text(one.ground.representative_point(), str(one.number))
                for one in ground.passes
                if not one.ground.is_empty
            ]
    if not work.paths:
        parts += [sheet.line(part, "way") for _, part in _runs(poses, np.zeros(len(poses), np.int8))]
    return sheet.svg(parts, Text("Map of the ground worked"))


def quality_map(poses: ScanPoses) -> Markup:
    """The vehicle's path, coloured by the quality of the positions."""
    sheet = Sheet(map_box(poses, FieldWork()), SMALL_HEIGHT)
    parts = [sheet.line(part, "fix", stroke=fix_colour(fix)) for fix, part in _runs(poses, poses.fix)]
    return sheet.svg(parts, Text("The vehicle's path, coloured by the quality of the positions"))


def tool_graph(work: FieldWork) -> Markup:
    """The tool's height over time with its states and passes."""
    history = work.history
    assert history is not None
    time = TimeAxis(float(history.t_s[0]), float(history.t_s[-1]), left=86.0)
    known = history.tool_height_m[np.isfinite(history.tool_height_m)]
    low = min(-0.05, float(known.min(initial=0.0)))
    high = max(history.lifted_m, float(known.max(initial=0.0))) + 0.05
    heights = Axis(low, high, 190.0, 22.0)
    states = history.states
    parts = [
        rectangle(left, 22, right, 190, class_=ToolState(state).label)
        for state, left, right in zip(
            states.state.tolist(), time.at(states.begin_s), time.at(states.end_s), strict=True
        )
    ]
    if len(work.passes) <= 40:
        for number, when in enumerate(work.passes, start=1):
            middle = time.at(0.5 * (when.begin_s + when.end_s))
            parts.append(element("text", str(number), class_="number", x=middle, y=16))
    parts += heights.grid(time.left, lambda v: f"{100 * v:.0f} cm", Text("height of the tool"))
    y = heights.at(history.threshold_m)
    parts.append(segment(time.left, y, WIDTH, y, class_="threshold"))
    parts += curve(time.at(history.t_s), heights.at(history.tool_height_m))
    parts += time.labels(190.0)
    return drawing(WIDTH, 228.0, parts, Text("Height of the tool above its working position over time"))


ACTIVITIES: Final = {
    Text("working"): TOOL_DOWN_COLOUR,
    Text("turning or reversing"): TOOL_UP_COLOUR,
    Text("standing"): "#bdbdbd",
    Text("driving, state of the tool unknown"): "#9e9ac8",
}
"""What a vehicle does, and its colour; the classes of the hours of a report."""


def activities(poses: ScanPoses, work: FieldWork) -> NDArray[np.int8]:
    """The number of the activity in :data:`ACTIVITIES` at each scan (n,): by motion, and the state of the tool."""
    state = work.states.at(poses.t_s)[0] if work.states is not None else np.full(len(poses), ToolState.UNKNOWN)
    forward = poses.motion == Motion.FORWARD
    back = poses.motion == Motion.REVERSE
    chosen = [forward & (state == ToolState.DOWN), back | (forward & (state == ToolState.UP)), ~forward & ~back]
    found: NDArray[np.int8] = np.select(chosen, [0, 1, 2], 3).astype(np.int8)
    return found


def poses_at_work(poses: ScanPoses, work: FieldWork) -> ScanPoses | None:
    """The poses from the first pass to the last, as the hours of a report count them; None without passes."""
    if work.ground is None or not work.ground.passes:
        return None
    begin_s = min(one.times.begin_s for one in work.ground.passes)
    end_s = max(one.times.end_s for one in work.ground.passes)
    inside = (poses.t_s >= begin_s) & (poses.t_s <= end_s)
    if inside.sum() < 2:
        return None
    return ScanPoses(**{name: values[inside] for name, values in vars(poses).items()})


def activity_graph(poses: ScanPoses, work: FieldWork) -> Markup:
    """What the vehicle does over time, a row for each activity."""
    time = TimeAxis(float(poses.t_s[0]), float(poses.t_s[-1]))
    seen = activities(poses, work)
    rows = np.unique(seen).tolist()
    colours = list(ACTIVITIES.values())
    pause = np.append(_pauses(poses), True)
    edges = np.flatnonzero(np.diff(seen, prepend=np.int8(-9), append=np.int8(-9)) != 0)
    cuts = np.unique(np.concatenate([edges, 1 + np.flatnonzero(pause)]))
    parts = []
    for first, behind in pairwise(cuts.tolist()):
        last = behind - 1 if pause[behind - 1] else behind
        left = float(time.at(poses.t_s[first]))
        right = float(time.at(poses.t_s[last]))
        y = 4.0 + 18.0 * rows.index(int(seen[first]))
        parts.append(rectangle(left, y, max(right, left + 0.3), y + 14.0, fill=colours[int(seen[first])]))
    bottom = 6.0 + 18.0 * len(rows)
    return drawing(WIDTH, bottom + 38.0, [*parts, *time.labels(bottom)], Text("Activity over time"))


def quality_graph(poses: ScanPoses) -> Markup:
    """The quality of the positions and the stated accuracy over time."""
    time = TimeAxis(float(poses.t_s[0]), float(poses.t_s[-1]), left=86.0)
    sigma_m = np.hypot(poses.sigma[:, 0], poses.sigma[:, 1])
    edges = np.flatnonzero(np.diff(poses.fix, prepend=np.int8(-99), append=np.int8(-99)))
    at = time.at(poses.t_s[np.minimum(edges, len(poses) - 1)])
    parts = [
        rectangle(left, 0, right, 12, fill=fix_colour(fix))
        for (left, right), fix in zip(pairwise(at), poses.fix[edges[:-1]].tolist(), strict=True)
    ]
    if not np.isfinite(sigma_m).any():
        return drawing(WIDTH, 52.0, [*parts, *time.labels(14.0)], Text("Quality of the positions over time"))
    axis = Axis(0.0, max(0.01, float(np.nanquantile(sigma_m, 0.99)) * 1.3), 130.0, 20.0)
    parts += axis.grid(time.left, lambda v: f"{100 * v:g} cm", Text("sigma"))
    parts += curve(time.at(poses.t_s), np.maximum(axis.at(sigma_m), 20.0))
    parts += time.labels(130.0)
    return drawing(WIDTH, 168.0, parts, Text("Quality and accuracy of the positions over time"))


def half_width_m(swaths: SwathDifferences) -> float:
    """A round half width of a histogram that shows nearly all differences."""
    return next((reach for reach in _HALF_WIDTHS_M if swaths.within_m(_SHARE_WITHIN) <= reach), _HALF_WIDTHS_M[-1])


def swath_histogram(swaths: SwathDifferences, reach_m: float | None = None) -> Markup:
    """Share of the ground by height difference; the outermost bars, at `reach_m`, include all larger differences."""
    top = 18.0
    bottom = 150.0
    left = 74.0
    reach_m = half_width_m(swaths) if reach_m is None else reach_m
    bins = round(reach_m / BIN_M)
    low = BINS - bins
    high = BINS + bins
    count = swaths.histogram[low:high].astype(np.float64)
    count[0] += swaths.histogram[:low].sum()
    count[-1] += swaths.histogram[high:].sum()
    share = count / max(swaths.blocks, 1)
    shares = Axis(0.0, max(float(share.max()), 1e-3), bottom, top)
    edges = np.linspace(left, WIDTH, len(share) + 1)
    parts = shares.grid(left, lambda value: f"{100.0 * value:g} %")
    parts += [
        rectangle(begin + 0.5, y, end - 0.5, bottom, class_="bars")
        for (begin, end), y, part in zip(pairwise(edges), shares.at(share), share, strict=True)
        if part
    ]
    middle = 0.5 * (left + WIDTH)
    last = 2 * BINS - 1  # like the first, of all larger differences
    beyond = bool(swaths.histogram[: max(low, 1)].any() or swaths.histogram[min(high, last) :].any())
    edge = figure_text(f"{1000 * reach_m:g} mm")
    least = Text("−{edge} and more", edge=edge) if beyond else figure_text(f"−{edge}")
    most = Text("+{edge} and more", edge=edge) if beyond else figure_text(f"+{edge}")
    parts += [
        segment(middle, top, middle, bottom, class_="threshold"),
        label(left, bottom + 18, least),
        label(middle, bottom + 18, "0", "middle"),
        label(WIDTH, bottom + 18, most, "right"),
    ]
    return drawing(WIDTH, bottom + 24.0, parts, Text("Differences in height of swaths over the same ground"))


def _pauses(poses: ScanPoses) -> NDArray[np.bool_]:
    """Whether the vehicle's path is interrupted after each pose but the last."""
    step_s = np.diff(poses.t_s)
    return step_s > max(1.0, 3.0 * float(np.median(step_s))) if len(step_s) else np.zeros(0, np.bool_)


def _runs(poses: ScanPoses, values: NDArray[np.int8]) -> list[tuple[int, FloatArray]]:
    """(value, positions (k, 2)) of each run of poses with one value and no pause; it includes the next run's first."""
    if len(poses) < 2:
        return []
    pause = _pauses(poses)
    cuts = 1 + np.flatnonzero(pause | (np.diff(values) != 0))
    firsts = np.append(0, cuts)
    ends = np.append(cuts, len(poses))
    reach = [end + int(end < len(poses) and not pause[end - 1]) for end in ends.tolist()]
    return [(int(values[a]), poses.xyz_m[a:b, :2]) for a, b in zip(firsts.tolist(), reach, strict=True)]
