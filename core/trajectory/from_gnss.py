"""The initial trajectory: position and heading from GNSS alone, the vehicle taken as level.

Nakagawa et al., section 2: driving status and azimuth from positions, then the sensor's position from azimuth and
lever arm. Roll and pitch are zero here and height is the antenna's less its lever arm; scan matching refines them.
"""

from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from furrowmap.core.adjustment.position_observations import ANTENNA_HEADING_SIGMA_RAD
from furrowmap.core.geodesy.projection import MapFrame
from furrowmap.core.runtime import arrays
from furrowmap.core.runtime.arrays import FloatArray
from furrowmap.core.runtime.errors import Notice, RefusedError
from furrowmap.core.runtime.languages.texts import Text
from furrowmap.core.trajectory.height_steps import without_height_steps
from furrowmap.core.trajectory.held_positions import held_against_motion, without_held
from furrowmap.core.trajectory.kinematic import EpochMeasurements, PathEpochs, solve_path
from furrowmap.core.trajectory.used_positions import (
    climb_notices,
    offsets,
    positions_of,
    quality_runs,
    quality_words,
    rate_notices,
    sigmas_m,
    usable,
    white_noise_m,
    without_jumps,
)
from furrowmap.core.trajectory.vehicle_motion import Motions, find_motion, longest_gap_s
from furrowmap.core.values.clock import iso_utc
from furrowmap.core.values.gnss import Fix, GnssTrack, Positions
from furrowmap.core.values.rotation import unwrap_deg, wrap_deg
from furrowmap.core.values.trajectory import Motion, Trajectory, source_columns, trajectory_from_attitude

SWAY_RAD: Final = np.radians(0.3)
"""A tractor on soil sways by a quarter of a degree; an antenna two metres up moves by a centimetre with it."""
TILT_SIGMA_DEG: Final = 1.0
"""What taking a tractor on a field as level is off by, in roll and in pitch (one standard deviation)."""
MAX_PATH_KNOT_STEP_S: Final = 0.2
"""Between positions further apart than this, knots are put in, so that curves stay curves."""
MIN_REPORTED_OUTLIERS: Final = 0.01
"""Share of outliers from which on they are reported."""
ANTENNAS_OFF_DEG: Final = 45.0
"""A heading of two antennas that is this far from the course is that of a baseline across or against the vehicle."""
ANTENNAS_REPORTED_DEG: Final = 0.5
VAGUE_DEG: Final = 15.0
"""Beyond it positions fit several headings: one antenna that moves by decimetres may as well turn about the axle."""
ANY_DEG: Final = 180.0 / np.sqrt(3.0)
"""Of a heading that may be any."""


@dataclass(frozen=True)
class GnssTrajectory:
    """A trajectory from GNSS, alone or with other sensors, the positions it uses, and notices.

    Attributes:
        positions: of the antenna, those that were used.
        used: positions used, by quality label.
        unused: positions left out, by reason.
        height_levels_m: by how much the levels of heights differ that were put on one.
    """

    trajectory: Trajectory
    positions: Positions
    used: dict[str, int]
    unused: dict[str, int]
    notices: tuple[Notice, ...]
    height_levels_m: float

    @property
    def counts(self) -> dict[str, dict[str, int]]:
        """Numbers of positions used and left out."""
        return {"used": self.used, "unused": self.unused}


def trajectory_from_gnss(
    track: GnssTrack, frame: MapFrame, lever_m: tuple[float, float, float], fixes: tuple[Fix, ...] | None
) -> GnssTrajectory:
    """The initial trajectory of the vehicle frame.

    Args:
        lever_m: the antenna in the vehicle frame.
        fixes: qualities whose positions are used; None for 'fixed and float if there is any fixed, else all'.

    Raises:
        InputError: if no position is left to use.
        RefusedError: if the vehicle never moves and no second antenna shows its heading, or positions are too far
            apart in time.
    """
    kept = without_held(usable(track, fixes))
    kept = without_height_steps(kept.told(*rate_notices(kept.track)), lasting=True)
    kept, en = without_jumps(kept, np.column_stack(frame.project(kept.track.lon_deg, kept.track.lat_deg)))
    kept = held_against_motion(kept, en)
    gated = kept.track
    notices = list(kept.notices)
    convergence = frame.convergence_deg(gated.lon_deg, gated.lat_deg)
    white = white_noise_m(gated, en, sigmas_m(gated)[:, 0])
    max_gap_s = longest_gap_s(gated.t_s)
    motions = find_motion(gated.t_s, en, float(np.median(white)), max_gap_s, quality_runs(gated.fix))

    heading_2, found = _antennas_heading(gated, convergence, motions)
    notices += found
    if not np.isfinite(heading_2).any():
        if not motions.motion.any():
            raise RefusedError(
                "heading-unknown.no-heading",
                source=track.source or "The GNSS log",
                first_time=iso_utc(gated.t_s[0]),
                last_time=iso_utc(gated.t_s[-1]),
            )
        if motions.doubtful:
            doubtful = tuple(
                Text("{first} to {last}", first=iso_utc(gated.t_s[a]), last=iso_utc(gated.t_s[b]))
                for a, b in motions.doubtful[:3]
            )
            notices.append(Notice("direction-assumed", spans=doubtful))

    grid = _Grid.over(gated.t_s, max_gap_s)
    steps = offsets(gated, en)
    notices += steps.notices
    positions = positions_of(gated, en, white, heading_2, steps)
    chain, antenna = _chain(positions, motions, lever_m, grid)
    # Yaw from course and direction of motion, interpolated over stands and gaps.
    driven = motions.velocity_mps * motions.motion[:, None]
    shown = np.isfinite(heading_2)
    yaw = np.where(shown, 90.0 - heading_2, np.degrees(np.arctan2(driven[:, 1], driven[:, 0])))
    known = shown | (np.hypot(*driven.T) > 0.0)
    start_yaw = np.radians(np.interp(grid.t_s, gated.t_s[known], unwrap_deg(yaw[known])))
    start_en = np.column_stack([np.interp(grid.t_s, gated.t_s, en[:, k]) for k in range(2)])
    path = solve_path(chain, antenna, start_en, start_yaw)

    motion = motions.motion[grid.nearest]
    speed = _speed(grid.t_s, path.xyz_m, path.yaw_rad, motion, chain.gap)
    notices += climb_notices(gated, en)
    outlier = path.outlier[grid.measured]
    if outlier.mean() > MIN_REPORTED_OUTLIERS:
        notices.append(Notice("gnss-outliers", outlier=outlier.sum(), outlier_count=len(outlier)))
    heading = 90.0 - np.degrees(path.yaw_rad)
    trajectory = trajectory_from_attitude(
        grid.t_s, path.xyz_m, 0.0, 0.0, heading, max_gap_s=max_gap_s, speed_mps=speed, motion=motion
    )
    heading_from = np.where(motion == Motion.STANDING, "standing", "gnss")
    heading_from = np.where(np.isfinite(antenna.yaw_rad), "antennas", heading_from)
    trajectory = replace(
        trajectory,
        **source_columns(len(trajectory), heading_from, "gnss", "gnss", "assumed"),
        fix=gated.fix[grid.nearest],
        sigma=with_vague_headings(_with_tilt(path.sigma, lever_m), np.asarray(lever_m, np.float64)),
    )
    return GnssTrajectory(trajectory, positions, quality_words(gated.fix), kept.unused, tuple(notices), kept.levels_m)


def _antennas_heading(
    track: GnssTrack, convergence_deg: FloatArray, motions: Motions
) -> tuple[FloatArray, list[Notice]]:
    """Grid heading (n,) that two antennas show, nan where there is none or it is not the vehicle's; notices."""
    heading = track.heading_deg - convergence_deg
    course = 90.0 - np.degrees(np.arctan2(motions.velocity_mps[:, 1], motions.velocity_mps[:, 0]))
    speed = np.hypot(*motions.velocity_mps.T)
    both = np.isfinite(heading) & (speed > 0.2)
    if not both.any():
        return heading, []
    off = wrap_deg(heading - course)[both]
    median = float(np.degrees(np.angle(np.median(np.cos(np.radians(off))) + 1j * np.median(np.sin(np.radians(off))))))
    if abs(median) > ANTENNAS_OFF_DEG:
        return np.full(len(track), np.nan), [Notice("antennas-heading-unused", off_course_deg=median)]
    if abs(median) > ANTENNAS_REPORTED_DEG:
        return heading, [Notice("antennas-heading-off", off_course_deg=median)]
    return heading, []


@dataclass(frozen=True)
class _Grid:
    """The knots (m,) of the trajectory: every position (n,), and more where positions are far apart."""

    t_s: FloatArray
    measured: NDArray[np.intp]  # (n,) index of each position's knot
    nearest: NDArray[np.intp]  # (m,) index of the position before or at each knot

    @classmethod
    def over(cls, t_s: FloatArray, max_gap_s: float) -> "_Grid":
        step = np.diff(t_s)
        parts = np.where(step > max_gap_s, 1, np.ceil(step / MAX_PATH_KNOT_STEP_S - 1e-6)).astype(np.intp)
        parts = np.append(np.maximum(parts, 1), 1)
        measured = np.concatenate([[0], np.cumsum(parts)[:-1]])
        nearest = np.repeat(np.arange(len(t_s)), parts)
        within = np.arange(len(nearest)) - measured[nearest]
        knots = t_s[nearest] + within / parts[nearest] * np.append(step, 0.0)[nearest]
        return cls(knots, measured, nearest)


def _chain(
    positions: Positions, motions: Motions, lever_m: tuple[float, float, float], grid: _Grid
) -> tuple[PathEpochs, EpochMeasurements]:
    """The knots with their links and measurements."""

    def spread(values: FloatArray) -> FloatArray:
        out = np.full((len(grid.t_s), *values.shape[1:]), np.nan)
        out[grid.measured] = values
        return out

    gap = np.diff(grid.t_s) > longest_gap_s(positions.t_s)
    motion = motions.motion[grid.nearest]
    still = (motion[1:] == 0) & (motion[:-1] == 0)
    chain = PathEpochs(grid.t_s, still & ~gap, gap, motions.stretch[grid.nearest])
    antenna = EpochMeasurements(
        en_m=spread(positions.xyz_m[:, :2]),
        height_m=spread(positions.xyz_m[:, 2]),
        white_m=np.hypot(positions.white_m[:, 0], SWAY_RAD * abs(lever_m[2]))[grid.nearest],
        white_h_m=positions.white_m[grid.nearest, 2],
        drift_m=positions.drift_m[grid.nearest, 0],
        drift_h_m=positions.drift_m[grid.nearest, 2],
        drift_run=positions.run[grid.nearest],
        yaw_rad=spread(positions.yaw_rad),
        sigma_yaw_rad=float(ANTENNA_HEADING_SIGMA_RAD),
        lever_m=lever_m,
    )
    return chain, antenna


def _speed(
    t_s: FloatArray, xyz_m: FloatArray, yaw_rad: FloatArray, motion: NDArray[np.int8], gap: NDArray[np.bool_]
) -> FloatArray:
    """Speed (m,) along the vehicle's x axis at the knots, 0 at a stand."""
    dt = np.diff(t_s)
    step = np.diff(xyz_m[:, :2], axis=0) / dt[:, None]
    middle = 0.5 * (yaw_rad[1:] + yaw_rad[:-1])
    along = np.where(gap, np.nan, step[:, 0] * np.cos(middle) + step[:, 1] * np.sin(middle))
    both = np.column_stack([np.append(np.nan, along), np.append(along, np.nan)])
    known = np.isfinite(both)
    count = known.sum(axis=1)
    speed = np.where(count > 0, np.where(known, both, 0.0).sum(axis=1) / np.maximum(count, 1), np.nan)
    return np.where(motion == Motion.STANDING, 0.0, speed)


def _with_tilt(sigma: FloatArray, lever_m: tuple[float, float, float]) -> FloatArray:
    """Sigmas (m, 6) of a level vehicle's pose from those (m, 4) of e, n, h, yaw: the lever arm turns with its tilt."""
    tilt = np.radians(TILT_SIGMA_DEG)
    out = np.empty((len(sigma), 6))
    out[:, :2] = np.hypot(sigma[:, :2], tilt * lever_m[2])
    out[:, 2] = np.hypot(sigma[:, 2], tilt * np.hypot(lever_m[0], lever_m[1]))
    out[:, 3:5] = TILT_SIGMA_DEG
    out[:, 5] = np.degrees(sigma[:, 3])
    return out


def with_vague_headings(sigma: FloatArray, lever_m: FloatArray) -> FloatArray:
    """Standard deviations (n, 6), of headings beyond VAGUE_DEG as of any heading, with those of the places they turn.

    Args:
        sigma: (n, 6) in the order of :data:`~furrowmap.core.values.trajectory.SIGMA_NAMES`.
        lever_m: (3,) the antenna in the vehicle frame, about which the vehicle's origin turns.
    """
    vague = sigma[:, 5] > VAGUE_DEG
    if not vague.any():
        return sigma
    out = arrays.copied(sigma)
    out[vague, 5] = np.maximum(sigma[vague, 5], ANY_DEG)
    out[vague, :2] = np.hypot(sigma[vague, :2], np.hypot(lever_m[0], lever_m[1]))
    return out
