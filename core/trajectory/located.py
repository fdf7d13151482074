"""The first guess of a run: the vehicle's trajectory from GNSS, attitudes of other devices, or a file of poses.

Roll and pitch may be those of one device and the heading that of another, as Christiansen et al. (Sensors 2017)
combined them: roll and pitch of an IMU, heading of the aircraft's autopilot, turned from true to grid north (their
equation 1).
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Final, TypeAlias

import msgspec
import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from furrowmap.core.adjustment.imu_aiding import Aid
from furrowmap.core.adjustment.position_observations import (
    ANTENNA_HEADING_CORRELATION_S,
    ANTENNA_HEADING_SIGMA_RAD,
    RecordedHeadings,
)
from furrowmap.core.geodesy.coordinates import UNCHANGED, TransformSummary, transform_poses, transform_track
from furrowmap.core.geodesy.longitudes import middle_deg
from furrowmap.core.geodesy.projection import MapFrame
from furrowmap.core.readers.inertial_rows import imu_notices, without_frozen
from furrowmap.core.readers.reader import GivesAttitude, GivesInertial, GivesPoses, GivesTrack, Reader
from furrowmap.core.runtime.arrays import FloatArray
from furrowmap.core.runtime.errors import InputError, Notice, RefusedError
from furrowmap.core.runtime.languages.texts import Text
from furrowmap.core.trajectory.from_course import trajectory_from_course
from furrowmap.core.trajectory.from_gnss import GnssTrajectory, trajectory_from_gnss
from furrowmap.core.trajectory.from_inertial import InertialFigures, trajectory_from_inertial
from furrowmap.core.trajectory.from_poses import trajectory_from_poses
from furrowmap.core.trajectory.height_steps import without_height_steps
from furrowmap.core.trajectory.held_positions import without_held
from furrowmap.core.trajectory.inertial_start import Hints, MountedImu, site_of
from furrowmap.core.trajectory.pose_errors import PoseErrors
from furrowmap.core.trajectory.smoothing import smooth_path
from furrowmap.core.trajectory.used_positions import (
    fixes_from_labels,
    positions_without_steps,
    quality_words,
    sigmas_m,
    usable,
)
from furrowmap.core.trajectory.vehicle_motion import STANDING_MPS, longest_gap_s
from furrowmap.core.values.clock import iso_utc
from furrowmap.core.values.gnss import Fix, GnssTrack, Positions
from furrowmap.core.values.inertial import inertial_noise
from furrowmap.core.values.pose_track import GRID_NORTH, MAGNETIC_NORTH, TRUE_NORTH, AttitudeTrack
from furrowmap.core.values.rotation import Mounting, attitude_to_quaternion, quaternion_to_attitude, unwrap_deg
from furrowmap.core.values.session import ORIGIN, Antenna, Session
from furrowmap.core.values.time_span import inertial_within, track_within
from furrowmap.core.values.trajectory import Motion, Trajectory, same_hemisphere, source_columns

MIN_PATH_POSITIONS: Final = 4
"""Positions of a stretch through which a path is laid."""


@dataclass(frozen=True)
class AttitudeLogs:
    """Roll and pitch of one log and the heading of another, both of the vehicle frame.

    Attributes:
        heading: its heading is used; from true or grid north.
        sigma_deg: standard deviations of roll and pitch, and of the heading; nan where unknown.
    """

    roll_pitch: AttitudeTrack
    heading: AttitudeTrack
    sigma_deg: tuple[float, float] = (np.nan, np.nan)


def of_vehicle(track: AttitudeTrack, rpy_deg: tuple[float, float, float]) -> AttitudeTrack:
    """The attitudes of the vehicle by a device whose axes are turned by `rpy_deg` in the vehicle frame.

    Angles that it does not record are taken for 0 and stay unknown.
    """
    if rpy_deg == (0.0, 0.0, 0.0):
        return track
    angles = [np.where(np.isfinite(a), a, 0.0) for a in (track.roll_deg, track.pitch_deg, track.heading_deg)]
    turned = Rotation.from_quat(attitude_to_quaternion(*angles), scalar_first=True)
    vehicle = turned * Rotation.from_matrix(Mounting(rpy_deg=rpy_deg).rotation).inv()
    roll, pitch, heading = quaternion_to_attitude(vehicle.as_quat(scalar_first=True))
    return replace(
        track,
        roll_deg=np.where(np.isfinite(track.roll_deg), roll, np.nan),
        pitch_deg=np.where(np.isfinite(track.pitch_deg), pitch, np.nan),
        heading_deg=np.where(np.isfinite(track.heading_deg), heading, np.nan),
    )


def from_stated_north(track: AttitudeTrack, north: str | None, declination_deg: float | None) -> AttitudeTrack:
    """Headings from true or grid north.

    Args:
        north: as the session states it, for logs that do not.
        declination_deg: of the magnetic field at the place and time, positive east.

    Raises:
        InputError: if it is unknown from which north the headings count, or the declination is.
    """
    north = north or track.north
    if north not in (TRUE_NORTH, GRID_NORTH, MAGNETIC_NORTH):
        raise InputError("north-unknown", source=track.source)
    if north != MAGNETIC_NORTH:
        return replace(track, north=north)
    if declination_deg is None:
        raise InputError("no-declination", source=track.source)
    return replace(track, heading_deg=track.heading_deg + declination_deg, north=TRUE_NORTH)


def trajectory_from_attitude_logs(
    track: GnssTrack,
    logs: AttitudeLogs,
    frame: MapFrame,
    lever_m: tuple[float, float, float],
    fixes: tuple[Fix, ...] | None,
) -> GnssTrajectory:
    """The trajectory of the vehicle frame.

    Args:
        track: positions of the antenna, in the datum of the map.

    Raises:
        InputError: if no position is left to use, or positions and logs have no time in common.
    """
    kept = without_height_steps(without_held(usable(track, fixes)))
    gated = kept.track
    en = np.column_stack(frame.project(gated.lon_deg, gated.lat_deg))
    t_s, xyz, velocity = _antenna(gated, en, logs.roll_pitch.t_s)
    roll, pitch = (_at(t_s, logs.roll_pitch, name) for name in ("roll_deg", "pitch_deg"))
    heading = _at(t_s, logs.heading, "heading_deg")
    known = np.isfinite(roll) & np.isfinite(pitch) & np.isfinite(heading)
    if known.sum() < 2:
        named = (
            (Text("positions"), gated.t_s),
            (Text("roll and pitch"), logs.roll_pitch.t_s),
            (Text("headings"), logs.heading.t_s),
        )
        spans = tuple(
            Text("{name} from {first} to {last}", name=name, first=iso_utc(float(t_s[0])), last=iso_utc(float(t_s[-1])))
            for name, t_s in named
        )
        raise InputError("attitude-no-overlap", spans=spans)
    t_s = t_s[known]
    xyz = xyz[known]
    velocity = velocity[known]
    roll = roll[known]
    pitch = pitch[known]
    heading = heading[known]
    if logs.heading.north == TRUE_NORTH:
        heading = heading - frame.convergence_deg(*frame.to_lon_lat(xyz[:, 0], xyz[:, 1]))
    turn = Rotation.from_quat(attitude_to_quaternion(roll, pitch, heading), scalar_first=True)
    speed = np.einsum("ki,ki->k", velocity, turn.as_matrix()[:, :, 0])
    standing = np.linalg.norm(velocity, axis=1) < STANDING_MPS
    nearest = np.clip(np.searchsorted(gated.t_s, t_s), 0, len(gated) - 1)
    sigma = np.empty((len(t_s), 6))
    sigma[:, :3] = sigmas_m(gated)[nearest][:, [0, 0, 1]]
    sigma[:, 3:5], sigma[:, 5] = logs.sigma_deg
    trajectory = Trajectory(
        t_s=t_s,
        xyz_m=xyz - turn.apply(np.asarray(lever_m, np.float64)),
        quaternion=same_hemisphere(turn.as_quat(scalar_first=True)),
        speed_mps=np.where(standing, 0.0, speed),
        motion=np.where(standing, Motion.STANDING, np.sign(speed)).astype(np.int8),
        fix=gated.fix[nearest],
        sigma=sigma,
        max_gap_s=longest_gap_s(t_s),
        **source_columns(len(t_s), "attitude", "gnss", "gnss", "attitude"),
    )
    positions = positions_without_steps(gated, en)
    return GnssTrajectory(trajectory, positions, quality_words(gated.fix), kept.unused, kept.notices, kept.levels_m)


def _antenna(track: GnssTrack, en_m: FloatArray, wanted_s: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """The wanted times (m,) within stretches of positions; place and velocity of the antenna (m, 3) there."""
    xyz = np.column_stack([en_m, track.height_m])
    parts = []
    for part in np.split(np.arange(len(track)), 1 + np.flatnonzero(np.diff(track.t_s) > longest_gap_s(track.t_s))):
        first_s = track.t_s[part[0]]
        last_s = track.t_s[part[-1]]
        t_s = wanted_s[(wanted_s >= first_s) & (wanted_s <= last_s)]
        if len(part) < MIN_PATH_POSITIONS or not len(t_s):
            continue
        origin = xyz[part[0]]
        path, up = (smooth_path(track.t_s[part] - first_s, (xyz[part] - origin)[:, axes]) for axes in ([0, 1], [2]))
        since = t_s - first_s
        here, moving = (np.column_stack([path(since, order), up(since, order)]) for order in (0, 1))
        parts.append((t_s, origin + here, moving))
    if not parts:
        return np.empty(0), np.empty((0, 3)), np.empty((0, 3))
    t_s, places, velocities = (np.concatenate(columns) for columns in zip(*parts, strict=True))
    return t_s, places, velocities


def _at(t_s: FloatArray, track: AttitudeTrack, name: str) -> FloatArray:
    """An angle (n,) of a log at times (n,); nan outside the log and in its gaps."""
    values: FloatArray = getattr(track, name)
    known = np.isfinite(values)
    if known.sum() < 2:
        return np.full(len(t_s), np.nan)
    known_s = track.t_s[known]
    angle = unwrap_deg(values[known])
    after = np.clip(np.searchsorted(known_s, t_s), 1, len(known_s) - 1)
    bridged = known_s[after] - known_s[after - 1] <= longest_gap_s(known_s)
    inside = (t_s >= known_s[0]) & (t_s <= known_s[-1]) & bridged
    return np.where(inside, np.interp(t_s, known_s, angle), np.nan)


SLOWEST_DIRECTIONS_S: Final = 0.3
"""Positions further apart than this do not show whether a vehicle reverses."""
HEADING_SIGMA_DEG: Final = 5.0
"""Of a recorded heading where `[attitude]` states none: what a magnetometer beside iron and motors is good for."""
OpenInertial: TypeAlias = Callable[[float], GivesInertial]
OpenAttitude: TypeAlias = Callable[[float], tuple[GivesAttitude, GivesAttitude]]


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
        height_levels_m: by how much the levels of heights differ that were put on one; standard deviations lack it.
        separation_off_m: by how much heights may be off with the geoid separations; standard deviations lack it, too.
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
    height_levels_m: float = 0.0
    separation_off_m: float = 0.0


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
    if isinstance(positions, GivesPoses) and session.trajectory is not None:
        poses, transformed = transform_poses(track_within(positions.poses(), session.recording.span_s), frame)
        notices = (*transformed.notices, *_unused_attitude(session, "[trajectory]"))
        return Located(trajectory_from_poses(poses, frame), "file", {}, notices, transformed=transformed)
    assert isinstance(positions, GivesTrack)
    recorded = track_within(positions.track(), session.recording.span_s)
    track, transformed = transform_track(recorded, frame)
    found = _locate_by_positions(track, transformed, session, frame, beside)
    return replace(found, separation_off_m=recorded.separation_off_m)


def _locate_by_positions(
    baseline: GnssTrack, transformed: TransformSummary, session: Session, frame: MapFrame, beside: Companions
) -> Located:
    """The trajectory from positions on the map, whose headings are those of the baseline between two antennas."""
    fixes = fixes_from_labels(session.run.fixes) if session.run.fixes is not None else None
    track = _of_nose(baseline, session)
    if beside.inertial is not None and session.imu is not None:
        near_s = middle_s(track)
        unused = _unused_attitude(session, "[imu]")
        hints = Hints(session.imu.on_wheels, unasked=int(np.isfinite(track.heading_deg).sum()) > 1)
        if session.imu.heading == "attitude" and beside.attitude is not None:
            hints = replace(hints, heading=_heading_log(session, frame, track, beside.attitude(near_s)[1]))
            unused = []
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
        height_levels_m=alone.height_levels_m,
    )


def _unused_attitude(session: Session, used: str) -> list[Notice]:
    return [Notice("attitude-unused", used=used)] if session.attitude is not None else []


def middle_s(track: GnssTrack) -> float:
    """A time in the middle of a track; 0 without positions."""
    return float(np.median(track.t_s)) if len(track) else 0.0


def _heading_log(session: Session, frame: MapFrame, track: GnssTrack, reader: GivesAttitude) -> RecordedHeadings:
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
        raise InputError("heading-missing.two-antennas")
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
    inertial: GivesInertial,
    hints: Hints,
) -> Located:
    """The trajectory from GNSS and an IMU; of a machine on the ground, from GNSS with what its IMU adds to matching."""
    assert session.imu is not None
    table = session.imu
    stated = {name: value for name, value in msgspec.structs.asdict(table.noise).items() if value is not None}
    mounting = Mounting(table.xyz_m, table.rpy_deg)
    noise = inertial_noise(table.kind, stated)
    measured, frozen = without_frozen(inertial.inertial())
    lever_m = lever_arm_m(session)
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
        found.trajectory,
        "imu",
        found.counts,
        notices,
        None,
        transformed,
        found.figures,
        pose_errors=found.pose_errors,
        height_levels_m=found.height_levels_m,
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
    notices = [*transformed.notices, *imu_warnings, *found.notices]
    figures = None
    try:
        by_imu = trajectory_from_inertial(track, imu, frame, lever_m, fixes, hints, by_noise_alone=True)
    except RefusedError as refused:
        notices.append(Notice("imu-not-aligned.gyroscopes-used", what=refused.words("what")))
    else:
        figures = by_imu.figures
        notices += [notice for notice in by_imu.notices if notice not in notices]
        # Accelerometers that contradict the positions say nothing of the attitude.
        aid = replace(aid, track=by_imu.adjusted.problem.links.track)
        if "imu-noisier" not in {notice.code for notice in by_imu.notices}:
            aid = replace(aid, trajectory=by_imu.trajectory)
    return Located(
        found.trajectory,
        "gnss",
        found.counts,
        tuple(notices),
        found.positions,
        transformed,
        figures,
        aid,
        height_levels_m=found.height_levels_m,
    )


def _with_attitude(
    track: GnssTrack,
    session: Session,
    frame: MapFrame,
    fixes: tuple[Fix, ...] | None,
    readers: tuple[GivesAttitude, GivesAttitude],
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
    levels_m = found.height_levels_m
    return Located(found.trajectory, "attitude", found.counts, notices, antenna, height_levels_m=levels_m)


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
    return Located(
        course.trajectory,
        "gnss",
        used,
        notices,
        transformed=transformed,
        separation_off_m=track.separation_off_m,
    )


def lever_arm_m(session: Session) -> tuple[float, float, float]:
    """The antenna in the vehicle frame; zero where the session does not state it."""
    return session.antenna.xyz_m if session.antenna is not None else (0.0, 0.0, 0.0)
