"""Ground of the field that was not worked: strips missed between passes or along the boundary, and the rest."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import shapely
from shapely.geometry.base import BaseGeometry

from furrowmap.core.work.shapes import areal, close_gaps, grow, parts

MIN_STRIP_WIDTH_M: Final = 0.02
"""Narrower strips are ignored."""
MIN_STRIP_AREA_M2: Final = 0.01
TOUCHES_M: Final = 0.005


def missed_strips(
    coverage: shapely.MultiPolygon, doubtful: BaseGeometry, width_m: float, boundary: BaseGeometry | None
) -> list[tuple[str, shapely.Polygon]]:
    """The strips missed, each with its kind: `between passes`, or `boundary` where the field's boundary is one side.

    A strip is ground not worked that is narrower than the tool, so that no whole pass has room in it: what a closing
    (widening all that is worked, or lies outside the field, by half the tool's width and narrowing it again) adds.
    Wider ground was not missed, it has not been worked yet.

    Args:
        doubtful: ground of which it is not known whether it was worked; no part of it is a miss.
    """
    taken: BaseGeometry = coverage
    if boundary is not None:
        box = shapely.box(*shapely.union(coverage, boundary).bounds).buffer(2.0 * width_m, join_style="mitre")
        taken = coverage.union(box.difference(boundary))
    strips = close_gaps(taken, width_m)
    if boundary is not None:
        strips = areal(strips.intersection(boundary))
    strips = areal(strips.difference(coverage.union(doubtful)))
    wide = grow(grow(strips, -0.5 * MIN_STRIP_WIDTH_M), 0.5 * MIN_STRIP_WIDTH_M).intersection(strips)
    found = []
    for strip in parts(wide):
        at_boundary = boundary is not None and strip.distance(boundary.boundary) < TOUCHES_M
        if strip.area >= MIN_STRIP_AREA_M2:
            found.append(("boundary" if at_boundary else "between passes", strip))
    return found


def unworked_places(
    coverage: shapely.MultiPolygon,
    doubtful: BaseGeometry,
    strips: Sequence[tuple[str, shapely.Polygon]],
    boundary: BaseGeometry | None,
) -> list[tuple[str, shapely.Polygon]]:
    """Ground of the field that was neither worked nor missed, each place with the kind `not worked`, the largest first.

    Args:
        doubtful: ground of which it is not known whether it was worked; no part of it is counted.
        boundary: the field, if known; without it there is no such ground.
    """
    if boundary is None:
        return []
    rest = boundary.difference(shapely.union_all([coverage, doubtful, *(strip for _, strip in strips)]))
    wide = areal(grow(grow(rest, -0.5 * MIN_STRIP_WIDTH_M), 0.5 * MIN_STRIP_WIDTH_M).intersection(rest))
    return [("not worked", place) for place in parts(wide) if place.area >= MIN_STRIP_AREA_M2]
