"""Field boundaries from vector files."""

from __future__ import annotations

from pathlib import Path
from typing import Final

import numpy as np
import shapely
from pyproj import Transformer
from shapely.geometry.base import BaseGeometry

from furrowmap.core.values.datum import LARGEST_DATUM_SHIFT_M, datum_shift_m
from furrowmap.core.values.errors import InputError

LARGEST_BYTES: Final = 100_000_000
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
    import geopandas  # half a second, and most sessions name no boundary

    _expect_format(path)
    try:
        table = geopandas.read_file(path, engine="pyogrio")
    except Exception as error:  # noqa: BLE001 GDAL's, GEOS's and pandas' errors have no family of their own
        raise _unreadable(path, str(error)) from None
    shapes = [shape for shape in table.geometry if isinstance(shape, (shapely.Polygon, shapely.MultiPolygon))]
    if not shapes:
        raise _unreadable(path, f"{len(table)} features, but no polygon")
    if table.crs is None:
        raise _unreadable(path, "it states no CRS")
    whole = shapely.union_all(shapely.make_valid(np.array(shapes, object)))
    base = table.crs.geodetic_crs
    to_base = Transformer.from_crs(table.crs, base.to_2d(), always_xy=True)
    outline = shapely.transform(whole, lambda xy: np.column_stack(to_base.transform(*xy.T)))
    if not np.isfinite(shapely.get_coordinates(outline)).all() or outline.area == 0.0:
        raise _unreadable(path, "its polygons are empty, or their coordinates do not match its CRS")
    middle = outline.centroid
    apart = datum_shift_m(base, round(middle.x, 1), round(middle.y, 1))
    if apart is not None and apart > LARGEST_DATUM_SHIFT_M:
        raise InputError(
            f"{path}: its CRS is based on {base.name}, whose coordinates differ by {apart:.0f} m from those of GNSS.",
            "The boundary would be shifted by that distance.",
            "Export it from a GIS in WGS 84 or in the map's CRS, which transforms the datum.",
            code="boundary-datum",
        )
    return outline


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
