"""Polygons fit for a map: areal, valid, without slivers."""

from collections.abc import Iterable
from typing import Final

import shapely
from shapely.geometry.base import BaseGeometry

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
