"""Polygons of the ground that a line sweeps, and operations on polygons for maps: areal, valid, without slivers."""

import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Final

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from furrowmap.core.coverage.sweep import Sweep
from furrowmap.core.runtime.arrays import FloatArray

TOLERANCE_M: Final = 0.005
"""Sides have as many vertices as chords so near to the path need (Douglas and Peucker's rule): half as far as the best
positions are from the truth."""
MAX_RIBBON_M: Final = 25.0
MAX_RIBBON_TURN_RAD: Final = np.radians(45.0)
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
        sides = [_simplify(side[piece]) for side in (left, right)]
        polygon: BaseGeometry = shapely.Polygon(np.concatenate([sides[0], sides[1][::-1]])[:, :2])
        if not polygon.is_valid:
            # One end of the line goes backwards: the union of the ground under each of its steps.
            a = left[piece, :2]
            b = right[piece, :2]
            steps = shapely.polygons(np.stack([a[:-1], a[1:], b[1:], b[:-1]], axis=1))
            polygon = shapely.union_all(shapely.make_valid(steps))
        found.append(Ribbon(polygon, *sides))
    return found


def _pieces(sweep: Sweep) -> list[slice]:
    """Where a sweep is cut, so that no piece is longer than :data:`MAX_RIBBON_M` or turns by more than 45°."""
    yaw = np.unwrap(np.arctan2(-sweep.half_m[:, 0], sweep.half_m[:, 1]))
    last = len(yaw) - 1
    pieces = []
    begin = 0
    while begin < last:
        rest_m = float(sweep.distance_m[-1] - sweep.distance_m[begin])
        length_m = rest_m / math.ceil(rest_m / MAX_RIBBON_M)  # equal pieces, none of them a stub
        reach = int(np.searchsorted(sweep.distance_m, sweep.distance_m[begin] + length_m, side="right"))
        turned = np.abs(yaw[begin:reach] - yaw[begin]) > MAX_RIBBON_TURN_RAD
        end = begin + int(np.argmax(turned)) if turned.any() else reach - 1
        end = min(max(end, begin + 1), last)
        pieces.append(slice(begin, end + 1))
        begin = end
    return pieces


def _simplify(side: FloatArray) -> FloatArray:
    """A side (n, 3) with few vertices (k, 3), its ends among them, that keeps the ground on either side of it.

    Douglas and Peucker's rule chooses the vertices; a polyline with these vertices is then fitted to the side by least
    squares, its ends held. What it leaves out on one side it adds on the other, where chords would always cut the
    outside of bends.
    """
    line = shapely.simplify(shapely.LineString(side), TOLERANCE_M, preserve_topology=False)
    chosen = np.searchsorted(side[:, 2], shapely.get_coordinates(line, include_z=True)[:, 2])
    vertices = side[chosen]
    if len(chosen) > 2:
        row = np.arange(len(side), dtype=np.float64)
        tents = np.column_stack([np.interp(row, chosen, one) for one in np.eye(len(chosen))])
        held = tents[:, [0, -1]] @ vertices[[0, -1], :2]
        vertices[1:-1, :2] = np.linalg.lstsq(tents[:, 1:-1], side[:, :2] - held, rcond=None)[0]
    return vertices


SLIVER_M: Final = 0.002
"""What is thinner than this on average comes from where vertices lie, not from where the machine went."""

MITRE_LIMIT: Final = 2.0
"""Corners down to 60° stay corners when shapes grow or shrink."""


def grow(shape: BaseGeometry, by_m: float) -> BaseGeometry:
    """The shape made wider (or, below 0, narrower) all round, its corners kept."""
    return shapely.buffer(shape, by_m, join_style="mitre", mitre_limit=MITRE_LIMIT)


def close_gaps(shape: BaseGeometry, width_m: float) -> BaseGeometry:
    """The shape with all gaps filled that are narrower than `width_m`: a morphological closing."""
    return grow(grow(shape, 0.5 * width_m), -0.5 * width_m)


def mean_width_m(polygon: shapely.Polygon) -> float:
    """Area over half the outline: the width of a strip that is much longer than wide."""
    return float(2.0 * polygon.area / polygon.length) if polygon.length else 0.0


def parts(shape: BaseGeometry) -> list[shapely.Polygon]:
    """The polygons of a geometry, from the largest to the smallest, without slivers and without holes that are.

    GEOS' overlays may leave a ring that crosses itself by less than a nanometre; such polygons are made valid.
    """
    found = [
        _without_sliver_holes(part)
        for part in shapely.get_parts(shapely.get_parts(shapely.make_valid(shapely.get_parts(shape))))
        if isinstance(part, shapely.Polygon) and mean_width_m(part) > SLIVER_M
    ]
    return sorted(found, key=lambda part: -part.area)


def areal(shape: BaseGeometry) -> BaseGeometry:
    """The polygons of a geometry, without the lines and points in which shapes touch: GEOS overlays no collections."""
    if shape.geom_type != "GeometryCollection":
        return shape
    return shapely.MultiPolygon([part for part in shapely.get_parts(shape) if isinstance(part, shapely.Polygon)])


def join(shapes: Iterable[BaseGeometry]) -> shapely.MultiPolygon:
    """The union of polygons, without slivers."""
    return shapely.MultiPolygon(parts(shapely.union_all(list(shapes))))


def _without_sliver_holes(polygon: shapely.Polygon) -> shapely.Polygon:
    kept = [ring for ring in polygon.interiors if mean_width_m(shapely.Polygon(ring)) > SLIVER_M]
    return shapely.Polygon(polygon.exterior, kept) if len(kept) < len(polygon.interiors) else polygon
