"""How uncertain an area is whose outline a tool drew.

A small error moves the outline; the area changes by the integral of that movement's normal component along it (the
divergence theorem). Every bit of an outline was drawn at a known time, so errors of position and heading enter with
their correlation in time: what moves a whole pass changes no area, what moves two passes against each other changes
their overlap and their union. An outline's flat ends also move with the time at which the tool went down or up.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

import numba
import numpy as np
import shapely
from numpy.typing import NDArray
from shapely.geometry.base import BaseGeometry

from furrowmap.core.runtime.arrays import FloatArray
from furrowmap.core.values.gnss import DRIFT_CORRELATION_S
from furrowmap.core.values.trajectory import SIGMA_NAMES, Trajectory
from furrowmap.core.work.ribbon import Ribbon
from furrowmap.core.work.sweep import Sweep

IntArray = NDArray[np.intp]

HEADING_CORRELATION_S: Final = 3.0
"""Time over which the error of the heading changes, measured on trajectories of the sample recordings."""
STEP_M: Final = 3.0
"""Bits of an outline that move as one."""
MAX_BITS: Final = 1_000_000
"""Of longer outlines than these bits make, the bits are longer."""
TOUCHING_M: Final = 0.01
"""What of an outline lies further from the tool's way was not drawn by it: a boundary, taken as exact."""


class OutlineErrors:
    """The ways that outlines come from, and how wrong they are; errors of the stated width and mounting are not in it.

    Args:
        trajectory: its sigma is that of a Gauss-Markov process of :data:`DRIFT_CORRELATION_S` in position and
            :data:`HEADING_CORRELATION_S` in heading.
        runs: all sweeps, each with its ribbons.
        common_share: share of the variance of the transitions' times that makes every pass longer, or every one
            shorter.
    """

    def __init__(
        self, trajectory: Trajectory, runs: Sequence[tuple[Sweep, Sequence[Ribbon]]], common_share: float = 0.0
    ) -> None:
        self._trajectory = trajectory
        self._common_share = common_share
        sides = [_segments(side, sweep.t_s[0]) for sweep, pieces in runs for r in pieces for side in (r.left, r.right)]
        ends = [end for sweep, _ in runs for end in _ends(sweep)]
        self._slip_m = np.array([slip for sweep, _ in runs for slip in (sweep.begin_slip_m, sweep.end_slip_m)])
        self._outward = np.array([_outward(sweep, k) for sweep, _ in runs for k in (0, -1)]).reshape(-1, 2)
        segments = np.concatenate([np.empty((0, 2, 3)), *sides, *ends])
        self._begin_s, self._end_s = segments[:, 0, 2], segments[:, 1, 2]
        self._end = np.concatenate([np.full(len(segments) - len(ends), -1), np.arange(len(ends))])
        self._lines = np.asarray(shapely.linestrings(segments[:, :, :2]), object)
        self._tree = shapely.STRtree(self._lines)

    def sigma_m2(self, shapes: Sequence[BaseGeometry]) -> FloatArray:
        """Standard deviation (n,) of the area of each of `shapes`; nan where a sigma that it needs is unknown.

        What several parts of one shape have in common is taken into account.
        """
        shape, place, normal = _outlines(shapes)
        points = np.asarray(shapely.points(place), object)
        found, source = self._sources(points)
        shape, place, normal = shape[found], place[found], normal[found]
        line = self._lines[source]
        share = shapely.line_locate_point(line, points[found], normalized=True)
        t = self._begin_s[source] + share * (self._end_s[source] - self._begin_s[source])
        variance = np.zeros(len(shapes))
        order = np.lexsort((t, shape))
        for effect, correlation_s in self._effects(t, place, normal):
            _add_correlated(shape[order], t[order], effect[order], correlation_s, variance)
        self._add_transitions(shape, self._end[source], normal, variance)
        return np.sqrt(np.maximum(variance, 0.0))

    def _sources(self, points: NDArray[np.object_]) -> tuple[IntArray, IntArray]:
        """(which of `points`, index of the nearest line), for those that lie on a line."""
        point, line = self._tree.query(points, predicate="dwithin", distance=TOUCHING_M)
        order = np.lexsort((shapely.distance(points[point], self._lines[line]), point))
        point, line = point[order], line[order]
        nearest = np.diff(point, prepend=-1) > 0
        return point[nearest], line[nearest]

    def _effects(self, t_s: FloatArray, place: FloatArray, normal: FloatArray) -> list[tuple[FloatArray, float]]:
        """What one standard deviation of easting, of northing and of heading at `t_s` adds to an area, each (n,)."""
        knots, sigma = self._trajectory.t_s, self._trajectory.sigma
        e, n, heading = (
            np.interp(t_s, knots, sigma[:, SIGMA_NAMES.index(name)]) for name in ("e_m", "n_m", "heading_deg")
        )
        lever = place - np.column_stack([np.interp(t_s, knots, self._trajectory.xyz_m[:, k]) for k in range(2)])
        turned = normal[:, 0] * lever[:, 1] - normal[:, 1] * lever[:, 0]
        return [
            (e * normal[:, 0], DRIFT_CORRELATION_S),
            (n * normal[:, 1], DRIFT_CORRELATION_S),
            (np.radians(heading) * turned, HEADING_CORRELATION_S),
        ]

    def _add_transitions(self, shape: IntArray, end: IntArray, normal: FloatArray, variance: FloatArray) -> None:
        """Add the variance from the times of the tool's transitions: each by itself, and what they have in common."""
        at_end = end >= 0
        shape, end, normal = shape[at_end], end[at_end], normal[at_end]
        moved = np.einsum("ij,ij->i", normal, self._outward[end])
        keys, which = np.unique(np.column_stack([shape, end]), axis=0, return_inverse=True)
        added = np.bincount(which.ravel(), weights=moved, minlength=len(keys)) * self._slip_m[keys[:, 1]]
        together = np.bincount(keys[:, 0], weights=added, minlength=len(variance))
        np.add.at(variance, keys[:, 0], (1.0 - self._common_share) * added**2)
        variance += self._common_share * together**2


def _segments(side: FloatArray, t0_s: float) -> FloatArray:
    """(n − 1, 2, 3) the lines between the vertices of a ribbon's side, with UTC."""
    side = side + np.array([0.0, 0.0, t0_s])
    return np.stack([side[:-1], side[1:]], axis=1)


def _ends(sweep: Sweep) -> list[FloatArray]:
    """(1, 2, 3) the tool's line at the beginning and the end of a sweep."""
    ends = []
    for k in (0, -1):
        middle, half, t = sweep.middle_m[k, :2], sweep.half_m[k], sweep.t_s[k]
        ends.append(np.array([[[*(middle + half), t], [*(middle - half), t]]]))
    return ends


def _outward(sweep: Sweep, k: int) -> FloatArray:
    """The unit vector at right angles to the tool's line, away from the sweep: backward at its beginning (0)."""
    x, y = sweep.half_m[k].tolist()
    return np.array([y, -x]) / math.copysign(math.hypot(x, y), -1.0 if k == 0 else 1.0)


def _outlines(shapes: Sequence[BaseGeometry]) -> tuple[IntArray, FloatArray, FloatArray]:
    """Bits of the outlines: (n,) which shape, (n, 2) middle, (n, 2) normal times length, outward."""
    pieces, shape = shapely.get_parts(np.asarray(shapes, object), return_index=True)
    step_m = max(STEP_M, float(shapely.length(pieces).sum()) / MAX_BITS)
    rings, piece = shapely.get_rings(shapely.segmentize(pieces, step_m), return_index=True)
    xy, ring = shapely.get_coordinates(rings, return_index=True)
    same = ring[1:] == ring[:-1]
    begin, step, ring = xy[:-1][same], np.diff(xy, axis=0)[same], ring[1:][same]
    middle = begin + 0.5 * step
    away = begin - begin[np.searchsorted(ring, ring)]
    twice = np.bincount(ring, weights=away[:, 0] * step[:, 1] - away[:, 1] * step[:, 0], minlength=len(rings))
    hole = np.diff(piece, prepend=-1) == 0
    sign = np.where(twice > 0, 1.0, -1.0) * np.where(hole, -1.0, 1.0)
    normal = sign[ring][:, None] * np.column_stack([step[:, 1], -step[:, 0]])
    return shape[piece[ring]], middle, normal


@numba.njit(cache=True, nogil=True)
def _add_correlated(shape, t_s, effect, correlation_s, variance):  # type: ignore[no-untyped-def]
    """Add Σᵢⱼ effectᵢ effectⱼ exp(−|tᵢ − tⱼ| / correlation) of each shape; sorted by shape, then time."""
    carried = 0.0
    for i in range(len(t_s)):
        if i > 0 and shape[i] == shape[i - 1]:
            carried = (carried + effect[i - 1]) * np.exp(-(t_s[i] - t_s[i - 1]) / correlation_s)
        else:
            carried = 0.0
        variance[shape[i]] += effect[i] * (effect[i] + 2.0 * carried)
