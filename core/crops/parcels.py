"""Parcels from files: polygons with identifiers, on the map, gross and net."""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
import shapely
from pyproj import CRS

from furrowmap.core.geodesy.projection import scale_at
from furrowmap.core.readers.areas.polygon_file import IDS, polygons_on_map
from furrowmap.core.readers.vector_file import VECTOR_FORMATS
from furrowmap.core.runtime.arrays import FloatArray
from furrowmap.core.runtime.errors import InputError
from furrowmap.core.values.parcel import Attribute, Parcel

BLOCK_COLUMNS: Final = ("block", "replicate", "replication", "rep", "blk")
"""Accepted names of the column of blocks, in any case."""
MIN_PARCEL_M2: Final = 1e-4


@dataclass(frozen=True)
class _GrossParcel:
    """A polygon of a file on the map."""

    id: str
    shape: shapely.Polygon
    attributes: Mapping[str, Attribute]


def read_parcels(
    path: Path, target: CRS, net_inset_m: tuple[float, float] = (0.0, 0.0), net: Path | None = None
) -> tuple[Parcel, ...]:
    """The parcels of a vector file, or of a CSV with one row per corner, in map coordinates.

    Coordinates in another CRS than `target` are projected; no datum is changed. Identifiers are those of the first
    column named id, parcel, plot or name, else 1, 2, … in the order of the file; blocks those of a column block or rep.

    Args:
        path: GeoJSON, GeoPackage, FlatGeobuf, Shapefile (also zipped), KML, or CSV of corners.
        target: projected CRS of the map.
        net_inset_m: width of the strip between gross and net parcel off each end, and off each side, in metres on the
            ground.
        net: file with the net parcels, under the same identifiers, instead of an inset.

    Raises:
        InputError: if a file cannot be read or has no polygon, a polygon is invalid, identifiers repeat or differ
            between the files, the parcels lie outside the domain of `target`, or are smaller than the inset.
    """
    gross = _read_polygons(path, target)
    nets = {found.id: found.shape for found in _read_polygons(net, target)} if net is not None else {}
    if net is not None and (differing := {found.id for found in gross} ^ nets.keys()):
        missing = [found.id for found in gross if found.id in differing] + [name for name in nets if name in differing]
        raise InputError(
            "parcels-identifiers.expect-same", path=path, net_path=net, missing=list_names(missing, "identifier")
        )
    place = gross[0].shape.centroid
    scale = scale_at(target, place.x, place.y)  # metres of the map per metre on the ground
    parcels, small = [], []
    for found in gross:
        ends_m, sides_m = (width * scale for width in net_inset_m)
        inner = nets[found.id] if net is not None else inset_parcel(found.shape, ends_m, sides_m)
        if inner is None or inner.area < MIN_PARCEL_M2:
            small.append(found.id)
            continue
        rest = dict(found.attributes)
        block = next((rest.pop(name) for name in list(rest) if name.casefold() in BLOCK_COLUMNS), None)
        parcels.append(Parcel(found.id, found.shape, inner, None if block is None else _label(block), rest))
    if small:
        raise InputError(
            "parcels-inset",
            path=path,
            small=list_names(small, "parcel"),
            net_inset_m=net_inset_m[0],
            net_inset_m_other=net_inset_m[1],
        )
    return tuple(parcels)


def elsewhere_error(path: Path, points: int, box_m: tuple[float, float, float, float]) -> InputError:
    """The error where no point lies in or around parcels, whose box is west, south, east, north."""
    within = ", ".join(f"{end:.1f}" for end in box_m)
    return InputError("parcels-elsewhere", path=path, points=points, within=within)


def inset_parcel(gross: shapely.Polygon, ends_m: float, sides_m: float) -> shapely.Polygon | None:
    """The net parcel; None if nothing, or no single polygon, is left.

    The ends of a parcel with four corners are the two opposite edges that are shorter together, its sides the others.
    Those of any other shape are the edges of its smallest rectangle.
    """
    if ends_m == 0.0 and sides_m == 0.0:
        return gross
    corners = _corners(gross)
    if corners is None:
        corners = _corners(shapely.minimum_rotated_rectangle(gross))
    if corners is None:
        return None
    along = np.roll(corners, -1, axis=0) - corners
    length = np.hypot(*along.T)
    first_are_ends = length[0] + length[2] < length[1] + length[3]
    widths = np.where((np.arange(4) % 2 == 0) == first_are_ends, ends_m, sides_m)
    inner = gross
    for start, step, reach, width in zip(corners, along, length, widths, strict=True):
        # the half-plane to the left of the edge, moved inwards, as far as the parcel reaches
        direction = step / reach
        inwards = np.array([-direction[1], direction[0]])
        west, south, east, north = gross.bounds
        far = 4.0 * (east - west + north - south) + 4.0 * float(width)
        at = start + float(width) * inwards
        beyond = [at + far * (direction + inwards), at + far * (inwards - direction)]
        left = inner.intersection(shapely.Polygon([at - far * direction, at + far * direction, *beyond]))
        if not isinstance(left, shapely.Polygon) or left.is_empty:
            return None
        inner = left
    return inner


def _corners(shape: shapely.Geometry) -> FloatArray | None:
    """The four corners (4, 2) of a convex quadrilateral, counterclockwise; None for any other shape."""
    if not isinstance(shape, shapely.Polygon) or shape.interiors:
        return None
    corners = shapely.get_coordinates(shapely.orient_polygons(shape).simplify(1e-3))[:-1]
    if len(corners) != 4:
        return None
    along = np.roll(corners, -1, axis=0) - corners
    after = np.roll(along, -1, axis=0)
    turns = along[:, 0] * after[:, 1] - along[:, 1] * after[:, 0]
    return corners if (turns > 0.0).all() else None


def _label(value: object) -> str:
    """An identifier as it is written: a whole number without decimals."""
    if isinstance(value, float | np.floating) and float(value).is_integer():
        return f"{int(value)}"
    return str(value).strip()


def _read_polygons(path: Path, target: CRS) -> list[_GrossParcel]:
    def unreadable(why: str) -> InputError:
        return InputError("parcels-unreadable", path=path, why=why, formats=VECTOR_FORMATS)

    polygons = polygons_on_map(path, target, unreadable)
    columns = {name.casefold(): name for row in reversed(polygons.attributes) for name in row}
    column = next((columns[name] for name in IDS if name in columns), None)
    names = _identifiers(path, polygons.attributes, column)
    named = list(zip(names, polygons.shapes, strict=True))
    several = [name for name, shape in named if not isinstance(shape, shapely.Polygon)]
    crossed = [name for name, shape in named if not (shape.is_valid and shape.area > MIN_PARCEL_M2)]
    for faulty, fault in ((several, "several parts"), (crossed, "a ring that crosses itself, or no area")):
        if faulty:
            raise InputError("parcels-invalid", path=path, faulty=list_names(faulty, "parcel"), fault=fault)
    return [
        _GrossParcel(name, shape, _attributes(row, column))
        for (name, shape), row in zip(named, polygons.attributes, strict=True)
        if isinstance(shape, shapely.Polygon)
    ]


def _identifiers(path: Path, attributes: Sequence[Mapping[str, Any]], column: str | None) -> list[str]:
    if column is None:
        return [str(k) for k in range(1, len(attributes) + 1)]
    names = ["" if row.get(column) is None else _label(row[column]) for row in attributes]
    nameless = [str(k) for k, name in enumerate(names, start=1) if not name]
    repeated = [name for name, count in Counter(names).items() if count > 1 and name]
    if nameless or repeated:
        raise InputError(
            "parcels-identifiers",
            path=path,
            column=column,
            nameless_list=list_names(nameless, "polygon") if nameless else None,
            repeated=list_names(repeated, "identifier") if not nameless else None,
        )
    return names


def _attributes(row: Mapping[str, Any], column: str | None) -> dict[str, Attribute]:
    """The attributes besides the identifier: numbers as such, all else as text; empty cells are left out."""
    return {
        name: float(value) if isinstance(value, int | float | np.number) and not isinstance(value, bool) else str(value)
        for name, value in row.items()
        if name != column and value is not None
    }


def list_names(names: Sequence[str], what: str) -> str:
    """Such as "2 parcels (3, 17)"."""
    shown = ", ".join(names[:5]) + (", …" if len(names) > 5 else "")
    return f"{len(names)} {what}{'s' if len(names) > 1 else ''} ({shown})"
