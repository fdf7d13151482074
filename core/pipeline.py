"""From a session to placed points: the whole way, composed."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from time import perf_counter
from typing import Final, Protocol

import msgspec
import numpy as np

from furrowmap.core.geodesy.projection import MapFrame, map_frame
from furrowmap.core.matching.facing import TURNED_DEG
from furrowmap.core.matching.laser_ranges import LaserRanges
from furrowmap.core.matching.locating import SCANS_AHEAD, Located, locate, matched_to_ground
from furrowmap.core.pointclouds.classifying import classifier
from furrowmap.core.pointclouds.placed import PlacedScan, Tally, place_scans
from furrowmap.core.pointclouds.placement_notices import gap_notices, refuse_empty, session_notices, tally_notices
from furrowmap.core.pointclouds.placing import Placer
from furrowmap.core.readers.reader import ClockReading
from furrowmap.core.session.file import load_session
from furrowmap.core.session.inputs import Inputs, open_lidar, open_positions, watched
from furrowmap.core.values.ahead import ahead, behind
from furrowmap.core.values.errors import Notice
from furrowmap.core.values.mounting import Mounting
from furrowmap.core.values.progress import Progress, silent
from furrowmap.core.values.scan import Scan
from furrowmap.core.values.session import Session
from furrowmap.core.work.field_work import FieldWork, ImplementWatch, earlier_implement, field_boundary
from furrowmap.core.work.states_elsewhere import states_from_elsewhere

ORIGIN_STEP_M: Final = 100.0
"""The local origin of the points is a whole multiple of this."""


class CloudSink(Protocol):
    """Takes the points of a run as they are placed."""

    def begin(self, frame: MapFrame, origin_m: tuple[float, float, float]) -> None:
        """Before the first scan: the map frame, and the local origin of the coordinates to come."""
        ...

    def add(self, placed: PlacedScan) -> None:
        """The points of one scan."""
        ...


@dataclass(frozen=True)
class Run:
    """What a run found out, besides the points that went to its sink.

    Attributes:
        session: as it was understood.
        inputs: the files that were read.
        frame: the map frame.
        located: the trajectory.
        tally: scans and points, and the scans' poses.
        work: what the implement did.
        clocks: what the clocks in the scanner's recording said, the one that was used first.
        notices: everything worth knowing, in the order of the work.
        timings_s: seconds of each stage.
    """

    session: Session
    inputs: tuple[Path, ...]
    frame: MapFrame
    located: Located
    tally: Tally
    work: FieldWork
    clocks: tuple[ClockReading, ...]
    notices: tuple[Notice, ...]
    timings_s: dict[str, float]


def run(session_file: Path, sink: CloudSink, progress: Progress = silent) -> Run:
    """Place every point of a session's recording and hand them to `sink` scan by scan.

    Raises:
        FurrowmapError: if the session, its files or what they hold do not make a cloud.
    """
    watch = _StopWatch()
    session = load_session(session_file)
    frame = map_frame(session.crs, session_file)
    inputs = Inputs.of(session_file, session)
    positions = open_positions(inputs, session)
    located = locate(positions, session, frame)
    boundary = field_boundary(session_file, session, frame)
    elsewhere = states_from_elsewhere(inputs.states, session, located.trajectory)
    watch.lap("positions")
    near_s = float(np.mean(located.trajectory.span_s)) + session.recording.lidar_minus_gnss_s
    earlier = earlier_implement(session_file, session)
    implement = ImplementWatch(session, earlier)
    lidar = open_lidar(inputs, session, near_s)
    if located.antenna is not None:
        located = matched_to_ground(located, lidar, session, implement.look, progress)
        if located.mounting is not None and _faces_elsewhere(located.mounting, session.lidar.mounting):
            # By the mounting as stated it was looked for on another side of the vehicle than it is.
            implement = ImplementWatch(_mounted(session, located.mounting), earlier)
            for scan in open_lidar(inputs, session, near_s).scans():
                implement.look(scan)
        watch.lap("matching")
    else:
        for scan in watched(lidar.scans(), lidar, progress, "reading scans"):
            implement.look(scan)
    machine = implement.learn(located.trajectory)
    watch.lap("implement")
    lidar = open_lidar(inputs, session, near_s)
    placer = placer_of(located, session)
    sink.begin(frame, placer.origin_m)
    followed = implement.following(_with_ranges(lidar.scans(), located.ranges))
    scans = watched(ahead(followed, SCANS_AHEAD), lidar, progress, "placing points")
    with behind(sink.add, SCANS_AHEAD) as add:
        tally = place_scans(scans, placer, standing=session.run.standing, sink=add, classify=classifier(machine))
    watch.lap("placing")
    refuse_empty(tally, located.trajectory, session)
    work = implement.work(located.trajectory, frame, boundary, elsewhere[0] if elsewhere is not None else None)
    watch.lap("work")
    notices = [
        *positions.notices,
        *located.notices,
        *lidar.notices,
        *session_notices(session, located),
        *gap_notices(tally, located),
        *tally_notices(tally),
        *(elsewhere[1] if elsewhere is not None else ()),
        *work.notices,
    ]
    unique = tuple(dict.fromkeys(notices))
    return Run(session, inputs.all, frame, located, tally, work, lidar.clocks, unique, watch.laps_s)


def _faces_elsewhere(used: Mounting, stated: Mounting) -> bool:
    """Whether the scanner faces another way than stated, not just a little beside it."""
    forward = np.array([used.rotation[:, 0], stated.rotation[:, 0]])
    return bool(forward[0] @ forward[1] < np.cos(np.radians(TURNED_DEG)))


def _mounted(session: Session, mounting: Mounting) -> Session:
    """The session with another mounting of the scanner."""
    lidar = msgspec.structs.replace(session.lidar, rpy_deg=mounting.rpy_deg)
    return msgspec.structs.replace(session, lidar=lidar)


def _with_ranges(scans: Iterator[Scan], ranges: LaserRanges | None) -> Iterator[Scan]:
    """The scans without what their lasers measure too long, as far as the ground showed it."""
    return scans if ranges is None else map(ranges.corrected, scans)


def placer_of(located: Located, session: Session) -> Placer:
    """What places a session's points, against a round local origin in the middle of the drive."""
    middle = np.median(located.trajectory.xyz_m, axis=0)
    e, n, h = (np.round(middle / ORIGIN_STEP_M) * ORIGIN_STEP_M).tolist()
    mounting = located.mounting or session.lidar.mounting
    return Placer(located.trajectory, mounting, session.recording.lidar_minus_gnss_s, (e, n, h))


class _StopWatch:
    """Seconds of each stage."""

    def __init__(self) -> None:
        self.laps_s: dict[str, float] = {}
        self._last = perf_counter()

    def lap(self, stage: str) -> None:
        now = perf_counter()
        self.laps_s[stage] = round(now - self._last, 3)
        self._last = now
