"""What a move leaves under ground that changed: how far a mean of changes is off, by the ground around it."""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_solve

from furrowmap.core.crops.soil import least_squares
from furrowmap.core.crops.soil_cells import SoilCells
from furrowmap.core.dates.pair_tie import LEVEL, PairTie

FloatArray = NDArray[np.float64]

MOST_PLACES: Final = 300


def left_under(
    xy_m: FloatArray, middle_m: FloatArray, move: FloatArray, covariance: FloatArray, tie: PairTie | None
) -> tuple[float, float]:
    """What is left of the error of a mean change when the moves are applied, and its standard deviation.

    The differences of untouched ground depart from the moves; under the changed ground, departures are interpolated
    from those around it (universal kriging of the mean of a block: Cressie 1993, section 3.4).

    Args:
        xy_m: (n, 2) places of the cells whose mean is taken.
        middle_m: (2,) of the field.
        move: (6,) of the second date less that of the first.
        covariance: (6, 6) of it.
        tie: of the two dates; None where they are tied by others only.

    Returns:
        The mean error to subtract, and the standard deviation of what remains, both in m.
    """
    places = xy_m[:: max(1, len(xy_m) // MOST_PLACES)]
    design = _design(places, middle_m)
    mean = design.mean(axis=0)
    variance = float(mean @ covariance[np.ix_(LEVEL, LEVEL)] @ mean)
    if tie is None:
        return 0.0, math.sqrt(variance)
    at_cells = _design(tie.departures.xy_m, middle_m)
    moved = at_cells @ (move[LEVEL] - tie.move[LEVEL])
    cells = SoilCells(tie.departures.xy_m, tie.departures.height_m + moved, tie.departures.sigma_m)
    plane, of_plane, factor = least_squares(cells, tie.departure, at_cells)
    near = tie.departure.between(places, cells.xy_m).mean(axis=0)
    seen = cho_solve(factor, near)
    lacking = mean - at_cells.T @ seen
    variance = float(tie.departure.between(places, places).mean() - near @ seen + lacking @ of_plane @ lacking)
    return float(mean @ plane + seen @ (cells.height_m - at_cells @ plane)), math.sqrt(max(variance, 0.0))


def _design(xy_m: FloatArray, middle_m: FloatArray) -> FloatArray:
    return np.column_stack([np.ones(len(xy_m)), xy_m - middle_m])
