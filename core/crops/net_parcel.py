"""The net parcel: what is left of the gross one without a strip off each end and each side."""

from __future__ import annotations

from typing import Final

import numpy as np
import shapely
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

_STRAIGHT_M: Final = 1e-3
"""A corner this close to the line between its neighbours is none."""


def net_of(gross: shapely.Polygon, ends_m: float, sides_m: float) -> shapely.Polygon | None:
    """The net parcel; None if nothing, or no single polygon, is left.

    The ends of a parcel with four corners are the two opposite edges that are shorter together, its sides the others.
    Those of any other shape are the edges of its smallest rectangle.

    Args:
        gross: the parcel, in metres.
        ends_m: width of the strip off each end.
        sides_m: width of the strip off each side.
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
        left = inner.intersection(_inside(start, step / reach, float(width), gross))
        if not isinstance(left, shapely.Polygon) or left.is_empty:
            return None
        inner = left
    return inner


def _corners(shape: shapely.Geometry) -> FloatArray | None:
    """The four corners (4, 2) of a convex quadrilateral, counterclockwise; None for any other shape."""
    if not isinstance(shape, shapely.Polygon) or shape.interiors:
        return None
    corners = shapely.get_coordinates(shapely.orient_polygons(shape).simplify(_STRAIGHT_M))[:-1]
    if len(corners) != 4:
        return None
    along = np.roll(corners, -1, axis=0) - corners
    after = np.roll(along, -1, axis=0)
    turns = along[:, 0] * after[:, 1] - along[:, 1] * after[:, 0]
    return corners if (turns > 0.0).all() else None


def _inside(start: FloatArray, direction: FloatArray, width_m: float, gross: shapely.Polygon) -> shapely.Polygon:
    """The half-plane to the left of an edge, moved inwards, as far as the parcel reaches."""
    west, south, east, north = gross.bounds
    far = 4.0 * (east - west + north - south) + 4.0 * width_m
    left = np.array([-direction[1], direction[0]])
    at = start + width_m * left
    return shapely.Polygon(
        [at - far * direction, at + far * direction, at + far * (direction + left), at + far * (left - direction)]
    )
