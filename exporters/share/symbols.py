"""The colours of vector layers on a page, from their QGIS styles."""

import math
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any, Final
from xml.etree import ElementTree as ET

import numpy as np

from furrowmap.exporters.files.result_folder import packaged_styles
from furrowmap.exporters.share.shown_layers import vector_style

_STOPS: Final = re.compile(r"create_ramp\(map\(([^)]*)\)\)")
_RANKED: Final = re.compile(r'if\(maximum\("(\w+)"\) > (1|minimum)')
_AROUND_ZERO: Final = re.compile(r'0\.5 \+ "(\w+)" / ([\d.]+)')


_DOTTED: Final[Mapping[str, float]] = {
    "dense1": 0.94,
    "dense2": 0.88,
    "dense3": 0.63,
    "dense4": 0.5,
    "dense5": 0.37,
    **dict.fromkeys(("dense6", "dense7"), 0.25),
}
"""Share of an area that the dots of a brush of QGIS cover; at least a quarter, so that a page shows it."""


@dataclass(frozen=True)
class Symbol:
    """How a feature is drawn: CSS colours of line and area or marker, None for none, and diameter of a marker."""

    stroke: str | None = None
    fill: str | None = None
    width_mm: float = 0.0
    size_mm: float = 0.0
    dashed: bool = False


PLAIN_SYMBOL: Final = Symbol("rgba(64,64,64,1)", "rgba(255,255,255,0.25)", 0.3, 2.0)


@dataclass(frozen=True)
class Ramp:
    """Fill colours by a number: stops (n, 4) of position 0 to 1, red, green, blue, from the value low to high."""

    attribute: str
    stops: np.ndarray[Any, np.dtype[np.float64]]
    low: float
    high: float

    def colour(self, value: float, opacity: float = 1.0) -> str:
        """The CSS colour of a value."""
        at = (value - self.low) / (self.high - self.low) if self.high > self.low else 0.5
        rgb = (np.interp(at, self.stops[:, 0], channel) for channel in self.stops[:, 1:].T)
        return "rgba({:.0f},{:.0f},{:.0f},{:g})".format(*rgb, opacity)


@dataclass(frozen=True)
class LayerStyle:
    """How a layer is drawn.

    Attributes:
        default: symbol of features of no category.
        attribute: the field that decides on the category; empty for none.
        by_value: symbols by the text of that field.
        labels: of the categories, for people.
        ramp: fill colours by a number, instead of categories; None for none.
        opacity: of the layer, which the symbols contain.
        label_attribute: the field that is written on the map; empty for none.
    """

    default: Symbol = PLAIN_SYMBOL
    attribute: str = ""
    by_value: Mapping[str, Symbol] = field(default_factory=dict)
    labels: Mapping[str, str] = field(default_factory=dict)
    ramp: Ramp | None = None
    opacity: float = 1.0
    label_attribute: str = ""


def layer_style(name: str, values: Mapping[str, Iterable[Any]]) -> LayerStyle:
    """The style of a layer; colours may depend on the least and the greatest of the `values` of its fields."""
    if f"{name}.qml" not in packaged_styles():
        return LayerStyle()
    root = ET.fromstring(vector_style(name))  # noqa: S314 - a file of this package
    opacity = float(root.findtext("layerOpacity") or 1.0)
    renderer = next(root.iter("renderer-v2"))
    symbols = {str(one.get("name")): _symbol(one, opacity) for one in renderer.iter("symbol")}
    categories = list(renderer.iter("category"))
    known = {str(one.get("value")): one for one in categories}
    text = root.find("labeling/settings/text-style")
    return LayerStyle(
        symbols.get(str(known[""].get("symbol")), PLAIN_SYMBOL) if "" in known else symbols["0"],
        str(renderer.get("attr") or "") if categories else "",
        {value: symbols[str(one.get("symbol"))] for value, one in known.items()},
        {value: str(one.get("label")) for value, one in known.items()},
        _ramp(renderer, values),
        opacity,
        str(text.get("fieldName")) if text is not None else "",
    )


def _ramp(renderer: ET.Element, values: Mapping[str, Iterable[Any]]) -> Ramp | None:
    """The ramp that the fill colour's expression describes; None for no such expression."""
    for option in renderer.iter("Option"):
        text = str(option.get("value"))
        if option.get("name") != "expression" or (listed := _STOPS.search(text)) is None:
            continue
        parts = [part.strip().strip("'") for part in listed[1].split(",")]
        rgb = [[int(colour[at : at + 2], 16) for at in (1, 3, 5)] for colour in parts[1::2]]
        stops = np.column_stack([np.array(parts[::2], float), np.array(rgb, float)])
        if (around := _AROUND_ZERO.search(text)) is not None:
            half = 0.5 * float(around[2])
            return Ramp(around[1], stops, -half, half)
        ranked = _RANKED.search(text)
        assert ranked is not None, text
        known = [value for value in values.get(ranked[1], ()) if isinstance(value, int | float | np.number)]
        numbers = [float(value) for value in known if math.isfinite(value)]
        if not numbers:
            return None
        return Ramp(ranked[1], stops, 1.0 if ranked[2] == "1" else min(numbers), max(numbers))
    return None


def _symbol(symbol: ET.Element, opacity: float) -> Symbol:
    """A symbol's lowest layer."""
    found = next(symbol.iter("layer"))
    options = {str(option.get("name")): str(option.get("value")) for option in found.iterfind("Option/Option")}
    width_mm = float(options.get("line_width") or options.get("outline_width") or 0.0)
    dashed = (options.get("line_style") or options.get("outline_style", "")) in ("dot", "dash", "dash dot")
    if symbol.get("type") == "line":
        return Symbol(_css(options["line_color"], opacity), None, width_mm, dashed=dashed)
    outlined = options.get("outline_style") != "no" and "outline_color" in options
    filled = "color" in options and options.get("style") != "no"
    return Symbol(
        _css(options["outline_color"], opacity) if outlined else None,
        _css(options["color"], opacity * _DOTTED.get(options.get("style", ""), 1.0)) if filled else None,
        width_mm,
        float(options.get("size", 0.0)),
        dashed,
    )


def _css(colour: str, opacity: float) -> str:
    """Of "red,green,blue,alpha"."""
    red, green, blue, alpha = (int(part) for part in colour.split(",")[:4])
    return f"rgba({red},{green},{blue},{alpha / 255 * opacity:.3g})"
