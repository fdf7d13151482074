"""Polygons and points with attributes from vector files: GeoPackage, Shapefile (zipped too), FlatGeobuf, GeoJSON, KML.

GDAL reads layers as arrays (:mod:`.ogr_layers`), but neither GeoJSON nor KML (OGC 12-007): its drivers choose by
content, and a text that names another format would open other files.
"""

import codecs
import datetime as dt
import re
import warnings
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

import numpy as np
import shapely
from numpy.typing import NDArray
from pyproj import CRS
from shapely.geometry.base import BaseGeometry

from furrowmap.core.geodesy.longitudes import SaidBy, expect_degrees
from furrowmap.core.readers.areas.repair import workable
from furrowmap.core.readers.geojson import ShapeOf, joined, point_of, polygon_of, read_geojson
from furrowmap.core.readers.isoxml.xml import Element, parse_xml
from furrowmap.core.readers.ogr_layers import LAYER_MAGIC, SHAPEFILE_MAGIC, layer_info, list_layers, read_layer_arrays
from furrowmap.core.readers.text_table import ZIP, number_or_text, unpacked_layer
from furrowmap.core.runtime.arrays import FloatArray
from furrowmap.core.runtime.errors import InputError, Notice, RefusedError
from furrowmap.core.runtime.file_signatures import binary_kind
from furrowmap.core.runtime.languages.texts import Text, Words, reason
from furrowmap.core.runtime.plain_reads import open_plain
from furrowmap.core.runtime.write_errors import scratch_directory, writing_scratch
from furrowmap.core.values.crs import crs_of_file


@dataclass(frozen=True)
class VectorLayer:
    """The n features of a layer.

    Attributes:
        shapes: (n,) geometries; None where a feature has none.
        columns: (n,) values of each field: numbers (nan where empty, also of integers), texts (None where empty),
            times as datetime64[ms] in UTC, dates as datetime64[D].
        crs: of the geometries; None if the file states none.
    """

    shapes: NDArray[np.object_]
    columns: dict[str, NDArray[Any]]
    crs: CRS | None
    notices: tuple[Notice, ...] = ()

    def __len__(self) -> int:
        return len(self.shapes)

    @property
    def bounds(self) -> tuple[float, float, float, float]:
        """Least x and y, greatest x and y; nan of a layer without coordinates."""
        west, south, east, north = shapely.total_bounds(self.shapes).tolist()
        return west, south, east, north

    @property
    def coordinates(self) -> FloatArray:
        """(n, 3) of points; heights are nan where they have none."""
        xyz: FloatArray = np.column_stack([part(self.shapes) for part in (shapely.get_x, shapely.get_y, shapely.get_z)])
        return xyz

    def where(self, kept: Any) -> "VectorLayer":
        """The features that an index, a mask or a slice selects, in its order."""
        return VectorLayer(
            self.shapes[kept], {k: values[kept] for k, values in self.columns.items()}, self.crs, self.notices
        )

    def rows(self) -> Iterator[dict[str, Any]]:
        """The fields of each feature as Python's own types, times with their zone; None where a field is empty."""
        columns = {name: values.tolist() for name, values in self.columns.items()}
        for name, values in self.columns.items():
            if values.dtype == "datetime64[ms]":
                columns[name] = [t if t is None else t.replace(tzinfo=dt.UTC) for t in columns[name]]
        for k in range(len(self)):
            row = {name: values[k] for name, values in columns.items()}
            yield {name: None if isinstance(v, float) and np.isnan(v) else v for name, v in row.items()}


def read_vector_layer(path: Path, name: str | None = None, *, times_as_text: bool = False) -> VectorLayer:
    """A layer of a vector file, by default the first.

    Args:
        times_as_text: read times and dates as text in ISO 8601, with the zone that the file states.

    Raises:
        ValueError: if the layer is a table without geometries, or as :func:`.read_layer_arrays`.
        Exception: of GDAL, GEOS and PROJ, which have no family of their own, if the file is damaged.
    """
    about, wkb, data = read_layer_arrays(path, name, times_as_text=times_as_text)
    if wkb is None:
        raise ValueError(Text("{name:layer {name}|its first layer} is a table without geometries", name=name))
    columns = dict(zip(map(str, about["fields"]), data, strict=True))
    crs = crs_of_file(about["crs"]) if about["crs"] else None
    return VectorLayer(np.asarray(shapely.from_wkb(wkb), object), columns, crs, tuple(about.get("notices", ())))


POINT_LAYERS: Final = ("Point",)
POLYGON_LAYERS: Final = ("Polygon", "Surface")
"""What the names of geometry types have that a layer of points, or of polygons, may have."""
_ANY_LAYERS: Final = ("Unknown", "Collection")


def layer_with(path: Path, kinds: Sequence[str]) -> tuple[str | None, list[Notice]]:
    """The name of the first layer with features that may have the geometries wanted, and a notice if others may, too.

    None stands for the only layer of a file, whatever it has.

    Raises:
        ValueError: if no layer may have them, or as :func:`.read_layer_arrays`.
        Exception: of GDAL, which has no family of its own, if the file is damaged.
    """
    layers = list_layers(path)
    if len(layers) < 2:
        return None, []
    for words in (kinds, _ANY_LAYERS):
        fitting = [name for name, kind in layers if any(word in (kind or "") for word in words)]
        filled = [name for name in fitting if layer_info(path, name)["features"]]
        if filled:
            others = ", ".join(filled[1:])
            return filled[0], [Notice("layer-chosen", path=path, chosen=filled[0], others=others)] if others else []
    there = ", ".join(f"{name} ({kind or 'a table without geometries'})" for name, kind in layers)
    raise ValueError(f"none of its layers has {kinds[0].lower()}s: {there[:200]}")


_GEOMETRIES: Final = ("Point", "LineString", "LinearRing", "Polygon", "Model", "Track", "MultiTrack")


_UTF_16: Final = (codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)


def _is_kml(head: bytes) -> bool:
    """Whether a file begins as KML does."""
    text = head.replace(b"\0", b"") if head.startswith(_UTF_16) else head  # what is ASCII of it
    text = text.lstrip(b"\xff\xfe\xef\xbb\xbf \t\r\n")
    return text.startswith(b"<") and (b"<kml" in text[:1000] or b":kml" in text[:1000])


_LEADING_ZERO: Final = re.compile(r"\s*0\d+\s*")
"""A name such as 007."""


def _cell(text: str) -> float | str | None:
    return text.strip() if _LEADING_ZERO.fullmatch(text) else number_or_text(text)


def _attributes(mark: Element) -> dict[str, Any]:
    found: dict[str, Any] = {
        _tag(child): _cell(child.text) for child in mark.children if _tag(child) in ("name", "description")
    }
    for element in _all(mark):
        if _tag(element) == "SimpleData":
            found[element.get("name")] = _cell(element.text)
        elif _tag(element) == "Data":
            text = next((child.text for child in element.children if _tag(child) == "value"), "")
            found[element.get("name")] = _cell(text)
    return found


def _polygons_of_mark(mark: Element) -> BaseGeometry | None:
    polygons = [_polygon(found) for found in _within(mark, "Polygon")]
    return polygons[0] if len(polygons) == 1 else shapely.MultiPolygon(polygons) if polygons else None


def _points_of_mark(mark: Element) -> BaseGeometry | None:
    points = [_point(found) for found in _within(mark, "Point")]
    return points[0] if len(points) == 1 else shapely.MultiPoint(points) if points else None


def _point(element: Element) -> shapely.Point:
    """A point, with its altitude where there is one and it is no height above the ground."""
    text = next((found.text for found in _within(element, "coordinates")), "")
    rows = [_numbers(word.split(",")) for word in _BY_COMMA.sub(",", text.strip()).split()]
    if len(rows) != 1 or len(rows[0]) > 3:
        raise ValueError(Text("a point has the coordinates {text!r}", text=text.strip()[:40]))
    above_ground = any(found.text.strip() in _ABOVE_GROUND for found in _within(element, "altitudeMode"))
    return shapely.Point(rows[0][: 2 if above_ground else 3])


def _polygon(element: Element) -> shapely.Polygon:
    outer = [_ring(ring) for side in _within(element, "outerBoundaryIs") for ring in _within(side, "coordinates")]
    inner = [_ring(ring) for side in _within(element, "innerBoundaryIs") for ring in _within(side, "coordinates")]
    if not outer:
        raise ValueError(Text("a polygon has no outer boundary"))
    try:
        return shapely.Polygon(outer[0], inner)
    except (ValueError, shapely.GEOSException) as error:
        raise ValueError(f"a polygon has a ring that is none ({str(error)[:80]})") from None


_ABOVE_GROUND: Final = ("relativeToGround", "relativeToSeaFloor")
_BY_COMMA: Final = re.compile(r"\s*,\s*")
_CLEARLY_SMALLER: Final = 10.0
"""How much smaller the extent of one reading of a list of numbers is than that of the other, to be the right one."""


def _ring(element: Element) -> list[tuple[float, float]]:
    corners = _corners(element.text)
    if len(corners) < 3 or not np.isfinite(corners).all():
        raise ValueError(
            Text("a ring of {corners} corners, or with coordinates that are not finite", corners=len(corners))
        )
    return [(lon, lat) for lon, lat in corners.tolist()]


def _corners(text: str) -> FloatArray:
    """Longitude and latitude (n, 2) of tuples of two or three numbers.

    The standard has commas within tuples and spaces between them. Files of others have spaces behind the commas, too,
    or commas between the tuples, which leaves open how many numbers a tuple has.

    Raises:
        ValueError: if a tuple is none, or both numbers are possible.
    """
    tuples = [word.split(",") for word in text.split()]
    if not all(len(one) in (2, 3) and all(one) for one in tuples):
        tuples = [word.split(",") for word in _BY_COMMA.sub(",", text.strip().rstrip(",")).split()]
    rows = [_numbers(one) for one in tuples]
    if all(len(row) in (2, 3) for row in rows):
        return np.array([row[:2] for row in rows], np.float64).reshape(-1, 2)
    readings = [
        np.concatenate([np.array(row).reshape(-1, size)[:, :2] for row in rows])
        for size in (2, 3)
        if all(len(row) % size == 0 for row in rows)
    ]
    readings.sort(key=_extent)
    if not readings or (len(readings) > 1 and not _CLEARLY_SMALLER * _extent(readings[0]) < _extent(readings[1])):
        raise ValueError(f"{text.strip()[:40]!r} has commas between its tuples, and no certain number of coordinates")
    return readings[0]


def _numbers(words: list[str]) -> list[float]:
    try:
        numbers = [float(word) for word in words]
    except ValueError:
        numbers = []
    if len(numbers) < 2:
        raise ValueError(Text("{words!r} is no longitude and latitude", words=",".join(words)[:40]))
    return numbers


def _extent(corners: FloatArray) -> float:
    return float(np.ptp(corners, axis=0).max())


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


MAX_VECTOR_BYTES: Final = 100_000_000
MAX_POLYGON_COORDINATE: Final = 1e9
"""In any unit that a CRS may have."""
VECTOR_FORMATS: Final = Text("GeoJSON, GeoPackage, FlatGeobuf, Shapefile (also zipped) or KML")

Unreadable = Callable[[Words], InputError]
"""The error of a file, from what is wrong with it."""


@dataclass(frozen=True)
class Polygons:
    """n polygons of a file, in its coordinates, and their attributes.

    Attributes:
        shapes: polygons and multipolygons, flat; their rings may cross.
        attributes: of each, by the column's name; None where a cell is empty.
        notices: what was decided where the file leaves it open.
    """

    shapes: tuple[BaseGeometry, ...]
    attributes: tuple[dict[str, Any], ...]
    crs: CRS
    notices: tuple[Notice, ...] = ()


def read_polygons(path: Path, unreadable: Unreadable) -> Polygons:
    """The polygons of the first layer of a vector file that has some.

    Only formats are read whose GDAL drivers open no other files. The error of `unreadable` if the file has another
    format, cannot be read, has no polygon, states no CRS, or has coordinates that are not finite; RefusedError if an
    archive unpacks to far more than its size.
    """
    try:
        with open_plain(path) as file:
            head = file.read(4096)
        size = path.stat().st_size
    except OSError as error:
        raise unreadable(str(error.strerror)) from None
    if not is_vector(head):
        kind = binary_kind(head)
        raise unreadable(
            Text(
                "{kind:{kind}, |}neither GeoJSON nor GeoPackage, FlatGeobuf, Shapefile, zipped Shapefile or KML",
                kind=kind,
            )
        )
    if size > MAX_VECTOR_BYTES:
        raise unreadable(Text("{size:,} bytes is too large for the boundary of a field or a set of parcels", size=size))
    try:
        layer, others = _read_layer(path, head, _POLYGONS)
    except RefusedError:
        raise
    except InputError as error:
        raise unreadable(error.what.removeprefix(f"{path}: ").rstrip(".")) from None
    except Exception as error:  # noqa: BLE001 the errors of GDAL, GEOS and PROJ have no family of their own
        raise unreadable(reason(error)) from None
    polygons = layer.where(np.array([shape is not None for shape in layer.shapes], bool))
    left_out = others + len(layer) - len(polygons)
    if not len(polygons):
        raise unreadable(Text("{features} features, but no polygon", features=left_out))
    shapes = shapely.force_2d(polygons.shapes)
    crs = layer.crs
    if crs is None:
        raise InputError("polygons-no-crs", path=path, is_shapefile=head.startswith(SHAPEFILE_MAGIC))
    base = crs.geodetic_crs
    meridian = base.prime_meridian if base is not None else None
    degree = base.axis_info[0].unit_conversion_factor / np.radians(1.0) if base is not None else 0.0
    if meridian is None or meridian.longitude != 0.0 or abs(degree - 1.0) > 1e-9:
        raise unreadable(Text("its CRS {name} is of no degrees from Greenwich", name=crs.name))
    corners = shapely.get_coordinates(shapes)
    if not np.isfinite(corners).all():
        raise unreadable(Text("a corner has coordinates that are not finite"))
    if len(corners) and np.abs(corners).max() > MAX_POLYGON_COORDINATE:
        raise unreadable(
            Text(
                "a corner has the coordinate {largest:g}, which is nowhere on the Earth", largest=np.abs(corners).max()
            )
        )
    if crs.is_geographic:
        expect_degrees(path, corners, crs, said_by(head))
    try:
        whole = tuple(workable(shapes.tolist(), crs))
    except ValueError as error:
        raise unreadable(reason(error)) from None
    dropped = [Notice("features-left-out", path=path.name, left_out=left_out)] if left_out else []
    return Polygons(whole, tuple(polygons.rows()), crs, (*polygons.notices, *dropped))


def is_vector(head: bytes) -> bool:
    """Whether a file begins as a vector file, or as an archive that may hold one."""
    return _is_json(head) or head.startswith((*LAYER_MAGIC, ZIP)) or _is_kml(head)


def said_by(head: bytes) -> SaidBy:
    """What says that the coordinates of a vector file, by its first bytes, are degrees, if they are."""
    return "kml" if _is_kml(head) else "geojson" if _is_json(head) else "layer"


def read_points_of_layer(path: Path) -> VectorLayer:
    """The points and multipoints of the first layer of a vector file that has some, None where a feature has neither.

    Raises:
        ValueError: if it has another format, or holds other geometries, too.
        RefusedError: if an archive unpacks to far more than its size.
        Exception: of GDAL, GEOS and PROJ, which have no family of their own, if the file is damaged.
    """
    with open_plain(path) as file:
        head = file.read(4096)
    layer, others = _read_layer(path, head, _POINTS)
    if others:
        raise ValueError(Text("holds other geometries than points"))
    return layer


@dataclass(frozen=True)
class _Wanted:
    """Geometries that are read of a file: names of types of layers, types, and parsers of KML's and GeoJSON's."""

    layers: Sequence[str]
    kinds: tuple[type[BaseGeometry], ...]
    of_mark: Callable[[Element], BaseGeometry | None]
    of_geojson: ShapeOf


_POLYGONS: Final = _Wanted(POLYGON_LAYERS, (shapely.Polygon, shapely.MultiPolygon), _polygons_of_mark, polygon_of)
_POINTS: Final = _Wanted(POINT_LAYERS, (shapely.Point, shapely.MultiPoint), _points_of_mark, point_of)


def _read_layer(path: Path, head: bytes, wanted: _Wanted) -> tuple[VectorLayer, int]:
    """The features with the geometries that are wanted, or with none, and the number of others."""
    with ExitStack() as stack:
        if head.startswith(ZIP):
            folder = stack.enter_context(scratch_directory())
            with writing_scratch():
                path = unpacked_layer(path, folder)
            head = path.read_bytes()[:4096]
            if not (_is_kml(head) or head.startswith(SHAPEFILE_MAGIC)):
                raise ValueError(Text("its layer {name} is neither a Shapefile nor KML", name=path.name))
        if _is_kml(head):
            return _by_kml(path, wanted)
        if _is_json(head):
            shapes, properties, crs, others = read_geojson(path.read_bytes(), wanted.of_geojson)
            return _layer_of(shapes, properties, crs), others
        return _by_gdal(path, wanted)


def _by_kml(path: Path, wanted: _Wanted) -> tuple[VectorLayer, int]:
    shapes: list[BaseGeometry | None] = []
    attributes: list[dict[str, Any]] = []
    others = 0
    for mark in _within(parse_xml(path.read_bytes(), f"{path}"), "Placemark"):
        shape = wanted.of_mark(mark)
        if shape is None and any(_tag(element) in _GEOMETRIES for element in _all(mark)):
            others += 1
            continue
        shapes.append(shape)
        attributes.append(_attributes(mark))
    return _layer_of(shapes, attributes, CRS.from_epsg(4326)), others


def _layer_of(shapes: list[BaseGeometry | None], rows: list[dict[str, Any]], crs: CRS) -> VectorLayer:
    names = list(dict.fromkeys(name for row in rows for name in row))
    columns = {name: np.array([*(row.get(name) for row in rows), None], object)[:-1] for name in names}
    return VectorLayer(np.array([*shapes, None], object)[:-1], columns, crs)


def _by_gdal(path: Path, wanted: _Wanted) -> tuple[VectorLayer, int]:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # a ring that is not closed is closed
        name, notices = layer_with(path, wanted.layers)
        layer = read_vector_layer(path, name, times_as_text=True)
    layer.shapes[:] = [_of_collection(shape, wanted.kinds) for shape in layer.shapes]
    kept = np.array([shape is None or isinstance(shape, wanted.kinds) for shape in layer.shapes], bool)
    return replace(layer.where(kept), notices=(*notices, *layer.notices)), int((~kept).sum())


def _of_collection(shape: BaseGeometry | None, kinds: tuple[type[BaseGeometry], ...]) -> BaseGeometry | None:
    """What a collection has of the geometries that are wanted, as one; other geometries are unchanged."""
    if not isinstance(shape, shapely.GeometryCollection):
        return shape
    inner = (_of_collection(one, kinds) for one in shape.geoms)
    return joined([one for one in inner if isinstance(one, kinds) and not one.is_empty]) or shape


def _is_json(head: bytes) -> bool:
    return head.lstrip(b"\xef\xbb\xbf \t\r\n").startswith(b"{")
