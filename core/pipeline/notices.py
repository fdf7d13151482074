"""Warnings and errors of a run about its session, its positions, and scans that are not in the cloud."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from furrowmap.core.pointclouds.placed import Placement
from furrowmap.core.runtime.errors import InputError, Notice
from furrowmap.core.trajectory.located import Located
from furrowmap.core.values.clock import iso_utc
from furrowmap.core.values.clock_readings import ClockReading, likely_offset
from furrowmap.core.values.gnss import Fix
from furrowmap.core.values.scan import Clock
from furrowmap.core.values.session import Session
from furrowmap.core.values.trajectory import ScanPoses, Trajectory

OUTAGE_S: Final = 2.0
"""Time without positions that is told."""
NOT_FIXED: Final = 0.05
"""Share of the time without a fixed solution that is told."""
_GOOD: Final = (Fix.FIXED, Fix.SIMULATED, -1)
"""Quality of fixed solutions; poses from a file have none."""


def position_notices(placement: Placement, located: Located) -> list[Notice]:
    """What stands out in the positions: gaps in which scans have no pose, outages, and float or worse solutions.

    Args:
        placement: the scans and their poses.
        located: the trajectory.
    """
    return [*_gaps(placement, located), *quality_notices(placement.poses)]


def quality_notices(poses: ScanPoses) -> list[Notice]:
    """Outages that poses bridge, and the time without a fixed solution where there are fixed ones as well.

    Args:
        poses: in the order of time.
    """
    return [*_outages(poses), *_not_fixed(poses)]


def fix_shares(poses: ScanPoses) -> dict[str, float]:
    """Share of the poses by the quality of the position behind each, the most frequent first.

    Poses without a position near are "none", those from a file "file".
    """
    codes, counts = np.unique(poses.fix, return_counts=True)
    order = np.argsort(-counts, kind="stable")
    names = [Fix(code).label if code >= 0 else "file" for code in codes.tolist()]
    return {names[i]: round(float(counts[i]) / len(poses), 4) for i in order.tolist()}


def _gaps(placement: Placement, located: Located) -> list[Notice]:
    """Gaps of the trajectory during the scans."""
    gaps = located.trajectory.gaps_s
    inside = gaps[(gaps[:, 0] < placement.last_s) & (gaps[:, 1] > placement.first_s)]
    if not len(inside):
        return []
    length = inside[:, 1] - inside[:, 0]
    longest = int(np.argmax(length))
    return [
        Notice(
            "gaps",
            length=length.sum(),
            inside=len(inside),
            length_2=length[longest],
            inside_2=iso_utc(float(inside[longest, 0])),
        )
    ]


def _outages(poses: ScanPoses) -> list[Notice]:
    """Times with poses, but without positions."""
    without = poses.fix == Fix.NONE
    edges = np.flatnonzero(np.diff(without, prepend=False, append=False)).reshape(-1, 2)
    begin, end = poses.t_s[np.maximum(edges[:, 0] - 1, 0)], poses.t_s[np.minimum(edges[:, 1], len(poses) - 1)]
    length = end - begin
    told = length >= OUTAGE_S
    if not told.any():
        return []
    longest = int(np.argmax(length))
    return [
        Notice(
            "gnss-outage",
            length=length[told].sum(),
            told=int(told.sum()),
            length_2=length[longest],
            begin=iso_utc(float(begin[longest])),
        )
    ]


def _not_fixed(poses: ScanPoses) -> list[Notice]:
    """Time with positions that are no fixed solutions, where others are."""
    fixed = np.isin(poses.fix, _GOOD)
    others = ~fixed & (poses.fix != Fix.NONE)
    if not fixed.any() or others.mean() < NOT_FIXED:
        return []
    seconds = _duration_s(poses.t_s)
    kinds = [Fix(code) for code in np.unique(poses.fix[others]).tolist()]
    words = ", ".join(f"{kind.label} {seconds[poses.fix == kind].sum():.1f} s" for kind in kinds)
    first = iso_utc(float(poses.t_s[np.argmax(others)]))
    return [Notice("gnss-not-fixed", others=others.mean(), words=words, first=first)]


def _duration_s(t_s: NDArray[np.float64]) -> NDArray[np.float64]:
    """Time (n,) that each of the times stands for; a pause counts as a usual step."""
    if len(t_s) < 2:
        return np.zeros(len(t_s))
    step = np.diff(t_s)
    usual = float(np.median(step))
    return np.append(np.where(step > 3.0 * usual, usual, step), usual)


POSE_SAMPLES: Final = 100
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
    times = np.linspace(begin_s, end_s, POSE_SAMPLES)
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
