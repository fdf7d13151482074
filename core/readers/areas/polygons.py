"""The one way in for polygons: vector files, tables of corners, field folders of AgOpenGPS, ISO 11783 task data.

A table of corners has a row per corner: id, and e_m, n_m or lon_deg, lat_deg.
"""

from pathlib import Path
from typing import Final

import numpy as np
import shapely
from pyproj import CRS

from furrowmap.core.geodesy.longitudes import expect_degrees
from furrowmap.core.readers.agopengps import is_field_folder, read_outline
from furrowmap.core.readers.areas.repair import repaired, workable
from furrowmap.core.readers.column_names import in_units, standard_name, without_unit
from furrowmap.core.readers.isoxml.content import is_task_data, open_task_sets, read_content
from furrowmap.core.readers.text_table import column_names, is_spreadsheet, number_or_text, read_table
from furrowmap.core.readers.vector_file import MAX_VECTOR_BYTES, Polygons, Unreadable, read_polygons
from furrowmap.core.runtime.errors import InputError
from furrowmap.core.runtime.file_names import resolved
from furrowmap.core.runtime.languages.texts import Text, reason

_LONGITUDES: Final = CRS.from_epsg(4326)
IDS: Final = ("id", "parcel", "parcel_id", "plot", "plot_id", "plot_no", "parzelle", "区画", "name", "nr", "no")
"""Accepted names of the column of identifiers, in any case."""
_MAP_PAIRS: Final = (("e_m", "n_m"), ("easting", "northing"), ("e", "n"), ("x", "y"), ("east", "north"))
_DEGREE_PAIRS: Final = (("lon_deg", "lat_deg"), ("lon", "lat"), ("longitude", "latitude"))
_PAIRS: Final = (*_MAP_PAIRS, *_DEGREE_PAIRS)


def open_polygons(path: Path, target: CRS | None, unreadable: Unreadable) -> Polygons:
    """The polygons of a file or folder, in its own coordinates.

    Args:
        path: of a vector file (:mod:`..vector_file`); a table of corners; a field folder of AgOpenGPS, which is one
            polygon; or task data, whose polygons are its fields.
        target: projected CRS of the map, for tables of corners, whose longitudes and latitudes are in its datum. None
            if there is no map yet: eastings and northings are then refused.
        unreadable: makes the error.

    Raises:
        InputError: that of `unreadable` if it has another format, cannot be read, has no polygon or states no CRS;
            another if task data are incomplete or damaged.
        RefusedError: if an archive unpacks to far more than its size.
    """
    if is_field_folder(path):
        return _of_agopengps(path, unreadable)
    if is_task_data(path):
        return _of_task_data(path, unreadable)
    if path.is_dir():
        raise unreadable(Text("it is a folder, and neither that of a field of AgOpenGPS nor of task data"))
    return _corner_polygons(path, target, unreadable) if _is_corner_table(path) else read_polygons(path, unreadable)


def _of_agopengps(folder: Path, unreadable: Unreadable) -> Polygons:
    outline = read_outline(folder, unreadable)
    try:
        return Polygons((repaired(outline),), ({"name": resolved(folder).name},), _LONGITUDES)
    except ValueError as error:
        raise unreadable(reason(error)) from None


def _of_task_data(path: Path, unreadable: Unreadable) -> Polygons:
    sets = [read_content(files) for files in open_task_sets(path)]
    fields = [one for content in sets for one in content.partfields.values()]
    known = [one for one in fields if one.boundary is not None]
    if not known:
        raise unreadable(Text("none of its {fields} fields has a boundary", fields=len(fields)))
    names = tuple({"name": one.name or None, "id": one.id} for one in known)
    shapes = tuple(one.boundary for one in known if one.boundary is not None)
    return Polygons(shapes, names, _LONGITUDES, tuple(notice for one in sets for notice in one.notices))


def _is_corner_table(path: Path) -> bool:
    """Whether a file is a spreadsheet, or a text whose header names columns of coordinates."""
    try:
        words = set(_MAP_PAIRS[0]) if is_spreadsheet(path) else set(column_names(path))
    except OSError:
        return False
    standard = {standard_name(word) or without_unit(word) for word in words}
    return any(standard >= {standard_name(name) for name in pair} for pair in _PAIRS)


def _corner_polygons(path: Path, target: CRS | None, unreadable: Unreadable) -> Polygons:
    """The polygons of the rows with the same identifier, in order, in the CRS of the map or its geographic base."""
    size = path.stat().st_size
    if size > MAX_VECTOR_BYTES:
        raise unreadable(Text("{size:,} bytes is too large for a table of corners", size=size))
    table = read_table(path, unreadable)
    pair = next((pair for pair in _PAIRS if set(pair) <= set(table.columns)), None)
    pair = pair or next((pair for pair in _PAIRS if all(table.find([name]) for name in pair)), None)
    names = [table.find([name]) or name for name in pair or ()]
    column = table.find(IDS)
    if pair is None or column is None or not table.lines:
        raise unreadable(
            Text("no rows with an identifier and two coordinates (its columns: {names})", names=table.names)
        )
    units_m = [table.unit_m(name) if pair in _MAP_PAIRS else None for name in names]
    xy, converted = in_units(target, np.column_stack([table.numbers(name) for name in names]), units_m)
    fault = table.first_fault(names)
    if fault is not None:
        raise unreadable(fault)
    if not np.isfinite(xy).all():
        row = int(np.flatnonzero(~np.isfinite(xy).all(axis=1))[0])
        raise unreadable(Text("line {line} has a coordinate that is empty or not finite", line=table.lines[row]))
    rows: dict[str, list[int]] = {}
    for k, name in enumerate(table.columns[column]):
        rows.setdefault(name.strip(), []).append(k)
    others = {key: cells for key, cells in table.columns.items() if key not in (column, *names)}
    shapes: list[shapely.Polygon] = []
    attributes: list[dict[str, object]] = []
    for name, members in rows.items():
        if len(members) < 3:
            raise unreadable(
                Text(
                    "parcel {name!r} has {corners} corners, and a polygon has three or more",
                    name=name,
                    corners=len(members),
                )
            )
        shapes.append(shapely.Polygon(xy[members]))
        attributes.append({column: name, **{key: number_or_text(cells[members[0]]) for key, cells in others.items()}})
    if target is None and pair in _MAP_PAIRS:
        raise InputError("polygons-no-crs.of-table", path=path)
    base = target.geodetic_crs if target is not None else _LONGITUDES
    crs = target if target is not None and (pair in _MAP_PAIRS or base is None) else base
    assert crs is not None
    if pair in _DEGREE_PAIRS:
        expect_degrees(path, xy, crs, "table")
    try:
        return Polygons(tuple(workable(shapes, crs)), tuple(attributes), crs, (*table.notices, *converted))
    except ValueError as error:
        raise unreadable(reason(error)) from None
