"""Areas of the map: the polygons of a file, and whether points lie in them."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any, Final

import numpy as np
import shapely
from numpy.typing import NDArray
from pyproj import CRS, Transformer
from shapely.geometry.base import BaseGeometry

from furrowmap.core.geodesy.crs_change import horizontal_part
from furrowmap.core.geodesy.longitudes import middle_deg
from furrowmap.core.readers.areas.polygons import open_polygons
from furrowmap.core.readers.areas.repair import whole_in_degrees
from furrowmap.core.readers.areas.rings import Rings, ring_at, rings_of
from furrowmap.core.readers.vector_file import VECTOR_FORMATS, Polygons, Unreadable
from furrowmap.core.runtime.arrays import BoolArray, FloatArray
from furrowmap.core.runtime.errors import InputError, Notice
from furrowmap.core.runtime.languages.texts import Words, reason
from furrowmap.core.values.crs import LARGEST_DATUM_SHIFT_M, datum_shift_m


def polygons_on_map(path: Path, target: CRS, unreadable: Unreadable) -> Polygons:
    """The polygons of a file; coordinates in another CRS than the map's are projected, no datum is changed.

    InputError if the file cannot be read, has no polygon, or its coordinates lie outside the domain of `target`.
    """
    polygons = open_polygons(path, target, unreadable)
    try:
        # A polygon of one part instead of a multipolygon of one.
        single = [
            shape.geoms[0] if isinstance(shape, shapely.MultiPolygon) and len(shape.geoms) == 1 else shape
            for shape in polygons.shapes
        ]
        shapes = placed(single, polygons.crs, target, f"{path}")
    except InputError:
        raise
    except Exception as error:  # noqa: BLE001 the errors of GEOS and PROJ have no family of their own
        raise unreadable(reason(error)) from None
    return replace(polygons, shapes=tuple(shapes), crs=target)


def placed(shapes: Sequence[BaseGeometry], source: CRS, target: CRS, what: str) -> NDArray[Any]:
    """Geometries (n,) of one CRS in another, both horizontal or the horizontal part of a compound one.

    InputError, which names `what`, if one of the CRS is on a historical datum and the other is not, or a geometry lies
    outside the domain of the map.
    """
    given = np.array(shapes, object)
    flat = horizontal_part(target)
    source = horizontal_part(source)
    if source.equals(flat, ignore_axis_order=True):
        return given
    base = source.geodetic_crs
    map_base = flat.geodetic_crs
    if base is None or map_base is None:
        raise InputError("polygons-crs", what=what, source=source.name, flat=flat.name)
    to_base = Transformer.from_crs(source, base.to_2d(), always_xy=True)
    to_map = Transformer.from_crs(map_base.to_2d(), flat, always_xy=True)
    round_earth = whole_in_degrees(shapely.transform(given, lambda xy: np.column_stack(to_base.transform(*xy.T))))
    lon, lat = middle_deg(*shapely.get_coordinates(round_earth).T)
    if not base.to_2d().equals(map_base.to_2d(), ignore_axis_order=True):
        for crs in (base, map_base):
            shift_m = datum_shift_m(crs, round(lon, 1), round(lat, 1))
            if shift_m is not None and shift_m > LARGEST_DATUM_SHIFT_M:
                if np.isinf(shift_m):
                    raise InputError("polygons-datum.unknown", what=what, base=crs.name)
                raise InputError("polygons-datum", what=what, base=crs.name, shift_m=shift_m)
    moved = shapely.transform(round_earth, lambda xy: np.column_stack(to_map.transform(*xy.T)))
    if not np.isfinite(shapely.get_coordinates(moved)).all():
        raise InputError("polygons-elsewhere", what=what, lat=lat, lon=lon, flat=flat.name)
    return np.asarray(moved, object)


MANY_POLYGONS: Final = 50
"""Polygons from which on a grid of them finds the right one faster than an index of all their edges."""


@dataclass(frozen=True)
class Area:
    """One or more polygons in map coordinates, with their holes; they may overlap."""

    path: Path
    polygons: tuple[shapely.Polygon, ...]
    notices: tuple[Notice, ...] = ()

    @property
    def bounds_m(self) -> tuple[float, float, float, float]:
        """West, south, east, north."""
        west, south, east, north = shapely.total_bounds(np.array(self.polygons, object)).tolist()
        return west, south, east, north

    def contains(self, xy_m: FloatArray) -> BoolArray:
        """Whether points (n, 2) or (n, 3) in map coordinates lie in one of the polygons, and in none of its holes."""
        west, south, east, north = self.bounds_m
        x = xy_m[:, 0]
        y = xy_m[:, 1]
        inside = (x >= west) & (y >= south) & (x <= east) & (y <= north)
        if len(self.polygons) < MANY_POLYGONS:
            inside[inside] = shapely.contains_xy(self._prepared, x[inside], y[inside])
        else:
            inside[inside] = ring_at(self._rings, x[inside] - west, y[inside] - south) >= 0
        return inside

    @cached_property
    def _prepared(self) -> shapely.Geometry:
        whole = shapely.union_all(np.array(self.polygons, object))
        shapely.prepare(whole)
        return whole

    @cached_property
    def _rings(self) -> Rings:
        return rings_of(self.polygons, self.bounds_m[:2])


def read_area(path: Path, target: CRS) -> Area:
    """The polygons of a file as an area in the projected CRS of a map; errors as :func:`.polygons_on_map`."""
    found = polygons_on_map(
        path, target, lambda why: InputError("within-unreadable", path=path, why=why, formats=VECTOR_FORMATS)
    )
    faulty = [k for k, shape in enumerate(found.shapes, start=1) if not (shape.is_valid and shape.area > 0.0)]
    if faulty:
        raise InputError("within-invalid", path=path, faulty=faulty[0])
    parts = shapely.get_parts(np.array(found.shapes, object))
    return Area(path, tuple(parts), found.notices)


def nothing_within(area: Area, what: Words, at_m: tuple[float, float] | None) -> InputError:
    """The error where nothing of `what`, such as "12 points" at easting and northing, lies in an area."""
    bounds = ", ".join(f"{end:.1f}" for end in area.bounds_m)
    return InputError(
        "within-nothing",
        area=area.path,
        what=what,
        bounds=bounds,
        at_m=at_m[0] if at_m is not None else None,
        at_m_other=at_m[1] if at_m is not None else None,
    )
