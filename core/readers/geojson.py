"""Polygons and points of GeoJSON (RFC 7946), read without GDAL, whose drivers take a text for whatever it mentions."""

import json
from collections.abc import Callable, Iterator, Sequence
from typing import Any, Final

import msgspec
import numpy as np
import shapely
from pyproj import CRS
from shapely.geometry.base import BaseGeometry

from furrowmap.core.runtime.languages.texts import Text
from furrowmap.core.values.crs import crs_of_file

MAX_CORNERS: Final = 5_000_000
_GEOMETRY_TYPES: Final = (
    "Point", "MultiPoint", "LineString", "MultiLineString", "Polygon", "MultiPolygon", "GeometryCollection",
)  # fmt: skip
_MOST_LEVELS: Final = 16
"""Of collections in collections (RFC 7946, 3.1.8, advises against any)."""
_LONGITUDES: Final = CRS.from_epsg(4326)


class _Object(msgspec.Struct):
    """Any object of GeoJSON; what it does not need stays text."""

    type: str = ""
    features: list[msgspec.Raw] | None = None
    geometry: msgspec.Raw = msgspec.Raw()
    properties: dict[str, Any] | None = None
    coordinates: msgspec.Raw = msgspec.Raw()
    geometries: list[msgspec.Raw] | None = None
    crs: dict[str, Any] | None = None


_Ring = list[list[float]]


ShapeOf = Callable[[str, msgspec.Raw], BaseGeometry | None]
"""The geometry of a type and its coordinates; None of a type that is not wanted."""


def read_geojson(data: bytes, shape_of: ShapeOf) -> tuple[list[BaseGeometry | None], list[dict[str, Any]], CRS, int]:
    """Geometries, None where a feature has none, the properties of each, the CRS, and the number of other features.

    Args:
        shape_of: :func:`polygon_of` or :func:`point_of`.

    Raises:
        ValueError: if it is no GeoJSON (msgspec's errors are among them), a geometry is none, or it has too many
            corners or levels.
        CRSError: if its CRS is unknown.
    """
    data = data.removeprefix(b"\xef\xbb\xbf")
    if data.count(b"[") > MAX_CORNERS:
        raise ValueError(f"it has more than {MAX_CORNERS:,} corners")
    try:
        root = msgspec.json.decode(data, type=_Object)
    except RecursionError:
        raise ValueError(Text("it is nested too deeply")) from None
    shapes: list[BaseGeometry | None] = []
    properties: list[dict[str, Any]] = []
    others = 0
    for one in _features(root):
        shape = _shape(one.geometry, shape_of)
        if shape is None and bytes(_given(one.geometry, b"null")) != b"null":
            others += 1
            continue
        shapes.append(shape)
        properties.append({name: _cell(value) for name, value in (one.properties or {}).items()})
    return shapes, properties, _crs(root.crs), others


def _features(root: _Object) -> Iterator[_Object]:
    if root.type == "FeatureCollection":
        for raw in root.features or []:
            one = msgspec.json.decode(raw, type=_Object)
            if one.type != "Feature":
                raise ValueError(f"one of its features is a {one.type[:40]!r}")
            yield one
    elif root.type == "Feature":
        yield root
    elif root.type in _GEOMETRY_TYPES:
        geometry = {"type": root.type, "coordinates": _given(root.coordinates, b"[]"), "geometries": root.geometries}
        yield _Object("Feature", geometry=msgspec.Raw(msgspec.json.encode(geometry)))
    else:
        raise ValueError(f"it is JSON of the type {root.type[:40]!r} and no GeoJSON")


def _given(raw: msgspec.Raw, otherwise: bytes) -> msgspec.Raw:
    return raw if len(memoryview(raw)) else msgspec.Raw(otherwise)


def _shape(raw: msgspec.Raw, shape_of: ShapeOf, levels: int = _MOST_LEVELS) -> BaseGeometry | None:
    """The geometry of a feature, those of a collection as one; None for one of another kind, or none."""
    geometry = msgspec.json.decode(_given(raw, b"null"), type=_Object | None)
    if geometry is None:
        return None
    if geometry.type not in _GEOMETRY_TYPES:
        raise ValueError(f"a feature has a geometry of the type {geometry.type[:40]!r}")
    if geometry.type == "GeometryCollection":
        shapes = [_shape(one, shape_of, levels - 1) for one in geometry.geometries or []] if levels else []
        return joined([shape for shape in shapes if shape is not None])
    return shape_of(geometry.type, _given(geometry.coordinates, b"[]"))


def joined(shapes: Sequence[BaseGeometry]) -> BaseGeometry | None:
    """Polygons, or points, of a feature as one geometry; None without any."""
    parts: list[Any] = shapely.get_parts(np.array([*shapes, None], object)[:-1]).tolist()
    if len(parts) < 2:
        return parts[0] if parts else None
    return shapely.MultiPolygon(parts) if parts[0].geom_type == "Polygon" else shapely.MultiPoint(parts)


def point_of(kind: str, coordinates: msgspec.Raw) -> BaseGeometry | None:
    """A point or multipoint, with heights where the file has them."""
    if kind == "Point":
        return _point(msgspec.json.decode(coordinates, type=list[float]))
    if kind == "MultiPoint":
        return shapely.MultiPoint([_point(one) for one in msgspec.json.decode(coordinates, type=list[list[float]])])
    return None


def _point(place: list[float]) -> shapely.Point:
    if len(place) == 1:
        raise ValueError(Text("a point has one coordinate"))
    return shapely.Point(place[:3])


def polygon_of(kind: str, coordinates: msgspec.Raw) -> BaseGeometry | None:
    """A polygon or multipolygon."""
    if kind == "Polygon":
        return _of_rings(msgspec.json.decode(coordinates, type=list[_Ring]))
    if kind == "MultiPolygon":
        return shapely.MultiPolygon(
            [_of_rings(part) for part in msgspec.json.decode(coordinates, type=list[list[_Ring]])]
        )
    return None


def _of_rings(rings: list[_Ring]) -> shapely.Polygon:
    """A polygon; a ring that is not closed is closed, and heights are left out."""
    if any(len(corner) < 2 for ring in rings for corner in ring):
        raise ValueError("a corner has fewer than two coordinates")
    corners = [np.array([corner[:2] for corner in ring], np.float64).reshape(-1, 2) for ring in rings]
    few = next((len(ring) for ring in corners if 0 < len(ring) < 3), 0)
    if few:
        raise ValueError(f"a ring has {few} corners")
    shell, *holes = [ring for ring in corners if len(ring)] or [np.empty((0, 2))]
    return shapely.Polygon(shell, holes)


def _cell(value: Any) -> Any:
    """A property as a cell of a table: lists and objects as JSON."""
    return json.dumps(value, ensure_ascii=False) if isinstance(value, list | dict) else value


def _crs(stated: dict[str, Any] | None) -> CRS:
    """The CRS that files of before RFC 7946 name; else longitudes and latitudes in WGS 84."""
    if stated is None:
        return _LONGITUDES
    properties = stated.get("properties")
    name = properties.get("name") if isinstance(properties, dict) else None
    if stated.get("type") != "name" or not isinstance(name, str):
        raise ValueError("its CRS is no name")
    return crs_of_file(name)
