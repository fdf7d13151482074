"""Polygons fit for a map: areal, valid, without slivers."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Final

import numpy as np
import shapely

SLIVER_M: Final = 0.002
"""What is thinner than this on average comes from where vertices lie, not from where the machine went."""


def mean_width_m(polygon: shapely.Polygon) -> float:
    """Area over half the outline: the width of a strip that is much longer than wide."""
    return float(2.0 * polygon.area / polygon.length) if polygon.length else 0.0


def parts(shape: shapely.Geometry) -> list[shapely.Polygon]:
    """The polygons of a geometry, from the largest to the smallest, without slivers and without holes that are."""
    found = [
        _without_sliver_holes(part)
        for part in shapely.get_parts(shape)
        if isinstance(part, shapely.Polygon) and mean_width_m(part) > SLIVER_M
    ]
    return sorted(found, key=lambda part: -part.area)


def joined(shapes: Iterable[shapely.Geometry]) -> shapely.MultiPolygon:
    """The union of polygons, without slivers."""
    return shapely.MultiPolygon(parts(shapely.union_all(list(shapes))))


def _without_sliver_holes(polygon: shapely.Polygon) -> shapely.Polygon:
    kept = [ring for ring in polygon.interiors if mean_width_m(shapely.Polygon(ring)) > SLIVER_M]
    return shapely.Polygon(polygon.exterior, kept) if len(kept) < len(polygon.interiors) else polygon
