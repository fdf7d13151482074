"""Styles of KML documents with the colours of the layers' QGIS styles."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final
from xml.etree import ElementTree as ET

from furrowmap.exporters.files.result_folder import packaged_style, packaged_styles
from furrowmap.exporters.reports.drawings import pass_colour

PASSES: Final = "passes"
"""The layer whose colours follow the number of the pass."""


@dataclass(frozen=True)
class Look:
    """Colours of features as KML has them: alpha, blue, green and red in hexadecimal.

    Attributes:
        mark: of points and of lines or outlines.
        fill: of areas.
    """

    mark: str
    fill: str


PLAIN: Final = Look("ff404040", "40ffffff")


@dataclass(frozen=True)
class LayerLooks:
    """How a layer's features look.

    Attributes:
        attribute: the field that decides; None if all look alike.
        by_value: looks by the text of that field; "" for all other values.
    """

    attribute: str | None
    by_value: Mapping[str, Look]

    def name(self, layer: str, fields: Mapping[str, str]) -> str:
        """Name of the style of a feature with these fields."""
        value = fields.get(self.attribute, "") if self.attribute is not None else ""
        return style_name(layer, value if value in self.by_value else "")


def style_name(layer: str, value: str) -> str:
    """Name of a style, which is an XML name."""
    return "-".join([layer, *value.split()]) if value else layer


def layer_looks(layer: str, numbers: Sequence[int] = ()) -> LayerLooks:
    """Looks of a layer's features, from its packaged QGIS style.

    Args:
        numbers: of the passes, if it is the layer of passes.
    """
    if f"{layer}.qml" not in packaged_styles():
        return LayerLooks(None, {"": PLAIN})
    root = ET.fromstring(packaged_style(f"{layer}.qml"))  # noqa: S314 - a file of this package
    opacity = float(root.findtext("layerOpacity") or 1.0)
    symbols = {str(symbol.get("name")): _look(symbol, opacity) for symbol in root.iter("symbol")}
    first = symbols["0"]
    if layer == PASSES:
        last = max(numbers, default=0)
        colours = {n: _kml(pass_colour(n, last), first.fill[:2]) for n in numbers}
        return LayerLooks("pass", {"": first} | {str(n): Look(first.mark, colour) for n, colour in colours.items()})
    renderer = next(root.iter("renderer-v2"))
    values = dict(_categories(renderer, symbols))
    return LayerLooks(renderer.get("attr") if values else None, {"": first} | values)


def _categories(renderer: ET.Element, symbols: Mapping[str, Look]) -> Iterator[tuple[str, Look]]:
    for category in renderer.iter("category"):
        yield str(category.get("value")), symbols[str(category.get("symbol"))]


def _look(symbol: ET.Element, opacity: float) -> Look:
    """Colours of a symbol's lowest layer."""
    found: Any = next(symbol.iter("layer"))
    options = {option.get("name"): str(option.get("value")) for option in found.iter("Option")}
    fill = _abgr(options["color"], opacity) if "color" in options and options.get("style") != "no" else "00ffffff"
    line = options.get("line_color") or (options["color"] if symbol.get("type") == "marker" else None)
    return Look(_abgr(line or options["outline_color"], opacity), fill)


def _abgr(colour: str, opacity: float) -> str:
    """Of "red,green,blue,alpha"."""
    red, green, blue, alpha = (int(part) for part in colour.split(",")[:4])
    return f"{round(alpha * opacity):02x}{blue:02x}{green:02x}{red:02x}"


def _kml(colour: str, alpha: str) -> str:
    """Of "#rrggbb"."""
    return f"{alpha}{colour[5:7]}{colour[3:5]}{colour[1:3]}"
