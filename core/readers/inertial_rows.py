"""Rows of inertial measurements to a track: what all formats have in common."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from furrowmap.core.readers.facts import timing_facts, utc_facts
from furrowmap.core.runtime.errors import InputError, Notice
from furrowmap.core.values.clock import runs_forward
from furrowmap.core.values.inertial import InertialTrack

FloatArray = NDArray[np.float64]

MOST_DISORDER: Final = 0.01
LARGEST_RATE_RADPS: Final = 100.0
LARGEST_FORCE_MPS2: Final = 1000.0
"""No IMU measures more: the unit is another one."""


def first_beyond(values: FloatArray) -> tuple[int, int, int] | None:
    """Rows of rate and force (n, 6) that no IMU measures: how many, the first, and its first column; None without."""
    for first, largest in ((0, LARGEST_RATE_RADPS), (3, LARGEST_FORCE_MPS2)):
        wrong = np.flatnonzero((np.abs(values[:, first : first + 3]) > largest).any(axis=1))
        if len(wrong):
            return len(wrong), int(wrong[0]), first
    return None


def inertial_track(t_s: FloatArray, values: FloatArray, name: str, notices: list[Notice]) -> InertialTrack:
    """The track of measurements in the order of recording; the few that are not later than all before are dropped.

    Args:
        t_s: (n,) UTC.
        values: (n, 6) angular rate (rad/s) and specific force (m/s²).
        name: of the recording, for messages.
        notices: one about dropped measurements is added.

    Raises:
        InputError: if the times do not increase.
    """
    forward = runs_forward(t_s)
    if (~forward).sum() > MOST_DISORDER * len(t_s) or forward.sum() < 2:
        raise InputError("time-disorder.inertial-track", name=name, forward=int((~forward).sum()), t_s=len(t_s))
    if not forward.all():
        notices.append(Notice("time-runs-back", name=name, forward=int((~forward).sum()), t_s=len(t_s)))
    return InertialTrack(t_s[forward], values[forward, :3], values[forward, 3:], name)


def inertial_facts(track: InertialTrack) -> dict[str, Any]:
    """What `inspect` reports about measurements."""
    return {
        "measurements": len(track),
        **utc_facts(track.t_s),
        **timing_facts(track.t_s),
        "mean_force_mps2": np.round(track.force_mps2.mean(axis=0), 3).tolist(),
        "largest_rate_dps": round(float(np.degrees(np.abs(track.rate_radps).max())), 1),
    }


def joined_name(paths: Sequence[Path]) -> str:
    """The name of a recording of several files, for messages."""
    return ", ".join(str(path) for path in paths)
