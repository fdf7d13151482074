"""Poses while the vehicle drives: scan by scan, from the positions so far and the ground under the scanner.

Each scan is matched to the ground of the last metres, which shows how the vehicle turns, leans and climbs, in reverse
and without positions too. A filter estimates place and speed, and by how much the sum of the turns is off: positions
show the heading, and on a way with turns what is level. At the start the vehicle may go forward or backwards: both are
followed until the ground shows which one it is.
"""

from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from scipy.spatial.transform import Rotation

from furrowmap.core.geodesy.coordinates import transform_track
from furrowmap.core.geodesy.projection import MapFrame
from furrowmap.core.matching.recent_ground import RecentGround
from furrowmap.core.matching.returns import GROUND_GATE_M, GROUND_GATE_SLOPE, LEARN_SCANS, SELF_RANGE_M, ground_height_m
from furrowmap.core.runtime.arrays import FloatArray
from furrowmap.core.trajectory.drive_filter import BRAKES_MPS2, DriveFilter
from furrowmap.core.trajectory.from_gnss import TILT_SIGMA_DEG
from furrowmap.core.trajectory.located import lever_arm_m
from furrowmap.core.trajectory.used_positions import fixes_from_labels, positions_without_steps
from furrowmap.core.trajectory.vehicle_motion import STANDING_MPS
from furrowmap.core.values.gnss import Fix, GnssTrack, Positions
from furrowmap.core.values.rotation import quaternion_to_attitude
from furrowmap.core.values.scan import Scan
from furrowmap.core.values.session import Session

PATH_S: Final = 15.0
"""Time over which poses are kept, and over which the noise of positions is estimated."""
MAX_CARRIED_S: Final = 0.5
"""Longer after the last position a pose is a guess."""
MAX_BRIDGED_S: Final = 12.0
"""Across gaps between positions up to this long poses are known, once they are over."""
STEADY_POSITIONS: Final = 10
"""Across a gap the vehicle goes on at the mean speed of so many positions before it."""
POSE_STEP_S: Final = 0.2
CATCH_UP: Final = 5
"""Scans from before the start that are looked at with each new one, so that none takes long."""
START_WAY_M: Final = 0.8
START_NOISES: Final = 15.0
START_WITHIN_S: Final = 4.0
"""Poses are given once positions moved so far, and by so many times their noise, in so short a time."""
KNOWN_HEADING_DEG: Final = 1.5
KNOWN_AFTER_M: Final = 2.5
"""The first pose has a standard deviation of the heading below the one and a way behind it above the other, unless two
antennas show the heading: others navigate by what is sent, and turns matched to the ground of a few scans err by more
than is stated."""
STAND_BEFORE_START_M: Final = 0.1
"""Scans from before, while the vehicle stood within this, show the ground best."""
BETTER: Final = 4.0
DECIDING_SCANS: Final = 8
"""One direction is the right one if the ground fits better by so many standard errors over so many scans."""
CERTAIN_M: Final = 10.0
"""After so long a way it is the one in which more was driven forward."""
TURN_SIGMA_RAD: Final = np.radians(0.1)
"""Of the turn that a scan shows; it does not add up, because scans are matched to what several before them saw."""
TURN_WALK: Final = np.radians(0.1)
"""Of the sum of the turns after a second."""
UNSEEN_TURN_RADPS: Final = np.radians(10.0)
"""A rate of turn that no scan shows."""
MOVE_SIGMA: Final = np.array([0.01, 0.01, 0.05, 0.01, 0.01, 0.02])
"""Of what is expected of a scan: place and height (m), turns about the axes (rad)."""
LOST_STEP_SIGMA_M: Final = 0.05
"""The same for the place without positions, where the vehicle may have stopped."""
MAX_CORRECTION_M: Final = 0.05
"""Steps of the positions beyond it, as of another quality, do not move the recent ground."""
PLANE_RANGE_M: Final = (SELF_RANGE_M[0], 9.0)
PLANE_ROUNDS: Final = 4
FIRST_PLANE_RETURNS: Final = 300
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

    @property
    def attitude_deg(self) -> tuple[float, float, float]:
        """Roll, pitch, heading in the conventions of files."""
        quaternion = Rotation.from_matrix(self.rotation).as_quat(scalar_first=True)
        roll, pitch, heading = quaternion_to_attitude(quaternion)
        return float(roll[0]), float(pitch[0]), float(heading[0])


class LivePoses:
    """Takes positions and scans as they come and gives the pose in the middle of each scan.

    Args:
        session: says how scanner and antenna are mounted.
        frame: the map frame.
        level: what is level, as an earlier look at the same scans from the same one on has found it.

    Raises:
        InputError: if the session names an unknown quality of positions.
    """

    def __init__(self, session: Session, frame: MapFrame, level: TrueLevel | None = None) -> None:
        self._level = level
        self._frame = frame
        self._fixes = fixes_from_labels(session.run.fixes) if session.run.fixes is not None else None
        mounting = session.lidar.mounting
        self._rotation = np.ascontiguousarray(mounting.rotation)
        self._sensor_m = np.asarray(mounting.xyz_m, np.float64)
        self._lever_m = np.asarray(lever_arm_m(session), np.float64)
        self._first: list[Scan] = []
        self._track: GnssTrack | None = None
        self._drives: list[_Drive] = []
        self._fits: list[float] = []
        self._heading_known = False

    @property
    def direction_is_certain(self) -> bool:
        """Whether it is known which way is forward."""
        return len(self._drives) == 1

    @property
    def antenna_m(self) -> tuple[float, float] | None:
        """Easting and northing of the antenna at the last position; None without any."""
        if self._track is None:
            return None
        e_m, n_m = self._frame.project(self._track.lon_deg[-1:], self._track.lat_deg[-1:])
        return float(e_m[0]), float(n_m[0])

    @property
    def level(self) -> TrueLevel | None:
        """What is level, as far as the drive has shown it; None before it begins."""
        return self._drives[0].level if self._drives else None

    @property
    def has_positions(self) -> bool:
        """Whether any position has come."""
        return self._track is not None

    @property
    def begin_s(self) -> float:
        """Time of the first pose that is known; infinite without one."""
        return float(self._drives[0].known[0, 0]) if self._drives and len(self._drives[0].known) else np.inf

    def add_track(self, track: GnssTrack) -> None:
        """Add positions as the receiver gave them; those of a time that is already known replace the earlier ones.

        Raises:
            InputError: if parameters or geoid of the map frame do not cover a position.
            RefusedError: if the datum of the map is not one of satellite positioning.
        """
        track = track[np.isfinite(track.lon_deg + track.height_m) & (track.fix != Fix.NONE)]
        if self._fixes is not None:
            track = track[np.isin(track.fix, self._fixes)]
        if not len(track):
            return
        new, _ = transform_track(track, self._frame)
        old = self._track
        if old is not None:
            old = old[old.t_s < new.t_s[0]]
            columns = {name: np.concatenate([getattr(old, name), getattr(new, name)]) for name in GnssTrack.columns()}
            new = GnssTrack.build(source=new.source, service=new.service, **columns)
        self._track = new[new.t_s > new.t_s[-1] - PATH_S]

    def add_scan(self, scan: Scan) -> LivePose | None:
        """Add a scan; gives its pose, None while positions do not show the heading."""
        if not len(scan):
            return None
        positions = self._positions()
        self._first.append(scan)
        if not self._drives:
            self._first = self._first[-LEARN_SCANS:]
            if positions is not None:
                self._start(positions)
        now, self._first = (self._first[:CATCH_UP], self._first[CATCH_UP:]) if self._drives else ([], self._first)
        for each in now:
            for drive in self._drives:
                drive.add(each, positions)
            self._choose()
        pose = self.at(_middle_s(scan)) if not self._first else None
        if pose is not None and pose.sigma[5] < KNOWN_HEADING_DEG:
            by_antennas = positions is not None and bool(np.isfinite(positions.yaw_rad[-1]))
            self._heading_known |= by_antennas or abs(self._drives[0].way_m) > KNOWN_AFTER_M
        return pose if self._heading_known else None

    def at(self, t_s: float) -> LivePose | None:
        """The pose at a time of the last seconds or just after them; later ones know more of it. None if unknown."""
        return self._drives[0].at(t_s) if self._drives else None

    def _positions(self) -> Positions | None:
        """The last seconds' positions of the antenna on the map, with their noise."""
        track = self._track
        if track is None or len(track) < 3:
            return None
        positions = positions_without_steps(track, np.column_stack(self._frame.project(track.lon_deg, track.lat_deg)))
        heading_deg = track.heading_deg - self._frame.convergence_deg(track.lon_deg, track.lat_deg)
        return replace(positions, yaw_rad=np.radians(90.0 - heading_deg))

    def _start(self, positions: Positions) -> None:
        """Follow the vehicle in both directions, once positions show its course, or two antennas the heading."""
        en_m = positions.xyz_m[:, :2]
        yaw_rad = float(positions.yaw_rad[-1])
        chord = en_m[-1] - en_m
        least_m = max(START_WAY_M, START_NOISES * float(positions.white_m[-1, 0]))
        away = np.flatnonzero(np.hypot(*chord.T) > least_m)
        if np.isfinite(yaw_rad):
            first = len(en_m) - 1
            starts = [(yaw_rad, 0.0)]
        elif len(away) and positions.t_s[-1] - positions.t_s[away[-1]] < START_WITHIN_S:
            first = int(away[-1])
            course = float(np.arctan2(chord[first, 1], chord[first, 0]))
            moving = np.hypot(*(en_m[:first] - en_m[first]).T) > STAND_BEFORE_START_M
            moving |= positions.t_s[:first] < _middle_s(self._first[0])
            first = int(np.flatnonzero([True, *moving])[-1])
            speed = float(np.hypot(*chord[first])) / float(positions.t_s[-1] - positions.t_s[first])
            starts = [(course, speed), (course + np.pi, -speed)]
        else:
            return
        up = _upright_on(self._first, self._rotation, self._sensor_m)
        self._first = [scan for scan in self._first if _middle_s(scan) >= positions.t_s[first]]
        self._drives = [
            _Drive(
                RecentGround(self._rotation, self._sensor_m), self._lever_m, up, positions, first, *start, self._level
            )
            for start in starts
        ]

    def _choose(self) -> None:
        """Leave the direction in which the ground fits worse."""
        if len(self._drives) < 2:
            return
        one, two = self._drives
        if min(one.residual_m, two.residual_m) > 0.0 and abs(one.speed_mps) > STANDING_MPS:
            self._fits = [*self._fits[-200:], two.residual_m - one.residual_m]
        fits = np.array(self._fits)
        if len(fits) >= DECIDING_SCANS and abs(fits.mean()) > BETTER * fits.std() / np.sqrt(len(fits)):
            self._drives = [one if fits.mean() > 0.0 else two]
        elif one.way_m + two.way_m > CERTAIN_M:
            self._drives = [one if one.way_m >= two.way_m else two]


class _Drive:
    """A drive that began in one direction: the turns by the scans, and what the filter makes of them and of positions.

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
        place = positions.xyz_m[first] - _attitude(np.zeros(2), yaw_rad, up) @ lever_m
        self._taken_s = np.nextafter(t_s, -np.inf)
        slope = level.slope if level is not None else np.zeros(2)
        mean = np.array([*place, 0.0, speed_mps, *slope, *np.zeros(3)])
        self._filter = DriveFilter(t_s, mean, yaw_rad, 0.0, level.sigma if level is not None else 0.0)
        # Of scans: time, sum of the turns, its variance, place on the ground's cells (3), upward direction (2), place
        # on the map (2).
        self._turns = np.array([[t_s, yaw_rad, 0.0, 0.0, 0.0, 0.0, *up, *place[:2]]])
        self._turn_radps = 0.0
        self._matched_s = -np.inf
        self.known = np.zeros((0, 16))
        self.residual_m = self.way_m = self.speed_mps = 0.0

    @property
    def level(self) -> TrueLevel:
        """What is level, as far as it is known."""
        sigma = float(np.sqrt(np.diag(self._filter.covariance)[5:7].max()))
        return TrueLevel(self._filter.mean[5:7].copy(), sigma)

    def add(self, scan: Scan, positions: Positions | None) -> None:
        """Add a scan, and the positions up to it."""
        self._add_turn(scan)
        if positions is not None:
            for k in np.flatnonzero((positions.t_s > self._taken_s) & (positions.t_s <= self._turns[-1, 0])).tolist():
                self._take(positions, k)

    def at(self, t_s: float) -> LivePose | None:
        """The pose at a time, None if unknown."""
        known = self.known
        k = int(np.searchsorted(known[:, 0], t_s, side="right")) - 1
        if k < 0:
            return None
        row = known[k]
        ahead_s = t_s - float(known[k, 0])
        turned, variance, height_m, up = self._turned(t_s)
        _, variance_before, height_before_m, _ = self._turned(float(row[0]))
        if k + 1 < len(known):
            share = ahead_s / float(known[k + 1, 0] - row[0])
            if known[k + 1, 0] - row[0] > MAX_BRIDGED_S:
                return None
            row = np.append(row[:8] + share * (known[k + 1, :8] - row[:8]), row[8:])
            ahead_s = 0.0
        yaw = turned + float(row[4])
        speed = float(row[5])
        slope = row[6:8]
        if ahead_s > MAX_CARRIED_S:
            speed = float(known[max(0, k - STEADY_POSITIONS) :, 5].mean())
        steps = np.linspace(t_s - ahead_s, t_s, 2 + int(ahead_s / POSE_STEP_S))
        yaws = np.array([self._turned(t)[0] for t in (0.5 * (steps[1:] + steps[:-1])).tolist()]) + row[4]
        moved = speed * np.diff(steps) @ np.column_stack([np.cos(yaws), np.sin(yaws)])
        height = float(row[3] + moved @ slope + (height_m - height_before_m if ahead_s else 0.0))
        sigma_yaw = float(np.sqrt(row[13] ** 2 + TURN_SIGMA_RAD**2 + max(0.0, variance - variance_before)))
        moved_m = np.hypot(row[14] * ahead_s, 0.5 * BRAKES_MPS2 * ahead_s**2) + sigma_yaw * abs(speed) * ahead_s
        leans = t_s - self._matched_s < MAX_CARRIED_S
        roll_deg, pitch_deg = (float(np.degrees(np.hypot(s, SWAY_SIGMA_RAD))) for s in row[11:13])
        sway_m = SWAY_SIGMA_RAD * abs(float(self._lever_m[2]))
        east, north = (float(np.sqrt(s**2 + moved_m**2 + sway_m**2)) for s in row[8:10])
        return LivePose(
            t_s,
            (float(row[1] + moved[0]), float(row[2] + moved[1]), height),
            _attitude(slope, yaw, up),
            (
                east,
                north,
                float(row[10]),
                roll_deg if leans else TILT_SIGMA_DEG,
                pitch_deg if leans else TILT_SIGMA_DEG,
                float(np.degrees(sigma_yaw)),
            ),
            speed,
            self._turn_radps if abs(speed) > STANDING_MPS else 0.0,
            ahead_s,
            Fix(int(row[15])),
            leans,
        )

    def _turned(self, t_s: float) -> tuple[float, float, float, FloatArray]:
        """The sum of the scans' turns at a time, its variance, height on the cells and upward direction (2,)."""
        turns = self._turns
        after_s = max(0.0, t_s - float(turns[-1, 0]))
        yaw, variance, height, x, y = (float(np.interp(t_s, turns[:, 0], turns[:, k])) for k in (1, 2, 5, 6, 7))
        yaw += self._turn_radps * min(after_s, 1.0)
        return yaw, variance + (UNSEEN_TURN_RADPS * after_s) ** 2, height, np.array([x, y])

    def _add_turn(self, scan: Scan) -> None:
        """Match a scan to the ground of the last metres."""
        t_s = _middle_s(scan)
        last = self._turns[-1]
        step_s = t_s - float(last[0])
        if step_s <= 0.0:
            return
        yaw, _, height, up = self._turned(t_s)
        pose = self.at(t_s)
        self.speed_mps = pose.speed_mps if pose is not None else float(self._filter.mean[4])
        self.way_m += self.speed_mps * step_s
        velocity = self.speed_mps * _direction(yaw)
        step = velocity * step_s
        on_map = last[8:]
        lost = True
        if pose is not None:
            lost = pose.position_age_s > MAX_CARRIED_S
            on_map = np.array(pose.xyz_m[:2])
            back = yaw - float(np.arctan2(pose.rotation[1, 0], pose.rotation[0, 0]))
            by_positions = np.array([_direction(back), _direction(back + 0.5 * np.pi)]).T @ (on_map - last[8:])
            step = by_positions if not lost and np.hypot(*(by_positions - step)) < MAX_CORRECTION_M else step
        place = np.array([*(last[3:5] + step), height])
        rotation = _attitude(np.zeros(2), yaw, up)
        sigma = np.where(np.arange(6) < 2, LOST_STEP_SIGMA_M, MOVE_SIGMA) if lost else MOVE_SIGMA
        moved = self._ground.move(scan, place, rotation, np.array([*velocity, self._turn_radps]), sigma)
        if moved is None:
            self._turn_radps *= 0.5
            variance = (UNSEEN_TURN_RADPS * step_s) ** 2
        else:
            turn_rad = float(moved.turn_rad[2])
            yaw = yaw + turn_rad
            self._matched_s = t_s
            place += moved.shift_m if lost else [0.0, 0.0, moved.shift_m[2]]
            level = rotation.T @ np.array([-moved.turn_rad[1], moved.turn_rad[0], 1.0])
            up = level[:2] / level[2]
            variance = TURN_WALK**2 * step_s + max(0.0, moved.sigma_rad**2 - TURN_SIGMA_RAD**2)
            self._turn_radps += 0.9 * turn_rad / step_s
        self.residual_m = moved.residual_m if moved is not None else 0.0
        row = [t_s, yaw, float(last[2]) + variance, *place, *up, *on_map]
        self._turns = np.vstack([self._turns[self._turns[:, 0] > t_s - PATH_S], row])

    def _take(self, positions: Positions, k: int) -> None:
        """Let the filter take a position."""
        state = self._filter
        t_s = self._taken_s = float(positions.t_s[k])
        turned, variance, height_m, up = self._turned(t_s)
        state.predict(t_s, turned, variance, height_m)
        arm = _attitude(state.mean[5:7], turned + float(state.mean[3]), up) @ self._lever_m
        sway_m = SWAY_SIGMA_RAD * abs(float(self._lever_m[2])) * np.array([1.0, 1.0, 0.0])
        white_m = np.hypot(positions.white_m[k], sway_m)
        state.take(positions.xyz_m[k], arm, white_m, positions.drift_m[k], int(positions.fix[k]))
        if np.isfinite(positions.yaw_rad[k]):
            state.take_yaw(float(positions.yaw_rad[k]) - turned)
        mean = state.mean
        sigma = np.sqrt(np.diag(state.covariance))
        ahead = _direction(turned + float(mean[3]))
        tilts = [a @ state.covariance[5:7, 5:7] @ a for a in (np.array([-ahead[1], ahead[0]]), ahead)]
        row = [t_s, *mean[:7], *sigma[:3], *np.sqrt(tilts), *sigma[3:5], float(positions.fix[k])]
        self.known = np.vstack([self.known[self.known[:, 0] > t_s - PATH_S], row])


def _upright_on(scans: list[Scan], rotation: FloatArray, sensor_m: FloatArray) -> FloatArray:
    """(2,) x and y of the normal, whose z is 1, of the plane of the ground in some scans; 0 where they show none."""
    xyz_m = np.concatenate([np.zeros((0, 3)), *(scan.xyz_m[::7] for scan in scans)]) @ rotation.T + sensor_m
    distance_m = np.hypot(xyz_m[:, 0], xyz_m[:, 1])
    xyz_m = xyz_m[(distance_m > PLANE_RANGE_M[0]) & (distance_m < PLANE_RANGE_M[1])]
    design = np.column_stack([np.ones(len(xyz_m)), xyz_m[:, :2]])
    plane = np.array([ground_height_m(scans, rotation, sensor_m), 0.0, 0.0])
    for gate_m in np.geomspace(GROUND_GATE_M + GROUND_GATE_SLOPE * PLANE_RANGE_M[1], 0.15, PLANE_ROUNDS):
        near = np.abs(xyz_m[:, 2] - design @ plane) < gate_m
        if near.sum() < FIRST_PLANE_RETURNS:
            return np.zeros(2)
        plane = np.linalg.lstsq(design[near], xyz_m[near, 2])[0]
    return -plane[1:]


def _attitude(slope: FloatArray, yaw_rad: float, up: FloatArray) -> FloatArray:
    """(3, 3) vehicle to map: `up` (2,) is turned upright, then the heading, then the plane with slopes (2,) level."""
    out: FloatArray = _upright(slope) @ Rotation.from_euler("z", yaw_rad).as_matrix() @ _upright(up)
    return out


def _middle_s(scan: Scan) -> float:
    return 0.5 * float(scan.t_s[0] + scan.t_s[-1])


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
