"""Poses while the vehicle drives: scan by scan, from the positions so far and the ground under the scanner.

At the start the vehicle may go forward or backwards: both drives are followed until the ground shows which one it is.
"""

from dataclasses import replace
from typing import Final

import numpy as np

from furrowmap.core.geodesy.coordinates import transform_track
from furrowmap.core.geodesy.projection import MapFrame
from furrowmap.core.live.drive import UNCERTAIN_AFTER_M, FollowedDrive, LivePose, TrueLevel, middle_s
from furrowmap.core.live.scan_path import KEPT_S
from furrowmap.core.matching.recent_ground import RecentGround
from furrowmap.core.matching.returns import GROUND_GATE_M, GROUND_GATE_SLOPE, LEARN_SCANS, SELF_RANGE_M, ground_height_m
from furrowmap.core.runtime.arrays import FloatArray
from furrowmap.core.trajectory.located import lever_arm_m
from furrowmap.core.trajectory.used_positions import fixes_from_labels, positions_without_steps
from furrowmap.core.trajectory.vehicle_motion import STANDING_MPS
from furrowmap.core.values.gnss import Fix, GnssTrack, Positions
from furrowmap.core.values.scan import Scan
from furrowmap.core.values.session import Session

CATCH_UP: Final = 5
"""Scans from before the start that are looked at with each new one, so that none takes long."""
START_WAY_M: Final = 0.8
START_NOISES: Final = 15.0
START_WITHIN_S: Final = 4.0
"""Poses are given once positions moved so far, and by so many times their noise, in so short a time."""
KNOWN_HEADING_DEG: Final = 1.5
KNOWN_AFTER_M: Final = 1.5
"""The first pose has a standard deviation of the heading below the first and a way behind it above the second, or above
`UNCERTAIN_AFTER_M` while it is not certain which way is forward, unless two antennas show the heading: others navigate
by what is sent, and turns matched to the ground of a few scans err by more than is stated."""
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
PLANE_RANGE_M: Final = (SELF_RANGE_M[0], 9.0)
PLANE_ROUNDS: Final = 4
FIRST_PLANE_RETURNS: Final = 300
FIRST_PLANE_SHARE: Final = 0.5
"""A plane that holds a smaller share of the returns is none, as in maize."""


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
        self._drives: list[FollowedDrive] = []
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
        pose = self.at(middle_s(scan)) if not self._first else None
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
            moving |= positions.t_s[:first] < middle_s(self._first[0])
            first = int(np.flatnonzero([True, *moving])[-1])
            speed = float(np.hypot(*chord[first])) / float(positions.t_s[-1] - positions.t_s[first])
            starts = [(course, speed), (course + np.pi, -speed)]
        else:
            return
        up = _upright_on(self._first, self._rotation, self._sensor_m)
        self._first = [scan for scan in self._first if middle_s(scan) >= positions.t_s[first]]
        self._drives = [
            FollowedDrive(
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
