"""Registration of returns to the ground: residuals, robust weights, and the equations of the poses.

A return's height above the surface at its place is its residual. It changes with the pose by the surface's normal
n = (−∂S/∂x, −∂S/∂y, 1): height, roll and pitch through its upright part, easting, northing and yaw through the relief.
Slopes taken from a noisy surface are too steep and pull any estimate towards 'no movement' (regression dilution;
Fuller 1987, Measurement Error Models, section 1.1). They are therefore multiplied by their reliability, the share of
true relief in their variance. The product of the slopes in the two halves of the scans has the relief's variance as
its mean, because their noise is independent.
"""

from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from furrowmap.core.adjustment.coarse import CoarseGrid
from furrowmap.core.adjustment.knots import KNOT_STEP_S, Chain
from furrowmap.core.adjustment.registered_returns import (
    Patches,
    PatchRows,
    SliceSums,
    add_to_patch,
    add_to_slice,
    close_patches,
    plane_row,
)
from furrowmap.core.matching.height_grid import TILE_BITS, TILE_NODES, HeightGrid
from furrowmap.core.runtime.arrays import FloatArray
from furrowmap.core.runtime.kernels import kernel, kernel_part

NOISE_M: Final = 0.012
"""Standard deviation of a return's height against a surface: range noise, and relief finer than the cells."""
CORRELATED: Final = 10.0
"""Neighbouring returns that share an error (relief between the nodes, straw, a laser's own bias)."""
MATCHING_HUBER: Final = 2.5
GROUND_GATE: Final = 8.0
"""Normalised residuals beyond MATCHING_HUBER lose weight; returns beyond GROUND_GATE are not of the ground."""
SLOPE_TRIM: Final = 6.0
"""Slopes of more standard deviations, at the feet of walls and posts, do not count as relief: they are few, but would
make relief of the noise of smooth soil. The weight of a slope falls smoothly from half of this limit on."""
MIN_NODE_RETURNS: Final = 1.5
"""Returns that each of the four nodes must hold for a return to be registered."""


class Relief(NamedTuple):
    """Variances of the surface's slopes, by its two halves.

    Attributes:
        variance: of true slopes between nodes.
        noise: of slopes, as a multiple of what NOISE_M and the nodes' weights make of it.
        trim: slopes of more standard deviations do not count in the next tally.
    """

    variance: float = 0.005
    noise: float = 1.0
    trim: float = SLOPE_TRIM


class GroundSums(NamedTuple):
    """Sums over registered returns.

    Attributes:
        slices: equations of the poses.
        tally: (6,) 0 to 3 sums for :meth:`relief`: products and squares of slopes, count, expected squares of their
            noise; 4 and 5 count of returns and sum of squared residuals (m²), each clipped at HUBER standard
            deviations.
    """

    slices: SliceSums
    tally: FloatArray

    @classmethod
    def empty(cls, knots: int) -> "GroundSums":
        """No returns yet, for a number of knots."""
        return cls(SliceSums.empty(knots), np.zeros(6))

    def take(self, other: "GroundSums") -> None:
        """Add the other's sums to these."""
        self.slices.take(other.slices)
        self.tally[:] += other.tally

    def relief(self) -> Relief:
        """The relief by these sums; the default where they count no slopes."""
        products, squares, count, expected = self.tally[:4]
        if count == 0:
            return Relief()
        return Relief(max(products / count, 1e-5), max((squares - products) / expected, 0.3))


class PlacedReturns(NamedTuple):
    """Returns of one chain in the map.

    Attributes:
        t_s: (n,) times, increasing.
        xyz_m: (n, 3) against the local origin.
        layer: (n,) see :func:`~furrowmap.core.matching.height_grid.layers`.
        half: (n,) 0 or 1.
        weight: (n,) uint8 in the surface, 255 for a whole return; registration sets it to the robust weight.
    """

    t_s: FloatArray
    xyz_m: FloatArray
    layer: NDArray[np.int8]
    half: NDArray[np.uint8]
    weight: NDArray[np.uint8]


class ChainPoses(NamedTuple):
    """Where the equations of a chain's returns belong.

    Attributes:
        first: index of the chain's first knot among all.
        knots: of the chain, in equal steps.
        begin_s: time of its first knot.
        position_m: (n, 3) contiguous positions at all knots.
        coarse: coarse knots of the chain; NO_COARSE for a fixed reference.
    """

    first: int
    knots: int
    begin_s: float
    position_m: FloatArray
    coarse: CoarseGrid

    @classmethod
    def of(cls, chain: Chain, position_m: FloatArray, coarse: CoarseGrid) -> "ChainPoses":
        """Those of a chain."""
        return cls(chain.first, chain.count, chain.begin_s, position_m, coarse)


NO_COARSE: Final = CoarseGrid(0, 0, 1.0)


def register_ground(
    placed: PlacedReturns, surface: HeightGrid, poses: ChainPoses, relief: Relief, share: float, sums: GroundSums
) -> Patches:
    """Register returns of a chain to a surface.

    Args:
        placed: returns; their weights are set.
        surface: of these and other returns.
        poses: of the chain.
        relief: reliability of slopes.
        share: factor on all weights.
        sums: are added to.

    Returns:
        Sums by patch; empty without coarse knots.
    """
    coarse = poses.coarse
    patched = placed.xyz_m[: len(placed.t_s) if coarse.every else 0]
    patches = PatchRows.over(patched, coarse.patch_m, 1024 if coarse.every else 0)
    while patches.progress[0] < len(placed.t_s):
        _register(placed, surface, poses, relief, share, sums, patches)
        if patches.full:
            patches = patches.longer()
    return patches.filled()


@kernel(error_model="numpy", fastmath={"contract", "nsz"})
def _register(placed, surface, poses, relief, share, sums, patches):  # type: ignore[no-untyped-def]
    """Register returns from the next one on, until all are or another patch would have no room."""
    # Arrays are taken out of the tuples before the loop: numba counts a reference each time that it takes one.
    t_s = placed.t_s
    xyz_m = placed.xyz_m
    layer = placed.layer
    half = placed.half
    robust = placed.weight
    height_m = surface.height_m
    weight = surface.weight
    tiles = surface.tiles
    number = tiles.number
    rows, columns = number.shape
    position_m = poses.position_m
    every = poses.coarse.every
    patch_m = poses.coarse.patch_m
    normal = sums.slices.normal
    right = sums.slices.right
    right_free = sums.slices.right_free
    used = sums.slices.returns
    tally = sums.tally
    slots = patches.slots
    place = patches.rows.place
    interval_of = patches.rows.interval
    early = patches.rows.early
    late = patches.rows.late
    pull = patches.rows.right
    progress = patches.progress
    begin = progress[0]
    filled = progress[1]
    opened = progress[2]
    now = progress[3]
    n = len(t_s)
    progress[0] = n
    variance = NOISE_M * NOISE_M
    per_cell = 1.0 / tiles.cell_m
    node = np.empty((2, 4))
    full = np.empty((2, 4))
    mean = np.empty(4)
    row6 = np.empty(6)
    for i in range(begin, n):
        if every > 0 and filled == len(interval_of):
            progress[0] = i
            break
        robust[i] = 255
        if layer[i] < 0:
            continue
        u = xyz_m[i, 0] * per_cell
        s = xyz_m[i, 1] * per_cell
        x = int(np.floor(u))
        y = int(np.floor(s))
        u -= x
        s -= y
        other = 2 * layer[i] + 1 - half[i]
        own = 2 * layer[i] + half[i]
        least = least_own = 1e9
        for c in range(4):
            p = y + c // 2
            q = x + c % 2
            row = (p >> TILE_BITS) - tiles.south
            column = (q >> TILE_BITS) - tiles.west
            tile = -1
            if 0 <= row < rows and 0 <= column < columns:
                tile = number[row, column]
            if tile < 0:
                least = 0.0
                break
            p = p & TILE_NODES - 1
            q = q & TILE_NODES - 1
            full[0, c] = weight[tile, other, p, q]
            full[1, c] = weight[tile, own, p, q]
            node[0, c] = height_m[tile, other, p, q]
            node[1, c] = height_m[tile, own, p, q]
            least = min(least, full[0, c])
            least_own = min(least_own, full[1, c])
        if least < MIN_NODE_RETURNS:
            continue
        a0 = 1.0 - u
        a1 = u
        b0 = 1.0 - s
        b1 = s
        ground = b0 * (a0 * node[0, 0] + a1 * node[0, 1]) + b1 * (a0 * node[0, 2] + a1 * node[0, 3])
        residual = xyz_m[i, 2] - ground
        i0 = 1.0 / full[0, 0]
        i1 = 1.0 / full[0, 1]
        i2 = 1.0 / full[0, 2]
        i3 = 1.0 / full[0, 3]
        spread = variance * (1.0 + max(max(i0, i1), max(i2, i3)))
        certain = 1.0 / spread
        normalised = np.sqrt(residual * residual * certain)
        if normalised > GROUND_GATE:
            robust[i] = 0
            continue
        slope_x = (b0 * (node[0, 1] - node[0, 0]) + b1 * (node[0, 3] - node[0, 2])) * per_cell
        slope_y = (a0 * (node[0, 2] - node[0, 0]) + a1 * (node[0, 3] - node[0, 1])) * per_cell
        scale = variance * per_cell * per_cell
        noise_x = scale * (b0 * b0 * (i0 + i1) + b1 * b1 * (i2 + i3))
        noise_y = scale * (a0 * a0 * (i0 + i2) + a1 * a1 * (i1 + i3))
        true_x = 1.0 / (relief.variance + relief.noise * noise_x)
        true_y = 1.0 / (relief.variance + relief.noise * noise_y)
        tally[4] += 1
        tally[5] += min(normalised, MATCHING_HUBER) ** 2 * spread
        if normalised < 3.0 and least_own >= MIN_NODE_RETURNS:
            again_x = (b0 * (node[1, 1] - node[1, 0]) + b1 * (node[1, 3] - node[1, 2])) * per_cell
            again_y = (a0 * (node[1, 2] - node[1, 0]) + a1 * (node[1, 3] - node[1, 1])) * per_cell
            steep_x = max(slope_x * slope_x, again_x * again_x) * true_x
            steep_y = max(slope_y * slope_y, again_y * again_y) * true_y
            counts = _counts(np.sqrt(max(steep_x, steep_y)), relief.trim)
            tally[0] += counts * 0.5 * (slope_x * again_x + slope_y * again_y)
            tally[1] += counts * 0.5 * (slope_x * slope_x + slope_y * slope_y)
            tally[2] += counts
            tally[3] += counts * 0.5 * (noise_x + noise_y)
        slope_x *= relief.variance * true_x
        slope_y *= relief.variance * true_y
        w = share / CORRELATED * certain
        if normalised > MATCHING_HUBER:
            w *= MATCHING_HUBER / normalised
            robust[i] = np.uint8(255.0 * MATCHING_HUBER / normalised)
        for c in range(4):
            mean[c] = (full[0, c] * node[0, c] + full[1, c] * node[1, c]) / (full[0, c] + full[1, c])
        residual_free = xyz_m[i, 2] - (b0 * (a0 * mean[0] + a1 * mean[1]) + b1 * (a0 * mean[2] + a1 * mean[3]))

        local = min(int((t_s[i] - poses.begin_s) / KNOT_STEP_S), poses.knots - 2)
        k = poses.first + local
        qx = xyz_m[i, 0] - 0.5 * (position_m[k, 0] + position_m[k + 1, 0])
        qy = xyz_m[i, 1] - 0.5 * (position_m[k, 1] + position_m[k + 1, 1])
        qz = xyz_m[i, 2] - 0.5 * (position_m[k, 2] + position_m[k + 1, 2])
        plane_row(row6, -slope_x, -slope_y, 1.0, qx, qy, qz)
        add_to_slice(normal, right, right_free, k, row6, w, residual, residual_free)
        used[k] += 1

        if every == 0:
            continue
        interval = local // every
        late_share = (local + 0.5) / every - interval
        if interval != now:
            close_patches(slots, place, opened, filled, patches.west, patches.south)
            now = interval
            opened = filled
        px = int(np.floor(xyz_m[i, 0] / patch_m))
        py = int(np.floor(xyz_m[i, 1] / patch_m))
        c = slots[layer[i], py - patches.south, px - patches.west]
        if c < 0:
            c = slots[layer[i], py - patches.south, px - patches.west] = filled
            place[c, 0] = px
            place[c, 1] = py
            place[c, 2] = layer[i]
            interval_of[c] = poses.coarse.first + interval
            filled += 1
        lx = xyz_m[i, 0] - (px + 0.5) * patch_m
        ly = xyz_m[i, 1] - (py + 0.5) * patch_m
        lz = xyz_m[i, 2]
        plane_row(row6, -slope_x, -slope_y, 1.0, lx, ly, lz)
        add_to_patch(early, late, pull, c, row6, w, late_share, residual_free)
    progress[1] = filled
    progress[2] = opened
    progress[3] = now


@kernel_part()
def _counts(steep, trim):  # type: ignore[no-untyped-def]
    """Weight of a slope in standard deviations: 1 up to half of `trim`, smoothly less beyond."""
    if steep <= 0.5 * trim:
        return 1.0
    left = max(0.0, 2.0 * (1.0 - steep / trim))
    return left * left * (3.0 - 2.0 * left)
