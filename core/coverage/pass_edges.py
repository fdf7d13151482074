"""How far the ends of the tool's line are from the edges of the passes beside it."""

import math
from typing import Final

import numpy as np

from furrowmap.core.coverage.worked_cells import Swept
from furrowmap.core.runtime.arrays import FloatArray

AHEAD_M: Final = 0.6
"""Ground so far ahead of the line or behind it shows an edge."""
OWN_M: Final = 5.0
"""What the tool worked on less way than this ago is of this pass."""
LONGEST_STEP_M: Final = 30.0
"""Longest way between two places of the line."""
NEIGHBOUR_WIDTHS: Final = 3.0
"""An edge so many widths away is of no neighbour."""


def edge_gaps_m(swept: Swept, line_m: FloatArray, way_m: float) -> tuple[float, float]:
    """Ground between the left and the right end of the tool's line and the passes there; nan without a pass.

    Args:
        swept: all that was worked.
        line_m: (2, 2) easting and northing of the right and the left end.
        way_m: driven forward until now.

    Returns:
        Of the left and of the right end; negative where the tool works a pass again.
    """
    across = line_m[1] - line_m[0]
    width_m = float(np.hypot(*across))
    if not len(swept) or width_m == 0.0:
        return math.nan, math.nan
    left = across / width_m
    ahead = np.array([left[1], -left[0]])
    middle = line_m.mean(axis=0)
    reach_m = (NEIGHBOUR_WIDTHS + 1.0) * width_m + LONGEST_STEP_M
    swept = swept[(np.abs(swept.corners_m[:, 0] - middle) < reach_m).all(axis=1)]
    from_m = swept.corners_m - middle
    along_m = from_m @ ahead
    near = swept.seen & (swept.way_m < way_m - OWN_M)
    near &= (along_m.min(axis=1) < AHEAD_M) & (along_m.max(axis=1) > -AHEAD_M)
    lateral_m = from_m[near] @ left
    right_m = lateral_m.min(axis=1)
    left_m = lateral_m.max(axis=1)
    near_enough = (left_m > -NEIGHBOUR_WIDTHS * width_m) & (right_m < NEIGHBOUR_WIDTHS * width_m)
    is_left = right_m + left_m > 0.0
    of_left = right_m[near_enough & is_left]
    of_right = left_m[near_enough & ~is_left]
    return (
        float(of_left.min()) - 0.5 * width_m if len(of_left) else math.nan,
        -0.5 * width_m - float(of_right.max()) if len(of_right) else math.nan,
    )
