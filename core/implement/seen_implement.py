"""The detected implement: where it is seen, its shape and its travel."""

from dataclasses import dataclass
from functools import cached_property
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from furrowmap.core.runtime.arrays import FloatArray
from furrowmap.core.runtime.errors import Notice
from furrowmap.core.runtime.kernels import kernel
from furrowmap.core.values.tool_states import ToolState

CELL_X_M: Final = 0.10
CELL_Z_M: Final = 0.02
CLUTTER: Final = 0.3
"""Expected share of points above the ground from dust, straw or posts."""
_UNIFORM_SHARE: Final = 0.3
"""Share of the points of the tool spread evenly along x at their height."""
_SMOOTH: Final = np.array([0.25, 0.5, 0.25])


class SideViewGrid(NamedTuple):
    """Cells of the side view: start of the first column and of the lowest row above the ground, their numbers."""

    x_m: float
    z_m: float
    columns: int
    rows: int

    def side_view(self, x_m: NDArray[np.float32], z_m: NDArray[np.float32]) -> NDArray[np.float32]:
        """(columns, rows) points in each cell, divided linearly between the two nearest rows."""
        view: NDArray[np.float32] = np.zeros((self.columns, self.rows), np.float32)
        _count(np.ascontiguousarray(x_m), z_m, self.x_m, self.z_m, view)
        return view


@dataclass(frozen=True)
class SideTemplate:
    """Side view of the tool in its working position: (columns, rows) float32 odds of tool against clutter."""

    grid: SideViewGrid
    odds: NDArray[np.float32]

    @classmethod
    def from_views(cls, grid: SideViewGrid, views: NDArray[np.float64]) -> "SideTemplate":
        """The template from weights (columns, rows) of the points of the tool."""
        total = float(views.sum())
        if total <= 0.0:
            return cls(grid, np.zeros(views.shape, np.float32))
        density = views / total
        for axis in (0, 1):
            density = np.apply_along_axis(np.convolve, axis, density, _SMOOTH, "same")
        density = (1.0 - _UNIFORM_SHARE) * density + _UNIFORM_SHARE * density.mean(axis=0)
        return cls(grid, (density * density.size * (1.0 - CLUTTER) / CLUTTER).astype(np.float32))

    @cached_property
    def gain(self) -> NDArray[np.float32]:
        """(columns, rows) float32, log-likelihood gain of a point in the cell over clutter alone."""
        return np.log1p(self.odds)


@dataclass(frozen=True)
class Fit:
    """Fit of a side view to a template: height of the tool, nan without points, and its expected number of points."""

    height_m: float
    explained: float
    gain: float


def fit_height(
    view: NDArray[np.float32], template: SideTemplate, low_m: float, high_m: float
) -> tuple[Fit, FloatArray]:
    """The best fit of `view` between `low_m` and `high_m`, and the gain at each height in steps of :data:`CELL_Z_M`."""
    low = round(low_m / CELL_Z_M)
    high = round(high_m / CELL_Z_M)
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


@kernel()
def _count(x_m, z_m, x0, z0, view):  # type: ignore[no-untyped-def]
    columns, rows = view.shape
    for i in range(len(x_m)):
        u = (x_m[i] - x0) / CELL_X_M
        v = (z_m[i] - z0) / CELL_Z_M - 0.5
        if u < 0.0 or v < 0.0:
            continue
        column = int(u)
        row = int(v)
        if column < columns and row < rows - 1:
            share = v - row
            view[column, row] += 1.0 - share
            view[column, row + 1] += share


@kernel()
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
            first = max(low, row - rows + 1)
            last = min(high, row)
            for lift in range(first, last + 1):
                scores[lift - low] += n * gain[column, row - lift]
                o = odds[column, row - lift]
                explained[lift - low] += n * o / (1.0 + o)
    return scores, explained


Box = tuple[float, float, float, float]
"""From, to along x, from, to along y of the vehicle frame."""
Plane = tuple[float, float, float]
"""Height of the ground in the vehicle frame: ``z = a + b·x + c·y``."""


@dataclass(frozen=True)
class Hint:
    """The implement as stated in a session; `xy_m` is the middle of the tool's line in the vehicle frame."""

    xy_m: tuple[float, float]
    width_m: float
    box_m: Box | None = None
    lift_m: float | None = None

    @property
    def region_m(self) -> Box:
        """Where it is looked for: as stated, else around its line."""
        if self.box_m is not None:
            return self.box_m
        x, y = self.xy_m
        half = 0.5 * self.width_m + 0.5
        return (x - 2.0, x + 1.2, y - half, y + half)


class Region(NamedTuple):
    """Where the implement is seen.

    Attributes:
        columns: (COLUMNS,) bool, columns of the range image that show it.
        still_m: (lasers, COLUMNS) float32, range of static pixels; nan elsewhere.
        begin: column at which scans begin.
        split: the column opposite to the implement, at which points are split into revolutions.
        clockwise: whether azimuth increases within a scan.
    """

    ground: Plane
    box_m: Box
    columns: NDArray[np.bool_]
    still_m: NDArray[np.float32]
    begin: int
    split: int
    clockwise: bool
    turn_s: float


@dataclass(frozen=True)
class DepthImages:
    """Depth images of the implement.

    Attributes:
        up_m: (lasers, n) float32, median range with the implement up, lowest laser first; nan where nothing is seen.
        down_m: the same with the implement down.
        implement: (lasers, n) bool, pixels that show the implement in any position.
        azimuth_deg: (n,) float64 of column centres, continuous across azimuth 0.
    """

    up_m: NDArray[np.float32]
    down_m: NDArray[np.float32]
    implement: NDArray[np.bool_]
    azimuth_deg: NDArray[np.float64]


@dataclass(frozen=True)
class Levels:
    """The two positions of a tool.

    Attributes:
        low_m: height of the lower one relative to the template; the lowest in view, where it works out of view.
        high_m: of the upper one.
        hidden: state in which the tool is out of view; UNKNOWN if none.
        sigma_m: standard deviation of heights of the static tool.
        jitter_m: the same including its motion at work.
    """

    low_m: float
    high_m: float
    hidden: ToolState
    sigma_m: float
    jitter_m: float


@dataclass(frozen=True)
class SeenImplement:
    """The implement, for measuring its height in every scan: height at work, usual points in a scan, their gain.

    `gain` is the log-likelihood gain of a point; `working_m` is assumed where the tool works out of view.
    """

    region: Region
    template: SideTemplate
    levels: Levels
    working_m: float
    points: float
    gain: float
    images: DepthImages

    @property
    def lifted_m(self) -> float:
        """Height of the lifted tool above its working position."""
        return self.levels.high_m - self.working_m

    def threshold_m(self, working_depth_m: float | None) -> float:
        """Height above the working position between down and up: the working depth, or half the lift if less."""
        half = 0.5 * self.lifted_m
        return working_depth_m if working_depth_m is not None and working_depth_m < 1.5 * half else half


@dataclass(frozen=True)
class Learned:
    """The implement, None where nothing moves up and down, with notices for the report."""

    implement: SeenImplement | None
    notices: tuple[Notice, ...]
