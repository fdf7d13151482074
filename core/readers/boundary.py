"""Field boundaries from vector files."""

from __future__ import annotations

import warnings
from pathlib import Path
from typing import Final

import numpy as np
import shapely
from pyproj import CRS, Transformer
from shapely.geometry.base import BaseGeometry

from furrowmap.core.values.datum import LARGEST_DATUM_SHIFT_M, datum_shift_m
from furrowmap.core.values.errors import InputError

LARGEST_BYTES: Final = 100_000_000
LARGEST_DEG: Final = 1.0
"""No field is wider or higher, in degrees of latitude."""
_FORMATS: Final = (
    (b"SQLite format 3\0", "GPKG"),
    (b"fgb", "FlatGeobuf"),
    (b"\0\0\x27\x0a", "ESRI Shapefile"),
)
"""The first bytes of each format besides GeoJSON, and its driver."""


def read_boundary(path: Path) -> BaseGeometry:
    """The union of all polygons of a GeoJSON, GeoPackage, FlatGeobuf or Shapefile, in longitude and latitude (degrees).

    Projected coordinates are converted to longitude and latitude of the same datum; no datum is changed.

    Raises:
        InputError: if the file has another format, cannot be read, has no polygon, states no CRS, or one on a
            historical datum.
    """
    _expect_format(path)
    try:
        outline, base = _outline(path)
        middle = outline.centroid
        apart = datum_shift_m(base, round(middle.x, 1), round(middle.y, 1))
    except InputError:
        raise
    except Exception as error:  # noqa: BLE001 the errors of GDAL, GEOS, PROJ and pandas have no family of their own
        raise _unreadable(path, str(error) or type(error).__name__) from None
    if apart is not None and apart > LARGEST_DATUM_SHIFT_M:
        raise InputError(
            f"{path}: its CRS is based on {base.name}, whose coordinates differ by {apart:.0f} m from those of GNSS.",
            "The boundary would be shifted by that distance.",
            "Export it from a GIS in WGS 84 or in the map's CRS, which transforms the datum.",
            code="boundary-datum",
        )
    return outline


def _outline(path: Path) -> tuple[BaseGeometry, CRS]:
    """The union of the polygons in longitude and latitude, and the CRS of these.

    Raises:
        InputError: if there is no polygon of the size of a field.
        Exception: of any library, if the file is damaged.
    """
    import geopandas  # half a second, and most sessions name no boundary

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # a ring that is not closed is closed
        table = geopandas.read_file(path, engine="pyogrio")
    shapes = [shape for shape in table.geometry if isinstance(shape, (shapely.Polygon, shapely.MultiPolygon))]
    if not shapes:
        raise _unreadable(path, f"{len(table)} features, but no polygon")
    if table.crs is None:
        raise _unreadable(path, "it states no CRS")
    if not np.isfinite(shapely.get_coordinates(np.array(shapes, object))).all():
        raise _unreadable(path, "a corner has coordinates that are not finite")
    base = table.crs.geodetic_crs
    to_base = Transformer.from_crs(table.crs, base.to_2d(), always_xy=True)
    whole = shapely.union_all(shapely.make_valid(np.array(shapes, object)))
    outline = shapely.transform(whole, lambda xy: np.column_stack(to_base.transform(*xy.T)))
    if not np.isfinite(shapely.get_coordinates(outline)).all() or outline.area == 0.0:
        raise _unreadable(path, "its polygons are empty, or their coordinates do not match its CRS")
    west, south, east, north = outline.bounds
    if max(-south, north) > 90.0 or max(-west, east) > 360.0:
        raise _unreadable(path, f"it reaches from {south:g} to {north:g} latitude and {west:g} to {east:g} longitude")
    if max(north - south, (east - west) * np.cos(np.radians(max(-south, north)))) > LARGEST_DEG:
        raise _unreadable(path, f"it is {north - south:.3g}° high and {east - west:.3g}° wide, which no field is")
    return outline, base


def _expect_format(path: Path) -> None:
    """Accept only formats whose GDAL drivers open no other files.

    Raises:
        InputError: if the file has another format, or is larger than any boundary.
    """
    try:
        with path.open("rb") as file:
            head = file.read(4096)
        size = path.stat().st_size
    except OSError as error:
        raise _unreadable(path, str(error.strerror)) from None
    known = any(head.startswith(magic) for magic, _ in _FORMATS) or head.lstrip(b"\xef\xbb\xbf \t\r\n").startswith(b"{")
    if not known:
        raise _unreadable(path, "neither GeoJSON nor GeoPackage, FlatGeobuf or Shapefile")
    if size > LARGEST_BYTES:
        raise _unreadable(path, f"{size:,} bytes is too large for the boundary of a field")


def _unreadable(path: Path, why: str) -> InputError:
    return InputError(
        f"{path}: {why}.",
        "Without the boundary, misses along it and zones inside it are not computed.",
        "Provide the field's polygon as GeoJSON (longitude, latitude), or remove `[field] boundary` from the session.",
        code="boundary-unreadable",
    )
