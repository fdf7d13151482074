"""Breaklines of the ground: ditches, and the upper and lower edges of banks, where its curvature is greatest.

The curvature is the eigenvalue of the Hessian of the smoothed ground that is greatest in magnitude; a line runs where
that is a maximum across it. After C. Steger (1998), An unbiased detector of curvilinear structures, IEEE Transactions
on Pattern Analysis and Machine Intelligence 20, 113-125, and, for terrain, M. Rutzinger, B. Höfle, M. Vetter,
N. Pfeifer (2011), Digital terrain models from airborne laser scanning for the automatic extraction of natural and
anthropogenic linear structures, Developments in Earth Surface Processes 15, 475-488.
"""

from dataclasses import dataclass
from typing import Any, Final, Literal

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import binary_dilation, gaussian_filter, map_coordinates
from scipy.sparse import coo_array
from scipy.sparse.csgraph import breadth_first_order, connected_components, dijkstra, minimum_spanning_tree
from scipy.spatial import cKDTree

from furrowmap.core.features.ground_surface import cells_of, medians
from furrowmap.core.runtime.arrays import FloatArray, IntArray
from furrowmap.core.surfaces.gaps import filled
from furrowmap.core.values.extents import bounds

BreakKind = Literal["ditch", "ridge", "edge"]

BREAK_CELL_M: Final = 0.25
SMOOTH_CELLS: Final = 1.6
"""Deviation of the smoothing: furrows of a metre and less vanish."""
CUT_DEVIATIONS: Final = 6.0
"""Where the Gaussian ends: cut at four, the sum of its second derivative takes 100 m of height for a curvature."""
DEPTH_CELLS: Final = 0.7
"""The same for depths, which smoothing makes less."""
MIN_CURVATURE: Final = 0.25
"""In 1/m: undulations of 0.1 m over 5 m have less."""
ACROSS_M: Final = (0.5, 1.0, 1.5, 2.0)
"""Distances from a ditch at which its banks are measured."""
MIN_DITCH_DEPTH_M: Final = 0.15
"""Of both banks above a ditch."""
MAX_LINK_M: Final = 0.8
MIN_BREAK_LENGTH_M: Final = 3.0
MIN_BREAK_CELLS: Final = 36


@dataclass(frozen=True)
class BreakPoints:
    """Points of breaklines: one a cell.

    Attributes:
        xyz_m: (n, 3) in the ground.
        concave: (n,) whether the ground turns up there, as in a ditch or at the foot of a bank.
        depth_m: (n,) least height of both sides above it, or, where it is not concave, of it above both sides; 0 where
            one side falls and the other rises.
    """

    xyz_m: FloatArray
    concave: NDArray[np.bool_]
    depth_m: FloatArray

    def __len__(self) -> int:
        return len(self.concave)

    def where(self, kept: NDArray[np.bool_]) -> "BreakPoints":
        """Some of them."""
        return BreakPoints(self.xyz_m[kept], self.concave[kept], self.depth_m[kept])

    @classmethod
    def joined(cls, parts: "list[BreakPoints]") -> "BreakPoints":
        """Those of all parts."""
        every = [cls(np.zeros((0, 3)), np.zeros(0, bool), np.zeros(0)), *parts]
        return cls(*(np.concatenate([getattr(part, name) for part in every]) for name in vars(every[0])))


@dataclass(frozen=True)
class Breakline:
    """A "ditch" between rising sides, a "ridge", or an "edge" of a bank: course (k, 3), median depth or height."""

    kind: BreakKind
    path_m: FloatArray
    depth_m: float
    cells: int


def break_points(xyz_m: FloatArray) -> BreakPoints:
    """Points of breaklines of the ground points (n, 3) of one tile, in cells of :data:`BREAK_CELL_M`."""
    nothing = BreakPoints.joined([])
    if not len(xyz_m):
        return nothing
    corner, last = (np.floor(end[:2] / BREAK_CELL_M) for end in bounds(xyz_m))
    shape = (last - corner).astype(np.int64) + 1
    height = medians(cells_of(xyz_m, corner, BREAK_CELL_M, int(shape[1])), xyz_m[:, 2], shape)
    known = np.isfinite(height)
    if np.count_nonzero(known) < MIN_BREAK_CELLS or shape.min() < 3:
        return nothing
    rough = filled(height)
    ground = gaussian_filter(rough, DEPTH_CELLS, mode="nearest")
    xx, xy, yy = (
        gaussian_filter(rough, SMOOTH_CELLS, order, mode="nearest", truncate=CUT_DEVIATIONS) / BREAK_CELL_M**2
        for order in ((2, 0), (1, 1), (0, 2))
    )
    # the eigenvalue of greatest magnitude, and its unit vector
    mean = 0.5 * (xx + yy)
    half = np.hypot(0.5 * (xx - yy), xy)
    curvature = np.where(mean >= 0.0, mean + half, mean - half)
    angle = 0.5 * np.arctan2(2.0 * xy, xx - yy) + np.where(mean >= 0.0, 0.0, 0.5 * np.pi)
    across = np.array([np.cos(angle), np.sin(angle)])
    column, row = np.nonzero(binary_dilation(known) & (np.abs(curvature) >= MIN_CURVATURE))
    at = np.array([column, row])
    way = across[:, column, row]
    own = curvature[column, row]
    beside = [map_coordinates(curvature, at + sign * way, order=1, mode="nearest") for sign in (-1.0, 1.0)]
    top = (np.sign(own) * beside[0] <= np.abs(own)) & (np.sign(own) * beside[1] < np.abs(own))
    at = at[:, top]
    way = way[:, top]
    own = own[top]
    level = ground[tuple(at)]
    rise = np.zeros((2, len(own)))
    if len(own):
        for side, sign in enumerate((-1.0, 1.0)):
            places = [at + sign * d / BREAK_CELL_M * way for d in ACROSS_M]
            banks = [map_coordinates(ground, place, order=1, mode="nearest") for place in places]
            rise[side] = np.max([np.sign(own) * (bank - level) for bank in banks], axis=0)
    place = (at.T + corner + 0.5) * BREAK_CELL_M
    return BreakPoints(np.column_stack([place, level]), own > 0.0, np.maximum(rise.min(axis=0), 0.0))


def breaklines(points: BreakPoints) -> list[Breakline]:
    """Lines of points that are near each other, of one kind each."""
    deep = points.depth_m >= MIN_DITCH_DEPTH_M
    return [
        *_link_points(points.where(points.concave & deep), "ditch"),
        *_link_points(points.where(~points.concave & deep), "ridge"),
        *_link_points(points.where(points.concave & ~deep), "edge"),
        *_link_points(points.where(~points.concave & ~deep), "edge"),
    ]


def _link_points(points: BreakPoints, kind: BreakKind) -> list[Breakline]:
    if len(points) < 2:
        return []
    flat = points.xyz_m[:, :2]
    pairs = cKDTree(flat).query_pairs(MAX_LINK_M, output_type="ndarray")
    if not len(pairs):
        return []
    apart = np.linalg.norm(flat[pairs[:, 0]] - flat[pairs[:, 1]], axis=1)
    tree: Any = minimum_spanning_tree(coo_array((apart, (pairs[:, 0], pairs[:, 1])), shape=(len(flat),) * 2).tocsr())
    _, label = connected_components(tree, directed=False)
    out = []
    for number in np.flatnonzero(np.bincount(label) * BREAK_CELL_M >= 0.5 * MIN_BREAK_LENGTH_M).tolist():
        members = np.flatnonzero(label == number)
        path = members[_longest_path(tree[members][:, members])]
        # as a point a metre: means of its neighbours
        smooth = gaussian_filter(points.xyz_m[path], (2.0, 0.0), mode="nearest")
        smooth[[0, -1]] = points.xyz_m[path][[0, -1]]
        step = max(1, round(1.0 / BREAK_CELL_M))
        xyz = smooth[np.unique(np.append(np.arange(0, len(smooth), step), len(smooth) - 1))]
        if np.linalg.norm(np.diff(xyz[:, :2], axis=0), axis=1).sum() >= MIN_BREAK_LENGTH_M:
            depth = float(np.median(points.depth_m[path])) if kind != "edge" else 0.0
            out.append(Breakline(kind, xyz, depth, len(members)))
    return out


def _longest_path(tree: Any) -> IntArray:
    """The longest path in a tree: from the node farthest from any to that farthest from it."""
    first = last = 0
    for _ in range(2):
        first = last
        last = int(np.argmax(dijkstra(tree, directed=False, indices=np.array([last]))))
    _, before = breadth_first_order(tree, first, directed=False)
    path = [last]
    while path[-1] != first:
        path.append(int(before[path[-1]]))
    return np.array(path, np.int64)
