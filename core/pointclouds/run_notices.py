"""What a run could not know, and what of the recording is not in its cloud."""

from __future__ import annotations

import numpy as np

from furrowmap.core.pointclouds.placed import Placement
from furrowmap.core.readers.reader import ClockReading
from furrowmap.core.session.examination import likely_offset
from furrowmap.core.trajectory.located import Located
from furrowmap.core.values.clock import iso_utc
from furrowmap.core.values.errors import InputError, Notice
from furrowmap.core.values.scan import Clock
from furrowmap.core.values.session import Session
from furrowmap.core.values.trajectory import Trajectory


def refuse_empty(placement: Placement, trajectory: Trajectory, session: Session) -> None:
    """A cloud without points is no cloud: say why, with both clocks' spans.

    Raises:
        InputError: if not a single point was placed.
    """
    if placement.points:
        return
    if not placement.points_read:
        raise InputError(
            f"{', '.join(session.recording.lidar)}: no laser returns in it.",
            "There is nothing to place.",
            "`furrowmap inspect` says what the file holds; perhaps another capture is the recording.",
            code="no-points",
        )
    if placement.scans_standing:
        raise InputError(
            f"The vehicle stands in all {placement.scans_standing} scans.",
            "Scans at a stand are left out, so nothing remains.",
            "Set `[run] standing = true` to keep them.",
            code="only-standing",
        )
    raise _no_common_time(
        ClockReading(Clock.SENSOR, placement.first_s, placement.last_s),
        trajectory,
        session.recording.lidar_minus_gnss_s,
    )


def _no_common_time(scans: ClockReading, trajectory: Trajectory, stated_s: float) -> InputError:
    """Why no scan has a pose; the scans' span is that by the trajectory's clock, after the `stated_s` offset."""
    begin_s, end_s = trajectory.span_s
    spans = (
        f"The scans ({iso_utc(scans.first_s)} to {iso_utc(scans.last_s)}"
        f"{f', {stated_s:+g} s of lidar_minus_gnss_s taken off' if stated_s else ''}) and the positions "
        f"({iso_utc(begin_s)} to {iso_utc(end_s)})"
    )
    if scans.first_s <= end_s and scans.last_s >= begin_s:
        return InputError(
            f"{spans} overlap, but where the scans are the positions have a gap.",
            "Without a position at its time no scan can be placed.",
            "See with `furrowmap inspect` where the receiver had no fix; other qualities may help (`[run] fixes`).",
            code="no-common-time",
        )
    likely = likely_offset(scans, ClockReading(Clock.GNSS, begin_s, end_s))
    if likely is None:
        remedy = "Name files of one drive; no usual difference of clocks (hours, leap seconds, days) explains it."
    else:
        offset_s, cause = likely
        remedy = (
            f"If they are of one drive, the scanner's clock is off by {cause}: write "
            f"`[recording] lidar_minus_gnss_s = {stated_s + offset_s:.1f}`."
        )
    return InputError(
        f"{spans} have no time in common.",
        "Without a position at its time no scan can be placed.",
        remedy,
        code="no-common-time",
    )


def session_notices(session: Session, located: Located, *, matched: bool) -> list[Notice]:
    """What a run could not know, and what of the session it has no use for."""
    notices = []
    if located.source == "file" and session.recording.gnss:
        notices.append(
            Notice("gnss-unused", "The trajectory comes from [trajectory]: the GNSS log is not used for it.")
        )
    if located.source == "gnss" and not matched:
        notices.append(
            Notice(
                "level-assumed",
                "Roll and pitch are taken as zero and the height is the antenna's: GNSS alone does not show how the "
                "vehicle leans.",
            )
        )
    if located.source == "gnss" and session.antenna is None:
        notices.append(
            Notice(
                "antenna-unknown",
                "The session does not say where the antenna stands ([antenna] xyz_m): it is taken as the vehicle's "
                "origin, and heights are the antenna's.",
            )
        )
    if session.lidar.mounting.xyz_m == (0.0, 0.0, 0.0) and session.lidar.mounting.rpy_deg == (0.0, 0.0, 0.0):
        notices.append(
            Notice(
                "mounting-identity",
                "The session does not say how the scanner is mounted ([lidar] xyz_m, rpy_deg): its frame is taken as "
                "the vehicle's.",
            )
        )
    return notices


def gap_notices(placement: Placement, located: Located) -> list[Notice]:
    """The gaps into which scans fall."""
    gaps = located.trajectory.gaps_s
    inside = gaps[(gaps[:, 0] < placement.last_s) & (gaps[:, 1] > placement.first_s)]
    if not len(inside):
        return []
    length = inside[:, 1] - inside[:, 0]
    longest = int(np.argmax(length))
    return [
        Notice(
            "gaps",
            f"Positions are missing for {length.sum():.1f} s of the scans' time (gaps: {len(inside)}, the longest "
            f"{length[longest]:.1f} s from {iso_utc(float(inside[longest, 0]))}); scans in them have no pose.",
        )
    ]


def placement_notices(placement: Placement) -> list[Notice]:
    """What of the recording is not in the cloud."""
    notices = []
    if placement.points_without_pose:
        share = placement.points_without_pose / placement.points_read
        in_gaps = placement.points_without_pose - placement.points_outside
        notices.append(
            Notice(
                "points-without-pose",
                f"{placement.points_without_pose:,} of {placement.points_read:,} points ({share:.1%}) are not in the cloud, "
                f"because no pose is known at their time: {placement.points_outside:,} before the positions begin or after "
                f"they end, {in_gaps:,} in gaps between them.",
            )
        )
    if placement.scans_standing:
        notices.append(
            Notice(
                "standing-left-out",
                f"{placement.scans_standing} scans at a stand ({placement.points_standing} points) are left out, as asked.",
            )
        )
    return notices
