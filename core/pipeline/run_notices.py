"""Warnings and errors of a run: what the session does not state, and which scans are not in the cloud."""

from __future__ import annotations

from typing import Final

import numpy as np

from furrowmap.core.pointclouds.placed import Placement
from furrowmap.core.runtime.errors import InputError, Notice
from furrowmap.core.trajectory.located import Located
from furrowmap.core.values.clock import iso_utc
from furrowmap.core.values.clock_readings import ClockReading, likely_offset
from furrowmap.core.values.scan import Clock
from furrowmap.core.values.session import Session
from furrowmap.core.values.trajectory import Trajectory

SAMPLES: Final = 100
"""Times of the scans at which poses are looked for."""


def refuse_empty(placement: Placement, trajectory: Trajectory, session: Session) -> None:
    """Refuse a cloud without points, with the reason.

    Raises:
        InputError: if no point was placed.
    """
    if placement.points:
        return
    if not placement.points_read:
        raise InputError("no-points", lidar=", ".join(session.recording.lidar))
    if placement.scans_standing:
        raise InputError("only-standing", scans_standing=placement.scans_standing)
    scans = ClockReading(Clock.SENSOR, placement.first_s, placement.last_s)
    if session.mount is not None and _has_poses(trajectory, scans):
        raise InputError(
            "no-common-time",
            attitude=session.mount.attitude,
            first_s=iso_utc(scans.first_s),
            last_s=iso_utc(scans.last_s),
        )
    raise _no_common_time(scans, trajectory, session.recording.lidar_minus_gnss_s)


def _has_poses(trajectory: Trajectory, scans: ClockReading) -> bool:
    """Whether the vehicle has poses at times of the scans."""
    begin_s, end_s = max(trajectory.span_s[0], scans.first_s), min(trajectory.span_s[1], scans.last_s)
    times = np.linspace(begin_s, end_s, SAMPLES)
    return begin_s <= end_s and bool(np.isfinite(trajectory.at(times).quaternion).any())


def _no_common_time(scans: ClockReading, trajectory: Trajectory, stated_s: float) -> InputError:
    """Why no scan has a pose."""
    begin_s, end_s = trajectory.span_s
    spans = {
        "first_s": iso_utc(scans.first_s),
        "last_s": iso_utc(scans.last_s),
        "stated_s": stated_s or None,
        "begin_s": iso_utc(begin_s),
        "end_s": iso_utc(end_s),
    }
    if scans.first_s <= end_s and scans.last_s >= begin_s:
        return InputError("no-common-time.no-common-time", **spans)
    likely = likely_offset(scans, ClockReading(Clock.GNSS, begin_s, end_s))
    offset_s, cause = likely if likely is not None else (0.0, None)
    return InputError("no-common-time.apart", **spans, cause=cause, offset_s=stated_s + offset_s)


def session_notices(session: Session, located: Located, *, matched: bool) -> list[Notice]:
    """What the session does not state, and which of its files are not used.

    Args:
        located: the trajectory.
        matched: whether the scans were matched to the ground.
    """
    notices = []
    from_gnss = located.source == "gnss"
    if located.source == "file" and session.recording.gnss:
        notices.append(Notice("gnss-unused"))
    if located.source == "file" and session.imu is not None:
        notices.append(Notice("imu-unused"))
    if from_gnss and not matched:
        notices.append(Notice("level-assumed"))
    if located.source != "file" and session.antenna is None:
        notices.append(Notice("antenna-unknown"))
    missing = [key.removeprefix("lidar.") for key in session.unstated if key.startswith("lidar.")]
    if missing:
        notices.append(Notice("mounting-identity", missing=", ".join(missing)))
    return notices


def placement_notices(placement: Placement) -> list[Notice]:
    """Scans and points that are not in the cloud."""
    notices = []
    if placement.points_without_pose:
        lost, outside = placement.points_without_pose, placement.points_outside
        notices.append(
            Notice(
                "points-without-pose",
                lost=lost,
                points_read=placement.points_read,
                lost_scaled=lost / placement.points_read,
                outside=outside,
                lost_2=lost - outside,
            )
        )
    if placement.scans_standing:
        notices.append(
            Notice(
                "standing-left-out", scans_standing=placement.scans_standing, points_standing=placement.points_standing
            )
        )
    return notices
