"""Height differences between the strips of a flight over the same ground, with the mounting as stated and as found."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from furrowmap.core.runtime.arrays import FloatArray, IntArray
from furrowmap.core.strips.cell_heights import (
    MIN_GROUP_RETURNS,
    CellHeights,
    cell_heights,
    same_cell_pairs,
    smooth_groups,
)
from furrowmap.core.strips.relief import PlanShifts, plan_shifts
from furrowmap.core.strips.strips import STRIP_CELL_M, StripReturns
from furrowmap.core.surfaces.visits import SwathDifferences, SwathSums
from furrowmap.core.values.rotation import Mounting
from furrowmap.core.values.time_span import Interval, interval_numbers

MAX_DIFFERENCES: Final = 20_000
"""Cells are joined by fours until there are no more rows."""


@dataclass(frozen=True)
class StripDifferences:
    """Height differences of pairs of strips in n cells, later strip less earlier; nan where unknown.

    Attributes:
        centre_m: (n, 2) easting and northing of the cells' centres.
        strip_a: (n,) number of the earlier strip.
        strip_b: (n,) of the later one.
        before_m: (n,) with the mounting as stated.
        after_m: (n,) with the mounting that was used.
        sigma_m: (n,) standard deviation of `after_m` by the noise of the returns.
        plan: shifts of the strips in plan; None where no relief shows them.
    """

    cell_m: float
    centre_m: FloatArray
    strip_a: IntArray
    strip_b: IntArray
    before_m: FloatArray
    after_m: FloatArray
    sigma_m: FloatArray
    plan: PlanShifts | None = None

    def __len__(self) -> int:
        return len(self.strip_a)

    @property
    def pairs(self) -> list[tuple[int, int]]:
        """The pairs of strips that see some ground together."""
        return [(int(a), int(b)) for a, b in np.unique(np.column_stack([self.strip_a, self.strip_b]), axis=0)]

    def of_pair(self, pair: tuple[int, int]) -> "StripDifferences":
        """The differences of one pair."""
        chosen = (self.strip_a == pair[0]) & (self.strip_b == pair[1])
        rows = {name: value[chosen] for name, value in vars(self).items() if name not in ("cell_m", "plan")}
        return replace(self, **rows)

    def figures(self) -> tuple[SwathDifferences | None, SwathDifferences | None]:
        """Statistics before and after; None without a difference."""
        out = []
        for values in (self.before_m, self.after_m):
            sums = SwathSums()
            sums.add(values.astype(np.float32), self.cell_m**2)
            out.append(sums.differences())
        return out[0], out[1]

    def plain(self) -> dict[str, Any]:
        """For `report.json`."""
        before, after = self.figures()
        rows = []
        for pair in self.pairs:
            of_pair = self.of_pair(pair)
            one, other = of_pair.figures()
            row: dict[str, Any] = {"strips": list(pair), "area_m2": round(len(of_pair) * self.cell_m**2, 2)}
            for name, figures in (("before", one), ("after", other)):
                if figures is not None:
                    row |= {f"{name}_mean_m": round(figures.mean_m, 4), f"{name}_rms_m": round(figures.rms_m, 4)}
            rows.append(row)
        return {
            "cell_m": self.cell_m,
            "before": before.plain() if before is not None else None,
            "after": after.plain() if after is not None else None,
            "pairs": rows,
            "plan": self.plan.plain() if self.plan is not None else None,
        }


def strip_differences(
    returns: StripReturns, strips: Sequence[Interval], stated: Mounting, used: Mounting
) -> StripDifferences | None:
    """Differences of all pairs of strips on smooth ground, of a scanner's returns; None where no two see the same."""
    number = interval_numbers(strips, returns.t_s).astype(np.int64)
    if not number.any():
        return None
    number[number == 0] = -1
    before, after = (
        cell_heights(returns, number, mounting.rotation, np.asarray(mounting.xyz_m)) for mounting in (stated, used)
    )
    variance, chosen = smooth_groups(after)
    first, second = same_cell_pairs(after.cell[chosen])
    if not len(first):
        return None
    a = chosen[first]
    b = chosen[second]
    sigma = np.sqrt(variance[first] / after.count[a] + variance[second] / after.count[b])
    earlier = _look_up(before, after, a), _look_up(before, after, b)
    found = StripDifferences(
        STRIP_CELL_M,
        (after.place[a] + 0.5) * STRIP_CELL_M + returns.local_m[:2],
        after.window[a],
        after.window[b],
        earlier[1] - earlier[0],
        after.height_m[b] - after.height_m[a],
        sigma,
    )
    while len(found) > MAX_DIFFERENCES:
        found = _coarsen(found)
    return replace(found, plan=plan_shifts(returns, number, stated, used))


def _look_up(before: CellHeights, after: CellHeights, groups: NDArray[np.intp]) -> FloatArray:
    """Heights of the same cells and strips in another placement of the returns; nan where there are too few."""
    # One whole number for a cell and a strip.
    numbers = ((heights.place + (1 << 20), heights.window) for heights in (before, after))
    keys = [((place[:, 0] << 21) + place[:, 1] << 16) + window for place, window in numbers]
    order = np.argsort(keys[0])
    at = order[np.minimum(np.searchsorted(keys[0], keys[1][groups], sorter=order), len(order) - 1)]
    known = (keys[0][at] == keys[1][groups]) & (before.count[at] >= MIN_GROUP_RETURNS)
    return np.where(known, before.height_m[at], np.nan)


def _coarsen(fine: StripDifferences) -> StripDifferences:
    """Means over cells of twice the sides."""
    size_m = 2.0 * fine.cell_m
    place = np.floor(fine.centre_m / size_m).astype(np.int64)
    rows = np.column_stack([place, fine.strip_a, fine.strip_b])
    cells, member = np.unique(rows, axis=0, return_inverse=True)
    count = np.bincount(member.ravel(), minlength=len(cells))

    def mean(values: FloatArray) -> FloatArray:
        known = np.isfinite(values)
        total = np.bincount(member.ravel(), np.where(known, values, 0.0), len(cells))
        number = np.bincount(member.ravel(), known, len(cells))
        return np.where(number > 0, total / np.maximum(number, 1), np.nan)

    sigma = np.sqrt(np.bincount(member.ravel(), fine.sigma_m**2, len(cells))) / count
    centre = (cells[:, :2] + 0.5) * size_m
    return StripDifferences(size_m, centre, cells[:, 2], cells[:, 3], mean(fine.before_m), mean(fine.after_m), sigma)
