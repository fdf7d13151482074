"""Parcels from files: polygons with identifiers, on the map, gross and net."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, Final

import numpy as np
import shapely
from pyproj import CRS
from shapely.geometry.base import BaseGeometry

from furrowmap.core.crops.net_parcel import net_of
from furrowmap.core.geodesy.projection import scale_at
from furrowmap.core.readers.areas.corner_table import IDS
from furrowmap.core.readers.areas.polygon_file import MapPolygons, polygons_on_map
from furrowmap.core.readers.vector_file import FORMATS
from furrowmap.core.runtime.errors import InputError
from furrowmap.core.values.parcel import Attribute, Parcel

BLOCKS: Final = ("block", "replicate", "replication", "rep", "blk")
"""Accepted names of the column of blocks, in any case."""
_SMALLEST_M2: Final = 1e-4


@dataclass(frozen=True)
class _Found:
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
    gross = _on_map(path, target)
    nets = {found.id: found.shape for found in _on_map(net, target)} if net is not None else None
    if nets is not None and net is not None:
        _expect_same(path, [found.id for found in gross], net, nets)
    parcels, small = [], []
    ends_m, sides_m = (width * _scale(gross, target) for width in net_inset_m)
    for found in gross:
        inner = nets[found.id] if nets is not None else net_of(found.shape, ends_m, sides_m)
        if inner is None or inner.area < _SMALLEST_M2:
            small.append(found.id)
            continue
        rest = dict(found.attributes)
        block = next((rest.pop(name) for name in list(rest) if name.casefold() in BLOCKS), None)
        parcels.append(Parcel(found.id, found.shape, inner, None if block is None else label(block), rest))
    if small:
        raise InputError(
            "parcels-inset",
            path=path,
            small=listed(small, "parcel"),
            net_inset_m=net_inset_m[0],
            net_inset_m_other=net_inset_m[1],
        )
    return tuple(parcels)


def elsewhere_error(path: Path, points: int, box_m: tuple[float, float, float, float]) -> InputError:
    """The error where no point lies in or around a parcel.

    Args:
        path: of the parcels.
        points: number of points of the clouds.
        box_m: west, south, east, north of the parcels and what surrounds them.
    """
    within = ", ".join(f"{end:.1f}" for end in box_m)
    return InputError("parcels-elsewhere", path=path, points=points, within=within)


def _scale(gross: Sequence[_Found], target: CRS) -> float:
    """Metres of the map per metre on the ground where the first parcel lies."""
    place = gross[0].shape.centroid
    return scale_at(target, place.x, place.y)


def label(value: object) -> str:
    """An identifier as it is written: a whole number without decimals."""
    if isinstance(value, float | np.floating) and float(value).is_integer():
        return f"{int(value)}"
    return str(value).strip()


def _on_map(path: Path, target: CRS) -> list[_Found]:
    polygons = polygons_on_map(path, target, partial(_unreadable, path))
    names = _identifiers(path, polygons.attributes)
    shapes = _valid(path, names, polygons.shapes)
    return [
        _Found(name, shape, attributes)
        for name, shape, attributes in zip(names, shapes, _others(polygons), strict=True)
    ]


def _identifiers(path: Path, attributes: Sequence[Mapping[str, Any]]) -> list[str]:
    column = _id_column(attributes)
    if column is None:
        return [str(k) for k in range(1, len(attributes) + 1)]
    names = ["" if row.get(column) is None else label(row[column]) for row in attributes]
    nameless = [str(k) for k, name in enumerate(names, start=1) if not name]
    repeated = [name for name, count in Counter(names).items() if count > 1 and name]
    if nameless or repeated:
        raise InputError(
            "parcels-identifiers",
            path=path,
            column=column,
            nameless_list=listed(nameless, "polygon") if nameless else None,
            repeated=listed(repeated, "identifier") if not (nameless) else None,
        )
    return names


def _id_column(attributes: Sequence[Mapping[str, Any]]) -> str | None:
    names = {name.casefold(): name for row in reversed(attributes) for name in row}
    return next((names[name] for name in IDS if name in names), None)


def _others(polygons: MapPolygons) -> list[dict[str, Attribute]]:
    """The attributes besides the identifier: numbers as such, all else as text; empty cells are left out."""
    column = _id_column(polygons.attributes)
    return [
        {
            name: float(value)
            if isinstance(value, int | float | np.number) and not isinstance(value, bool)
            else str(value)
            for name, value in row.items()
            if name != column and value is not None
        }
        for row in polygons.attributes
    ]


def _valid(path: Path, names: Sequence[str], shapes: Sequence[BaseGeometry]) -> list[shapely.Polygon]:
    """The shapes, each a valid polygon of one part."""
    several = [name for name, shape in zip(names, shapes, strict=True) if not isinstance(shape, shapely.Polygon)]
    crossed = [
        name for name, shape in zip(names, shapes, strict=True) if not (shape.is_valid and shape.area > _SMALLEST_M2)
    ]
    for faulty, fault in ((several, "several parts"), (crossed, "a ring that crosses itself, or no area")):
        if faulty:
            raise InputError("parcels-invalid", path=path, faulty=listed(faulty, "parcel"), fault=fault)
    return [shape for shape in shapes if isinstance(shape, shapely.Polygon)]


def _expect_same(path: Path, gross: Sequence[str], net_path: Path, nets: Mapping[str, BaseGeometry]) -> None:
    missing = [name for name in gross if name not in nets] + [name for name in nets if name not in gross]
    if missing:
        raise InputError(
            "parcels-identifiers.expect-same", path=path, net_path=net_path, missing=listed(missing, "identifier")
        )


def listed(names: Sequence[str], what: str) -> str:
    """Such as "2 parcels (3, 17)"."""
    shown = ", ".join(names[:5]) + (", …" if len(names) > 5 else "")
    return f"{len(names)} {what}{'s' if len(names) > 1 else ''} ({shown})"


def _unreadable(path: Path, why: str) -> InputError:
    return InputError("parcels-unreadable", path=path, why=why, formats=FORMATS)
