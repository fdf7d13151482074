"""The same ground on two dates: differences of height by patches, and what shift in place they show."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy.ndimage import uniform_filter

from furrowmap.core.runtime.arrays import Float32Array, FloatArray
from furrowmap.core.runtime.kernels import kernel

TIE_PATCH_M: Final = 1.0
"""Side of the patches."""
MIN_PATCH_CELLS: Final = 60
PATCH_SUMS: Final = 14
MAX_SLOPE: Final = 1.0
"""Steeper cells are rims of things that stand."""


@dataclass(frozen=True)
class GroundPair:
    """A piece of ground on two dates: (rows, columns) float32 heights, nan where unknown or touched by a tool since."""

    west_m: float
    north_m: float
    cell_m: float
    one: Float32Array
    other: Float32Array


@dataclass(frozen=True)
class DifferencePatches:
    """Sums over the common cells of patches.

    Attributes:
        count: (p,) cells.
        xy_m: (p, 2) mean easting and northing.
        difference_m: (p,) mean height on the second date less that on the first.
        variance_m2: (p,) of the differences in a patch.
        relief: (p, 2, 2) sums of slopes on one date times slopes on the other, by easting and northing, about their
            means; its expectation is that of the relief that both saw, without their noise.
        seen_m: (p, 2) sums of mean slopes times differences, likewise.
    """

    count: FloatArray
    xy_m: FloatArray
    difference_m: FloatArray
    variance_m2: FloatArray
    relief: FloatArray
    seen_m: FloatArray

    def __len__(self) -> int:
        return len(self.count)


def smooth_pair(pair: GroundPair, cells: int) -> GroundPair:
    """A piece whose heights are means over squares of so many cells a side, of those that are known."""
    if cells == 1:
        return pair
    return GroundPair(pair.west_m, pair.north_m, pair.cell_m, _mean(pair.one, cells), _mean(pair.other, cells))


def _mean(height: Float32Array, cells: int) -> Float32Array:
    known = np.isfinite(height)
    base = np.float32(np.median(height[known])) if known.any() else np.float32(0.0)
    share = uniform_filter(known.astype(np.float32), cells, mode="constant")
    total = uniform_filter(np.where(known, height - base, np.float32(0.0)), cells, mode="constant")
    with np.errstate(invalid="ignore", divide="ignore"):
        out: Float32Array = np.where(known, total / share + base, np.float32(np.nan)).astype(np.float32)
    return out


def sum_differences(
    pairs: Sequence[GroundPair], middle_m: FloatArray, shift: FloatArray, trend: FloatArray, limit_m: float
) -> DifferencePatches:
    """Sum up differences, the second date's surface moved by a shift.

    Args:
        middle_m: (2,) easting and northing that turns are about.
        shift: (3,) by which the second date's surface is moved east and north (m), and turned counter-clockwise (rad).
        trend: (3,) differences that are expected: at the middle (m), and their change per metre east and north.
        limit_m: cells whose difference is farther from that do not count.
    """
    parts = [np.zeros((0, PATCH_SUMS))]
    for pair in pairs:
        rows, columns = pair.one.shape
        side = max(round(TIE_PATCH_M / pair.cell_m), 1)
        across = -(-columns // side)
        parts.append(np.zeros((-(-rows // side) * across, PATCH_SUMS)))
        west, north = pair.west_m - middle_m[0], pair.north_m - middle_m[1]
        _sum(pair.one, pair.other, west, north, pair.cell_m, shift, trend, limit_m, side, across, parts[-1])
    sums = np.concatenate(parts)
    sums = sums[sums[:, 0] >= MIN_PATCH_CELLS]
    n = sums[:, 0]
    x, y, r, square, ax, ay, bx, by = (sums[:, 1:9] / n[:, None]).T
    xx, xy, yy, rx, ry = (sums[:, 9:] / n[:, None]).T
    cross = xy - 0.5 * (ax * by + ay * bx)
    relief = np.stack([np.stack([xx - ax * bx, cross], -1), np.stack([cross, yy - ay * by], -1)], -2)
    seen = np.stack([rx - 0.5 * (ax + bx) * r, ry - 0.5 * (ay + by) * r], -1)
    return DifferencePatches(
        n,
        np.stack([x, y], -1) + middle_m,
        r,
        np.maximum(square - r**2, 0.0),
        relief * n[:, None, None],
        seen * n[:, None],
    )


@kernel()
def _sum(one, other, west, north, cell, shift, trend, limit, side, across, sums):  # type: ignore[no-untyped-def]
    """Sums: cells, east, north, difference, its square, slopes (4), their products (3), and with differences (2)."""
    rows, columns = one.shape
    for i in range(1, rows - 1):
        y = north - (i + 0.5) * cell
        for j in range(1, columns - 1):
            a = one[i, j]
            if not np.isfinite(a):
                continue
            x = west + (j + 0.5) * cell
            # the moved surface at (x, y) is that which was measured at (x, y) less the shift
            u = j - (shift[0] - shift[2] * y) / cell
            v = i + (shift[1] + shift[2] * x) / cell
            p, q = int(np.floor(v)), int(np.floor(u))
            if p < 1 or q < 1 or p + 2 >= rows or q + 2 >= columns:
                continue
            fv, fu = v - p, u - q
            b = gx = gy = 0.0
            for k in range(2):
                for m in range(2):
                    w = (fv if k else 1.0 - fv) * (fu if m else 1.0 - fu)
                    b += w * other[p + k, q + m]
                    gx += w * (other[p + k, q + m + 1] - other[p + k, q + m - 1])
                    gy += w * (other[p + k - 1, q + m] - other[p + k + 1, q + m])
            # products of the slopes of one date with those of the other: noise of neither biases the shift
            bx, by = gx / (2.0 * cell), gy / (2.0 * cell)
            ax = (one[i, j + 1] - one[i, j - 1]) / (2.0 * cell)
            ay = (one[i - 1, j] - one[i + 1, j]) / (2.0 * cell)
            gx, gy = 0.5 * (ax + bx), 0.5 * (ay + by)
            r = b - a
            if not (np.isfinite(r) and np.isfinite(gx) and np.isfinite(gy)) or gx * gx + gy * gy > MAX_SLOPE**2:
                continue
            if abs(r - trend[0] - trend[1] * x - trend[2] * y) > limit:
                continue
            s = sums[(i // side) * across + j // side]
            s[0] += 1.0
            s[1] += x
            s[2] += y
            s[3] += r
            s[4] += r * r
            s[5] += ax
            s[6] += ay
            s[7] += bx
            s[8] += by
            s[9] += ax * bx
            s[10] += 0.5 * (ax * by + ay * bx)
            s[11] += ay * by
            s[12] += gx * r
            s[13] += gy * r
