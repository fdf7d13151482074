"""Simple morphological filter (SMRF): the ground among the lowest heights of cells.

T. J. Pingel, K. C. Clarke, W. A. McBride (2013), An improved simple morphological filter for the terrain
classification of airborne LIDAR data, ISPRS Journal of Photogrammetry and Remote Sensing 77, 21-30, with square windows
instead of disks (separable, so at constant cost) and gaps filled by harmonic interpolation instead of springs.
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
"""A cell below its neighbours by more than this slope is an error (Pingel: 500 %)."""


@dataclass(frozen=True)
class Smrf:
    """Parameters of the filter, named as in the paper's section 2.

    Attributes:
        cell_m: of the surface of lowest heights.
        slope: steepest slope of the ground, as a ratio.
        window_m: half the width of the widest object.
        threshold_m: greatest distance of ground points from the surface.
        scale: added to that, times the slope of the surface.
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
    """Which cells (rows, columns) are ground by their lowest heights `lowest_m`; False where these are nan."""
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
    """Heights with gaps filled from the nearest cell; at least one is finite."""
    gaps = np.isnan(height_m)
    if not gaps.any():
        return height_m
    nearest = distance_transform_edt(gaps, return_distances=False, return_indices=True)
    taken: FloatArray = height_m[tuple(nearest)]
    return taken


def _risen(surface_m: FloatArray, reach: int, by_m: float) -> NDArray[np.bool_]:
    """Where the surface exceeds its opening by more than `by_m`."""
    risen: NDArray[np.bool_] = surface_m - _opened(surface_m, reach) > by_m
    return risen


def _opened(surface_m: FloatArray, reach: int) -> FloatArray:
    """Morphological opening with a square that reaches this many cells to each side."""
    opened: FloatArray = grey_opening(surface_m, size=(2 * reach + 1,) * 2, mode="nearest")
    return opened
