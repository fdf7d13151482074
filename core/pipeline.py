"""From a session to placed points: the whole way, composed."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from time import perf_counter
from typing import Any, Final, Protocol, cast

import numpy as np

from furrowmap.core.classifying import classifier
from furrowmap.core.cloud.ahead import ahead, behind
from furrowmap.core.cloud.placed import PlacedScan, Tally, place_scans
from furrowmap.core.cloud.placing import Placer
from furrowmap.core.examination import likely_offset
from furrowmap.core.field_work import FieldWork, ImplementWatch, earlier_implement, field_boundary
from furrowmap.core.matching.adjustment import Tool
from furrowmap.core.matching.laser_ranges import LaserRanges
from furrowmap.core.matching.matched import Matched, match
from furrowmap.core.matching.returns import ground_returns
from furrowmap.core.readers.reader import (
    ClockReading,
    GivesPoses,
    GivesScans,
    GivesTrack,
    Reader,
    ReadOptions,
    open_recording,
)
from furrowmap.core.states_elsewhere import states_from_elsewhere
from furrowmap.core.trajectory.coordinates import AS_IT_WAS, Brought, brought_poses, brought_track
from furrowmap.core.trajectory.from_gnss import trajectory_from_gnss
from furrowmap.core.trajectory.from_poses import trajectory_from_poses
from furrowmap.core.trajectory.positions import Positions, fixes_from_labels
from furrowmap.core.trajectory.projection import MapFrame, map_frame
from furrowmap.core.values.clock import iso_utc
from furrowmap.core.values.errors import InputError, Notice
from furrowmap.core.values.mounting import Mounting
from furrowmap.core.values.progress import Progress, silent
from furrowmap.core.values.scan import Clock, Scan
from furrowmap.core.values.session import Session, resolve
from furrowmap.core.values.session_file import load_session
from furrowmap.core.values.trajectory import Trajectory

SCANS_AHEAD: Final = 32
ORIGIN_STEP_M: Final = 100.0


_UNSOLVED: Final = Notice(
    "matching-unsolved",
    "The scans were not matched: positions and ground leave a part of the drive without any hold, so that the poses' "
    "equations have no solution. The trajectory is that of GNSS alone.",
)


class LidarReader(Reader, GivesScans, Protocol):
    """A reader of laser scans."""


class CloudSink(Protocol):
    """Takes the points of a run as they are placed."""

    def begin(self, frame: MapFrame, origin_m: tuple[float, float, float]) -> None:
        """Before the first scan: the map frame, and the local origin of the coordinates to come."""
        ...

    def add(self, placed: PlacedScan) -> None:
        """The points of one scan."""
        ...


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
    implement = ImplementWatch(session, earlier_implement(session_file, session))
    lidar = open_lidar(inputs, session, near_s)
    if located.antenna is not None:
        located = matched_to_ground(located, lidar, session, implement.look, progress)
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
        *_gap_notices(tally, located),
        *_tally_notices(tally),
        *(elsewhere[1] if elsewhere is not None else ()),
        *work.notices,
    ]
    unique = tuple(dict.fromkeys(notices))
    return Run(session, inputs.all, frame, located, tally, work, lidar.clocks, unique, watch.laps_s)


@dataclass(frozen=True)
class Inputs:
    """The files that a session names, found before any work starts."""

    lidar: tuple[Path, ...]
    positions: tuple[Path, ...]
    boundary: tuple[Path, ...] = ()
    states: tuple[Path, ...] = ()
    learned: tuple[Path, ...] = ()
    crs: tuple[Path, ...] = ()

    @classmethod
    def of(cls, session_file: Path, session: Session) -> Inputs:
        """The files that `session` names, relative to `session_file`.

        Raises:
            InputError: if one is missing, or lies outside the session's folder.
        """
        stated = session.trajectory
        positions = stated.files if stated is not None else session.recording.gnss
        boundary = session.field.boundary
        learned = session.implement.learned if session.implement is not None else None
        return cls(
            tuple(resolve(session_file, name) for name in session.recording.lidar),
            tuple(resolve(session_file, name) for name in positions),
            (resolve(session_file, boundary),) if boundary is not None else (),
            tuple(resolve(session_file, name) for name in (session.implement.states if session.implement else ())),
            (resolve(session_file, learned),) if learned is not None else (),
            tuple(resolve(session_file, name) for name in (session.crs.parameters, session.crs.geoid_grid) if name),
        )

    @property
    def all(self) -> tuple[Path, ...]:
        """Every file once, the scanner's first, in the order in which the session names them."""
        return tuple(dict.fromkeys(self.lidar + self.positions + self.boundary + self.states + self.learned + self.crs))


def open_positions(inputs: Inputs, session: Session) -> Reader:
    """The reader of the session's positions, or of its trajectory from elsewhere.

    Raises:
        InputError: if a file is of no known kind, or of one that cannot give what it is named for.
    """
    stated = session.trajectory
    options = ReadOptions(
        date=session.recording.date,
        time=stated.time if stated is not None else None,
        week=stated.week if stated is not None else None,
        task=session.recording.task,
    )
    reader = open_recording(inputs.positions, options)
    if stated is not None:
        _expect(reader, GivesPoses, inputs.positions[0], "trajectory.files")
    else:
        _expect(reader, GivesTrack, inputs.positions[0], "recording.gnss")
    return reader


def open_lidar(inputs: Inputs, session: Session, near_s: float, glance_s: float | None = None) -> LidarReader:
    """The reader of the session's laser scans; `near_s` is a time of the drive by the scanner's clock.

    With `glance_s` a scan in so many seconds is enough.

    Raises:
        InputError: as :func:`open_positions`.
    """
    reader = open_recording(inputs.lidar, ReadOptions(model=session.lidar.model, near_s=near_s, glance_s=glance_s))
    _expect(reader, GivesScans, inputs.lidar[0], "recording.lidar")
    return cast("LidarReader", reader)


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
    lidar: LidarReader,
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
    lidar: LidarReader,
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
    returns = ground_returns(
        scans, session.lidar.mounting, session.recording.lidar_minus_gnss_s, located.trajectory, on_scan
    )
    return match(
        returns,
        located.trajectory,
        located.antenna,
        lever,
        session.lidar.mounting,
        tool,
        lambda share: progress("matching scans", share),
    )


def _expect(reader: Reader, kind: type[object], path: Path, key: str) -> None:
    if not isinstance(reader, kind):
        raise InputError(
            f"{path} is '{reader.title}', which gives no {_GIVES[kind]}.",
            f"The session names it under `{key}`.",
            "Name the right file there; `furrowmap inspect` says what a file holds.",
            code="wrong-kind-of-file",
        )


_GIVES: Final = {GivesScans: "laser scans", GivesTrack: "positions", GivesPoses: "trajectory"}


def _with_ranges(scans: Iterator[Scan], ranges: LaserRanges | None) -> Iterator[Scan]:
    """The scans without what their lasers measure too long, as far as the ground showed it."""
    return scans if ranges is None else map(ranges.corrected, scans)


def placer_of(located: Located, session: Session) -> Placer:
    """What places a session's points, against a round local origin in the middle of the drive."""
    middle = np.median(located.trajectory.xyz_m, axis=0)
    e, n, h = (np.round(middle / ORIGIN_STEP_M) * ORIGIN_STEP_M).tolist()
    mounting = located.mounting or session.lidar.mounting
    return Placer(located.trajectory, mounting, session.recording.lidar_minus_gnss_s, (e, n, h))


def watched(scans: Iterator[Scan], reader: LidarReader, progress: Progress, stage: str) -> Iterator[Scan]:
    """The scans; tells `progress` how much of the recording has been read."""
    for scan in scans:
        yield scan
        progress(stage, reader.share_read)
    progress(stage, 1.0)


def refuse_empty(tally: Tally, trajectory: Trajectory, session: Session) -> None:
    """A cloud without points is no cloud: say why, with both clocks' spans.

    Raises:
        InputError: if not a single point was placed.
    """
    if tally.points:
        return
    if not tally.points_read:
        raise InputError(
            f"{', '.join(session.recording.lidar)}: no laser returns in it.",
            "There is nothing to place.",
            "`furrowmap inspect` says what the file holds; perhaps another capture is the recording.",
            code="no-points",
        )
    if tally.scans_standing:
        raise InputError(
            f"The vehicle stands in all {tally.scans_standing} scans.",
            "Scans at a stand are left out, so nothing remains.",
            "Set `[run] standing = true` to keep them.",
            code="only-standing",
        )
    raise _no_common_time(
        ClockReading(Clock.SENSOR, tally.first_s, tally.last_s), trajectory, session.recording.lidar_minus_gnss_s
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


def session_notices(session: Session, located: Located) -> list[Notice]:
    """What a run could not know, and what of the session it has no use for."""
    notices = []
    if located.source == "file" and session.recording.gnss:
        notices.append(
            Notice("gnss-unused", "The trajectory comes from [trajectory]: the GNSS log is not used for it.")
        )
    if located.source == "gnss" and located.matching is None:
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


def _gap_notices(tally: Tally, located: Located) -> list[Notice]:
    """The gaps into which scans fall."""
    gaps = located.trajectory.gaps_s
    inside = gaps[(gaps[:, 0] < tally.last_s) & (gaps[:, 1] > tally.first_s)]
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


def _tally_notices(tally: Tally) -> list[Notice]:
    """What of the recording is not in the cloud."""
    notices = []
    if tally.points_without_pose:
        share = tally.points_without_pose / tally.points_read
        in_gaps = tally.points_without_pose - tally.points_outside
        notices.append(
            Notice(
                "points-without-pose",
                f"{tally.points_without_pose:,} of {tally.points_read:,} points ({share:.1%}) are not in the cloud, "
                f"because no pose is known at their time: {tally.points_outside:,} before the positions begin or after "
                f"they end, {in_gaps:,} in gaps between them.",
            )
        )
    if tally.scans_standing:
        notices.append(
            Notice(
                "standing-left-out",
                f"{tally.scans_standing} scans at a stand ({tally.points_standing} points) are left out, as asked.",
            )
        )
    return notices


class _StopWatch:
    """Seconds of each stage."""

    def __init__(self) -> None:
        self.laps_s: dict[str, float] = {}
        self._last = perf_counter()

    def lap(self, stage: str) -> None:
        now = perf_counter()
        self.laps_s[stage] = round(now - self._last, 3)
        self._last = now
