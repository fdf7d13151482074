"""The first guess of a run: the vehicle's trajectory from GNSS alone, or from a file of poses."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from furrowmap.core.geodesy.coordinates import UNCHANGED, TransformSummary, transform_poses, transform_track
from furrowmap.core.geodesy.projection import MapFrame
from furrowmap.core.readers.reader import GivesPoses, GivesTrack, Reader
from furrowmap.core.trajectory.from_course import trajectory_from_course
from furrowmap.core.trajectory.from_gnss import trajectory_from_gnss
from furrowmap.core.trajectory.from_poses import trajectory_from_poses
from furrowmap.core.trajectory.positions import fixes_from_labels, quality_words
from furrowmap.core.values.errors import Notice
from furrowmap.core.values.gnss import GnssTrack
from furrowmap.core.values.positions import Positions
from furrowmap.core.values.session import Session
from furrowmap.core.values.trajectory import Trajectory

SLOWEST_DIRECTIONS_S: Final = 0.3
"""Positions further apart than this do not show whether a vehicle reverses."""
_FORWARD: Final = Notice(
    "direction-forward",
    "Positions are too far apart, or have no heights, for a direction of motion to be seen in them: the vehicle is "
    "taken to drive forward, level, along its course.",
)


@dataclass(frozen=True)
class Located:
    """A trajectory and where it comes from.

    Attributes:
        trajectory: of the vehicle frame.
        source: "gnss" or "file".
        positions: numbers of positions used and left out, by quality or reason; empty for a trajectory from a file.
        notices: for the report.
        antenna: the positions themselves; None for a trajectory from a file, or from the course alone.
        transformed: how the recorded coordinates were transformed to the map.
    """

    trajectory: Trajectory
    source: str
    positions: dict[str, dict[str, int]]
    notices: tuple[Notice, ...]
    antenna: Positions | None = None
    transformed: TransformSummary = UNCHANGED


def locate(positions: Reader, session: Session, frame: MapFrame) -> Located:
    """The trajectory: from the session's own file, or from GNSS.

    Raises:
        InputError: if there is too little to make one.
        RefusedError: if the CRS does not fit the place, or nothing shows the heading.
    """
    if isinstance(positions, GivesPoses) and session.trajectory is not None:
        poses, transformed = transform_poses(positions.poses(), frame)
        return Located(trajectory_from_poses(poses, frame), "file", {}, transformed.notices, transformed=transformed)
    assert isinstance(positions, GivesTrack)
    fixes = fixes_from_labels(session.run.fixes) if session.run.fixes is not None else None
    track, transformed = transform_track(positions.track(), frame)
    found = trajectory_from_gnss(track, frame, lever_arm_m(session), fixes)
    used = {"used": found.used, "unused": found.unused}
    notices = (*transformed.notices, *found.notices)
    return Located(found.trajectory, "gnss", used, notices, found.positions, transformed)


def located_without_lidar(positions: Reader, session: Session, frame: MapFrame) -> Located:
    """The trajectory; from the course alone where positions come too seldom to show which way the vehicle moves.

    Raises:
        InputError: as :func:`locate`.
        RefusedError: as :func:`locate`.
    """
    if session.trajectory is not None or not isinstance(positions, GivesTrack):
        return locate(positions, session, frame)
    track = positions.track()
    if not _seldom(track):
        return locate(positions, session, frame)
    track, transformed = transform_track(track, frame)
    course = trajectory_from_course(track, frame, lever_arm_m(session))
    used = {"used": quality_words(track.fix[course.used]), "unused": quality_words(track.fix[~course.used])}
    notices = (_FORWARD, *transformed.notices, *course.notices)
    return Located(course.trajectory, "gnss", used, notices, transformed=transformed)


def lever_arm_m(session: Session) -> tuple[float, float, float]:
    """The antenna in the vehicle frame; zero where the session does not state it."""
    return session.antenna.xyz_m if session.antenna is not None else (0.0, 0.0, 0.0)


def _seldom(track: GnssTrack) -> bool:
    if len(track) < 2:
        return True
    return float(np.median(np.diff(track.t_s))) > SLOWEST_DIRECTIONS_S or not np.isfinite(track.height_m).any()
