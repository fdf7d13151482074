"""A preview: the drive and its points in seconds, neither matched to the ground nor searched for the implement."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

import numpy as np

from furrowmap.core.coverage.field_work import FieldWork
from furrowmap.core.implement.machine_voxels import classifier
from furrowmap.core.pipeline.notices import refuse_empty, session_notices
from furrowmap.core.pipeline.place import OpenSink, place_within
from furrowmap.core.pipeline.run_result import RunResult
from furrowmap.core.pipeline.solution import StopWatch, companions, placer_of, run_result, without_unstated_accuracy
from furrowmap.core.pointclouds.placed_scans import Placement
from furrowmap.core.runtime.errors import Notice
from furrowmap.core.runtime.progress import Progress, silent
from furrowmap.core.session.opened import OpenSession, watched
from furrowmap.core.trajectory.located import Located, locate, located_without_lidar
from furrowmap.core.trajectory.moving_mount import carrier_of
from furrowmap.core.values.scan import ClockReading, Scan

PREVIEW_SCANS: Final = 400
"""Places of the drive at which a preview reads scans; each shows the ground for some 15 m around."""
PREVIEW_PERIOD_S: Final = 0.4
"""Shortest period between them: half a metre of a tractor's way."""
PREVIEW_LENGTH_S: Final = 0.12
"""Time for which scans are read at each."""


def preview(opened: OpenSession, open_sink: OpenSink, progress: Progress = silent) -> RunResult:
    """A run with few scans, in seconds: neither matched to the ground nor searched for the implement.

    An error that would stop a run before its work, such as clocks without a common time, stops a preview.

    Args:
        open_sink: is called before the first of these scans, where the session names a scanner's recording.

    Raises:
        FurrowmapError: if the session's files do not make a track with points along it.
    """
    watch = StopWatch()
    progress("reading positions", 0.0)
    positions = opened.positions()
    if opened.session.recording.lidar:
        located = locate(positions, opened.session, opened.frame, companions(opened))
        located = without_unstated_accuracy(located, opened.session)
        placement, clocks, assumed = _place_some(opened, located, open_sink, progress)
    else:
        located = located_without_lidar(positions, opened.session, opened.frame, companions(opened))
        placement = Placement.without_scans(located.trajectory)
        clocks = ()
        assumed = []
    watch.lap("preview")
    notices = [*positions.notices, *located.notices, *assumed]
    return run_result(opened, located, placement, FieldWork(), clocks, notices, watch)


def _place_some(
    opened: OpenSession, located: Located, open_sink: OpenSink, progress: Progress
) -> tuple[Placement, tuple[ClockReading, ...], list[Notice]]:
    """Place a few scans as the session states the mounting; readings of the clocks, and notices."""
    session = opened.session
    carrier, mount_notices = carrier_of(located, session, opened.inputs.mount)
    begin_s, end_s = located.trajectory.span_s
    period_s = max(PREVIEW_PERIOD_S, (end_s - begin_s) / PREVIEW_SCANS)
    lidar = opened.lidar(0.5 * (begin_s + end_s), period_s)
    placer = placer_of(located, session.lidar.mounting, carrier)
    sink = open_sink(opened.frame, placer.origin_m, None)
    scans = watched(preview_scans(lidar.scans(), period_s), lidar, progress, "looking at scans")
    placement = place_within(opened, scans, [placer], sink, [classifier(None)], standing=True)
    refuse_empty(placement, located.trajectory, session)
    assumed = [*lidar.notices, *mount_notices, *session_notices(session, located, matched=False)]
    return placement, lidar.clocks, assumed


def preview_scans(scans: Iterator[Scan], period_s: float) -> Iterator[Scan]:
    """The scans that begin within the first PREVIEW_LENGTH_S of each period; a period begins with a scan."""
    begin_s = -np.inf
    for scan in scans:
        if not len(scan):
            continue
        since_s = float(scan.t_s[0]) - begin_s
        if since_s >= period_s - PREVIEW_LENGTH_S or since_s < 0.0:
            begin_s = float(scan.t_s[0])
        elif since_s >= PREVIEW_LENGTH_S:
            continue
        yield scan
