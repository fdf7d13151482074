"""The features of vector layers for a page: geometry, symbol, and what a tap shows."""

import datetime as dt
import json
import math
from collections.abc import Callable, Mapping
from dataclasses import asdict, replace
from typing import Any, Final
from zoneinfo import ZoneInfo

import numpy as np
import shapely

from furrowmap.core.geodesy.local_time import clock_words, local_time
from furrowmap.core.readers.vector_file import VectorLayer
from furrowmap.core.runtime.errors import printable
from furrowmap.core.runtime.languages.templates import Figures
from furrowmap.core.values.margins import with_margin
from furrowmap.exporters.share.symbols import LayerStyle, Symbol, layer_style
from furrowmap.exporters.vectors.crop_layers import PARCELS_LAYER
from furrowmap.exporters.vectors.labels import SHARED_LAYERS

MAX_SHOWN_FEATURES: Final = 5000
"""Of a layer; of more, every second, third… is shown."""
SIMPLIFICATION_M: Final = 0.01
"""By which outlines and lines are simplified."""
MAP_DIGITS: Final = 3
Format = Callable[[Any, Mapping[str, Any]], str]
"""Of a value, and of the fields of its row."""


def shared_layer(name: str, layer: VectorLayer, zone: ZoneInfo, *, shown: bool) -> dict[str, Any] | None:
    """A layer of `field.gpkg` as the page reads it, on at first if it is `shown`; None for no features."""
    layer = layer.where(~(shapely.is_missing(layer.shapes) | shapely.is_empty(layer.shapes)))
    every = max(1, math.ceil(len(layer) / MAX_SHOWN_FEATURES))
    layer = layer.where(slice(None, None, every))
    if not len(layer):
        return None
    style = layer_style(name, layer.columns)
    symbols: list[Symbol] = []
    features = []
    flat = shapely.simplify(shapely.force_2d(layer.shapes), SIMPLIFICATION_M)
    shapes = shapely.to_geojson(shapely.transform(flat, lambda xy: np.round(xy, MAP_DIGITS)))
    for shape, row in zip(map(json.loads, shapes), layer.rows(), strict=True):
        known = {key: value for key, value in row.items() if value is not None}
        symbol = _symbol_of(style, known)
        if symbol not in symbols:
            symbols.append(symbol)
        feature = {"symbol": symbols.index(symbol), "geometry": shape, "rows": feature_rows(known, style, zone)}
        if style.label_attribute in known:
            parts = [known[name] for name in ("tool", style.label_attribute) if name in known]
            feature["label"] = printable(" ".join(map(str, parts)))
        elif name == PARCELS_LAYER and "mean_height_m" in known:
            feature |= {"label": f"{100.0 * known['mean_height_m']:.1f} cm", "measured": True}
        features.append(feature)
    return {
        "name": name,
        "title": SHARED_LAYERS.get(name, name.replace("_", " ")),
        "shown": shown,
        "every": every,
        "names_overflow": name != PARCELS_LAYER,
        "legend": _legend(style, symbols, layer),
        "symbols": [asdict(symbol) for symbol in symbols],
        "features": features,
    }


def _symbol_of(style: LayerStyle, row: Mapping[str, Any]) -> Symbol:
    if style.ramp is not None and style.ramp.attribute in row:
        fill = style.ramp.colour(float(row[style.ramp.attribute]), style.opacity)
        return replace(style.default, fill=fill, dashed=False)
    return style.by_value.get(str(row.get(style.attribute, "")), style.default)


def _legend(style: LayerStyle, symbols: list[Symbol], layer: VectorLayer) -> list[dict[str, Any]]:
    """The categories that the layer has, or the ends of the ramp."""
    if style.ramp is not None:
        _, text = SHOWN_FIELDS[style.ramp.attribute]
        ends = dict.fromkeys((style.ramp.low, 0.5 * (style.ramp.low + style.ramp.high), style.ramp.high))
        legend = []
        for value in ends:
            symbol = _symbol_of(style, {style.ramp.attribute: value})
            if symbol not in symbols:
                symbols.append(symbol)
            legend.append({"label": text(value, {}), "symbol": symbols.index(symbol)})
        return legend
    if not style.by_value or style.attribute not in layer.columns:
        return []
    there = {"" if row[style.attribute] is None else str(row[style.attribute]) for row in layer.rows()}
    chosen = {value if value in style.by_value else "" for value in there}
    return [
        {"label": style.labels[value], "symbol": symbols.index(symbol)}
        for value, symbol in style.by_value.items()
        if value in chosen and symbol in symbols
    ]


def feature_rows(row: Mapping[str, Any], style: LayerStyle, zone: ZoneInfo) -> list[tuple[str, str]]:
    """Name and value of what a feature's fields say, for people; `row` is without fields that are NULL."""
    rows: list[tuple[str, str]] = []
    for field, (label, text) in SHOWN_FIELDS.items():
        if field not in row:
            continue
        value = row[field]
        words = style.labels.get(str(value)) if field == style.attribute else None
        rows.append((label, words or printable(text(value, row))))
    if "start" in row and "end" in row:
        rows.append(("Time", f"{_clock(row['start'], zone)} – {_clock(row['end'], zone)} ({zone.key})"))
    elif "start" in row or "time" in row:
        rows.append(("Time", f"{_clock(row.get('start', row.get('time')), zone)} ({zone.key})"))
    return rows


def _clock(moment: Any, zone: ZoneInfo) -> str:
    t_s = float(moment.timestamp())
    return f"{local_time(t_s, zone):%Y-%m-%d} {clock_words(t_s, zone)}"


def _number(digits: int, unit: str = "", factor: float = 1.0, sigma: str = "") -> Format:
    """Formats a number with its unit and, if its row has a standard deviation, its margin of error."""

    def words(value: Any, row: Mapping[str, Any]) -> str:
        said = with_margin(float(value), row.get(sigma), unit, factor, digits)
        return Figures(f"{said} (95 %)" if "±" in said else said)

    return words


def _text(value: Any, row: Mapping[str, Any]) -> str:  # noqa: ARG001 (one of the formats)
    if isinstance(value, bool):
        return "yes" if value else "no"
    return f"{value:.0f}" if isinstance(value, float) else str(value)


SHOWN_FIELDS: Final[Mapping[str, tuple[str, Format]]] = {
    "kind": ("Kind", _text),
    "zone": ("Kind", _text),
    "id": ("Parcel", _text),
    "block": ("Block", _text),
    "treatment": ("Treatment", _text),
    "pass": ("Pass", _text),
    "pass_a": ("Passes concerned", lambda value, row: f"{value}, {row.get('pass_b', '')}"),
    "strip": ("Strip", _text),
    "strip_a": ("Strip", lambda value, row: f"{row.get('strip_b', '')} − {value}"),
    "scan": ("Scan", _text),
    "implement": ("Tool", _text),
    "tool": ("Name of the tool", _text),
    "motion": ("Motion", _text),
    "fix": ("Positioning", _text),
    "area_m2": ("Area", _number(1, " m²", sigma="area_sigma_m2")),
    "worked_share": ("Worked share", _number(1, " %", 100.0)),
    "length_m": ("Length", _number(1, " m")),
    "width_m": ("Width", _number(2, " m")),
    "speed_mps": ("Speed", _number(1, " km/h", 3.6)),
    "heading_deg": ("Heading", _number(1, "°")),
    "depth_m": ("Depth (approximate)", _number(0, " cm", 100.0, sigma="depth_sigma_m")),
    "mean_height_m": ("Mean height", _number(1, " cm", 100.0, sigma="height_sigma_m")),
    "p95_m": ("95th percentile of heights", _number(1, " cm", 100.0)),
    "volume_m3": ("Volume", _number(2, " m³", sigma="volume_sigma_m3")),
    "cover": ("Cover", _number(1, " %", 100.0)),
    "lodging": ("Lodging", _text),
    "n_kg_ha": ("Nitrogen", _number(0, " kg/ha")),
    "points_m2": ("Points a square metre", _number(0)),
    "after_m": ("Difference", _number(1, " mm", 1000.0)),
    "before_m": ("Difference with the stated mounting", _number(1, " mm", 1000.0)),
}
"""Label and format of the fields that people read; the GeoPackage has all."""
MEASURES: Final = tuple(label for label, words in SHOWN_FIELDS.values() if isinstance(words(1.0, {}), Figures))
"""Labels of the fields with numbers that follow the language of the page."""


def moment_s(text: str) -> float:
    """UTC in seconds since 1970 of a time in a report."""
    return dt.datetime.fromisoformat(text).timestamp()
