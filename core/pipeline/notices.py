"""Warnings and errors of a run about its session, its positions, and scans that are not in the cloud."""

from __future__ import annotations

from typing import Final

import numpy as np

from furrowmap.core.pointclouds.placed_scans import Placement
from furrowmap.core.runtime.errors import InputError, Notice
from furrowmap.core.trajectory.located import Located
from furrowmap.core.values.clock import iso_utc
from furrowmap.core.values.gnss import Fix
from furrowmap.core.values.scan import Clock, ClockReading, likely_offset
from furrowmap.core.values.session import Session
from furrowmap.core.values.trajectory import ScanPoses, Trajectory

MIN_OUTAGE_S: Final = 2.0
"""Shorter times without positions give no warning."""
MIN_NOT_FIXED_SHARE: Final = 0.05
"""A smaller share of the time without a fixed solution gives no warning."""
MAX_BEYOND_POSITIONS: Final = 0.2
"""Where more of the points lie before or after all positions, the log of positions may be cut."""
_GOOD: Final = (Fix.FIXED, Fix.SIMULATED, -1)
"""Quality of fixed solutions; poses from a file have none."""


def position_notices(placement: Placement, located: Located) -> list[Notice]:
    """What stands out in the positions: gaps in which scans have no pose, outages, and float or worse solutions."""
    gaps = located.trajectory.gaps_s
    inside = gaps[(gaps[:, 0] < placement.last_s) & (gaps[:, 1] > placement.first_s)]
    if not len(inside):
        return quality_notices(placement.poses)
    length = inside[:, 1] - inside[:, 0]
    longest = int(np.argmax(length))
    notice = Notice(
        "gaps",
        missing_s=length.sum(),
        gaps=len(inside),
        longest_s=length[longest],
        longest_begins=iso_utc(float(inside[longest, 0])),
    )
    return [notice, *quality_notices(placement.poses)]


def quality_notices(poses: ScanPoses) -> list[Notice]:
    """Outages that poses bridge, and the time without a fixed solution where there are fixed ones as well."""
    return [*_outages(poses), *_not_fixed(poses)]


def fix_shares(poses: ScanPoses) -> dict[str, float]:
    """Share of the poses by the quality of the position behind each, the most frequent first.

    Poses without a position near are "none", those from a file "file".
    """
    codes, counts = np.unique(poses.fix, return_counts=True)
    order = np.argsort(-counts, kind="stable")
    names = [Fix(code).label if code >= 0 else "file" for code in codes.tolist()]
    return {names[i]: round(float(counts[i]) / len(poses), 4) for i in order.tolist()}


def _outages(poses: ScanPoses) -> list[Notice]:
    """Times with poses, but without positions."""
    without = poses.fix == Fix.NONE
    edges = np.flatnonzero(np.diff(without, prepend=False, append=False)).reshape(-1, 2)
    begin = poses.t_s[np.maximum(edges[:, 0] - 1, 0)]
    end = poses.t_s[np.minimum(edges[:, 1], len(poses) - 1)]
    length = end - begin
    long = length >= MIN_OUTAGE_S
    if not long.any():
        return []
    longest = int(np.argmax(length))
    return [
        Notice(
            "gnss-outage",
            missing_s=length[long].sum(),
            told=int(long.sum()),
            longest_s=length[longest],
            longest_begins=iso_utc(float(begin[longest])),
        )
    ]


def _not_fixed(poses: ScanPoses) -> list[Notice]:
    """Time with positions that are no fixed solutions, where others are."""
    fixed = np.isin(poses.fix, _GOOD)
    others = ~fixed & (poses.fix != Fix.NONE)
    if not fixed.any() or others.mean() < MIN_NOT_FIXED_SHARE:
        return []
    # A pause counts as a usual step. There are two poses at least: a fixed one and another.
    step = np.diff(poses.t_s)
    usual = float(np.median(step))
    seconds = np.append(np.where(step > 3.0 * usual, usual, step), usual)
    kinds = [Fix(code) for code in np.unique(poses.fix[others]).tolist()]
    words = ", ".join(f"{kind.label} {seconds[poses.fix == kind].sum():.1f} s" for kind in kinds)
    first = iso_utc(float(poses.t_s[np.argmax(others)]))
    return [Notice("gnss-not-fixed", others=others.mean(), words=words, first=first)]


POSE_SAMPLES: Final = 100
"""Times of the scans at which poses are looked for."""


def refuse_empty(placement: Placement, trajectory: Trajectory, session: Session) -> None:
    """Raise InputError, with the reason, for a cloud without points."""
    if placement.points:
        return
    if not placement.points_read:
        raise InputError("no-points", lidar=", ".join(session.recording.lidar))
    if placement.scans_standing:
        raise InputError("only-standing", scans_standing=placement.scans_standing)
    scans = ClockReading(Clock.SENSOR, placement.first_s, placement.last_s)
    if session.mount is not None:
        begin_s = max(trajectory.span_s[0], scans.first_s)
        end_s = min(trajectory.span_s[1], scans.last_s)
        poses = trajectory.at(np.linspace(begin_s, end_s, POSE_SAMPLES))
        if begin_s <= end_s and np.isfinite(poses.quaternion).any():
            raise InputError(
                "no-common-time",
                attitude=session.mount.attitude,
                first=iso_utc(scans.first_s),
                last=iso_utc(scans.last_s),
            )
    raise _no_common_time(scans, trajectory, session.recording.lidar_minus_gnss_s)


def _no_common_time(scans: ClockReading, trajectory: Trajectory, stated_s: float) -> InputError:
    """Why no scan has a pose."""
    begin_s, end_s = trajectory.span_s
    spans = {
        "first": iso_utc(scans.first_s),
        "last": iso_utc(scans.last_s),
        "stated_s": stated_s or None,
        "begin": iso_utc(begin_s),
        "end": iso_utc(end_s),
    }
    if scans.first_s <= end_s and scans.last_s >= begin_s:
        return InputError("no-common-time.no-positions-within", **spans)
    likely = likely_offset(scans, ClockReading(Clock.GNSS, begin_s, end_s))
    offset_s, cause = likely if likely is not None else (0.0, None)
    return InputError("no-common-time.no-overlap", **spans, cause=cause, offset_s=stated_s + offset_s)


def session_notices(session: Session, located: Located, *, matched: bool) -> list[Notice]:
    """What the session does not state, and which of its files are not used."""
    notices = []
    from_gnss = located.source == "gnss"
    if located.source == "file" and session.recording.gnss:
        notices.append(Notice("gnss-unused"))
    if located.source == "file" and session.imu is not None:
        notices.append(Notice("imu-unused"))
    if from_gnss and not matched:
        notices.append(Notice("level-assumed"))
    no_antenna = located.source != "file" and session.antenna is None
    missing = [key.removeprefix("lidar.") for key in session.unstated if key.startswith("lidar.")]
    if missing:
        key = "mounting-identity.and-antenna" if no_antenna else "mounting-identity"
        notices.append(Notice(key, missing=", ".join(missing)))
    if no_antenna:
        notices.append(Notice("antenna-unknown"))
    return notices


def placement_notices(placement: Placement) -> list[Notice]:
    """Scans and points that are not in the cloud."""
    notices = []
    if placement.points_without_pose:
        lost = placement.points_without_pose
        outside = placement.points_outside
        log_is_shorter = outside > MAX_BEYOND_POSITIONS * placement.points_read
        notices.append(
            Notice(
                "points-without-pose.log-shorter" if log_is_shorter else "points-without-pose",
                lost=lost,
                points_read=placement.points_read,
                lost_scaled=lost / placement.points_read,
                outside=outside,
                in_gaps=lost - outside,
            )
        )
    if placement.scans_standing:
        notices.append(
            Notice(
                "standing-left-out", scans_standing=placement.scans_standing, points_standing=placement.points_standing
            )
        )
    return notices
