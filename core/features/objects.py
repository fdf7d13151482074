"""Planes with outlines and lines with heights, joined across the tiles in which they were found."""

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Final, Literal

import numpy as np
import shapely
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from shapely import STRtree

from furrowmap.core.features.breaklines import Breakline
from furrowmap.core.features.lines import DetectedLine, course
from furrowmap.core.features.planes import HORIZONTAL_NORMAL, Plane, axes_of
from furrowmap.core.runtime.arrays import FloatArray
from furrowmap.core.runtime.kernels import kernel

LineKind = Literal["pole", "wire", "fence", "wall", "ditch", "ridge", "edge"]

MIN_PIECE_COSINE: Final = math.cos(math.radians(6.0))
MAX_PIECE_OFFSET_M: Final = 0.1
"""Distance of the middle of each of two pieces of one plane from the plane of the other."""
MAX_PIECE_GAP_M: Final = 0.4
"""Between them."""
MAX_COURSE_GAP_M: Final = 0.6
"""Between two pieces of one line."""
MAX_COURSE_OFFSET_M: Final = 0.2
"""Of one from the course of the other."""
MIN_COURSE_COSINE: Final = math.cos(math.radians(15.0))


@dataclass(frozen=True)
class PlanePiece:
    """A plane, or what one tile sees of it.

    Attributes:
        normal: (3,) unit.
        outline: (shapely polygon or polygons) in :func:`~furrowmap.core.features.planes.axes_of` from the centre.
        rms_m: of the distances from it.
        base_m: height of the ground below.
        is_open: whether it is a fence of wires or mesh rather than filled.
    """

    centre_m: FloatArray
    normal: FloatArray
    outline: shapely.Geometry
    points: int
    rms_m: float
    base_m: float
    is_open: bool = False

    @property
    def vertical(self) -> bool:
        """Whether it is a wall rather than a roof."""
        return bool(abs(self.normal[2]) < HORIZONTAL_NORMAL)

    @property
    def area_m2(self) -> float:
        """In the plane."""
        return float(shapely.area(self.outline))

    @property
    def top_m(self) -> float:
        """Height of its highest point."""
        return float(self._place(shapely.get_coordinates(self.outline))[:, 2].max())

    @property
    def shape(self) -> shapely.Geometry:
        """Its outline on the map, with heights."""
        return shapely.transform(shapely.force_3d(self.outline), lambda c: self._place(c[:, :2]), include_z=True)

    def _place(self, flat: FloatArray) -> FloatArray:
        out: FloatArray = self.centre_m + flat @ np.vstack(axes_of(self.normal))
        return out


@dataclass(frozen=True)
class LineObject:
    """A line.

    Attributes:
        kind: pole (posts and trunks as well), wire (rails as well), fence, wall (foot of a vertical plane); in the
            ground ditch, ridge, edge (of a bank).
        height_m: of a pole, fence or wall from its lowest point to its highest; of a wire above the ground; depth of a
            ditch, height of a ridge; nan for an edge.
        points: number of points, of lines in the ground of cells.
    """

    kind: LineKind
    shape: shapely.Geometry
    height_m: float
    points: int

    @property
    def length_m(self) -> float:
        """In space."""
        return float(np.linalg.norm(np.diff(shapely.get_coordinates(self.shape, include_z=True), axis=0), axis=1).sum())


def outline_plane(
    plane: Plane, voxel_m: FloatArray, count: NDArray[np.int64], side_m: float, base_m: float
) -> PlanePiece:
    """The outline of a plane through its voxels (k, 3) of `count` points each, as cells of a side."""
    flat, _ = plane.flat(voxel_m)
    cell = np.unique(np.floor(flat / side_m).astype(np.int64), axis=0)
    new = np.ones(len(cell), bool)
    new[1:] = (np.diff(cell[:, 0]) != 0) | (np.diff(cell[:, 1]) > 2)
    begin = np.flatnonzero(new)
    end = np.append(begin[1:], len(cell)) - 1
    low = cell[begin] * side_m
    high = (cell[end] + 1) * side_m
    boxes = shapely.box(low[:, 0], low[:, 1], high[:, 0], high[:, 1])
    with np.errstate(divide="ignore", invalid="ignore"):  # GEOS leaves the flags of parallel edges behind
        whole = shapely.union_all(boxes).buffer(side_m, join_style="mitre").buffer(-side_m, join_style="mitre")
    outline = shapely.simplify(whole, 0.75 * side_m)
    outline = outline if not outline.is_empty else whole
    return PlanePiece(plane.centre_m, plane.normal, outline, int(count.sum()), plane.rms_m, base_m)


def join_planes(pieces: Sequence[PlanePiece]) -> list[PlanePiece]:
    """Planes of pieces: those that continue each other are one; the largest first."""
    if not pieces:
        return []
    groups = _group([each.shape for each in pieces], MAX_PIECE_GAP_M, lambda i, j: _is_same_plane(pieces[i], pieces[j]))
    return sorted((_merge_planes([pieces[k] for k in group]) for group in groups), key=lambda plane: -plane.area_m2)


def ground_lines(lines: Iterable[Breakline]) -> list[LineObject]:
    """Breaklines as lines."""
    return [
        LineObject(
            line.kind, shapely.LineString(line.path_m), line.depth_m if line.kind != "edge" else math.nan, line.cells
        )
        for line in lines
    ]


def join_lines(lines: Sequence[LineObject]) -> list[LineObject]:
    """Lines without the borders of tiles: those of a kind that overlap along one course, or continue it, are one."""
    if not lines:
        return []
    groups = _group([line.shape for line in lines], MAX_COURSE_GAP_M, lambda i, j: _is_same_line(lines[i], lines[j]))
    return [_merge_lines([lines[k] for k in group]) for group in groups]


def _group(shapes: Sequence[shapely.Geometry], reach_m: float, same: Callable[[int, int], bool]) -> list[list[int]]:
    """Numbers of shapes in groups: two are in one if `same` says so of them, or of others between them."""
    tree = STRtree([shapely.box(*shapely.bounds(shape)).buffer(reach_m) for shape in shapes])
    a, b = tree.query(tree.geometries)
    pairs = [(i, j) for i, j in zip(a.tolist(), b.tolist(), strict=True) if i < j and same(i, j)]
    first, second = np.array(pairs, np.int64).reshape(-1, 2).T
    graph = coo_array((np.ones(len(first), bool), (first, second)), shape=(len(shapes),) * 2)
    count, label = connected_components(graph, directed=False)
    return [np.flatnonzero(label == number).tolist() for number in range(count)]


def _is_same_line(a: LineObject, b: LineObject) -> bool:
    """Whether two lines run the same way, and one lies on the other, or begins where the other ends."""
    if a.kind != b.kind:
        return False
    one, other = (shapely.get_coordinates(line.shape, include_z=True) for line in (a, b))
    axis, along = (_unit(path[-1] - path[0]) for path in (one, other))
    if abs(float(axis @ along)) < MIN_COURSE_COSINE:
        return False
    s = one @ axis
    t = other @ axis
    gap = max(float(t.min() - s.max()), float(s.min() - t.max()))
    if gap <= 0.0:
        return _over(a, b)
    apart = np.linalg.norm(one[:, None] - other[None, :], axis=2)
    i, j = np.unravel_index(int(np.argmin(apart)), apart.shape)
    away = other[j] - one[i]
    return gap <= MAX_COURSE_GAP_M and float(np.linalg.norm(away - (away @ axis) * axis)) <= MAX_COURSE_OFFSET_M


def _over(a: LineObject, b: LineObject) -> bool:
    """Whether the vertices of the shorter that lie beside the longer lie on it."""
    short, long = sorted((a, b), key=lambda line: line.length_m)
    path = shapely.get_coordinates(long.shape, include_z=True)
    place = shapely.get_coordinates(shapely.segmentize(short.shape, 0.5), include_z=True)
    axis = _unit(path[-1] - path[0])
    s = path @ axis
    at = place @ axis
    beside = (at >= s.min()) & (at <= s.max())
    order = np.argsort(s)
    on = np.column_stack([np.interp(at[beside], s[order], path[order, k]) for k in range(3)])
    return bool(beside.any() and np.median(np.linalg.norm(place[beside] - on, axis=1)) <= MAX_COURSE_OFFSET_M)


def _merge_lines(group: list[LineObject]) -> LineObject:
    """One line through the vertices of all, a parabola at most."""
    if len(group) == 1:
        return group[0]
    places = [shapely.get_coordinates(shapely.segmentize(line.shape, 0.5), include_z=True) for line in group]
    own = np.concatenate(places)
    longest = max(group, key=lambda line: line.length_m)
    ends = shapely.get_coordinates(longest.shape, include_z=True)[[0, -1]]
    s = (own - ends[0]) @ _unit(ends[1] - ends[0])
    path, _ = course(own, s - s.min(), 1.0)
    points = np.array([line.points for line in group])
    height = float(np.average([line.height_m for line in group], weights=points))
    if longest.kind == "pole":
        height = max(line.height_m for line in group)
    return LineObject(longest.kind, shapely.LineString(path), height, int(points.sum()))


def _unit(vector: FloatArray) -> FloatArray:
    out: FloatArray = vector / max(float(np.linalg.norm(vector)), 1e-9)
    return out


def line_objects(lines: Iterable[tuple[DetectedLine, int, float]]) -> list[LineObject]:
    """Poles and wires of lines, each with its number of points and the height of the ground below."""
    out = []
    for line, points, base_m in lines:
        low = line.path_m[:, 2].min()
        high = line.path_m[:, 2].max()
        height = high - min(low, base_m) if line.upright else line.path_m[:, 2].mean() - base_m
        out.append(LineObject("pole" if line.upright else "wire", shapely.LineString(line.path_m), height, points))
    return out


def plane_foot(plane: PlanePiece, kind: LineKind) -> LineObject:
    """The foot of a vertical plane as a line, from end to end at its lowest height."""
    left, low, right, high = shapely.bounds(plane.outline).tolist()
    foot = shapely.LineString(plane._place(np.array([[left, low], [right, low]])))
    return LineObject(kind, foot, float(high - low), plane.points)


def is_rim(line: LineObject, wall: LineObject) -> bool:
    """Whether a wire lies on a wall, as its upper edge does: there is no air below it."""
    if line.kind != "wire" or not shapely.buffer(wall.shape, MAX_COURSE_OFFSET_M).contains(line.shape):
        return False
    foot, heights = (shapely.get_coordinates(each.shape, include_z=True)[:, 2] for each in (wall, line))
    return bool(heights.max() <= foot.min() + wall.height_m + MAX_COURSE_OFFSET_M)


def _is_same_plane(a: PlanePiece, b: PlanePiece) -> bool:
    """Whether two pieces lie in one plane, beside each other."""
    between = b.centre_m - a.centre_m
    if abs(float(a.normal @ b.normal)) < MIN_PIECE_COSINE:
        return False
    if max(abs(float(between @ a.normal)), abs(float(between @ b.normal))) > MAX_PIECE_OFFSET_M:
        return False
    return bool(shapely.distance(a.outline, _in_plane_of(a, b)) <= MAX_PIECE_GAP_M)


def _in_plane_of(a: PlanePiece, b: PlanePiece) -> shapely.Geometry:
    """The outline of `b` in the axes of `a`."""
    axes = np.column_stack(axes_of(a.normal))
    return shapely.transform(b.outline, lambda flat: (b._place(flat) - a.centre_m) @ axes)


def _merge_planes(group: list[PlanePiece]) -> PlanePiece:
    if len(group) == 1:
        return group[0]
    largest = max(group, key=lambda each: each.area_m2)
    weight = np.array([each.points for each in group], np.float64)
    outline = shapely.union_all([_in_plane_of(largest, each) for each in group])
    rms = math.sqrt(float(np.average([each.rms_m**2 for each in group], weights=weight)))
    base = min(each.base_m for each in group)
    is_open = 2.0 * float(weight[[each.is_open for each in group]].sum()) > float(weight.sum())
    return PlanePiece(largest.centre_m, largest.normal, outline, int(weight.sum()), rms, base, is_open)


CROWN_CELL_M: Final = 0.25
MIN_PLANT_HEIGHT_M: Final = 0.3
MIN_CROWN_AREA_M2: Final = 0.1875
"""Three cells."""
SADDLE_M: Final = 0.5
SADDLE_SHARE: Final = 0.25
"""Two tops are two plants where the saddle between them lies this much below the lower one: metres, or this share."""


@dataclass(frozen=True)
class Plants:
    """n plants: place and height (n, 3) of the highest cell, height above the ground, area of the crown from above."""

    top_m: FloatArray
    height_m: FloatArray
    area_m2: FloatArray
    points: NDArray[np.int64]

    def __len__(self) -> int:
        return len(self.height_m)

    @classmethod
    def none(cls) -> "Plants":
        """No plants."""
        return cls(np.zeros((0, 3)), np.zeros(0), np.zeros(0), np.zeros(0, np.int64))


def plants(xyz_m: FloatArray, above_m: FloatArray) -> Plants:
    """Plants in scatter points (n, 3) at heights (n,) above the ground."""
    tall = above_m >= 0.5 * MIN_PLANT_HEIGHT_M
    xyz = xyz_m[tall]
    above = above_m[tall]
    if not len(xyz):
        return Plants.none()
    column = np.floor(xyz[:, :2] / CROWN_CELL_M).astype(np.int64)
    corner = column.min(axis=0) - 1
    shape = column.max(axis=0) - corner + 2
    cell = (column[:, 0] - corner[0]) * shape[1] + column[:, 1] - corner[1]
    height = np.zeros(np.prod(shape))
    np.maximum.at(height, cell, above)
    points = np.bincount(cell, minlength=len(height))
    smooth = np.where(height > 0.0, gaussian_filter(height.reshape(shape), 1.0).ravel(), 0.0)
    order = np.argsort(-smooth, kind="stable")
    order = order[: np.count_nonzero(smooth > 0.0)]
    basin = _basins(smooth, order, int(shape[1]), SADDLE_M, SADDLE_SHARE)
    there, number = np.unique(basin[order], return_inverse=True)
    area = np.bincount(number).astype(np.float64) * CROWN_CELL_M**2
    count = np.bincount(number, points[order]).astype(np.int64)
    tallest = np.zeros(len(there))
    np.maximum.at(tallest, number, height[order])
    kept = (tallest >= MIN_PLANT_HEIGHT_M) & (area >= MIN_CROWN_AREA_M2)
    row, col = np.divmod(there[kept], shape[1])
    place = (np.column_stack([row, col]) + corner + 0.5) * CROWN_CELL_M
    highest = np.full(len(height), -np.inf)
    np.maximum.at(highest, cell, xyz[:, 2])
    top = np.full(len(there), -np.inf)
    np.maximum.at(top, number, highest[order])
    return Plants(np.column_stack([place, top[kept]]), tallest[kept], area[kept], count[kept])


@kernel()
def _basins(height, order, columns, saddle_m, saddle_share):  # type: ignore[no-untyped-def]
    """Cell of the top of the plant of each cell, from the highest cell down; -1 for cells without any."""
    parent = np.full(len(height), -1, np.int64)
    for k in range(len(order)):
        at = order[k]
        best = -1
        parent[at] = at
        for step in (-columns - 1, -columns, -columns + 1, -1, 1, columns - 1, columns, columns + 1):
            beside = at + step
            if beside < 0 or beside >= len(height) or parent[beside] < 0 or beside == at:
                continue
            root = beside
            while parent[root] != root:
                parent[root] = parent[parent[root]]
                root = parent[root]
            if best < 0:
                best = root
                parent[at] = root
            elif root != best:
                lower, higher = (root, best) if height[root] < height[best] else (best, root)
                if height[lower] - height[at] < max(saddle_m, saddle_share * height[lower]):
                    parent[lower] = higher
                    best = higher
    for k in range(len(order)):
        root = order[k]
        while parent[root] != root:
            root = parent[root]
        parent[order[k]] = root
    return parent
