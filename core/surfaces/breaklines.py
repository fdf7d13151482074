"""Ground at breaklines: what the morphological filter takes off at edges and leaves on roofs, by the ground around it.

A morphological opening takes off the upper edges of banks and terraces and the high side of a slope at the border of a
cloud, and leaves islands on wide roofs. Both are mended in cells that hold a point, in this order:

1. Small islands that stand above the ground at most of their rim are taken off.
2. A cell joins the ground if it lies between the planes that continue the ground of its sides: these agree on a smooth
   slope, and differ by the height of a cliff at its edge. Of what joined, connected parts whose rim mostly stands above
   the ground are left out: decks of bridges and roofs that touch a slope (segments as in G. Sithole, G. Vosselman,
   2005, Filtering of airborne laser scanner data based on segmented point clouds, ISPRS Archives 36, 3/W19, 66-71).
3. Cells above all planes leave the ground, and step 2 is repeated in a smaller neighbourhood, as the ground is denser.

Lengths are spacings of the points, and heights follow the roughness of the ground, so that nothing is set for a scene.
Clouds whose points are closer than :data:`SPARSE_M` stay as the filter leaves them.
"""

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import uniform_filter

from furrowmap.core.runtime.arrays import BoolArray, FloatArray
from furrowmap.core.runtime.kernels import kernel, kernel_part

WIDE_SPACINGS: Final = 3.0
CLOSE_SPACINGS: Final = 2.0
"""Radii of the neighbourhoods whose ground continues to a cell, before and after ground was found again."""
RIM_SPACINGS: Final = 1.6
"""Distance of neighbours: above the diagonal of a square of points."""
MIN_ON_SIDE: Final = 5
"""Least cells of ground on a side for a plane."""
SMOOTH_M: Final = 0.15
JOIN_DEVIATIONS: Final = 2.0
LEAVE_DEVIATIONS: Final = 1.0
"""Tolerances of heights: the former, and these times the standard deviation of the ground from its planes. Cells that
join lie farther from the ground that is known, so that its curvature adds to its roughness."""
STEP_SLOPE: Final = 1.0 / 3.0
"""Neighbours on either side of a step differ by more than this slope and the tolerance."""
MAX_STANDING: Final = 0.6
"""Share of the rim that may stand above the ground: half of it does along the edge of a terrace."""
ISLAND_M2: Final = 100.0
ISLAND_STANDING: Final = 2.0 / 3.0
"""Islands up to this size are taken off where more than this share of the rim stands above the ground."""
PRUNING_ROUNDS: Final = 3
MAX_SPACING_M: Final = 4.0
SPARSE_M: Final = 0.75
"""Spacing from which on cells are mended. In denser clouds the filter loses less at edges, and the margins of crops and
hedges are slopes like any other, by which whole stands would join the ground."""
_DENSITY_M: Final = 10.0
"""Side of the squares in which the density of the points is measured."""
_LEAST_EMPTY: Final = 1e-9
"""Share of empty cells that stands for none."""
_MAX_ROUGHNESS_CELLS: Final = 20_000
_RAYS_AND_SECTORS: Final = 16
"""Eight rays along the axes and diagonals, numbered even, and the sectors between them, so that both sides of a
half-plane hold their border and no direction of the map is preferred."""
_SUMS: Final = 9
_RIDGE_M2: Final = 0.01
"""Added to the spread of the points of a plane, which limits the slope of a plane through a row of points."""

IndexArray = NDArray[np.int64]


def point_spacing_m(seen: BoolArray, cell_m: float) -> float:
    """Distance of points as if on a square grid, by the usual share of cells `seen` (rows, columns), at least one.

    Where all cells around most cells are seen, the points are closer than this tells: at least a fifth of a cell.
    """
    side = 2 * round(0.5 * _DENSITY_M / cell_m) + 1
    share = float(np.median(uniform_filter(seen.astype(np.float64), side, mode="reflect")[seen]))
    # Of points thrown at random with a density d in a cell, exp(-d) of the cells are empty.
    density = -math.log(max(1.0 - share, _LEAST_EMPTY))
    return min(cell_m / math.sqrt(density), MAX_SPACING_M)


def with_breaklines(lowest_m: FloatArray, ground: BoolArray, cell_m: float) -> BoolArray:
    """Ground cells (rows, columns), improved by the cells around them.

    Args:
        lowest_m: lowest heights; nan in cells that are not seen.
        ground: the cells that a filter for terrain without breaklines keeps.
        cell_m: side of a cell.
    """
    seen = np.isfinite(lowest_m)
    if not ground.any():
        return ground
    spacing_m = point_spacing_m(seen, cell_m)
    if spacing_m < SPARSE_M:
        return ground
    spacing_m = max(spacing_m, cell_m)
    wide = _disc(WIDE_SPACINGS * spacing_m, cell_m)
    close = _disc(CLOSE_SPACINGS * spacing_m, cell_m)
    rim = _disc(RIM_SPACINGS * spacing_m, cell_m)[:, :2]
    deviation_m = _roughness_m(lowest_m, ground, wide, cell_m)
    leave_m = SMOOTH_M + LEAVE_DEVIATIONS * deviation_m
    step = np.array([SMOOTH_M + JOIN_DEVIATIONS * deviation_m, STEP_SLOPE * cell_m])
    found = _without_islands(lowest_m, ground, rim, step, ISLAND_M2 / spacing_m**2)
    found = _extended(lowest_m, found, seen, wide, rim, step, cell_m)
    found = _pruned(lowest_m, found, wide, leave_m, cell_m, PRUNING_ROUNDS)
    found = _extended(lowest_m, found, seen, close, rim, step, cell_m)
    out: BoolArray = _pruned(lowest_m, found, close, leave_m, cell_m, 1)
    return out


def _disc(radius_m: float, cell_m: float) -> IndexArray:
    """Steps in rows and columns to the cells around one, and the direction of each."""
    reach = int(radius_m / cell_m)
    rows, columns = (part.ravel() for part in np.mgrid[-reach : reach + 1, -reach : reach + 1])
    near = (np.hypot(rows, columns) * cell_m <= radius_m) & ((rows != 0) | (columns != 0))
    rows = rows[near]
    columns = columns[near]
    eighths = (np.arctan2(columns, rows) / np.pi + 1.0) * (_RAYS_AND_SECTORS // 4)
    on_ray = (rows == 0) | (columns == 0) | (np.abs(rows) == np.abs(columns))
    direction = np.where(on_ray, 2.0 * np.rint(eighths), 2.0 * np.floor(eighths) + 1.0) % _RAYS_AND_SECTORS
    return np.column_stack([rows, columns, direction]).astype(np.int64)


def _roughness_m(lowest_m: FloatArray, ground: BoolArray, disc: IndexArray, cell_m: float) -> float:
    """Robust standard deviation of ground cells from the planes of those around them; of a sample of the cells."""
    place = np.flatnonzero(ground)
    place = place[:: 1 + len(place) // _MAX_ROUGHNESS_CELLS].copy()
    apart_m = _apart(lowest_m, ground, place, disc, cell_m)
    apart_m = apart_m[np.isfinite(apart_m)]
    return 1.4826 * float(np.median(apart_m)) if len(apart_m) else 0.0


def _without_islands(
    lowest_m: FloatArray, ground: BoolArray, rim: IndexArray, step: FloatArray, most_cells: float
) -> BoolArray:
    segment, number = _segments(lowest_m, ground, rim, step)
    cells, touching, standing = _rims(lowest_m, segment, number, ground, rim, step)
    island = (standing > ISLAND_STANDING * touching) & (cells < most_cells)
    out: BoolArray = ground & ~island[segment]
    return out


def _extended(
    lowest_m: FloatArray,
    ground: BoolArray,
    seen: BoolArray,
    disc: IndexArray,
    rim: IndexArray,
    step: FloatArray,
    cell_m: float,
) -> BoolArray:
    """The ground with what continues it, without parts whose rim mostly stands above it."""
    joined = _continued(lowest_m, ground, seen, disc, step[0], cell_m) & ~ground
    segment, number = _segments(lowest_m, joined, rim, step)
    _, touching, standing = _rims(lowest_m, segment, number, ground, rim, step)
    part = standing <= MAX_STANDING * touching
    part[0] = False
    out: BoolArray = ground | part[segment]
    return out


@kernel_part()
def _plane(m):  # type: ignore[no-untyped-def]
    """Height at the origin of the plane through points, by the sums (9,) of x, y, z, xx, xy, yy, xz, yz and 1."""
    n = m[8]
    x = m[0] / n
    y = m[1] / n
    z = m[2] / n
    xx = m[3] / n - x * x + _RIDGE_M2
    xy = m[4] / n - x * y
    yy = m[5] / n - y * y + _RIDGE_M2
    xz = m[6] / n - x * z
    yz = m[7] / n - y * z
    turned = xx * yy - xy * xy
    return z - ((xz * yy - yz * xy) * x + (yz * xx - xz * xy) * y) / turned


@kernel_part()
def _gather(lowest_m, ground, i, j, disc, cell_m, sums):  # type: ignore[no-untyped-def]
    """Sums (16, 9) of the ground around a cell by direction, from its place and height."""
    sums[:] = 0.0
    rows, columns = lowest_m.shape
    for k in range(len(disc)):
        a = i + disc[k, 0]
        b = j + disc[k, 1]
        if a < 0 or b < 0 or a >= rows or b >= columns or not ground[a, b]:
            continue
        x = disc[k, 0] * cell_m
        y = disc[k, 1] * cell_m
        z = lowest_m[a, b] - lowest_m[i, j]
        m = sums[disc[k, 2]]
        m[0] += x
        m[1] += y
        m[2] += z
        m[3] += x * x
        m[4] += x * y
        m[5] += y * y
        m[6] += x * z
        m[7] += y * z
        m[8] += 1.0


@kernel_part()
def _bounds(sums, half):  # type: ignore[no-untyped-def]
    """Lowest and highest plane of the halves of a neighbourhood above its middle; inf and -inf without any."""
    low = np.inf
    high = -np.inf
    for first in range(0, _RAYS_AND_SECTORS, 2):
        half[:] = 0.0
        for k in range(_RAYS_AND_SECTORS // 2 + 1):
            for s in range(_SUMS):
                half[s] += sums[(first + k) % _RAYS_AND_SECTORS, s]
        if half[8] >= MIN_ON_SIDE:
            height = _plane(half)
            low = min(low, height)
            high = max(high, height)
    return low, high


@kernel()
def _apart(lowest_m, ground, place, disc, cell_m):  # type: ignore[no-untyped-def]
    """Distance of cells from the plane of the ground around each; nan where that has too few cells."""
    out = np.full(len(place), np.nan)
    sums = np.empty((_RAYS_AND_SECTORS, _SUMS))
    total = np.empty(_SUMS)
    for k in range(len(place)):
        _gather(lowest_m, ground, place[k] // lowest_m.shape[1], place[k] % lowest_m.shape[1], disc, cell_m, sums)
        for s in range(_SUMS):
            total[s] = 0.0
            for direction in range(_RAYS_AND_SECTORS):
                total[s] += sums[direction, s]
        if total[8] >= MIN_ON_SIDE:
            out[k] = abs(_plane(total))
    return out


@kernel()
def _continued(lowest_m, ground, seen, disc, tolerance_m, cell_m):  # type: ignore[no-untyped-def]
    """The ground with all cells that lie between the planes of its sides, round by round until none is added."""
    rows, columns = lowest_m.shape
    out = ground.copy()
    waiting = np.empty(rows * columns, np.int64)
    count = 0
    for i in range(rows):
        for j in range(columns):
            if seen[i, j] and not ground[i, j]:
                waiting[count] = i * columns + j
                count += 1
    asked = seen.copy()
    joined = np.empty(count, np.int64)
    sums = np.empty((_RAYS_AND_SECTORS, _SUMS))
    half = np.empty(_SUMS)
    while True:  # each round takes a cell from those that wait
        new = 0
        left = 0
        for k in range(count):
            i = waiting[k] // columns
            j = waiting[k] % columns
            if asked[i, j]:
                asked[i, j] = False
                _gather(lowest_m, out, i, j, disc, cell_m, sums)
                low, high = _bounds(sums, half)
                if low - tolerance_m <= 0.0 <= high + tolerance_m:
                    joined[new] = waiting[k]
                    new += 1
                    continue
            waiting[left] = waiting[k]
            left += 1
        count = left
        if new == 0:
            return out
        for k in range(new):
            i = joined[k] // columns
            j = joined[k] % columns
            out[i, j] = True
            for d in range(len(disc)):
                a = i + disc[d, 0]
                b = j + disc[d, 1]
                if 0 <= a < rows and 0 <= b < columns:
                    asked[a, b] = True


@kernel()
def _pruned(lowest_m, ground, disc, tolerance_m, cell_m, rounds):  # type: ignore[no-untyped-def]
    """The ground without cells above all planes of the ground around them, which change as cells leave."""
    rows, columns = lowest_m.shape
    out = ground.copy()
    asked = ground.copy()
    left = np.empty(rows * columns, np.int64)
    sums = np.empty((_RAYS_AND_SECTORS, _SUMS))
    half = np.empty(_SUMS)
    for _ in range(rounds):
        count = 0
        for i in range(rows):
            for j in range(columns):
                if asked[i, j] and out[i, j]:
                    _gather(lowest_m, out, i, j, disc, cell_m, sums)
                    low, high = _bounds(sums, half)
                    if low <= high and high + tolerance_m < 0.0:
                        left[count] = i * columns + j
                        count += 1
                asked[i, j] = False
        for k in range(count):
            out[left[k] // columns, left[k] % columns] = False
        for k in range(count):
            for d in range(len(disc)):
                a = left[k] // columns + disc[d, 0]
                b = left[k] % columns + disc[d, 1]
                if 0 <= a < rows and 0 <= b < columns:
                    asked[a, b] = True
    return out


@kernel()
def _segments(lowest_m, member, near, step):  # type: ignore[no-untyped-def]
    """Segments of member cells, numbered from 1, whose neighbours have no step between them; and their number."""
    rows, columns = lowest_m.shape
    out = np.zeros((rows, columns), np.int32)
    stack = np.empty(rows * columns, np.int64)
    number = 0
    for first in range(rows * columns):
        if not member[first // columns, first % columns] or out[first // columns, first % columns]:
            continue
        number += 1
        out[first // columns, first % columns] = number
        stack[0] = first
        top = 1
        while top:
            top -= 1
            i = stack[top] // columns
            j = stack[top] % columns
            for k in range(len(near)):
                a = i + near[k, 0]
                b = j + near[k, 1]
                if a < 0 or b < 0 or a >= rows or b >= columns or not member[a, b] or out[a, b]:
                    continue
                limit_m = step[0] + step[1] * np.hypot(near[k, 0], near[k, 1])
                if abs(lowest_m[a, b] - lowest_m[i, j]) <= limit_m:
                    out[a, b] = number
                    stack[top] = a * columns + b
                    top += 1
    return out, number


@kernel()
def _rims(lowest_m, segment, number, ground, near, step):  # type: ignore[no-untyped-def]
    """Of each segment, 0 for none: its cells, those with ground of others beside them, those above all of that."""
    cells = np.zeros(number + 1)
    touching = np.zeros(number + 1)
    standing = np.zeros(number + 1)
    rows, columns = lowest_m.shape
    for i in range(rows):
        for j in range(columns):
            own = segment[i, j]
            if own == 0:
                continue
            cells[own] += 1.0
            above = False
            level = False
            for k in range(len(near)):
                a = i + near[k, 0]
                b = j + near[k, 1]
                if a < 0 or b < 0 or a >= rows or b >= columns or not ground[a, b] or segment[a, b] == own:
                    continue
                limit_m = step[0] + step[1] * np.hypot(near[k, 0], near[k, 1])
                if lowest_m[i, j] - lowest_m[a, b] > limit_m:
                    above = True
                else:
                    level = True
            touching[own] += above or level
            standing[own] += above and not level
    return cells, touching, standing
