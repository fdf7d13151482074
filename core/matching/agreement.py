"""How well returns agree with the ground, and which movement of the poses would make them agree better.

A return's height above the surface at its place is its residual. It changes with the pose by the surface's normal
n = (−∂S/∂x, −∂S/∂y, 1): height, roll and pitch through its upright part, easting, northing and yaw through the relief.
Slopes taken from a noisy surface are too steep and pull any estimate towards 'no movement' (regression dilution;
Fuller 1987, Measurement Error Models, section 1.1). They are therefore multiplied by their reliability, the share of
true relief in their variance, which the two halves of the scans tell: what both show alike is relief.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numba
import numpy as np
from numpy.typing import NDArray

from furrowmap.core.estimation.knots import STEP_S, Chain
from furrowmap.core.matching.surface import TILE, TILE_BITS, Surface

FloatArray = NDArray[np.float64]

NOISE_M: Final = 0.012
"""Of one return's height against a surface: range noise, and relief finer than the cells."""
CORRELATED: Final = 10.0
"""So many neighbouring returns share an error (relief between the nodes, straw, a laser's own bias)."""
HUBER: Final = 2.5
GATE: Final = 8.0
"""Residuals beyond HUBER standard deviations lose weight, beyond GATE they are not of the ground."""
TRIM: Final = 6.0
"""Slopes of more standard deviations, at the feet of walls and posts, do not count as relief: they are few, and would
make true slopes of the noise that smooth soil shows everywhere else. Those of more than half as many count less and
less, so that no single slope makes a difference by coming just below the limit."""
LEAST_WEIGHT: Final = 1.5
"""Returns that each of the four nodes must hold before anything is matched to them."""
UPPER: Final = 21
"""Entries of a symmetric 6 × 6 matrix."""


@dataclass(frozen=True)
class Relief:
    """What the two halves of the scans say about slopes of the surface, by the square.

    Attributes:
        variance: of true slopes between nodes.
        noise: of slopes, as a multiple of what NOISE_M and the nodes' weights make of it.
        trim: slopes of more standard deviations do not count in the next tally, of more than half as many less.
    """

    variance: float = 0.005
    noise: float = 1.0
    trim: float = TRIM

    @classmethod
    def of(cls, tally: FloatArray, trim: float = TRIM) -> Relief:
        """What a tally says, see :class:`Sums`; the usual where it counts nothing."""
        products, squares, count, expected = tally[:4]
        if count == 0:
            return cls(trim=trim)
        return cls(max(products / count, 1e-5), max((squares - products) / expected, 0.3), trim)


@dataclass(frozen=True)
class Sums:
    """What returns say about the poses of the slices between knots.

    A slice's unknowns are position and rotation vector (map axes) of the pose half-way between its two knots.

    Attributes:
        normal: (n, 21) upper triangles of the normal matrices, row by row.
        right: (n, 6) right-hand sides against the other half's surface.
        right_all: (n, 6) the same against the surface of both halves.
        count: (n,) returns that took part.
        tally: (7,) 0 to 3 sums for :class:`Relief`; 5 and 6 count and sum of squared residuals (m²), none counted for
            more than HUBER standard deviations; 4 is free.
    """

    normal: FloatArray
    right: FloatArray
    right_all: FloatArray
    count: NDArray[np.int64]
    tally: FloatArray

    @classmethod
    def of(cls, knots: int) -> Sums:
        """Nothing yet for so many knots."""
        return cls(
            np.zeros((knots, UPPER)),
            np.zeros((knots, 6)),
            np.zeros((knots, 6)),
            np.zeros(knots, np.int64),
            np.zeros(7),
        )

    def plus(self, other: Sums) -> Sums:
        """Both together."""
        return Sums(
            self.normal + other.normal,
            self.right + other.right,
            self.right_all + other.right_all,
            self.count + other.count,
            self.tally + other.tally,
        )

    def relief(self) -> Relief:
        """What these sums say about the relief."""
        return Relief.of(self.tally)


@dataclass(frozen=True)
class Patches:
    """Sums by patch of the ground and interval of the coarse knots, for :mod:`furrowmap.core.matching.coarse`.

    Attributes:
        place: (m, 3) int64 column, row and layer of the patch.
        interval: (m,) int64 index of the coarse knot before.
        early: (m, 21) Σ w (1 − s) g gᵀ, with s the share of the way to the next coarse knot and g = (n, p × n) about
            the patch's centre at the local origin's height; upper triangles, row by row.
        late: (m, 21) Σ w s g gᵀ.
        right: (m, 6) −Σ w g r, with r against the surface of both halves.
    """

    place: NDArray[np.int64]
    interval: NDArray[np.int64]
    early: FloatArray
    late: FloatArray
    right: FloatArray


@dataclass(frozen=True)
class CoarseGrid:
    """How the coarse knots of a chain lie.

    Attributes:
        first: index of the chain's first coarse knot.
        every: knots from one coarse knot to the next; 0 where no patches are wanted.
        patch_m: side of the patches.
    """

    first: int
    every: int
    patch_m: float


def agree(
    chain: Chain,
    t_s: FloatArray,
    xyz_m: FloatArray,
    layer: NDArray[np.int8],
    half: NDArray[np.uint8],
    trust: NDArray[np.uint8],
    surface: Surface,
    position_m: FloatArray,
    relief: Relief,
    share: float,
    sums: Sums,
    coarse: CoarseGrid,
) -> Patches:
    """Match returns of a chain to a surface.

    Args:
        chain: that covers them.
        t_s: (n,) times, increasing.
        xyz_m: (n, 3) placed, against the local origin.
        layer: (n,) see :func:`~furrowmap.core.matching.surface.layers`.
        half: (n,) 0 or 1.
        trust: (n,) uint8, is set: weight in the next surface, 255 for a whole return.
        surface: of these and other returns.
        position_m: (knots, 3) positions at all knots.
        relief: reliability of slopes.
        share: factor on all weights.
        sums: are added to.
        coarse: knots and patches of the coarse unknowns.

    Returns:
        Sums by patch; empty where `coarse` wants none.
    """
    tiles = surface.tiles
    place, interval, early, late, right = _agree(
        t_s,
        xyz_m,
        layer,
        half,
        trust,
        chain.first,
        chain.count,
        chain.begin_s,
        tiles.cell_m,
        tiles.west,
        tiles.south,
        tiles.number,
        surface.height_m,
        surface.weight,
        position_m,
        relief.variance,
        relief.noise,
        relief.trim,
        share,
        sums.normal,
        sums.right,
        sums.right_all,
        sums.count,
        sums.tally,
        coarse.first,
        coarse.every,
        coarse.patch_m,
    )
    return Patches(place, interval, early, late, right)


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _agree(  # type: ignore[no-untyped-def]
    t_s,
    xyz_m,
    layer,
    half,
    trust,
    first,
    count,
    begin_s,
    cell_m,
    west,
    south,
    number,
    height,
    weight,
    position_m,
    relief,
    noise,
    trim,
    share,
    normal,
    right,
    right_all,
    used,
    tally,
    first_coarse,
    every,
    patch_m,
):
    n = len(t_s)
    rows, columns = number.shape
    # Only these returns' own extent: that of the whole surface grows with the way to the field.
    patch_west = patch_south = patch_columns = patch_rows = 0
    if every > 0 and n > 0:
        patch_west = int(np.floor(xyz_m[:, 0].min() / patch_m))
        patch_south = int(np.floor(xyz_m[:, 1].min() / patch_m))
        patch_columns = int(np.floor(xyz_m[:, 0].max() / patch_m)) - patch_west + 1
        patch_rows = int(np.floor(xyz_m[:, 1].max() / patch_m)) - patch_south + 1
    slot = np.full((2, patch_rows, patch_columns), -1, np.int64)
    room = 1024
    out_place = np.empty((room, 3), np.int64)
    out_interval = np.empty(room, np.int64)
    early = np.zeros((room, UPPER))
    late = np.zeros((room, UPPER))
    out_right = np.zeros((room, 6))
    patches = opened = 0
    now = -1
    variance = NOISE_M * NOISE_M
    node = np.empty((2, 4))
    full = np.empty((2, 4))
    mean = np.empty(4)
    j = np.empty(6)
    g = np.empty(6)
    for i in range(n):
        trust[i] = 255
        if layer[i] < 0:
            continue
        u, s = xyz_m[i, 0] / cell_m, xyz_m[i, 1] / cell_m
        x, y = int(np.floor(u)), int(np.floor(s))
        u -= x
        s -= y
        other, own = 2 * layer[i] + 1 - half[i], 2 * layer[i] + half[i]
        least = least_own = 1e9
        for c in range(4):
            p, q = y + c // 2, x + c % 2
            row, column = (p >> TILE_BITS) - south, (q >> TILE_BITS) - west
            tile = -1
            if 0 <= row < rows and 0 <= column < columns:
                tile = number[row, column]
            if tile < 0:
                least = 0.0
                break
            p, q = p & TILE - 1, q & TILE - 1
            full[0, c], full[1, c] = weight[tile, other, p, q], weight[tile, own, p, q]
            node[0, c], node[1, c] = height[tile, other, p, q], height[tile, own, p, q]
            least = min(least, full[0, c])
            least_own = min(least_own, full[1, c])
        if least < LEAST_WEIGHT:
            continue
        a0, a1, b0, b1 = 1.0 - u, u, 1.0 - s, s
        ground = b0 * (a0 * node[0, 0] + a1 * node[0, 1]) + b1 * (a0 * node[0, 2] + a1 * node[0, 3])
        residual = xyz_m[i, 2] - ground
        spread = variance * (1.0 + 1.0 / least)
        normed = abs(residual) / np.sqrt(spread)
        if normed > GATE:
            trust[i] = 0
            continue
        slope_x = (b0 * (node[0, 1] - node[0, 0]) + b1 * (node[0, 3] - node[0, 2])) / cell_m
        slope_y = (a0 * (node[0, 2] - node[0, 0]) + a1 * (node[0, 3] - node[0, 1])) / cell_m
        scale = variance / (cell_m * cell_m)
        noise_x = scale * (b0 * b0 * (1 / full[0, 0] + 1 / full[0, 1]) + b1 * b1 * (1 / full[0, 2] + 1 / full[0, 3]))
        noise_y = scale * (a0 * a0 * (1 / full[0, 0] + 1 / full[0, 2]) + a1 * a1 * (1 / full[0, 1] + 1 / full[0, 3]))
        tally[5] += 1
        tally[6] += min(normed, HUBER) ** 2 * spread
        if normed < 3.0 and least_own >= LEAST_WEIGHT:
            again_x = (b0 * (node[1, 1] - node[1, 0]) + b1 * (node[1, 3] - node[1, 2])) / cell_m
            again_y = (a0 * (node[1, 2] - node[1, 0]) + a1 * (node[1, 3] - node[1, 1])) / cell_m
            steep_x = max(slope_x * slope_x, again_x * again_x) / (relief + noise * noise_x)
            steep_y = max(slope_y * slope_y, again_y * again_y) / (relief + noise * noise_y)
            counts = _counts(np.sqrt(max(steep_x, steep_y)), trim)
            tally[0] += counts * 0.5 * (slope_x * again_x + slope_y * again_y)
            tally[1] += counts * 0.5 * (slope_x * slope_x + slope_y * slope_y)
            tally[2] += counts
            tally[3] += counts * 0.5 * (noise_x + noise_y)
        slope_x *= relief / (relief + noise * noise_x)
        slope_y *= relief / (relief + noise * noise_y)
        w = share / (spread * CORRELATED)
        if normed > HUBER:
            w *= HUBER / normed
            trust[i] = np.uint8(255.0 * HUBER / normed)
        for c in range(4):
            mean[c] = (full[0, c] * node[0, c] + full[1, c] * node[1, c]) / (full[0, c] + full[1, c])
        residual_all = xyz_m[i, 2] - (b0 * (a0 * mean[0] + a1 * mean[1]) + b1 * (a0 * mean[2] + a1 * mean[3]))

        local = min(int((t_s[i] - begin_s) / STEP_S), count - 2)
        k = first + local
        qx = xyz_m[i, 0] - 0.5 * (position_m[k, 0] + position_m[k + 1, 0])
        qy = xyz_m[i, 1] - 0.5 * (position_m[k, 1] + position_m[k + 1, 1])
        qz = xyz_m[i, 2] - 0.5 * (position_m[k, 2] + position_m[k + 1, 2])
        j[0], j[1], j[2] = -slope_x, -slope_y, 1.0
        j[3], j[4], j[5] = qy + qz * slope_y, -qz * slope_x - qx, -qx * slope_y + qy * slope_x
        e = 0
        for a in range(6):
            weighted = w * j[a]
            right[k, a] -= weighted * residual
            right_all[k, a] -= weighted * residual_all
            for b in range(a, 6):
                normal[k, e] += weighted * j[b]
                e += 1
        used[k] += 1

        if every == 0:
            continue
        interval = local // every
        late_share = (local + 0.5) / every - interval
        if interval != now:
            for c in range(opened, patches):
                slot[out_place[c, 2], out_place[c, 1] - patch_south, out_place[c, 0] - patch_west] = -1
            now, opened = interval, patches
        px, py = int(np.floor(xyz_m[i, 0] / patch_m)), int(np.floor(xyz_m[i, 1] / patch_m))
        c = slot[layer[i], py - patch_south, px - patch_west]
        if c < 0:
            if patches == room:
                room *= 2
                out_place = _longer_int(out_place, room)
                out_interval = np.concatenate((out_interval, np.empty(room // 2, np.int64)))
                early = _longer(early, room)
                late = _longer(late, room)
                out_right = _longer(out_right, room)
            c = patches
            patches += 1
            slot[layer[i], py - patch_south, px - patch_west] = c
            out_place[c, 0], out_place[c, 1], out_place[c, 2] = px, py, layer[i]
            out_interval[c] = first_coarse + interval
        lx, ly, lz = xyz_m[i, 0] - (px + 0.5) * patch_m, xyz_m[i, 1] - (py + 0.5) * patch_m, xyz_m[i, 2]
        g[0], g[1], g[2] = -slope_x, -slope_y, 1.0
        g[3], g[4], g[5] = ly + lz * slope_y, -lz * slope_x - lx, -lx * slope_y + ly * slope_x
        e = 0
        for a in range(6):
            weighted = w * g[a]
            out_right[c, a] -= weighted * residual_all
            for b in range(a, 6):
                entry = weighted * g[b]
                early[c, e] += (1.0 - late_share) * entry
                late[c, e] += late_share * entry
                e += 1
    return out_place[:patches], out_interval[:patches], early[:patches], late[:patches], out_right[:patches]


@numba.njit(cache=True, nogil=True)
def _counts(steep, trim):  # type: ignore[no-untyped-def]
    """How much a slope of so many standard deviations counts: wholly up to half of `trim`, smoothly less beyond."""
    if steep <= 0.5 * trim:
        return 1.0
    left = max(0.0, 2.0 * (1.0 - steep / trim))
    return left * left * (3.0 - 2.0 * left)


@numba.njit(cache=True, nogil=True)
def _longer(array, rows):  # type: ignore[no-untyped-def]
    out = np.zeros((rows, array.shape[1]))
    out[: len(array)] = array
    return out


@numba.njit(cache=True, nogil=True)
def _longer_int(array, rows):  # type: ignore[no-untyped-def]
    out = np.zeros((rows, array.shape[1]), np.int64)
    out[: len(array)] = array
    return out
