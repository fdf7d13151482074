"""Steps in the error of positions: ambiguities fixed wrongly, with standard deviations as of right ones.

Poses that scans, wheels or an IMU hold together show them: medians of errors before and after differ, and most of that
comes from one position to the next. What a wrong lever arm or clock does takes the seconds of a turn.
"""

from dataclasses import replace
from typing import Final

import numpy as np

from furrowmap.core.runtime.arrays import FloatArray, IntArray
from furrowmap.core.runtime.errors import Notice
from furrowmap.core.values.clock import iso_utc
from furrowmap.core.values.gnss import Positions

OVER_S: Final = 2.5
MIN_OVER: Final = 5
"""Medians are of the positions of OVER_S before and after, but of at least so many: half as long lasts an outlier."""
STEP_SIGMAS: Final = 8.0
"""Of the usual scatter, of medians and of neighbours: right recordings have up to 5."""
STATED_SIGMAS: Final = 3.0
"""Smaller steps are within what the receiver states."""
LASTS: Final = 0.2
"""Least share of a step that medians show: poses bend from one side to the other."""
HIDDEN: Final = 2.0
"""Times as large as it shows a step may be, for the same reason."""
ABRUPT: Final = 0.5
"""Least share of what medians show that comes from one position to the next."""
ENDS: Final = 0.6
"""Share of these limits from which on others count beside a step: what begins ends."""
CLEAR_SHARE: Final = 0.6
"""Share of the positions on one level from which on it is taken for the right one."""


def with_steps(positions: Positions, error_m: FloatArray) -> tuple[Positions, tuple[Notice, ...]]:
    """Positions (m,) whose slow error begins anew at each step that errors (m, 3) show, nan where unknown; notices.

    On the level that most have, it is as stated; others may be off by the difference, and all without CLEAR_SHARE.
    """
    known = np.flatnonzero(np.isfinite(error_m).all(axis=1))
    stated_m = np.hypot(positions.drift_m, positions.white_m)
    found = steps(positions.t_s[known], error_m[known], positions.run[known], stated_m[known])
    if not found:
        return positions, ()
    begins = known[sorted(found)]
    level = np.searchsorted(begins, np.arange(len(positions.t_s)), side="right")
    level_m = np.cumsum([np.zeros(3), *(found[k] for k in sorted(found))], axis=0)
    apart_m = np.abs(level_m[:, None] - level_m)
    alike = np.linalg.norm(apart_m, axis=2) < 0.5 * np.linalg.norm(np.diff(level_m, axis=0), axis=1).max()
    share = alike @ np.bincount(level) / len(level)
    right = int(np.argmax(share))
    clear = share[right] > CLEAR_SHARE
    off_m = apart_m[right] * ~alike[right, :, None] if clear else apart_m.max(axis=1)
    # Chains of poses begin anew after pauses, in which errors are unknown.
    starts = np.union1d([0, *begins], known[np.diff(known, prepend=-2) > 1])
    drift_m = positions.drift_m.copy()
    drift_m[starts] = np.hypot(drift_m[starts], HIDDEN * off_m[level[starts]])
    there = np.flatnonzero(off_m.any(axis=1)[level]) if clear else begins
    first, last = (iso_utc(float(positions.t_s[there[k]])) for k in (0, -1))
    most_m = float(np.linalg.norm(off_m, axis=1).max())
    key = "gnss-steps.shown" if clear else "gnss-steps.either"
    notice = Notice(key, there=len(there), first=first, last=last, off_m=most_m, sigma_m=np.median(stated_m[:, 0]))
    return replace(positions, run=positions.run + level, drift_m=drift_m), (notice,)


def steps(t_s: FloatArray, error_m: FloatArray, run: IntArray, stated_m: FloatArray) -> dict[int, FloatArray]:
    """Steps (3,) by the index of the first of the errors (n, 3) after each.

    `run` (n,) numbers the runs within which they are continuous, `stated_m` (n, 3) are stated standard deviations.
    """
    found: dict[int, FloatArray] = {}
    each_s = float(np.median(np.diff(t_s))) if len(t_s) > 1 else OVER_S
    over = max(MIN_OVER, round(OVER_S / each_s))
    if len(t_s) < 6 * over:
        return found
    median_m = np.median(np.lib.stride_tricks.sliding_window_view(error_m, over, axis=0), axis=2)
    differ_m = median_m[over:] - median_m[:-over]
    next_m = np.diff(error_m, axis=0)[over - 1 : 1 - over]
    same_run = run[2 * over - 1 :] == run[: len(differ_m)]
    follows = same_run & (t_s[2 * over - 1 :] - t_s[: len(differ_m)] < 3.0 * over * each_s)
    least_m = STATED_SIGMAS * stated_m[over : over + len(differ_m)]
    lasting, single = (_size(step_m, least_m) * follows for step_m in (differ_m, next_m))
    size = np.maximum(lasting, single)
    while size.max() > (ENDS if found else 1.0):
        k = int(np.argmax(size))
        at = max(0, k - over // 2) + int(np.argmax(single[max(0, k - over // 2) : k + over // 2 + 1]))
        most_m2 = max(LASTS * (next_m[at] @ next_m[at]), ABRUPT * (differ_m[at] @ differ_m[at]))
        if next_m[at] @ differ_m[at] > most_m2:
            found[at + over] = max(next_m[at], differ_m[at], key=np.linalg.norm)
        size[max(0, k - over // 2) : k + over // 2 + 1] = 0.0
    return found


def _size(step_m: FloatArray, least_m: FloatArray) -> FloatArray:
    usual_m = [np.median(np.hypot(step_m[:, 0], step_m[:, 1])) / 1.1774, np.median(np.abs(step_m[:, 2])) / 0.6745]
    scaled = step_m / np.maximum(STEP_SIGMAS * np.repeat(usual_m, (2, 1)), least_m)
    return np.asarray(np.maximum(np.hypot(scaled[:, 0], scaled[:, 1]), np.abs(scaled[:, 2])))
