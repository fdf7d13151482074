"""The two positions of a tool from its heights, and whether they are plausible."""

from typing import Final

import numpy as np
from numpy.typing import NDArray

from furrowmap.core.implement.seen_implement import Levels
from furrowmap.core.implement.views import Heights, Views
from furrowmap.core.runtime.arrays import FloatArray
from furrowmap.core.values.tool_states import ToolState

MOVED_M: Final = 0.10
"""Least travel of a tool; less is a swinging frame."""
MIN_LEVEL_SCANS: Final = 3
_NOISE_M: Final = 0.04
"""Greatest scatter between successive scans."""
SHORTEST_S: Final = 1.5
"""Least mean time between changes of state."""
_LEFT_M: Final = 0.03
"""Tolerance of a position."""
_AWAY_SHARE: Final = 0.3
"""With a smaller share of the usual points the tool is out of view, not only occluded."""
_MIN_STATE_SHARE: Final = 0.02
_MIN_LEAVING_SCANS: Final = 2
_MAX_AWAY_SHARE: Final = 0.7
"""Greatest share of time out of view of a tool that is seen in both positions."""


def find_positions(views: Views, heights: Heights) -> Levels | None:
    """Lower and upper position; None where nothing is lifted and lowered."""
    return _seen_to_move(views, heights) or _seen_to_leave(views, heights)


def _seen_to_move(views: Views, heights: Heights) -> Levels | None:
    """The two positions of a tool that is seen in both, or on most of its travel."""
    sure = heights.sure
    height = heights.height_m
    if np.count_nonzero(sure) < 2 * MIN_LEVEL_SCANS:
        return None
    upper = sure & (height > _split(height[sure]))
    lower = sure & ~upper
    below, above, away = (int(np.count_nonzero(side)) for side in (lower, upper, ~sure))
    if min(below, above) < MIN_LEVEL_SCANS or _dwell_s(views, upper, lower) < SHORTEST_S:
        return None
    low = float(np.median(height[lower]))
    high = float(np.median(height[upper]))
    if high - low < MOVED_M:
        return None
    sigma_low = _sigma(views, height, lower)
    sigma_high = _sigma(views, height, upper)
    limit = min(_NOISE_M, (high - low) / 8.0)
    if sigma_low < limit and sigma_high < limit and away < _MAX_AWAY_SHARE * len(sure):
        return Levels(low, high, ToolState.UNKNOWN, min(sigma_low, sigma_high), max(sigma_low, sigma_high))
    # out of view in one state: the few heights on that side are of the moving tool
    if sigma_high < limit and away > below and below < above:
        return Levels(float(np.quantile(height[lower], 0.1)), high, ToolState.DOWN, sigma_high, sigma_high)
    if sigma_low < limit and away > above and above < below:
        return Levels(low, float(np.quantile(height[upper], 0.9)), ToolState.UP, sigma_low, sigma_low)
    return None


def _seen_to_leave(views: Views, heights: Heights) -> Levels | None:
    """The position of a tool with one constant height and long absences, which is seen to leave downward or upward."""
    sure = heights.sure
    height = heights.height_m
    if np.count_nonzero(sure) < 2 * MIN_LEVEL_SCANS:
        return None
    level = float(np.median(height[sure]))
    there = sure & (np.abs(height - level) < _LEFT_M)
    away = ~sure & (heights.there < _AWAY_SHARE * heights.usual[0])
    sigma = _sigma(views, height, there)
    fewest = max(2 * MIN_LEVEL_SCANS, _MIN_STATE_SHARE * len(sure))
    if min(np.count_nonzero(there), np.count_nonzero(away)) < fewest or np.count_nonzero(there | away) < 0.8 * len(
        sure
    ):
        return None
    if sigma > 0.5 * _LEFT_M or _dwell_s(views, there, away) < SHORTEST_S:
        return None
    below = sure & (height < level - _LEFT_M)
    above = sure & (height > level + _LEFT_M)
    lower = int(np.count_nonzero(below))
    higher = int(np.count_nonzero(above))
    if lower >= _MIN_LEAVING_SCANS and lower > 2 * higher:
        return Levels(float(height[below].min()), level, ToolState.DOWN, sigma, sigma)
    if higher >= _MIN_LEAVING_SCANS and higher > 2 * lower:
        return Levels(level, float(height[above].max()), ToolState.UP, sigma, sigma)
    return None


def _split(height: FloatArray) -> float:
    """Threshold between two groups with the least variance within (Otsu 1979)."""
    ordered = np.sort(height)
    n = np.arange(1, len(ordered))
    total = np.cumsum(ordered)[:-1]
    square = np.cumsum(ordered**2)[:-1]
    whole = float(ordered.sum())
    whole_square = float((ordered**2).sum())
    within = square - total**2 / n + (whole_square - square) - (whole - total) ** 2 / (len(ordered) - n)
    k = int(np.argmin(within))
    return float(0.5 * (ordered[k] + ordered[k + 1]))


def _sigma(views: Views, height: FloatArray, side: NDArray[np.bool_]) -> float:
    """Standard deviation of the heights on one side, from differences of successive scans."""
    first, second = views.pairs.T
    step = (height[second] - height[first])[side[first] & side[second]]
    return float(1.4826 * np.median(np.abs(step)) / np.sqrt(2.0)) if len(step) else float("inf")


def _dwell_s(views: Views, upper: NDArray[np.bool_], lower: NDArray[np.bool_]) -> float:
    """Mean time in one state, from the changes between successive scans."""
    pairs = views.pairs
    if not len(pairs):
        return float("inf")
    first, second = pairs.T
    known = (upper | lower)[first] & (upper | lower)[second]
    changes = np.count_nonzero(known & (upper[first] != upper[second]))
    step_s = np.median([views.scans[b].begin_s - views.scans[a].begin_s for a, b in pairs.tolist()])
    return float(step_s) * int(np.count_nonzero(known)) / max(int(changes), 1)
