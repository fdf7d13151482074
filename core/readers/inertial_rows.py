"""Rows of inertial measurements and of attitudes to a track: what all formats have in common."""

from __future__ import annotations

from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from furrowmap.core.readers.facts import timing_facts, utc_facts
from furrowmap.core.runtime.arrays import FloatArray
from furrowmap.core.runtime.errors import InputError, Notice
from furrowmap.core.values.clock import runs_forward
from furrowmap.core.values.inertial import InertialTrack
from furrowmap.core.values.pose_track import AttitudeTrack

MAX_LATE_SHARE: Final = 0.01
MAX_RATE_RADPS: Final = 100.0
MAX_FORCE_MPS2: Final = 1000.0
"""No IMU measures more: the unit is another one."""


def first_beyond(values: FloatArray) -> tuple[int, int, int] | None:
    """Rows of rate and force (n, 6) that no IMU measures: how many, the first, and its first column; None without."""
    for first, largest in ((0, MAX_RATE_RADPS), (3, MAX_FORCE_MPS2)):
        wrong = np.flatnonzero((np.abs(values[:, first : first + 3]) > largest).any(axis=1))
        if len(wrong):
            return len(wrong), int(wrong[0]), first
    return None


def inertial_track(t_s: FloatArray, values: FloatArray, name: str, notices: list[Notice]) -> InertialTrack:
    """The track of measurements in the order of recording; the few that are not later than all before are dropped.

    Args:
        t_s: (n,) UTC.
        values: (n, 6) angular rate (rad/s) and specific force (m/s²).

    Raises:
        InputError: if the times do not increase.
    """
    forward = _forward(t_s, "time-disorder.inertial-track", name, notices)
    return InertialTrack(t_s[forward], values[forward, :3], values[forward, 3:], name)


def attitude_track(
    t_s: FloatArray, angles_deg: FloatArray, north: str, name: str, notices: list[Notice]
) -> AttitudeTrack:
    """The track of attitudes in the order of recording; the few that are not later than all before are dropped.

    Args:
        t_s: (n,) UTC.
        angles_deg: (n, 3) roll, pitch, heading.
        north: see :class:`AttitudeTrack`.

    Raises:
        InputError: if the times do not increase.
    """
    forward = _forward(t_s, "time-disorder", name, notices)
    roll, pitch, heading = angles_deg[forward].T
    return AttitudeTrack(t_s[forward], roll, pitch, heading, north, name)


def _forward(t_s: FloatArray, disorder: str, name: str, notices: list[Notice]) -> NDArray[np.bool_]:
    """Which rows are later than all before; an error if these are too many or all but one."""
    forward = runs_forward(t_s)
    late = int((~forward).sum())
    if late > MAX_LATE_SHARE * len(t_s) or len(t_s) - late < 2:
        raise InputError(disorder, name=name, forward=late, t_s=len(t_s))
    if late:
        notices.append(Notice("time-runs-back", name=name, forward=late, t_s=len(t_s)))
    return forward


def inertial_facts(track: InertialTrack) -> dict[str, Any]:
    """What `inspect` reports about measurements."""
    return {
        "measurements": len(track),
        **utc_facts(track.t_s),
        **timing_facts(track.t_s),
        "mean_force_mps2": np.round(track.force_mps2.mean(axis=0), 3).tolist(),
        "largest_rate_dps": round(float(np.degrees(np.abs(track.rate_radps).max())), 1),
    }


def attitude_facts(track: AttitudeTrack) -> dict[str, Any]:
    """What `inspect` reports about attitudes."""
    facts: dict[str, Any] = {"attitudes": len(track), **utc_facts(track.t_s), **timing_facts(track.t_s)}
    for name in ("roll_deg", "pitch_deg"):
        values = getattr(track, name)
        if np.isfinite(values).any():
            facts[name] = [round(float(q), 2) for q in np.nanquantile(values, [0.0, 0.5, 1.0])]
    facts["north"] = (track.north or "not stated") if track.has_heading else "no heading"
    return facts
