"""Field boundaries from vector files."""

from collections.abc import Iterable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Final

import numpy as np
import shapely
from pyproj import CRS, Transformer
from shapely.geometry.base import BaseGeometry

from furrowmap.core.readers.areas.polygons import open_polygons
from furrowmap.core.readers.areas.repair import made_valid, whole_in_degrees
from furrowmap.core.readers.isoxml.content import MAX_FIELD_DEG
from furrowmap.core.readers.vector_file import VECTOR_FORMATS, Polygons, Unreadable
from furrowmap.core.runtime.errors import FurrowmapError, InputError, Notice
from furrowmap.core.runtime.languages.texts import Text, Words, reason
from furrowmap.core.values.crs import LARGEST_DATUM_SHIFT_M, datum_shift_m


@dataclass(frozen=True)
class FieldOutline:
    """A field of a file, in longitude and latitude, and its names: attributes as texts.

    Of task data its name and id.
    """

    names: tuple[str, ...]
    outline: BaseGeometry


BOUNDARY_UNREADABLE: Final = "boundary-unreadable"
WITHIN_UNREADABLE: Final = "within-unreadable"
BOUNDARIES_UNREADABLE: Final = "boundaries-unreadable"
"""Errors of a file that cannot be read, by what its polygons are for."""


def read_fields(
    path: Path, target: CRS | None = None, error_code: str = BOUNDARY_UNREADABLE
) -> tuple[list[FieldOutline], tuple[Notice, ...]]:
    """The fields of a file or folder (:mod:`.areas.polygons`), a polygon each, in longitude and latitude.

    Notices say what was decided where a file leaves it open; `target` is the CRS of the map, if it is known.

    Projected coordinates are converted to longitude and latitude of the same datum; no datum is changed. InputError if
    the file has another format, cannot be read, has no polygon, states no CRS, or one on a historical datum.
    """
    unreadable = partial(_unreadable, path, error_code)
    polygons = open_polygons(path, target, unreadable)
    try:
        outlines, base = _outlines(polygons, unreadable)
        middle = outlines[0].centroid
        apart = datum_shift_m(base, round(middle.x, 1), round(middle.y, 1))
    except InputError:
        raise
    except Exception as error:  # noqa: BLE001 the errors of GDAL, GEOS and PROJ have no family of their own
        raise unreadable(reason(error)) from None
    if apart is not None and apart > LARGEST_DATUM_SHIFT_M:
        if np.isinf(apart):
            raise InputError("boundary-datum.unknown", path=path, base=base.name)
        raise InputError("boundary-datum", path=path, base=base.name, apart_m=apart)
    rows = zip(polygons.attributes, outlines, strict=True)
    return [FieldOutline(_texts(attributes.values()), outline) for attributes, outline in rows], polygons.notices


def notices_of_fields(path: Path) -> tuple[Notice, ...]:
    """What :func:`read_fields` notices of a file; nothing of one that cannot be read."""
    try:
        # notices do not depend on the map
        return open_polygons(path, CRS.from_epsg(3857), partial(_unreadable, path, BOUNDARY_UNREADABLE)).notices
    except FurrowmapError:
        return ()


def _texts(values: Iterable[object]) -> tuple[str, ...]:
    return tuple(dict.fromkeys(str(value).strip() for value in values if isinstance(value, str | int)))


def _outlines(polygons: Polygons, unreadable: Unreadable) -> tuple[list[BaseGeometry], CRS]:
    """The polygons in longitude and latitude, and the CRS of these."""
    base = polygons.crs.geodetic_crs
    assert base is not None
    to_base = Transformer.from_crs(polygons.crs, base.to_2d(), always_xy=True)
    outlines = []
    shapes = shapely.transform(np.array(polygons.shapes, object), lambda xy: np.column_stack(to_base.transform(*xy.T)))
    for shape in whole_in_degrees(shapes):
        outline = made_valid(shape)
        if not np.isfinite(shapely.get_coordinates(outline)).all() or outline.area == 0.0:
            raise unreadable(Text("its polygons are empty, or their coordinates do not match its CRS"))
        west, south, east, north = outline.bounds
        if max(-south, north) > 90.0 or max(-west, east) > 360.0:
            raise unreadable(
                Text(
                    "it reaches from {south:g} to {north:g} latitude and {west:g} to {east:g} longitude",
                    south=south,
                    north=north,
                    west=west,
                    east=east,
                )
            )
        if max(north - south, (east - west) * np.cos(np.radians(max(-south, north)))) > MAX_FIELD_DEG:
            raise unreadable(
                Text(
                    "it is {high_deg:.3g}° high and {wide_deg:.3g}° wide, which no field is",
                    high_deg=north - south,
                    wide_deg=east - west,
                )
            )
        outlines.append(outline)
    return outlines, base


def _unreadable(path: Path, error_code: str, why: Words) -> InputError:
    return InputError(error_code, path=path, why=why, formats=VECTOR_FORMATS)
