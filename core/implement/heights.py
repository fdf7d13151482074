"""Height of the tool in each revolution of the sensor."""

from array import array
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from furrowmap.core.implement.near_scans import column_of, with_fewer_lasers
from furrowmap.core.implement.seen_implement import CELL_X_M, CELL_Z_M, SeenImplement, fit_height
from furrowmap.core.implement.views import (
    AGREE_M,
    CUT_M,
    CUT_PER_M,
    FEWEST_POINTS,
    FEWEST_SHARE,
    MIN_PROFILE_GAIN,
    TOP_M,
)
from furrowmap.core.runtime.arrays import FloatArray
from furrowmap.core.runtime.kernels import kernel_part
from furrowmap.core.values.rotation import Mounting
from furrowmap.core.values.scan import Scan

_BEYOND_M: Final = 0.2
"""Search range below the working and above the lifted position."""
_BESIDE_M: Final = 0.8
"""Width of the soil strips on both sides of the box of the implement."""
_SOIL_M: Final = 0.3
"""Greatest distance of soil from the ground plane."""
_SOIL_BIN_M: Final = 0.01
_MIN_SOIL_POINTS: Final = 20
_EIGHTHS: Final = (0, 1, 3, 2, 7, 6, 4, 5)
"""Eighths of a turn of columns, by whether y > 0 (4), x < 0 (2) and abs(y) > abs(x) (1): told before an arc tangent."""


class TurnSums(NamedTuple):
    """What is seen in the current revolution (0) and the next (1).

    `views` (2, columns, rows) are points of the side view, `soil` (2, bins) heights beside the tool, `times` (2, 2, 2)
    number and sum of the times of all points (0) and of those of the side view (1).
    """

    views: NDArray[np.float32]
    soil: NDArray[np.int64]
    times: FloatArray


@dataclass(frozen=True)
class ToolHeights:
    """The tool in n revolutions, which start at the column opposite to it.

    Attributes:
        t_s: (n,) UTC of its points.
        height_m: (n,) above its working position; nan where not seen.
        seen: (n,) share of its usual points.
        contrast: (n,) log-likelihood of the best height over the best on the other side of the threshold.
        whole: (n,) bool, False for a revolution truncated by the start, the end or a pause.
        soil_m: (n,) height of the soil beside it above the ground plane; nan where not seen.
        scan_begin_s: (m,) UTC of the first return of each scan with returns.
        scan_end_s: (m,) of the last one.
    """

    t_s: FloatArray
    height_m: FloatArray
    seen: FloatArray
    contrast: FloatArray
    whole: NDArray[np.bool_]
    soil_m: FloatArray
    scan_begin_s: FloatArray
    scan_end_s: FloatArray


class ToolHeightTracker:
    """Measures the height of the tool in each revolution from successive scans.

    Scans begin at an azimuth of the scanner, which may be that of the implement; points are therefore regrouped into
    revolutions that start opposite to it.
    """

    def __init__(self, mounting: Mounting, implement: SeenImplement, working_depth_m: float | None) -> None:
        region = implement.region
        grid = implement.template.grid
        self._implement = implement
        self._threshold_m = implement.threshold_m(working_depth_m)
        self._rotation = np.ascontiguousarray(mounting.rotation)
        self._lever_m = np.asarray(mounting.xyz_m, np.float64)
        columns = region.columns | np.roll(region.columns, 1) | np.roll(region.columns, -1)
        self._eighths = np.any(columns.reshape(8, -1), axis=1)[list(_EIGHTHS)]
        views = np.zeros((2, grid.columns, grid.rows), np.float32)
        soil = np.zeros((2, round(2.0 * _SOIL_M / _SOIL_BIN_M)), np.int64)
        self._sums = TurnSums(views, soil, np.zeros((2, 2, 2)))
        self._last_s = float("nan")
        self._turns = array("d")
        self._scans = array("d")

    def add(self, scan: Scan) -> None:
        """Add the next scan."""
        scan = with_fewer_lasers(scan)
        if not len(scan):
            return
        begin_s = float(scan.t_s[0])
        end_s = float(scan.t_s[-1])
        goes_on = abs(begin_s - self._last_s) < 0.25 * self._implement.region.turn_s
        if not goes_on:
            self._end_turn(whole=False)
        self._last_s = end_s
        self._scans.extend((begin_s, end_s))
        _gather(
            np.ascontiguousarray(scan.xyz_m, np.float32), np.ascontiguousarray(scan.laser, np.uint8),
            np.ascontiguousarray(scan.t_s, np.float64), self._rotation, self._lever_m, self._implement.region,
            self._eighths, self._implement.template.grid, self._sums,
        )  # fmt: skip
        self._end_turn(whole=goes_on)

    def heights(self) -> ToolHeights:
        """All heights so far, including the current revolution."""
        self._end_turn(whole=False)
        return self._stored()

    def latest(self, turns: int) -> ToolHeights:
        """Those of the last complete revolutions; earlier ones are forgotten."""
        del self._turns[: -6 * turns], self._scans[: -2 * turns]
        return self._stored()

    def _stored(self) -> ToolHeights:
        t_s, height, seen, contrast, whole, soil = np.array(self._turns).reshape(-1, 6).T
        begin_s, end_s = np.array(self._scans).reshape(-1, 2).T
        return ToolHeights(t_s, height, seen, contrast, whole > 0, soil, begin_s, end_s)

    def _end_turn(self, *, whole: bool) -> None:
        """Finish the current revolution; points beyond the split belong to the next one."""
        sums = self._sums
        looked, seen = sums.times[0]
        if looked[0]:
            points, total_s = seen if seen[0] >= FEWEST_POINTS else looked
            self._turns.extend((total_s / points, *self._measure(sums.views[0]), whole, _median(sums.soil[0])))
        for parts in sums:
            parts[0] = parts[1]
            parts[1] = 0

    def _measure(self, view: NDArray[np.float32]) -> tuple[float, float, float]:
        """Height, share of points seen, contrast."""
        implement = self._implement
        low_m = implement.working_m - _BEYOND_M
        fit, scores = fit_height(view, implement.template, low_m, implement.working_m + implement.lifted_m + _BEYOND_M)
        seen = fit.explained / implement.points
        best = int(np.argmax(scores))
        if not (
            0 < best < len(scores) - 1
            and fit.explained > max(FEWEST_POINTS, FEWEST_SHARE * implement.points)
            and fit.gain > MIN_PROFILE_GAIN * implement.gain * fit.explained
        ):
            return float("nan"), seen, 0.0
        height = fit.height_m - implement.working_m
        across = round((implement.working_m + self._threshold_m - low_m) / CELL_Z_M)
        other = scores[:across] if height > self._threshold_m else scores[across:]
        return height, seen, float(scores[best] - other.max(initial=0.0))


def _median(counts: NDArray[np.int64]) -> float:
    """Median soil height from the histogram."""
    total = int(counts.sum())
    if total < _MIN_SOIL_POINTS:
        return float("nan")
    sums = np.cumsum(counts)
    k = int(np.searchsorted(sums, 0.5 * total))
    within = (0.5 * total - (sums[k] - counts[k])) / counts[k]
    return float((k + within) * _SOIL_BIN_M - _SOIL_M)


@kernel_part()
def _gather(xyz_m, laser, t_s, rotation, lever_m, region, eighths, grid, sums):  # type: ignore[no-untyped-def]
    """Add the points of a scan to the sums of the revolutions."""
    box = region.box_m
    ground = region.ground
    lasers, width = region.still_m.shape
    bins = sums.soil.shape[1]
    turned = (region.split - region.begin) % width
    for i in range(len(xyz_m)):
        px = xyz_m[i, 0]
        py = xyz_m[i, 1]
        pz = xyz_m[i, 2]
        if not eighths[4 * (py > 0.0) + 2 * (px < 0.0) + (abs(py) > abs(px))]:
            continue
        column = column_of(px, py)
        if not region.columns[column]:
            continue
        since = column - region.begin if column >= region.begin else column - region.begin + width  # no slow division
        part = 0 if (since < turned) == region.clockwise else 1
        sums.times[part, 0, 0] += 1.0
        sums.times[part, 0, 1] += t_s[i]
        x = rotation[0, 0] * px + rotation[0, 1] * py + rotation[0, 2] * pz + lever_m[0]
        if not box[0] < x < box[1]:
            continue
        y = rotation[1, 0] * px + rotation[1, 1] * py + rotation[1, 2] * pz + lever_m[1]
        z = rotation[2, 0] * px + rotation[2, 1] * py + rotation[2, 2] * pz + lever_m[2]
        above = z - ground[0] - ground[1] * x - ground[2] * y
        if not box[2] < y < box[3]:
            if abs(above) < _SOIL_M and box[2] - _BESIDE_M < y < box[3] + _BESIDE_M:
                sums.soil[part, min(int((above + _SOIL_M) / _SOIL_BIN_M), bins - 1)] += 1
            continue
        if not CUT_M + CUT_PER_M * np.sqrt(x * x + y * y) < above < TOP_M:
            continue
        if laser[i] < lasers:
            distance = np.sqrt(px * px + py * py + pz * pz)
            still = False
            for beside in (column - 1, column, column + 1 if column + 1 < width else 0):  # -1 is the last one
                still |= abs(region.still_m[laser[i], beside] - distance) < AGREE_M
            if still:
                continue
        u = (x - grid.x_m) / CELL_X_M
        v = (above - grid.z_m) / CELL_Z_M - 0.5
        if u < 0.0 or v < 0.0:
            continue
        view_column = int(u)
        row = int(v)
        if view_column < grid.columns and row < grid.rows - 1:
            sums.times[part, 1, 0] += 1.0
            sums.times[part, 1, 1] += t_s[i]
            share = v - row
            sums.views[part, view_column, row] += 1.0 - share
            sums.views[part, view_column, row + 1] += share
