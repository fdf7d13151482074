"""Warnings and errors of a run: what the session does not state, and which scans are not in the cloud."""

from __future__ import annotations

from typing import Final

import numpy as np

from furrowmap.core.pointclouds.placed import Placement
from furrowmap.core.readers.reader import ClockReading
from furrowmap.core.runtime.errors import InputError, Notice
from furrowmap.core.session.examination import likely_offset
from furrowmap.core.trajectory.located import Located
from furrowmap.core.values.clock import iso_utc
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
        raise InputError(
            f"{', '.join(session.recording.lidar)}: no laser returns.",
            "There is nothing to place.",
            "Check with `furrowmap inspect` what the file holds; another capture may be the recording.",
            code="no-points",
        )
    if placement.scans_standing:
        raise InputError(
            f"The vehicle stands still in all {placement.scans_standing} scans.",
            "Scans of a standing vehicle are left out, so the cloud is empty.",
            "Set `[run] standing = true` to keep them.",
            code="only-standing",
        )
    scans = ClockReading(Clock.SENSOR, placement.first_s, placement.last_s)
    if session.mount is not None and _has_poses(trajectory, scans):
        raise InputError(
            f"{session.mount.attitude}: no attitude of the mount at the time of the scans "
            f"({iso_utc(scans.first_s)} to {iso_utc(scans.last_s)}), while there are positions.",
            "A scan from a mount that moves cannot be placed without its attitude.",
            "Record the mount during the scans, without pauses; its times are UTC or GPS time.",
            code="no-common-time",
        )
    raise _no_common_time(scans, trajectory, session.recording.lidar_minus_gnss_s)


def _has_poses(trajectory: Trajectory, scans: ClockReading) -> bool:
    """Whether the vehicle has poses at times of the scans."""
    begin_s, end_s = max(trajectory.span_s[0], scans.first_s), min(trajectory.span_s[1], scans.last_s)
    times = np.linspace(begin_s, end_s, SAMPLES)
    return begin_s <= end_s and bool(np.isfinite(trajectory.at(times).quaternion).any())


def _no_common_time(scans: ClockReading, trajectory: Trajectory, stated_s: float) -> InputError:
    """Why no scan has a pose.

    Args:
        scans: span of the scans, by the clock of the trajectory.
        trajectory: of the vehicle.
        stated_s: clock offset in the session, which has been subtracted from the times of the scans.
    """
    begin_s, end_s = trajectory.span_s
    spans = (
        f"The scans ({iso_utc(scans.first_s)} to {iso_utc(scans.last_s)}"
        f"{f', after subtracting lidar_minus_gnss_s = {stated_s:+g} s' if stated_s else ''}) and the positions "
        f"({iso_utc(begin_s)} to {iso_utc(end_s)})"
    )
    meaning = "A scan cannot be placed without a position at its time."
    if scans.first_s <= end_s and scans.last_s >= begin_s:
        return InputError(
            f"{spans} overlap, but the positions have a gap at the time of the scans.",
            meaning,
            "Check with `furrowmap inspect` where the receiver had no fix; set `[run] fixes` to use other fix types.",
            code="no-common-time",
        )
    likely = likely_offset(scans, ClockReading(Clock.GNSS, begin_s, end_s))
    if likely is None:
        remedy = "Use files of the same drive; no common clock offset (hours, leap seconds, days) explains the gap."
    else:
        offset_s, cause = likely
        remedy = (
            f"If the files are of the same drive, the scanner's clock is probably off ({cause}): set "
            f"`[recording] lidar_minus_gnss_s = {stated_s + offset_s:.1f}`."
        )
    return InputError(f"{spans} do not overlap in time.", meaning, remedy, code="no-common-time")


def session_notices(session: Session, located: Located, *, matched: bool) -> list[Notice]:
    """What the session does not state, and which of its files are not used.

    Args:
        session: the session.
        located: the trajectory.
        matched: whether the scans were matched to the ground.
    """
    notices = []
    from_gnss = located.source == "gnss"
    if located.source == "file" and session.recording.gnss:
        notices.append(Notice("gnss-unused", "The GNSS log is not used: the trajectory comes from [trajectory]."))
    if located.source == "file" and session.imu is not None:
        notices.append(Notice("imu-unused", "The IMU is not used: the trajectory comes from [trajectory]."))
    if from_gnss and not matched:
        text = (
            "Roll and pitch are assumed to be zero and the height is that of the antenna: GNSS alone does not show the "
            "tilt of the vehicle."
        )
        notices.append(Notice("level-assumed", text))
    if located.source != "file" and session.antenna is None:
        text = (
            "The session does not state the position of the antenna ([antenna] xyz_m). It is assumed to be at the "
            "origin of the vehicle frame, so heights are those of the antenna, and no accuracy is stated."
        )
        notices.append(Notice("antenna-unknown", text))
    missing = [key.removeprefix("lidar.") for key in session.unstated if key.startswith("lidar.")]
    if missing:
        text = (
            f"The session does not state the mounting of the scanner ([lidar] {', '.join(missing)}). It is assumed to "
            "be zero, as if the scanner were at the origin of the vehicle frame or parallel to it, and no accuracy is "
            "stated."
        )
        notices.append(Notice("mounting-identity", text))
    return notices


def placement_notices(placement: Placement) -> list[Notice]:
    """Scans and points that are not in the cloud."""
    notices = []
    if placement.points_without_pose:
        lost, outside = placement.points_without_pose, placement.points_outside
        text = (
            f"{lost:,} of {placement.points_read:,} points ({lost / placement.points_read:.1%}) are not in the cloud "
            f"because they have no pose: {outside:,} before the first or after the last one, "
            f"{lost - outside:,} in gaps between poses."
        )
        notices.append(Notice("points-without-pose", text))
    if placement.scans_standing:
        text = (
            f"{placement.scans_standing} scans of the standing vehicle ({placement.points_standing} points) are left "
            "out, as requested."
        )
        notices.append(Notice("standing-left-out", text))
    return notices
