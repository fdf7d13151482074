"""Drawings as SVG: maps to scale, and curves over time."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from html import escape
from typing import Final

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely.geometry.base import BaseGeometry

from furrowmap.exporters.rasters.png import data_uri
from furrowmap.exporters.rasters.relief import Box, Relief

FloatArray = NDArray[np.float64]

WIDTH: Final = 640.0
"""Width of every drawing; a unit is a CSS pixel."""
TALLEST: Final = 640.0
FINE: Final = 0.3
"""Tolerance of simplified lines in units."""
_STEPS: Final = (1.0, 2.0, 5.0, 10.0)
_TIME_STEPS_S: Final = (1, 2, 5, 10, 20, 30, 60, 120, 300, 600, 1200, 1800, 3600, 7200, 14400, 21600, 43200)


@dataclass(frozen=True)
class Sheet:
    """The area of a map and its scale in units per metre."""

    box_m: Box
    scale: float

    @classmethod
    def of(cls, box_m: Box) -> Sheet:
        """The largest sheet for a box."""
        west, south, east, north = box_m
        return cls(box_m, min(WIDTH / (east - west), TALLEST / (north - south)))

    @property
    def size(self) -> tuple[float, float]:
        """Width and height in units."""
        west, south, east, north = self.box_m
        return (east - west) * self.scale, (north - south) * self.scale

    def image(self, relief: Relief) -> str:
        """An image."""
        (x, y), (right, bottom) = self._at(np.array([relief.box_m[::3], relief.box_m[2:0:-1]])).tolist()
        place = f'x="{x:.1f}" y="{y:.1f}" width="{right - x:.1f}" height="{bottom - y:.1f}"'
        return f'<image {place} preserveAspectRatio="none" href="{data_uri(relief.picture)}"/>'

    def area(self, shape: BaseGeometry, kind: str, more: str = "") -> str:
        """A polygon."""
        simple = shapely.simplify(shape, FINE / self.scale)
        rings = shapely.get_rings(shapely.get_parts(simple if not simple.is_empty else shape))
        path = "".join(self._path(shapely.get_coordinates(ring)) + "Z" for ring in rings)
        return f'<path class="{kind}" {more} fill-rule="evenodd" d="{path}"/>'

    def line(self, en_m: FloatArray, kind: str, more: str = "") -> str:
        """A line through places (n, 2)."""
        if len(en_m) > 1:
            en_m = shapely.get_coordinates(shapely.simplify(shapely.LineString(en_m[:, :2]), FINE / self.scale))
        return f'<path class="{kind}" {more} d="{self._path(en_m)}"/>'

    def text(self, place: shapely.Point, text: str) -> str:
        """A text at a point."""
        x, y = self._at(shapely.get_coordinates(place))[0]
        return f'<text class="number" x="{x:.1f}" y="{y + 4:.1f}">{escape(text)}</text>'

    def svg(self, parts: Sequence[str], title: str) -> str:
        """The map with a scale bar and a north arrow."""
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
    """A vertical axis from `low` to `high` between two heights of a drawing."""

    low: float
    high: float
    bottom: float
    top: float

    def at(self, value: FloatArray | float) -> FloatArray:
        """Vertical positions of values."""
        share = (np.asarray(value, np.float64) - self.low) / (self.high - self.low)
        place: FloatArray = self.bottom + share * (self.top - self.bottom)
        return place

    def grid(self, left: float, label: Callable[[float], str], name: str = "") -> list[str]:
        """Grid lines at round values, starting at `left`, with labels before them; the axis itself, and its name."""
        step = _nice((self.high - self.low) / 3.0)
        values = np.arange(np.ceil(self.low / step), np.floor(self.high / step) + 1) * step
        lines = [
            f'<line class="grid" x1="{left}" x2="{WIDTH}" y1="{y:.1f}" y2="{y:.1f}"/>'
            f'<text class="label right" x="{left - 7}" y="{y + 4:.1f}">{label(value)}</text>'
            for value, y in zip((values + 0.0).tolist(), self.at(values).tolist(), strict=True)
        ]
        ticks = "".join(f"M{left} {y:.1f}h-5" for y in self.at(values).tolist())
        lines.append(f'<path class="ticks" d="M{left} {self.top}V{self.bottom}{ticks}"/>')
        middle = 0.5 * (self.top + self.bottom)
        turned = f'transform="rotate(-90 12 {middle:.1f})"'
        if name:
            lines.append(f'<text class="label middle" x="12" y="{middle:.1f}" {turned}>{escape(name)}</text>')
        return lines


@dataclass(frozen=True)
class TimeAxis:
    """A horizontal axis of times."""

    begin_s: float
    end_s: float
    left: float = 74.0

    def at(self, t_s: FloatArray | float) -> FloatArray:
        """Horizontal positions of times."""
        share = (np.asarray(t_s, np.float64) - self.begin_s) / max(self.end_s - self.begin_s, 1e-9)
        place: FloatArray = self.left + np.clip(share, 0.0, 1.0) * (WIDTH - self.left)
        return place

    def labels(self, y: float) -> list[str]:
        """Ticks and labels at round times below a graph that ends at `y`, and the name of the axis."""
        length_s = self.end_s - self.begin_s
        step = next((step for step in _TIME_STEPS_S if step >= length_s / 5.0), 86_400)
        times = range(0, int(length_s - 0.2 * step) + 1, step)
        places = [float(self.at(self.begin_s + t)) for t in times]
        ticks = "".join(f"M{x:.1f} {y:.1f}v5" for x in places)
        name = "time since the beginning, " + ("h:min:s" if length_s >= 3600 else "min:s")
        return [
            f'<path class="ticks" d="M{self.left} {y:.1f}H{WIDTH}{ticks}"/>',
            *(
                f'<text class="label{" middle" if t else ""}" x="{x:.1f}" y="{y + 18:.1f}">{_duration(t)}</text>'
                for t, x in zip(times, places, strict=True)
            ),
            f'<text class="label right" x="{WIDTH}" y="{y + 34:.1f}">{name}</text>',
        ]


def curve(x: FloatArray, y: FloatArray) -> list[str]:
    """A curve, interrupted at nan; of several points in one unit, the least and the greatest."""
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
    """The greatest of 1, 2, 5 times a power of ten not above `length`."""
    power = 10.0 ** np.floor(np.log10(length))
    return float(max(step * power for step in _STEPS if step * power <= length * (1 + 1e-9)))


def _duration(t_s: int) -> str:
    return f"{t_s // 3600}:{t_s // 60 % 60:02d}:{t_s % 60:02d}" if t_s >= 3600 else f"{t_s // 60}:{t_s % 60:02d}"


def drawing(width: float, height: float, parts: Sequence[str], title: str) -> str:
    """A complete SVG with a title for screen readers."""
    head = f'<svg viewBox="0 0 {width:.0f} {height:.0f}" role="img" aria-label="{escape(title)}">'
    return head + "".join(parts) + "</svg>"
