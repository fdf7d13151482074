"""The returns of a run around some points, gathered while scans are placed."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from furrowmap.core.pointclouds.placed_scans import PlacedScan
from furrowmap.core.runtime.arrays import FloatArray

MAX_POINT_RETURNS: Final = 100_000
"""Returns kept at a point; of twice as many every second one is."""


@dataclass(frozen=True)
class ReturnsAround:
    """n returns around a point, in the order of measurement.

    Attributes:
        xyz_m: (n, 3) relative to the point.
        t_s: (n,) UTC.
        intensity: (n,).
    """

    xyz_m: FloatArray
    t_s: FloatArray
    intensity: FloatArray

    def __len__(self) -> int:
        return len(self.t_s)

    def where(self, chosen: NDArray[np.bool_]) -> ReturnsAround:
        """Some of the returns."""
        return ReturnsAround(self.xyz_m[chosen], self.t_s[chosen], self.intensity[chosen])

    def beside(self, at_m: FloatArray) -> ReturnsAround:
        """The returns relative to a place (2,) beside the point."""
        return ReturnsAround(self.xyz_m - np.array([*at_m, 0.0]), self.t_s, self.intensity)


class ReturnsAtPoints:
    """Takes placed scans, and keeps what may lie on the land within a reach of points (k, 3) in the map frame.

    What is kept does not depend on how the scans come together, and does not grow with the recording.
    """

    def __init__(self, points_m: FloatArray, origin_m: tuple[float, float, float], reach_m: float) -> None:
        self._points_m = points_m - np.asarray(origin_m)
        self._reach_m = reach_m
        self._tree = cKDTree(self._points_m[:, :2])
        self._low_m = self._points_m[:, :2].min(axis=0) - reach_m
        self._high_m = self._points_m[:, :2].max(axis=0) + reach_m
        self._kept: list[list[FloatArray]] = [[] for _ in points_m]
        self._number = [0] * len(points_m)
        self._step = [1] * len(points_m)
        self._seen = [0] * len(points_m)

    def add(self, placed: PlacedScan) -> None:
        """Take the points of some scans."""
        xy = placed.xyz_m[:, :2]
        near = np.flatnonzero(placed.kept & ((xy >= self._low_m) & (xy <= self._high_m)).all(axis=1))
        if not len(near):
            return
        cells = self._tree.query_ball_tree(cKDTree(xy[near]), self._reach_m)
        for number, found in enumerate(cells):
            if found:
                self._keep(number, placed, near[np.sort(found)])

    def _keep(self, number: int, placed: PlacedScan, chosen: NDArray[np.intp]) -> None:
        """Keep each so manieth of the returns at a point."""
        step = self._step[number]
        place = self._seen[number] + np.arange(len(chosen))
        self._seen[number] += len(chosen)
        chosen = chosen[place % step == 0]
        scan = placed.scan
        rows = np.column_stack(
            [placed.xyz_m[chosen] - self._points_m[number], scan.t_s[chosen], scan.intensity[chosen]]
        )
        self._kept[number].append(rows)
        self._number[number] += len(rows)
        if self._number[number] >= 2 * MAX_POINT_RETURNS:
            rows = np.concatenate(self._kept[number])[::2]
            self._kept[number] = [rows]
            self._number[number] = len(rows)
            self._step[number] = 2 * step

    def at(self, number: int) -> ReturnsAround:
        """The returns around a point."""
        rows = np.concatenate([np.empty((0, 5)), *self._kept[number]])
        return ReturnsAround(rows[:, :3], rows[:, 3], rows[:, 4])
