"""Working depth of each pass, from the height of the tool relative to the soil beside it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from furrowmap.core.runtime.arrays import FloatArray
from furrowmap.core.work.sweep import PassTimes

SETTLING_S: Final = 1.0
"""Time at both ends of a pass in which the tool still moves."""
MIN_PASS_HEIGHTS: Final = 5
SOIL_SIGMA_M: Final = 0.02
"""Standard deviation of the soil's height beside the tool over that which the tool works: loosened by the pass before,
rows, clods, straw. In the two samples, whose six passes are all 12 cm deep, depths are off by 2.3 cm (RMS) and at most
by 4.1 cm."""


@dataclass(frozen=True)
class Depth:
    """The working depth of one pass.

    Attributes:
        depth_m: median; nan where unknown.
        spread_m: standard deviation within the pass, robust; nan where unknown.
        sigma_m: standard deviation of the depth, if the stated one is right; nan where unknown.
    """

    depth_m: float
    spread_m: float
    sigma_m: float


UNKNOWN_DEPTH: Final = Depth(math.nan, math.nan, math.nan)


def pass_depths(
    passes: Sequence[PassTimes],
    t_s: FloatArray,
    tool_height_m: FloatArray,
    soil_height_m: FloatArray,
    working_depth_m: float | None,
) -> tuple[Depth, ...]:
    """The working depth of each pass.

    The scanner sees the tool relative to the soil beside it, but not its tines: the median of all passes is taken as
    the stated working depth. Without a stated depth only the spread is known.

    Args:
        passes: in the order of time.
        t_s: (n,) UTC of the heights, increasing.
        tool_height_m: (n,) above the working position; nan where unknown.
        soil_height_m: (n,) of the soil beside the tool in the vehicle's frame; nan where unknown.
    """
    sunk_m = soil_height_m - tool_height_m
    inside = [
        sunk_m[(t_s > p.begin_s + SETTLING_S) & (t_s < p.end_s - SETTLING_S) & np.isfinite(sunk_m)] for p in passes
    ]
    medians = [float(np.median(part)) if len(part) >= MIN_PASS_HEIGHTS else math.nan for part in inside]
    known = np.isfinite(medians)
    usual_m = float(np.median(np.array(medians)[known])) if known.any() else math.nan
    stated_m = working_depth_m if working_depth_m is not None else math.nan
    depths = []
    for part, median_m in zip(inside, medians, strict=True):
        depth_m = stated_m + median_m - usual_m
        # What varies within a pass varies over metres: its mean is hardly better than a single value.
        spread_m = 1.4826 * float(np.median(np.abs(part - median_m))) if len(part) else math.nan
        depths.append(
            Depth(depth_m, spread_m, math.hypot(SOIL_SIGMA_M, spread_m) if math.isfinite(depth_m) else math.nan)
        )
    return tuple(depths)
