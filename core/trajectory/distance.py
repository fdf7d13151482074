"""How far a vehicle drove, and how long it stood."""

from __future__ import annotations

import numpy as np

from furrowmap.core.trajectory.motion import length_m
from furrowmap.core.values.trajectory import Motion, Trajectory


def distance_and_standing(trajectory: Trajectory, begin_s: float, end_s: float) -> tuple[float, float]:
    """Distance driven (m) and time at a standstill (s) within a span, without gaps.

    Args:
        trajectory: evaluated at its own knots, as scans may pause.
        begin_s: UTC, as `end_s`.
        end_s: end of the last scan.
    """
    inside = (trajectory.t_s > begin_s) & (trajectory.t_s < end_s)
    t_s = np.concatenate([[begin_s], trajectory.t_s[inside], [end_s]])
    before, share, known = trajectory.interval(t_s)
    t_s, nearest = t_s[known], (before + (share > 0.5))[known]
    if not len(t_s):
        return 0.0, 0.0
    en_m, standing = trajectory.at(t_s).xyz_m[:, :2], trajectory.motion[nearest] == Motion.STANDING
    step_s = np.diff(t_s)
    gap, still = step_s > trajectory.max_gap_s, standing[1:] & standing[:-1]
    drives = np.split(en_m, np.flatnonzero(gap | still) + 1)
    return sum(length_m(drive) for drive in drives), float(step_s[still & ~gap].sum())
