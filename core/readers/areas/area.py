"""An area of the map: the polygons of a file, and whether points lie in them."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Final

import numpy as np
import shapely
from pyproj import CRS

from furrowmap.core.readers.areas.polygon_file import polygons_on_map
from furrowmap.core.readers.areas.rings import Rings, ring_at, rings_of
from furrowmap.core.readers.vector_file import VECTOR_FORMATS
from furrowmap.core.runtime.arrays import BoolArray, FloatArray
from furrowmap.core.runtime.errors import InputError

MANY_POLYGONS: Final = 50
"""Polygons from which on a grid of them finds the right one faster than an index of all their edges."""


@dataclass(frozen=True)
class Area:
    """One or more polygons in map coordinates, with their holes; they may overlap."""

    path: Path
    polygons: tuple[shapely.Polygon, ...]

    @property
    def bounds_m(self) -> tuple[float, float, float, float]:
        """West, south, east, north."""
        west, south, east, north = shapely.total_bounds(np.array(self.polygons, object)).tolist()
        return west, south, east, north

    def contains(self, xy_m: FloatArray) -> BoolArray:
        """Whether points (n, 2) or (n, 3) in map coordinates lie in one of the polygons, and in none of its holes."""
        west, south, east, north = self.bounds_m
        x, y = xy_m[:, 0], xy_m[:, 1]
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
    return Area(path, tuple(parts))


def nothing_within(area: Area, what: str, at_m: tuple[float, float] | None) -> InputError:
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
