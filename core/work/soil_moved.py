"""Soil moved by the work: the change between the surfaces, by pass."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from furrowmap.core.work.field_surfaces import FieldTile


@dataclass(frozen=True)
class Moved:
    """The change of a piece of ground.

    Attributes:
        area_m2: of the cells in it.
        compared_m2: of those that were seen before and after.
        mean_m: mean change of these, upward positive; nan where there are none.
    """

    area_m2: float
    compared_m2: float
    mean_m: float

    @property
    def volume_m3(self) -> float:
        """Volume of the change, with the mean for cells that were not compared."""
        return self.area_m2 * self.mean_m


@dataclass(frozen=True)
class SoilMoved:
    """What the work changed.

    Attributes:
        worked: all ground that was worked.
        passes: by number, the ground that each pass worked last.
        beside: the ground beside the passes, as a measure of the error.
    """

    worked: Moved
    passes: dict[int, Moved]
    beside: Moved


class SoilSums:
    """Sums up the change over tiles."""

    def __init__(self) -> None:
        self._sums: NDArray[np.float64] = np.zeros((1, 3))
        self._cell_m2 = math.nan

    def add(self, tile: FieldTile) -> None:
        """Take a tile into account."""
        self._cell_m2 = tile.grid.cell_area_m2
        number = tile.number.ravel()
        change = tile.change_m.ravel().astype(np.float64)
        seen = np.isfinite(change)
        passes = max(len(self._sums), int(number.max(initial=0)) + 1)
        sums = np.zeros((passes, 3))
        sums[: len(self._sums)] = self._sums
        sums[:, 0] += np.bincount(number, minlength=passes)
        sums[:, 1] += np.bincount(number[seen], minlength=passes)
        sums[:, 2] += np.bincount(number[seen], weights=change[seen], minlength=passes)
        self._sums = sums

    def moved(self) -> SoilMoved | None:
        """What was moved; None where nothing was worked."""
        if not self._sums[1:, 0].any():
            return None
        beside = self._sums[0].copy()
        beside[0] = beside[1]  # all else is land that was not compared
        passes = {number: self._of(self._sums[number]) for number in range(1, len(self._sums))}
        return SoilMoved(self._of(self._sums[1:].sum(axis=0)), passes, self._of(beside))

    def _of(self, sums: NDArray[np.float64]) -> Moved:
        cells, compared, total = sums.tolist()
        mean = total / compared if compared else math.nan
        return Moved(cells * self._cell_m2, compared * self._cell_m2, mean)
