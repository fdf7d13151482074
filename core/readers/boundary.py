"""Field boundaries from vector files."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import Final

import numpy as np
import shapely
from pyproj import CRS, Transformer
from shapely.geometry.base import BaseGeometry

from furrowmap.core.readers.vector_file import Polygons, read_polygons
from furrowmap.core.values.datum import LARGEST_DATUM_SHIFT_M, datum_shift_m
from furrowmap.core.values.errors import InputError

LARGEST_DEG: Final = 1.0
"""No field is wider or higher, in degrees of latitude."""


def read_boundary(path: Path) -> BaseGeometry:
    """The union of all polygons of a vector file (:mod:`.vector_file`), in longitude and latitude (degrees).

    Projected coordinates are converted to longitude and latitude of the same datum; no datum is changed.

    Raises:
        InputError: if the file has another format, cannot be read, has no polygon, states no CRS, or one on a
            historical datum.
    """
    polygons = read_polygons(path, partial(_unreadable, path))
    try:
        outline, base = _outline(path, polygons)
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


def _outline(path: Path, polygons: Polygons) -> tuple[BaseGeometry, CRS]:
    """The union of the polygons in longitude and latitude, and the CRS of these.

    Raises:
        InputError: if there is no polygon of the size of a field.
        Exception: of any library, if the file is damaged.
    """
    base = polygons.crs.geodetic_crs
    assert base is not None
    to_base = Transformer.from_crs(polygons.crs, base.to_2d(), always_xy=True)
    whole = shapely.union_all(shapely.make_valid(np.array(polygons.shapes, object)))
    outline = shapely.transform(whole, lambda xy: np.column_stack(to_base.transform(*xy.T)))
    if not np.isfinite(shapely.get_coordinates(outline)).all() or outline.area == 0.0:
        raise _unreadable(path, "its polygons are empty, or their coordinates do not match its CRS")
    west, south, east, north = outline.bounds
    if max(-south, north) > 90.0 or max(-west, east) > 360.0:
        raise _unreadable(path, f"it reaches from {south:g} to {north:g} latitude and {west:g} to {east:g} longitude")
    if max(north - south, (east - west) * np.cos(np.radians(max(-south, north)))) > LARGEST_DEG:
        raise _unreadable(path, f"it is {north - south:.3g}° high and {east - west:.3g}° wide, which no field is")
    return outline, base


def _unreadable(path: Path, why: str) -> InputError:
    return InputError(
        f"{path}: {why}.",
        "Without the boundary, misses along it and zones inside it are not computed.",
        "Provide the field's polygon as GeoJSON (longitude, latitude), or remove `[field] boundary` from the session.",
        code="boundary-unreadable",
    )
