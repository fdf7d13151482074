"""Drawings as SVG: their elements, maps to scale, and the axes and curves of charts."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from html import escape
from typing import Final

import numpy as np
import shapely
from markupsafe import Markup
from numpy.typing import NDArray
from shapely.geometry.base import BaseGeometry

from furrowmap.core.runtime.arrays import FloatArray
from furrowmap.core.runtime.languages.texts import Text, Words, figure_text
from furrowmap.exporters.rasters.relief import Box
from furrowmap.exporters.rasters.web_images import data_uri
from furrowmap.exporters.reports.page_language import in_page

Number = float | FloatArray
"""A coordinate; an array has a single value."""

WIDTH: Final = 640.0
"""Width of every drawing; a unit is a CSS pixel."""
MAX_HEIGHT: Final = 640.0
SCALE_STRIP: Final = 28.0
"""Height of the strip below a map that has its scale bar and north arrow."""
MIN_STRIP: Final = 180.0
"""Its least width."""
LINE_TOLERANCE: Final = 0.3
"""Tolerance of simplified lines in units."""
_ROUND_STEPS: Final = (1.0, 2.0, 5.0, 10.0)
_TIME_STEPS_S: Final = (1, 2, 5, 10, 20, 30, 60, 120, 300, 600, 1200, 1800, 3600, 7200, 14400, 21600, 43200)


def element(name: str, text: Words = "", /, **attributes: object) -> str:
    """An element of SVG with a text; `class_` is its class, `stroke_width` its stroke-width; floats have a decimal."""
    said = ""
    for key, value in attributes.items():
        shown = f"{value:.1f}" if isinstance(value, float | np.ndarray) else escape(str(value))
        said += f' {key.rstrip("_").replace("_", "-")}="{shown}"'
    return f"<{name}{said}>{escape(in_page(text))}</{name}>" if text else f"<{name}{said}/>"


def rectangle(left: Number, top: Number, right: Number, bottom: Number, **look: object) -> str:
    """A rectangle."""
    return element("rect", x=left, y=top, width=right - left, height=bottom - top, **look)


def segment(x1: Number, y1: Number, x2: Number, y2: Number, **look: object) -> str:
    """A straight line between two points."""
    return element("line", x1=x1, y1=y1, x2=x2, y2=y2, **look)


def label(x: Number, y: Number, text: Words, place: str = "") -> str:
    """A text of an axis that begins at a place; "middle" or "right" if it is centred or ends there."""
    return element("text", text, class_=f"label {place}".rstrip(), x=x, y=y)


def corners(x: Iterable[float], y: Iterable[float]) -> str:
    """The points of a polyline or polygon."""
    return " ".join(f"{a:.1f},{b:.1f}" for a, b in zip(x, y, strict=True))


def drawing(width: float, height: float, parts: Iterable[str], title: Words) -> Markup:
    """A complete SVG with a title for screen readers."""
    head = f'<svg viewBox="0 0 {width:.0f} {height:.0f}" role="img" aria-label="{escape(in_page(title))}">'
    return Markup(f"{head}{''.join(parts)}</svg>")  # noqa: S704 (its texts are escaped)


@dataclass(frozen=True)
class Sheet:
    """The area of a map, in the largest scale that fits a drawing of some height."""

    box_m: Box
    max_height: float = MAX_HEIGHT

    @property
    def scale(self) -> float:
        """Units per metre."""
        west, south, east, north = self.box_m
        return min(WIDTH / (east - west), self.max_height / (north - south))

    @property
    def size(self) -> tuple[float, float]:
        """Width and height in units."""
        west, south, east, north = self.box_m
        return (east - west) * self.scale, (north - south) * self.scale

    def image(self, pixels: NDArray[np.uint8]) -> str:
        """An image (rows, columns, channels) of the whole area, north on top."""
        return image(0.0, 0.0, *self.size, pixels)

    def area(self, shape: BaseGeometry, kind: str, **look: str) -> str:
        """A polygon."""
        simple = shapely.simplify(shape, LINE_TOLERANCE / self.scale)
        rings = shapely.get_rings(shapely.get_parts(simple if not simple.is_empty else shape))
        path = "".join(self._path(shapely.get_coordinates(ring)) + "Z" for ring in rings)
        return element("path", class_=kind, **look, fill_rule="evenodd", d=path)

    def line(self, en_m: FloatArray, kind: str, **look: str) -> str:
        """A line through places (n, 2)."""
        if len(en_m) > 1:
            line = shapely.LineString(en_m[:, :2])
            en_m = shapely.get_coordinates(shapely.simplify(line, LINE_TOLERANCE / self.scale))
        return element("path", class_=kind, **look, d=self._path(en_m))

    def text(self, place: shapely.Point, text: str) -> str:
        """A text at a point."""
        x, y = self._at(shapely.get_coordinates(place))[0]
        return element("text", text, class_="number", x=x, y=y + 4)

    def svg(self, parts: Sequence[str], title: Words) -> Markup:
        """The map, and in a strip below it a scale bar and a north arrow, which cover nothing of it."""
        width, height = self.size
        length_m = _round_step(0.25 * width / self.scale)
        whole = max(width, MIN_STRIP)
        y = height + 0.6 * SCALE_STRIP
        x = 12.0 + length_m * self.scale
        arrow = whole - 36.0
        frame = (
            element("path", class_="bar", d=f"M12 {y:.1f}H{x:.1f}"),
            label(x + 8, y + 4, figure_text(f"{length_m:g} m")),
            element("path", class_="arrow", d=f"M{arrow:.1f} {height + 5:.1f}l7 20l-7 -5l-7 5Z"),
            element("text", "N", class_="number", x=whole - 18.0, y=y + 4),
        )
        return drawing(whole, height + SCALE_STRIP, [*parts, *frame], title)

    def _at(self, en_m: FloatArray) -> FloatArray:
        west, _, _, north = self.box_m
        place: FloatArray = (en_m[:, :2] - (west, north)) * (self.scale, -self.scale)
        return place

    def _path(self, en_m: FloatArray) -> str:
        return "M" + "L".join(f"{x:.1f} {y:.1f}" for x, y in self._at(en_m))


def image(left: float, top: float, right: float, bottom: float, pixels: NDArray[np.uint8], **look: str) -> str:
    """An embedded image (rows, columns, channels), stretched between its edges."""
    place = {"x": left, "y": top, "width": right - left, "height": bottom - top}
    return element("image", **look, **place, preserveAspectRatio="none", href=data_uri(pixels))


@dataclass(frozen=True)
class Axis:
    """A linear axis from `low` to `high` between two places of a drawing: below and above, or left and right."""

    low: float
    high: float
    begin: float
    end: float

    def at(self, value: FloatArray | float) -> FloatArray:
        """Places of values."""
        share = (np.asarray(value, np.float64) - self.low) / (self.high - self.low)
        place: FloatArray = self.begin + share * (self.end - self.begin)
        return place

    def grid(self, left: float, words: Callable[[float], str], name: Words = "") -> list[str]:
        """Of a vertical axis: grid lines at round values, starting at `left`, with labels; the axis, and its name."""
        step = _round_step((self.high - self.low) / 3.0)
        values = np.arange(np.ceil(self.low / step), np.floor(self.high / step) + 1) * step + 0.0
        places = self.at(values).tolist()
        lines = [
            segment(left, y, WIDTH, y, class_="grid") + label(left - 7, y + 4, figure_text(words(value)), "right")
            for value, y in zip(values.tolist(), places, strict=True)
        ]
        ticks = "".join(f"M{left} {y:.1f}h-5" for y in places)
        lines.append(element("path", class_="ticks", d=f"M{left} {self.end}V{self.begin}{ticks}"))
        return [*lines, turned_label(name, 0.5 * (self.end + self.begin))] if name else lines


def turned_label(text: Words, y: float) -> str:
    """The name of a vertical axis at the left edge."""
    return element("text", text, class_="label middle", x=12, y=y, transform=f"rotate(-90 12 {y:.1f})")


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
        long = length_s >= 3600
        texts = [
            label(x, y + 18, f"{t // 3600}:{t // 60 % 60:02d}:{t % 60:02d}" if t >= 3600 else f"{t // 60}:{t % 60:02d}",
                  "middle" if t else "")
            for t, x in zip(times, places, strict=True)
        ]  # fmt: skip
        text = Text("time since the beginning, h:min:s" if long else "time since the beginning, min:s")
        name = label(WIDTH, y + 34, text, "right")
        return [element("path", class_="ticks", d=f"M{self.left} {y:.1f}H{WIDTH}{ticks}"), *texts, name]


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
        parts.append(element("polyline", class_="curve", points=corners(x[part][kept], y[part][kept])))
    return parts


def _round_step(length: float) -> float:
    """The greatest of 1, 2, 5 times a power of ten not above `length`."""
    power = 10.0 ** np.floor(np.log10(length))
    return float(max(step * power for step in _ROUND_STEPS if step * power <= length * (1 + 1e-9)))


def mixed_colour(share: float, colours: NDArray[np.int64]) -> str:
    """A colour between three (3, 3) by a share from 0 to 1, as CSS."""
    return "#" + "".join(f"{round(np.interp(2.0 * share, (0, 1, 2), channel)):02x}" for channel in colours.T)
