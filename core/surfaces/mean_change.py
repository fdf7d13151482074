"""The mean change of ground of which unlike shares were seen, with what lay in shadows of relief."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import uniform_filter

from furrowmap.core.runtime.arrays import Float32Array, FloatArray

HIDDEN_SHARE: Final = 0.04
"""Tops of clods are seen more than what lies between: heights are off by this share of the relief within cells."""
SAMPLE_M2: Final = 0.5
"""What was not seen lies together: so much ground is one sample of it."""
SHADOW_DEPTH: Final = 0.9
"""Cells in the shadow of relief lie below those in view by this share of its standard deviation, ± half of that."""
SHADOW_STEP: Final = 5
"""Cells over which second differences of height show relief, without slopes."""
VIEW_CELLS: Final = 21
MIN_VIEW_SHARE: Final = 0.5
"""A cell without a height lies in a shadow where more of the cells in a square of a metre have one."""


@dataclass(frozen=True)
class MeanChange:
    """The change of a piece of ground; nan where nothing was compared.

    Attributes:
        compared_m2: of the area what was seen before and after.
        mean_m: mean change, upward positive, with what lay in shadows before.
        sigma_m: standard deviation of it, by noise of cells, what was not seen, and what is hidden within cells.
        shadow_share: of the ground in view before, what lay in shadows of relief.
    """

    area_m2: float
    compared_m2: float
    mean_m: float
    sigma_m: float
    shadow_share: float


class ChangeSums:
    """Sums (kinds, 12) over the cells of kinds of ground, piece by piece.

    Cells, of these compared, changes, their squares, squares of standard errors and of the spread of returns; before:
    cells with a height, without one in view, of one return, of two, second differences of height, and their squares.
    """

    def __init__(self) -> None:
        self.sums: FloatArray = np.zeros((1, 12))

    def add(
        self,
        kind: NDArray[np.integer],
        change_m: Float32Array,
        error_m: Float32Array,
        spread_m: Float32Array,
        before_m: Float32Array,
        returns: NDArray[np.floating] | NDArray[np.unsignedinteger],
    ) -> None:
        """Add a piece of ground by the numbers of its kinds, from 0; all arrays (rows, columns), nan where unknown."""
        size = max(len(self.sums), int(kind.max(initial=0)) + 1)
        self.sums = np.pad(self.sums, ((0, size - len(self.sums)), (0, 0)))
        seen = np.isfinite(change_m)
        known = np.isfinite(before_m)
        in_view = uniform_filter(known.astype(np.float32), VIEW_CELLS, mode="nearest") > MIN_VIEW_SHARE
        squares = (np.where(seen, a, np.float32(0.0)).astype(np.float64) ** 2 for a in (change_m, error_m, spread_m))
        parts = [np.ones(kind.shape), seen, np.where(seen, change_m, 0.0), *map(np.nan_to_num, squares)]
        parts += [known, in_view & ~known, returns == 1, returns == 2]
        for column, values in enumerate(parts):
            self.sums[:, column] += np.bincount(kind.ravel(), values.ravel(), size)
        middle = slice(SHADOW_STEP, -SHADOW_STEP)
        for h, of in ((before_m, kind), (before_m.T, kind.T)):
            bends = h[2 * SHADOW_STEP :] + h[: -2 * SHADOW_STEP] - np.float32(2.0) * h[middle]
            there = np.isfinite(bends)
            self.sums[:, 10] += np.bincount(of[middle][there], minlength=size)
            self.sums[:, 11] += np.bincount(of[middle][there], bends[there].astype(np.float64) ** 2, size)

    def mean(self, cell_m2: float, kinds: Sequence[int]) -> MeanChange:
        """The mean change of some kinds by their areas; that of a kind which nobody saw is that of the others."""
        sums = np.pad(self.sums, ((0, len(kinds)), (0, 0)))[list(kinds)]
        area = sums[:, 0].sum() * cell_m2
        compared = sums[:, 1].sum() * cell_m2
        sums = sums[sums[:, 1] > 0]
        if not len(sums):
            return MeanChange(area, compared, math.nan, math.nan, math.nan)
        cells, count, total, squares, noise, relief = sums[:, :6].T
        share = cells / cells.sum()
        mean = total / count
        in_shadow, lower = _shadows(sums[:, 6:])
        spread = np.sqrt(np.maximum(squares / count - mean**2, 0.0))
        unseen = (1.0 - count / cells) * spread / np.sqrt(np.maximum(count * cell_m2 / SAMPLE_M2, 1.0))
        of_kinds = (1.0 - cells.sum() * cell_m2 / area) * share @ spread / math.sqrt(max(compared / SAMPLE_M2, 1.0))
        hidden = HIDDEN_SHARE * np.sqrt(share @ (relief / count))
        each = np.hypot(share * unseen, share * np.sqrt(noise) / count)
        sigma_m = math.hypot(*each.tolist(), of_kinds, 0.5 * share @ lower, hidden)
        return MeanChange(area, compared, float(share @ (mean + lower)), sigma_m, float(share @ in_shadow))


def _shadows(sums: FloatArray) -> tuple[FloatArray, FloatArray]:
    """The share of cells in view that lay in shadows of relief, by kind, and how much lower it makes the mean, in m.

    Of the cells without a height, those that chance left without a return are estimated by the numbers of cells with
    one and with two (Chao 1984, Nonparametric estimation of the number of classes in a population). Of
    :class:`ChangeSums` the last six are needed.
    """
    known, unseen, one, two, bends, bend = sums.T
    share = np.maximum(unseen - one**2 / np.maximum(2.0 * two, 1.0), 0.0) / np.maximum(known + unseen, 1.0)
    # second differences have six times the variance of heights that are independent at that distance
    return share, SHADOW_DEPTH * share * np.sqrt(bend / np.maximum(6.0 * bends, 1.0))
