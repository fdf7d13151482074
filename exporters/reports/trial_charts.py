"""Charts of a trial as SVG: the response to a dose, and a quantity by treatment or block.

Colours are attributes, not a style sheet, so that a chart is the same in a report and as a file of its own.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from html import escape
from typing import Final

import numpy as np
from numpy.typing import NDArray

from furrowmap.core.crops.response import Response
from furrowmap.exporters.reports.svg import WIDTH, Axis, drawing

FloatArray = NDArray[np.float64]

HEIGHT: Final = 380.0
COLOURS: Final = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#8c6d31", "#444444")
"""Okabe and Ito (2008), which all readers can tell apart, without yellow."""
_LEFT, _RIGHT, _TOP, _BOTTOM = 74.0, WIDTH - 14.0, 34.0, 320.0
_INK, _PALE = "#333333", "#dddddd"
_TEXT: Final = 'font-family="sans-serif" font-size="12"'
_STEPS: Final = (1.0, 2.0, 2.5, 5.0, 10.0)


@dataclass(frozen=True)
class Points:
    """A quantity of n parcels.

    Attributes:
        value: (n,) nan where unknown.
        group: (n,) by which they are coloured, such as their block.
        name: of the quantity, with its unit.
        group_name: such as "block".
    """

    value: FloatArray
    group: Sequence[str]
    name: str
    group_name: str = ""


def standalone(svg: str) -> str:
    """A chart as a file of its own."""
    sized = svg.replace(
        "<svg ", f'<svg xmlns="http://www.w3.org/2000/svg" width="{WIDTH:.0f}" height="{HEIGHT:.0f}" ', 1
    )
    head, _, rest = sized.partition(">")
    return f'<?xml version="1.0" encoding="UTF-8"?>\n{head}><rect width="100%" height="100%" fill="#ffffff"/>{rest}\n'


def response_chart(dose: FloatArray, points: Points, response: Response, dose_name: str) -> str:
    """Parcels over their dose, coloured by block; curve, 95 % band, and the rate beyond which nothing is gained."""
    known = np.isfinite(dose) & np.isfinite(points.value)
    low, high = float(dose[known].min(initial=0.0)), float(dose[known].max(initial=0.0))
    high = high if high > low else 1.0
    x = Axis(low - 0.03 * (high - low), high + 0.03 * (high - low), _LEFT, _RIGHT)
    curve = response.curve
    shown = [points.value[known]] if curve is None else [points.value[known], curve.band_low, curve.band_high]
    y = _vertical(np.concatenate(shown))
    parts = [*_frame(y, points.name), *_ticks(x, low, high, dose_name)]
    if curve is not None:
        if response.plateau_shown:
            parts += _plateau(x, curve.plateau.low, curve.plateau.high, curve.plateau.value)
        around = [
            *zip(curve.dose, curve.band_high, strict=True),
            *reversed([*zip(curve.dose, curve.band_low, strict=True)]),
        ]
        corners = " ".join(f"{x.at(a):.1f},{y.at(b):.1f}" for a, b in around)
        parts.append(f'<polygon points="{corners}" fill="#999999" fill-opacity="0.3"/>')
        line = " ".join(f"{x.at(a):.1f},{y.at(b):.1f}" for a, b in zip(curve.dose, curve.fitted, strict=True))
        parts.append(f'<polyline points="{line}" fill="none" stroke="{_INK}" stroke-width="2"/>')
    parts += _dots(
        x.at(dose[known]), y.at(points.value[known]), [points.group[k] for k in np.flatnonzero(known).tolist()], points
    )
    return drawing(WIDTH, HEIGHT, parts, f"{points.name} over {dose_name}")


def category_chart(category: Sequence[str], points: Points, means: Sequence[tuple[str, float, float, float]]) -> str:
    """Parcels by category, coloured by group, with the mean of each category and its interval.

    Args:
        category: (n,) of each parcel.
        points: the quantity.
        means: name, mean, lower and upper end for each category, in the order of the axis.
    """
    names = [name for name, *_ in means]
    known = np.isfinite(points.value) & np.array([name in names for name in category], bool)
    y = _vertical(np.array([*points.value[known], *(end for _, _, *ends in means for end in ends)]))
    step = (_RIGHT - _LEFT) / max(1, len(names))
    middle = {name: _LEFT + (k + 0.5) * step for k, name in enumerate(names)}
    turned = step < 44.0
    parts = _frame(y, points.name)
    for name, mean, low, high in means:
        at, half = middle[name], min(12.0, 0.3 * step)
        parts.append(_segment(at, y.at(low), at, y.at(high), 2.0))
        parts.append(_segment(at - half, y.at(mean), at + half, y.at(mean), 3.0))
        place = f'x="{at:.1f}" y="{_BOTTOM + 16:.1f}"'
        turn = f' transform="rotate(-40 {at:.1f} {_BOTTOM + 16:.1f})"' if turned else ""
        anchor = "end" if turned else "middle"
        parts.append(f'<text {place}{turn} {_TEXT} fill="{_INK}" text-anchor="{anchor}">{escape(name)}</text>')
    rows = np.flatnonzero(known).tolist()
    groups = [points.group[k] for k in rows]
    order = {name: k for k, name in enumerate(dict.fromkeys(points.group))}
    beside = [(order[group] - 0.5 * (len(order) - 1)) * min(7.0, 0.5 * step / len(order)) for group in groups]
    at_x = np.array([middle[category[k]] for k in rows]) + np.array(beside)
    parts += _dots(at_x, y.at(points.value[known]), groups, points)
    return drawing(WIDTH, HEIGHT, parts, f"{points.name} by category")


def _vertical(values: FloatArray) -> Axis:
    known = values[np.isfinite(values)]
    low, high = (float(known.min()), float(known.max())) if len(known) else (0.0, 1.0)
    margin = 0.06 * (high - low) or 0.1 * abs(high) or 1.0
    return Axis(low - margin, high + margin, _BOTTOM, _TOP)


def _frame(y: Axis, name: str) -> list[str]:
    parts = []
    for value in _round_values(y.low, y.high):
        at = float(y.at(value))
        parts.append(_segment(_LEFT, at, _RIGHT, at, 1.0, _PALE))
        parts.append(
            f'<text x="{_LEFT - 6}" y="{at + 4:.1f}" {_TEXT} fill="{_INK}" text-anchor="end">{value:.4g}</text>'
        )
    parts.append(f'<text x="6" y="16" {_TEXT} fill="{_INK}">{escape(name)}</text>')
    return parts


def _ticks(x: Axis, low: float, high: float, name: str) -> list[str]:
    parts = [
        f'<text x="{x.at(value):.1f}" y="{_BOTTOM + 16}" {_TEXT} fill="{_INK}" text-anchor="middle">{value:g}</text>'
        for value in _round_values(low, high)
    ]
    middle = 0.5 * (_LEFT + _RIGHT)
    label = f'<text x="{middle:.0f}" y="{_BOTTOM + 36}" {_TEXT} fill="{_INK}" text-anchor="middle">'
    return [*parts, f"{label}{escape(name)}</text>"]


def _plateau(x: Axis, low: float, high: float, value: float) -> list[str]:
    left, right, at = (float(x.at(np.clip(end, x.low, x.high))) for end in (low, high, value))
    size = f'width="{right - left:.1f}" height="{_BOTTOM - _TOP}"'
    return [
        f'<rect x="{left:.1f}" y="{_TOP}" {size} fill="#009e73" fill-opacity="0.12"/>',
        f'<line x1="{at:.1f}" x2="{at:.1f}" y1="{_TOP}" y2="{_BOTTOM}" stroke="#009e73" stroke-dasharray="5 4"/>',
    ]


def _dots(x: FloatArray, y: FloatArray, groups: Sequence[str], points: Points) -> Iterable[str]:
    names = list(dict.fromkeys(points.group))
    colour = {name: COLOURS[k % len(COLOURS)] for k, name in enumerate(names)}
    for a, b, group in zip(x, y, groups, strict=True):
        yield f'<circle cx="{a:.1f}" cy="{b:.1f}" r="3.5" fill="{colour[group]}" fill-opacity="0.8"/>'
    if len(names) < 2 or not points.group_name:
        return
    at = _RIGHT
    for name in reversed(names[: len(COLOURS)]):
        label = f"{points.group_name} {name}"
        at -= 7.0 * len(label) + 16.0
        yield f'<circle cx="{at:.1f}" cy="12" r="4" fill="{colour[name]}"/>'
        yield f'<text x="{at + 8:.1f}" y="16" {_TEXT} fill="{_INK}">{escape(label)}</text>'


def _segment(x1: float, y1: object, x2: float, y2: object, width: float, colour: str = _INK) -> str:
    return f'<line x1="{x1:.1f}" y1="{y1:.1f}" x2="{x2:.1f}" y2="{y2:.1f}" stroke="{colour}" stroke-width="{width:g}"/>'


def _round_values(low: float, high: float) -> list[float]:
    """About five round values between two."""
    rough = (high - low) / 5.0
    power = 10.0 ** np.floor(np.log10(rough)) if rough > 0.0 else 1.0
    step = min((each * power for each in _STEPS if each * power >= rough * (1 - 1e-9)), default=1.0)
    first, last = int(np.ceil(low / step - 1e-9)), int(np.floor(high / step + 1e-9))
    return [float(k * step) for k in range(first, last + 1)]
