"""The side view of a tool as a template in the (x, z) plane, and its fit to scans.

A tool is lifted as a whole, so its side view moves up and down unchanged, also when a reversible plough turns over or a
trailed tool swings aside.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numba
import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

CELL_X_M: Final = 0.10
CELL_Z_M: Final = 0.02
CLUTTER: Final = 0.3
"""Expected share of points above the ground from dust, straw or posts."""
_ANYWHERE: Final = 0.3
"""Share of the points of the tool spread evenly along x at their height."""
_SMOOTH: Final = np.array([0.25, 0.5, 0.25])


@dataclass(frozen=True)
class SideViewGrid:
    """Cells of the side view.

    Attributes:
        x_m: start of the first column.
        z_m: start of the lowest row, above the ground.
        columns: along x.
        rows: upward.
    """

    x_m: float
    z_m: float
    columns: int
    rows: int

    def side_view(self, x_m: NDArray[np.float32], z_m: NDArray[np.float32]) -> NDArray[np.float32]:
        """(columns, rows) points in each cell, divided linearly between the two nearest rows."""
        view: NDArray[np.float32] = np.zeros((self.columns, self.rows), np.float32)
        _count(x_m, z_m, self.x_m, self.z_m, view)
        return view


@dataclass(frozen=True)
class Template:
    """The side view of the tool in its working position.

    Attributes:
        grid: its cells.
        odds: (columns, rows) float32, of tool against clutter for a point in the cell.
    """

    grid: SideViewGrid
    odds: NDArray[np.float32]

    @classmethod
    def of(cls, grid: SideViewGrid, views: NDArray[np.float64]) -> Template:
        """The template from weights (columns, rows) of the points of the tool."""
        total = float(views.sum())
        if total <= 0.0:
            return cls(grid, np.zeros(views.shape, np.float32))
        density = views / total
        for axis in (0, 1):
            density = np.apply_along_axis(np.convolve, axis, density, _SMOOTH, "same")
        density = (1.0 - _ANYWHERE) * density + _ANYWHERE * density.mean(axis=0)
        return cls(grid, (density * density.size * (1.0 - CLUTTER) / CLUTTER).astype(np.float32))

    @cached_property
    def gain(self) -> NDArray[np.float32]:
        """(columns, rows) float32, log-likelihood gain of a point in the cell over clutter alone."""
        return np.log1p(self.odds)


@dataclass(frozen=True)
class Fit:
    """Fit of a side view to a template.

    Attributes:
        height_m: of the tool; nan without points.
        explained: expected number of points of the tool.
        gain: log-likelihood gain.
    """

    height_m: float
    explained: float
    gain: float


def fit_height(view: NDArray[np.float32], template: Template, low_m: float, high_m: float) -> tuple[Fit, FloatArray]:
    """The best fit of `view` between `low_m` and `high_m`, and the gain at each height in steps of :data:`CELL_Z_M`."""
    low, high = round(low_m / CELL_Z_M), round(high_m / CELL_Z_M)
    scores, explained = _scores(view, template.gain, template.odds, low, high)
    best = int(np.argmax(scores))
    if scores[best] <= 0.0:
        return Fit(float("nan"), 0.0, 0.0), scores
    height = low + best + vertex(scores, best)
    return Fit(height * CELL_Z_M, float(explained[best]), float(scores[best])), scores


def vertex(scores: FloatArray, best: int) -> float:
    """Offset in steps of the vertex of the parabola through the largest score and its neighbours."""
    if not 0 < best < len(scores) - 1:
        return 0.0
    before, top, after = scores[best - 1 : best + 2]
    bend = before - 2.0 * top + after
    return float(np.clip(0.5 * (before - after) / bend, -0.5, 0.5)) if bend < 0.0 else 0.0


@numba.njit(cache=True, nogil=True)
def _count(x_m, z_m, x0, z0, view):  # type: ignore[no-untyped-def]
    columns, rows = view.shape
    for i in range(len(x_m)):
        u = (x_m[i] - x0) / CELL_X_M
        v = (z_m[i] - z0) / CELL_Z_M - 0.5
        if u < 0.0 or v < 0.0:
            continue
        column, row = int(u), int(v)
        if column < columns and row < rows - 1:
            share = v - row
            view[column, row] += 1.0 - share
            view[column, row + 1] += share


@numba.njit(cache=True, nogil=True)
def _scores(view, gain, odds, low, high):  # type: ignore[no-untyped-def]
    """Log-likelihood gain and points explained with the template lifted by `low` to `high` rows."""
    columns, rows = view.shape
    scores = np.zeros(high - low + 1)
    explained = np.zeros(high - low + 1)
    for column in range(columns):
        for row in range(rows):
            n = view[column, row]
            if n == 0.0:
                continue
            first, last = max(low, row - rows + 1), min(high, row)
            for lift in range(first, last + 1):
                scores[lift - low] += n * gain[column, row - lift]
                o = odds[column, row - lift]
                explained[lift - low] += n * o / (1.0 + o)
    return scores, explained
