"""The first guess of a run: the vehicle's trajectory from GNSS alone, or from a file of poses."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Final, TypeAlias

import msgspec
import numpy as np
from numpy.typing import NDArray

from furrowmap.core.estimation.aiding import Aid
from furrowmap.core.estimation.positions import (
    ANTENNA_HEADING_CORRELATION_S,
    ANTENNA_HEADING_SIGMA_RAD,
    RecordedHeadings,
)
from furrowmap.core.geodesy.coordinates import UNCHANGED, TransformSummary, transform_poses, transform_track
from furrowmap.core.geodesy.projection import MapFrame, middle_deg
from furrowmap.core.readers.inertial_rows import imu_notices, without_frozen
from furrowmap.core.readers.reader import AttitudeReader, GivesPoses, GivesTrack, InertialReader, Reader
from furrowmap.core.runtime.errors import InputError, Notice, RefusedError
from furrowmap.core.trajectory.from_attitude import (
    AttitudeLogs,
    from_stated_north,
    of_vehicle,
    trajectory_from_attitude_logs,
)
from furrowmap.core.trajectory.from_course import trajectory_from_course
from furrowmap.core.trajectory.from_gnss import GnssTrajectory, trajectory_from_gnss
from furrowmap.core.trajectory.from_inertial import InertialFigures, trajectory_from_inertial
from furrowmap.core.trajectory.from_poses import trajectory_from_poses
from furrowmap.core.trajectory.inertial_start import Hints, MountedImu, site_of
from furrowmap.core.trajectory.pose_errors import PoseErrors
from furrowmap.core.trajectory.positions import fixes_from_labels, quality_words
from furrowmap.core.values.gnss import Fix, GnssTrack, Positions
from furrowmap.core.values.inertial import inertial_noise
from furrowmap.core.values.pose_track import TRUE_NORTH
from furrowmap.core.values.rotation import Mounting
from furrowmap.core.values.session import ORIGIN, Antenna, Session
from furrowmap.core.values.time_span import inertial_within, track_within
from furrowmap.core.values.trajectory import Trajectory

SLOWEST_DIRECTIONS_S: Final = 0.3
"""Positions further apart than this do not show whether a vehicle reverses."""
HEADING_SIGMA_DEG: Final = 5.0
"""Of a recorded heading where `[attitude]` states none: what a magnetometer beside iron and motors is good for."""
OpenInertial: TypeAlias = Callable[[float], InertialReader]
OpenAttitude: TypeAlias = Callable[[float], tuple[AttitudeReader, AttitudeReader]]


@dataclass(frozen=True)
class Located:
    """A trajectory and where it comes from.

    Attributes:
        source: "gnss", "imu", "attitude" or "file".
        positions: numbers of positions used and left out, by quality or reason; empty for a trajectory from a file.
        antenna: the positions themselves; None for a trajectory from a file, from the course alone, or of an aircraft.
        transformed: how the recorded coordinates were transformed to the map.
        inertial: figures of the IMU; None without one.
        aid: what the IMU of a machine on the ground adds to scan matching; None without one.
        with_lever: gives the trajectory with another lever arm; None where it does not come from GNSS.
        pose_errors: gives the joint covariance of the errors of the poses, with nodes at some times among others; None
            where they do not come from an IMU.
    """

    trajectory: Trajectory
    source: str
    positions: dict[str, dict[str, int]]
    notices: tuple[Notice, ...]
    antenna: Positions | None = None
    transformed: TransformSummary = UNCHANGED
    inertial: InertialFigures | None = None
    aid: Aid | None = None
    with_lever: Callable[[tuple[float, float, float]], Trajectory] | None = None
    pose_errors: Callable[[NDArray[np.float64]], PoseErrors] | None = None


@dataclass(frozen=True)
class Companions:
    """What opens the recordings beside the positions, given a time near them; None for what a session does not have."""

    inertial: OpenInertial | None = None
    attitude: OpenAttitude | None = None


def locate(positions: Reader, session: Session, frame: MapFrame, beside: Companions = Companions()) -> Located:
    """The trajectory: from the session's own file, from GNSS and an IMU or attitude logs, or from GNSS alone.

    Raises:
        InputError: if there is too little to make one.
        RefusedError: if the CRS does not fit the place, or nothing shows the heading.
    """

    def unused_attitude(used: str) -> list[Notice]:
        return [Notice("attitude-unused", used=used)] if session.attitude is not None else []

    if isinstance(positions, GivesPoses) and session.trajectory is not None:
        poses, transformed = transform_poses(track_within(positions.poses(), session.recording.span_s), frame)
        notices = (*transformed.notices, *unused_attitude("[trajectory]"))
        return Located(trajectory_from_poses(poses, frame), "file", {}, notices, transformed=transformed)
    assert isinstance(positions, GivesTrack)
    fixes = fixes_from_labels(session.run.fixes) if session.run.fixes is not None else None
    track, transformed = transform_track(track_within(positions.track(), session.recording.span_s), frame)
    baseline = track
    track = _of_nose(track, session)
    if beside.inertial is not None and session.imu is not None:
        near_s, unused = middle_s(track), unused_attitude("[imu]")
        hints = Hints(session.imu.on_wheels, unasked=int(np.isfinite(track.heading_deg).sum()) > 1)
        if session.imu.heading == "attitude" and beside.attitude is not None:
            hints, unused = replace(hints, heading=_heading_log(session, frame, track, beside.attitude(near_s)[1])), []
        elif session.imu.heading == "antennas":
            hints = replace(hints, heading=_antennas_log(session, frame, baseline))
        found = _with_imu(track, transformed, session, frame, fixes, beside.inertial(near_s), hints)
        return replace(found, notices=(*found.notices, *unused))
    if beside.attitude is not None and session.attitude is not None:
        found = _with_attitude(track, session, frame, fixes, beside.attitude(middle_s(track)))
        return replace(found, notices=(*transformed.notices, *found.notices), transformed=transformed)

    def with_lever(lever_m: tuple[float, float, float]) -> GnssTrajectory:
        return trajectory_from_gnss(track, frame, lever_m, fixes)

    alone = with_lever(lever_arm_m(session))
    return Located(
        alone.trajectory,
        "gnss",
        alone.counts,
        (*transformed.notices, *alone.notices),
        alone.positions,
        transformed,
        with_lever=lambda lever_m: with_lever(lever_m).trajectory,
    )


def middle_s(track: GnssTrack) -> float:
    """A time in the middle of a track; 0 without positions."""
    return float(np.median(track.t_s)) if len(track) else 0.0


def _heading_log(session: Session, frame: MapFrame, track: GnssTrack, reader: AttitudeReader) -> RecordedHeadings:
    """The headings of the vehicle that `[attitude] heading` names, from grid north."""
    table = session.attitude
    assert table is not None
    log = from_stated_north(of_vehicle(reader.attitude(), table.heading_rpy_deg), table.north, table.declination_deg)
    known = np.isfinite(log.heading_deg)
    if known.sum() < 2:
        raise InputError("heading-missing", source=log.source)
    heading = log.heading_deg[known]
    if log.north == TRUE_NORTH:
        lon, lat = middle_deg(track.lon_deg, track.lat_deg)
        heading = heading - float(frame.convergence_deg(np.array([lon]), np.array([lat]))[0])
    sigma_deg = table.heading_sigma_deg or HEADING_SIGMA_DEG
    return RecordedHeadings(log.t_s[known], np.radians(90.0 - heading), float(np.radians(sigma_deg)))


def _of_nose(track: GnssTrack, session: Session) -> GnssTrack:
    """The track with headings of the vehicle instead of those of the baseline between its two antennas."""
    if session.antenna is None or not session.antenna.baseline_yaw_deg:
        return track
    return replace(track, heading_deg=(track.heading_deg + session.antenna.baseline_yaw_deg) % 360.0)


def _antennas_log(session: Session, frame: MapFrame, track: GnssTrack) -> RecordedHeadings:
    """The directions of the baseline between two antennas that the log of positions holds, from grid north."""
    known = np.isfinite(track.heading_deg)
    if known.sum() < 2:
        raise InputError("heading-missing.antennas-log")
    convergence = frame.convergence_deg(track.lon_deg[known], track.lat_deg[known])
    yaw = np.radians(90.0 - (track.heading_deg[known] - convergence))
    antenna = session.antenna or Antenna(xyz_m=ORIGIN)
    stated = antenna.heading_sigma_deg
    sigma = float(np.radians(stated)) if stated is not None else float(ANTENNA_HEADING_SIGMA_RAD)
    baseline = float(np.radians(antenna.baseline_yaw_deg))
    return RecordedHeadings(track.t_s[known], yaw, sigma, ANTENNA_HEADING_CORRELATION_S, baseline)


def _with_imu(
    track: GnssTrack,
    transformed: TransformSummary,
    session: Session,
    frame: MapFrame,
    fixes: tuple[Fix, ...] | None,
    inertial: InertialReader,
    hints: Hints,
) -> Located:
    """The trajectory from GNSS and an IMU; of a machine on the ground, from GNSS with what its IMU adds to matching."""
    assert session.imu is not None
    table = session.imu
    stated = {name: value for name, value in msgspec.structs.asdict(table.noise).items() if value is not None}
    mounting, noise = Mounting(table.xyz_m, table.rpy_deg), inertial_noise(table.kind, stated)
    frozen: list[Notice] = []
    measured, lever_m = without_frozen(inertial.inertial(), frozen), lever_arm_m(session)
    imu = MountedImu(measured, mounting, noise).earlier_by(table.minus_gnss_s)
    imu = replace(imu, track=inertial_within(imu.track, session.recording.span_s))
    imu_warnings = (*inertial.notices, *frozen, *imu_notices(measured))
    # A machine on the ground is matched to it; an aircraft has neither wheels nor soil below them.
    on_ground = session.implement is not None
    if on_ground and session.recording.lidar:
        return _aided(track, imu, transformed, frame, lever_m, fixes, imu_warnings, hints)
    hints = replace(hints, on_wheels=hints.on_wheels or on_ground)
    try:
        found = trajectory_from_inertial(track, imu, frame, lever_m, fixes, hints)
    except RefusedError:
        if not on_ground:
            raise
        return _aided(track, imu, transformed, frame, lever_m, fixes, imu_warnings, hints)
    notices = (*transformed.notices, *imu_warnings, *found.notices)
    return Located(
        found.trajectory, "imu", found.counts, notices, None, transformed, found.figures, pose_errors=found.pose_errors
    )


def _aided(
    track: GnssTrack,
    imu: MountedImu,
    transformed: TransformSummary,
    frame: MapFrame,
    lever_m: tuple[float, float, float],
    fixes: tuple[Fix, ...] | None,
    imu_warnings: tuple[Notice, ...],
    hints: Hints,
) -> Located:
    """The trajectory of a machine on the ground from GNSS, and what its IMU adds to scan matching."""
    found = trajectory_from_gnss(track, frame, lever_m, fixes)
    aid = Aid(imu.in_vehicle_axes, imu.noise, site_of(track, frame), None)
    notices, figures = [*transformed.notices, *imu_warnings, *found.notices], None
    try:
        by_imu = trajectory_from_inertial(track, imu, frame, lever_m, fixes, hints, by_noise_alone=True)
    except RefusedError as refused:
        notices.append(Notice("imu-not-aligned.aided", what=refused.what))
    else:
        figures = by_imu.figures
        notices += [notice for notice in by_imu.notices if notice not in notices]
        # Accelerometers that contradict the positions say nothing of the attitude.
        aid = replace(aid, track=by_imu.adjusted.problem.links.track)
        if "imu-noisier" not in {notice.code for notice in by_imu.notices}:
            aid = replace(aid, trajectory=by_imu.trajectory)
    return Located(found.trajectory, "gnss", found.counts, tuple(notices), found.positions, transformed, figures, aid)


def _with_attitude(
    track: GnssTrack,
    session: Session,
    frame: MapFrame,
    fixes: tuple[Fix, ...] | None,
    readers: tuple[AttitudeReader, AttitudeReader],
) -> Located:
    """The trajectory from GNSS and attitude logs."""
    assert session.attitude is not None
    table = session.attitude
    level, heading = (reader.attitude() for reader in readers)
    logs = AttitudeLogs(
        of_vehicle(level, table.roll_pitch_rpy_deg),
        from_stated_north(of_vehicle(heading, table.heading_rpy_deg), table.north, table.declination_deg),
        (table.roll_pitch_sigma_deg or np.nan, table.heading_sigma_deg or np.nan),
    )
    found = trajectory_from_attitude_logs(track, logs, frame, lever_arm_m(session), fixes)
    notices = (*readers[0].notices, *readers[1].notices, *found.notices)
    antenna = found.positions if session.implement is not None else None
    return Located(found.trajectory, "attitude", found.counts, notices, antenna)


def located_without_lidar(
    positions: Reader, session: Session, frame: MapFrame, beside: Companions = Companions()
) -> Located:
    """As :func:`locate`; from the course alone where positions come too seldom to show the direction of motion."""
    if session.trajectory is not None or beside != Companions() or not isinstance(positions, GivesTrack):
        return locate(positions, session, frame, beside)
    track = track_within(positions.track(), session.recording.span_s)
    step_s = float(np.median(np.diff(track.t_s))) if len(track) > 1 else np.inf
    if step_s <= SLOWEST_DIRECTIONS_S and np.isfinite(track.height_m).any():
        return locate(positions, session, frame)
    track, transformed = transform_track(_of_nose(track, session), frame)
    course = trajectory_from_course(track, frame, lever_arm_m(session))
    used = {"used": quality_words(track.fix[course.used]), "unused": quality_words(track.fix[~course.used])}
    notices = (Notice("direction-forward"), *transformed.notices, *course.notices)
    return Located(course.trajectory, "gnss", used, notices, transformed=transformed)


def lever_arm_m(session: Session) -> tuple[float, float, float]:
    """The antenna in the vehicle frame; zero where the session does not state it."""
    return session.antenna.xyz_m if session.antenna is not None else (0.0, 0.0, 0.0)
