"""Ground worked twice."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence

import numpy as np
import shapely

from furrowmap.core.work.ribbon import Ribbon
from furrowmap.core.work.shapes import parts


def overlapping(runs: Sequence[tuple[int, Sequence[Ribbon]]]) -> dict[tuple[int, int], list[shapely.Polygon]]:
    """For each pair of passes the places that both worked, a polygon a place; the earlier pass stands first.

    A pass that comes back to its own ground overlaps itself. Ribbons that follow each other in one run do not: where
    they touch, the tool turned.

    Args:
        runs: number of the pass and ribbons of each run, in the order of time.
    """
    pieces = np.array([r.polygon for _, ribbons in runs for r in ribbons], object)
    number = np.array([number for number, ribbons in runs for _ in ribbons], np.intp)
    run = np.repeat(np.arange(len(runs)), [len(ribbons) for _, ribbons in runs])
    first, second = shapely.STRtree(pieces).query(pieces, predicate="intersects")
    distinct = (first < second) & ~((run[first] == run[second]) & (second == first + 1))
    first, second = first[distinct], second[distinct]
    shared = defaultdict(list)
    for a, b, piece in zip(
        number[first].tolist(),
        number[second].tolist(),
        shapely.intersection(pieces[first], pieces[second]),
        strict=True,
    ):
        if piece.area > 0.0:
            shared[a, b].append(piece)
    found = {pair: parts(shapely.union_all(shapely.make_valid(places))) for pair, places in sorted(shared.items())}
    return {pair: places for pair, places in found.items() if places}
