"""The boundary of a field from a vector file."""

from __future__ import annotations

from pathlib import Path
from typing import Final

import numpy as np
import shapely
from pyproj import Transformer
from shapely.geometry.base import BaseGeometry

from furrowmap.core.values.datum import APART_M, apart_m
from furrowmap.core.values.errors import InputError

LARGEST_BYTES: Final = 100_000_000
_FORMATS: Final = (
    (b"SQLite format 3\0", "GPKG"),
    (b"fgb", "FlatGeobuf"),
    (b"\0\0\x27\x0a", "ESRI Shapefile"),
)
"""The first bytes of each format besides GeoJSON, and its driver."""


def read_boundary(path: Path) -> BaseGeometry:
    """All polygons of a GeoJSON, GeoPackage, FlatGeobuf or Shapefile, as one, in longitude and latitude (degrees).

    Coordinates that the file holds in a projected CRS are taken back to that CRS's own longitudes and latitudes; no
    datum is changed.

    Raises:
        InputError: if the file is of no such format, cannot be read, holds no polygon, states no CRS, or one on a datum
            of the past.
    """
    import geopandas  # half a second, and most sessions name no boundary

    _expect_format(path)
    try:
        table = geopandas.read_file(path, engine="pyogrio")
    except Exception as error:  # noqa: BLE001 GDAL's, GEOS's and pandas' errors have no family of their own
        raise _unreadable(path, str(error)) from None
    shapes = [shape for shape in table.geometry if isinstance(shape, (shapely.Polygon, shapely.MultiPolygon))]
    if not shapes:
        raise _unreadable(path, f"{len(table)} features, none of them a polygon")
    if table.crs is None:
        raise _unreadable(path, "it states no CRS")
    whole = shapely.union_all(shapely.make_valid(np.array(shapes, object)))
    base = table.crs.geodetic_crs
    to_base = Transformer.from_crs(table.crs, base.to_2d(), always_xy=True)
    outline = shapely.transform(whole, lambda xy: np.column_stack(to_base.transform(*xy.T)))
    if not np.isfinite(shapely.get_coordinates(outline)).all() or outline.area == 0.0:
        raise _unreadable(path, "its polygons are empty, or their coordinates are none of its CRS")
    middle = outline.centroid
    apart = apart_m(base, round(middle.x, 1), round(middle.y, 1))
    if apart is not None and apart > APART_M:
        raise InputError(
            f"{path}: its CRS stands on {base.name}, whose coordinates lie {apart:.0f} m beside those of satellites.",
            "The boundary would lie that far from the field.",
            "Save it from a GIS in WGS 84 or the map's CRS; that changes the datum.",
            code="boundary-datum",
        )
    return outline


def _expect_format(path: Path) -> None:
    """Only formats of which GDAL's drivers open no other file.

    Raises:
        InputError: if the content is of no such format, or larger than any boundary.
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
        raise _unreadable(path, f"{size:,} bytes, more than any field's boundary")


def _unreadable(path: Path, why: str) -> InputError:
    return InputError(
        f"{path}: {why}.",
        "The field's boundary could not be read, so misses along it and the zones inside it cannot be told.",
        "Give the field's polygon as GeoJSON (longitude, latitude), or take `[field] boundary` out of the session.",
        code="boundary-unreadable",
    )
