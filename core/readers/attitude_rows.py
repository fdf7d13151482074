"""Rows of attitudes to a track: what all formats have in common."""

from __future__ import annotations

from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from furrowmap.core.readers.facts import timing_facts, utc_facts
from furrowmap.core.runtime.errors import InputError, Notice
from furrowmap.core.values.attitude import AttitudeTrack
from furrowmap.core.values.clock import runs_forward

FloatArray = NDArray[np.float64]

MOST_DISORDER: Final = 0.01


def attitude_track(
    t_s: FloatArray, angles_deg: FloatArray, north: str, name: str, notices: list[Notice]
) -> AttitudeTrack:
    """The track of attitudes in the order of recording; the few that are not later than all before are dropped.

    Args:
        t_s: (n,) UTC.
        angles_deg: (n, 3) roll, pitch, heading.
        north: see :class:`AttitudeTrack`.
        name: of the recording, for messages.
        notices: one about dropped attitudes is added.

    Raises:
        InputError: if the times do not increase.
    """
    forward = runs_forward(t_s)
    if (~forward).sum() > MOST_DISORDER * len(t_s) or forward.sum() < 2:
        raise InputError("time-disorder", name=name, forward=int((~forward).sum()), t_s=len(t_s))
    if not forward.all():
        notices.append(Notice("time-runs-back", name=name, forward=int((~forward).sum()), t_s=len(t_s)))
    roll, pitch, heading = angles_deg[forward].T
    return AttitudeTrack(t_s[forward], roll, pitch, heading, north, name)


def attitude_facts(track: AttitudeTrack) -> dict[str, Any]:
    """What `inspect` reports about attitudes."""
    facts: dict[str, Any] = {"attitudes": len(track), **utc_facts(track.t_s), **timing_facts(track.t_s)}
    for name in ("roll_deg", "pitch_deg"):
        values = getattr(track, name)
        if np.isfinite(values).any():
            facts[name] = [round(float(q), 2) for q in np.nanquantile(values, [0.0, 0.5, 1.0])]
    facts["north"] = (track.north or "not stated") if track.has_heading else "no heading"
    return facts
