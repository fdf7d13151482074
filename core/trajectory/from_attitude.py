"""The trajectory from GNSS positions and the attitudes that other devices computed.

Roll and pitch may be those of one device and the heading that of another, as Christiansen et al. (Sensors 2017)
combined them: roll and pitch of an IMU, heading of the aircraft's autopilot, turned from true to grid north (their
equation 1).
"""

from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from scipy.spatial.transform import Rotation

from furrowmap.core.geodesy.projection import MapFrame
from furrowmap.core.runtime.arrays import FloatArray
from furrowmap.core.runtime.errors import InputError, Notice
from furrowmap.core.trajectory.from_gnss import GnssTrajectory
from furrowmap.core.trajectory.motion import STANDING_MPS, longest_gap_s
from furrowmap.core.trajectory.positions import positions_without_steps, quality_words, sigmas_m, usable
from furrowmap.core.trajectory.smoothing import smooth_path
from furrowmap.core.values.clock import iso_utc
from furrowmap.core.values.gnss import Fix, GnssTrack
from furrowmap.core.values.pose_track import GRID_NORTH, MAGNETIC_NORTH, TRUE_NORTH, AttitudeTrack
from furrowmap.core.values.rotation import Mounting, attitude_to_quaternion, quaternion_to_attitude, unwrap_deg
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
    notices: list[Notice] = []
    gated, unused = usable(track, fixes, notices)
    en = np.column_stack(frame.project(gated.lon_deg, gated.lat_deg))
    t_s, xyz, velocity = _antenna(gated, en, logs.roll_pitch.t_s)
    roll, pitch = (_at(t_s, logs.roll_pitch, name) for name in ("roll_deg", "pitch_deg"))
    heading = _at(t_s, logs.heading, "heading_deg")
    known = np.isfinite(roll) & np.isfinite(pitch) & np.isfinite(heading)
    if known.sum() < 2:
        times = {"positions": gated.t_s, "roll and pitch": logs.roll_pitch.t_s, "headings": logs.heading.t_s}
        spans = (f"{name} from {iso_utc(float(t[0]))} to {iso_utc(float(t[-1]))}" for name, t in times.items())
        raise InputError("attitude-no-overlap", spans=", ".join(spans))
    t_s, xyz, velocity = t_s[known], xyz[known], velocity[known]
    roll, pitch, heading = roll[known], pitch[known], heading[known]
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
    return GnssTrajectory(trajectory, positions, quality_words(gated.fix), unused, tuple(notices))


def _antenna(track: GnssTrack, en_m: FloatArray, wanted_s: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """The wanted times (m,) within stretches of positions; place and velocity of the antenna (m, 3) there."""
    xyz = np.column_stack([en_m, track.height_m])
    parts = []
    for part in np.split(np.arange(len(track)), 1 + np.flatnonzero(np.diff(track.t_s) > longest_gap_s(track.t_s))):
        first_s, last_s = track.t_s[part[0]], track.t_s[part[-1]]
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
    known_s, angle = track.t_s[known], unwrap_deg(values[known])
    after = np.clip(np.searchsorted(known_s, t_s), 1, len(known_s) - 1)
    bridged = known_s[after] - known_s[after - 1] <= longest_gap_s(known_s)
    inside = (t_s >= known_s[0]) & (t_s <= known_s[-1]) & bridged
    return np.where(inside, np.interp(t_s, known_s, angle), np.nan)
