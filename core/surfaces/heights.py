"""The heights of a grid's cells from points that memory holds: sums as they come, or ordered cell by cell."""

from __future__ import annotations

from typing import Any, Final

import numba
import numpy as np
from numpy.typing import NDArray

from furrowmap.core.surfaces.grid import Grid, Surface
from furrowmap.core.surfaces.statistic import NMAD, TRIM, Statistic

FloatArray = NDArray[np.float64]

SUMS: Final = 5
"""Of each cell: number, sum and sum of squares of the heights, least and greatest one."""
MEAN, LEAST, GREATEST = 1, 3, 4
PERCENTILE, TRIMMED = 0, 2
"""What :func:`rank` is asked for, besides MEAN."""
FEW: Final = 24
"""So many heights are put in order by insertion."""


class Moments:
    """Number, mean, spread, least and greatest height of cells, added up as points come: 40 bytes a cell.

    Args:
        grid: of the cells.
        base_m: a height near all others, against which sums keep their digits.
    """

    def __init__(self, grid: Grid, base_m: float = 0.0) -> None:
        self.grid = grid
        self._base_m = base_m
        self._sums = np.zeros((grid.rows * grid.columns, SUMS))
        self._sums[:, 3] = np.inf
        self._sums[:, 4] = -np.inf

    def add(self, xyz_m: FloatArray, origin_m: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> None:
        """Take points (n, 3): easting, northing, height less `origin_m`. Those outside the grid are passed over.

        Threads may add to two objects at once, not to one.
        """
        e_m, n_m, h_m = origin_m
        grid = self.grid
        add_points(
            np.ascontiguousarray(xyz_m, np.float64),
            np.array([e_m, n_m, h_m - self._base_m]),
            np.array([grid.west, grid.north, *grid.shape], np.int64),
            grid.cell_m,
            self._sums,
        )

    def join(self, other: Moments) -> None:
        """Take over what another one of the same grid and base has summed up."""
        mine, its = self._sums, other._sums
        mine[:, :3] += its[:, :3]
        np.minimum(mine[:, 3], its[:, 3], out=mine[:, 3])
        np.maximum(mine[:, 4], its[:, 4], out=mine[:, 4])

    def surface(self, statistic: Statistic) -> Surface:
        """The surface of "mean", "min" or "max"; its spread is the standard deviation."""
        if statistic.needs_order:
            raise ValueError(f"{statistic.name} needs the heights themselves")
        column = {"mean": MEAN, "min": LEAST, "max": GREATEST}[statistic.name]
        return _surface(self.grid, statistic, sum_up(self._sums, self._base_m, column))


def ordered_surface(
    grid: Grid, cell: NDArray[np.uint16], height_m: NDArray[np.float32], base_m: float, statistic: Statistic
) -> Surface:
    """The surface of any statistic over a grid of at most 65,536 cells.

    The spread of percentiles and of the trimmed mean is 1.4826 times the median absolute deviation from the median,
    which a few stray returns do not move; that of the others is the standard deviation, as :class:`Moments` has it.

    Args:
        grid: of the cells.
        cell: (n,) flat index of the cell of each point.
        height_m: (n,) less `base_m`.
        base_m: added to all heights.
        statistic: what stands for a cell.
    """
    kind = {"trimmed": TRIMMED, "mean": MEAN}.get(statistic.name, PERCENTILE)
    share = 0.5 if np.isnan(statistic.percent) else 0.01 * statistic.percent
    bands = rank(cell, height_m, grid.rows * grid.columns, base_m, kind, share, statistic.needs_order)
    return _surface(grid, statistic, bands)


def _surface(grid: Grid, statistic: Statistic, bands: tuple[NDArray[Any], ...]) -> Surface:
    height, count, spread, used = (band.reshape(grid.shape) for band in bands)
    factor = np.float32(statistic.error_factor)
    error = np.where(used > 0, factor * spread / np.sqrt(np.maximum(used, 1), dtype=np.float32), np.float32(np.nan))
    return Surface(grid, height, count, spread, error)


@numba.njit(
    "void(float64[:, ::1], float64[::1], int64[::1], float64, float64[:, ::1])",
    cache=True,
    nogil=True,
    error_model="numpy",
)
def add_points(xyz_m, shift_m, where, cell_m, sums):  # type: ignore[no-untyped-def]
    """Kernel of :meth:`Moments.add`; `where` holds west, north, rows and columns of the grid."""
    west, top, rows, columns = where[0], where[1] - 1, where[2], where[3]
    for i in range(len(xyz_m)):
        column = np.floor((xyz_m[i, 0] + shift_m[0]) / cell_m) - west
        row = top - np.floor((xyz_m[i, 1] + shift_m[1]) / cell_m)
        z = xyz_m[i, 2] + shift_m[2]
        if not (0.0 <= column < columns and 0.0 <= row < rows and np.isfinite(z)):
            continue
        k = int(row) * columns + int(column)
        sums[k, 0] += 1.0
        sums[k, 1] += z
        sums[k, 2] += z * z
        sums[k, 3] = min(sums[k, 3], z)
        sums[k, 4] = max(sums[k, 4], z)


@numba.njit(
    "Tuple((float32[::1], uint32[::1], float32[::1], uint32[::1]))(float64[:, ::1], float64, int64)",
    cache=True,
    nogil=True,
)
def sum_up(sums, base_m, column):  # type: ignore[no-untyped-def]
    """Height, count, standard deviation and points used, from the sums of :func:`add_points`."""
    cells = len(sums)
    height, spread = np.full(cells, np.nan, np.float32), np.full(cells, np.nan, np.float32)
    count, used = np.zeros(cells, np.uint32), np.zeros(cells, np.uint32)
    for k in range(cells):
        n = sums[k, 0]
        if n < 1.0:
            continue
        mean = sums[k, 1] / n
        height[k] = base_m + (mean if column == MEAN else sums[k, column])
        count[k] = used[k] = int(n)
        if n > 1.0:
            spread[k] = np.sqrt(max(0.0, (sums[k, 2] - n * mean * mean) / (n - 1.0)))
    return height, count, spread, used


@numba.njit("float64(float32[::1], float64)", cache=True, nogil=True)
def median_deviation(z, middle):  # type: ignore[no-untyped-def]
    """Median of the distances of ordered heights from `middle`, their median."""
    n = len(z)
    low, high = (n - 1) // 2, n // 2
    first = second = 0.0
    steps = 0
    if low == high:  # the median itself is the nearest
        low, high, steps = low - 1, high + 1, 1
    while steps <= n // 2:
        down = middle - z[low] if low >= 0 else np.inf
        up = z[high] - middle if high < n else np.inf
        first = second
        if down <= up:
            second = down
            low -= 1
        else:
            second = up
            high += 1
        steps += 1
    return second if n % 2 else 0.5 * (first + second)


@numba.njit(
    "Tuple((float32[::1], uint32[::1], float32[::1], uint32[::1]))"
    "(uint16[::1], float32[::1], int64, float64, int64, float64, boolean)",
    cache=True,
    nogil=True,
)
def rank(cell, height_m, cells, base_m, kind, share, robust):  # type: ignore[no-untyped-def]
    """Kernel of :func:`ordered_surface`: height, count, spread and points used of each cell.

    The heights are put cell after cell by counting and ordered within each. In an ordered cell the median absolute
    deviation is found by walking outward from the median, and what the trimmed mean keeps is one stretch.
    """
    height, spread = np.full(cells, np.nan, np.float32), np.full(cells, np.nan, np.float32)
    used = np.zeros(cells, np.uint32)
    count = np.zeros(cells, np.uint32)
    for i in range(len(cell)):
        count[cell[i]] += np.uint32(1)
    place = np.zeros(cells, np.int64)
    for k in range(1, cells):
        place[k] = place[k - 1] + count[k - 1]
    ordered = np.empty(len(cell), np.float32)
    for i in range(len(cell)):
        ordered[place[cell[i]]] = height_m[i]
        place[cell[i]] += 1
    for k in range(cells):
        n = int(count[k])
        if n == 0:
            continue
        z = ordered[place[k] - n : place[k]]
        if n <= FEW:
            for i in range(1, n):
                value, j = z[i], i - 1
                while j >= 0 and z[j] > value:
                    z[j + 1] = z[j]
                    j -= 1
                z[j + 1] = value
        else:
            z.sort()
        low, high = 0, n
        if robust:
            middle = 0.5 * (float(z[(n - 1) // 2]) + float(z[n // 2]))
            deviation = NMAD * median_deviation(z, middle)
            if kind == TRIMMED:
                reach = TRIM * deviation
                while z[low] < middle - reach and low < n // 2:
                    low += 1
                while z[high - 1] > middle + reach and high - 1 > n // 2:
                    high -= 1
        if kind == PERCENTILE:
            at = share * (n - 1)
            i = min(int(at), n - 2) if n > 1 else 0
            after = z[min(i + 1, n - 1)]
            height[k] = base_m + z[i] + (at - i) * (after - z[i])
        total = square = 0.0
        if kind != PERCENTILE or not robust:
            for i in range(low, high):
                total += z[i] - z[0]
            mean = total / (high - low)
            for i in range(low, high):
                square += (z[i] - z[0] - mean) ** 2
            if kind != PERCENTILE:
                height[k] = base_m + z[0] + mean
        used[k] = high - low
        if n > 1:
            spread[k] = deviation if robust else np.sqrt(square / (n - 1))
    return height, count, spread, used
