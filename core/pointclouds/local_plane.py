"""The plane of the ground at a point, through the returns around it."""

from dataclasses import dataclass
from typing import Final

import numpy as np

from furrowmap.core.runtime.arrays import FloatArray

PLANE_RADIUS_M: Final = 0.25
"""Radius of the returns to which the plane at a point is fitted."""
MAX_PLANE_SLOPE: Final = 0.5
"""A steeper plane is an edge, where the height depends on the position."""
MIN_PLANE_RETURNS: Final = 6
PLANE_OUTLIER_SIGMAS: Final = 3.5
"""Outlier threshold, in robust standard deviations."""
SPACINGS: Final = 2.0
"""Side of the cells in which returns are compared, in mean point spacings."""


@dataclass(frozen=True)
class LocalPlane:
    """A plane through n returns: its rise to the east and north, places (n, 2) relative to the point, and residuals."""

    height_m: float
    slope: tuple[float, float]
    xy_m: FloatArray
    above_m: FloatArray

    @property
    def steepness(self) -> float:
        """Slope as a ratio."""
        return float(np.hypot(*self.slope))

    @property
    def freedom(self) -> int:
        """Degrees of freedom of the fit."""
        return len(self.above_m) - 3

    @property
    def range_m(self) -> float:
        """Greatest difference of residuals within a cell of two mean point spacings, where relief is negligible."""
        radius_m = float(np.hypot(*self.xy_m.T).max())
        side_m = SPACINGS * radius_m * np.sqrt(np.pi / len(self.above_m))
        column, row = np.floor(self.xy_m / side_m).astype(np.int64).T
        cell = np.unique(column * (1 << 32) + row, return_inverse=True)[1]
        low = np.full(cell.max() + 1, np.inf)
        high = np.full(cell.max() + 1, -np.inf)
        np.minimum.at(low, cell, self.above_m)
        np.maximum.at(high, cell, self.above_m)
        return float((high - low).max())


def local_plane(xyz_m: FloatArray) -> LocalPlane | None:
    """Plane through returns (n, 3) around 0, 0, refitted once without outliers.

    None with too few returns, or where they do not lie on all sides.
    """
    keep = np.ones(len(xyz_m), bool)
    for _ in range(2):
        if keep.sum() < MIN_PLANE_RETURNS:
            return None
        x, y, z = xyz_m[keep].T
        (height, east, north), _, rank, _ = np.linalg.lstsq(np.column_stack([np.ones(len(x)), x, y]), z, rcond=1e-6)
        if rank < 3 or min(x.max(), -x.min(), y.max(), -y.min()) <= 0.0:
            return None
        above = xyz_m[:, 2] - height - east * xyz_m[:, 0] - north * xyz_m[:, 1]
        used = keep
        scatter = 1.4826 * float(np.median(np.abs(above[keep])))
        keep = np.abs(above) <= max(PLANE_OUTLIER_SIGMAS * scatter, 1e-3)
    return LocalPlane(float(height), (float(east), float(north)), xyz_m[used, :2], above[used])
