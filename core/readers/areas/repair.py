"""Polygons of anybody made usable: without repeated rings, with as many corners as matter, and not crossing themselves.

GEOS compares pairs of edges. A file of a megabyte can hold so many that it takes hours and all memory, so they are
counted first.
"""

from collections.abc import Sequence
from typing import Any, Final

import numpy as np
import shapely
from numpy.typing import NDArray
from pyproj import CRS
from shapely.geometry.base import BaseGeometry

from furrowmap.core.runtime.arrays import FloatArray
from furrowmap.core.runtime.kernels import kernel

FINEST_M: Final = 1e-3
"""Details below this are left out of polygons with many corners."""
_FINEST_DEG: Final = 1e-8
MANY_CORNERS: Final = 10_000
"""Polygons with fewer keep all of them."""
_FEW_EDGES: Final = 400
"""So few edges are compared at once, whatever their place."""
_CHUNK: Final = 2048
MAX_CROSSINGS: Final = 20_000
MAX_NEAR_PAIRS: Final = 50_000_000
"""Pairs of edges whose boxes overlap: some seconds of GEOS for each operation."""
_MAX_COMPARED: Final = 500_000_000


def workable(shapes: Sequence[BaseGeometry], crs: CRS | None) -> NDArray[Any]:
    """Polygons and multipolygons (n,) as GEOS can work with them; those with few corners are unchanged.

    Without a CRS, and in a geographic one, the coordinates are longitudes and latitudes: polygons across the
    antimeridian, cut there (RFC 7946, 3.1.9) or not, become whole and reach beyond 180° on one side.

    Raises:
        ValueError: if their edges cross, or come close to, each other too often.
    """
    found = np.array([*shapes, None], object)[:-1]
    if crs is None or crs.is_geographic:
        finest = _FINEST_DEG
        found = whole_in_degrees(found)
    else:
        finest = FINEST_M / crs.axis_info[0].unit_conversion_factor
    for k in np.flatnonzero(shapely.get_num_coordinates(found) > _FEW_EDGES):
        found[k] = _without_repeated_rings(found[k])
        if shapely.get_num_coordinates(found[k]) > MANY_CORNERS:
            found[k] = _thinned(found[k], finest)
    expect_few_crossings(found)
    return found


def whole_in_degrees(shapes: NDArray[Any]) -> NDArray[Any]:
    """Polygons (n,) in longitude and latitude that cross the antimeridian, cut there or not, as whole ones.

    They reach beyond 180° on one side; others are unchanged.

    Raises:
        ValueError: as :func:`workable`.
    """
    xy, of = shapely.get_coordinates(shapes, return_index=True)
    if not len(xy) or not np.isfinite(xy).all() or np.ptp(xy[:, 0]) <= 180.0:
        return shapes
    first = xy[np.searchsorted(of, of), 0]
    turns = np.round((xy[:, 0] - first) / 360.0)
    found = shapely.set_coordinates(shapes.copy(), np.column_stack([xy[:, 0] - 360.0 * turns, xy[:, 1]]))
    crossing = np.unique(of[turns != 0.0])
    expect_few_crossings(found[crossing])
    for k in crossing:
        parts = [made_valid(part) for part in shapely.get_parts(found[k])]
        found[k] = parts[0] if len(parts) == 1 else shapely.union_all(parts)
    return found


def repaired(shape: BaseGeometry) -> BaseGeometry:
    """A valid polygon or multipolygon: the ground within the outer rings and outside the holes.

    Raises:
        ValueError: as :func:`workable`.
    """
    (shape,) = workable([shape], None)
    return made_valid(shape)


def made_valid(shape: BaseGeometry) -> BaseGeometry:
    """As :func:`repaired`, of what is workable."""
    # Of rings that cross themselves, GEOS's other method takes a hundred times as long, and all memory for equal holes.
    return shape if shape.is_valid else shapely.make_valid(shape, method="structure", keep_collapsed=False)


def expect_few_crossings(shapes: NDArray[Any]) -> None:
    """Raises ValueError where the edges of geometries (n,) cross, or come close to, each other too often."""
    rings = shapely.get_rings(shapes)
    xy, ring = shapely.get_coordinates(rings, return_index=True)
    same = np.flatnonzero(ring[1:] == ring[:-1])
    if len(same) <= _FEW_EDGES:
        return
    begin = xy[same]
    end = xy[same + 1]
    low = np.minimum(begin, end)
    high = np.maximum(begin, end)
    reach = (high - low).sum(axis=0) / np.maximum(high.max(axis=0) - low.min(axis=0), 1e-300)
    axis = int(np.argmin(reach))  # along which fewer edges overlap
    order = np.argsort(low[:, axis], kind="stable")
    edges = np.column_stack([begin, end])[order][:, [axis, 1 - axis, 2 + axis, 3 - axis]]
    compared, near, crossing = _count_pairs(np.ascontiguousarray(edges), _MAX_COMPARED, MAX_NEAR_PAIRS, MAX_CROSSINGS)
    if crossing > MAX_CROSSINGS:
        raise ValueError(f"its {len(edges):,} edges cross each other more than {MAX_CROSSINGS:,} times")
    if near > MAX_NEAR_PAIRS or compared > _MAX_COMPARED:
        raise ValueError(f"its {len(edges):,} edges lie so close together that comparing them would take hours")


@kernel()
def _count_pairs(edges, most_compared, most_near, most_crossing):  # type: ignore[no-untyped-def]
    """Pairs of edges (n, 4: begin and end, sorted by their least first coordinate) compared, near, and crossing.

    Counting ends where a number is beyond its limit.
    """
    compared = 0
    near = 0
    crossing = 0
    n = len(edges)
    for i in range(n):
        ax = edges[i, 0]
        ay = edges[i, 1]
        bx = edges[i, 2]
        by = edges[i, 3]
        right = max(ax, bx)
        low = min(ay, by)
        high = max(ay, by)
        for j in range(i + 1, n):
            cx = edges[j, 0]
            dx = edges[j, 2]
            if min(cx, dx) > right:
                break
            compared += 1
            cy = edges[j, 1]
            dy = edges[j, 3]
            if max(cy, dy) < low or min(cy, dy) > high:
                continue
            near += 1
            c = (bx - ax) * (cy - ay) - (by - ay) * (cx - ax)
            d = (bx - ax) * (dy - ay) - (by - ay) * (dx - ax)
            a = (dx - cx) * (ay - cy) - (dy - cy) * (ax - cx)
            b = (dx - cx) * (by - cy) - (dy - cy) * (bx - cx)
            if (c > 0.0) != (d > 0.0) and (a > 0.0) != (b > 0.0) and c != 0.0 and d != 0.0:
                crossing += 1
        if compared > most_compared or near > most_near or crossing > most_crossing:
            break
    return compared, near, crossing


def _without_repeated_rings(shape: BaseGeometry) -> BaseGeometry:
    """The polygons without equal holes, and of equal polygons one."""
    parts = [shapely.Polygon(part.exterior, _once(part.interiors)) for part in shapely.get_parts(shape).tolist()]
    once = _once(parts)
    return once[0] if len(once) == 1 else shapely.MultiPolygon(once)


def _once(shapes: Sequence[BaseGeometry]) -> list[Any]:
    if len(shapes) < 2:
        return [*shapes]
    alike = shapely.to_wkb(shapely.normalize(np.array([*shapes, None], object)[:-1]))
    return list(dict(zip(alike.tolist(), shapes, strict=True)).values())


def _thinned(shape: BaseGeometry, finest: float) -> BaseGeometry:
    """A polygon whose corners lie within a tolerance of the given one; the given one where it would become invalid."""
    parts = []
    for part in shapely.get_parts(shape).tolist():
        rings = (part.exterior, *part.interiors)
        shell, *holes = [_thinned_ring(shapely.get_coordinates(ring), finest) for ring in rings]
        if len(shell) >= 4:
            parts.append(shapely.Polygon(shell, [hole for hole in holes if len(hole) >= 4]))
    thin = parts[0] if len(parts) == 1 else shapely.MultiPolygon(parts)
    try:
        expect_few_crossings(np.array([thin, None], object)[:1])
    except ValueError:
        return thin  # refused as a whole
    if thin.is_valid:
        return thin
    try:
        expect_few_crossings(np.array([shape, None], object)[:1])
    except ValueError:
        return thin
    return shape if shape.is_valid else thin


def _thinned_ring(xy: FloatArray, finest: float) -> FloatArray:
    """A closed ring (n, 2), thinned chunk by chunk: of a whole ring, Douglas and Peucker may take the square of n."""
    line = shapely.get_coordinates(shapely.remove_repeated_points(shapely.LineString(xy), finest))
    starts = range(0, max(len(line) - 1, 1), _CHUNK)
    chunks = np.array([shapely.LineString(line[k : k + _CHUNK + 1]) for k in starts] + [None], object)[:-1]
    thin = shapely.get_coordinates(shapely.simplify(chunks, 0.5 * finest, preserve_topology=False))
    kept = np.concatenate([[True], (np.diff(thin, axis=0) != 0.0).any(axis=1)])
    closed: FloatArray = thin[kept]
    return closed
