"""Drawings of a run as SVG: the map, and what went on over time."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from html import escape
from itertools import pairwise
from typing import Final

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely.geometry.base import BaseGeometry

from furrowmap.core.field_work import FieldWork
from furrowmap.core.values.gnss import Fix
from furrowmap.core.values.scan_poses import ScanPoses
from furrowmap.core.values.tool_states import ToolState
from furrowmap.exporters.png import data_uri
from furrowmap.exporters.relief import Box, Relief

FloatArray = NDArray[np.float64]

WIDTH: Final = 640.0
"""Of every drawing; a unit is a pixel on a desktop's screen."""
TALLEST: Final = 640.0
MARGIN_M: Final = 2.0
FINE: Final = 0.3
"""Units below which a line's bends are left out."""
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
_STEPS: Final = (1.0, 2.0, 5.0, 10.0)
_TIME_STEPS_S: Final = (1, 2, 5, 10, 20, 30, 60, 120, 300, 600, 1200, 1800, 3600, 7200, 14400)


def pass_colour(number: int, passes: int) -> str:
    """From the first pass (orange) over green to the last (blue)."""
    at = (number - 1) / (passes - 1) * 2.0 if passes > 1 else 1.0
    return "#" + "".join(f"{round(np.interp(at, (0, 1, 2), channel)):02x}" for channel in PASS_COLOURS.T)


def fix_colour(fix: int) -> str:
    """Of a quality of positions."""
    return FIX_COLOURS.get(Fix(fix), OTHER_COLOUR) if fix in list(Fix) else OTHER_COLOUR


def map_box(poses: ScanPoses, work: FieldWork) -> Box:
    """What a map has to show: the vehicle's way, the ground worked and the boundary."""
    shapes: list[BaseGeometry] = [shapely.MultiPoint(poses.xyz_m[:, :2])]
    if work.ground is not None:
        shapes.append(work.ground.coverage)
    if work.boundary is not None:
        shapes.append(work.boundary)
    west, south, east, north = shapely.total_bounds(shapes)
    return west - MARGIN_M, south - MARGIN_M, east + MARGIN_M, north + MARGIN_M


def work_map(box_m: Box, poses: ScanPoses, work: FieldWork, relief: Relief | None) -> str:
    """The ground worked over the relief; the vehicle's way where no tool's path is known."""
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
    """The vehicle's way, coloured by the quality of the positions."""
    sheet = Sheet.of(map_box(poses, FieldWork()))
    parts = [sheet.line(part, "fix", f'stroke="{fix_colour(fix)}"') for fix, part in _runs(poses, poses.fix)]
    return sheet.svg(parts, "The vehicle's way, coloured by the quality of the positions")


def tool_graph(work: FieldWork) -> str:
    """The tool's height over time, with its states and passes."""
    history = work.history
    assert history is not None
    time = TimeAxis(float(history.t_s[0]), float(history.t_s[-1]))
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
    parts += heights.grid(time.left, lambda v: f"{100 * v:.0f} cm")
    y = heights.at(history.threshold_m)
    parts.append(f'<line class="threshold" x1="{time.left}" x2="{WIDTH}" y1="{y:.1f}" y2="{y:.1f}"/>')
    parts += curve(time.at(history.t_s), heights.at(history.tool_height_m))
    parts += time.labels(190.0)
    return drawing(WIDTH, 212.0, parts, "Height of the tool above its working position over time")


def quality_graph(poses: ScanPoses) -> str:
    """The quality of the positions and the stated accuracy over time."""
    time = TimeAxis(float(poses.t_s[0]), float(poses.t_s[-1]))
    sigma_m = np.hypot(poses.sigma[:, 0], poses.sigma[:, 1])
    edges = np.flatnonzero(np.diff(poses.fix, prepend=np.int8(-99), append=np.int8(-99)))
    parts = []
    for first, behind in pairwise(edges.tolist()):
        left, right = time.at(poses.t_s[first]), time.at(poses.t_s[min(behind, len(poses) - 1)])
        colour = fix_colour(int(poses.fix[first]))
        parts.append(f'<rect x="{left:.1f}" y="0" width="{right - left:.1f}" height="12" fill="{colour}"/>')
    if not np.isfinite(sigma_m).any():
        return drawing(WIDTH, 36.0, [*parts, *time.labels(14.0)], "Quality of the positions over time")
    axis = Axis(0.0, max(0.01, float(np.nanquantile(sigma_m, 0.99)) * 1.3), 130.0, 20.0)
    parts += axis.grid(time.left, lambda v: f"{100 * v:g} cm")
    parts += curve(time.at(poses.t_s), np.maximum(axis.at(sigma_m), 20.0))
    parts += time.labels(130.0)
    return drawing(WIDTH, 152.0, parts, "Quality and accuracy of the positions over time")


@dataclass(frozen=True)
class Sheet:
    """A map's paper: from metres to units."""

    box_m: Box
    scale: float

    @classmethod
    def of(cls, box_m: Box) -> Sheet:
        """The largest that shows a box."""
        west, south, east, north = box_m
        return cls(box_m, min(WIDTH / (east - west), TALLEST / (north - south)))

    @property
    def size(self) -> tuple[float, float]:
        """Width and height in units."""
        west, south, east, north = self.box_m
        return (east - west) * self.scale, (north - south) * self.scale

    def image(self, relief: Relief) -> str:
        """A picture at its place."""
        (x, y), (right, bottom) = self._at(np.array([relief.box_m[::3], relief.box_m[2:0:-1]])).tolist()
        place = f'x="{x:.1f}" y="{y:.1f}" width="{right - x:.1f}" height="{bottom - y:.1f}"'
        return f'<image {place} preserveAspectRatio="none" href="{data_uri(relief.picture)}"/>'

    def area(self, shape: BaseGeometry, kind: str, more: str = "") -> str:
        """A polygon."""
        simple = shapely.simplify(shape, FINE / self.scale)
        rings = shapely.get_rings(shapely.get_parts(simple if not simple.is_empty else shape))
        way = "".join(self._path(shapely.get_coordinates(ring)) + "Z" for ring in rings)
        return f'<path class="{kind}" {more} fill-rule="evenodd" d="{way}"/>'

    def line(self, en_m: FloatArray, kind: str, more: str = "") -> str:
        """A line through places (n, 2)."""
        if len(en_m) > 1:
            en_m = shapely.get_coordinates(shapely.simplify(shapely.LineString(en_m[:, :2]), FINE / self.scale))
        return f'<path class="{kind}" {more} d="{self._path(en_m)}"/>'

    def text(self, place: shapely.Point, text: str) -> str:
        """A word at a place."""
        x, y = self._at(shapely.get_coordinates(place))[0]
        return f'<text class="number" x="{x:.1f}" y="{y + 4:.1f}">{escape(text)}</text>'

    def svg(self, parts: Sequence[str], title: str) -> str:
        """The whole map, with a scale bar and an arrow to north."""
        width, height = self.size
        return drawing(width, height, [*parts, *self._scale_bar(), *self._north()], title)

    def _at(self, en_m: FloatArray) -> FloatArray:
        west, _, _, north = self.box_m
        place: FloatArray = (en_m[:, :2] - (west, north)) * (self.scale, -self.scale)
        return place

    def _path(self, en_m: FloatArray) -> str:
        return "M" + "L".join(f"{x:.1f} {y:.1f}" for x, y in self._at(en_m))

    def _scale_bar(self) -> Iterable[str]:
        width, height = self.size
        length_m = _nice(0.25 * width / self.scale)
        right = 12.0 + length_m * self.scale
        yield f'<path class="halo" d="M12 {height - 12:.1f}H{right:.1f}"/>'
        yield f'<path class="bar" d="M12 {height - 12:.1f}H{right:.1f}"/>'
        yield f'<text class="label" x="12" y="{height - 18:.1f}">{length_m:g} m</text>'

    def _north(self) -> Iterable[str]:
        x = self.size[0] - 18.0
        yield f'<path class="arrow" d="M{x:.1f} 8l7 20l-7 -5l-7 5Z"/><text class="number" x="{x:.1f}" y="44">N</text>'


@dataclass(frozen=True)
class Axis:
    """Values from `low` to `high` between two heights of a drawing."""

    low: float
    high: float
    bottom: float
    top: float

    def at(self, value: FloatArray | float) -> FloatArray:
        """Where values are drawn."""
        share = (np.asarray(value, np.float64) - self.low) / (self.high - self.low)
        place: FloatArray = self.bottom + share * (self.top - self.bottom)
        return place

    def grid(self, left: float, told: Callable[[float], str]) -> list[str]:
        """Lines at round values, from `left` on, with their words before them."""
        step = _nice((self.high - self.low) / 3.0)
        values = np.arange(np.ceil(self.low / step), np.floor(self.high / step) + 1) * step
        return [
            f'<line class="grid" x1="{left}" x2="{WIDTH}" y1="{y:.1f}" y2="{y:.1f}"/>'
            f'<text class="label right" x="{left - 5}" y="{y + 4:.1f}">{told(value)}</text>'
            for value, y in zip((values + 0.0).tolist(), self.at(values).tolist(), strict=True)
        ]


@dataclass(frozen=True)
class TimeAxis:
    """Times from left to right."""

    begin_s: float
    end_s: float
    left: float = 74.0

    def at(self, t_s: FloatArray | float) -> FloatArray:
        """Where times are drawn."""
        share = (np.asarray(t_s, np.float64) - self.begin_s) / max(self.end_s - self.begin_s, 1e-9)
        place: FloatArray = self.left + np.clip(share, 0.0, 1.0) * (WIDTH - self.left)
        return place

    def labels(self, y: float) -> list[str]:
        """Round times below a graph that ends at `y`."""
        length_s = self.end_s - self.begin_s
        step = next((step for step in _TIME_STEPS_S if step >= length_s / 5.0), 86_400)
        return [
            f'<text class="label{" middle" if t else ""}" x="{self.at(self.begin_s + t):.1f}" y="{y + 16:.1f}">'
            f"{_duration(t)}</text>"
            for t in range(0, int(length_s - 0.2 * step) + 1, step)
        ]


def _runs(poses: ScanPoses, values: NDArray[np.int8]) -> list[tuple[int, FloatArray]]:
    """(value, places (k, 2)) of each stretch of poses of one value without a pause; it ends where the next begins."""
    if len(poses) < 2:
        return []
    step_s = np.diff(poses.t_s)
    pause = step_s > max(1.0, 3.0 * float(np.median(step_s)))
    cuts = 1 + np.flatnonzero(pause | (np.diff(values) != 0))
    firsts, ends = np.append(0, cuts), np.append(cuts, len(poses))
    reach = [end + int(end < len(poses) and not pause[end - 1]) for end in ends.tolist()]
    return [(int(values[a]), poses.xyz_m[a:b, :2]) for a, b in zip(firsts.tolist(), reach, strict=True)]


def curve(x: FloatArray, y: FloatArray) -> list[str]:
    """A curve with a break wherever it is not known; of many points in one unit, the least and the greatest."""
    known = np.flatnonzero(np.isfinite(y))
    parts = []
    for part in np.split(known, 1 + np.flatnonzero(np.diff(known) > 1)):
        if len(part) < 2:
            continue
        unit = np.floor(x[part]).astype(np.intp)
        order = np.lexsort((y[part], unit))
        edges = np.flatnonzero(np.diff(unit[order], prepend=-1, append=-1))
        kept = np.unique(np.concatenate([order[edges[:-1]], order[edges[1:] - 1], [0, len(part) - 1]]))
        points = " ".join(f"{a:.1f},{b:.1f}" for a, b in zip(x[part][kept], y[part][kept], strict=True))
        parts.append(f'<polyline class="curve" points="{points}"/>')
    return parts


def _nice(length: float) -> float:
    """The greatest of 1, 2, 5 times a power of ten that is not above `length`."""
    power = 10.0 ** np.floor(np.log10(length))
    return float(max(step * power for step in _STEPS if step * power <= length * (1 + 1e-9)))


def _duration(t_s: int) -> str:
    return f"{t_s // 3600}:{t_s // 60 % 60:02d}:{t_s % 60:02d}" if t_s >= 3600 else f"{t_s // 60}:{t_s % 60:02d}"


def drawing(width: float, height: float, parts: Sequence[str], title: str) -> str:
    """The whole drawing, with what it shows in words."""
    head = f'<svg viewBox="0 0 {width:.0f} {height:.0f}" role="img" aria-label="{escape(title)}">'
    return head + "".join(parts) + "</svg>"
