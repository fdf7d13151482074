"""Scan matching: returns and positions in, the adjusted trajectory with figures and notices out."""

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter1d, uniform_filter1d
from scipy.spatial.transform import Rotation

from furrowmap.core.adjustment.covariance import Considered, pose_sigmas, quick_variances, slow_covariance
from furrowmap.core.adjustment.imu_aiding import AIDED, GYRO_SCALE, MISALIGNMENT, Aid
from furrowmap.core.adjustment.knots import KNOT_STEP_S, Knots, State, StateBlock
from furrowmap.core.adjustment.preintegration import RATE_BIAS
from furrowmap.core.adjustment.vehicle import LEVEL_SIGMA
from furrowmap.core.matching.bridging import held_by_positions
from furrowmap.core.matching.clock_offset import ClockCandidate, search_clock_offset
from furrowmap.core.matching.consistency import LEVEL_GROUND, GroundTilt, Seen, check_consistency
from furrowmap.core.matching.ground_registration import CORRELATED
from furrowmap.core.matching.laser_ranges import range_bow, range_bow_sigma
from furrowmap.core.matching.mounting_calibration import MountingCalibration
from furrowmap.core.matching.placing import Tool
from furrowmap.core.matching.problem import Adjusted, Iterate, Linearised, Problem
from furrowmap.core.matching.returns import PIXEL_M, GroundReturns
from furrowmap.core.matching.schedule import resolve_yaw_ambiguity
from furrowmap.core.matching.yaw_ambiguity import Facing
from furrowmap.core.runtime import arrays
from furrowmap.core.runtime.arrays import FloatArray
from furrowmap.core.runtime.errors import Notice
from furrowmap.core.trajectory.from_gnss import with_vague_headings
from furrowmap.core.trajectory.used_positions import WHITE_SHARE
from furrowmap.core.trajectory.vehicle_motion import HYSTERESIS, STANDING_MPS
from furrowmap.core.values.clock import iso_utc
from furrowmap.core.values.gnss import Fix, Positions
from furrowmap.core.values.margins import margin
from furrowmap.core.values.rotation import Mounting
from furrowmap.core.values.scan import LaserRanges
from furrowmap.core.values.time_span import Span
from furrowmap.core.values.trajectory import Motion, Trajectory, same_hemisphere

MIN_MATCH_RETURNS: Final = 20_000
"""With fewer returns of the ground in the whole recording there is nothing to match."""
MIN_MATCH_SCAN_RETURNS: Final = 300.0
"""The same on the mean of the scans: what little a standing crop lets through is not only ground."""
CONSTANT_HEIGHT_SHARE: Final = 0.7
"""Share of the drift of GNSS heights that is constant for a whole session (troposphere, the antenna's own offset)."""
FIX_REACH_S: Final = 0.5
SPEED_OVER_S: Final = 0.4
AROUND_S: Final = 0.5
"""Time to either side over which the returns' information is summed."""
SCANNED_S: Final = 0.05
"""Half a scan, in which there may be no returns of the ground; beyond it a turning vehicle's heading is another one."""
PLACED_M: Final = 0.05
"""Without GNSS, returns that determine the place less well leave it to wheels and motion prior."""
HEIGHT_REPORTED_M: Final = 0.05
FACING_ASSUMED: Final = Notice("facing-assumed")
LEVER_ASSUMED: Final = Notice("lever-assumed")
OF_MOUNTING: Final = "mounting-"
"""Begin of the codes of notices about the mounting."""


@dataclass(frozen=True)
class Matched:
    """The result of scan matching.

    Attributes:
        mounting: of the sensor: the session's, unless matching shows that it is off.
        ranges: the lasers' constants; None where the ground does not show them.
        calibration: how the vehicle stands on the ground with that mounting.
        facing_shown: whether the scans show which way the sensor faces; else the stated yaw is assumed.
        seen: whether positions, scans and wheels agree.
        clock_used_s: time by which the scanner's clock is ahead beyond what the session states, and which is used.
    """

    trajectory: Trajectory
    mounting: Mounting
    ranges: LaserRanges | None
    calibration: MountingCalibration
    facing_shown: bool
    seen: Seen
    figures: dict[str, Any]
    notices: tuple[Notice, ...]
    clock_used_s: float = 0.0


@dataclass(frozen=True)
class Prepared:
    """What is known before the adjustment.

    Attributes:
        first: iterate, with the yaw ambiguity of the mounting resolved.
        clock: offset of the clocks with which the scans agree better; None where the stated one is as good as any.
        ground: how it lies in the vehicle frame.
        unheld: times whose scans no positions hold, so that they take no part.
    """

    problem: Problem
    first: Iterate
    start: Trajectory
    clock: ClockCandidate | None
    ground: GroundTilt
    unheld: tuple[Span, ...] = ()


def prepare(
    returns: GroundReturns,
    start: Trajectory,
    positions: Positions,
    lever_m: tuple[float, float, float],
    mounting: Mounting,
    tool: Tool | None,
    ground: GroundTilt = LEVEL_GROUND,
    aid: Aid | None = None,
) -> Prepared | None:
    """The input of the adjustment; None where there is too little ground in the scans, or no position in their time.

    Args:
        returns: of the ground.
        start: first guess of the vehicle frame's trajectory.
        lever_m: the antenna in the vehicle frame; zero where that is not known.
        mounting: of the sensor, as the session states it.
        tool: where an implement changes the soil; None if none is known.
        ground: how it lies in the vehicle frame.
        aid: what an IMU adds; None without one.
    """
    unheld: tuple[Span, ...] = ()
    if aid is None:
        returns, unheld = held_by_positions(returns, positions.t_s, start)
    # Halves alternate from one scan to the next.
    scans = 1 + int(np.count_nonzero(np.diff(np.asarray(returns.half, np.int8))))
    if len(returns) < max(MIN_MATCH_RETURNS, MIN_MATCH_SCAN_RETURNS * scans):
        return None
    problem = Problem.from_session(returns, start, positions, lever_m, mounting, tool, aid)
    if not problem.knots.at(positions.t_s)[2].any():
        return None
    first = resolve_yaw_ambiguity(problem, Iterate.first(problem))
    return Prepared(problem, first, start, search_clock_offset(returns, first.sensor, start), ground, unheld)


def matched_by(prepared: Prepared, adjusted: Adjusted) -> Matched:
    """The result of the adjustment, with its figures and notices."""
    mounting = prepared.problem.mounting
    turn = adjusted.sensor.turn
    turned = not np.array_equal(turn, np.eye(3))
    used = Mounting.from_rotation(mounting.xyz_m, turn @ mounting.rotation) if turned else mounting
    seen = check_consistency(adjusted, prepared.ground)
    return Matched(
        _trajectory(adjusted, prepared.start),
        used,
        adjusted.sensor.ranges,
        adjusted.calibration,
        adjusted.facing.shown,
        seen,
        match_figures(adjusted, used),
        match_notices(adjusted, used, prepared.unheld),
    )


def _trajectory(adjusted: Adjusted, start: Trajectory) -> Trajectory:
    """The adjusted trajectory; what determined the headings before matching is that of the first guess."""
    problem = adjusted.problem
    state = adjusted.state
    knots = adjusted.problem.knots
    last = adjusted.last
    ground = adjusted.ground.slices.normal
    walls = adjusted.walls.observation.sums.normal
    bow_sigma = range_bow_sigma(problem.returns, problem.sensor_m, problem.sensor_axis)
    sigma = sigmas(state, last, range_bow(bow_sigma, last.prior, last.centre_m), ground, walls)
    # Positions scatter by the sway as well, which matching removes: it may have passed for white noise.
    white = problem.positions.white_m[:, :2]
    drift = problem.positions.drift_m[:, :2]
    sway_m2 = np.median(np.maximum(white**2 - (WHITE_SHARE * np.hypot(white, drift)) ** 2, 0.0))
    sigma[:, :2] = np.hypot(sigma[:, :2], np.sqrt(sway_m2))
    sigma[:, 2] = np.hypot(sigma[:, 2], CONSTANT_HEIGHT_SHARE * np.median(problem.positions.drift_m[:, 2]))
    sigma[:, 3:] = np.hypot(sigma[:, 3:], adjusted.calibration.left_deg)
    if not adjusted.facing.shown:
        sigma = as_by_positions(sigma, knots.t_s, start, problem.lever_m)
    sigma = with_vague_headings(sigma, problem.lever_m)
    speed = _speed(knots, state)
    standing = np.abs(speed) < STANDING_MPS * HYSTERESIS
    motion = np.where(standing, Motion.STANDING, np.sign(speed)).astype(np.int8)
    nearest = _nearest(problem.positions.t_s, knots.t_s)
    apart_s = np.abs(problem.positions.t_s[nearest] - knots.t_s)
    near = apart_s <= max(FIX_REACH_S, float(np.median(np.diff(problem.positions.t_s))))
    fix = np.where(near, problem.positions.fix[nearest], Fix.NONE).astype(np.int8)

    def before_matching(part: slice) -> list[NDArray[Any]]:
        quaternion = Rotation.from_matrix(state.rotation[part]).as_quat(scalar_first=True)
        before = np.where(standing[part], "standing", start.heading_from[_nearest(start.t_s, knots.t_s[part])])
        return [quaternion, state.xyz_m[part] + problem.origin_m, before]

    quaternion, xyz, before = arrays.in_parts(before_matching, len(knots))
    before_deg = np.interp(knots.t_s, start.t_s, start.sigma[:, 5])
    sources = sources_of(ground, walls, before_deg, before, fix != Fix.NONE)
    if not adjusted.facing.shown:
        np.copyto(sources.heading, before, where=sources.heading == "relief")
    return Trajectory(
        t_s=knots.t_s,
        xyz_m=xyz,
        quaternion=same_hemisphere(quaternion),
        speed_mps=np.where(standing, 0.0, speed),
        motion=motion,
        fix=fix,
        sigma=sigma,
        heading_from=sources.heading,
        position_from=sources.position,
        height_from=sources.height,
        level_from=sources.level,
        max_gap_s=1.5 * KNOT_STEP_S,
    )


def as_by_positions(sigma: FloatArray, t_s: FloatArray, start: Trajectory, lever_m: FloatArray) -> FloatArray:
    """Standard deviations (n, 6) with headings no better than positions alone show them.

    Where scans do not show which way the scanner faces, what they say of headings is as likely a pattern that moves
    with the vehicle (rings of lasers, or of grass seen from afar) as relief. The vehicle's origin turns about the
    antenna with the heading.

    Args:
        sigma: (n, 6) as matched.
        t_s: (n,) times.
        start: trajectory by positions alone.
        lever_m: (3,) of the antenna.
    """
    out = arrays.copied(sigma)
    known = np.isfinite(start.sigma[:, 5])
    if known.any():
        out[:, 5] = np.maximum(sigma[:, 5], np.interp(t_s, start.t_s[known], start.sigma[known, 5]))
    more = np.radians(np.sqrt(out[:, 5] ** 2 - sigma[:, 5] ** 2)) * np.hypot(lever_m[0], lever_m[1]) / np.sqrt(2.0)
    out[:, :2] = np.hypot(sigma[:, :2], more[:, None])
    return out


def _speed(knots: Knots, state: State) -> FloatArray:
    """Speed (n,) along the vehicle's x axis, over a short time to either side."""
    out = np.empty(len(knots))
    width = max(1, round(SPEED_OVER_S / KNOT_STEP_S))
    for chain in knots.chains:
        part = slice(chain.first, chain.first + chain.count)
        velocity = np.gradient(state.xyz_m[part], KNOT_STEP_S, axis=0)
        along = np.einsum("ij,ij->i", velocity, state.rotation[part, :, 0])
        out[part] = uniform_filter1d(along, width, mode="nearest")
    return out


def _nearest(known_s: FloatArray, t_s: FloatArray) -> NDArray[np.intp]:
    """Indices (n,) of the nearest of the times known, which increase."""
    after = np.clip(np.searchsorted(known_s, t_s), 1, len(known_s) - 1)
    return np.where(t_s - known_s[after - 1] < known_s[after] - t_s, after - 1, after)


def sigmas(state: State, last: Linearised, considered: Considered, *normals: FloatArray) -> FloatArray:
    """Standard deviations (n, 6) of easting, northing, height (m), roll, pitch, heading (degrees) at the knots.

    What is slow comes from the equations with free references, what is quick from those with fixed ones; their
    covariances are added. Errors that neighbouring returns share lift and tilt a scan but do not turn it, because
    relief slopes to all sides: the part of a heading's quick variance that returns determine is that of independent
    returns.

    Args:
        considered: bow of the scanner's ranges.
        normals: (n, 21) normal matrices of the returns between knots, of each kind of returns.
    """
    with ThreadPoolExecutor(1) as pool:
        beside = pool.submit(quick_variances, last.held, state.layout.size)
        slow = slow_covariance(last.covariance, considered)
        quick = beside.result()
    seen = np.zeros(len(normals[0]), np.uint8)
    for one in normals:
        seen |= one[:, 0] > 0.0
    scanned = maximum_filter1d(seen, 2 * round(SCANNED_S / KNOT_STEP_S) + 1) > 0
    by_returns = np.minimum(information_of(*normals).heading * quick[:, 5], 1.0) * scanned
    quick[:, 5] *= 1.0 - by_returns * (1.0 - 1.0 / CORRELATED)
    return pose_sigmas(state, last.coarse, last.centre_m, slow, quick)


@dataclass(frozen=True)
class Information:
    """Information of the returns about the poses, within AROUND_S to either side.

    Attributes:
        heading: (n,) information (1 / rad²) about the heading, the other five unknowns eliminated.
        place: (n,) information (1 / m²) about the place where there is least of it, the other unknowns eliminated.
        level: (n,) whether roll and pitch are determined.
    """

    heading: FloatArray
    place: FloatArray
    level: NDArray[np.bool_]


def information_of(*normals: FloatArray) -> Information:
    """The information in the sum of normal matrices (n, 21) of the slices between knots; zero where there are none."""
    n = len(normals[0])
    half = round(AROUND_S / KNOT_STEP_S)
    out = Information(np.zeros(n), np.zeros(n), np.zeros(n, np.bool_))
    row, column = np.triu_indices(6)
    for part in arrays.parts(n):
        around = slice(max(0, part.start - half), part.stop + half)
        normal = np.sum([one[around] for one in normals], axis=0)
        before = half - (part.start - around.start)
        after = half - (min(n, around.stop) - part.stop)
        total = np.cumsum(np.pad(normal, ((before + 1, after), (0, 0))), axis=0)
        near = total[2 * half + 1 :] - total[: -2 * half - 1]
        square = np.zeros((len(near), 6, 6))
        square[:, row, column] = square[:, column, row] = near
        known = square[:, 2, 2] > 0
        if not known.any():
            continue
        m = square[known]
        m += np.eye(6) * (1e-9 * m[:, 2, 2])[:, None, None]
        out.heading[part][known] = _reduced(m, [5])[:, 0, 0]
        out.place[part][known] = np.linalg.eigvalsh(_reduced(m, [0, 1]))[:, 0]
        out.level[part][known] = np.linalg.eigvalsh(_reduced(m, [3, 4]))[:, 0] > 1.0 / LEVEL_SIGMA**2
    return out


def _reduced(normal: FloatArray, kept: list[int]) -> FloatArray:
    """Normal matrices (n, 6, 6) of the unknowns kept, the others eliminated (Schur complement)."""
    others = [i for i in range(6) if i not in kept]
    link = normal[:, kept][:, :, others]
    rest = np.linalg.solve(normal[:, others][:, :, others], link.transpose(0, 2, 1))
    left: FloatArray = normal[:, kept][:, :, kept] - link @ rest
    return left


@dataclass(frozen=True)
class Sources:
    """The observations that determine each knot's unknowns most firmly.

    Attributes:
        heading: (n,) labels, as in :class:`~furrowmap.core.values.trajectory.Trajectory`.
        position: (n,) the same.
        height: (n,) the same.
        level: (n,) the same, of roll and pitch.
    """

    heading: NDArray[np.str_]
    position: NDArray[np.str_]
    height: NDArray[np.str_]
    level: NDArray[np.str_]


def sources_of(
    ground: FloatArray,
    walls: FloatArray,
    heading_sigma_deg: FloatArray,
    heading_label: NDArray[np.str_],
    has_position: NDArray[np.bool_],
) -> Sources:
    """For each unknown the observation with the most information about it.

    Args:
        ground: (n, 21) normal matrices of the ground's returns between knots.
        walls: (n, 21) of those of the walls.
        heading_sigma_deg: (n,) of the headings before matching.
        heading_label: (n,) what determined them.
        has_position: (n,) whether GNSS gave a position at the time.
    """
    relief, both = information_of(ground), information_of(ground, walls)
    by_walls = both.heading - relief.heading > relief.heading
    firmer = np.maximum(both.heading - relief.heading, relief.heading) > 1.0 / np.radians(heading_sigma_deg) ** 2
    placed = both.place > 1.0 / PLACED_M**2
    placed_by_walls = both.place - relief.place > relief.place

    def firmest(p: slice) -> list[NDArray[np.str_]]:
        scans = np.where(by_walls[p], "walls", "relief")
        placing = np.where(placed[p], np.where(placed_by_walls[p], "walls", "relief"), "carried")
        height = np.where(has_position[p], "gnss", np.where(relief.level[p], "ground", "carried"))
        return [
            np.where(firmer[p], scans, heading_label[p]),
            np.where(has_position[p], "gnss", placing),
            height,
            np.where(relief.level[p], "ground", "assumed"),
        ]

    return Sources(*arrays.in_parts(firmest, len(firmer)))


def match_notices(adjusted: Adjusted, used: Mounting, unheld: Sequence[Span] = ()) -> tuple[Notice, ...]:
    """Scans left out, unbridged gaps, a mounting that is off, and what is assumed.

    Args:
        adjusted: the result.
        used: the mounting in use.
        unheld: times whose scans no positions hold.
    """
    assumed = adjusted.problem.lever_m.any() and not adjusted.facing.shown and not adjusted.sway.known
    lever = [LEVER_ASSUMED] if assumed else []
    stated = adjusted.problem.mounting
    mounting = mounting_notices(adjusted.calibration, adjusted.facing, stated, used)
    unbridged = adjusted.unbridged
    gaps = [Notice("gap-not-bridged", begin=iso_utc(g.begin_s), end_s=g.end_s - g.begin_s) for g in unbridged]
    found = adjusted.slow_errors
    unchecked = not (found.checked or adjusted.sway.off) and found.times == (1.0, 1.0)
    slow = [slow_errors_unchecked(adjusted.problem.positions)] if unchecked else []
    return (*adjusted.problem.notices, *unheld_notices(unheld), *gaps, *mounting, *lever, *slow)


def slow_errors_unchecked(positions: Positions) -> Notice:
    """The notice that nothing shows slow errors of the positions, and which are assumed."""
    return Notice("slow-errors-assumed", margin=margin(float(np.median(positions.drift_m[:, 0])), " m"))


def unheld_notices(unheld: Sequence[Span]) -> list[Notice]:
    """Scans that no positions hold, at times in order; none where there are no such."""
    if not unheld:
        return []
    total_s = sum(end_s - begin_s for begin_s, end_s in unheld)
    return [Notice("scans-not-held", total_s=total_s, unheld=iso_utc(unheld[0][0]))]


def mounting_notices(found: MountingCalibration, facing: Facing, stated: Mounting, used: Mounting) -> list[Notice]:
    """A mounting that is off, as the scans show it; `used` is the one in use."""
    notices = []
    was, now = (", ".join(f"{angle:.2f}" for angle in m.rpy_deg) for m in (stated, used))
    if facing.offset_deg:
        notices.append(Notice("mounting-off", was=was, now=now))
    elif used is not stated:
        notices.append(Notice("mounting-off.level-ground", was=was, now=now))
    if not facing.shown:
        notices.append(FACING_ASSUMED)
    if height_is_off(found):
        notices.append(Notice("mounting-height", height_m=found.height_m))
    return notices


def height_is_off(found: MountingCalibration) -> bool:
    """Whether the vehicle's origin certainly is not on the ground under its wheels."""
    return abs(found.height_m) > HEIGHT_REPORTED_M + 3.0 * found.sigma_height_m


def match_figures(adjusted: Adjusted, used: Mounting) -> dict[str, Any]:
    """The figures of matching in the report, with the mounting in use."""
    returns = adjusted.problem.returns
    walls = adjusted.walls.scatter
    ranges = adjusted.sensor.ranges
    constants = adjusted.constants
    matched, squares = adjusted.ground.tally[4:]
    return {
        "residual_rms_m": round(float(np.sqrt(squares / max(matched, 1.0))), 4),
        "returns": len(returns),
        "returns_matched": int(matched),
        "walls": {
            "returns": len(returns.upright),
            "returns_matched": int(walls.matched),
            "residual_rms_m": round(float(np.sqrt(walls.squares / walls.matched)), 4) if walls.matched else None,
            "correlated": round(walls.correlated, 1) if walls.matched else None,
        },
        "relief_slope_rms": round(float(np.sqrt(adjusted.relief.variance)), 4),
        "body_footprint_m2": round(float(returns.body.sum()) * PIXEL_M**2, 2),
        "facing_shown": adjusted.facing.shown,
        "mounting_rpy_deg": [round(angle, 3) for angle in used.rpy_deg],
        # By how much each laser's ranges are too long, by its number from the lowest.
        "laser_ranges_m": None
        if ranges is None
        else {
            str(k): [round(float(ranges.offset_m[k]), 5), round(float(ranges.sigma_m[k]), 5)]
            for k in np.flatnonzero(np.isfinite(ranges.sigma_m)).tolist()
        },
        "stance": _stance_figures(adjusted.calibration),
        "positions_doubted": int((adjusted.antenna.weight < 1.0).sum()),
        # What is to be added to the lever arm, forward and to the left.
        "lever_arm_m": {
            axis: [round(value, 4), round(sigma, 4)]
            for axis, value, sigma in zip("xy", constants.lever_m, constants.lever_sigma_m, strict=True)
        }
        if np.isfinite(constants.lever_sigma_m).all()
        else None,
        "imu": _imu_figures(adjusted),
    }


def _imu_figures(adjusted: Adjusted) -> dict[str, Any] | None:
    """Of the IMU, each with its standard deviation against fixed ground; null without one."""
    state = adjusted.state
    if state.layout != AIDED:
        return None
    sigma = adjusted.last.held.solve().sigma().reshape(len(state.xyz_m), -1).min(axis=0)

    def of(block: StateBlock, factor: float) -> list[list[float]]:
        first = state.layout.column(block)
        spread = factor * sigma[first : first + block.size]
        pairs: list[list[float]] = np.column_stack([factor * state[block].mean(axis=0), spread]).round(5).tolist()
        return pairs

    return {
        "rate_bias_dps": of(RATE_BIAS, np.degrees(1.0)),
        "misalignment_deg": of(MISALIGNMENT, np.degrees(1.0)),
        "gyro_scale": of(GYRO_SCALE, 1.0)[0],
    }


def _stance_figures(found: MountingCalibration) -> dict[str, Any] | None:
    """How the vehicle stands on its ground; null where the scans do not show it."""
    if not np.isfinite(found.sigma_deg[0]):
        return None
    roll, pitch, yaw = found.sigma_deg
    return {
        "roll_deg": [round(found.roll_deg, 3), round(roll, 3)],
        "pitch_deg": [round(found.pitch_deg, 3), round(pitch, 3)],
        "yaw_deg": [round(found.yaw_deg, 3), round(yaw, 3) if np.isfinite(yaw) else None],
        "height_m": [round(found.height_m, 3), round(found.sigma_height_m, 3)],
    }
