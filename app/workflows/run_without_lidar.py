"""A run without a scanner: positions from a receiver or a machine's log, the tool's states from elsewhere."""

from __future__ import annotations

from pathlib import Path
from time import perf_counter
from typing import Final

import numpy as np

from furrowmap.core.geodesy.coordinates import brought_track
from furrowmap.core.geodesy.projection import MapFrame, map_frame
from furrowmap.core.matching.locating import Located, locate
from furrowmap.core.pipeline import Run
from furrowmap.core.pointclouds.placed import Tally
from furrowmap.core.readers.reader import GivesTrack, Reader
from furrowmap.core.session.file import load_session
from furrowmap.core.session.inputs import Inputs, open_positions
from furrowmap.core.trajectory.from_course import trajectory_from_course
from furrowmap.core.trajectory.positions import quality_words
from furrowmap.core.values.errors import Notice
from furrowmap.core.values.gnss import GnssTrack
from furrowmap.core.values.progress import Progress, silent
from furrowmap.core.values.session import Session
from furrowmap.core.work.field_work import FieldWork, field_boundary, with_ground
from furrowmap.core.work.states_elsewhere import states_from_elsewhere

SLOWEST_DIRECTIONS_S: Final = 0.3
"""Positions further apart than this do not show whether a vehicle reverses."""
_FORWARD: Final = Notice(
    "direction-forward",
    "Positions are too far apart, or have no heights, for a direction of motion to be seen in them: the vehicle is "
    "taken to drive forward, level, along its course.",
)


def run_without_lidar(session_file: Path, progress: Progress = silent) -> Run:
    """The ground worked in a session that names no scanner's recording.

    Raises:
        FurrowmapError: if the session, its files or what they hold do not make a trajectory with states.
    """
    begin = perf_counter()
    session = load_session(session_file)
    frame = map_frame(session.crs, session_file)
    inputs = Inputs.of(session_file, session)
    progress("reading positions", 0.0)
    positions = open_positions(inputs, session)
    located = located_without_lidar(positions, session, frame)
    boundary = field_boundary(session_file, session, frame)
    elsewhere = states_from_elsewhere(inputs.states, session, located.trajectory)
    assert elsewhere is not None
    located_s = perf_counter()
    progress("work", 0.0)
    found = FieldWork(boundary=boundary, elsewhere=elsewhere[0])
    work = with_ground(found, located.trajectory, frame, session.implement)
    notices = (*positions.notices, *located.notices, *elsewhere[1], *work.notices)
    timings_s = {"positions": round(located_s - begin, 3), "work": round(perf_counter() - located_s, 3)}
    tally = Tally.without_scans(located.trajectory)
    return Run(session, inputs.all, frame, located, tally, work, (), tuple(dict.fromkeys(notices)), timings_s)


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
