"""Headland and body of a field, from the turns of the machine."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from itertools import pairwise
from typing import Final

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from furrowmap.core.values.session import Implement
from furrowmap.core.values.trajectory import Trajectory
from furrowmap.core.work.ribbon import Ribbon
from furrowmap.core.work.shapes import areal, close_gaps, parts
from furrowmap.core.work.sweep import Sweep, tool_line

TURN_RAD: Final = np.radians(60.0)
"""Between two passes whose headings differ by less the tool was lifted, but the machine did not turn."""
HEADLAND_REACH_M: Final = 12.0
REACH_WIDTHS: Final = 3.0
"""No turn reaches further from the ends of its passes than the larger of these; what does is a drive elsewhere."""
INSIDE_SHARE: Final = 0.5


def zones(
    trajectory: Trajectory,
    passes: Sequence[Sequence[tuple[Sweep, Sequence[Ribbon]]]],
    implement: Implement,
    boundary: BaseGeometry | None,
) -> list[tuple[str, shapely.Polygon]]:
    """The field's zones, `headland` and `body`, each a list of places that do not overlap.

    The headland is the ground that turns take up, and whatever was worked mostly on it; the body is all other ground
    worked, with the strips left between its passes. Neither reaches over the field's boundary, where that is known.

    Args:
        passes: for each pass, in the order of time, its runs with their ribbons.
    """
    turning = shapely.union_all(list(_turns(trajectory, [runs for runs in passes if runs], implement)))
    pieces = np.array([r.polygon for runs in passes for _, ribbons in runs for r in ribbons], object)
    places = shapely.get_parts(turning)
    piece, place = shapely.STRtree(places).query(pieces, predicate="intersects")
    shared_m2 = shapely.area(shapely.intersection(pieces[piece], places[place]))
    on_turn_m2 = np.bincount(piece, shared_m2, len(pieces))
    on_turns = on_turn_m2 > INSIDE_SHARE * shapely.area(pieces)
    width_m = implement.width_m
    body = close_gaps(shapely.union_all(pieces[~on_turns]), width_m)
    headland = close_gaps(shapely.union_all([turning, *pieces[on_turns]]), width_m).difference(body)
    if boundary is not None:
        body, headland = areal(body.intersection(boundary)), areal(headland.intersection(boundary))
    return [("body", part) for part in parts(body)] + [("headland", part) for part in parts(headland)]


def _turns(
    trajectory: Trajectory, passes: Sequence[Sequence[tuple[Sweep, Sequence[Ribbon]]]], implement: Implement
) -> Iterator[BaseGeometry]:
    """The ground that each turn between two passes takes up: the hull of the tool's line near the passes' ends."""
    reach_m = max(HEADLAND_REACH_M, REACH_WIDTHS * implement.width_m)
    for before, after in pairwise(passes):
        leaving, coming = before[-1][0], after[0][0]
        a, b = leaving.half_m[-1], coming.half_m[0]
        turn = np.arctan2(a[0] * b[1] - a[1] * b[0], a @ b)
        if abs(turn) < TURN_RAD:
            continue
        knots = slice(*np.searchsorted(trajectory.t_s, [leaving.t_s[-1], coming.t_s[0]]).tolist())
        middle, left = (axis[:, :2] for axis in tool_line(trajectory, knots, implement))
        half = 0.5 * implement.width_m * left
        way = np.concatenate([leaving.middle_m[-1:, :2], middle, coming.middle_m[:1, :2]])
        half = np.concatenate([leaving.half_m[-1:], half, coming.half_m[:1]])
        near = [np.hypot(*(way - way[end]).T) <= reach_m for end in (0, -1)]
        if math.dist(way[0], way[-1]) <= 2.0 * reach_m:
            near = [near[0] | near[1]]
        for part in near:
            yield shapely.MultiPoint(np.concatenate([(way + half)[part], (way - half)[part]])).convex_hull
