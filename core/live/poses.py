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
from furrowmap.core.live.scan_path import KEPT_S, UNSEEN_TURN_RADPS, PathPoint, ScanPath
from furrowmap.core.matching.recent_ground import Added, RecentGround
from furrowmap.core.matching.returns import GROUND_GATE_M, GROUND_GATE_SLOPE, LEARN_SCANS, SELF_RANGE_M, ground_height_m
from furrowmap.core.runtime.arrays import FloatArray
from furrowmap.core.trajectory.drive_filter import BRAKES_MPS2, JUMP_SQUARES, DriveFilter, ScannedWay
from furrowmap.core.trajectory.from_gnss import TILT_SIGMA_DEG
from furrowmap.core.trajectory.located import lever_arm_m
from furrowmap.core.trajectory.used_positions import fixes_from_labels, positions_without_steps
from furrowmap.core.trajectory.vehicle_motion import STANDING_MPS
from furrowmap.core.values.gnss import Fix, GnssTrack, Positions
from furrowmap.core.values.rotation import quaternion_to_attitude
from furrowmap.core.values.scan import Scan
from furrowmap.core.values.session import Session

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
CATCH_UP: Final = 5
"""Scans from before the start that are looked at with each new one, so that none takes long."""
START_WAY_M: Final = 0.8
START_NOISES: Final = 15.0
START_WITHIN_S: Final = 4.0
"""Poses are given once positions moved so far, and by so many times their noise, in so short a time."""
KNOWN_HEADING_DEG: Final = 1.5
KNOWN_AFTER_M: Final = 1.5
UNCERTAIN_AFTER_M: Final = 2.5
"""The first pose has a standard deviation of the heading below the first and a way behind it above the second, or above
the third while it is not certain which way is forward, unless two antennas show the heading: others navigate by what is
sent, and turns matched to the ground of a few scans err by more than is stated."""
SMOOTH_HEADING_DEG: Final = 8.0
SMOOTH_AFTER_M: Final = 5.0
"""The same where positions alone show the heading, as on asphalt."""
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
PLANE_RANGE_M: Final = (SELF_RANGE_M[0], 9.0)
PLANE_ROUNDS: Final = 4
FIRST_PLANE_RETURNS: Final = 300
FIRST_PLANE_SHARE: Final = 0.5
"""A plane that holds a smaller share of the returns is none, as in maize."""
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
        self._track = new[new.t_s > new.t_s[-1] - KEPT_S]

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
                drive.add(each, positions, is_certain=len(self._drives) == 1)
            self._choose()
        pose = self.at(_middle_s(scan)) if not self._first else None
        if pose is not None and pose.sigma[5] < SMOOTH_HEADING_DEG:
            by_antennas = positions is not None and bool(np.isfinite(positions.yaw_rad[-1]))
            least_m = KNOWN_AFTER_M if self.direction_is_certain else UNCERTAIN_AFTER_M
            if pose.sigma[5] > KNOWN_HEADING_DEG:
                least_m = SMOOTH_AFTER_M
            self._heading_known |= by_antennas or abs(self._drives[0].way_m) > least_m
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
        place = positions.xyz_m[first] - _attitude(np.zeros(2), yaw_rad, up) @ lever_m
        self._taken_s = np.nextafter(t_s, -np.inf)
        slope = level.slope if level is not None else np.zeros(2)
        mean = np.array([*place, 0.0, speed_mps, *slope, *np.zeros(3)])
        self._filter = DriveFilter(t_s, mean, yaw_rad, 0.0, level.sigma if level is not None else 0.0)
        self._path = ScanPath(t_s, PathPoint(yaw_rad, 0.0, np.zeros(3), 0.0, up))
        self._on_map_m = place[:2]  # at the end of the path
        self._lost = (0.0, 0.0)  # covariance of place and speed (m²/s), variance of the speed (m²/s²)
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
        is_far = _middle_s(scan) - self._path.end_s > MAX_SCAN_STEP_S
        self._add_turn(scan)
        if positions is not None:
            for k in np.flatnonzero((positions.t_s > self._taken_s) & (positions.t_s <= self._path.end_s)).tolist():
                self._take(positions, k)
        if is_far:
            self._way_sigma_m = DOUBTED_SIGMA_M
            self.speed_mps = float(self._filter.mean[4])
            self._lost = (0.0, float(self._filter.covariance[4, 4]))

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
            _attitude(row[6:8], yaw, point.up),
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
        """Match a scan to the ground of the last metres."""
        t_s = _middle_s(scan)
        last = self._path.at(self._path.end_s)
        step_s = t_s - self._path.end_s
        if step_s <= 0.0:
            return
        if step_s > FORGET_S:
            self._ground.forget()
            self._path.turn_radps = 0.0
        expected = self._path.at(t_s, self.speed_mps)
        pose = self.at(t_s)
        is_far = step_s > MAX_SCAN_STEP_S
        shown = self._ground_shows(np.inf if pose is None else pose.position_age_s) and not is_far
        lost = pose is None or pose.position_age_s > (SHOWN_AFTER_S if shown else MAX_CARRIED_S)
        self.speed_mps = pose.speed_mps if pose is not None else float(self._filter.mean[4])
        self.way_m += self.speed_mps * step_s
        ahead = _direction(expected.yaw_rad)
        step = self.speed_mps * step_s * ahead
        common, variance = self._lost
        if lost:
            variance += LOST_ACCELERATION**2 * step_s
        elif pose is not None:
            common = 0.0
            variance = LOST_SIGMA**2
            on_map = np.array(pose.xyz_m[:2])
            back = float(np.arctan2(pose.rotation[1, 0], pose.rotation[0, 0])) - expected.yaw_rad
            by_positions = _plan_turn(back).T @ (on_map - self._on_map_m)
            step = by_positions if np.hypot(*(by_positions - step)) < MAX_CORRECTION_M else step
        if pose is not None:
            self._on_map_m = np.array(pose.xyz_m[:2])
        place = np.array([*(last.place_m[:2] + step), expected.place_m[2]])
        rotation = _attitude(np.zeros(2), expected.yaw_rad, expected.up)
        sigma_m = float(np.sqrt(variance)) * step_s
        if not lost:
            sigma = MOVE_SIGMA
        elif shown:
            sigma = np.array([sigma_m, sigma_m, *MOVE_SIGMA[2:]])
        else:
            sigma = LOST_SIGMAS
        sigma = np.append(sigma[:5], max(sigma[5], UNSEEN_TURN_RADPS * step_s))
        velocity = np.array([*(self.speed_mps * ahead), self._path.turn_radps])
        added: Added = "expected"
        if lost and shown:
            added = "found" if pose is not None and pose.position_age_s < MAX_CARRIED_S else "found-new"
        moved = self._ground.move(scan, place, rotation, velocity, sigma, added=added)
        yaw = expected.yaw_rad
        up = expected.up
        unseen = 1.0
        if moved is None:
            self._path.turn_radps *= 0.9
            yaw_variance = self._turn_variance(step_s, UNSEEN_TURN_RADPS * step_s, UNSEEN_TURN_RADPS * step_s)
            self._add_way_sigma(DOUBTED_SIGMA_M)
            self.residual_m = 0.0
        else:
            turn_rad = float(moved.turn_rad[2])
            yaw += turn_rad
            self._matched_s = t_s
            place[2] += moved.shift_m[2]
            level = rotation.T @ np.array([-moved.turn_rad[1], moved.turn_rad[0], 1.0])
            up = level[:2] / level[2]
            yaw_variance = self._turn_variance(step_s, moved.sigma_rad, float(sigma[5]))
            self._path.turn_radps += 0.9 * turn_rad / step_s
            self.residual_m = moved.residual_m
            unseen = float(ahead @ moved.covariance_m2 @ ahead) / sigma[0] ** 2
            self._add_way_sigma(float(sigma[0] * np.sqrt(unseen / max(1.0 - unseen, 1e-9))))
            if lost:
                place[:2] += moved.shift_m[:2]
            if lost and shown:
                self.speed_mps += float(moved.shift_m[:2] @ ahead) / step_s
            elif not shown:
                unseen = 1.0
        # The step's error is that of the speed, as far as the scan does not show it.
        place_variance = last.place_variance
        if lost:
            place_variance += (2.0 * common * step_s + sigma_m**2) * unseen
            common = common * unseen + sigma_m**2 * unseen / step_s
            variance *= unseen
        self._lost = (common, variance)
        self._path.add(t_s, PathPoint(yaw, last.yaw_variance + yaw_variance, place, place_variance, up))

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
        return ScannedWay(way_m, float(np.sqrt(variance)), self.speed_mps, float(np.sqrt(self._lost[1])))

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
        arm = _attitude(state.mean[5:7], turned + float(state.mean[3]), point.up) @ self._lever_m
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
            self._lost = (0.0, float(state.covariance[4, 4]))
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


def _upright_on(scans: list[Scan], rotation: FloatArray, sensor_m: FloatArray) -> FloatArray:
    """(2,) x and y of the normal, whose z is 1, of the plane of the ground in some scans; 0 where they show none."""
    xyz_m = np.concatenate([np.zeros((0, 3)), *(scan.xyz_m[::7] for scan in scans)]) @ rotation.T + sensor_m
    distance_m = np.hypot(xyz_m[:, 0], xyz_m[:, 1])
    xyz_m = xyz_m[(distance_m > PLANE_RANGE_M[0]) & (distance_m < PLANE_RANGE_M[1])]
    design = np.column_stack([np.ones(len(xyz_m)), xyz_m[:, :2]])
    plane = np.array([ground_height_m(scans, rotation, sensor_m), 0.0, 0.0])
    for gate_m in np.geomspace(GROUND_GATE_M + GROUND_GATE_SLOPE * PLANE_RANGE_M[1], 0.15, PLANE_ROUNDS):
        near = np.abs(xyz_m[:, 2] - design @ plane) < gate_m
        if near.sum() < max(FIRST_PLANE_RETURNS, FIRST_PLANE_SHARE * len(near)):
            return np.zeros(2)
        plane = np.linalg.lstsq(design[near], xyz_m[near, 2])[0]
    return -plane[1:]


def _attitude(slope: FloatArray, yaw_rad: float, up: FloatArray) -> FloatArray:
    """(3, 3) vehicle to map: `up` (2,) is turned upright, then the heading, then the plane with slopes (2,) level."""
    out: FloatArray = _upright(slope) @ Rotation.from_euler("z", yaw_rad).as_matrix() @ _upright(up)
    return out


def _middle_s(scan: Scan) -> float:
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
