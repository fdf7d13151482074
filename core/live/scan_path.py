"""The way of a vehicle by its scans alone, each matched to the ground that those before it saw."""

from dataclasses import dataclass
from typing import Final

import numpy as np

from furrowmap.core.runtime.arrays import FloatArray

UNSEEN_TURN_RADPS: Final = np.radians(10.0)
"""A rate of turn that no scan shows."""
KEPT_S: Final = 15.0
"""Time over which paths and poses are kept, and over which the noise of positions is estimated."""


@dataclass(frozen=True)
class PathPoint:
    """Where the scans have the vehicle, in a frame of their own, which turns and drifts against the map.

    Attributes:
        yaw_rad: the sum of their turns.
        yaw_variance: of that sum, in rad²; only its growth counts.
        place_m: (3,) on the ground's cells.
        place_variance: along each axis of the plan, in m²; only its growth counts.
        up: (2,) x and y of the upward direction in the vehicle frame, where its z is 1.
    """

    yaw_rad: float
    yaw_variance: float
    place_m: FloatArray
    place_variance: float
    up: FloatArray


class ScanPath:
    """The last seconds of the path.

    Args:
        t_s: UTC of the first point.
        first: where the scans have the vehicle then.

    Attributes:
        turn_radps: rate of turn by which it goes on.
    """

    def __init__(self, t_s: float, first: PathPoint) -> None:
        self._rows = np.array([_row(t_s, first)])
        self.turn_radps = 0.0

    @property
    def end_s(self) -> float:
        """UTC of the last point."""
        return float(self._rows[-1, 0])

    def longest_step_s(self, begin_s: float, end_s: float) -> float:
        """The longest time without scans between two times, of which the latter may be after the path."""
        t_s = self._rows[:, 0]
        first = max(0, int(np.searchsorted(t_s, begin_s, side="right")) - 1)
        last = int(np.searchsorted(t_s, end_s)) + 1
        return float(max(np.diff(t_s[first:last]).max(initial=0.0), end_s - t_s[-1]))

    def add(self, t_s: float, point: PathPoint) -> None:
        """Add a point that is later than all others."""
        self._rows = np.vstack([self._rows[self._rows[:, 0] > t_s - KEPT_S], _row(t_s, point)])

    def at(self, t_s: float, speed_mps: float = 0.0) -> PathPoint:
        """The point at a time; after the last one the vehicle goes on turning for a second, with that speed."""
        rows = self._rows
        k = int(np.clip(np.searchsorted(rows[:, 0], t_s) - 1, 0, max(0, len(rows) - 2)))
        before = rows[k]
        after = rows[min(k + 1, len(rows) - 1)]
        step_s = float(after[0] - before[0])
        share = float(np.clip((t_s - before[0]) / step_s, 0.0, 1.0)) if step_s > 0.0 else 0.0
        yaw, variance, x, y, z, sigma, *up = (before + share * (after - before))[1:].tolist()
        ahead_s = max(0.0, t_s - self.end_s)
        way_m = speed_mps * ahead_s
        return PathPoint(
            yaw + self.turn_radps * min(ahead_s, 1.0),
            variance + (UNSEEN_TURN_RADPS * ahead_s) ** 2,
            np.array([x + way_m * np.cos(yaw), y + way_m * np.sin(yaw), z]),
            sigma,
            np.array(up),
        )


def _row(t_s: float, point: PathPoint) -> FloatArray:
    return np.array(
        [t_s, point.yaw_rad, point.yaw_variance, *point.place_m, point.place_variance, *point.up], np.float64
    )
