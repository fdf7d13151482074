"""A drive in one direction: the path that scans show, and what a filter makes of it and of positions.

Each scan is matched to the ground of the last metres, which shows how the vehicle turns, leans and climbs, in reverse
and without positions too. The filter estimates place and speed, and by how much the sum of the turns is off: positions
show the heading, and on a way with turns what is level.
"""

from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from scipy.spatial.transform import Rotation

from furrowmap.core.live.scan_path import KEPT_S, UNSEEN_TURN_RADPS, PathPoint, ScanPath
from furrowmap.core.matching.recent_ground import Added, RecentGround, ScanTurn
from furrowmap.core.runtime.arrays import FloatArray
from furrowmap.core.trajectory.drive_filter import BRAKES_MPS2, JUMP_SQUARES, DriveFilter, ScannedWay
from furrowmap.core.trajectory.from_gnss import TILT_SIGMA_DEG
from furrowmap.core.trajectory.vehicle_motion import STANDING_MPS
from furrowmap.core.values.gnss import Fix, Positions
from furrowmap.core.values.rotation import quaternion_to_attitude
from furrowmap.core.values.scan import Scan

MAX_CARRIED_S: Final = 0.5
MISSED_STEPS: Final = 1.6
"""Longer after the last position, in seconds and in steps between positions, a pose is a guess."""
MAX_SCAN_STEP_S: Final = 0.35
"""Scans further apart do not show the way between them."""
FORGET_S: Final = 2.0
"""After so long a time without scans it is not known where the ground before lies."""
SHOWN_AFTER_S: Final = 0.05
"""From so long after the last position on, scans show how far the vehicle goes, once it is certain which way is
forward: in the wrong direction they would show it as well."""
MAX_BRIDGED_S: Final = 12.0
"""Across gaps between positions up to this long poses are known, once they are over."""
STEADY_POSITIONS: Final = 10
"""Where scans do not show the way, the vehicle goes on across a gap at the mean speed of so many positions before."""
POSE_STEP_S: Final = 0.2
TURN_SIGMA_RAD: Final = np.radians(0.1)
"""Of the turn that a scan shows; it does not add up, because scans are matched to what several before them saw."""
TURN_WALK: Final = np.radians(0.1)
"""Of the sum of the turns after a second."""
UNCERTAIN_AFTER_M: Final = 2.5
"""Length of the way behind it after which a heading is known although it is not certain which way is forward."""
UNSEEN_TURN_S: Final = 1.0
UNSEEN_TURN_MPS: Final = 1.0
"""Turns that scans do not show go on for so long; slower vehicles turn less, in proportion to their speed."""
TURN_BY_POSITIONS: Final = 0.3
TURN_STEP_S: Final = 0.04
"""Share of a correction of the heading by positions that is taken for a rate of turn where scans do not show any, if
positions come in steps of more than this."""
MOVE_SIGMA: Final = np.array([0.01, 0.01, 0.05, 0.01, 0.01, 0.03])
"""Of what is expected of a scan: place and height (m), turns about the axes (rad)."""
LOST_SIGMAS: Final = np.array([0.05, 0.05, *MOVE_SIGMA[2:]])
"""The same without positions, where the vehicle may have stopped and scans do not show how far it goes."""
LOST_ACCELERATION: Final = 0.5
"""Change of the speed after a second without positions (m/s, one standard deviation), before scans show it."""
LOST_SIGMA: Final = 0.1
"""Of the speed by which a gap between positions begins (m/s)."""
SHOWN_SIGMA_M: Final = (0.010, 0.020)
"""Ground that shows the way of a scan worse than the first, and the second for the second after a position, is too
smooth: from one position to the next the speed before shows it better."""
CONTRADICTED: Final = 12.0
CONTRADICTION_SHARE: Final = 0.2
"""Positions whose squared deviations from the way by scans are above the one, in a mean that each has the other in,
show that the scans are matched to wrong ground."""
DOUBTED_SIGMA_M: Final = 0.2
"""By which scans count as showing the way from then on, until their own are seen again."""
WAY_SHARE: Final = 0.1
"""Of a scan in the mean of how well scans show the way."""
MAX_CORRECTION_M: Final = 0.05
"""Steps of the positions beyond it, as of another quality, do not move the recent ground."""
SWAY_SIGMA_RAD: Final = np.radians(0.12)
"""What scans do not show of the sway."""
TRUE_LEVEL_SIGMA: Final = 0.004
"""The slopes of the plane that scans take for level are known to this, if turns showed them."""


@dataclass(frozen=True)
class TrueLevel:
    """The plane that scans take for level: its slopes (2,) to the east and the north, and their standard deviation."""

    slope: FloatArray
    sigma: float


@dataclass(frozen=True)
class LivePose:
    """The vehicle frame's pose at a time.

    Attributes:
        t_s: UTC, by the clock of the positions.
        xyz_m: easting, northing, height of the vehicle frame's origin.
        rotation: (3, 3) vehicle to map.
        sigma: standard deviations, see :data:`~furrowmap.core.values.trajectory.SIGMA_NAMES`.
        speed_mps: along the vehicle's x axis.
        turn_radps: rate of the yaw.
        position_age_s: time since the last position that went into it.
        fix: of that position.
        leans: whether the ground shows roll and pitch; else the vehicle is taken as level.
        is_guess: whether positions are missing: the last one is older than half a second, and than they usually get.
    """

    t_s: float
    xyz_m: tuple[float, float, float]
    rotation: FloatArray
    sigma: tuple[float, ...]
    speed_mps: float
    turn_radps: float
    position_age_s: float
    fix: Fix
    leans: bool
    is_guess: bool

    @property
    def attitude_deg(self) -> tuple[float, float, float]:
        """Roll, pitch, heading in the conventions of files."""
        quaternion = Rotation.from_matrix(self.rotation).as_quat(scalar_first=True)
        roll, pitch, heading = quaternion_to_attitude(quaternion)
        return float(roll[0]), float(pitch[0]), float(heading[0])


@dataclass(frozen=True)
class _SpeedError:
    """The error of the speed without positions: its covariance with that of the place (m²/s), its variance (m²/s²)."""

    with_place: float
    variance: float


@dataclass(frozen=True)
class ScanStep:
    """What is expected of a scan.

    Attributes:
        step_s: since the scan before.
        last: the path's point there.
        place_m: (3,) of the vehicle frame's origin on the recent ground.
        yaw_rad: by the turns so far.
        up: (2,) x and y of the upward direction in the vehicle frame, where its z is 1.
        velocity: (3,) on the recent ground (m/s), rate of the yaw (rad/s).
        speed: its error.
        sigma: (6,) standard deviations of place and height (m), turns about the axes (rad).
        is_lost: whether no position is near.
        is_shown: whether the ground shows the way.
        added: how the scan is added to the ground.
    """

    t_s: float
    step_s: float
    last: PathPoint
    place_m: FloatArray
    yaw_rad: float
    up: FloatArray
    velocity: FloatArray
    speed: _SpeedError
    sigma: FloatArray
    is_lost: bool
    is_shown: bool
    added: Added

    @property
    def rotation(self) -> FloatArray:
        """(3, 3) vehicle to recent ground."""
        return attitude(np.zeros(2), self.yaw_rad, self.up)


class FollowedDrive:
    """A drive that began in one direction: the path by the scans, and what the filter makes of it and of positions.

    Where positions are missing, the speed follows from the path.

    Args:
        ground: on which nothing was seen so far.
        lever_m: (3,) of the antenna.
        up: (2,) x and y of the upward direction in the vehicle frame, where its z is 1: what scans count from.
        positions: that have come.
        first: which of them is the first.
        yaw_rad: assumed then.
        speed_mps: assumed then, negative in reverse.
        level: known then; None for nothing.

    Attributes:
        known: (n, 16) at positions: time, place (3), yaw less the sum of the turns, speed, slopes (2) of the plane that
            scans take for level, standard deviations of place (3), roll, pitch, yaw and speed, quality.
        residual_m: RMS of the last scan's heights on the ground of those before; 0 without.
        way_m: driven forward less that in reverse.
        speed_mps: of the last scan.
    """

    def __init__(
        self,
        ground: RecentGround,
        lever_m: FloatArray,
        up: FloatArray,
        positions: Positions,
        first: int,
        yaw_rad: float,
        speed_mps: float,
        level: TrueLevel | None,
    ) -> None:
        self._ground = ground
        self._lever_m = lever_m
        t_s = float(positions.t_s[first])
        place = positions.xyz_m[first] - attitude(np.zeros(2), yaw_rad, up) @ lever_m
        self._taken_s = np.nextafter(t_s, -np.inf)
        slope = level.slope if level is not None else np.zeros(2)
        mean = np.array([*place, 0.0, speed_mps, *slope, *np.zeros(3)])
        self._filter = DriveFilter(t_s, mean, yaw_rad, 0.0, level.sigma if level is not None else 0.0)
        self._path = ScanPath(t_s, PathPoint(yaw_rad, 0.0, np.zeros(3), 0.0, up))
        self._on_map_m = place[:2]  # at the end of the path
        self._speed_error = _SpeedError(0.0, 0.0)
        self._matched_s = -np.inf
        self._step_s = 0.0  # usual one between positions
        self._is_certain = False
        self._unseen_turn = 1.0  # share of the variance of what is expected of a turn that the last scan left
        self._contradiction = 0.0  # of the way by scans by positions: squared deviation, a mean of the last ones
        self._way_sigma_m = np.inf  # by which a scan shows how far the vehicle went, a mean of the last ones
        self.known = np.zeros((0, 16))
        self.residual_m = self.way_m = 0.0
        self.speed_mps = speed_mps

    @property
    def level(self) -> TrueLevel:
        """What is level, as far as it is known."""
        sigma = float(np.sqrt(np.diag(self._filter.covariance)[5:7].max()))
        return TrueLevel(self._filter.mean[5:7].copy(), sigma)

    def add(self, scan: Scan, positions: Positions | None, *, is_certain: bool) -> None:
        """Add a scan, and the positions up to it; whether the direction of the drive is certain."""
        if positions is not None:
            self._step_s = float(np.median(np.diff(positions.t_s)))
        self._is_certain = is_certain
        is_far = middle_s(scan) - self._path.end_s > MAX_SCAN_STEP_S
        self._add_turn(scan)
        if positions is not None:
            for k in np.flatnonzero((positions.t_s > self._taken_s) & (positions.t_s <= self._path.end_s)).tolist():
                self._take(positions, k)
        if is_far:
            self._way_sigma_m = DOUBTED_SIGMA_M
            self.speed_mps = float(self._filter.mean[4])
            self._speed_error = _SpeedError(0.0, float(self._filter.covariance[4, 4]))

    def at(self, t_s: float) -> LivePose | None:
        """The pose at a time, None if unknown."""
        known = self.known
        k = int(np.searchsorted(known[:, 0], t_s, side="right")) - 1
        if k < 0:
            return None
        row = known[k]
        ahead_s = t_s - float(row[0])
        age_s = ahead_s
        point = self._path.at(t_s, self.speed_mps)
        before = self._path.at(float(row[0]), self.speed_mps)
        speed = float(row[5])
        moved = np.zeros(3)
        moved_sigma_m = 0.0
        if k + 1 < len(known):
            after = known[k + 1]
            gap_s = float(after[0] - row[0])
            if gap_s > MAX_BRIDGED_S:
                return None
            share = age_s / gap_s
            age_s = 0.0
            if self._scans_show(float(row[0]), float(after[0])):
                end = self._path.at(float(after[0]), self.speed_mps)
                whole = self._way(before, end, row)
                moved = self._way(before, point, row) - share * whole
                moved_sigma_m = np.sqrt((end.place_variance - before.place_variance) * share * (1.0 - share))
            row = np.append(row[:8] + share * (after[:8] - row[:8]), row[8:])
            speed = float(row[5])
        elif self._scans_show(float(row[0]), t_s):
            moved = self._way(before, point, row)
            moved_sigma_m = np.sqrt((row[14] * SHOWN_AFTER_S) ** 2 + point.place_variance - before.place_variance)
            speed = self.speed_mps
        else:
            if ahead_s > MAX_CARRIED_S:
                speed = float(known[max(0, k - STEADY_POSITIONS) :, 5].mean())
            moved = self._way_at_speed(float(row[0]), t_s, speed, row)
            moved[2] += float(point.place_m[2] - before.place_m[2]) if ahead_s else 0.0
            moved_sigma_m = np.hypot(row[14] * ahead_s, 0.5 * BRAKES_MPS2 * ahead_s**2)
        yaw = point.yaw_rad + float(row[4])
        variance = max(0.0, point.yaw_variance - before.yaw_variance)
        sigma_yaw = float(np.sqrt(row[13] ** 2 + TURN_SIGMA_RAD**2 + variance))
        moved_sigma_m = np.hypot(moved_sigma_m, sigma_yaw * float(np.hypot(*moved[:2])))
        leans = t_s - self._matched_s < MAX_CARRIED_S
        tilt_rad = SWAY_SIGMA_RAD if leans else np.radians(TILT_SIGMA_DEG)
        roll_deg, pitch_deg = (float(np.degrees(np.hypot(s, SWAY_SIGMA_RAD))) for s in row[11:13])
        sway_m = tilt_rad * abs(float(self._lever_m[2]))
        east, north = (float(np.sqrt(s**2 + moved_sigma_m**2 + sway_m**2)) for s in row[8:10])
        return LivePose(
            t_s,
            (float(row[1] + moved[0]), float(row[2] + moved[1]), float(row[3] + moved[2])),
            attitude(row[6:8], yaw, point.up),
            (
                east,
                north,
                float(row[10]),
                roll_deg if leans else TILT_SIGMA_DEG,
                pitch_deg if leans else TILT_SIGMA_DEG,
                float(np.degrees(sigma_yaw)),
            ),
            speed,
            self._path.turn_radps if abs(speed) > STANDING_MPS else 0.0,
            age_s,
            Fix(int(row[15])),
            leans,
            age_s > max(MAX_CARRIED_S, MISSED_STEPS * self._step_s),
        )

    def _scans_show(self, begin_s: float, end_s: float) -> bool:
        """Whether scans show the way between two times better than the speed before does."""
        is_dense = self._path.longest_step_s(begin_s, end_s) < MAX_SCAN_STEP_S
        return is_dense and end_s - begin_s > SHOWN_AFTER_S and self._ground_shows(end_s - begin_s)

    def _ground_shows(self, age_s: float) -> bool:
        """Whether the ground shows the way so long after a position."""
        return self._is_certain and self._way_sigma_m < SHOWN_SIGMA_M[0] + SHOWN_SIGMA_M[1] * min(1.0, age_s)

    def _way(self, begin: PathPoint, end: PathPoint, row: FloatArray) -> FloatArray:
        """(3,) on the map between two points of the path, with the yaw and the level of a row of `known`."""
        on_cells = end.place_m - begin.place_m
        plan = _plan_turn(float(row[4])) @ on_cells[:2]
        return np.array([*plan, plan @ row[6:8] + on_cells[2]])

    def _way_at_speed(self, begin_s: float, end_s: float, speed_mps: float, row: FloatArray) -> FloatArray:
        """(3,) on the map with the yaw and the level of a row of `known`, without climbs that scans show."""
        steps = np.linspace(begin_s, end_s, 2 + int((end_s - begin_s) / POSE_STEP_S))
        yaws = np.array([self._path.at(t).yaw_rad for t in (0.5 * (steps[1:] + steps[:-1])).tolist()]) + row[4]
        plan = speed_mps * np.diff(steps) @ np.column_stack([np.cos(yaws), np.sin(yaws)])
        return np.array([*plan, plan @ row[6:8]])

    def _add_turn(self, scan: Scan) -> None:
        """Match a scan to the ground of the last metres, and continue the path by what it shows."""
        t_s = middle_s(scan)
        if t_s <= self._path.end_s:
            return
        if t_s - self._path.end_s > FORGET_S:
            self._ground.forget()
            self._path.turn_radps = 0.0
        step = self._expected_step(t_s)
        moved = self._ground.move(scan, step.place_m, step.rotation, step.velocity, step.sigma, added=step.added)
        if moved is None:
            self._go_on_unseen(step)
        else:
            self._go_on(step, moved)

    def _expected_step(self, t_s: float) -> "ScanStep":
        """How the vehicle is expected to have moved from the last scan to one at a time.

        Takes over the speed, the way and the place on the map that the positions show by then.
        """
        step_s = t_s - self._path.end_s
        last = self._path.at(self._path.end_s)
        point = self._path.at(t_s, self.speed_mps)
        pose = self.at(t_s)
        is_near = step_s <= MAX_SCAN_STEP_S
        is_shown = is_near and self._ground_shows(np.inf if pose is None else pose.position_age_s)
        is_lost = pose is None or pose.position_age_s > (SHOWN_AFTER_S if is_shown else MAX_CARRIED_S)
        self.speed_mps = pose.speed_mps if pose is not None else float(self._filter.mean[4])
        self.way_m += self.speed_mps * step_s
        ahead = _direction(point.yaw_rad)
        way_m = self.speed_mps * step_s * ahead
        if is_lost:
            speed = replace(self._speed_error, variance=self._speed_error.variance + LOST_ACCELERATION**2 * step_s)
        else:
            speed = _SpeedError(0.0, LOST_SIGMA**2)
        if pose is not None:
            on_map_m = np.array(pose.xyz_m[:2])
            if not is_lost:
                way_m = self._way_by_positions(on_map_m, pose.rotation, point.yaw_rad, way_m)
            self._on_map_m = on_map_m
        sigma_m = float(np.sqrt(speed.variance)) * step_s
        sigma = MOVE_SIGMA
        if is_lost:
            sigma = np.array([sigma_m, sigma_m, *MOVE_SIGMA[2:]]) if is_shown else LOST_SIGMAS
        sigma = np.append(sigma[:5], max(sigma[5], UNSEEN_TURN_RADPS * step_s))
        added: Added = "expected"
        if is_lost and is_shown:
            added = "found" if pose is not None and pose.position_age_s < MAX_CARRIED_S else "found-new"
        return ScanStep(
            t_s,
            step_s,
            last,
            np.array([*(last.place_m[:2] + way_m), point.place_m[2]]),
            point.yaw_rad,
            point.up,
            np.array([*(self.speed_mps * ahead), self._path.turn_radps]),
            speed,
            sigma,
            is_lost,
            is_shown,
            added,
        )

    def _way_by_positions(
        self, on_map_m: FloatArray, rotation: FloatArray, yaw_rad: float, way_m: FloatArray
    ) -> FloatArray:
        """The way (2,) of a step by positions, unless it contradicts the one by the speed, `way_m`."""
        back = float(np.arctan2(rotation[1, 0], rotation[0, 0])) - yaw_rad
        by_positions: FloatArray = _plan_turn(back).T @ (on_map_m - self._on_map_m)
        return by_positions if np.hypot(*(by_positions - way_m)) < MAX_CORRECTION_M else way_m

    def _go_on_unseen(self, step: "ScanStep") -> None:
        """Continue the path by a step that the scan does not show."""
        self.residual_m = 0.0
        self._path.turn_radps *= 0.9
        unseen_rad = UNSEEN_TURN_RADPS * step.step_s
        yaw_variance = self._turn_variance(step.step_s, unseen_rad, unseen_rad)
        self._add_way_sigma(DOUBTED_SIGMA_M)
        self._add_point(step, step.yaw_rad, yaw_variance, step.place_m, step.up, 1.0)

    def _go_on(self, step: "ScanStep", moved: ScanTurn) -> None:
        """Continue the path by a step and what the scan shows of it."""
        self.residual_m = moved.residual_m
        self._matched_s = step.t_s
        turn_rad = float(moved.turn_rad[2])
        yaw_variance = self._turn_variance(step.step_s, moved.sigma_rad, float(step.sigma[5]))
        self._path.turn_radps += 0.9 * turn_rad / step.step_s
        level = step.rotation.T @ np.array([-moved.turn_rad[1], moved.turn_rad[0], 1.0])
        ahead = _direction(step.yaw_rad)
        unseen = float(ahead @ moved.covariance_m2 @ ahead) / step.sigma[0] ** 2
        self._add_way_sigma(float(step.sigma[0] * np.sqrt(unseen / max(1.0 - unseen, 1e-9))))
        place_m = step.place_m.copy()
        place_m[2] += moved.shift_m[2]
        if step.is_lost:
            place_m[:2] += moved.shift_m[:2]
        if step.is_lost and step.is_shown:
            self.speed_mps += float(moved.shift_m[:2] @ ahead) / step.step_s
        elif not step.is_shown:
            unseen = 1.0
        self._add_point(step, step.yaw_rad + turn_rad, yaw_variance, place_m, level[:2] / level[2], unseen)

    def _add_point(
        self,
        step: "ScanStep",
        yaw_rad: float,
        yaw_variance: float,
        place_m: FloatArray,
        up: FloatArray,
        unseen: float,
    ) -> None:
        """Add a point to the path; the error of its way is that of the speed, as far as the scan leaves it `unseen`."""
        self._speed_error = step.speed
        place_variance = step.last.place_variance
        if step.is_lost:
            way_variance = step.speed.variance * step.step_s**2
            place_variance += (2.0 * step.speed.with_place * step.step_s + way_variance) * unseen
            with_place = step.speed.with_place * unseen + way_variance * unseen / step.step_s
            self._speed_error = _SpeedError(with_place, step.speed.variance * unseen)
        yaw_variance += step.last.yaw_variance
        self._path.add(step.t_s, PathPoint(yaw_rad, yaw_variance, place_m, place_variance, up))

    def _turn_variance(self, step_s: float, sigma_rad: float, expected_sigma_rad: float) -> float:
        """What a turn that is known so well, and was expected so well, adds to the variance of the sum of turns."""
        self._unseen_turn = (sigma_rad / expected_sigma_rad) ** 2
        unseen = self._unseen_turn * sigma_rad**2
        noise = max(0.0, sigma_rad**2 - unseen - TURN_SIGMA_RAD**2)
        lasts_s = UNSEEN_TURN_S * min(1.0, (self.speed_mps / UNSEEN_TURN_MPS) ** 2)
        return float(TURN_WALK**2 * step_s + noise + unseen * lasts_s / step_s)

    def _add_way_sigma(self, sigma_m: float) -> None:
        """Add to the mean of how well scans show the way."""
        before_m = self._way_sigma_m if np.isfinite(self._way_sigma_m) else sigma_m
        self._way_sigma_m = before_m + WAY_SHARE * (sigma_m - before_m)

    def _scanned_way(self, end: PathPoint) -> ScannedWay | None:
        """The way from the last position on, if it was so long ago that scans had to show it."""
        begin_s = float(self.known[-1, 0]) if len(self.known) else np.inf
        if not self._scans_show(begin_s, self._taken_s):
            return None
        begin = self._path.at(begin_s)
        way_m = (end.place_m - begin.place_m)[:2]
        variance = end.place_variance - begin.place_variance
        return ScannedWay(way_m, float(np.sqrt(variance)), self.speed_mps, float(np.sqrt(self._speed_error.variance)))

    def _take(self, positions: Positions, k: int) -> None:
        """Let the filter take a position."""
        state = self._filter
        step_s = float(positions.t_s[k]) - self._taken_s
        offset = float(state.mean[3])
        t_s = self._taken_s = float(positions.t_s[k])
        point = self._path.at(t_s, self.speed_mps)
        turned = point.yaw_rad
        scanned = self._scanned_way(point)
        state.predict(t_s, turned, point.yaw_variance, float(point.place_m[2]), scanned)
        arm = attitude(state.mean[5:7], turned + float(state.mean[3]), point.up) @ self._lever_m
        sway_m = SWAY_SIGMA_RAD * abs(float(self._lever_m[2])) * np.array([1.0, 1.0, 0.0])
        white_m = np.hypot(positions.white_m[k], sway_m)
        squares = state.take(positions.xyz_m[k], arm, white_m, positions.drift_m[k], int(positions.fix[k]))
        if np.isfinite(positions.yaw_rad[k]):
            state.take_yaw(float(positions.yaw_rad[k]) - turned)
        mean = state.mean
        if step_s > TURN_STEP_S and self._path.end_s - t_s < MAX_CARRIED_S:
            known = min(1.0, abs(self.way_m) / UNCERTAIN_AFTER_M)  # before, positions correct the first heading
            share = TURN_BY_POSITIONS * self._unseen_turn * known
            self._path.turn_radps += share * (float(mean[3]) - offset) / step_s
        if scanned is not None:
            self.speed_mps += float(mean[4]) - scanned.speed_mps
            self._speed_error = _SpeedError(0.0, float(state.covariance[4, 4]))
            self._contradiction += CONTRADICTION_SHARE * (min(squares, JUMP_SQUARES) - self._contradiction)
        if self._contradiction > CONTRADICTED:
            self._contradiction = 0.0
            self._way_sigma_m = DOUBTED_SIGMA_M
            state.forget_speed()
        sigma = np.sqrt(np.diag(state.covariance))
        ahead = _direction(turned + float(mean[3]))
        tilts = [a @ state.covariance[5:7, 5:7] @ a for a in (np.array([-ahead[1], ahead[0]]), ahead)]
        row = [t_s, *mean[:7], *sigma[:3], *np.sqrt(tilts), *sigma[3:5], float(positions.fix[k])]
        self.known = np.vstack([self.known[self.known[:, 0] > t_s - KEPT_S], row])


def attitude(slope: FloatArray, yaw_rad: float, up: FloatArray) -> FloatArray:
    """(3, 3) vehicle to map: `up` (2,) is turned upright, then the heading, then the plane with slopes (2,) level."""
    out: FloatArray = _upright(slope) @ Rotation.from_euler("z", yaw_rad).as_matrix() @ _upright(up)
    return out


def middle_s(scan: Scan) -> float:
    """The time in the middle of a scan."""
    return 0.5 * float(scan.t_s[0] + scan.t_s[-1])


def _plan_turn(yaw_rad: float) -> FloatArray:
    """(2, 2) counter-clockwise rotation."""
    ahead = _direction(yaw_rad)
    return np.array([[ahead[0], -ahead[1]], [ahead[1], ahead[0]]])


def _direction(yaw_rad: float) -> FloatArray:
    return np.array([np.cos(yaw_rad), np.sin(yaw_rad)])


def _upright(level: FloatArray) -> FloatArray:
    """(3, 3) the least rotation that turns a vector (x, y, 1), of which (2,) is given, upright."""
    x, y, z = np.array([*level, 1.0]) / np.sqrt(1.0 + level @ level)
    return np.array(
        [
            [1.0 - x * x / (1.0 + z), -x * y / (1.0 + z), -x],
            [-x * y / (1.0 + z), 1.0 - y * y / (1.0 + z), -y],
            [x, y, z],
        ]
    )
