"""KML 2.2 (OGC 07-147r2): folders of placemarks with times, fields and the colours of the layers' QGIS styles."""

import datetime as dt
from collections.abc import Mapping
from itertools import pairwise
from pathlib import Path
from typing import Any, Final
from xml.etree import ElementTree as ET
from zoneinfo import ZoneInfo

import numpy as np
from shapely.geometry import Polygon
from shapely.geometry.base import BaseGeometry, BaseMultipartGeometry

from furrowmap.core.readers.vector_layer import VectorLayer
from furrowmap.core.runtime.errors import Notice, printable
from furrowmap.core.runtime.languages.catalogue import translated
from furrowmap.core.runtime.settings import language_of_user
from furrowmap.exporters.files.provenance import Origin
from furrowmap.exporters.files.result_folder import TRAJECTORY
from furrowmap.exporters.share.symbols import PLAIN_SYMBOL, Symbol, layer_style
from furrowmap.exporters.vectors.labels import COLUMN_LABELS, LAYER_NAMES, VALUES

_NAMESPACE: Final = "http://www.opengis.net/kml/2.2"
_TITLES: Final = ("pass", "kind", "zone", "implement", "scan")
"""The first of these fields that a feature has is its name."""
_PASSES: Final = "passes"
"""The layer whose colours follow the number of the pass."""
_NO_COLOUR: Final = "rgba(255,255,255,0)"
_Styles = tuple[str, Mapping[str, tuple[str, str]]]


def write_kml(path: Path, layers: Mapping[str, VectorLayer], origin: Origin, zone: ZoneInfo) -> list[Notice]:
    """Write one KML file with a folder a layer; the trajectory becomes a line for each quality of its positions.

    Layers are in WGS 84; heights are left out, as viewers relate them to their own terrain model.
    """
    root = ET.Element("kml", xmlns=_NAMESPACE)
    document = ET.SubElement(root, "Document")
    _text(document, "name", origin.title)
    _text(document, "description", "; ".join(f"{name} {text}" for name, text in origin.metadata.items()))
    styles = {name: _colours_by_value(name, layer) for name, layer in layers.items()}
    for name, (_, colours) in styles.items():
        for value, (mark, fill) in colours.items():
            style = ET.SubElement(document, "Style", id=_style_name(name, value))
            _text(ET.SubElement(style, "IconStyle"), "color", mark)
            stroke = ET.SubElement(style, "LineStyle")
            _text(stroke, "color", mark)
            _text(stroke, "width", "2")
            _text(ET.SubElement(style, "PolyStyle"), "color", fill)
    notices = []
    for name, layer in reversed(list(layers.items())):  # KML draws later folders on top
        folder = ET.SubElement(document, "Folder")
        _text(folder, "name", translated(LAYER_NAMES.get(name, name.replace("_", " ")), language_of_user()))
        if name == TRAJECTORY:
            _add_lines(folder, layer, styles[name])
            notices.append(Notice("kml-trajectory"))
        else:
            for shape, row in zip(layer.shapes, layer.rows(), strict=True):
                if shape is not None and not shape.is_empty:
                    _add_placemark(folder, name, shape, row, styles[name], zone)
    ET.indent(root)
    ET.ElementTree(root).write(path, encoding="utf-8", xml_declaration=True)
    return notices


def _colours_by_value(name: str, layer: VectorLayer) -> tuple[str, dict[str, tuple[str, str]]]:
    """The field that decides on the style of a layer ("" for none), and colours by its text; "" for other values."""
    style = layer_style(name, layer.columns)
    found = {"": _colours(style.default)} | {value: _colours(symbol) for value, symbol in style.by_value.items()}
    if name != _PASSES or style.ramp is None:
        return style.attribute, found
    # A damaged layer may have something else in place of numbers.
    passes = [row.get("pass") for row in layer.rows()]
    numbers = [value for value in passes if isinstance(value, int | float) and np.isfinite(value)]
    ramp = {str(int(n)): (found[""][0], _abgr(style.ramp.colour(n, style.opacity))) for n in numbers}
    return style.ramp.attribute, {"": found[""]} | ramp


def _colours(symbol: Symbol) -> tuple[str, str]:
    """Colours of points, lines and outlines, and of areas: alpha, blue, green and red in hexadecimal."""
    mark = symbol.fill if symbol.size_mm and symbol is not PLAIN_SYMBOL else symbol.stroke
    return _abgr(mark or symbol.fill or _NO_COLOUR), _abgr(symbol.fill or _NO_COLOUR)


def _abgr(css: str) -> str:
    """A colour as CSS has it: "rgba(red,green,blue,opacity)"."""
    red, green, blue, opacity = css.removeprefix("rgba(").removesuffix(")").split(",")
    return f"{round(255 * float(opacity)):02x}{int(blue):02x}{int(green):02x}{int(red):02x}"


def _style_of(layer: str, fields: Mapping[str, str], styles: _Styles) -> str:
    """Name of the style of a feature with these fields."""
    attribute, colours = styles
    value = fields.get(attribute, "")
    return _style_name(layer, value if value in colours else "")


def _style_name(layer: str, value: str) -> str:
    """Name of a style, which is an XML name."""
    return "-".join([layer, *value.split()])


def _add_lines(folder: ET.Element, trajectory: VectorLayer, styles: _Styles) -> None:
    """The trajectory in parts of one quality of the positions; each begins where the one before ends."""
    if len(trajectory) < 2:
        return
    xy = trajectory.coordinates
    fix = np.array([_field_text(row.get("fix")) or "" for row in trajectory.rows()], object)
    edges = np.flatnonzero(fix[1:] != fix[:-1]) + 1
    for begin, end in pairwise([0, *edges.tolist(), len(xy)]):
        part = xy[max(begin - 1, 0) : end]
        if len(part) > 1:
            mark = ET.SubElement(folder, "Placemark")
            value = str(fix[begin])
            _text(mark, "name", translated(VALUES["fix"].get(value, "trajectory"), language_of_user()))
            _text(mark, "styleUrl", f"#{_style_of(TRAJECTORY, {'fix': value}, styles)}")
            _text(ET.SubElement(mark, "LineString"), "coordinates", _coordinates(part))


def _add_placemark(
    folder: ET.Element, layer: str, shape: BaseGeometry, row: dict[str, Any], styles: _Styles, zone: ZoneInfo
) -> None:
    """A feature with its fields; times are in a zone."""
    for name, value in row.items():
        if isinstance(value, dt.datetime):
            row[name] = value.astimezone(zone)
    fields = {name: text for name, value in row.items() if (text := _field_text(value)) is not None}
    mark = ET.SubElement(folder, "Placemark")
    key = next((key for key in _TITLES if key in fields), None)
    name = layer if key is None else f"{key} {fields[key]}" if key == "pass" else fields[key]
    _text(mark, "name", f"{fields['tool']}, {name}" if "tool" in fields else name)
    if "start" in fields:  # for the time slider of viewers
        span = ET.SubElement(mark, "TimeSpan")
        _text(span, "begin", fields["start"])
        if "end" in fields:
            _text(span, "end", fields["end"])
    elif "time" in fields:
        _text(ET.SubElement(mark, "TimeStamp"), "when", fields["time"])
    _text(mark, "styleUrl", f"#{_style_of(layer, fields, styles)}")
    data = ET.SubElement(mark, "ExtendedData")
    for name, text in fields.items():
        field = ET.SubElement(data, "Data", name=name)
        if name in COLUMN_LABELS:
            label = translated(COLUMN_LABELS[name], language_of_user())
            _text(field, "displayName", label.replace("UTC", zone.key))
        _text(field, "value", text)
    _add_shape(mark, shape)


def _add_shape(parent: ET.Element, shape: BaseGeometry) -> None:
    if isinstance(shape, BaseMultipartGeometry):
        several = ET.SubElement(parent, "MultiGeometry")
        for part in shape.geoms:
            _add_shape(several, part)
    elif isinstance(shape, Polygon):
        polygon = ET.SubElement(parent, "Polygon")
        for edge, ring in [("outerBoundaryIs", shape.exterior), *(("innerBoundaryIs", r) for r in shape.interiors)]:
            linear = ET.SubElement(ET.SubElement(polygon, edge), "LinearRing")
            _text(linear, "coordinates", _coordinates(np.asarray(ring.coords)))
    else:
        _text(ET.SubElement(parent, shape.geom_type), "coordinates", _coordinates(np.asarray(shape.coords)))


def _coordinates(xy: Any) -> str:
    return " ".join(f"{x:.9f},{y:.9f}" for x, y in xy[:, :2].tolist())


def _field_text(value: Any) -> str | None:
    """A field's value as text; None for NULL."""
    if value is None:
        return None
    if isinstance(value, dt.datetime):
        return value.isoformat(timespec="milliseconds").replace("+00:00", "Z")
    return f"{value:.4f}".rstrip("0").rstrip(".") if isinstance(value, float) else str(value)


def _text(parent: ET.Element, tag: str, text: str) -> None:
    ET.SubElement(parent, tag).text = printable(text)
