"""Classification of the points of one tile by the shape around them, refined by the votes of segments of colour."""

import math
from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from furrowmap.core.features.classes import Feature
from furrowmap.core.features.eigenfeatures import neighbourhoods
from furrowmap.core.features.ground_surface import heights_above_ground
from furrowmap.core.features.lines import MAX_TURN_DEG, MIN_LINEARITY, DetectedLine, find_lines
from furrowmap.core.features.neighbours import first_above, sort_into_columns
from furrowmap.core.features.planes import HORIZONTAL_NORMAL, MIN_PLANE_PURITY, Plane, axes_of, find_planes
from furrowmap.core.runtime.arrays import BoolArray, FloatArray, IntArray
from furrowmap.core.runtime.kernels import kernel
from furrowmap.core.values.extents import bounds


@dataclass(frozen=True)
class Voxels:
    """Points by voxel: the voxel of each point (n,), and the mean (m, 3) and number (m,) of each voxel's points."""

    of_point: IntArray
    mean_m: FloatArray
    count: IntArray

    def __len__(self) -> int:
        return len(self.mean_m)

    def mean_of(self, values: NDArray[Any]) -> FloatArray:
        """Mean (m,) of values (n,) of points in each voxel."""
        out: FloatArray = np.bincount(self.of_point, values, len(self)) / self.count
        return out


def voxels(xyz_m: FloatArray, cell_m: float) -> Voxels:
    """Group points (n, 3), finite, by voxels of a cell size; voxels are in the order of their first points."""
    if not cell_m > 0.0:
        raise ValueError(f"voxels of {cell_m} m")
    if not len(xyz_m):
        return Voxels(np.zeros(0, np.int64), np.zeros((0, 3)), np.zeros(0, np.int64))
    points = np.ascontiguousarray(xyz_m, np.float64)
    low, high = (np.floor(end / cell_m) for end in bounds(points))
    across = high - low + 1.0
    if np.prod(across) >= 2.0**62:
        raise ValueError(f"points span {across * cell_m} m, too many voxels of {cell_m} m")
    of_point, sums, count = _group(points, cell_m, low, across.astype(np.int64))
    return Voxels(of_point, sums / count[:, None] + low * cell_m, count)


@kernel()
def _group(xyz_m, cell_m, low, across):  # type: ignore[no-untyped-def]
    """Voxel of each point, sum of each voxel's points less the corner of all, and their number, by a hash table."""
    n = len(xyz_m)
    bits = 10
    table = np.full(1 << bits, -1, np.int64)
    keys = np.empty(1024, np.int64)
    count = np.zeros(1024, np.int64)
    sums = np.zeros((1024, 3))
    of_point = np.empty(n, np.int64)
    held = 0
    corner = low * cell_m
    for i in range(n):
        key = np.int64(0)
        for a in range(3):
            key = key * across[a] + np.int64(np.floor(xyz_m[i, a] / cell_m) - low[a])
        slot = np.int64((np.uint64(key) * np.uint64(0x9E3779B97F4A7C15)) >> np.uint64(64 - bits))
        while table[slot] >= 0 and keys[table[slot]] != key:
            slot = (slot + 1) & ((1 << bits) - 1)
        at = table[slot]
        if at < 0:
            if held == len(keys):
                more_keys = np.empty(2 * held, np.int64)
                more_count = np.zeros(2 * held, np.int64)
                more_sums = np.zeros((2 * held, 3))
                more_keys[:held] = keys
                more_count[:held] = count
                more_sums[:held] = sums
                keys = more_keys
                count = more_count
                sums = more_sums
            at = held
            keys[at] = key
            table[slot] = at
            held += 1
            if 2 * held > len(table):
                bits += 1
                table = np.full(1 << bits, -1, np.int64)
                for k in range(held):
                    slot = np.int64((np.uint64(keys[k]) * np.uint64(0x9E3779B97F4A7C15)) >> np.uint64(64 - bits))
                    while table[slot] >= 0:
                        slot = (slot + 1) & ((1 << bits) - 1)
                    table[slot] = k
        of_point[i] = at
        count[at] += 1
        for a in range(3):
            sums[at, a] += xyz_m[i, a] - corner[a]
    return of_point, sums[:held].copy(), count[:held].copy()


VOTED: Final = (Feature.HORIZONTAL_PLANE, Feature.VERTICAL_PLANE, Feature.LINE, Feature.SCATTER)
MIN_VOTING_VOXELS: Final = 8
"""Voxels of a segment that votes."""
GREEN: Final = (0.1, 0.4)
"""Excess green index (2g - r - b) / (r + g + b) of what may be, and of what is green vegetation (Woebbecke et al. 1995,
Transactions of the ASAE 38, 259-269)."""
LEAF_AS_OBJECT: Final = 0.5
OBJECT_AS_LEAF: Final = 0.6
"""Weight of planes and lines that are all green, and of scatter that is not green at all."""
COLOUR_SCALE: Final = 0.1
"""Preference for larger segments, in colours of which black and white differ by 1."""


def vote_classes(evidence: FloatArray, segment: IntArray, rgb: FloatArray | None) -> NDArray[np.uint8]:
    """Class of each voxel by its own evidence (n, 4) of :data:`VOTED`, from 0 to 1, and that of its segment.

    `segment` (n,) is below 0 for none; `rgb` (n, 3) from 0 to 1, nan where unknown.
    """
    total = evidence.copy()
    known = segment >= 0
    if known.any():
        there, number, count = np.unique(segment[known], return_inverse=True, return_counts=True)
        mean = np.column_stack([np.bincount(number, evidence[known, k], len(there)) for k in range(4)])
        mean[count < MIN_VOTING_VOXELS] = 0.0
        # What is sure of itself does not listen. Lines are thinner than segments: those around them have no say.
        unsure = np.clip(2.0 * (1.0 - evidence[known].max(axis=1)), 0.0, 1.0)
        total[known] += (unsure * (evidence[known, 2] < 0.5))[:, None] * (mean / count[:, None])[number]
        if rgb is not None:
            green = greenness(rgb[known])
            seen = np.isfinite(green)
            counted = np.bincount(number[seen], minlength=len(there))
            share = (np.bincount(number[seen], green[seen], len(there)) / np.maximum(counted, 1))[number]
            unsure = np.where(seen, unsure, 0.0)
            total[known, :3] *= (1.0 - unsure * (1.0 - LEAF_AS_OBJECT) * share)[:, None]
            total[known, 3] *= 1.0 - unsure * (1.0 - OBJECT_AS_LEAF) * (1.0 - share)
    out: NDArray[np.uint8] = np.array(VOTED, np.uint8)[np.argmax(total, axis=1)]
    return out


def greenness(rgb: FloatArray) -> FloatArray:
    """From 0, not green, to 1, as leaves, of colours (n, 3); nan for black or unknown."""
    total = rgb.sum(axis=1)
    index = (3.0 * rgb[:, 1] - total) / np.where(total > 0.0, total, np.nan)
    out: FloatArray = np.clip((index - GREEN[0]) / (GREEN[1] - GREEN[0]), 0.0, 1.0)
    return out


def colour_segments(xyz_m: FloatArray, rgb: FloatArray, reach_m: float) -> IntArray:
    """Segment (n,) of voxels (n, 3) by their colours (n, 3), from 0 to 1: segmentation of the graph of the voxels.

    P. F. Felzenszwalb, D. P. Huttenlocher (2004), Efficient graph-based image segmentation, International Journal of
    Computer Vision 59, 167-181, with neighbours within a distance instead of pixels.
    """
    if not len(xyz_m):
        return np.zeros(0, np.int64)
    near = sort_into_columns(xyz_m, reach_m)
    colour = np.nan_to_num(rgb)[near.order]
    a, b, weight = _edges(near.xyz_m, near.starts, reach_m, *near.across, colour)
    order = np.argsort(weight)
    out = np.empty(len(xyz_m), np.int64)
    out[near.order] = _merge_segments(a[order], b[order], weight[order], len(xyz_m), COLOUR_SCALE)
    return out


@kernel()
def _edges(xyz, starts, reach, across, rows, colour):  # type: ignore[no-untyped-def]
    """Pairs of near points, and how their colours differ."""
    first = [0 for _ in range(0)]
    second = [0 for _ in range(0)]
    weight = [0.0 for _ in range(0)]
    for i in range(len(xyz)):
        x = xyz[i, 0]
        y = xyz[i, 1]
        z = xyz[i, 2]
        column = int(x // reach)
        row = int(y // reach)
        for beside in range(column, min(column + 2, across)):
            for near in range(max(row - 1, 0), min(row + 2, rows)):
                begin = starts[beside * rows + near]
                end = starts[beside * rows + near + 1]
                for j in range(first_above(xyz, begin, end, z - reach), end):
                    c = xyz[j, 2] - z
                    if c > reach:
                        break
                    a = xyz[j, 0] - x
                    b = xyz[j, 1] - y
                    if j > i and a * a + b * b + c * c <= reach * reach:
                        r = colour[j, 0] - colour[i, 0]
                        g = colour[j, 1] - colour[i, 1]
                        h = colour[j, 2] - colour[i, 2]
                        first.append(i)
                        second.append(j)
                        weight.append(np.sqrt((r * r + g * g + h * h) / 3.0))
    return np.array(first, np.int64), np.array(second, np.int64), np.array(weight, np.float64)


@kernel()
def _merge_segments(a, b, weight, n, scale):  # type: ignore[no-untyped-def]
    """Segments of a graph whose edges are sorted by weight."""
    parent = np.arange(n)
    size = np.ones(n, np.int64)
    most = np.full(n, scale)
    for k in range(len(a)):
        i = a[k]
        j = b[k]
        while parent[i] != i:
            parent[i] = parent[parent[i]]
            i = parent[i]
        while parent[j] != j:
            parent[j] = parent[parent[j]]
            j = parent[j]
        if i != j and weight[k] <= most[i] and weight[k] <= most[j]:
            if size[i] < size[j]:
                i, j = j, i
            parent[j] = i
            size[i] += size[j]
            most[i] = weight[k] + scale / size[i]
    for i in range(n):
        root = i
        while parent[root] != root:
            root = parent[root]
        parent[i] = root
    return parent


MIN_LEVEL_NORMAL: Final = 0.75
"""Height of the unit normal of ground that the filter missed, as beyond a ditch at the rim of a cloud."""
MIN_LEVEL_PURITY: Final = 0.7
"""Of such ground: it need not be as even as a roof or a table."""
GROUND_STEP_M: Final = 0.2
"""What is flat and nowhere higher than this above the ground beside it is ground."""
MAX_WALL_SCATTER: Final = 0.3
"""RMS distance of the voxels from a wall as a share of the tolerance: a third is the noise. Those of a crop or hedge
spread evenly within the tolerance, with 0.58 of it."""
MIN_FENCE_PURITY: Final = 0.8
"""Of an open vertical plane, such as the wires of a fence."""
MIN_FENCE_ORDER: Final = 0.5
"""Share of its voxels whose neighbourhoods run along it or upright, unless they scatter no more than those of a wall:
it consists of wires and posts. The side of a crop is open as well, but in no order."""
MIN_ORDERED: Final = 0.5
"""Linearity of such a neighbourhood: two wires may be in it."""
MIN_FENCE_LENGTH_M: Final = 1.5
MAX_FENCE_NORMAL: Final = 0.2
"""Height of its unit normal."""
SCATTER_EVIDENCE: Final = 0.7
"""Of a voxel that is on no plane or line."""
LINE_EVIDENCE: Final = 0.33
"""Of a voxel in a long neighbourhood that is on no line: it needs colours to become one."""
NOISE_PERCENTILE: Final = 15.0
"""Percentile of the thickness of flat neighbourhoods that is the noise of the scanner."""
PLANE_TOLERANCE_M: Final = (0.04, 0.12)
"""Limits of the distance from a plane of a point that is on it: three deviations of the noise."""


@dataclass(frozen=True)
class FeatureTile:
    """What is classified at once: finite points, which are ground, the size of voxels, colours (n, 3) from 0 to 1."""

    xyz_m: FloatArray
    ground: BoolArray
    cell_m: float
    rgb: FloatArray | None = None


@dataclass(frozen=True)
class Classified:
    """The classes of a tile, and its planes and lines.

    Attributes:
        feature: (n,) :class:`Feature` of each point.
        above_m: (n,) height above the ground, nan without any.
        hidden: (n,) whether plants hide the ground there.
        of_voxel: (n,) voxel of each point; -1 for those that the first estimate of the ground takes.
        voxel_m: (m, 3) the voxels, of which planes and lines are.
        planes, lines: their members are voxels.
        fences: open vertical planes, as of wires between posts; likewise.
    """

    feature: NDArray[np.uint8]
    above_m: FloatArray
    hidden: BoolArray
    of_voxel: IntArray
    voxel_m: FloatArray
    planes: list[Plane]
    lines: list[DetectedLine]
    fences: list[Plane]


def classify(tile: FeatureTile) -> Classified:
    """The class of each point of a tile, by voxels."""
    heights = heights_above_ground(tile.xyz_m, tile.ground, tile.cell_m)
    ground = heights.ground
    rest = np.flatnonzero(~ground)
    fine = voxels(tile.xyz_m[rest], tile.cell_m)
    found, tolerance = _candidate_planes(fine, heights.noise_m, tile.cell_m)
    of_ground = _find_ground_planes(tile, ground, fine, found)
    own = np.full(len(fine), Feature.SCATTER, np.uint8)
    if of_ground.any():
        ground = ground.copy()
        ground[rest] = of_ground[fine.of_point]
        heights = heights_above_ground(tile.xyz_m, ground, tile.cell_m)
        ground = heights.ground
        own[of_ground | (fine.mean_of(ground[rest]) > 0.5)] = Feature.GROUND
        found = [plane for plane in found if not of_ground[plane.members].all()]
    evidence = _plane_evidence(own, found)
    flat = [plane for plane in found if plane.purity >= MIN_PLANE_PURITY]
    free = np.flatnonzero((own == Feature.SCATTER) & (evidence[:, :2].max(axis=1, initial=0.0) < 0.5))
    bars, fences, linearity = _find_bars(fine.mean_m[free], tile.cell_m, tolerance)
    faint = LINE_EVIDENCE * np.interp(linearity, [0.5, MIN_LINEARITY], [0.0, 1.0])
    evidence[free, 2], evidence[free, 3] = faint, evidence[free, 3] - faint
    for line in bars:
        evidence[free[line.members]] = (0.0, 0.0, 0.5 + 0.5 * line.purity, 0.5 - 0.5 * line.purity)
    for fence in fences:
        evidence[free[fence.members]] = (0.0, 0.0, fence.purity, 1.0 - fence.purity)
    standing = own == Feature.SCATTER
    own[standing] = vote_classes(evidence[standing], *_segments(tile, rest, fine, standing))
    feature = np.where(ground, Feature.GROUND, Feature.NONE).astype(np.uint8)
    feature[rest] = own[fine.of_point]
    of_voxel = np.full(len(feature), -1, np.int64)
    of_voxel[rest] = fine.of_point
    return Classified(
        feature,
        heights.above_m,
        heights.hidden,
        of_voxel,
        fine.mean_m,
        flat,
        [replace(line, members=free[line.members]) for line in bars],
        [replace(fence, members=free[fence.members]) for fence in fences],
    )


def _candidate_planes(fine: Voxels, noise_m: float, cell_m: float) -> tuple[list[Plane], float]:
    """Candidates of planes, and the tolerance by the noise of the ground or, if that is less, of what is flat."""
    coarse = voxels(fine.mean_m, 2.0 * cell_m)
    (wide,) = neighbourhoods(coarse.mean_m, coarse.mean_m, (8.0 * cell_m,))
    flat = wide.planarity > 0.4
    thickness = np.sqrt(wide.eigenvalue_m2[flat, 2])
    # Where hedges outnumber walls the flattest there is may be their faces, but the ground is known.
    noise = min(noise_m, float(np.percentile(thickness, NOISE_PERCENTILE)) if flat.any() else np.inf)
    tolerance = float(np.clip(3.0 * noise, PLANE_TOLERANCE_M[0], max(PLANE_TOLERANCE_M[1], 0.5 * cell_m)))
    found = find_planes(fine.mean_m, wide.at(coarse.of_point), cell_m, tolerance, 3.0 * cell_m)
    return [_as_wall(plane, tolerance) if plane.normal[2] < HORIZONTAL_NORMAL else plane for plane in found], tolerance


def _as_wall(plane: Plane, tolerance_m: float) -> Plane:
    """An upright plane, with its purity less two standard errors, and less by how far it is less even than a wall."""
    uneven = max(plane.rms_m / tolerance_m - MAX_WALL_SCATTER, 0.0)
    return replace(plane, purity=plane.purity - 2.0 * _purity_error(plane) - uneven)


def _purity_error(plane: Plane) -> float:
    """Standard error of a plane's purity, by the number of its voxels."""
    return math.sqrt(plane.purity * (1.0 - plane.purity) / len(plane.members))


def _find_ground_planes(tile: FeatureTile, ground: BoolArray, fine: Voxels, found: list[Plane]) -> BoolArray:
    """Which voxels are on level planes that reach down to the ground: ground that the filter missed."""
    of_ground = np.zeros(len(fine), bool)
    pending = [plane for plane in found if plane.normal[2] >= MIN_LEVEL_NORMAL and plane.purity >= MIN_LEVEL_PURITY]
    if not pending or not ground.any():
        return of_ground
    side = 2.0 * tile.cell_m
    reach = max(GROUND_STEP_M, 4.0 * tile.cell_m)
    # the ground points in the boxes of planes and a margin around them
    ground_m = tile.xyz_m[ground]
    margin_m = reach + side
    ends = [bounds(fine.mean_m[plane.members]) for plane in pending]
    boxes = np.array([[*(low - margin_m), *(high + margin_m)] for low, high in ends])
    touched = voxels(ground_m[_in_boxes(ground_m, boxes)], side).mean_m
    while pending and len(touched):
        tree = cKDTree(touched)
        new: list[Plane] = []
        others: list[Plane] = []
        for plane in pending:
            xyz = fine.mean_m[plane.members]
            away, _ = tree.query(xyz, distance_upper_bound=reach)
            flat, _ = plane.flat(xyz[np.isfinite(away)])
            contact_m = len(np.unique(np.floor(flat / side), axis=0)) * side
            (new if contact_m >= 0.5 * np.sqrt(plane.area_m2) else others).append(plane)
        for plane in new:
            of_ground[plane.members] = True
        touched = fine.mean_m[np.concatenate([plane.members for plane in new])] if new else np.zeros((0, 3))
        pending = others
    return of_ground


@kernel()
def _in_boxes(xyz_m, boxes):  # type: ignore[no-untyped-def]
    """Which points (n, 3) lie in any of the boxes (k, 6)."""
    out = np.zeros(len(xyz_m), np.bool_)
    for i in range(len(xyz_m)):
        for box in boxes:
            inside = True
            for a in range(3):
                inside &= box[a] <= xyz_m[i, a] <= box[a + 3]
            if inside:
                out[i] = True
                break
    return out


def _plane_evidence(own: NDArray[np.uint8], found: list[Plane]) -> FloatArray:
    """Evidence (m, 4) of :data:`VOTED` for each voxel: of candidates too that shape alone does not make planes."""
    evidence = np.zeros((len(own), len(VOTED)))
    evidence[:, 3] = SCATTER_EVIDENCE
    for plane in reversed(found):  # the largest has the last word
        members = plane.members[own[plane.members] == Feature.SCATTER]
        sure = float(np.interp(plane.purity, [MIN_PLANE_PURITY - 0.25, MIN_PLANE_PURITY, 1.0], [0.0, 0.5 + 1e-6, 1.0]))
        weaker = (evidence[members, :2].max(axis=1) <= sure) | (sure >= 0.5)
        upright = abs(plane.normal[2]) < HORIZONTAL_NORMAL
        evidence[members[weaker]] = (0.0, sure, 0.0, 1.0 - sure) if upright else (sure, 0.0, 0.0, 1.0 - sure)
    return evidence


def _find_bars(
    xyz_m: FloatArray, cell_m: float, tolerance_m: float
) -> tuple[list[DetectedLine], list[Plane], FloatArray]:
    """Lines, open vertical planes of them, and the linearity (n,) of the voxels (n, 3)."""
    coarse = voxels(xyz_m, 2.0 * cell_m)
    radii = (5.0 * cell_m, 10.0 * cell_m, 12.0 * cell_m)
    near, wide, widest = (each.at(coarse.of_point) for each in neighbourhoods(xyz_m, coarse.mean_m, radii))
    longer = np.nan_to_num(wide.linearity) > np.nan_to_num(near.linearity)
    linearity = np.nan_to_num(np.fmax(near.linearity, wide.linearity)).astype(np.float64)
    direction = np.where(longer[:, None], wide.direction, near.direction).astype(np.float64)
    bars = find_lines(xyz_m, linearity, direction, cell_m, tolerance_m)
    open_planes = find_planes(xyz_m, widest, cell_m, tolerance_m, 6.0 * cell_m, fill=(0.0, math.inf))
    fences = []
    for plane in open_planes:
        members = plane.members
        axes = np.column_stack(axes_of(plane.normal))
        flat, _ = plane.flat(xyz_m[members])
        long = np.ptp(flat[:, 0]) >= MIN_FENCE_LENGTH_M and abs(plane.normal[2]) < MAX_FENCE_NORMAL
        if long and plane.purity - _purity_error(plane) >= MIN_FENCE_PURITY:
            along = np.abs(direction[members] @ axes).max(axis=1) >= math.cos(math.radians(MAX_TURN_DEG))
            order = np.mean(along & (linearity[members] >= MIN_ORDERED))
            if order >= MIN_FENCE_ORDER or plane.rms_m <= MAX_WALL_SCATTER * tolerance_m:
                fences.append(plane)
    return bars, fences, linearity


def _segments(tile: FeatureTile, rest: IntArray, fine: Voxels, asked: BoolArray) -> tuple[IntArray, FloatArray | None]:
    """Segment and colour of the voxels asked for, by the colours of the points; segments below 0 without colours."""
    if tile.rgb is None:
        return np.full(np.count_nonzero(asked), -1, np.int64), None
    rgb = np.column_stack([fine.mean_of(tile.rgb[rest, k]) for k in range(3)])[asked]
    return colour_segments(fine.mean_m[asked], rgb, 3.0 * tile.cell_m), rgb
