"""Registration to walls, fences and hedges' faces, which show place and yaw where the ground has no relief.

Returns well above the ground are counted into upright columns, each half of the scans on its own. A column whose
returns lie along a line in plan, over a good part of its height, is a piece of a wall: its normal is the direction in
which they scatter least (a two-dimensional normal distributions transform; Biber and Straßer 2003, The Normal
Distributions Transform, section 3). Crowns of trees, roofs and whatever moves fill their columns and are no lines. A
return's distance along the normal from the other half's line is its residual. It changes with the pose as that of the
ground's returns does, with a level normal, so that walls add to the same equations; patches of wall move along with
the poses as those of ground do.
"""

from dataclasses import astuple, dataclass
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from furrowmap.core.adjustment.registered_returns import (
    Patches,
    PatchRows,
    PlaneEquation,
    SliceSums,
    add_equation,
)
from furrowmap.core.matching.ground_registration import ChainPoses
from furrowmap.core.matching.height_grid import TILE_NODES, Tiles, node_at, tiles_over
from furrowmap.core.runtime.arrays import FloatArray
from furrowmap.core.runtime.kernels import kernel, kernel_part

MIN_WALL_RANGE_M: Final = 1.5
MAX_WALL_RANGE_M: Final = 40.0
ABOVE_M: Final = 0.35
ABOVE_SLOPE: Final = 0.05
ABOVE_MOST_M: Final = 1.0
"""Upright returns are higher above the plane under the vehicle than ABOVE_M and ABOVE_SLOPE of the distance, or than
ABOVE_MOST_M, which straw and tall weeds are not."""
UPRIGHT_RATE_HZ: Final = 3_000.0
COLUMN_CELL_M: Final = 0.5
"""Side of a column."""
MIN_COLUMN_RETURNS: Final = 16
"""In one half of a column: with fewer its normal is random, which would constrain the vehicle along the wall."""
MIN_COLUMN_HEIGHT_M: Final = 0.4
MIN_LINE_SIGMA_M: Final = 0.06
"""Standard deviation along the line; half a metre of wall has 0.14 m."""
MAX_LINE_SIGMA_M: Final = 0.06
MAX_LINE_THICKNESS: Final = 0.35
"""A line is no thicker (standard deviation) than MAX_LINE_SIGMA_M and this share of its length."""
LINE_REACH_SIGMAS: Final = 3.0
"""Standard deviations to either side of a line that must lie in its column."""
MIN_WALL_SIGMA_M: Final = 0.008
"""No wall is known better."""
WALL_HUBER: Final = 2.5
WALL_GATE: Final = 6.0
GROUP_S: Final = 1.0
"""Returns of one half in one column and such a time share their errors."""
CORRELATED_START: Final = 20.0
MIN_CORRELATED: Final = 4.0
MIN_WALL_GROUPS: Final = 50
WALL_PATCH_M: Final = 8.0
WALL_LAYER: Final = np.int64(2)
"""Layer of a wall's patch in :class:`~furrowmap.core.adjustment.registered_returns.Patches`."""


@dataclass(frozen=True)
class UprightReturns:
    """Upright returns, in the order of time.

    Attributes:
        t_s: (n,) float64 UTC by the trajectory's clock.
        xyz_m: (n, 3) float32 in the vehicle frame.
        half: (n,) uint8: 0 or 1, which of two independent halves of the scans a return belongs to.
        laser: (n,) uint8 which laser measured a return; none of them where that is not known.
    """

    t_s: FloatArray
    xyz_m: NDArray[np.float32]
    half: NDArray[np.uint8]
    laser: NDArray[np.uint8]

    def __len__(self) -> int:
        return len(self.t_s)


def no_upright() -> UprightReturns:
    """No upright returns."""
    none = np.zeros(0, np.uint8)
    return UprightReturns(np.zeros(0), np.zeros((0, 3), np.float32), none, none)


class WallColumns(NamedTuple):
    """Upright columns, of which only those in use take memory.

    Attributes:
        number: (tiles, 32, 32) int32 number of each column, −1 where there is none.
        sums: (columns, 2, 8) of each half: count; sums of easting and northing against the column's centre and of
            their products ee, en, nn; least and greatest height.
    """

    tiles: Tiles
    number: NDArray[np.int32]
    sums: FloatArray


class Lines(NamedTuple):
    """Pieces of walls.

    Attributes:
        columns: in which they stand.
        line: (columns, 2, 5) of each half: easting, northing of a point of the line against the column's centre;
            level unit normal; variance across (m²), infinite where there is no line.
    """

    columns: WallColumns
    line: FloatArray

    @property
    def whole(self) -> int:
        """Columns in which both halves show a line."""
        return int(np.isfinite(self.line[:, :, 4]).all(axis=1).sum())


@dataclass(frozen=True)
class Scatter:
    """Correlation of the residuals of walls, from groups of one column and one second.

    Attributes:
        groups: how many there were.
        together: sum over groups of (Σ r)² / m, with residuals r in standard deviations.
        apart: sum over groups of Σ r² / m.
        matched: returns.
        squares: sum of their squared residuals (m²).
    """

    groups: float = 0.0
    together: float = 0.0
    apart: float = 0.0
    matched: float = 0.0
    squares: float = 0.0

    def plus(self, other: "Scatter") -> "Scatter":
        """Both together."""
        return Scatter(*(one + more for one, more in zip(astuple(self), astuple(other), strict=True)))

    @property
    def correlated(self) -> float:
        """Returns that share an error."""
        if self.groups < MIN_WALL_GROUPS or self.apart <= 0.0:
            return CORRELATED_START
        return max(self.together / self.apart, MIN_CORRELATED)


class Groups(NamedTuple):
    """Residuals of walls by half of a column and second.

    Attributes:
        second: (2 · columns,) the one at hand, −1 before the first.
        sums: (2 · columns, 3) of it: count, residuals in standard deviations, their squares.
        tally: (5,) what :class:`Scatter` has of those before.
    """

    second: NDArray[np.int64]
    sums: FloatArray
    tally: FloatArray


class PlacedUpright(NamedTuple):
    """Upright returns of one chain in the map.

    Attributes:
        t_s: (n,) times, increasing.
        xyz_m: (n, 3) against the local origin.
        half: (n,) 0 or 1.
    """

    t_s: FloatArray
    xyz_m: FloatArray
    half: NDArray[np.uint8]


def columns_over(xyz_m: FloatArray) -> WallColumns:
    """No columns yet, in tiles wherever one of the points (n, 2 or 3) is."""
    tiles = tiles_over(np.ascontiguousarray(xyz_m[:, :2]), COLUMN_CELL_M)
    return WallColumns(tiles, np.full((tiles.used, TILE_NODES, TILE_NODES), -1, np.int32), np.zeros((0, 2, 8)))


def add_upright(columns: WallColumns, xyz_m: FloatArray, half: NDArray[np.uint8]) -> WallColumns:
    """The columns with more returns (n, 3); those outside the tiles are left out."""
    tiles = columns.tiles
    had = len(columns.sums)
    count = _number(xyz_m, tiles, columns.number, had)
    fresh = np.zeros((count - had, 2, 8))
    fresh[:, :, 6] = np.inf
    fresh[:, :, 7] = -np.inf
    sums = np.concatenate([columns.sums, fresh])
    out = WallColumns(tiles, columns.number, sums)
    _add(xyz_m, half, out)
    return out


def lines(columns: WallColumns) -> Lines:
    """The pieces of walls among the columns."""
    return Lines(columns, _fit(columns.sums))


def register_walls(
    placed: PlacedUpright, walls: Lines, poses: ChainPoses, correlated: float, share: float, sums: SliceSums
) -> tuple[Patches, Scatter]:
    """Register upright returns of a chain to the pieces of walls.

    Args:
        placed: upright returns.
        walls: of these and other returns.
        poses: of the chain.
        correlated: how many returns share an error.
        share: factor on all weights.
        sums: are added to.

    Returns:
        Sums by patch, empty without coarse knots, and the scatter of the residuals.
    """
    coarse = poses.coarse
    groups = Groups(np.full(2 * len(walls.line), -1), np.zeros((2 * len(walls.line), 3)), np.zeros(5))
    patched = placed.xyz_m[: len(placed.t_s) if coarse.every else 0]
    patches = PatchRows.over(patched, WALL_PATCH_M, 64 if coarse.every else 0)
    row = np.empty(6)
    while patches.progress[0] < len(placed.t_s):
        _register(placed, walls, poses, correlated, share, sums, groups, patches, row)
        if patches.full:
            patches = patches.longer()
    for of in range(len(groups.second)):
        _close(groups.sums, of, groups.tally)
    return patches.filled(), Scatter(*groups.tally.tolist())


@kernel()
def select_upright(  # type: ignore[no-untyped-def]
    t_s, xyz_m, column, laser, rotation, lever_m, ground_m, stride
):
    """Time, place in the vehicle frame and laser of every `stride`-th firing's upright returns, and the count of all.

    The ground lies about `ground_m` above the vehicle frame's origin.
    """
    n = len(xyz_m)
    times = np.empty(n)
    lasers = np.empty(n, np.uint8)
    out = np.empty((n, 3), np.float32)
    kept = candidates = 0
    for i in range(n):
        px = xyz_m[i, 0]
        py = xyz_m[i, 1]
        pz = xyz_m[i, 2]
        z = rotation[2, 0] * px + rotation[2, 1] * py + rotation[2, 2] * pz + lever_m[2] - ground_m
        if not z > ABOVE_M:
            continue
        x = rotation[0, 0] * px + rotation[0, 1] * py + rotation[0, 2] * pz + lever_m[0]
        y = rotation[1, 0] * px + rotation[1, 1] * py + rotation[1, 2] * pz + lever_m[1]
        square = x * x + y * y
        if not MIN_WALL_RANGE_M * MIN_WALL_RANGE_M < square < MAX_WALL_RANGE_M * MAX_WALL_RANGE_M:
            continue
        if z < min(ABOVE_M + ABOVE_SLOPE * np.sqrt(square), ABOVE_MOST_M):
            continue
        candidates += 1
        if column[i] % stride == 0:
            times[kept] = t_s[i]
            lasers[kept] = laser[i]
            out[kept, 0] = x
            out[kept, 1] = y
            out[kept, 2] = z + ground_m
            kept += 1
    return (times[:kept], out[:kept], lasers[:kept]), candidates


@kernel_part()
def _number(xyz_m, tiles, number, count):  # type: ignore[no-untyped-def]
    """Number the columns in which points are, from `count` on; returns how many there are then."""
    for i in range(len(xyz_m)):
        x = int(np.floor(xyz_m[i, 0] / tiles.cell_m))
        y = int(np.floor(xyz_m[i, 1] / tiles.cell_m))
        tile, p, q = node_at(tiles, x, y)
        if tile >= 0 and number[tile, p, q] < 0:
            number[tile, p, q] = count
            count += 1
    return count


@kernel_part()
def _column(e, n, tiles, number):  # type: ignore[no-untyped-def]
    """Number of the column at a place, −1 where there is none, and the place against its centre."""
    x = int(np.floor(e / tiles.cell_m))
    y = int(np.floor(n / tiles.cell_m))
    tile, p, q = node_at(tiles, x, y)
    if tile < 0:
        return -1, 0.0, 0.0
    return number[tile, p, q], e - (x + 0.5) * tiles.cell_m, n - (y + 0.5) * tiles.cell_m


@kernel_part()
def _add(xyz_m, half, columns):  # type: ignore[no-untyped-def]
    for i in range(len(xyz_m)):
        c, e, n = _column(xyz_m[i, 0], xyz_m[i, 1], columns.tiles, columns.number)
        if c < 0:
            continue
        s = columns.sums[c, half[i]]
        s[0] += 1.0
        s[1] += e
        s[2] += n
        s[3] += e * e
        s[4] += e * n
        s[5] += n * n
        s[6] = min(s[6], xyz_m[i, 2])
        s[7] = max(s[7], xyz_m[i, 2])


@kernel()
def _fit(sums):  # type: ignore[no-untyped-def]
    count = len(sums)
    out = np.zeros((count, 2, 5))
    out[:, :, 4] = np.inf
    for c in range(count):
        for h in range(2):
            s = sums[c, h]
            if s[0] < MIN_COLUMN_RETURNS or s[7] - s[6] < MIN_COLUMN_HEIGHT_M:
                continue
            e = s[1] / s[0]
            n = s[2] / s[0]
            ee = s[3] / s[0] - e * e
            en = s[4] / s[0] - e * n
            nn = s[5] / s[0] - n * n
            middle = 0.5 * (ee + nn)
            half_way = np.hypot(0.5 * (ee - nn), en)
            across = max(middle - half_way, 0.0)
            along = middle + half_way
            if along < MIN_LINE_SIGMA_M**2 or across > MAX_LINE_SIGMA_M**2 or across > MAX_LINE_THICKNESS**2 * along:
                continue
            direction = 0.5 * np.arctan2(2.0 * en, ee - nn)
            ne = -np.sin(direction)
            nn = np.cos(direction)
            variance = across * (1.0 + 2.0 / s[0]) + MIN_WALL_SIGMA_M**2
            # A wall along the border of two columns would be cut in half lengthwise.
            reach = LINE_REACH_SIGMAS * np.sqrt(variance)
            if abs(e) + reach * abs(ne) > 0.5 * COLUMN_CELL_M or abs(n) + reach * abs(nn) > 0.5 * COLUMN_CELL_M:
                continue
            out[c, h, 0] = e
            out[c, h, 1] = n
            out[c, h, 2] = ne
            out[c, h, 3] = nn
            out[c, h, 4] = variance
    return out


@kernel_part(error_model="numpy")
def _register(placed, walls, poses, correlated, share, sums, groups, patches, row):  # type: ignore[no-untyped-def]
    """Register returns from the next one on, until all are or another patch would have no room; `row` (6,) is scratch.

    The residual is against the other half's line; with walls that move along, half-way to the own half's, along the
    other's normal.
    """
    begin = patches.progress[0]
    patches.progress[0] = len(placed.t_s)
    for i in range(begin, len(placed.t_s)):
        if poses.coarse.every > 0 and patches.progress[1] == len(patches.rows.interval):
            patches.progress[0] = i
            break
        t_s = placed.t_s[i]
        east_m = placed.xyz_m[i, 0]
        north_m = placed.xyz_m[i, 1]
        c, e, n = _column(east_m, north_m, walls.columns.tiles, walls.columns.number)
        if c < 0:
            continue
        other = walls.line[c, 1 - placed.half[i]]
        own = walls.line[c, placed.half[i]]
        variance = other[4]
        if not (np.isfinite(variance) and np.isfinite(own[4])):
            continue
        residual_m = other[2] * (e - other[0]) + other[3] * (n - other[1])
        normalised = residual_m / np.sqrt(variance)
        if abs(normalised) > WALL_GATE:
            continue
        residual_free_m = residual_m - 0.5 * (other[2] * (own[0] - other[0]) + other[3] * (own[1] - other[1]))
        weight = share / (variance * correlated)
        if abs(normalised) > WALL_HUBER:
            weight *= WALL_HUBER / abs(normalised)
        _count(groups, 2 * c + placed.half[i], int((t_s - poses.begin_s) / GROUP_S), normalised, variance)
        equation = PlaneEquation(other[2], other[3], 0.0, weight, residual_m, residual_free_m)
        add_equation(
            equation, t_s, east_m, north_m, placed.xyz_m[i, 2], WALL_LAYER, WALL_PATCH_M, poses, sums, patches, row
        )


@kernel_part(inline="always")
def _count(groups, of, second, normalised, variance):  # type: ignore[no-untyped-def]
    """Add a residual in standard deviations, clipped at WALL_HUBER, to its group, which begins with the second."""
    clipped = min(max(normalised, -WALL_HUBER), WALL_HUBER)
    groups.tally[3] += 1.0
    groups.tally[4] += clipped**2 * variance
    if second != groups.second[of]:
        _close(groups.sums, of, groups.tally)
        groups.second[of] = second
    groups.sums[of, 0] += 1.0
    groups.sums[of, 1] += clipped
    groups.sums[of, 2] += clipped * clipped


@kernel_part()
def _close(sums, of, tally):  # type: ignore[no-untyped-def]
    """Count a group of one column and one second, if it has four returns, and begin the next."""
    if sums[of, 0] >= 4.0:
        tally[0] += 1.0
        tally[1] += sums[of, 1] * sums[of, 1] / sums[of, 0]
        tally[2] += sums[of, 2] / sums[of, 0]
    sums[of, 0] = sums[of, 1] = sums[of, 2] = 0.0
