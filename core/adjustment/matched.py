"""Scan matching from outside: scans and positions in, a better trajectory and what there is to say about it out."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import uniform_filter1d
from scipy.spatial.transform import Rotation

from furrowmap.core.adjustment.certainty import held_by, sigmas
from furrowmap.core.adjustment.solve import Problem, Tool, problem_of, solve
from furrowmap.core.calibration.clock_offset import clock_offset
from furrowmap.core.calibration.laser_ranges import LaserRanges
from furrowmap.core.calibration.mounting_calibration import Stance
from furrowmap.core.calibration.range_bow import bow_of, bow_sigma
from furrowmap.core.estimation.knots import STEP_S
from furrowmap.core.matching.returns import PIXEL_M, GroundReturns
from furrowmap.core.trajectory.motion import HYSTERESIS, STANDING_MPS
from furrowmap.core.trajectory.positions import WHITE_SHARE, Positions
from furrowmap.core.values.clock import iso_utc
from furrowmap.core.values.errors import Notice
from furrowmap.core.values.gnss import Fix
from furrowmap.core.values.mounting import Mounting
from furrowmap.core.values.trajectory import Motion, Trajectory, same_hemisphere

FloatArray = NDArray[np.float64]

LEAST_RETURNS: Final = 20_000
"""With fewer returns of the ground in the whole recording there is nothing to match."""
HEIGHT_TOLD_M: Final = 0.05
CLOCK_CERTAIN: Final = 4.0
CLOCK_TOLD_S: Final = 0.01
HEIGHT_STAYS: Final = 0.7
"""Of the slow error of GNSS heights, what stays for a whole session (troposphere, the antenna's own offset)."""
FIX_REACH_S: Final = 0.5
SPEED_OVER_S: Final = 0.4


@dataclass(frozen=True)
class Matched:
    """What matching made of a recording.

    Attributes:
        trajectory: of the vehicle frame.
        mounting: of the sensor: the session's, unless the vehicle's stance shows that it is off.
        ranges: the lasers' constants, which its trajectory goes with; None where the ground does not show them.
        stance: how the vehicle stands on the ground with that mounting.
        clock_offset_s: what the scanner's clock seems ahead of the receiver's, and its standard deviation, which is inf
            where the antenna's place is not known.
        figures: for the report.
        notices: for the report.
    """

    trajectory: Trajectory
    mounting: Mounting
    ranges: LaserRanges | None
    stance: Stance
    clock_offset_s: tuple[float, float]
    figures: dict[str, Any]
    notices: tuple[Notice, ...]


def match(
    returns: GroundReturns,
    start: Trajectory,
    positions: Positions,
    lever_m: tuple[float, float, float],
    mounting: Mounting,
    tool: Tool | None,
    progress: Callable[[float], None],
) -> Matched | None:
    """The trajectory that makes the ground agree with itself, held in place by the positions.

    Args:
        returns: of the ground.
        start: an approximate trajectory of the vehicle frame.
        positions: of the antenna.
        lever_m: the antenna in the vehicle frame; zero where that is not known.
        mounting: of the sensor, as the session states it.
        tool: where an implement changes the soil; None if none is known.
        progress: is told how much is done, 0 to 1.

    Returns:
        None where there is too little ground in the scans, or no position in their time.

    Raises:
        LinAlgError: if positions and ground leave a part of the trajectory without any hold.
    """
    if len(returns) < LEAST_RETURNS:
        return None
    problem = problem_of(returns, start, positions, lever_m, mounting, tool)
    if not problem.knots.at(positions.t_s)[2].any():
        return None
    solve(problem, progress)
    trajectory = _trajectory(problem, start)
    right = Mounting.from_rotation(mounting.xyz_m, problem.mounting_turn @ mounting.rotation)
    turned = not np.array_equal(problem.mounting_turn, np.eye(3))
    used = right if turned else mounting
    assert problem.stance is not None
    # An antenna ahead of where it is taken to be looks like a clock that is off; none stands at the vehicle's origin.
    clock = (0.0, float("inf"))
    if any(lever_m):
        clock = clock_offset(problem.knots, problem.state, problem.positions, problem.origin_m, problem.lever_m)
    figures = _figures(problem, used) | {"clock_offset_s": [round(v, 4) if np.isfinite(v) else None for v in clock]}
    notices = [*_gap_notices(problem), *_mounting_notices(problem, mounting, used), *_clock_notices(*clock)]
    return Matched(trajectory, used, problem.ranges, problem.stance, clock, figures, tuple(notices))


def _gap_notices(problem: Problem) -> list[Notice]:
    """Times without positions across which the scans did not carry the poses."""
    return [
        Notice(
            "gap-not-bridged",
            f"From {iso_utc(gap.begin_s)} there are no positions for {gap.end_s - gap.begin_s:.0f} s, and what the "
            "scans carry on from before and back from after does not meet: poses between are held by inertia alone, "
            "and their standard deviations say so.",
        )
        for gap in problem.withheld
    ]


def _clock_notices(offset_s: float, sigma_s: float) -> list[Notice]:
    """What the ground, seen on the way there and back, says about the clocks."""
    if abs(offset_s) <= max(CLOCK_CERTAIN * sigma_s, CLOCK_TOLD_S):
        return []
    return [
        Notice(
            "clock-offset",
            f"The scanner's clock seems {'ahead of' if offset_s > 0 else 'behind'} the receiver's by at least "
            f"{abs(offset_s):.2f} s more than the session says (± {sigma_s:.2f} s): `furrowmap calibrate` finds the "
            "whole of it.",
        )
    ]


def _mounting_notices(problem: Problem, stated: Mounting, used: Mounting) -> list[Notice]:
    """What the ground and the vehicle's stance say about the mounting."""
    stance, notices = problem.stance, []
    assert stance is not None
    was, now = (", ".join(f"{angle:.2f}" for angle in m.rpy_deg) for m in (stated, used))
    if problem.faces_deg:
        notices.append(
            Notice(
                "mounting-off",
                f"The session has the scanner at rpy_deg = [{was}], but what it sees of the ground stays where it is "
                f"with [{now}], which is used: it faces another way, or the vehicle drove in reverse all the time. "
                "`furrowmap calibrate` writes it into the session.",
            )
        )
    elif used is not stated:
        notices.append(
            Notice(
                "mounting-off",
                f"The session has the scanner at rpy_deg = [{was}], but the ground under the vehicle is level and the "
                f"drive straight ahead with [{now}], which is used. `furrowmap calibrate` writes it into the session.",
            )
        )
    if abs(stance.height_m) > HEIGHT_TOLD_M + 3.0 * stance.sigma_height_m:
        notices.append(
            Notice(
                "mounting-height",
                f"The vehicle's origin comes out {stance.height_m:+.2f} m above the ground it stands on: the scanner's "
                "height in [lidar] xyz_m is off by that much. Nothing is changed for it.",
            )
        )
    return notices


def _trajectory(problem: Problem, start: Trajectory) -> Trajectory:
    assert problem.sums is not None
    assert problem.walls is not None
    assert problem.last is not None
    state, knots, last = problem.state, problem.knots, problem.last
    bent = bow_sigma(problem.returns, problem.sensor_m, problem.sensor_axis)
    bow = bow_of(bent, last.blind, last.centre_m)
    seen = problem.sums.normal + problem.walls.sums.normal
    sigma = sigmas(state, last.held, last.coarse, last.centre_m, last.together, bow, seen)
    sigma[:, :2] = np.hypot(sigma[:, :2], _taken_for_white_m(problem.positions))
    sigma[:, 2] = np.hypot(sigma[:, 2], HEIGHT_STAYS * np.median(problem.positions.drift_m[:, 2]))
    speed = _speed(problem)
    standing = np.abs(speed) < STANDING_MPS * HYSTERESIS
    motion = np.where(standing, Motion.STANDING, np.sign(speed)).astype(np.int8)
    quaternion = Rotation.from_matrix(state.rotation).as_quat(scalar_first=True)
    fix = _fix(problem.positions, knots.t_s)
    held = held_by(
        problem.sums.normal,
        problem.walls.sums.normal,
        np.interp(knots.t_s, start.t_s, start.sigma[:, 5]),
        np.where(motion == Motion.STANDING, "standing", start.heading_from[_nearest(start.t_s, knots.t_s)]),
        fix != Fix.NONE,
    )
    return Trajectory(
        t_s=knots.t_s,
        xyz_m=state.xyz_m + problem.origin_m,
        quaternion=same_hemisphere(quaternion),
        speed_mps=np.where(standing, 0.0, speed),
        motion=motion,
        fix=fix,
        sigma=sigma,
        heading_from=held.heading,
        position_from=held.position,
        height_from=held.height,
        level_from=held.level,
        max_gap_s=1.5 * STEP_S,
    )


def _taken_for_white_m(positions: Positions) -> float:
    """Of the receiver's horizontal error, what the antenna's sway may have passed off as noise of each position.

    On rough ground positions scatter by the sway as well, which matching takes out by roll and pitch. What scatters by
    more than a receiver's own noise is then not known to be gone from its slow error.
    """
    white, drift = positions.white_m[:, :2], positions.drift_m[:, :2]
    receivers = WHITE_SHARE * np.hypot(white, drift)
    return float(np.sqrt(np.median(np.maximum(white**2 - receivers**2, 0.0))))


def _speed(problem: Problem) -> FloatArray:
    """Speed (n,) along the vehicle's x axis, over a short time to either side."""
    out = np.empty(len(problem.knots))
    width = max(1, round(SPEED_OVER_S / STEP_S))
    for chain in problem.knots.chains:
        part = slice(chain.first, chain.first + chain.count)
        velocity = np.gradient(problem.state.xyz_m[part], STEP_S, axis=0)
        along = np.einsum("ij,ij->i", velocity, problem.state.rotation[part, :, 0])
        out[part] = uniform_filter1d(along, width, mode="nearest")
    return out


def _fix(positions: Positions, t_s: FloatArray) -> NDArray[np.int8]:
    """The quality of the nearest position (n,); none where there is none near."""
    nearest = _nearest(positions.t_s, t_s)
    near = np.abs(positions.t_s[nearest] - t_s) <= max(FIX_REACH_S, float(np.median(np.diff(positions.t_s))))
    return np.where(near, positions.fix[nearest], Fix.NONE).astype(np.int8)


def _nearest(known_s: FloatArray, t_s: FloatArray) -> NDArray[np.intp]:
    """Indices (n,) of the nearest of the times known, which increase."""
    after = np.clip(np.searchsorted(known_s, t_s), 1, len(known_s) - 1)
    return np.where(t_s - known_s[after - 1] < known_s[after] - t_s, after - 1, after)


def _figures(problem: Problem, mounting: Mounting) -> dict[str, Any]:
    """What the report tells about matching."""
    assert problem.sums is not None
    assert problem.walls is not None
    tally, walls = problem.sums.tally, problem.walls.scatter
    return {
        "residual_rms_m": round(float(np.sqrt(tally[6] / max(tally[5], 1.0))), 4),
        "returns": len(problem.returns),
        "returns_matched": int(tally[5]),
        "walls": {
            "returns": len(problem.returns.upright),
            "returns_matched": int(walls.matched),
            "residual_rms_m": round(float(np.sqrt(walls.squares / walls.matched)), 4) if walls.matched else None,
            "correlated": round(walls.correlated, 1) if walls.matched else None,
        },
        "relief_slope_rms": round(float(np.sqrt(problem.relief.variance)), 4),
        "body_footprint_m2": round(float(problem.returns.body.sum()) * PIXEL_M**2, 2),
        "mounting_rpy_deg": [round(angle, 3) for angle in mounting.rpy_deg],
        "laser_ranges_m": _range_figures(problem.ranges),
        "stance": _stance_figures(problem.stance),
        "positions_doubted": int((problem.position_trust < 1.0).sum()),
    }


def _range_figures(ranges: LaserRanges | None) -> dict[str, list[float]] | None:
    """By how much each laser's ranges are too long, and its standard deviation, by its number from the lowest."""
    if ranges is None:
        return None
    seen = np.flatnonzero(np.isfinite(ranges.sigma_m)).tolist()
    return {str(k): [round(float(ranges.offset_m[k]), 5), round(float(ranges.sigma_m[k]), 5)] for k in seen}


def _stance_figures(stance: Stance | None) -> dict[str, Any] | None:
    """How the vehicle stands on its ground, null where the scans do not show it."""
    if stance is None or not np.isfinite(stance.sigma_deg[0]):
        return None
    roll, pitch, yaw = stance.sigma_deg
    return {
        "roll_deg": [round(stance.roll_deg, 3), round(roll, 3)],
        "pitch_deg": [round(stance.pitch_deg, 3), round(pitch, 3)],
        "yaw_deg": [round(stance.yaw_deg, 3), round(yaw, 3) if np.isfinite(yaw) else None],
        "height_m": [round(stance.height_m, 3), round(stance.sigma_height_m, 3)],
    }
