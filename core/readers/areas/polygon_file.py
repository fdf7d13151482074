"""Polygons of a vector file, or of a table of corners, in the coordinates of a map."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import shapely
from pyproj import CRS
from shapely.geometry.base import BaseGeometry

from furrowmap.core.readers.areas.corner_table import corner_polygons, is_corner_table
from furrowmap.core.readers.areas.placing import placed
from furrowmap.core.readers.vector_file import Unreadable, read_polygons
from furrowmap.core.runtime.errors import InputError


@dataclass(frozen=True)
class MapPolygons:
    """n polygons on the map.

    Attributes:
        shapes: polygons, and multipolygons of several parts, in map coordinates; their rings may cross.
        attributes: of each, by the column's name; None where a cell is empty.
    """

    shapes: tuple[BaseGeometry, ...]
    attributes: tuple[Mapping[str, Any], ...]


def polygons_on_map(path: Path, target: CRS, unreadable: Unreadable) -> MapPolygons:
    """The polygons of a file; coordinates in another CRS than `target` are projected, no datum is changed.

    Args:
        path: GeoJSON, GeoPackage, FlatGeobuf, Shapefile (also zipped), KML, or CSV (:mod:`.corner_table`).
        target: projected CRS of the map.
        unreadable: makes the error of what is wrong with the file.

    Raises:
        InputError: if the file cannot be read, has no polygon, or its coordinates lie outside the domain of `target`.
    """
    table = is_corner_table(path)
    polygons = corner_polygons(path, target, unreadable) if table else read_polygons(path, unreadable)
    try:
        shapes = placed([_single(shape) for shape in polygons.shapes], polygons.crs, target, f"{path}")
    except InputError:
        raise
    except Exception as error:  # noqa: BLE001 the errors of GEOS and PROJ have no family of their own
        raise unreadable(str(error) or type(error).__name__) from None
    return MapPolygons(tuple(shapes), polygons.attributes)


def _single(shape: BaseGeometry) -> BaseGeometry:
    """A polygon of one part instead of a multipolygon of one."""
    return shape.geoms[0] if isinstance(shape, shapely.MultiPolygon) and len(shape.geoms) == 1 else shape
