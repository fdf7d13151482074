"""Poses while the vehicle drives: scan by scan, from the positions so far and the ground under the scanner.

Each scan is matched to the ground of the last metres, which shows how the vehicle turns, in reverse and without
positions too. The plane of the ground in a scan shows how the vehicle leans on it; with that lean the antenna's
positions are brought down to the ground. A filter estimates place and speed, and by how much the sum of the turns is
off. At the start the vehicle may go forward or backwards: both are followed until the ground shows which one it is.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from scipy.spatial.transform import Rotation

from furrowmap.core.geodesy.coordinates import transform_track
from furrowmap.core.geodesy.projection import MapFrame
from furrowmap.core.matching.recent_ground import RecentGround
from furrowmap.core.matching.returns import (
    GROUND_GATE_M,
    GROUND_GATE_SLOPE,
    LEARN_SCANS,
    SELF_RANGE_M,
    ground_height_m,
)
from furrowmap.core.runtime.arrays import FloatArray
from furrowmap.core.runtime.kernels import kernel
from furrowmap.core.trajectory.drive_filter import DriveFilter
from furrowmap.core.trajectory.from_gnss import SWAY_RAD, TILT_SIGMA_DEG
from furrowmap.core.trajectory.located import lever_arm_m
from furrowmap.core.trajectory.motion import STANDING_MPS
from furrowmap.core.trajectory.positions import fixes_from_labels, positions_without_steps
from furrowmap.core.values.gnss import Fix, GnssTrack, Positions
from furrowmap.core.values.rotation import quaternion_to_attitude
from furrowmap.core.values.scan import Scan
from furrowmap.core.values.session import Session
from furrowmap.core.values.trajectory import Motion

PATH_S: Final = 15.0
"""Time over which poses are kept, and over which the noise of positions is estimated."""
SLOPE_S: Final = 90.0
"""Time whose heights show how the ground slopes."""
SLOPE_SIGMA: Final = 0.015
"""Slope of a field where heights do not show it."""
SLOPE_HEIGHT_SIGMA_M: Final = 0.05
"""Of the height of each position: waves of the ground, and errors that last for seconds."""
CLIMB: Final = 0.02
"""Standard deviation of the height after a second beside the known slope."""
MAX_CARRIED_S: Final = 0.5
"""Longer after the last position a pose is a guess."""
MAX_BRIDGED_S: Final = 12.0
"""Across gaps between positions up to this long poses are known, once they are over."""
POSE_STEP_S: Final = 0.2
GUESS_MPS: Final = 0.5
"""How much the speed changes in a second without positions."""
START_WAY_M: Final = 0.8
START_NOISES: Final = 15.0
START_WITHIN_S: Final = 4.0
"""Poses are given once positions moved so far, and by so many times their noise, in so short a time."""
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
"""Of what is expected of a scan: place, height (m), turns about the axes (rad)."""
MAX_CORRECTION_M: Final = 0.05
"""Steps of the positions beyond it, as of another quality, do not move the recent ground."""
PLANE_RANGE_M: Final = (SELF_RANGE_M[0], 9.0)
PLANE_ROUNDS: Final = 3
PLANE_NOISE_M: Final = 0.03
"""Returns this far from the plane lose weight; four times as far ones are not of it."""
MIN_LEAN_RETURNS: Final = 300
RESIDUAL_SWAY_RAD: Final = np.radians(0.12)
"""What the plane does not show of the sway."""


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

    @property
    def motion(self) -> Motion:
        """Forward, reverse or standing."""
        return Motion(int(np.sign(self.speed_mps))) if abs(self.speed_mps) > STANDING_MPS else Motion.STANDING


class LivePoses:
    """Takes positions and scans as they come and gives the pose in the middle of each scan.

    Args:
        session: says how scanner and antenna are mounted.
        frame: the map frame.

    Raises:
        InputError: if the session names an unknown quality of positions.
    """

    def __init__(self, session: Session, frame: MapFrame) -> None:
        self._frame = frame
        self._fixes = fixes_from_labels(session.run.fixes) if session.run.fixes is not None else None
        self._stance = _Stance(session)
        self._first: list[Scan] = []
        self._track: GnssTrack | None = None
        self._drives: list[_Drive] = []
        self._fits: list[float] = []

    @property
    def direction_is_certain(self) -> bool:
        """Whether it is known which way is forward."""
        return len(self._drives) == 1

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
            new = _joined(old[old.t_s < new.t_s[0]], new)
        self._track = new[new.t_s > new.t_s[-1] - PATH_S]

    def add_scan(self, scan: Scan) -> LivePose | None:
        """Add a scan; gives its pose, None while positions do not show the heading."""
        if not len(scan):
            return None
        self._stance.add(scan)
        positions = self._positions()
        if not self._drives:
            self._first = [*self._first[-LEARN_SCANS:], scan]
            if positions is None:
                return None
            self._start(positions)
            new, self._first = (self._first, []) if self._drives else ([], self._first)
        else:
            new = [scan]
        for each in new:
            for drive in self._drives:
                drive.add(each, positions)
            self._choose()
        return self.at(_middle_s(scan))

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
        en_m, yaw_rad = positions.xyz_m[:, :2], float(positions.yaw_rad[-1])
        chord = en_m[-1] - en_m
        least_m = max(START_WAY_M, START_NOISES * float(positions.white_m[-1, 0]))
        away = np.flatnonzero(np.hypot(*chord.T) > least_m)
        if np.isfinite(yaw_rad):
            first, starts = len(en_m) - 1, [(yaw_rad, 0.0)]
        elif len(away) and positions.t_s[-1] - positions.t_s[away[-1]] < START_WITHIN_S:
            first = int(away[-1])
            course = float(np.arctan2(chord[first, 1], chord[first, 0]))
            speed = float(np.hypot(*chord[first])) / float(positions.t_s[-1] - positions.t_s[first])
            starts = [(course, speed), (course + np.pi, -speed)]
        else:
            return
        self._first = [scan for scan in self._first if _middle_s(scan) >= positions.t_s[first]]
        self._drives = [_Drive(self._stance, positions, first, *start) for start in starts]

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


class _Stance:
    """How the vehicle leans on the ground, by each scan, and how the ground slopes, by the heights of the positions."""

    def __init__(self, session: Session) -> None:
        mounting = session.lidar.mounting
        self.rotation = np.ascontiguousarray(mounting.rotation)
        self.sensor_m = np.asarray(mounting.xyz_m, np.float64)
        self.lever_m = np.asarray(lever_arm_m(session), np.float64)
        self._first: list[Scan] = []
        self._plane: FloatArray | None = None
        self._leans: list[tuple[float, float, float]] = []
        self._heights = np.zeros((0, 4))
        self.slope, self.slope_sigma = np.zeros(2), np.full(2, SLOPE_SIGMA)

    def add(self, scan: Scan) -> None:
        """The slopes of the ground along the vehicle's axes in a scan."""
        if self._plane is None:
            self._first.append(scan)
            if len(self._first) < LEARN_SCANS:
                return
            self._plane = np.array([ground_height_m(self._first, self.rotation, self.sensor_m), 0.0, 0.0])
            for early in self._first[:-1]:
                self.add(early)
            self._first = []
        xyz_m = np.ascontiguousarray(scan.xyz_m, np.float32)
        plane = self._plane
        for number in range(PLANE_ROUNDS):
            gate_m = 4.0 * PLANE_NOISE_M if number else GROUND_GATE_M
            normal, right, used = _plane_sums(xyz_m, self.rotation, self.sensor_m, plane, gate_m)
            if used < MIN_LEAN_RETURNS or np.linalg.cond(normal) > 1e6:
                return
            plane = np.linalg.solve(normal, right)
        self._plane = np.array([self._plane[0], 0.5 * plane[1], 0.5 * plane[2]])
        self._leans = self._leans[-int(PATH_S * 20) :]
        self._leans.append((_middle_s(scan), float(plane[1]), float(plane[2])))

    def on_ground(self, t_s: float) -> tuple[FloatArray, bool]:
        """(3, 3) vehicle to a frame that stands upright on the ground below, and whether a scan shows it."""
        lean = self.leans_at(np.array([t_s]))
        return _upright(np.where(np.isfinite(lean), -lean, 0.0))[0], bool(np.isfinite(lean).all())

    def leans_at(self, t_s: FloatArray) -> FloatArray:
        """(n, 2) slopes of the ground along x and y of the vehicle; nan where no scan near shows them."""
        if not self._leans:
            return np.full((len(t_s), 2), np.nan)
        known_s, along, across = np.array(self._leans).T
        after = np.clip(np.searchsorted(known_s, t_s), 1, max(1, len(known_s) - 1))
        before_s, after_s = known_s[after - 1], known_s[np.minimum(after, len(known_s) - 1)]
        near = np.minimum(np.abs(t_s - before_s), np.abs(t_s - after_s)) < MAX_CARRIED_S
        leans = np.column_stack([np.interp(t_s, known_s, along), np.interp(t_s, known_s, across)])
        return np.where(near[:, None], leans, np.nan)

    def attitudes(self, yaw_rad: FloatArray, leans: FloatArray) -> FloatArray:
        """(n, 3, 3) vehicle to map, standing on the slope of the ground with a lean; level where that is not known."""
        known = np.isfinite(leans[:, :1])
        on_ground = _upright(np.where(known, -leans, 0.0))
        slope = _upright(np.where(known, -self.slope, 0.0)).transpose(0, 2, 1)
        out: FloatArray = slope @ Rotation.from_euler("z", yaw_rad[:, None]).as_matrix() @ on_ground
        return out

    def add_height(self, t_s: float, en_m: FloatArray, height_m: float) -> None:
        """The slope of the ground from the heights of the last minute."""
        old = self._heights
        self._heights = rows = np.vstack([old[(old[:, 0] > t_s - SLOPE_S) & (old[:, 0] < t_s)], [t_s, *en_m, height_m]])
        # Neighbours in time share their error: one position in a second counts.
        weight = 1.0 / (SLOPE_HEIGHT_SIGMA_M**2 * max(1.0, len(rows) / max(1.0, rows[-1, 0] - rows[0, 0])))
        design = np.column_stack([np.ones(len(rows)), rows[:, 1:3] - rows[-1, 1:3]])
        normal = weight * design.T @ design + np.diag([1e-6, SLOPE_SIGMA**-2, SLOPE_SIGMA**-2])
        covariance = np.linalg.inv(normal)
        self.slope = (covariance @ (weight * design.T @ (rows[:, 3] - rows[-1, 3])))[1:]
        self.slope_sigma = np.sqrt(np.diag(covariance)[1:])


class _Drive:
    """A drive that began in one direction: the turns by the scans, and what the filter makes of them and of positions.

    Args:
        stance: of the vehicle.
        positions: that have come.
        first: which of them is the first.
        yaw_rad: assumed then.
        speed_mps: assumed then, negative in reverse.

    Attributes:
        known: (n, 12) at positions: time, easting, northing, height, yaw less the sum of the turns, speed, standard
            deviations of these, quality.
        residual_m: RMS of the last scan's heights on the ground of those before; 0 without.
        way_m: driven forward less that in reverse.
        speed_mps: of the last scan.
    """

    def __init__(self, stance: _Stance, positions: Positions, first: int, yaw_rad: float, speed_mps: float) -> None:
        self._stance = stance
        self._ground = RecentGround(stance.rotation, stance.sensor_m)
        t_s, place = float(positions.t_s[first]), positions.xyz_m[first, :2]
        arm = stance.attitudes(np.array([yaw_rad]), stance.leans_at(np.array([t_s])))[0] @ stance.lever_m
        self._taken_s = np.nextafter(t_s, -np.inf)
        self._filter = DriveFilter(t_s, np.array([*(place - arm[:2]), 0.0, speed_mps, 0.0, 0.0]), yaw_rad, 0.0)
        # Of scans: time, sum of the turns, its variance, place on the ground's cells, place on the map.
        self._turns = np.array([[t_s, yaw_rad, 0.0, 0.0, 0.0, *(place - arm[:2])]])
        self._turn_radps = 0.0
        self.known = np.zeros((0, 12))
        self.residual_m = self.way_m = self.speed_mps = 0.0

    def add(self, scan: Scan, positions: Positions | None) -> None:
        """Add a scan, and the positions up to it."""
        self._add_turn(scan)
        if positions is not None:
            for k in np.flatnonzero((positions.t_s > self._taken_s) & (positions.t_s <= self._turns[-1, 0])).tolist():
                self._take(positions, k)

    def at(self, t_s: float) -> LivePose | None:
        """The pose at a time, None if unknown."""
        known, stance = self.known, self._stance
        k = int(np.searchsorted(known[:, 0], t_s, side="right")) - 1
        if k < 0:
            return None
        row, ahead_s = known[k], t_s - float(known[k, 0])
        turned, variance = self._turned(t_s)
        variance_before = self._turned(float(row[0]))[1]
        if k + 1 < len(known):
            share = ahead_s / float(known[k + 1, 0] - row[0])
            if known[k + 1, 0] - row[0] > MAX_BRIDGED_S:
                return None
            row = np.append(row[:6] + share * (known[k + 1, :6] - row[:6]), row[6:])
            ahead_s = 0.0
        yaw, speed = turned + float(row[4]), float(row[5])
        steps = np.linspace(t_s - ahead_s, t_s, 2 + int(ahead_s / POSE_STEP_S))
        yaws = np.array([self._turned(t)[0] for t in (0.5 * (steps[1:] + steps[:-1])).tolist()]) + row[4]
        e, n = row[1:3] + speed * np.diff(steps) @ np.column_stack([np.cos(yaws), np.sin(yaws)])
        sigma_yaw = float(np.sqrt(row[9] ** 2 + TURN_SIGMA_RAD**2 + max(0.0, variance - variance_before)))
        moved_m = np.hypot(row[10] * ahead_s, 0.5 * GUESS_MPS * ahead_s**2) + sigma_yaw * abs(speed) * ahead_s
        leans = stance.on_ground(t_s)[1]
        tilt_deg = float(0.2 + np.degrees(np.hypot(*stance.slope_sigma)) if leans else TILT_SIGMA_DEG)
        sway_m = np.radians(tilt_deg) * abs(float(stance.lever_m[2]))
        east, north = (float(np.sqrt(s**2 + moved_m**2 + sway_m**2)) for s in row[6:8])
        return LivePose(
            t_s,
            (float(e), float(n), float(row[3])),
            stance.attitudes(np.array([yaw]), stance.leans_at(np.array([t_s])))[0],
            (east, north, float(row[8]), tilt_deg, tilt_deg, float(np.degrees(sigma_yaw))),
            speed,
            self._turn_radps if abs(speed) > STANDING_MPS else 0.0,
            ahead_s,
            Fix(int(row[11])),
            leans,
        )

    def _turned(self, t_s: float) -> tuple[float, float]:
        """The sum of the scans' turns at a time, and its variance."""
        turns = self._turns
        after_s = max(0.0, t_s - float(turns[-1, 0]))
        yaw = float(np.interp(t_s, turns[:, 0], turns[:, 1])) + self._turn_radps * min(after_s, 1.0)
        return yaw, float(np.interp(t_s, turns[:, 0], turns[:, 2])) + (UNSEEN_TURN_RADPS * after_s) ** 2

    def _add_turn(self, scan: Scan) -> None:
        """Match a scan to the ground of the last metres."""
        t_s, last = _middle_s(scan), self._turns[-1]
        step_s = t_s - float(last[0])
        if step_s <= 0.0:
            return
        yaw, _ = self._turned(t_s)
        on_ground, leans = self._stance.on_ground(t_s)
        pose = self.at(t_s)
        self.speed_mps = pose.speed_mps if pose is not None else float(self._filter.mean[3])
        self.way_m += self.speed_mps * step_s
        velocity = self.speed_mps * _direction(yaw)
        step, on_map = velocity * step_s, last[5:]
        if pose is not None:
            on_map = np.array(pose.xyz_m[:2])
            back = yaw - float(np.arctan2(pose.rotation[1, 0], pose.rotation[0, 0]))
            by_positions = np.array([_direction(back), _direction(back + 0.5 * np.pi)]).T @ (on_map - last[5:])
            step = by_positions if np.hypot(*(by_positions - step)) < MAX_CORRECTION_M else step
        place = last[3:5] + step
        moved = None
        if leans:
            rotation = Rotation.from_euler("z", yaw).as_matrix() @ on_ground
            moved = self._ground.move(scan, place, rotation, np.array([*velocity, self._turn_radps]), MOVE_SIGMA)
        if moved is None:
            self._turn_radps *= 0.5
            variance = (UNSEEN_TURN_RADPS * step_s) ** 2
        else:
            yaw += moved.turn_rad
            variance = TURN_WALK**2 * step_s + max(0.0, moved.sigma_rad**2 - TURN_SIGMA_RAD**2)
            self._turn_radps += 0.9 * moved.turn_rad / step_s
        self.residual_m = moved.residual_m if moved is not None else 0.0
        row = [t_s, yaw, float(last[2]) + variance, *place, *on_map]
        self._turns = np.vstack([self._turns[self._turns[:, 0] > t_s - PATH_S], row])

    def _take(self, positions: Positions, k: int) -> None:
        """Let the filter take a position."""
        stance, state = self._stance, self._filter
        t_s = self._taken_s = float(positions.t_s[k])
        turned, variance = self._turned(t_s)
        state.predict(t_s, turned, variance)
        lean = stance.leans_at(np.array([t_s]))
        arm = stance.attitudes(np.array([turned + state.mean[2]]), lean)[0] @ stance.lever_m
        sway_m = (RESIDUAL_SWAY_RAD if np.isfinite(lean).all() else SWAY_RAD) * abs(float(stance.lever_m[2]))
        white_m, drift_m = positions.white_m[k], positions.drift_m[k]
        en_m, height_m = positions.xyz_m[k, :2], float(positions.xyz_m[k, 2] - arm[2])
        state.take(en_m, arm, float(np.hypot(white_m[0], sway_m)), float(drift_m[0]), int(positions.fix[k]))
        if np.isfinite(positions.yaw_rad[k]):
            state.take_yaw(float(positions.yaw_rad[k]) - turned)
        mean, sigma = state.mean, np.sqrt(np.diag(state.covariance))
        stance.add_height(t_s, mean[:2], height_m)
        sigma_h = float(np.hypot(white_m[2], drift_m[2]))
        if len(self.known):  # the height by a filter of its own, which knows the slope
            last = self.known[-1]
            gain = min(1.0, CLIMB / max(float(white_m[2]), 0.01) * float(np.sqrt(t_s - last[0])))
            expected = float(last[3] + (mean[:2] - last[1:3]) @ stance.slope)
            height_m = expected + gain * (height_m - expected)
        row = [t_s, *mean[:2], height_m, *mean[2:4], *sigma[:2], sigma_h, *sigma[2:4], float(positions.fix[k])]
        self.known = np.vstack([self.known[self.known[:, 0] > t_s - PATH_S], row])


def _middle_s(scan: Scan) -> float:
    return 0.5 * float(scan.t_s[0] + scan.t_s[-1])


def _direction(yaw_rad: float) -> FloatArray:
    return np.array([np.cos(yaw_rad), np.sin(yaw_rad)])


def _upright(level: FloatArray) -> FloatArray:
    """(n, 3, 3) the least rotations that turn vectors (x, y, 1), of which (n, 2) is given, upright."""
    unit = np.column_stack([level, np.ones(len(level))])
    unit /= np.linalg.norm(unit, axis=1)[:, None]
    axis = np.cross(unit, [0.0, 0.0, 1.0])
    sine = np.linalg.norm(axis, axis=1)
    vector = axis * (np.arcsin(sine) / np.maximum(sine, 1e-12))[:, None]
    out: FloatArray = Rotation.from_rotvec(vector).as_matrix()
    return out


def _joined(one: GnssTrack, two: GnssTrack) -> GnssTrack:
    columns = {name: np.concatenate([getattr(one, name), getattr(two, name)]) for name in GnssTrack.columns()}
    return GnssTrack(**columns, source=two.source, service=two.service)


@kernel()
def _plane_sums(xyz_m, rotation, sensor_m, plane, gate_m):  # type: ignore[no-untyped-def]
    """Normal equations of the plane z = a + b x + c y through every third return near the plane so far."""
    normal, right = np.zeros((3, 3)), np.zeros(3)
    row = np.ones(3)
    used = 0
    for i in range(0, len(xyz_m), 3):
        px, py, pz = xyz_m[i, 0], xyz_m[i, 1], xyz_m[i, 2]
        x = rotation[0, 0] * px + rotation[0, 1] * py + rotation[0, 2] * pz + sensor_m[0]
        y = rotation[1, 0] * px + rotation[1, 1] * py + rotation[1, 2] * pz + sensor_m[1]
        square = x * x + y * y
        if not PLANE_RANGE_M[0] ** 2 < square < PLANE_RANGE_M[1] ** 2:
            continue
        z = rotation[2, 0] * px + rotation[2, 1] * py + rotation[2, 2] * pz + sensor_m[2]
        off = abs(z - plane[0] - plane[1] * x - plane[2] * y)
        if off > gate_m + (GROUND_GATE_SLOPE * np.sqrt(square) if gate_m == GROUND_GATE_M else 0.0):
            continue
        weight = 1.0 / max(1.0, off / PLANE_NOISE_M)
        row[1], row[2] = x, y
        for a in range(3):
            right[a] += weight * row[a] * z
            for b in range(3):
                normal[a, b] += weight * row[a] * row[b]
        used += 1
    return normal, right, used
