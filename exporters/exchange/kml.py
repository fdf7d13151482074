"""KML 2.2 (OGC 07-147r2): folders of placemarks with times, colours and fields."""

from __future__ import annotations

import datetime as dt
from collections.abc import Mapping
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final
from xml.etree import ElementTree as ET
from zoneinfo import ZoneInfo

import numpy as np
import pandas as pd
from shapely.geometry import Polygon
from shapely.geometry.base import BaseGeometry, BaseMultipartGeometry

from furrowmap.core.runtime.errors import Notice, printable
from furrowmap.core.runtime.languages.catalogue import translated
from furrowmap.core.runtime.settings import language_of_user
from furrowmap.exporters.exchange.kml_styles import PASSES, LayerLooks, Look, layer_looks, style_name
from furrowmap.exporters.files.provenance import Origin
from furrowmap.exporters.files.result_folder import TRAJECTORY
from furrowmap.exporters.vectors.layer_words import ALIASES, NAMES, VALUES

if TYPE_CHECKING:
    import geopandas as gpd

_NAMESPACE: Final = "http://www.opengis.net/kml/2.2"
_TITLES: Final = ("pass", "kind", "zone", "implement", "scan")
"""The first of these fields that a feature has is its name."""


def write_kml(path: Path, layers: Mapping[str, gpd.GeoDataFrame], origin: Origin, zone: ZoneInfo) -> list[Notice]:
    """Write one KML file with a folder a layer; the trajectory becomes a line for each quality of its positions.

    Args:
        layers: in WGS 84; heights are left out, as viewers relate them to their own terrain model.
        origin: provenance, with the title of the document.
        zone: time zone of the times in fields.
    """
    root = ET.Element("kml", xmlns=_NAMESPACE)
    document = ET.SubElement(root, "Document")
    _text(document, "name", origin.title)
    _text(document, "description", "; ".join(f"{name} {text}" for name, text in origin.metadata.items()))
    looks = {name: layer_looks(name, _numbers(layer) if name == PASSES else ()) for name, layer in layers.items()}
    for name, look in looks.items():
        for value in look.by_value:
            _add_style(document, style_name(name, value), look.by_value[value])
    notices = []
    for name, layer in reversed(list(layers.items())):  # KML draws later folders on top
        folder = ET.SubElement(document, "Folder")
        _text(folder, "name", translated(NAMES.get(name, name.replace("_", " ")), language_of_user()))
        if name == TRAJECTORY:
            _add_lines(folder, layer, looks[name])
            notices.append(Notice("kml-trajectory"))
        else:
            for row in layer.to_dict("records"):
                _add_placemark(folder, name, _in_zone(row, zone), str(layer.geometry.name), looks[name], zone)
    ET.indent(root)
    ET.ElementTree(root).write(path, encoding="utf-8", xml_declaration=True)
    return notices


def _numbers(layer: gpd.GeoDataFrame) -> list[int]:
    """Numbers of the passes, without what a damaged layer has in their place."""
    if "pass" not in layer:
        return []
    numbers = pd.to_numeric(layer["pass"], errors="coerce")
    return [int(number) for number in numbers[np.isfinite(numbers)]]


def _add_style(document: ET.Element, name: str, look: Look) -> None:
    style = ET.SubElement(document, "Style", id=name)
    _text(ET.SubElement(style, "IconStyle"), "color", look.mark)
    stroke = ET.SubElement(style, "LineStyle")
    _text(stroke, "color", look.mark)
    _text(stroke, "width", "2")
    _text(ET.SubElement(style, "PolyStyle"), "color", look.fill)


def _add_lines(folder: ET.Element, trajectory: gpd.GeoDataFrame, looks: LayerLooks) -> None:
    """The trajectory in parts of one quality of the positions; each begins where the one before ends."""
    points = trajectory.geometry
    if len(points) < 2:
        return
    xy = np.column_stack([points.x, points.y])
    known = "fix" in trajectory
    fix = np.array([_field_text(value) or "" for value in trajectory["fix"]] if known else [""] * len(xy), object)
    edges = np.flatnonzero(fix[1:] != fix[:-1]) + 1
    for begin, end in pairwise([0, *edges.tolist(), len(xy)]):
        part = xy[max(begin - 1, 0) : end]
        if len(part) > 1:
            mark = ET.SubElement(folder, "Placemark")
            value = str(fix[begin])
            _text(mark, "name", translated(VALUES["fix"].get(value, "trajectory"), language_of_user()))
            _text(mark, "styleUrl", f"#{looks.name(TRAJECTORY, {'fix': value})}")
            _text(ET.SubElement(mark, "LineString"), "coordinates", _coordinates(part))


def _in_zone(row: dict[str, Any], zone: ZoneInfo) -> dict[str, Any]:
    """The fields of a feature with its times in a zone."""
    return {name: value.astimezone(zone) if _is_time(value) else value for name, value in row.items()}


def _is_time(value: Any) -> bool:
    return isinstance(value, dt.datetime) and value == value and value.tzinfo is not None  # NaT is not itself


def _add_placemark(
    folder: ET.Element, layer: str, row: dict[str, Any], geometry: str, looks: LayerLooks, zone: ZoneInfo
) -> None:
    shape = row.pop(geometry)
    if shape is None or shape.is_empty:
        return
    fields = {str(name): text for name, value in row.items() if (text := _field_text(value)) is not None}
    mark = ET.SubElement(folder, "Placemark")
    key = next((key for key in _TITLES if key in fields), None)
    _text(mark, "name", layer if key is None else f"{key} {fields[key]}" if key == "pass" else fields[key])
    _add_time(mark, fields)
    _text(mark, "styleUrl", f"#{looks.name(layer, fields)}")
    data = ET.SubElement(mark, "ExtendedData")
    for name, text in fields.items():
        field = ET.SubElement(data, "Data", name=name)
        if name in ALIASES:
            label = translated(ALIASES[name], language_of_user())
            _text(field, "displayName", label.replace("UTC", zone.key))
        _text(field, "value", text)
    _add_shape(mark, shape)


def _add_time(mark: ET.Element, fields: Mapping[str, str]) -> None:
    """The time, for the time slider of viewers."""
    if "start" in fields:
        span = ET.SubElement(mark, "TimeSpan")
        _text(span, "begin", fields["start"])
        if "end" in fields:
            _text(span, "end", fields["end"])
    elif "time" in fields:
        _text(ET.SubElement(mark, "TimeStamp"), "when", fields["time"])


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
    if value is None or value != value:  # as nan and NaT do
        return None
    if hasattr(value, "isoformat"):
        text = str(value.isoformat(timespec="milliseconds"))
        return text.replace("+00:00", "Z") if value.tzinfo is not None else f"{text}Z"
    return f"{value:.4f}".rstrip("0").rstrip(".") if isinstance(value, float) else str(value)


def _text(parent: ET.Element, tag: str, text: str) -> None:
    ET.SubElement(parent, tag).text = printable(text)
