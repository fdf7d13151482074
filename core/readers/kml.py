"""Polygons of a KML file (OGC 12-007): placemarks with their names and extended data, in WGS 84.

GDAL's drivers are not used: they choose by content, and a text that names another format would open other files.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from furrowmap.core.readers.isoxml.xml import Element, parse_xml
from furrowmap.core.readers.text_table import number_or_text

_GEOMETRIES = ("Point", "LineString", "LinearRing", "Model", "Track", "MultiTrack")


def is_kml(head: bytes) -> bool:
    """Whether a file begins as KML does."""
    text = head.lstrip(b"\xef\xbb\xbf \t\r\n")
    return text.startswith(b"<") and (b"<kml" in text[:1000] or b":kml" in text[:1000])


def kml_polygons(path: Path) -> tuple[tuple[BaseGeometry, ...], tuple[dict[str, Any], ...], int]:
    """Polygons (longitude, latitude; n), their attributes (n), and how many placemarks have another geometry.

    The attributes are `name`, `description` and the extended data (`Data`, `SimpleData`), numbers as such.

    Raises:
        InputError: if it is no well-formed XML.
        ValueError: if a corner is no pair of numbers.
    """
    root = parse_xml(path.read_bytes(), f"{path}")
    shapes: list[BaseGeometry] = []
    attributes: list[dict[str, Any]] = []
    others = 0
    for mark in _within(root, "Placemark"):
        polygons = [_polygon(found) for found in _within(mark, "Polygon")]
        if not polygons:
            others += any(_tag(element) in _GEOMETRIES for element in _all(mark))
            continue
        shapes.append(polygons[0] if len(polygons) == 1 else shapely.MultiPolygon(polygons))
        attributes.append(_attributes(mark))
    return tuple(shapes), tuple(attributes), others


def _attributes(mark: Element) -> dict[str, Any]:
    found: dict[str, Any] = {
        _tag(child): number_or_text(child.text) for child in mark.children if _tag(child) in ("name", "description")
    }
    for element in _all(mark):
        if _tag(element) == "SimpleData":
            found[element.get("name")] = number_or_text(element.text)
        elif _tag(element) == "Data":
            text = next((child.text for child in element.children if _tag(child) == "value"), "")
            found[element.get("name")] = number_or_text(text)
    return found


def _polygon(element: Element) -> shapely.Polygon:
    outer = [_ring(ring) for side in _within(element, "outerBoundaryIs") for ring in _within(side, "coordinates")]
    inner = [_ring(ring) for side in _within(element, "innerBoundaryIs") for ring in _within(side, "coordinates")]
    if not outer:
        raise ValueError("a polygon has no outer boundary")
    try:
        return shapely.Polygon(outer[0], inner)
    except (ValueError, shapely.GEOSException) as error:
        raise ValueError(f"a polygon has a ring that is none ({str(error)[:80]})") from None


def _ring(element: Element) -> list[tuple[float, float]]:
    corners = []
    for text in element.text.split():
        numbers = text.split(",")
        try:
            corners.append((float(numbers[0]), float(numbers[1])))
        except (ValueError, IndexError):
            raise ValueError(f"{text[:40]!r} is no longitude and latitude") from None
    if len(corners) < 3 or not np.isfinite(corners).all():
        raise ValueError(f"a ring of {len(corners)} corners, or with coordinates that are not finite")
    return corners


def _tag(element: Element) -> str:
    """The tag without the prefix of its namespace."""
    return element.tag.rpartition(":")[2]


def _all(element: Element) -> Iterator[Element]:
    """All elements below one, depth first; the parser limits the depth."""
    for child in element.children:
        yield child
        yield from _all(child)


def _within(element: Element, tag: str) -> Iterator[Element]:
    return (found for found in _all(element) if _tag(found) == tag)
