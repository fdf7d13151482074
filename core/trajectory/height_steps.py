"""Heights of positions that jump from one level to another, which no vehicle does between two epochs.

Logs that hold ellipsoidal heights in one part and altitudes in another, receivers that were restarted with another
geoid, and bases that were moved make such steps. Alignment and adjustment need a height that goes on, so that the parts
are put on the level that most of the positions have. Which level is right, no step says: heights are as uncertain as
the levels differ.
"""

from dataclasses import replace
from typing import Final

import numpy as np

from furrowmap.core.runtime.errors import Notice
from furrowmap.core.trajectory.used_positions import (
    AROUND,
    HEIGHT_JUMP_FLOOR_M,
    JUMP_SIGMAS,
    MAX_STEP_INTERVALS,
    MIN_POSITIONS_FOR_STEPS,
    UsedPositions,
    sigmas_m,
)
from furrowmap.core.values.clock import iso_utc

MAX_CLIMB_ACCELERATION_MPS2: Final = 10.0
"""Of an aircraft or a vehicle between two epochs."""
MEDIAN_OF_NORMAL: Final = 0.6745
"""Median of absolute normal deviates, in their standard deviation."""


def without_height_steps(positions: UsedPositions, *, lasting: bool = False) -> UsedPositions:
    """The positions with heights on one level.

    Args:
        positions: with heights, in the order of time.
        lasting: whether levels of few positions, and steps between positions of different quality, are left: outliers,
            and errors of float solutions, which have standard deviations of their own.
    """
    track = positions.track
    if len(track) < MIN_POSITIONS_FOR_STEPS or not np.isfinite(track.height_m).all():
        return positions
    step_s = np.diff(track.t_s)
    climb_mps = np.diff(track.height_m) / step_s
    around = np.clip(np.arange(len(step_s))[:, None] + np.array(AROUND), 0, len(step_s) - 1)
    step_m = (climb_mps - np.median(climb_mps[around], axis=1)) * step_s
    # Heights may scatter more than their standard deviations say.
    scatter_m = float(np.median(np.abs(step_m))) / MEDIAN_OF_NORMAL
    sigma_m = np.maximum(sigmas_m(track)[:, 1], scatter_m)
    reach_m = np.maximum(HEIGHT_JUMP_FLOOR_M, JUMP_SIGMAS * np.maximum(sigma_m[1:], sigma_m[:-1]))
    reach_m += 0.5 * MAX_CLIMB_ACCELERATION_MPS2 * step_s**2
    steps = np.flatnonzero((np.abs(step_m) > reach_m) & (step_s < MAX_STEP_INTERVALS * np.median(step_s)))
    if lasting:
        steps = steps[track.fix[steps] == track.fix[steps + 1]]
    if not len(steps):
        return positions
    level = np.searchsorted(steps, np.arange(len(track)))
    level_m = np.append(0.0, np.cumsum(step_m[steps]))
    sizes = np.bincount(level)
    level_m -= level_m[np.argmax(sizes)]
    counts = sizes >= (MIN_POSITIONS_FOR_STEPS if lasting else 1)
    most_m = float(np.abs(level_m[counts]).max(initial=0.0))
    if most_m < HEIGHT_JUMP_FLOOR_M:
        return positions
    notice = Notice(
        "gnss-height-steps",
        source=track.source or "The GNSS log",
        steps=len(steps),
        most_m=most_m,
        first=iso_utc(float(track.t_s[steps[0] + 1])),
        last=iso_utc(float(track.t_s[steps[-1] + 1])),
    )
    level_track = replace(track, height_m=track.height_m - level_m[level])
    return replace(positions, track=level_track, levels_m=most_m).told(notice)
