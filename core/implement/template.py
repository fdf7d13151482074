"""The tool seen from the side: how likely a place of the (x, z) plane holds a point of it; the height at which it fits.

A tool is lifted as a whole, so that its side view keeps its shape and moves up or down. Taking the side view, and not
the whole body, leaves the same picture where a reversible plough has turned over or a trailed tool swings aside.
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
"""Share of points above the ground that are expected to be something else: dust, straw, a post passed by."""
_ANYWHERE: Final = 0.3
"""Share of the tool's points that are taken to lie at their height, but anywhere along x."""
_SMOOTH: Final = np.array([0.25, 0.5, 0.25])


@dataclass(frozen=True)
class SideViewGrid:
    """Cells of the side view.

    Attributes:
        x_m: where the first column begins.
        z_m: where the lowest row begins, above the ground.
        columns: along x.
        rows: upwards.
    """

    x_m: float
    z_m: float
    columns: int
    rows: int

    def side_view(self, x_m: NDArray[np.float32], z_m: NDArray[np.float32]) -> NDArray[np.float32]:
        """(columns, rows) number of points in each cell; each is shared between the two rows nearest to its height."""
        view: NDArray[np.float32] = np.zeros((self.columns, self.rows), np.float32)
        _count(x_m, z_m, self.x_m, self.z_m, view)
        return view


@dataclass(frozen=True)
class Template:
    """The side view of the tool in its working position.

    Attributes:
        grid: its cells.
        odds: (columns, rows) float32, how much likelier a point in the cell is the tool than clutter.
    """

    grid: SideViewGrid
    odds: NDArray[np.float32]

    @classmethod
    def of(cls, grid: SideViewGrid, views: NDArray[np.float64]) -> Template:
        """The template of `views` (columns, rows): weights of the tool's points in each cell."""
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
        """(columns, rows) float32, log-likelihood that a point in the cell adds against clutter alone."""
        return np.log1p(self.odds)


@dataclass(frozen=True)
class Fit:
    """How well a side view agrees with a template at one height.

    Attributes:
        height_m: of the tool; nan where there is no point to fit.
        explained: number of points that are the tool, by the template.
        gain: log-likelihood gained.
    """

    height_m: float
    explained: float
    gain: float


def fit_height(view: NDArray[np.float32], template: Template, low_m: float, high_m: float) -> tuple[Fit, FloatArray]:
    """The height between `low_m` and `high_m` at which `view` agrees best with the template.

    Returns:
        the best fit, and the log-likelihood gained at each height from `low_m` on in steps of :data:`CELL_Z_M`.
    """
    low, high = round(low_m / CELL_Z_M), round(high_m / CELL_Z_M)
    scores, explained = _scores(view, template.gain, template.odds, low, high)
    best = int(np.argmax(scores))
    if scores[best] <= 0.0:
        return Fit(float("nan"), 0.0, 0.0), scores
    height = low + best + vertex(scores, best)
    return Fit(height * CELL_Z_M, float(explained[best]), float(scores[best])), scores


def vertex(scores: FloatArray, best: int) -> float:
    """By how many steps the top of the parabola through the largest score and its neighbours lies beside it."""
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
    """Log-likelihood gained, and points explained, with the template lifted by `low` to `high` rows."""
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
