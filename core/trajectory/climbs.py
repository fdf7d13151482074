"""Heights that change by more than a vehicle on wheels climbs along its way."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from furrowmap.core.runtime.errors import Notice
from furrowmap.core.trajectory.positions import sigmas_m
from furrowmap.core.values.clock import iso_utc
from furrowmap.core.values.gnss import GnssTrack

FloatArray = NDArray[np.float64]

WINDOWS_S: Final = (3.0, 10.0, 30.0)
STEEPEST: Final = 0.45
"""Slope that vehicles on wheels climb at most for so long: steep vineyards are worked by winch from there on."""
FLOOR_M: Final = 1.0
"""For slow errors, which stated standard deviations do not hold."""
SIGMAS: Final = 3.0
GAP_S: Final = 2.0
"""Over longer pauses, if they are also longer than GAP_INTERVALS usual intervals, the way is not known."""
GAP_INTERVALS: Final = 5.0


def climb_notices(track: GnssTrack, en_m: FloatArray) -> list[Notice]:
    """A notice where heights rise or fall by more than STEEPEST along the way and their standard deviations allow.

    The way is the sum of the steps between positions: noise makes it longer, never shorter.

    Args:
        track: (n,) positions of a vehicle on the ground, those that are used.
        en_m: (n, 2) on the map.
    """
    known = np.isfinite(track.height_m)
    if known.sum() < 2:
        return []
    track, en_m = track[known], en_m[known]
    t_s, sigma_m = track.t_s, sigmas_m(track)[:, 1]
    step_s = np.diff(t_s)
    way_m = np.append(0.0, np.cumsum(np.linalg.norm(np.diff(en_m, axis=0), axis=1)))
    gaps = np.append(0, np.cumsum(step_s > max(GAP_S, GAP_INTERVALS * float(np.median(step_s)))))
    steep = np.zeros(len(t_s), bool)
    worst, worst_at = 0.0, (0, 0)
    for window_s in WINDOWS_S:
        first = np.arange(len(t_s))
        last = np.searchsorted(t_s, t_s + window_s, side="right") - 1
        first, last = first[whole := gaps[last] == gaps], last[whole]
        allowed_m = FLOOR_M + STEEPEST * (way_m[last] - way_m[first]) + SIGMAS * np.hypot(sigma_m[first], sigma_m[last])
        beyond_m = np.abs(track.height_m[last] - track.height_m[first]) - allowed_m
        steep[first] |= beyond_m > 0.0
        at = int(np.argmax(beyond_m))
        if beyond_m[at] > worst:
            worst, worst_at = float(beyond_m[at]), (int(first[at]), int(last[at]))
    if not steep.any():
        return []
    a, b = worst_at
    return [
        Notice(
            "gnss-heights",
            source=track.source or "The GNSS log",
            height_m=track.height_m[b] - track.height_m[a],
            way_m=way_m[b] - way_m[a],
            t_s=iso_utc(t_s[a]),
            t_s_2=iso_utc(t_s[b]),
            steepest=100.0 * STEEPEST,
            sigma_m=max(sigma_m[a], sigma_m[b]),
            steep=int(steep.sum()),
            t_s_count=len(t_s),
        )
    ]
