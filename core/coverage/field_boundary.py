"""A field's boundary in the map frame."""

from collections.abc import Sequence
from pathlib import Path
from typing import Final

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely.geometry.base import BaseGeometry

from furrowmap.core.geodesy.longitudes import principal_deg
from furrowmap.core.geodesy.projection import MapFrame
from furrowmap.core.readers.areas.area import Area
from furrowmap.core.readers.areas.repair import made_valid, whole_in_degrees
from furrowmap.core.readers.boundary_file import WITHIN_UNREADABLE, FieldOutline, read_fields
from furrowmap.core.runtime.errors import InputError, Notice, RefusedError

MIN_BOUNDARY_SHARE: Final = 0.01
"""A field in which the vehicle is for less of the time is passed by or crossed."""
MAX_NAMES: Final = 10
MAX_OUTSIDE_SHARE: Final = 0.1
"""A larger share of the worked ground outside of its field is no headland, but another field's."""
BOUNDARY_STRIP_M: Final = 1.0
"""Boundaries are drawn, and driven along, to this."""


def field_boundary(
    file: Path, frame: MapFrame, name: str | None, xy_m: NDArray[np.float64]
) -> tuple[BaseGeometry, list[Notice]]:
    """The boundary of the field of a drive in the map frame, and which field of the file that is.

    Of several fields, the one of that name; without a name, those in which the vehicle is; where it is in none, all.
    `xy_m` (n, 2) are places of the vehicle at even steps of time. Raises InputError if the file cannot be read, has no
    field of the name, or the field lies outside the map.
    """
    fields, decided = read_fields(file, frame.crs)
    notices = list(decided)
    if name is not None:
        wanted = [field for field in fields if name.casefold().strip() in map(str.casefold, field.names)]
        if not wanted:
            known = [" / ".join(field.names[:3]) for field in fields if field.names]
            shown = ", ".join(known[:MAX_NAMES]) + (" and others" if len(known) > MAX_NAMES else "")
            raise InputError("field-unknown", file=file, fields=len(fields), name=name, known=bool(known), shown=shown)
        return boundary_on_map(_union(wanted), frame), notices
    if len(fields) == 1:
        return boundary_on_map(fields[0].outline, frame), notices
    on_map = [boundary_on_map(field.outline, frame) for field in fields]
    shares = [float(np.mean(shapely.contains_xy(shape, *xy_m[:, :2].T))) for shape in on_map]
    chosen = [k for k, share in enumerate(shares) if share >= MIN_BOUNDARY_SHARE] or list(range(len(fields)))
    boundary = shapely.union_all([on_map[k] for k in chosen])
    if len(chosen) == len(fields):
        return boundary, notices
    names = ", ".join(" / ".join(fields[k].names[:3]) or "without a name" for k in chosen[:MAX_NAMES])
    notices.append(Notice("field-chosen", file=file, fields=len(fields), chosen=len(chosen), names=names))
    return boundary, notices


def held_against_boundary(
    boundary: BaseGeometry | None, worked: BaseGeometry | None, xy_m: NDArray[np.float64]
) -> list[Notice]:
    """The notice that a drive was elsewhere than in its field.

    Args:
        boundary: of the field, in the map frame; None where the session names none.
        worked: the ground worked, in the map frame; None where it is not known.
        xy_m: (n, 2) places of the vehicle at even steps of time.
    """
    if boundary is None or boundary.is_empty or not len(xy_m):
        return []
    if worked is None or worked.is_empty:
        inside = shapely.contains_xy(boundary, *xy_m[:, :2].T)
        if inside.any():
            return []
        return [_apart(boundary, shapely.MultiPoint(xy_m[:, :2]))]
    outside = worked.difference(boundary)
    # What is narrower lies along the boundary.
    beyond = outside.buffer(-0.5 * BOUNDARY_STRIP_M).buffer(0.5 * BOUNDARY_STRIP_M)
    if outside.area >= worked.area:
        return [_apart(boundary, worked)]
    if beyond.area <= MAX_OUTSIDE_SHARE * worked.area:
        return []
    corners_m = shapely.get_coordinates(outside)
    farthest_m = float(shapely.distance(boundary, shapely.points(corners_m)).max())
    return [Notice("boundary-apart", share=outside.area / worked.area, farthest_m=farthest_m)]


def _apart(boundary: BaseGeometry, drive: BaseGeometry) -> Notice:
    """The notice that no part of a drive lies within its field."""
    here, there = shapely.get_coordinates(shapely.shortest_line(drive, boundary))
    east_m, north_m = (there - here).tolist()
    way_m = float(np.hypot(east_m, north_m))
    return Notice("boundary-apart.wholly", way_m=way_m, east_m=east_m, north_m=north_m)


def ground_to_map(file: Path, frame: MapFrame) -> Area:
    """All polygons of a file, or of task data, as an area of the map; InputError if it cannot be read."""
    fields, notices = read_fields(file, frame.crs, WITHIN_UNREADABLE)
    shape = boundary_on_map(_union(fields), frame)
    polygons = [part for part in shapely.get_parts(shape) if part.geom_type == "Polygon"]
    return Area(file, tuple(polygons), notices)


def _union(fields: Sequence[FieldOutline]) -> BaseGeometry:
    """All fields as one, in longitude and latitude."""
    together = np.array([shapely.union_all([field.outline for field in fields])], object)
    whole: BaseGeometry = whole_in_degrees(together)[0]
    return whole


def boundary_on_map(boundary: BaseGeometry, frame: MapFrame) -> BaseGeometry:
    """The polygons of `boundary` (longitude, latitude) on the map; raises InputError outside the area of its CRS."""
    try:
        return made_valid(shapely.transform(boundary, lambda xy: np.column_stack(frame.project(xy[:, 0], xy[:, 1]))))
    except RefusedError as error:
        lon, lat = boundary.centroid.coords[0]
        raise InputError("boundary-elsewhere", lat=lat, lon=principal_deg(lon), frame=frame.name) from error
