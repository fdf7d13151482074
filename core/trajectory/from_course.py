"""A trajectory from positions a second apart, as machines log them: the vehicle drives forward along its course.

At that rate positions do not show which way a vehicle moves (a turn on the headland looks like a change of direction),
so :mod:`.from_gnss` cannot tell reverse from forward. A machine at work does not reverse, and where it does not work it
does not matter.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from furrowmap.core.geodesy.projection import MapFrame
from furrowmap.core.readers.implausible_positions import drop_implausible_positions
from furrowmap.core.runtime.arrays import FloatArray
from furrowmap.core.runtime.errors import InputError, Notice
from furrowmap.core.runtime.languages.texts import Text
from furrowmap.core.trajectory.smoothing import smooth_path, white_noise
from furrowmap.core.trajectory.used_positions import UsedPositions, sigmas_m, without_jumps
from furrowmap.core.values.gnss import GnssTrack
from furrowmap.core.values.trajectory import Motion, Trajectory, source_columns, trajectory_from_attitude

MAX_COURSE_GAP_S: Final = 15.0
"""A machine on its way bridges this without surprises; logs pause for seconds where nothing changes."""
CREEPING_MPS: Final = 0.3
"""Slower than this, positions a second apart show no course."""
COURSE_STANDING_MPS: Final = 0.05
MIN_COURSE_POSITIONS: Final = 2


@dataclass(frozen=True)
class CourseTrajectory:
    """A trajectory, whether each position of the track was used (n,), and notices."""

    trajectory: Trajectory
    used: NDArray[np.bool_]
    notices: tuple[Notice, ...]


def trajectory_from_course(
    track: GnssTrack, frame: MapFrame, lever_m: tuple[float, float, float] = (0.0, 0.0, 0.0)
) -> CourseTrajectory:
    """The trajectory of a vehicle that drives forward along its course.

    Roll and pitch are zero; a height that the track does not state is 0. Positions far away from all others, and those
    that no drive leads to, are left out and reported.

    Args:
        lever_m: the antenna in the vehicle frame.

    Raises:
        InputError: if fewer than two positions are left.
        RefusedError: if the place lies outside the area of the map's CRS.
    """
    near = np.isfinite(track.lon_deg) & np.isfinite(track.lat_deg)
    here, kept_of_near, found = drop_implausible_positions(track[near])
    near[near] = kept_of_near
    _expect_some(track, near)
    en = np.column_stack(frame.project(here.lon_deg, here.lat_deg))
    positions, en = without_jumps(UsedPositions(here, notices=tuple(found)), en)
    kept = positions.track
    used = near.copy()
    used[near] = np.isin(here.t_s, kept.t_s)
    _expect_some(track, used)
    heading, speed = _course(kept.t_s, en)
    turned = np.radians(90.0 - heading)
    along = np.array([np.cos(turned), np.sin(turned)]).T
    across = np.array([-np.sin(turned), np.cos(turned)]).T
    origin = en - lever_m[0] * along - lever_m[1] * across
    height = np.where(np.isfinite(kept.height_m), kept.height_m - lever_m[2], 0.0)
    sigma = np.full((len(kept), 6), np.nan)
    sigma[:, :2] = sigmas_m(kept)[:, :1]
    sigma[:, 5] = np.degrees(white_noise(en) / np.maximum(speed, CREEPING_MPS) / float(np.median(np.diff(kept.t_s))))
    motion = np.where(speed > COURSE_STANDING_MPS, Motion.FORWARD, Motion.STANDING).astype(np.int8)
    xyz_m = np.column_stack([origin, height])
    trajectory = trajectory_from_attitude(
        kept.t_s, xyz_m, 0.0, 0.0, heading, max_gap_s=MAX_COURSE_GAP_S, speed_mps=speed, motion=motion
    )
    sources = source_columns(len(kept), "course", "gnss", "gnss", "assumed")
    trajectory = replace(trajectory, fix=kept.fix, sigma=sigma, **sources)
    return CourseTrajectory(trajectory, used, positions.notices)


def _expect_some(track: GnssTrack, used: NDArray[np.bool_]) -> None:
    if used.sum() < MIN_COURSE_POSITIONS:
        raise InputError(
            "gnss-no-positions.few-usable",
            source=track.source or Text("The log"),
            used=int(used.sum()),
            track=len(track),
        )


def _course(t_s: FloatArray, en_m: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Heading (n,) in degrees from grid north, at a stand that around it, and speed (n,), along a smooth path."""
    heading = np.zeros(len(t_s))
    speed = np.zeros(len(t_s))
    for part in np.split(np.arange(len(t_s)), 1 + np.flatnonzero(np.diff(t_s) > MAX_COURSE_GAP_S)):
        if len(part) < MIN_COURSE_POSITIONS:
            continue
        since = t_s[part] - t_s[part[0]]
        velocity = smooth_path(since, en_m[part] - en_m[part[0]])(since, 1)
        speed[part] = np.hypot(velocity[:, 0], velocity[:, 1])
        moves = speed[part] > CREEPING_MPS
        if moves.any():
            course = np.unwrap(np.arctan2(velocity[moves, 0], velocity[moves, 1]))
            heading[part] = np.degrees(np.interp(since, since[moves], course))
    return heading % 360.0, speed
