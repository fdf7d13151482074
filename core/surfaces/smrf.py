"""The ground among the lowest heights of cells: the simple morphological filter (SMRF).

T. J. Pingel, K. C. Clarke, W. A. McBride (2013), An improved simple morphological filter for the terrain
classification of airborne LIDAR data, ISPRS Journal of Photogrammetry and Remote Sensing 77, 21-30. What rises from the
ground more steeply than a slope, and is narrower than a window, is no ground.

Windows are squares here, disks there: the least and greatest of a square are found row by row and column by column, at
a cost that does not grow with the window. Gaps in the ground are filled by a soap
film over their rims, there by a network of springs.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import distance_transform_edt, grey_opening

FloatArray = NDArray[np.float64]

PIT_SLOPE: Final = 5.0
"""A cell that lies lower than those beside it by more than this slope is no ground but an error (Pingel: 500 %)."""


@dataclass(frozen=True)
class Smrf:
    """Parameters of the filter, named as in the paper's section 2.

    Attributes:
        cell_m: of the surface of lowest heights.
        slope: steepest rise of the ground, a share.
        window_m: half the width of the widest thing that stands on the ground.
        threshold_m: points farther than this from the ground's surface, up or down, are none of it.
        scale: and this times the surface's slope there, in metres.
    """

    cell_m: float = 0.5
    slope: float = 0.15
    window_m: float = 18.0
    threshold_m: float = 0.15
    scale: float = 1.25

    def __post_init__(self) -> None:
        if not all(math.isfinite(value) and value > 0.0 for value in (self.cell_m, self.slope, self.window_m)):
            raise ValueError(f"SMRF needs a cell, a slope and a window above zero: {self}")


def ground_cells(lowest_m: FloatArray, filter_: Smrf) -> NDArray[np.bool_]:
    """Which cells show the ground.

    Args:
        lowest_m: (rows, columns) lowest height in each cell; nan where there is none.
        filter_: what is ground.

    Returns:
        (rows, columns), False where there is no height.
    """
    seen = np.isfinite(lowest_m)
    if not seen.any():
        return seen
    pits = seen & _risen(-from_nearest(lowest_m), 1, PIT_SLOPE * filter_.cell_m)
    surface = from_nearest(np.where(pits, np.nan, lowest_m))
    standing = np.zeros(lowest_m.shape, bool)
    last = surface
    for reach in range(1, math.ceil(filter_.window_m / filter_.cell_m) + 1):
        opened = _opened(last, reach)
        standing |= last - opened > filter_.slope * reach * filter_.cell_m
        last = opened
    ground: NDArray[np.bool_] = seen & ~pits & ~standing
    return ground


def from_nearest(height_m: FloatArray) -> FloatArray:
    """Heights with each gap filled from the nearest cell that has one; there must be one."""
    gaps = np.isnan(height_m)
    if not gaps.any():
        return height_m
    nearest = distance_transform_edt(gaps, return_distances=False, return_indices=True)
    taken: FloatArray = height_m[tuple(nearest)]
    return taken


def _risen(surface_m: FloatArray, reach: int, by_m: float) -> NDArray[np.bool_]:
    """What rises above the opened surface."""
    risen: NDArray[np.bool_] = surface_m - _opened(surface_m, reach) > by_m
    return risen


def _opened(surface_m: FloatArray, reach: int) -> FloatArray:
    """Least and then greatest height of the squares that reach so many cells to each side."""
    opened: FloatArray = grey_opening(surface_m, size=(2 * reach + 1,) * 2, mode="nearest")
    return opened
