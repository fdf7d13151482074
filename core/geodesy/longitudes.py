"""Longitudes: near the antimeridian, where they step by 360°, and coordinates that count as them and are not."""

from functools import partial
from pathlib import Path
from typing import Any, Final, Literal

import numpy as np
import shapely
from numpy.typing import NDArray
from pyproj import CRS
from shapely.geometry.base import BaseGeometry

from furrowmap.core.runtime.arrays import FloatArray
from furrowmap.core.runtime.errors import InputError
from furrowmap.core.values.crs import full_name_of


def unwrapped_deg(lon_deg: FloatArray, about_deg: float | None = None) -> FloatArray:
    """Longitudes (n,), each within 180° of one of them: by default of the first finite one.

    Those that are within 180° already are unchanged to the last bit.
    """
    if about_deg is None:
        known = lon_deg[np.isfinite(lon_deg)]
        about_deg = float(known[0]) if len(known) else 0.0
    turns = np.round((lon_deg - about_deg) / 360.0)
    out: FloatArray = lon_deg - 360.0 * turns
    return out


def signed_deg(lon_deg: FloatArray) -> FloatArray:
    """Longitudes (n,) from −180 to 180°; some programs write the western hemisphere as 180 to 360°."""
    is_beyond = (np.abs(lon_deg) > 180.0) & (np.abs(lon_deg) <= 360.0)
    return np.where(is_beyond, lon_deg - np.copysign(360.0, lon_deg), lon_deg)


def principal_deg(lon_deg: float) -> float:
    """A longitude from -180° to below 180°; unchanged where it is so already."""
    return lon_deg - 360.0 * float(np.floor((lon_deg + 180.0) / 360.0))


def middle_deg(lon_deg: FloatArray, lat_deg: FloatArray) -> tuple[float, float]:
    """Median longitude and latitude of positions (n,), also across the antimeridian; nan where none is finite."""
    known = lon_deg[np.isfinite(lon_deg)]
    if not len(known):
        return float("nan"), float(np.nanmedian(lat_deg))
    # not about the first position, which may be a receiver's 0° before it has a fix
    angle = np.radians(known)
    about_deg = float(np.degrees(np.arctan2(np.sin(angle).sum(), np.cos(angle).sum())))
    return principal_deg(float(np.median(unwrapped_deg(known, about_deg)))), float(np.nanmedian(lat_deg))


def west_east_deg(lon_deg: FloatArray) -> tuple[float, float]:
    """Western and eastern end of longitudes (n,), from -180° to 180°: west > east where they cross the antimeridian.

    This is the order of a bounding box in RFC 7946, section 5.2. nan where none is finite.
    """
    known = lon_deg[np.isfinite(lon_deg)]
    if not len(known):
        return float("nan"), float("nan")
    whole = unwrapped_deg(known, middle_deg(known, known)[0])
    return bounding_box_ends_deg(float(whole.min()), float(whole.max()))


def bounding_box_ends_deg(west_deg: float, east_deg: float) -> tuple[float, float]:
    """Western and eastern end of a range of longitudes in the order of RFC 7946, as of :func:`west_east_deg`."""
    west = west_deg if -180.0 <= west_deg < 180.0 else principal_deg(west_deg)
    east = east_deg if -180.0 < east_deg <= 180.0 else principal_deg(east_deg)
    return west, east


def cut_at_antimeridian(shapes: NDArray[Any]) -> NDArray[Any]:
    """Geometries (n,) in degrees as RFC 7946 (3.1.9) has them: lines and polygons that cross the antimeridian in parts.

    Corners may lie on either side of it, or beyond 180°. Others, and None, are unchanged.
    """
    found = shapes.copy()
    xyz, of = shapely.get_coordinates(found, include_z=True, return_index=True)
    if not len(xyz) or (np.ptp(xyz[:, 0]) <= 180.0 and np.abs(xyz[:, 0]).max() <= 180.0):
        return found
    first = xyz[np.searchsorted(of, of), 0]
    whole = xyz[:, 0] - 360.0 * np.round((xyz[:, 0] - first) / 360.0)
    for k in np.unique(of[np.abs(whole) > 180.0]):
        own = np.column_stack([whole, xyz[:, 1:]])[of == k]
        found[k] = _cut(_with_corners(found[k], own))
    return found


def _with_corners(shape: BaseGeometry, xyz: FloatArray) -> BaseGeometry:
    moved: BaseGeometry = shapely.transform(shape, lambda _: xyz[:, : 2 + shape.has_z], include_z=shape.has_z)
    return moved


def _cut(shape: BaseGeometry) -> BaseGeometry:
    """A geometry that reaches beyond 180°, in parts from -180° to 180°."""
    kind = shape.geom_type.removeprefix("Multi")
    parts: list[BaseGeometry] = []
    for turn in (-1, 0, 1):
        side = shapely.box(360.0 * turn - 180.0, -90.0, 360.0 * turn + 180.0, 90.0)
        found = shapely.get_parts(shapely.intersection(shape, side))
        within = [part for part in found if part.geom_type == kind and not part.is_empty]
        parts += [shapely.transform(part, partial(_turned, turn=turn), include_z=part.has_z) for part in within]
    if len(parts) == 1:
        return parts[0]
    several: dict[str, Any] = {"LineString": shapely.MultiLineString, "Polygon": shapely.MultiPolygon}
    whole: BaseGeometry = several.get(kind, shapely.MultiPoint)(parts)
    return whole


def _turned(xyz: FloatArray, turn: int) -> FloatArray:
    return np.column_stack([xyz[:, 0] - 360.0 * turn, xyz[:, 1:]])


SaidBy = Literal["layer", "geojson", "kml", "table"]
"""What says that coordinates are degrees: a CRS, a format without others, or the names of columns."""
FEWEST_METRES: Final = 1_000.0
"""Larger coordinates are no angles that a program got wrong, but those of a map."""
_MOST_WITH_MINUTES: Final = (18_060.0, 9_060.0)


def expect_degrees(path: Path, xy: FloatArray, crs: CRS, said_by: SaidBy) -> None:
    """Raises InputError where one of the coordinates (n, 2) in a geographic CRS is too large for any angle.

    Latitudes from 90° to that are left to the caller: they are longitudes, or places on another map.
    """
    beyond = np.flatnonzero((np.abs(xy) > FEWEST_METRES).any(axis=1))
    if not len(beyond):
        return
    x, y = xy[beyond[0]].tolist()
    raise InputError(
        "not-degrees",
        path=path,
        x=x,
        y=y,
        crs=full_name_of(crs),
        is_minutes=_has_minutes(xy),
        is_layer=said_by == "layer",
        is_table=said_by == "table",
        is_kml=said_by == "kml",
    )


def _has_minutes(xy: FloatArray) -> bool:
    """Whether coordinates (n, 2) may be degrees and minutes without a space, as in NMEA 0183: 5126.7412."""
    known = np.abs(xy[np.isfinite(xy).all(axis=1)])
    return bool((known <= _MOST_WITH_MINUTES).all() and (known % 100.0 < 60.0).all())
