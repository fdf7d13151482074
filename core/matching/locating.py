"""Where the vehicle was: from positions to a trajectory, with what the scans see of the ground."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np

from furrowmap.core.geodesy.coordinates import AS_IT_WAS, Brought, brought_poses, brought_track
from furrowmap.core.geodesy.projection import MapFrame
from furrowmap.core.matching.adjustment import Tool
from furrowmap.core.matching.laser_ranges import LaserRanges
from furrowmap.core.matching.matched import Matched, match
from furrowmap.core.matching.returns import ground_returns
from furrowmap.core.readers.reader import GivesPoses, GivesTrack, Reader
from furrowmap.core.session.opened import LidarRecording, watched
from furrowmap.core.trajectory.from_course import trajectory_from_course
from furrowmap.core.trajectory.from_gnss import trajectory_from_gnss
from furrowmap.core.trajectory.from_poses import trajectory_from_poses
from furrowmap.core.trajectory.positions import Positions, fixes_from_labels, quality_words
from furrowmap.core.values.ahead import ahead
from furrowmap.core.values.errors import Notice
from furrowmap.core.values.gnss import GnssTrack
from furrowmap.core.values.mounting import Mounting
from furrowmap.core.values.progress import Progress, silent
from furrowmap.core.values.scan import Scan
from furrowmap.core.values.session import Session
from furrowmap.core.values.trajectory import Trajectory

SCANS_AHEAD: Final = 32
"""Scans that are read while others are at work."""
SLOWEST_DIRECTIONS_S: Final = 0.3
"""Positions further apart than this do not show whether a vehicle reverses."""
_FORWARD: Final = Notice(
    "direction-forward",
    "Positions are too far apart, or have no heights, for a direction of motion to be seen in them: the vehicle is "
    "taken to drive forward, level, along its course.",
)
_UNSOLVED: Final = Notice(
    "matching-unsolved",
    "The scans were not matched: positions and ground leave a part of the drive without any hold, so that the poses' "
    "equations have no solution. The trajectory is that of GNSS alone.",
)


@dataclass(frozen=True)
class Located:
    """The trajectory of a run and what there is to say about it.

    Attributes:
        trajectory: of the vehicle frame.
        source: "gnss" or "file".
        positions: numbers of positions used and left out, by quality or reason; empty for a trajectory from a file.
        notices: for the report.
        antenna: the positions themselves; None for a trajectory from a file.
        matching: what the report tells about scan matching; None where the scans were not matched.
        mounting: of the sensor as matching found it; None for the session's.
        ranges: what the sensor's lasers measure too long, as matching found it; None where it did not.
        brought: how the recorded coordinates came to the map.
    """

    trajectory: Trajectory
    source: str
    positions: dict[str, dict[str, int]]
    notices: tuple[Notice, ...]
    antenna: Positions | None = None
    matching: dict[str, Any] | None = None
    mounting: Mounting | None = None
    ranges: LaserRanges | None = None
    brought: Brought = AS_IT_WAS


def locate(positions: Reader, session: Session, frame: MapFrame) -> Located:
    """The trajectory: from the session's own file, or from GNSS.

    Raises:
        InputError: if there is too little to make one.
        RefusedError: if the CRS does not fit the place, or nothing shows the heading.
    """
    if isinstance(positions, GivesPoses) and session.trajectory is not None:
        poses, brought = brought_poses(positions.poses(), frame)
        return Located(trajectory_from_poses(poses, frame), "file", {}, brought.notices, brought=brought)
    assert isinstance(positions, GivesTrack)
    lever = session.antenna.xyz_m if session.antenna is not None else (0.0, 0.0, 0.0)
    fixes = fixes_from_labels(session.run.fixes) if session.run.fixes is not None else None
    track, brought = brought_track(positions.track(), frame)
    found = trajectory_from_gnss(track, frame, lever, fixes)
    used = {"used": found.used, "unused": found.unused}
    notices = (*brought.notices, *found.notices)
    return Located(found.trajectory, "gnss", used, notices, found.positions, brought=brought)


def matched_to_ground(
    located: Located,
    lidar: LidarRecording,
    session: Session,
    on_scan: Callable[[Scan], None] | None = None,
    progress: Progress = silent,
) -> Located:
    """The trajectory improved by what the scans see of the ground; as it was where they see too little.

    `on_scan` sees each scan on its way.
    """
    try:
        matched = match_session(located, lidar, session, on_scan, progress)
    except np.linalg.LinAlgError:
        return replace(located, notices=(*located.notices, _UNSOLVED))
    if matched is None:
        return located
    return replace(
        located,
        trajectory=matched.trajectory,
        notices=(*located.notices, *matched.notices),
        matching=matched.figures,
        mounting=matched.mounting,
        ranges=matched.ranges,
    )


def match_session(
    located: Located,
    lidar: LidarRecording,
    session: Session,
    on_scan: Callable[[Scan], None] | None = None,
    progress: Progress = silent,
) -> Matched | None:
    """Match a session's scans to the ground; None where they see too little of it.

    Raises:
        LinAlgError: if positions and ground leave a part of the trajectory without any hold.
    """
    assert located.antenna is not None
    lever = session.antenna.xyz_m if session.antenna is not None else (0.0, 0.0, 0.0)
    implement = session.implement
    tool = Tool(implement.xy_m, 0.5 * implement.width_m) if implement is not None else None
    scans = watched(ahead(lidar.scans(), SCANS_AHEAD), lidar, progress, "reading scans")
    returns = ground_returns(scans, session.lidar.mounting, located.trajectory, on_scan)
    return match(
        returns,
        located.trajectory,
        located.antenna,
        lever,
        session.lidar.mounting,
        tool,
        lambda share: progress("matching scans", share),
    )


def located_without_lidar(positions: Reader, session: Session, frame: MapFrame) -> Located:
    """The trajectory; from the course alone where positions come too seldom to show which way the vehicle moves."""
    if session.trajectory is not None or not isinstance(positions, GivesTrack):
        return locate(positions, session, frame)
    track = positions.track()
    if not _seldom(track):
        return locate(positions, session, frame)
    lever_m = session.antenna.xyz_m if session.antenna is not None else (0.0, 0.0, 0.0)
    track, brought = brought_track(track, frame)
    course = trajectory_from_course(track, frame, lever_m)
    used = {"used": quality_words(track.fix[course.used]), "unused": quality_words(track.fix[~course.used])}
    notices = (_FORWARD, *brought.notices, *course.notices)
    return Located(course.trajectory, "gnss", used, notices, brought=brought)


def _seldom(track: GnssTrack) -> bool:
    if len(track) < 2:
        return True
    return float(np.median(np.diff(track.t_s))) > SLOWEST_DIRECTIONS_S or not np.isfinite(track.height_m).any()
