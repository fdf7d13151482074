"""The mean change of ground of which unlike shares were seen, with what lay in shadows of relief."""

from __future__ import annotations

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
        area_m2: of the cells in it.
        compared_m2: of those that were seen before and after.
        mean_m: mean change, upward positive, with what lay in shadows before.
        noise_m: standard deviation of the mean by the noise of the cells.
        unseen_m: by what was not seen before and after.
        shadow_share: of the ground in view before, what lay in shadows of relief.
        hidden_m: standard deviation of the mean by what is hidden within the cells that were seen.
    """

    area_m2: float
    compared_m2: float
    mean_m: float
    noise_m: float
    unseen_m: float
    shadow_share: float
    hidden_m: float

    @property
    def sigma_m(self) -> float:
        """Standard deviation of the mean."""
        return math.hypot(self.noise_m, self.unseen_m, self.hidden_m)


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
        """Add a piece of ground; all arrays (rows, columns).

        Args:
            kind: numbers of the kinds, from 0.
            error_m: standard errors of the changes, nan where unknown; `spread_m` of returns within the cells likewise.
            before_m: heights before; nan where not seen.
            returns: before.
        """
        size = max(len(self.sums), int(kind.max(initial=0)) + 1)
        self.sums = np.pad(self.sums, ((0, size - len(self.sums)), (0, 0)))
        seen, known = np.isfinite(change_m), np.isfinite(before_m)
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
        """The mean change of some kinds: of each, weighted by its area (post-stratification).

        Ground of a kind that nobody saw changes like the others.
        """
        return _weighted(np.pad(self.sums, ((0, len(kinds)), (0, 0)))[list(kinds)], cell_m2)


def _weighted(sums: FloatArray, cell_m2: float) -> MeanChange:
    area, compared = sums[:, 0].sum() * cell_m2, sums[:, 1].sum() * cell_m2
    sums = sums[sums[:, 1] > 0]
    if not len(sums):
        return MeanChange(area, compared, *5 * (math.nan,))
    cells, count, total, squares, noise, relief = sums[:, :6].T
    share = cells / cells.sum()
    in_shadow, lower = _shadows(sums[:, 6:])
    mean = total / count
    # what was not seen lies together: about a square metre is one sample of it
    spread = np.sqrt(np.maximum(squares / count - mean**2, 0.0))
    unseen = (1.0 - count / cells) * spread / np.sqrt(np.maximum(count * cell_m2, 1.0))
    off_noise = float(np.linalg.norm(share * np.sqrt(noise) / count))
    of_kinds = (1.0 - cells.sum() * cell_m2 / area) * float(share @ spread) / math.sqrt(max(compared, 1.0))
    off_unseen = math.hypot(*(share * unseen).tolist(), of_kinds, 0.5 * float(share @ lower))
    hidden = HIDDEN_SHARE * float(np.sqrt(share @ (relief / count)))
    mean_m, shadow_share = float(share @ (mean + lower)), float(share @ in_shadow)
    return MeanChange(area, compared, mean_m, off_noise, off_unseen, shadow_share, hidden)


def _shadows(sums: FloatArray) -> tuple[FloatArray, FloatArray]:
    """The share of cells in view that lay in shadows of relief, by kind, and how much lower it makes the mean, in m.

    Of the cells without a height, those that chance left without a return are estimated by the numbers of cells with
    one and with two (Chao 1984, Nonparametric estimation of the number of classes in a population).

    Args:
        sums: (kinds, 6), the last of :class:`ChangeSums`.
    """
    known, unseen, one, two, bends, bend = sums.T
    share = np.maximum(unseen - one**2 / np.maximum(2.0 * two, 1.0), 0.0) / np.maximum(known + unseen, 1.0)
    # second differences have six times the variance of heights that are independent at that distance
    return share, SHADOW_DEPTH * share * np.sqrt(bend / np.maximum(6.0 * bends, 1.0))
