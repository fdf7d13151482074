"""From an open session to placed points and the ground worked: a run, a run without scans, a preview."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from importlib.util import find_spec
from itertools import zip_longest
from time import perf_counter
from typing import TYPE_CHECKING, Final, Protocol

import msgspec
import numpy as np
import shapely
from numpy.typing import NDArray
from shapely.geometry.base import BaseGeometry

from furrowmap.core.adjustment.boresight import (
    MAX_DRAWN_DEG,
    Boresight,
    boresight_notices,
    held_against_mounting,
    held_against_strips,
)
from furrowmap.core.adjustment.height_creep import held_against_heights
from furrowmap.core.adjustment.model_by_strips import LikelierModel, likelier_model
from furrowmap.core.adjustment.strip_adjustment import (
    StripAdjustment,
    calibrate_flight,
    scanner_goes_with_imu,
    timed_wrongly,
)
from furrowmap.core.adjustment.strips import StripReturns, ThinnedReturns, at_shifted_times, thinned_returns
from furrowmap.core.geodesy.projection import MapFrame
from furrowmap.core.pipeline.notices import (
    placement_notices,
    position_notices,
    quality_notices,
    refuse_empty,
    session_notices,
)
from furrowmap.core.pipeline.run_result import RunResult
from furrowmap.core.pipeline.scanners import classifiers, further_notices, further_recordings, together
from furrowmap.core.pointclouds.placed import PLACED_AHEAD, PlacedScan, Placement, Placer, place_scans
from furrowmap.core.readers.areas.area import nothing_within
from furrowmap.core.readers.reader import GivesTrack, Reader
from furrowmap.core.runtime import arrays
from furrowmap.core.runtime.background import SCANS_AHEAD, ahead, behind, beside
from furrowmap.core.runtime.errors import CONTRADICTION, Notice
from furrowmap.core.runtime.progress import Progress, silent
from furrowmap.core.session.opened import LidarRecording, OpenSession, watched
from furrowmap.core.trajectory.located import Companions, Located, locate, located_without_lidar, middle_s
from furrowmap.core.trajectory.moving_mount import carrier_of
from furrowmap.core.trajectory.straight_passes import Strip, find_strips
from furrowmap.core.values.images import CONTRADICTING, ImageFile
from furrowmap.core.values.rotation import Mounting
from furrowmap.core.values.scan import ClockReading, Scan
from furrowmap.core.values.session import Session
from furrowmap.core.values.time_span import track_within
from furrowmap.core.values.tool_states import ToolStates
from furrowmap.core.values.trajectory import Trajectory
from furrowmap.core.work.boundary import field_boundary, ground_to_map, held_against_boundary
from furrowmap.core.work.external_states import external_states
from furrowmap.core.work.field_work import FieldWork, ImplementTracker, with_grounds
from furrowmap.core.work.machine import classifier
from furrowmap.core.work.saved import load_implement
from furrowmap.core.work.strip_differences import StripDifferences, strip_differences

if TYPE_CHECKING:
    from furrowmap.core.adjustment.matched import Matched
    from furrowmap.core.adjustment.session_match import MatchedSession
    from furrowmap.core.images.aiding import ImageAid
    from furrowmap.core.images.features import ImageFeatures
    from furrowmap.core.images.frames import Frames

IMU_CLOCK_STEP_S: Final = 1e-4
"""The session's offset of the IMU's clock is as precise."""
MIN_YAW_CHANGE_DEG: Final = 20.0
"""A mounting whose yaw differs by more sees the implement elsewhere."""
ORIGIN_STEP_M: Final = 100.0
"""The local origin of the points is a multiple of this."""
PREVIEW_SCANS: Final = 400
"""Places of the drive at which a preview reads scans; each shows the ground for some 15 m around."""
PREVIEW_PERIOD_S: Final = 0.4
"""Shortest period between them: half a metre of a tractor's way."""
PREVIEW_LENGTH_S: Final = 0.12
"""Time for which scans are read at each."""


class OpenSink(Protocol):
    """Opens what takes the points of a run: a function of each scan's points, as they are placed."""

    def __call__(
        self, frame: MapFrame, origin_m: tuple[float, float, float], frames: Frames | None
    ) -> Callable[[PlacedScan], None]:
        """The sink, before the first scan.

        Args:
            origin_m: local origin of the points' coordinates.
            frames: of the camera, where the session has one and some frames have a pose.
        """
        ...


class Checkpoint(Protocol):
    """Keeps what the longest stage found, for a run that continues after this one was killed."""

    def load(self) -> MatchedSession | None:
        """What an earlier run of the same session and recordings kept; None for nothing."""
        ...

    def save(self, found: MatchedSession) -> None:
        """Keep what matching found."""
        ...


@arrays.keeping_files_out()
def run(
    opened: OpenSession, open_sink: OpenSink, progress: Progress = silent, checkpoint: Checkpoint | None = None
) -> RunResult:
    """Place every point of a session's recording, hand them to a sink scan by scan, and find the ground worked.

    A session without a scanner's recording gives the ground worked alone, and opens no sink.

    Args:
        open_sink: is called before the first scan.
        checkpoint: keeps what matching finds; an earlier run's is used instead of matching again.

    Raises:
        FurrowmapError: if the session's files do not make a cloud, or no trajectory with tool states.
    """
    session = opened.session
    frame = opened.frame
    watch = _StopWatch()
    if not session.recording.lidar:
        return _run_without_scans(opened, progress)
    positions = opened.positions()
    image_notices: list[Notice] = []
    guess, aid, survey = _first_guess(opened, positions, image_notices, watch, progress)
    boundary, field_notices = _read_boundary(opened, guess.trajectory)
    states, state_notices = _read_external_states(opened, guess.trajectory)
    carrier, mount_notices = carrier_of(guess, session, opened.inputs.mount)
    lidar, located, matched, flown, implement = _calibrate(opened, guess, survey, carrier, progress, checkpoint)
    mounting_doubts: list[Notice] = []
    if located.source == "imu" and matched is None:
        located, mounting_doubts = _held_against_mounting(located, flown.boresight, aid)
    located = _held_against_control(_held_against_geoid(located, positions.notices), aid)
    if located.trajectory is not guess.trajectory:
        carrier, mount_notices = _carrier_trajectory(opened, located, flown.strip_adjustment)
    watch.lap("matching")
    machine = implement.learn(located.trajectory)
    watch.lap("implement")
    # Matching takes metres on the ground for metres of the map, within whose reach they differ by millimetres.
    scale = ground_scale(frame, located.trajectory) if matched is None else 1.0
    mounting = _mounting(session, matched, flown.boresight)
    placer = placer_of(located, mounting, carrier, scale)
    further = further_recordings(opened, lidar, mounting, matched, located.trajectory, implement, progress)
    if further:
        watch.lap("scanners")
    frames = None
    if not any(notice.code == CONTRADICTING for notice in image_notices):
        frames = _camera_frames(opened, located.trajectory, aid, image_notices)
    sink = open_sink(frame, placer.origin_m, frames)
    corrected = lidar.scans()
    if matched is not None and matched.ranges is not None:
        corrected = map(matched.ranges.corrected, corrected)
    moving = ahead(implement.following(corrected), SCANS_AHEAD)
    scans = together(watched(moving, lidar, progress, "placing points"), further)
    placers = [placer, *(replace(placer, mounting=one.found.mounting) for one in further)]
    with behind(sink, PLACED_AHEAD) as add:
        placement = _place(opened, scans, placers, add, classifiers(machine, further))
    watch.lap("placing")
    refuse_empty(placement, located.trajectory, session)
    number, tracker = next(
        ((k, one.implement) for k, one in enumerate(further, start=1) if one.implement is not None), (0, implement)
    )
    work = replace(tracker.work(located.trajectory, frame, boundary, states), scanner=number)
    field_notices += _boundary_notices(work, located.trajectory)
    if opened.inputs.within is not None:
        field_notices += ground_to_map(opened.inputs.within, frame).notices
    watch.lap("work")
    notices = [*positions.notices, *located.notices, *lidar.notices, *mount_notices, *image_notices]
    notices += session_notices(session, located, matched=matched is not None) + position_notices(placement, located)
    notices += [*placement_notices(placement), *field_notices, *state_notices, *work.notices]
    notices += further_notices(opened, further)
    if located.source == "imu" and matched is None:
        notices += _boresight_notices(flown.boresight, session.lidar.mounting, located)
        notices += mounting_doubts
    found = _run_result(opened, located, placement, work, lidar.clocks, notices, watch, matched)
    mountings = {lidar.name: one.found for lidar, one in zip(session.further_lidars, further, strict=True)}
    return replace(found, image_aid=aid, further_scanners=mountings, **vars(flown))


def _place(
    opened: OpenSession,
    scans: Iterator[Scan],
    placers: Sequence[Placer],
    sink: Callable[[PlacedScan], None],
    classify: Sequence[Callable[[Scan], NDArray[np.uint8]]],
) -> Placement:
    """Place the scans and hand on the points that lie on the ground to map; placers and classes are of each scanner."""
    file = opened.inputs.within
    area = ground_to_map(file, opened.frame) if file is not None else None
    standing = opened.session.run.standing
    placement = place_scans(
        scans,
        placers[0],
        standing=standing,
        sink=sink,
        classify=lambda scan: classify[scan.scanner](scan),
        within=area,
        further=placers[1:],
    )
    if area is not None and not placement.points and placement.points_elsewhere:
        east_m, north_m = np.median(placement.poses.xyz_m[:, :2], axis=0).tolist()
        raise nothing_within(area, f"{placement.points_elsewhere:,} points", (east_m, north_m))
    return placement


def _aid_by_images(
    opened: OpenSession,
    located: Located,
    notices: list[Notice],
    progress: Progress,
    features: Mapping[ImageFile, ImageFeatures] | None = None,
) -> tuple[Located, ImageAid | None]:
    """The trajectory aided by the images of the session's camera, where it has one; `features` as they were found."""
    camera = opened.session.camera
    if camera is None or not camera.is_known:
        return located, None
    from furrowmap.core.pipeline.session_aid import aid_session

    return aid_session(opened, located, ground_scale(opened.frame, located.trajectory), notices, progress, features)


def _camera_frames(
    opened: OpenSession, trajectory: Trajectory, aid: ImageAid | None, notices: list[Notice]
) -> Frames | None:
    """The frames that have a pose, with the camera as they show it, else as stated."""
    camera = opened.session.camera
    if camera is None:
        return None
    if not camera.is_known:
        notices.append(Notice("images-unused.intrinsics"))
        return None
    if find_spec("PIL") is None:
        notices.append(Notice("images-unused"))
        return None
    images = opened.images(notices)
    if not images:
        return None
    from furrowmap.core.images.frames import frames_along

    scale = ground_scale(opened.frame, trajectory)
    return frames_along(images, aid.camera if aid is not None else opened.camera(), trajectory, scale, notices)


def _read_boundary(opened: OpenSession, trajectory: Trajectory) -> tuple[BaseGeometry | None, list[Notice]]:
    """The boundary of the field, None where the session names none, and notices about it."""
    file = opened.inputs.boundary
    if file is None:
        return None, []
    return field_boundary(file, opened.frame, opened.session.field.name, trajectory.xyz_m)


def _boundary_notices(work: FieldWork, trajectory: Trajectory) -> list[Notice]:
    """Whether the ground worked, or where that is not known the drive, lies in the field."""
    worked = [one.ground.coverage for one in work.each if one.ground is not None]
    return held_against_boundary(work.boundary, shapely.union_all(worked) if worked else None, trajectory.xyz_m)


def _read_external_states(opened: OpenSession, trajectory: Trajectory) -> tuple[list[ToolStates | None], list[Notice]]:
    """The states of each implement from files, None where the session names none, and notices about them."""
    task = opened.session.recording.task
    states: list[ToolStates | None] = []
    notices: list[Notice] = []
    for tool, files in zip(opened.session.implements, opened.inputs.tools, strict=True):
        found, about = external_states(files.states, tool, task, trajectory)
        states.append(found)
        notices += about
    return states, notices


def _drop_unstated_accuracy(located: Located, session: Session) -> Located:
    """The trajectory without standard deviations where the session leaves out a place that the cloud rests on.

    Nobody knows how wrong an assumed place is; the noise of the positions says nothing of it.
    """
    return replace(located, trajectory=located.trajectory.without_accuracy()) if session.unstated else located


def _mounting(session: Session, matched: Matched | None, found: Boresight | None) -> Mounting:
    """The mounting of the scanner that is used: as the recording shows it, else as the session states it."""
    if matched is not None:
        return matched.mounting
    return found.mounting if found is not None and found.certain else session.lidar.mounting


def companions(opened: OpenSession) -> Companions:
    """The recordings of a session that go into the trajectory beside the positions."""
    session = opened.session
    return Companions(
        opened.inertial if session.imu is not None else None, opened.attitude if session.attitude is not None else None
    )


@dataclass(frozen=True)
class _FlightScans:
    """The first reading of a flight's scans."""

    lidar: LidarRecording
    returns: ThinnedReturns
    implement: ImplementTracker


def _first_guess(
    opened: OpenSession, positions: Reader, notices: list[Notice], watch: _StopWatch, progress: Progress
) -> tuple[Located, ImageAid | None, _FlightScans | None]:
    """The trajectory before scans are matched, aided by images; beside it, the scans of a flight with an IMU are read.

    Notices about the images are added.
    """
    session = opened.session

    def guess() -> Located:
        located = locate(positions, session, opened.frame, companions(opened))
        watch.lap("positions")
        return located

    def aided(
        located: Located, features: Mapping[ImageFile, ImageFeatures] | None = None
    ) -> tuple[Located, ImageAid | None]:
        found = _aid_by_images(opened, located, notices, progress, features)
        watch.lap("images")
        return found

    if session.imu is None or session.implement is not None or session.trajectory is not None:
        return *aided(guess()), None
    survey = partial(_read_survey, opened)
    if session.camera is None or not session.camera.aid:
        with beside(survey, progress) as scans:
            found = aided(guess())
        return *found, scans.result()
    from furrowmap.core.pipeline.session_aid import features_ahead

    # Features take all cores beside the trajectory; the adjustment of the images leaves them to the scans.
    with beside(partial(features_ahead, opened), progress) as features:
        located = guess()
    with beside(survey, progress) as scans:
        found = aided(located, features.result())
    return *found, scans.result()


def _read_survey(opened: OpenSession, progress: Progress) -> _FlightScans:
    """Read a flight's scans before its trajectory is known; the positions themselves say when it was."""
    positions = opened.positions()
    assert isinstance(positions, GivesTrack)
    track = track_within(positions.track(), opened.session.recording.span_s)
    lidar = opened.lidar(middle_s(track))
    implement = ImplementTracker(opened.session, flying=True)
    scans = map(implement.looked_at, watched(lidar.scans(), lidar, progress, "reading scans"))
    span_s = (float(track.t_s[0]), float(track.t_s[-1])) if len(track) else (0.0, 0.0)
    return _FlightScans(lidar, thinned_returns(scans, span_s), implement)


def _calibrate(
    opened: OpenSession,
    guess: Located,
    survey: _FlightScans | None,
    carrier: Trajectory | None,
    progress: Progress,
    checkpoint: Checkpoint | None,
) -> tuple[LidarRecording, Located, Matched | None, _FlightCalibration, ImplementTracker]:
    """Match the scans to the ground, or those of a flight to each other; the recording gets the clock that is found."""
    if survey is None:
        lidar = opened.lidar(float(np.mean(guess.trajectory.span_s)))
        located, matched, implement = _match(opened, guess, lidar, progress, checkpoint)
        located = _drop_unstated_accuracy(located, opened.session)
        return _correct_clock(lidar, matched), located, matched, _FlightCalibration(), implement
    returns = survey.returns.posed(guess.trajectory if carrier is None else carrier)
    located, flown = _calibrate_flight(opened, guess, returns, carrier)
    if (other := _likelier_model(opened, guess, returns, carrier, flown, survey.lidar)) is not None:
        # Poses and mounting that fit the elevations of another model are not those of the flight.
        located = replace(guess, notices=(*guess.notices, other.notice))
        flown = _FlightCalibration(strips=flown.strips)
    located = _drop_unstated_accuracy(located, opened.session)
    return survey.lidar.ahead_by(-flown.clock_used_s), located, None, flown, survey.implement


def _likelier_model(
    opened: OpenSession,
    guess: Located,
    returns: StripReturns,
    carrier: Trajectory | None,
    flown: _FlightCalibration,
    lidar: LidarRecording,
) -> LikelierModel | None:
    """The model of which the scanner likely is, rather than the one that it is read as."""
    if flown.boresight is None or any(notice.code == CONTRADICTION for notice in guess.notices):
        return None
    stated = opened.session.lidar.mounting
    return likelier_model(returns, guess.trajectory, stated, carrier, flown.boresight, lidar.beam_elevations())


def _match(
    opened: OpenSession, guess: Located, lidar: LidarRecording, progress: Progress, checkpoint: Checkpoint | None
) -> tuple[Located, Matched | None, ImplementTracker]:
    """Read the scans once: match them to the ground, and collect those that show the implement.

    What an earlier run kept of the matching is used instead.
    """
    from furrowmap.core.adjustment.session_match import MatchedSession, match_to_ground

    session = opened.session
    learned = (tool.learned for tool in opened.inputs.tools)
    earlier = [load_implement(file) if file is not None else None for file in learned]
    implement = ImplementTracker(session, earlier)
    located = guess
    matched = None
    kept = checkpoint.load() if checkpoint is not None and guess.antenna is not None else None
    if kept is not None:
        located = replace(guess, trajectory=kept.trajectory, notices=kept.notices)
        matched = kept.matched
    elif guess.antenna is not None:
        located, matched = match_to_ground(guess, lidar, session, implement.add_scan, progress)
        if checkpoint is not None:
            checkpoint.save(MatchedSession(located.trajectory, located.notices, matched))
    # The yaw ambiguity of the mounting may be resolved otherwise than stated.
    forward = session.lidar.mounting.rotation[:, 0]
    cosine = np.cos(np.radians(MIN_YAW_CHANGE_DEG))
    turned = matched is not None and bool(matched.mounting.rotation[:, 0] @ forward < cosine)
    late = matched is not None and matched.clock_used_s != 0.0
    if matched is not None and (turned or late):
        # The implement was looked for on another side of the vehicle, or at other times.
        mounted = msgspec.structs.replace(session.lidar, rpy_deg=matched.mounting.rpy_deg) if turned else session.lidar
        implement = ImplementTracker(msgspec.structs.replace(session, lidar=mounted), earlier)
    if turned or late or kept is not None or guess.antenna is None:
        for scan in watched(_correct_clock(lidar, matched).scans(), lidar, progress, "reading scans"):
            implement.add_scan(scan)
    return located, matched, implement


@dataclass(frozen=True)
class _FlightCalibration:
    """What the ground that a flight sees several times shows: fields of :class:`RunResult`."""

    boresight: Boresight | None = None
    strips: tuple[Strip, ...] = ()
    strip_differences: StripDifferences | None = None
    strip_adjustment: StripAdjustment | None = None

    @property
    def clock_used_s(self) -> float:
        """Time by which the scanner's clock is behind, where that is corrected."""
        return self.boresight.clock_used_s if self.boresight is not None and self.boresight.certain else 0.0


def _carrier_trajectory(
    opened: OpenSession, located: Located, adjusted: StripAdjustment | None
) -> tuple[Trajectory | None, list[Notice]]:
    """The trajectory of the frame that carries the scanner, None for the vehicle's, and notices about its file."""
    turned = adjusted.turned if adjusted is not None else None
    if turned is None:
        return carrier_of(located, opened.session, opened.inputs.mount)
    carrier, notices = carrier_of(replace(located, trajectory=turned.carrier), opened.session, opened.inputs.mount)
    return turned.carrier if carrier is None else carrier, notices


def _calibrate_flight(
    opened: OpenSession, guess: Located, returns: StripReturns, carrier: Trajectory | None
) -> tuple[Located, _FlightCalibration]:
    """Boresight, strips and their differences; the trajectory adjusted by the strips."""
    located, flown = _calibrated(opened, guess, returns, carrier)
    moved = flown.boresight is not None and flown.boresight.mounting.xyz_m != opened.session.lidar.xyz_m
    if moved and any(notice.key == "contradiction.creep" for notice in located.notices):
        # Ground that creeps from strip to strip looks like a scanner at another place, but not the other way round.
        return _calibrated(opened, guess, returns, carrier, place_known=True)
    return located, flown


def _calibrated(
    opened: OpenSession, guess: Located, returns: StripReturns, carrier: Trajectory | None, *, place_known: bool = False
) -> tuple[Located, _FlightCalibration]:
    """As :func:`_calibrate_flight`; `place_known` says that the scanner's place stays as stated."""
    stated = opened.session.lidar.mounting
    located = guess
    walk = opened.session.lidar.rpy_walk_deg_rts
    ahead_s = _imu_ahead_s(opened.session, guess)
    by_imu = ahead_s != 0.0 and scanner_goes_with_imu(returns, guess.trajectory, stated, ahead_s, carrier)
    if by_imu:
        returns = at_shifted_times(returns, guess.trajectory if carrier is None else carrier, -ahead_s)
    found, returns, adjusted = calibrate_flight(returns, guess, stated, carrier, walk, place_known=place_known)
    if adjusted is not None:
        located = _adjusted_by_strips(guess, adjusted)
        carrier = _carrier_trajectory(opened, located, adjusted)[0]
        returns = at_shifted_times(returns, located.trajectory if carrier is None else carrier, 0.0)
    if found is not None and by_imu:
        found = replace(found, clock_used_s=found.clock_used_s - ahead_s)
    if found is not None and found.certain and ahead_s and abs(found.clock_used_s + ahead_s) < 0.5 * abs(ahead_s):
        notice = Notice("contradiction.clock", off_s=abs(ahead_s), is_ahead_s=ahead_s < 0.0)
        doubtful = timed_wrongly(located.trajectory, ahead_s)
        located = replace(located, trajectory=doubtful, notices=(*located.notices, notice))
    strips = find_strips(located.trajectory)
    used = _mounting(opened.session, None, found)
    differences = strip_differences(returns, strips, stated, used)
    if found is not None and found.coincides and not _contradicts(located):
        doubtful, creeps = held_against_strips(located.trajectory, returns, strips, used)
        if creeps is not None:
            located = replace(located, trajectory=doubtful, notices=(*located.notices, creeps))
    return located, _FlightCalibration(found, strips, differences, adjusted)


def _adjusted_by_strips(guess: Located, adjusted: StripAdjustment) -> Located:
    """The trajectory that strips adjusted; heights are held against what they find."""
    trajectory = adjusted.trajectory
    if _contradicts(guess):
        # Strips know the errors of the poses by what the contradiction denies, so they do not make them smaller.
        return replace(
            guess, trajectory=replace(trajectory, sigma=np.maximum(trajectory.sigma, guess.trajectory.sigma))
        )
    if not adjusted.boresight.certain or adjusted.boresight.turned_deg > MAX_DRAWN_DEG:
        return replace(guess, trajectory=trajectory)
    trajectory, creeps = held_against_heights(trajectory, adjusted.before, adjusted.found)
    return replace(guess, trajectory=trajectory, notices=(*guess.notices, *([creeps] if creeps is not None else [])))


def _contradicts(located: Located) -> bool:
    return any(notice.code == CONTRADICTION for notice in located.notices)


def _boresight_notices(found: Boresight | None, stated: Mounting, located: Located) -> list[Notice]:
    """Notices about the mounting, of which none blames it for what another cause explains."""
    keys = {notice.key for notice in located.notices}
    if "contradiction.model" in keys:
        return []
    notices = boresight_notices(found, stated)
    if "contradiction.lever-arm" in keys:
        # With another place of the IMU all places in the vehicle are off together.
        return [notice for notice in notices if notice.code != "lever-arm-off"]
    return notices


def _held_against_mounting(
    located: Located, found: Boresight | None, aid: ImageAid | None
) -> tuple[Located, list[Notice]]:
    """The trajectory with larger standard deviations of the attitude where the IMU may be turned, and why."""
    if found is None or (_contradicts(located) and not found.certain):
        return located, []
    camera_deg = float(np.linalg.norm(aid.adjusted.correction_deg)) if aid is not None else np.inf
    trajectory, notice = held_against_mounting(located.trajectory, found, camera_deg)
    return replace(located, trajectory=trajectory), [notice] if notice is not None else []


def _held_against_geoid(located: Located, notices: Sequence[Notice]) -> Located:
    """The trajectory with larger standard deviations of the heights where these, or a part, may lack the geoid's."""
    off_m = [float(str(dict(notice.values)["off_m"])) for notice in notices if notice.code == "geoid-separation"]
    most_m = max(located.height_levels_m, *off_m, 0.0)
    if not most_m:
        return located
    sigma = located.trajectory.sigma.copy()
    sigma[:, 2] = np.hypot(sigma[:, 2], most_m)
    return replace(located, trajectory=replace(located.trajectory, sigma=sigma))


def _held_against_control(located: Located, aid: ImageAid | None) -> Located:
    """The trajectory with larger standard deviations where all control points contradict it alike."""
    if aid is None or aid.control.control_shift_m is None:
        return located
    sigma = located.trajectory.sigma.copy()
    sigma[:, :3] = np.hypot(sigma[:, :3], aid.control.control_shift_m)
    return replace(located, trajectory=replace(located.trajectory, sigma=sigma))


def _imu_ahead_s(session: Session, located: Located) -> float:
    """By how much the IMU's clock was found to be ahead of the positions', beyond what the session states."""
    if session.imu is None or located.inertial is None:
        return 0.0
    ahead_s = located.inertial.minus_gnss_s - session.imu.minus_gnss_s
    return ahead_s if abs(ahead_s) > IMU_CLOCK_STEP_S else 0.0


def _correct_clock(lidar: LidarRecording, matched: Matched | None) -> LidarRecording:
    """The recording with the offset of the clocks that matching found."""
    return lidar.ahead_by(matched.clock_used_s) if matched is not None else lidar


def _run_without_scans(opened: OpenSession, progress: Progress) -> RunResult:
    """The ground worked in a session that names no scanner's recording."""
    session = opened.session
    watch = _StopWatch()
    progress("reading positions", 0.0)
    positions = opened.positions()
    located = located_without_lidar(positions, session, opened.frame, companions(opened))
    located = _held_against_geoid(located, positions.notices)
    aid_notices: list[Notice] = []
    located, aid = _aid_by_images(opened, located, aid_notices, progress)
    located = _held_against_control(located, aid)
    boundary, field_notices = _read_boundary(opened, located.trajectory)
    states, state_notices = _read_external_states(opened, located.trajectory)
    watch.lap("positions")
    progress("work", 0.0)
    tools = session.implements or (None,)
    known = [
        FieldWork(boundary=boundary, external=external, tool=tool.name if tool is not None else "")
        for tool, external in zip_longest(tools, states)
    ]
    work = with_grounds(known, located.trajectory, opened.frame, tools)
    field_notices += _boundary_notices(work, located.trajectory)
    watch.lap("work")
    placement = Placement.without_scans(located.trajectory)
    notices = [*positions.notices, *located.notices, *quality_notices(placement.poses), *aid_notices]
    notices += [*field_notices, *state_notices, *work.notices]
    found = _run_result(opened, located, placement, work, (), notices, watch)
    return replace(found, image_aid=aid)


def preview(opened: OpenSession, open_sink: OpenSink, progress: Progress = silent) -> RunResult:
    """A run with few scans, in seconds: neither matched to the ground nor searched for the implement.

    An error that would stop a run before its work, such as clocks without a common time, stops a preview.

    Args:
        open_sink: is called before the first of these scans, where the session names a scanner's recording.

    Raises:
        FurrowmapError: if the session's files do not make a track with points along it.
    """
    session = opened.session
    watch = _StopWatch()
    progress("reading positions", 0.0)
    positions = opened.positions()
    clocks: tuple[ClockReading, ...] = ()
    if session.recording.lidar:
        located = _drop_unstated_accuracy(locate(positions, session, opened.frame, companions(opened)), session)
        carrier, mount_notices = carrier_of(located, session, opened.inputs.mount)
        begin_s, end_s = located.trajectory.span_s
        period_s = max(PREVIEW_PERIOD_S, (end_s - begin_s) / PREVIEW_SCANS)
        lidar = opened.lidar(0.5 * (begin_s + end_s), period_s)
        placer = placer_of(located, session.lidar.mounting, carrier)
        sink = open_sink(opened.frame, placer.origin_m, None)
        scans = watched(preview_scans(lidar.scans(), period_s), lidar, progress, "looking at scans")
        placement = place_scans(scans, placer, standing=True, sink=sink, classify=classifier(None))
        refuse_empty(placement, located.trajectory, session)
        clocks = lidar.clocks
        assumed = [*lidar.notices, *mount_notices, *session_notices(session, located, matched=False)]
    else:
        located = located_without_lidar(positions, session, opened.frame, companions(opened))
        placement = Placement.without_scans(located.trajectory)
        assumed = []
    watch.lap("preview")
    notices = [*positions.notices, *located.notices, *assumed]
    return _run_result(opened, located, placement, FieldWork(), clocks, notices, watch)


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


def ground_scale(frame: MapFrame, trajectory: Trajectory) -> float:
    """Metres of the map for a metre on the ground in the middle of a trajectory."""
    e, n, h = np.median(trajectory.xyz_m, axis=0)
    lon, lat = frame.to_lon_lat(np.array([e]), np.array([n]))
    return frame.ground_scale(float(lon[0]), float(lat[0]), float(h))


def placer_of(located: Located, mounting: Mounting, carrier: Trajectory | None = None, scale: float = 1.0) -> Placer:
    """What places the points of a scanner mounted so, against a round local origin in the middle of the drive."""
    middle = np.median(located.trajectory.xyz_m, axis=0)
    e, n, h = (np.round(middle / ORIGIN_STEP_M) * ORIGIN_STEP_M).tolist()
    return Placer(located.trajectory, mounting, (e, n, h), carrier, scale)


def _run_result(
    opened: OpenSession,
    located: Located,
    placement: Placement,
    work: FieldWork,
    clocks: tuple[ClockReading, ...],
    notices: list[Notice],
    watch: _StopWatch,
    matched: Matched | None = None,
) -> RunResult:
    return RunResult(
        session=opened.session,
        inputs=opened.inputs.all,
        frame=opened.frame,
        located=located,
        placement=placement,
        work=work,
        clocks=clocks,
        notices=tuple(sorted(dict.fromkeys(notices), key=lambda notice: notice.code != CONTRADICTION)),
        timings_s=watch.laps_s,
        matched=matched,
    )


class _StopWatch:
    """Seconds of each stage."""

    def __init__(self) -> None:
        self.laps_s: dict[str, float] = {}
        self._last = perf_counter()

    def lap(self, stage: str) -> None:
        arrays.release()
        now = perf_counter()
        self.laps_s[stage] = round(now - self._last, 3)
        self._last = now
