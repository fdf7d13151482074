"""Polygons of the ground that a line sweeps: flat at both ends, as curved as the way."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely.geometry.base import BaseGeometry

from furrowmap.core.work.sweep import Sweep

FloatArray = NDArray[np.float64]

TOLERANCE_M: Final = 0.002
"""Sides have as few vertices as leave them this near to the path (Douglas and Peucker's rule)."""
LONGEST_M: Final = 25.0
LARGEST_TURN_RAD: Final = np.radians(45.0)
"""Within a ribbon so short and so straight the line does not come back to ground that it has swept."""


@dataclass(frozen=True)
class Ribbon:
    """The ground swept along a piece of a run.

    Attributes:
        polygon: valid; of several parts only where the line turns about a place within itself.
        left: (k, 3) the side swept by the line's left end: easting, northing, seconds since the sweep began.
        right: (l, 3) the other side.
    """

    polygon: BaseGeometry
    left: FloatArray
    right: FloatArray


def ribbons(sweep: Sweep) -> list[Ribbon]:
    """The pieces of a sweep in their order; neighbours share the line between them, vertex for vertex."""
    since_s = sweep.t_s - sweep.t_s[0]
    left = np.column_stack([sweep.middle_m[:, :2] + sweep.half_m, since_s])
    right = np.column_stack([sweep.middle_m[:, :2] - sweep.half_m, since_s])
    found = []
    for piece in _pieces(sweep):
        sides = [_simplified(side[piece]) for side in (left, right)]
        polygon: BaseGeometry = shapely.Polygon(np.concatenate([sides[0], sides[1][::-1]])[:, :2])
        if not polygon.is_valid:
            polygon = _folded(left[piece, :2], right[piece, :2])
        found.append(Ribbon(polygon, *sides))
    return found


def _pieces(sweep: Sweep) -> list[slice]:
    """Where a sweep is cut, so that no piece is longer than :data:`LONGEST_M` or turns by more than 45°."""
    yaw = np.unwrap(np.arctan2(-sweep.half_m[:, 0], sweep.half_m[:, 1]))
    last = len(yaw) - 1
    pieces, begin = [], 0
    while begin < last:
        rest_m = float(sweep.way_m[-1] - sweep.way_m[begin])
        length_m = rest_m / math.ceil(rest_m / LONGEST_M)  # equal pieces, none of them a stub
        reach = int(np.searchsorted(sweep.way_m, sweep.way_m[begin] + length_m, side="right"))
        turned = np.abs(yaw[begin:reach] - yaw[begin]) > LARGEST_TURN_RAD
        end = begin + int(np.argmax(turned)) if turned.any() else reach - 1
        end = min(max(end, begin + 1), last)
        pieces.append(slice(begin, end + 1))
        begin = end
    return pieces


def _simplified(side: FloatArray) -> FloatArray:
    """The vertices (k, 3) of a side (n, 3) that are needed, its ends among them."""
    line = shapely.simplify(shapely.LineString(side), TOLERANCE_M, preserve_topology=False)
    return shapely.get_coordinates(line, include_z=True)


def _folded(left: FloatArray, right: FloatArray) -> BaseGeometry:
    """The ground under each step of the line, one end of which goes backwards."""
    steps = shapely.polygons(np.stack([left[:-1], left[1:], right[1:], right[:-1]], axis=1))
    return shapely.union_all(shapely.make_valid(steps))
