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
from furrowmap.core.adjustment.knots import Chain
from furrowmap.core.adjustment.registered_returns import (
    Patches,
    PatchRows,
    PlaneEquation,
    SliceSums,
    add_equation,
)
from furrowmap.core.matching.height_grid import (
    Corners,
    HeightGrid,
    cell_at,
    corners,
    corners_from_ne,
    least,
    nodes_round,
)
from furrowmap.core.runtime.arrays import FloatArray
from furrowmap.core.runtime.kernels import kernel_part

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
    row = np.empty(6)
    while patches.progress[0] < len(placed.t_s):
        _register(placed, surface, poses, relief, share, sums, patches, row)
        if patches.full:
            patches = patches.longer()
    return patches.filled()


@kernel_part(error_model="numpy", fastmath={"contract", "nsz"})
def _register(placed, surface, poses, relief, share, sums, patches, row):  # type: ignore[no-untyped-def]
    """Register returns from the next one on, until all are or another patch would have no room; `row` (6,) is scratch.

    The residual is against the other half's surface; with surfaces that move along, against that of both halves.
    """
    per_cell = 1.0 / surface.tiles.cell_m
    begin = patches.progress[0]
    patches.progress[0] = len(placed.t_s)
    for i in range(begin, len(placed.t_s)):
        if poses.coarse.every > 0 and patches.progress[1] == len(patches.rows.interval):
            patches.progress[0] = i
            break
        placed.weight[i] = 255
        layer = placed.layer[i]
        if layer < 0:
            continue
        east_m = placed.xyz_m[i, 0]
        north_m = placed.xyz_m[i, 1]
        up_m = placed.xyz_m[i, 2]
        x, y, u, s = cell_at(east_m * per_cell, north_m * per_cell)
        nodes, known = nodes_round(surface.tiles, x, y)
        if not known:
            continue
        other = 2 * layer + 1 - placed.half[i]
        own = 2 * layer + placed.half[i]
        # Rounding depends on the order of loading here and below; see corners_from_ne.
        count = corners_from_ne(surface.weight, nodes, other)
        if least(count) < MIN_NODE_RETURNS:
            continue
        height_m = corners(surface.height_m, nodes, other)
        height_own_m = corners_from_ne(surface.height_m, nodes, own)
        count_own = corners(surface.weight, nodes, own)

        residual_m = up_m - _bilinear(height_m, u, s)
        variance = residual_variance(least(count))
        certain = 1.0 / variance
        normalised = np.sqrt(residual_m * residual_m * certain)
        if normalised > GROUND_GATE:
            placed.weight[i] = 0
            continue
        slope_x, slope_y = _slopes(height_m, u, s, per_cell)
        noise_x, noise_y = _slope_variances(count, u, s, per_cell)
        true_x = 1.0 / (relief.variance + relief.noise * noise_x)
        true_y = 1.0 / (relief.variance + relief.noise * noise_y)
        sums.tally[4] += 1
        sums.tally[5] += min(normalised, MATCHING_HUBER) ** 2 * variance
        if normalised < 3.0 and least(count_own) >= MIN_NODE_RETURNS:
            again_x, again_y = _slopes(height_own_m, u, s, per_cell)
            steep_x = max(slope_x * slope_x, again_x * again_x) * true_x
            steep_y = max(slope_y * slope_y, again_y * again_y) * true_y
            counts = _counts(np.sqrt(max(steep_x, steep_y)), relief.trim)
            sums.tally[0] += counts * 0.5 * (slope_x * again_x + slope_y * again_y)
            sums.tally[1] += counts * 0.5 * (slope_x * slope_x + slope_y * slope_y)
            sums.tally[2] += counts
            sums.tally[3] += counts * 0.5 * (noise_x + noise_y)
        slope_x *= relief.variance * true_x
        slope_y *= relief.variance * true_y
        weight = share / CORRELATED * certain
        if normalised > MATCHING_HUBER:
            weight *= MATCHING_HUBER / normalised
            placed.weight[i] = np.uint8(255.0 * MATCHING_HUBER / normalised)
        residual_free_m = up_m - _bilinear(_mean(height_m, count, height_own_m, count_own), u, s)
        equation = PlaneEquation(-slope_x, -slope_y, 1.0, weight, residual_m, residual_free_m)
        patch_m = poses.coarse.patch_m
        add_equation(equation, placed.t_s[i], east_m, north_m, up_m, layer, patch_m, poses, sums.slices, patches, row)


# Inlined by numba, so that the arithmetic is that of the kernel which calls them.
@kernel_part(inline="always")
def residual_variance(count):  # type: ignore[no-untyped-def]
    """Variance of a residual in m²: σ² (1 + 1 / n), with n the returns in the poorest of the nodes."""
    return NOISE_M * NOISE_M * (1.0 + 1.0 / count)


@kernel_part(inline="always")
def _bilinear(height_m, u, s):  # type: ignore[no-untyped-def]
    """The surface S(u, s) = (1 − s) ((1 − u) h_sw + u h_se) + s ((1 − u) h_nw + u h_ne)."""
    south = (1.0 - u) * height_m.sw + u * height_m.se
    north = (1.0 - u) * height_m.nw + u * height_m.ne
    return (1.0 - s) * south + s * north


@kernel_part(inline="always")
def _slopes(height_m, u, s, per_cell):  # type: ignore[no-untyped-def]
    """∂S/∂x and ∂S/∂y of the bilinear surface."""
    slope_x = ((1.0 - s) * (height_m.se - height_m.sw) + s * (height_m.ne - height_m.nw)) * per_cell
    slope_y = ((1.0 - u) * (height_m.nw - height_m.sw) + u * (height_m.ne - height_m.se)) * per_cell
    return slope_x, slope_y


@kernel_part(inline="always")
def _slope_variances(count, u, s, per_cell):  # type: ignore[no-untyped-def]
    """Variances of both slopes, which are linear in heights of variance σ² / n."""
    scale = NOISE_M * NOISE_M * per_cell * per_cell
    sw = 1.0 / count.sw
    se = 1.0 / count.se
    nw = 1.0 / count.nw
    ne = 1.0 / count.ne
    noise_x = scale * ((1.0 - s) * (1.0 - s) * (sw + se) + s * s * (nw + ne))
    noise_y = scale * ((1.0 - u) * (1.0 - u) * (sw + nw) + u * u * (se + ne))
    return noise_x, noise_y


@kernel_part(inline="always")
def _mean(height_m, count, height_own_m, count_own):  # type: ignore[no-untyped-def]
    """Heights of both halves together: (n h + n' h') / (n + n')."""
    return Corners(
        (count.sw * height_m.sw + count_own.sw * height_own_m.sw) / (count.sw + count_own.sw),
        (count.se * height_m.se + count_own.se * height_own_m.se) / (count.se + count_own.se),
        (count.nw * height_m.nw + count_own.nw * height_own_m.nw) / (count.nw + count_own.nw),
        (count.ne * height_m.ne + count_own.ne * height_own_m.ne) / (count.ne + count_own.ne),
    )


@kernel_part()
def _counts(steep, trim):  # type: ignore[no-untyped-def]
    """Weight of a slope in standard deviations: 1 up to half of `trim`, smoothly less beyond."""
    if steep <= 0.5 * trim:
        return 1.0
    left = max(0.0, 2.0 * (1.0 - steep / trim))
    return left * left * (3.0 - 2.0 * left)
