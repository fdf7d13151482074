"""Geometries in the coordinates of a map; no datum is changed."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray
from pyproj import CRS, Transformer
from shapely.geometry.base import BaseGeometry

from furrowmap.core.runtime.errors import InputError
from furrowmap.core.values.datum import LARGEST_DATUM_SHIFT_M, datum_shift_m


def placed(shapes: Sequence[BaseGeometry], source: CRS, target: CRS, what: str) -> NDArray[Any]:
    """Geometries (n,) of one CRS in another, both horizontal or the horizontal part of a compound one.

    Args:
        shapes: n geometries.
        source: their CRS.
        target: that of the map.
        what: where they are from, to begin the message of an error.

    Raises:
        InputError: if one of the CRS is on a historical datum and the other is not, or a geometry lies outside the
            domain of the map.
    """
    given = np.array(shapes, object)
    flat, source = _flat(target), _flat(source)
    if source.equals(flat, ignore_axis_order=True):
        return given
    base, map_base = source.geodetic_crs, flat.geodetic_crs
    if base is None or map_base is None:
        raise InputError("polygons-crs", what=what, source=source.name, flat=flat.name)
    to_base = Transformer.from_crs(source, base.to_2d(), always_xy=True)
    to_map = Transformer.from_crs(map_base.to_2d(), flat, always_xy=True)
    round_earth = shapely.transform(given, lambda xy: np.column_stack(to_base.transform(*xy.T)))
    lon, lat = np.median(shapely.get_coordinates(round_earth), axis=0)
    if not base.to_2d().equals(map_base.to_2d(), ignore_axis_order=True):
        _expect_modern((base, map_base), float(lon), float(lat), what)
    moved = shapely.transform(round_earth, lambda xy: np.column_stack(to_map.transform(*xy.T)))
    if not np.isfinite(shapely.get_coordinates(moved)).all():
        raise InputError("polygons-elsewhere", what=what, lat=lat, lon=lon, flat=flat.name)
    return np.asarray(moved, object)


def _expect_modern(bases: tuple[CRS, CRS], lon_deg: float, lat_deg: float, what: str) -> None:
    for base in bases:
        shift_m = datum_shift_m(base, round(lon_deg, 1), round(lat_deg, 1))
        if shift_m is not None and shift_m > LARGEST_DATUM_SHIFT_M:
            raise InputError("polygons-datum", what=what, base=base.name, shift_m=shift_m)


def _flat(crs: CRS) -> CRS:
    return crs.sub_crs_list[0].to_2d() if crs.is_compound else crs.to_2d()
