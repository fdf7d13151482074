"""How often the wheels of a vehicle rolled over each spot."""

from itertools import pairwise
from typing import Final

import numpy as np
from numpy.typing import NDArray

from furrowmap.core.runtime.arrays import FloatArray
from furrowmap.core.runtime.kernels import kernel
from furrowmap.core.surfaces.grid import Grid

AGAIN_M: Final = 2.0
"""A wheel that comes back to a spot within so much driving, as where it stands or turns about, passes it once."""

MIN_TRACK_STEP_M: Final = 0.1
"""Shorter steps show no direction: positions of a standing vehicle tremble."""


def wheel_passages(
    grid: Grid, paths_m: list[FloatArray], track_width_m: float, tyre_width_m: float
) -> NDArray[np.uint16]:
    """Passages of the two wheels of an axle over the cells of a grid.

    The wheels roll along the path of the middle of the axle, at half the track width on either side of it. A cell is
    passed where its centre is below the tyre, and again once the wheel has driven on by :data:`AGAIN_M` before it
    returns. `paths_m` (n, 3) are easting and northing of the middle of the axle and the distance driven, at least two
    places each; the track width is between the middles of the tyres. Returns (rows, columns) the number of passages of
    both wheels.
    """
    counts = np.zeros(grid.shape, np.uint16)
    last = np.full(grid.shape, -np.inf)
    west, _, _, north = grid.bounds_m
    sides = 0.5 * np.array([[track_width_m + tyre_width_m, track_width_m - tyre_width_m]])
    offsets = np.concatenate([sides, -sides[:, ::-1]])  # left and right edge of the left wheel, then of the right one
    for path in paths_m:
        for piece in _smooth_pieces(path - (west, north, 0.0)):
            steps = np.diff(piece[:, :2], axis=0)
            along = steps / np.hypot(*steps.T)[:, np.newaxis]
            before = np.concatenate([along[:1], along])
            after = np.concatenate([along, along[-1:]])
            middle = before + after
            length = np.hypot(*middle.T)
            # The bisector, longer by 1 / cos of half the turn; length = 2 cos of half the turn.
            middle *= (2.0 / length**2)[:, np.newaxis]
            across = np.column_stack([-middle[:, 1], middle[:, 0]])
            edges = piece[:, :2] + offsets[:, :, np.newaxis, np.newaxis] * across
            _roll(counts, last, edges, np.ascontiguousarray(piece[:, 2]), grid.cell_m, AGAIN_M)
    return counts


def _smooth_pieces(path: FloatArray) -> list[FloatArray]:
    """A path without small steps, cut where it turns by more than a right angle, as where the vehicle reverses."""
    path = path[_apart(path[:, 0].copy(), path[:, 1].copy(), MIN_TRACK_STEP_M)]
    steps = np.diff(path[:, :2], axis=0)
    cusps = 1 + np.flatnonzero((steps[1:] * steps[:-1]).sum(axis=1) < 0.0)
    ends = [0, *cusps.tolist(), len(path) - 1]
    return [path[a : b + 1] for a, b in pairwise(ends) if b > a]


@kernel()
def _apart(x, y, step):  # type: ignore[no-untyped-def]
    """The places (n,) that are so far from the one kept before."""
    kept = np.zeros(len(x), np.bool_)
    kept[0] = True
    k = 0
    for i in range(1, len(x)):
        if (x[i] - x[k]) ** 2 + (y[i] - y[k]) ** 2 >= step * step:
            kept[i] = True
            k = i
    return kept


@kernel()
def _roll(counts, last, edges, distance, cell, again):  # type: ignore[no-untyped-def]
    """Count the cells below strips between edges (wheels, 2, n, 2), in metres from the grid's north-west corner.

    The wheels of an axle share the distance at which a cell was passed last: when the vehicle reverses, what was to the
    left of its way is to the right.
    """
    rows, columns = counts.shape
    for i in range(len(distance) - 1):
        for wheel in range(len(edges)):
            ax, ay = edges[wheel, 0, i]
            bx, by = edges[wheel, 0, i + 1]
            cx, cy = edges[wheel, 1, i + 1]
            dx, dy = edges[wheel, 1, i]
            ux = 0.5 * (bx + cx - ax - dx)
            uy = 0.5 * (by + cy - ay - dy)
            first_column = max(0, int(np.floor(min(ax, bx, cx, dx) / cell)))
            last_column = min(columns - 1, int(np.floor(max(ax, bx, cx, dx) / cell)))
            first_row = max(0, int(np.floor(-max(ay, by, cy, dy) / cell)))
            last_row = min(rows - 1, int(np.floor(-min(ay, by, cy, dy) / cell)))
            for row in range(first_row, last_row + 1):
                y = -(row + 0.5) * cell
                for column in range(first_column, last_column + 1):
                    x = (column + 0.5) * cell
                    ab = (bx - ax) * (y - ay) - (by - ay) * (x - ax)
                    bc = (cx - bx) * (y - by) - (cy - by) * (x - bx)
                    ca = (ax - cx) * (y - cy) - (ay - cy) * (x - cx)
                    inside = (ab >= 0 and bc >= 0 and ca >= 0) or (ab <= 0 and bc <= 0 and ca <= 0)
                    if not inside:
                        cd = (dx - cx) * (y - cy) - (dy - cy) * (x - cx)
                        da = (ax - dx) * (y - dy) - (ay - dy) * (x - dx)
                        inside = (-ca >= 0 and cd >= 0 and da >= 0) or (-ca <= 0 and cd <= 0 and da <= 0)
                    if inside:
                        ahead = ((x - 0.5 * (ax + dx)) * ux + (y - 0.5 * (ay + dy)) * uy) / (ux * ux + uy * uy)
                        at = distance[i] + min(max(ahead, 0.0), 1.0) * (distance[i + 1] - distance[i])
                        if at - last[row, column] > again and counts[row, column] < 65535:
                            counts[row, column] += 1
                        last[row, column] = at
