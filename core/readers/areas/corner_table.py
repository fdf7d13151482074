"""Parcels from a CSV with one row per corner, as surveyed: id, e_m, n_m (or lon_deg, lat_deg), and other columns."""

from __future__ import annotations

from pathlib import Path
from typing import Final

import numpy as np
import shapely
from pyproj import CRS

from furrowmap.core.readers.text_table import number_or_text, read_table
from furrowmap.core.readers.vector_file import MAX_VECTOR_BYTES, Polygons, Unreadable

IDS: Final = ("id", "parcel", "parcel_id", "plot", "plot_id", "plot_no", "name", "nr", "no")
"""Accepted names of the column of identifiers, in any case."""
_MAP_PAIRS: Final = (("e_m", "n_m"), ("easting", "northing"), ("e", "n"), ("x", "y"), ("east", "north"))
_DEGREE_PAIRS: Final = (("lon_deg", "lat_deg"), ("lon", "lat"), ("longitude", "latitude"))


def is_corner_table(path: Path) -> bool:
    """Whether a file is a text whose first line names columns of coordinates."""
    try:
        with path.open("rb") as file:
            head = file.read(4096).lstrip(b"\xef\xbb\xbf")
    except OSError:
        return False
    first = head.split(b"\n")[0]
    if b"\0" in head or first.lstrip()[:1] in (b"{", b"<", b"["):
        return False
    words = {
        word.strip().strip('"').casefold()
        for word in first.decode("latin-1").replace(";", ",").replace("\t", ",").split(",")
    }
    return any(x in words and y in words for x, y in (*_MAP_PAIRS, *_DEGREE_PAIRS))


def corner_polygons(path: Path, target: CRS, unreadable: Unreadable) -> Polygons:
    """The polygons of the rows with the same identifier, in their order around each parcel.

    Eastings and northings are those of `target`, longitudes and latitudes of its geographic base.

    Raises:
        InputError: made by `unreadable`, if the file is no such table, or a parcel has fewer than three corners.
    """
    size = path.stat().st_size
    if size > MAX_VECTOR_BYTES:
        raise unreadable(f"{size:,} bytes is too large for a table of corners")
    table = read_table(path, unreadable)
    names = next((pair for pair in (*_MAP_PAIRS, *_DEGREE_PAIRS) if set(pair) <= set(table.columns)), None)
    column = table.find(IDS)
    if names is None or column is None or not table.lines:
        raise unreadable(f"no rows with an identifier and two coordinates (its columns: {table.names})")
    xy = np.column_stack([table.numbers(name) for name in names])
    for name in names:
        fault = table.first_fault(name)
        if fault is not None:
            raise unreadable(f"line {fault[0]} holds {fault[1]!r} under {name}")
    if not np.isfinite(xy).all():
        row = int(np.flatnonzero(~np.isfinite(xy).all(axis=1))[0])
        raise unreadable(f"line {table.lines[row]} has a coordinate that is empty or not finite")
    rows: dict[str, list[int]] = {}
    for k, name in enumerate(table.columns[column]):
        rows.setdefault(name.strip(), []).append(k)
    others = {key: cells for key, cells in table.columns.items() if key not in (column, *names)}
    shapes, attributes = [], []
    for name, members in rows.items():
        if len(members) < 3:
            raise unreadable(f"parcel {name!r} has {len(members)} corners, and a polygon has three or more")
        shapes.append(shapely.Polygon(xy[members]))
        attributes.append({column: name, **{key: number_or_text(cells[members[0]]) for key, cells in others.items()}})
    crs = target if names in _MAP_PAIRS else target.geodetic_crs or target
    return Polygons(tuple(shapes), tuple(attributes), crs, 0)
