"""Statistics that reduce the heights of a cell to one, and surfaces of them: by sums, or by ordering cell by cell."""

import math
import re
from dataclasses import dataclass
from statistics import NormalDist
from typing import Final, Self

import numpy as np
from numpy.typing import NDArray

from furrowmap.core.runtime.errors import UsageError
from furrowmap.core.runtime.kernels import kernel, kernel_part
from furrowmap.core.surfaces.grid import Grid, Surface

NMAD: Final = 1.4826
"""Standard deviation over median absolute deviation of a normal distribution."""
TRIM_NMADS: Final = 2.5
"""The trimmed mean excludes heights farther than this many NMAD from the median."""
_PERCENTS: Final = {"min": 0.0, "median": 50.0, "max": 100.0}
_SUM_COLUMNS: Final = {"mean": 1, "min": 3, "max": 4}
"""Index of the statistics that need no order among number, sum, sum of squares, least and greatest height."""
MEAN: Final = _SUM_COLUMNS["mean"]
MAX_INSERTED: Final = 24
"""Up to this many heights are sorted by insertion."""
FEW_SELECTED: Final = 4
"""So many are sorted instead of divided further."""


@dataclass(frozen=True)
class Statistic:
    """A statistic.

    Attributes:
        name: "median", "trimmed", "mean", "min", "max" or "p" and a percentage such as "p90".
        percent: of a percentile, 0 to 100; nan for the two means.
    """

    name: str
    percent: float = math.nan

    @classmethod
    def parse(cls, name: str) -> Self:
        """The statistic of a name. Raises UsageError if there is none of that name."""
        word = name.strip().lower()
        if word in {"mean", "trimmed"}:
            return cls(word)
        if word in _PERCENTS:
            return cls(word, _PERCENTS[word])
        number = re.fullmatch(r"p(\d{1,3}(?:\.\d+)?)", word)
        if number and float(number[1]) <= 100.0:
            return cls(word, float(number[1]))
        raise UsageError("unknown-statistic", name=name)

    @property
    def error_factor(self) -> float:
        """Standard error for n normal heights of unit variance times √n, asymptotically.

        For percentiles ``sqrt(p (1 - p)) / density`` (Stuart & Ord, Kendall's Advanced Theory of Statistics I, 10.10);
        nan for the least and the greatest height.
        """
        if math.isnan(self.percent):
            return 1.0
        p = self.percent / 100.0
        if not 0.0 < p < 1.0:
            return math.nan
        normal = NormalDist()
        return math.sqrt(p * (1.0 - p)) / normal.pdf(normal.inv_cdf(p))


MEDIAN: Final = Statistic.parse("median")


def cell_surface(
    grid: Grid,
    cell: NDArray[np.uint16],
    height_m: NDArray[np.float32],
    base_m: float,
    statistic: Statistic,
    kept: NDArray[np.bool_] | None = None,
) -> Surface:
    """The surface of a statistic on a grid of at most 65,536 cells.

    The spread of percentiles and of the trimmed mean is 1.4826 times the median absolute deviation, else the standard
    deviation. Mean, least and greatest height need no sorting, which makes them five times as fast. `cell` (n,) is the
    flat index of the cell of each point, `height_m` (n,) its height less `base_m`; `kept` (n,) are the points that take
    part.
    """
    cells = grid.rows * grid.columns
    kept = np.ones(len(cell), np.bool_) if kept is None else kept
    if statistic.name not in _SUM_COLUMNS:
        trimmed = statistic.name == "trimmed"
        share = 0.5 if trimmed else 0.01 * statistic.percent
        bands = rank(cell, height_m, kept, cells, base_m, trimmed, share)
    else:
        bands = sum_up(cell, height_m, kept, cells, base_m, _SUM_COLUMNS[statistic.name])
    height, count, spread, used = (band.reshape(grid.shape) for band in bands)
    factor = np.float32(statistic.error_factor)
    error = np.where(used > 0, factor * spread / np.sqrt(np.maximum(used, 1), dtype=np.float32), np.float32(np.nan))
    return Surface(grid, height, count, spread, error)


@kernel()
def sum_up(cell, height_m, kept, cells, base_m, column):  # type: ignore[no-untyped-def]
    """Kernel of :func:`cell_surface` where no order is needed: height, count, spread and points used of each cell."""
    sums = np.zeros((cells, 5))
    sums[:, 3] = np.inf
    sums[:, 4] = -np.inf
    near = float(height_m[0]) if len(height_m) else 0.0  # differences from it keep their precision
    for i in range(len(cell)):
        if not kept[i]:
            continue
        k = cell[i]
        z = height_m[i] - near
        sums[k, 0] += 1.0
        sums[k, 1] += z
        sums[k, 2] += z * z
        sums[k, 3] = min(sums[k, 3], z)
        sums[k, 4] = max(sums[k, 4], z)
    height = np.full(cells, np.nan, np.float32)
    spread = np.full(cells, np.nan, np.float32)
    count = np.zeros(cells, np.uint32)
    used = np.zeros(cells, np.uint32)
    for k in range(cells):
        n = sums[k, 0]
        if n < 1.0:
            continue
        mean = sums[k, 1] / n
        height[k] = base_m + near + (mean if column == MEAN else sums[k, column])
        count[k] = used[k] = int(n)
        if n > 1.0:
            spread[k] = np.sqrt(max(0.0, (sums[k, 2] - n * mean * mean) / (n - 1.0)))
    return height, count, spread, used


@kernel()
def sort_in_place(z):  # type: ignore[no-untyped-def]
    """Shell's sort, gaps of Gonnet and Baeza-Yates (1991); numba's own sort compiles for a second in each module."""
    n = len(z)
    gap = 1 if n <= MAX_INSERTED else n * 5 // 11
    while gap > 0:
        for i in range(gap, n):
            value = z[i]
            j = i - gap
            while j >= 0 and z[j] > value:
                z[j + gap] = z[j]
                j -= gap
            z[j + gap] = value
        gap = 1 if gap == 2 else gap * 5 // 11


@kernel_part()
def quantile(work, n, share):  # type: ignore[no-untyped-def]
    """The ordered values before and after a quantile of the n values in work[0], and the share of the way between.

    Hoare's selection. It divides from one row of `work` (2, n or more) into the other, so that no branch depends on a
    value; both are overwritten.
    """
    if n == 1:
        return work[0, 0], work[0, 0], 0.0
    k = min(int(share * (n - 1)), n - 2)
    between = share * (n - 1) - k
    row = 0
    begin = 0
    end = n
    while end - begin > FEW_SELECTED:
        pivot = (work[row, begin] + work[row, (begin + end) >> 1] + work[row, end - 1]) / 3.0
        low = begin
        for _ in range(2):
            low = begin
            for i in range(begin, end):
                value = work[row, i]
                work[1 - row, low] = value
                work[1 - row, end - 1 - i + low] = value
                low += value <= pivot
            if begin < low < end:
                break
            pivot = work[row, begin]  # nothing is divided: next the least value from all others
            for i in range(begin, end):
                pivot = min(pivot, work[row, i])
        if not begin < low < end:
            return pivot, pivot, between  # all are equal
        row = 1 - row
        if k + 1 < low:
            end = low
        elif k >= low:
            begin = low
        else:
            before = work[row, begin]
            after = work[row, low]
            for i in range(begin, low):
                before = max(before, work[row, i])
            for i in range(low, end):
                after = min(after, work[row, i])
            return before, after, between
    for i in range(begin + 1, end):
        value = work[row, i]
        j = i - 1
        while j >= begin and work[row, j] > value:
            work[row, j + 1] = work[row, j]
            j -= 1
        work[row, j + 1] = value
    return work[row, k], work[row, k + 1], between


@kernel()
def rank(cell, height_m, kept, cells, base_m, trimmed, share):  # type: ignore[no-untyped-def]
    """Kernel of :func:`cell_surface` where order is needed: height, count, spread and points used of each cell.

    Counting sort by cell, then selection within each.
    """
    height = np.full(cells, np.nan, np.float32)
    spread = np.full(cells, np.nan, np.float32)
    used = np.zeros(cells, np.uint32)
    count = np.zeros(cells, np.uint32)
    for i in range(len(cell)):
        count[cell[i]] += np.uint32(kept[i])
    place = np.zeros(cells + 1, np.int64)
    most = np.int64(0)
    for k in range(cells):
        place[k + 1] = place[k] + count[k]
        most = max(most, np.int64(count[k]))
    ordered = np.empty(place[cells], np.float32)
    for i in range(len(cell)):
        if kept[i]:
            ordered[place[cell[i]]] = height_m[i]
            place[cell[i]] += 1
    work = np.empty((2, most))
    for k in range(cells):
        n = np.int64(count[k])
        if n == 0:
            continue
        begin = place[k] - n
        for i in range(n):
            work[0, i] = ordered[begin + i]
        before, after, between = quantile(work, n, share)
        height[k] = base_m + before + between * np.float32(after - before)
        used[k] = n
        if n == 1:
            continue
        if share != 0.5:
            for i in range(n):
                work[0, i] = ordered[begin + i]
            before, after, between = quantile(work, n, 0.5)
        middle = np.float32(before + between * (after - before))
        for i in range(n):
            work[0, i] = abs(np.float64(ordered[begin + i]) - middle)
        before, after, between = quantile(work, n, 0.5)
        deviation = NMAD * (before + between * (after - before))
        spread[k] = deviation
        if trimmed:
            reach = TRIM_NMADS * deviation
            total = 0.0
            near = 0
            for i in range(begin, begin + n):
                if middle - reach <= ordered[i] <= middle + reach:
                    total += ordered[i] - middle
                    near += 1
            height[k] = base_m + middle + total / near
            used[k] = near
    return height, count, spread, used
