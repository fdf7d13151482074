"""A session at a glance, before its run: the track as GNSS alone has it, and the points of few scans."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from time import perf_counter
from typing import Final

import numpy as np

from furrowmap.core.geodesy.projection import MapFrame, map_frame
from furrowmap.core.matching.locating import Located, locate
from furrowmap.core.pipeline import CloudSink, Run, placer_of
from furrowmap.core.pointclouds.classifying import classifier
from furrowmap.core.pointclouds.placed import Tally, place_scans
from furrowmap.core.pointclouds.placement_notices import refuse_empty, session_notices
from furrowmap.core.readers.reader import ClockReading
from furrowmap.core.session.file import load_session
from furrowmap.core.session.inputs import Inputs, open_lidar, open_positions, watched
from furrowmap.core.values.progress import Progress, silent
from furrowmap.core.values.scan import Scan
from furrowmap.core.values.session import Session
from furrowmap.core.work.field_work import FieldWork
from furrowmap.workflows.run_without_lidar import located_without_lidar

GLANCES: Final = 400
"""So many places of the drive are looked at: each shows the ground for some 15 m around."""
SHORTEST_S: Final = 0.4
"""A tractor's half a metre: looking more often shows nothing new."""
LENGTH_S: Final = 0.12
"""Of a look."""


def preview(session_file: Path, sink: CloudSink, progress: Progress = silent) -> Run:
    """A run with few scans, neither matched to the ground nor searched for the implement; in seconds.

    What would stop the whole run before its work, such as clocks without a common time, stops this one.

    Args:
        session_file: the session.
        sink: takes the points of the scans that are looked at; not asked where the session names no scanner.
        progress: is told of the stages.

    Raises:
        FurrowmapError: if the session, its files or what they hold do not make a track with points along it.
    """
    begin = perf_counter()
    session = load_session(session_file)
    frame = map_frame(session.crs, session_file)
    inputs = Inputs.of(session_file, session)
    progress("reading positions", 0.0)
    positions = open_positions(inputs, session)
    if session.recording.lidar:
        located = locate(positions, session, frame)
        clocks, tally = _looked(inputs, session, located, frame, sink, progress)
        assumed = session_notices(session, located)
    else:
        located = located_without_lidar(positions, session, frame)
        clocks, tally, assumed = (), Tally.without_scans(located.trajectory), []
    notices = tuple(dict.fromkeys([*positions.notices, *located.notices, *assumed]))
    timings_s = {"preview": round(perf_counter() - begin, 3)}
    return Run(session, inputs.all, frame, located, tally, FieldWork(), clocks, notices, timings_s)


def _looked(
    inputs: Inputs, session: Session, located: Located, frame: MapFrame, sink: CloudSink, progress: Progress
) -> tuple[tuple[ClockReading, ...], Tally]:
    """Place the points of few scans; what the scanner's clocks said, and what was placed."""
    begin_s, end_s = located.trajectory.span_s
    period_s = max(SHORTEST_S, (end_s - begin_s) / GLANCES)
    lidar = open_lidar(inputs, session, 0.5 * (begin_s + end_s) + session.recording.lidar_minus_gnss_s, period_s)
    placer = placer_of(located, session)
    sink.begin(frame, placer.origin_m)
    scans = watched(glances(lidar.scans(), period_s), lidar, progress, "looking at scans")
    tally = place_scans(scans, placer, standing=True, sink=sink.add, classify=classifier(None))
    refuse_empty(tally, located.trajectory, session)
    return lidar.clocks, tally


def glances(scans: Iterator[Scan], period_s: float) -> Iterator[Scan]:
    """The scans that begin within the first LENGTH_S of each period; a period begins with a scan."""
    look_s = -np.inf
    for scan in scans:
        if not len(scan):
            continue
        since_s = float(scan.t_s[0]) - look_s
        if since_s >= period_s - LENGTH_S or since_s < 0.0:
            look_s = float(scan.t_s[0])
        elif since_s >= LENGTH_S:
            continue
        yield scan
