"""Charts of a trial as SVG: the response to a dose, its residuals, and a quantity by treatment or block.

Colours are attributes, not a style sheet, so that a chart is the same in a report and as a file of its own.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final
from unicodedata import east_asian_width

import numpy as np
from markupsafe import Markup
from scipy import special

from furrowmap.core.crops.response_values import Estimate, Response
from furrowmap.core.crops.response_words import MIN_WEIGHT, MODEL_WORDS
from furrowmap.core.runtime.arrays import FloatArray
from furrowmap.core.runtime.languages.texts import ENGLISH, Text, Words, figure_text
from furrowmap.exporters.reports.page_language import chosen
from furrowmap.exporters.reports.svg import WIDTH, Axis, Number, corners, drawing, element, rectangle, segment

CHART_HEIGHT: Final = 424.0
GROUP_COLOURS: Final = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#8c6d31", "#444444")
"""Okabe and Ito (2008), which all readers can tell apart, without yellow."""
_LEFT: Final = 74.0
_RIGHT: Final = WIDTH - 14.0
_TOP: Final = 34.0
_BOTTOM: Final = 320.0
_KEYS: Final = ((6.0, 36.0), (330.0, 36.0), (6.0, 12.0), (500.0, 12.0))
"""Where the keys of a curve begin, and their height above the edge: with room for the large letters of a phone."""
_INK: Final = "#333333"
_PALE: Final = "#dddddd"
_RIVAL: Final = "#8c6d31"
_GREEN: Final = "#009e73"
_TICK_STEPS: Final = (1.0, 2.0, 2.5, 5.0, 10.0)


@dataclass(frozen=True)
class ParcelValues:
    """A quantity of n parcels, nan where unknown, with the groups by which they are coloured, such as their block."""

    value: FloatArray
    group: Sequence[str]
    name: Words
    group_name: Words = ""


def standalone(svg: str, language: str = ENGLISH) -> str:
    """A chart as a file of its own, in a language."""
    head, _, rest = chosen(svg, language).removeprefix("<svg ").partition(">")
    size = f'xmlns="http://www.w3.org/2000/svg" width="{WIDTH:.0f}" height="{CHART_HEIGHT:.0f}"'
    ground = '<rect width="100%" height="100%" fill="#ffffff"/>'
    return f'<?xml version="1.0" encoding="UTF-8"?>\n<svg {size} {head}>{ground}{rest}\n'


def response_chart(dose: FloatArray, points: ParcelValues, response: Response, dose_name: Words) -> Markup:
    """Parcels over their dose, coloured by block; curve, its 95 % band, rivals, and the optimum with its interval."""
    known = np.isfinite(dose) & np.isfinite(points.value)
    low = float(dose[known].min(initial=0.0))
    high = float(dose[known].max(initial=0.0))
    high = high if high > low else 1.0
    x = Axis(low - 0.03 * (high - low), high + 0.03 * (high - low), _LEFT, _RIGHT)
    y, parts = _vertical_axis(np.concatenate([points.value[known], response.band_low, response.band_high]), points.name)
    parts += [
        _text(x.at(value), _BOTTOM + 16, figure_text(f"{value:g}"), "middle") for value in _round_values(low, high)
    ]
    parts.append(_text(0.5 * (_LEFT + _RIGHT), _BOTTOM + 36, dose_name, "middle"))
    if response.models:
        optimum = response.economic or response.agronomic
        if optimum is not None:
            parts += _optimum(x, optimum, response.highest)
        around = corners(
            x.at(np.append(response.dose, response.dose[::-1])),
            y.at(np.append(response.band_high, response.band_low[::-1])),
        )
        parts.append(element("polygon", points=around, fill="#999999", fill_opacity="0.3"))
        first, *rivals = response.models
        for rival in rivals:
            if rival.weight >= MIN_WEIGHT:
                line = corners(x.at(response.dose), y.at(rival.fitted))
                parts.append(element("polyline", points=line, fill="none", stroke=_RIVAL, stroke_width=1))
        line = corners(x.at(response.dose), y.at(first.fitted))
        parts.append(element("polyline", points=line, fill="none", stroke=_INK, stroke_width=2))
        parts += _curve_legend(response)
    parts += _dots(x.at(dose[known]), y.at(points.value[known]), np.flatnonzero(known).tolist(), points)
    return drawing(WIDTH, CHART_HEIGHT, parts, Text("{quantity} over {dose}", quantity=points.name, dose=dose_name))


def _optimum(x: Axis, optimum: Estimate, highest: float) -> Iterable[str]:
    """Its interval, and itself where it is within the doses."""
    left, right, at = x.at(np.array([optimum.low, optimum.high, optimum.value])).tolist()
    yield rectangle(left, _TOP, right, _BOTTOM, fill=_GREEN, fill_opacity="0.12")
    if optimum.value < highest:
        yield segment(at, _TOP, at, _BOTTOM, stroke=_GREEN, stroke_dasharray="5 4")


def _curve_legend(response: Response) -> Iterable[str]:
    """What lines, band and dashes are, below the axis."""
    optimum = Text(
        "economic optimum, 95 %" if response.economic is not None else "dose beyond which nothing is gained, 95 %"
    )
    keys: list[tuple[Text, str, dict[str, str]]] = [
        (MODEL_WORDS[response.models[0].name], _INK, {}),
        (Text("its 95 % band"), "#999999", {"opacity": "0.5"}),
        (optimum, _GREEN, {"stroke_dasharray": "5 4"}),
    ]
    if any(rival.weight >= MIN_WEIGHT for rival in response.models[1:]):
        keys.append((Text("others"), _RIVAL, {}))
    for (at, above), (words, colour, look) in zip(_KEYS, keys, strict=False):
        y = CHART_HEIGHT - above
        yield segment(at, y - 4, at + 18, y - 4, stroke=colour, stroke_width=3, **look)
        yield _text(at + 24, y, words)


def residual_chart(expected: FloatArray, residual: FloatArray, points: ParcelValues) -> Markup:
    """Residuals of parcels over what is expected of them, and in order over those of a normal distribution."""
    known = np.flatnonzero(np.isfinite(residual))
    middle = 0.5 * (_LEFT + _RIGHT)
    y, parts = _vertical_axis(residual[known], Text("residual"))
    parts.append(segment(_LEFT, y.at(0.0), _RIGHT, y.at(0.0), stroke=_INK, stroke_width=1))
    if len(known):
        low = float(expected[known].min())
        high = float(expected[known].max())
        high = high if high > low else low + 1.0
        x = Axis(low - 0.05 * (high - low), high + 0.05 * (high - low), _LEFT, middle - 10.0)
        parts += [
            _text(x.at(value), _BOTTOM + 16, figure_text(f"{value:.4g}"), "middle")
            for value in _round_values(low, high)
        ]
        parts += _dots(x.at(expected[known]), y.at(residual[known]), known.tolist(), points)
        order = known[np.argsort(residual[known])]
        share = (np.arange(len(order)) + 0.625) / (len(order) + 0.25)
        normal = special.ndtri(share)
        reach = max(float(normal.max(initial=1.0)), 1.0)
        x = Axis(-1.1 * reach, 1.1 * reach, middle + 30.0, _RIGHT)
        spread = float(residual[known].std())
        ends = np.array([-reach, reach])
        line = corners(x.at(ends), y.at(np.clip(spread * ends, y.low, y.high)))
        parts.append(element("polyline", points=line, fill="none", stroke=_RIVAL, stroke_width=1))
        parts += [
            _text(x.at(value), _BOTTOM + 16, figure_text(f"{value:g}"), "middle")
            for value in _round_values(-reach, reach)
        ]
        parts += _dots(x.at(normal), y.at(residual[order]), order.tolist(), replace(points, group_name=""))
    parts.append(_text(0.25 * (3.0 * _LEFT + _RIGHT), _BOTTOM + 36, Text("expected"), "middle"))
    parts.append(_text(0.25 * (_LEFT + 3.0 * _RIGHT), _BOTTOM + 36, Text("of a normal distribution"), "middle"))
    return drawing(WIDTH, CHART_HEIGHT, parts, Text("residuals"))


def category_chart(
    category: Sequence[str],
    points: ParcelValues,
    means: Sequence[tuple[str, float, float, float]],
    letters: Mapping[str, str] | None = None,
) -> Markup:
    """Parcels by category, coloured by group; `means` are name, mean, lower and upper end for each, in their order.

    `letters` stand above the categories: means that share one do not differ.
    """
    names = [name for name, *_ in means]
    known = np.isfinite(points.value) & np.array([name in names for name in category], bool)
    y, parts = _vertical_axis(
        np.array([*points.value[known], *(end for _, _, *ends in means for end in ends)]), points.name
    )
    step = (_RIGHT - _LEFT) / max(1, len(names))
    middle = {name: _LEFT + (k + 0.5) * step for k, name in enumerate(names)}
    below = _BOTTOM + 16
    for name, mean, low, high in means:
        at = middle[name]
        half = min(12.0, 0.3 * step)
        parts.append(segment(at, y.at(low), at, y.at(high), stroke=_INK, stroke_width=2))
        parts.append(segment(at - half, y.at(mean), at + half, y.at(mean), stroke=_INK, stroke_width=3))
        if letters:
            parts.append(_text(at, _TOP - 4, letters.get(name, ""), "middle"))
        turn = {"transform": f"rotate(-40 {at:.1f} {below:.1f})"} if step < 44.0 else {}
        parts.append(_text(at, below, name, "end" if turn else "middle", **turn))
    rows = np.flatnonzero(known).tolist()
    order = {name: k for k, name in enumerate(dict.fromkeys(points.group))}
    beside = min(7.0, 0.5 * step / max(1, len(order)))
    at_x = [middle[category[k]] + (order[points.group[k]] - 0.5 * (len(order) - 1)) * beside for k in rows]
    parts += _dots(at_x, y.at(points.value[known]), rows, points)
    return drawing(WIDTH, CHART_HEIGHT, parts, Text("{quantity} by category", quantity=points.name))


def _vertical_axis(values: FloatArray, name: Words) -> tuple[Axis, list[str]]:
    """An axis with room for all values, and its drawing."""
    known = values[np.isfinite(values)]
    low, high = (float(known.min()), float(known.max())) if len(known) else (0.0, 1.0)
    margin = 0.06 * (high - low) or 0.1 * abs(high) or 1.0
    axis = Axis(low - margin, high + margin, _BOTTOM, _TOP)
    parts = [_text(6, 16, name)]
    for value in _round_values(axis.low, axis.high):
        y = axis.at(value)
        parts.append(segment(_LEFT, y, _RIGHT, y, stroke=_PALE, stroke_width=1))
        parts.append(_text(_LEFT - 6, y + 4, figure_text(f"{value:.4g}"), "end"))
    return axis, parts


def _dots(x: Iterable[float], y: Iterable[float], rows: Iterable[int], points: ParcelValues) -> Iterable[str]:
    """The parcels of some rows, and the legend of the groups."""
    names = list(dict.fromkeys(points.group))
    colour = {name: GROUP_COLOURS[k % len(GROUP_COLOURS)] for k, name in enumerate(names)}
    for a, b, row in zip(x, y, rows, strict=True):
        yield element("circle", cx=a, cy=b, r="3.5", fill=colour[points.group[row]], fill_opacity="0.8")
    if len(names) < 2 or not points.group_name:
        return
    at = _RIGHT
    for name in reversed(names[: len(GROUP_COLOURS)]):
        at -= sum(12.0 if east_asian_width(letter) in "WF" else 7.0 for letter in name) + 20.0
        yield element("circle", cx=at, cy=12, r=4, fill=colour[name])
        yield _text(at + 8, 16, name)
    yield _text(at - 10, 16, points.group_name, "end")


def _text(x: Number, y: Number, text: Words, anchor: str = "start", **more: str) -> str:
    look = {"font_family": "sans-serif", "font_size": "12", "fill": _INK, "text_anchor": anchor}
    return element("text", text, x=x, y=y, **look, **more)


def _round_values(low: float, high: float) -> list[float]:
    """About five round values between two."""
    rough = (high - low) / 5.0
    power = 10.0 ** np.floor(np.log10(rough)) if rough > 0.0 else 1.0
    step = min((each * power for each in _TICK_STEPS if each * power >= rough * (1 - 1e-9)), default=1.0)
    first = int(np.ceil(low / step - 1e-9))
    last = int(np.floor(high / step + 1e-9))
    return [float(k * step) for k in range(first, last + 1)]
