"""Coordinates that count as longitudes and latitudes, and are metres of a map whose CRS the file does not state."""

from pathlib import Path
from typing import Final, Literal

import numpy as np
from pyproj import CRS

from furrowmap.core.runtime.arrays import FloatArray
from furrowmap.core.runtime.errors import InputError
from furrowmap.core.values.crs import full_name_of

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
