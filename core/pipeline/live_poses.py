"""Poses while the vehicle drives: scan by scan, from the positions so far and the ground under the scanner.

The plane of the ground in a scan shows how the vehicle leans on it. With that lean the antenna's positions are brought
down to the ground, so that its sway no longer hides the course, and the last seconds of positions give the heading as
in :mod:`~furrowmap.core.trajectory.kinematic`. How the ground itself slopes is what the heights of the last minute
show. What a run has beyond this is the future, and the relief.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final

import numba
import numpy as np
from scipy.spatial.transform import Rotation

from furrowmap.core.geodesy.coordinates import transform_track
from furrowmap.core.geodesy.projection import MapFrame
from furrowmap.core.matching.returns import (
    GROUND_GATE_M,
    GROUND_GATE_SLOPE,
    LEARN_SCANS,
    SELF_RANGE_M,
    ground_height_m,
)
from furrowmap.core.runtime.arrays import FloatArray
from furrowmap.core.runtime.errors import FurrowmapError
from furrowmap.core.trajectory.from_gnss import SWAY_RAD, TILT_SIGMA_DEG, trajectory_from_gnss
from furrowmap.core.trajectory.located import lever_arm_m
from furrowmap.core.trajectory.motion import STANDING_MPS
from furrowmap.core.trajectory.positions import fixes_from_labels
from furrowmap.core.values.gnss import Fix, GnssTrack
from furrowmap.core.values.rotation import quaternion_to_attitude
from furrowmap.core.values.scan import Scan
from furrowmap.core.values.session import Session
from furrowmap.core.values.trajectory import Motion, Trajectory

PATH_S: Final = 15.0
"""Time over which positions are smoothed: some passes of the noise, and less than a turn of the drift."""
SLOPE_S: Final = 90.0
"""Time whose heights show how the ground slopes."""
SLOPE_SIGMA: Final = 0.015
"""Slope of a field where heights do not show it."""
SLOPE_HEIGHT_SIGMA_M: Final = 0.05
"""Of the height of each position: waves of the ground, and errors that last for seconds."""
MAX_CARRIED_S: Final = 0.5
"""Longer after the last position a pose is a guess."""
MAX_BRIDGED_S: Final = 12.0
"""Across gaps between positions up to this long the vehicle is taken to have gone straight, once they are over."""
REVERSE_FACTOR: Final = 4.0
"""By how much headings in reverse are less certain than the positions so far say: an error grows with the way."""
REVERSE_LASTS_S: Final = 5.0
GUESS_MPS: Final = 0.5
GUESS_DEGPS: Final = 3.0
"""How much speed and rate of turn change in a second without positions."""
SURE_HEADING_DEG: Final = 2.0
SURE_WAY_M: Final = 1.0
"""Poses are given from where positions lie this far apart and show the heading this well."""
REVERSED_M: Final = 2.0
"""By how much more was driven in reverse than forward when the direction assumed at the start was the other one."""
CERTAIN_M: Final = 10.0
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
        mounting = session.lidar.mounting
        self._frame = frame
        self._rotation = np.ascontiguousarray(mounting.rotation)
        self._sensor_m = np.asarray(mounting.xyz_m, np.float64)
        self._lever_m = np.asarray(lever_arm_m(session), np.float64)
        self._fixes = fixes_from_labels(session.run.fixes) if session.run.fixes is not None else None
        self._first: list[Scan] = []
        self._ground_m: float | None = None
        self._plane = np.zeros(3)
        self._leans: list[tuple[float, float, float]] = []
        self._track: GnssTrack | None = None
        self._heights = np.zeros((0, 4))
        self._slope, self._slope_sigma = np.zeros(2), np.full(2, SLOPE_SIGMA)
        self._path: Trajectory | None = None
        self._known: Trajectory | None = None
        self._facing: tuple[float, float] | None = None
        self._ways_m = [0.0, 0.0]
        self._last_s = -np.inf

    @property
    def direction_is_certain(self) -> bool:
        """Whether enough was driven to know which way is forward."""
        return self._ways_m[0] - self._ways_m[1] > CERTAIN_M

    @property
    def has_positions(self) -> bool:
        """Whether any position has come."""
        return self._track is not None

    @property
    def begin_s(self) -> float:
        """Time of the first pose that is known; infinite without one."""
        return self._path.span_s[0] if self._path is not None and self._facing is not None else np.inf

    def add_track(self, track: GnssTrack) -> None:
        """Add positions as the receiver gave them; those of a time that is already known replace the earlier ones.

        Raises:
            InputError: if parameters or geoid of the map frame do not cover a position.
            RefusedError: if the datum of the map is not one of satellite positioning.
        """
        track = track[np.isfinite(track.lon_deg + track.height_m)]
        if not len(track):
            return
        new, _ = transform_track(track, self._frame)
        old = self._track
        if old is not None:
            new = _joined(old[old.t_s < new.t_s[0]], new)
        self._track = new[new.t_s > new.t_s[-1] - PATH_S]
        self._path = None

    def add_scan(self, scan: Scan) -> LivePose | None:
        """Add a scan; gives its pose, None while positions do not show the heading."""
        if not len(scan):
            return None
        self._add_lean(scan)
        if self._track is None:
            return None
        if self._path is None:
            self._solve(self._track)
        pose = self.at(0.5 * float(scan.t_s[0] + scan.t_s[-1]))
        if pose is not None and pose.t_s > self._last_s:
            step_s, self._last_s = pose.t_s - self._last_s, pose.t_s
            if step_s < 1.0:
                self._ways_m[pose.speed_mps < 0.0] += abs(pose.speed_mps) * step_s
            if self._ways_m[1] > self._ways_m[0] + REVERSED_M and self._facing is not None:
                self._facing = self._facing[0], self._facing[1] + 180.0
                self._ways_m.reverse()
                self._solve(self._track)
        return pose

    def at(self, t_s: float) -> LivePose | None:
        """The pose at a time of the last seconds or just after them; later ones know more of it. None if unknown."""
        path = self._path
        if path is None or self._facing is None or not path.span_s[0] <= t_s:
            return None
        k = min(int(np.searchsorted(path.t_s, t_s, side="right")), len(path)) - 1
        near = path.at(min(t_s, path.span_s[1]))
        before = max(0, k - 3)
        speed = float(np.nan_to_num(path.speed_mps[k]))
        yaws = np.radians(90.0 - path.attitude_deg()[2][before : k + 1])
        span_s = float(path.t_s[k] - path.t_s[before])
        turn = float(np.unwrap(yaws)[-1] - yaws[0]) / span_s if span_s > 0.0 and abs(speed) > STANDING_MPS else 0.0
        if not np.isfinite(near.xyz_m[0, 0]):
            return None
        ahead_s = max(0.0, t_s - path.span_s[1])
        yaw = float(np.radians(90.0 - near.attitude_deg()[2][0])) + turn * ahead_s
        middle = yaw - 0.5 * turn * ahead_s
        e, n, h = near.xyz_m[0].tolist()
        e, n = e + speed * ahead_s * np.cos(middle), n + speed * ahead_s * np.sin(middle)
        lean = self._leans_at(np.array([t_s]))
        leans = bool(np.isfinite(lean).all())
        turned_deg = 0.5 * GUESS_DEGPS * ahead_s**2
        moved_m = 0.5 * GUESS_MPS * ahead_s**2 + np.radians(turned_deg) * abs(speed) * ahead_s
        tilt_deg = 0.2 + np.degrees(np.hypot(*self._slope_sigma)) if leans else TILT_SIGMA_DEG
        sway_m = np.radians(tilt_deg) * abs(float(self._lever_m[2]))
        sigma = path.sigma[k].copy()
        lately = path.motion[np.searchsorted(path.t_s, t_s - REVERSE_LASTS_S) : k + 1]
        sigma[5] *= REVERSE_FACTOR if (lately == Motion.REVERSE).any() else 1.0
        return LivePose(
            t_s,
            (float(e), float(n), float(h)),
            self._attitudes(np.array([yaw]), lean)[0],
            (
                *(float(np.hypot(np.hypot(s, moved_m), sway_m)) for s in sigma[:2]),
                float(sigma[2]),
                float(tilt_deg),
                float(tilt_deg),
                float(np.hypot(sigma[5], turned_deg)),
            ),
            speed,
            turn,
            ahead_s,
            Fix(int(path.fix[k])),
            leans,
        )

    def _add_lean(self, scan: Scan) -> None:
        """How the vehicle leans on the ground in a scan: slopes of the ground along its axes."""
        if self._ground_m is None:
            self._first.append(scan)
            if len(self._first) < LEARN_SCANS:
                return
            self._ground_m = ground_height_m(self._first, self._rotation, self._sensor_m)
            self._plane[0] = self._ground_m
            first, self._first = self._first, []
            for early in first:
                self._add_lean(early)
            return
        xyz_m = np.ascontiguousarray(scan.xyz_m, np.float32)
        plane = self._plane
        for number in range(PLANE_ROUNDS):
            gate_m = 4.0 * PLANE_NOISE_M if number else GROUND_GATE_M
            normal, right, used = _plane_sums(xyz_m, self._rotation, self._sensor_m, plane, gate_m)
            if used < MIN_LEAN_RETURNS or np.linalg.cond(normal) > 1e6:
                return
            plane = np.linalg.solve(normal, right)
        self._plane = np.array([self._ground_m, 0.5 * plane[1], 0.5 * plane[2]])
        self._leans = self._leans[-int(PATH_S * 20) :]
        self._leans.append((0.5 * float(scan.t_s[0] + scan.t_s[-1]), float(plane[1]), float(plane[2])))

    def _leans_at(self, t_s: FloatArray) -> FloatArray:
        """(n, 2) slopes of the ground along x and y of the vehicle; nan where no scan near shows them."""
        if not self._leans:
            return np.full((len(t_s), 2), np.nan)
        known_s, along, across = np.array(self._leans).T
        after = np.clip(np.searchsorted(known_s, t_s), 1, max(1, len(known_s) - 1))
        before_s, after_s = known_s[after - 1], known_s[np.minimum(after, len(known_s) - 1)]
        near = np.minimum(np.abs(t_s - before_s), np.abs(t_s - after_s)) < MAX_CARRIED_S
        leans = np.column_stack([np.interp(t_s, known_s, along), np.interp(t_s, known_s, across)])
        return np.where(near[:, None], leans, np.nan)

    def _attitudes(self, yaw_rad: FloatArray, leans: FloatArray) -> FloatArray:
        """(n, 3, 3) vehicle to map, standing on the slope of the ground with a lean; level where that is not known."""
        known = np.isfinite(leans[:, :1])
        on_ground = _upright(np.where(known, -leans, 0.0))
        slope = _upright(np.where(known, -self._slope, 0.0)).transpose(0, 2, 1)
        out: FloatArray = slope @ Rotation.from_euler("z", yaw_rad[:, None]).as_matrix() @ on_ground
        return out

    def _solve(self, track: GnssTrack) -> None:
        """Heading and place from the positions, brought down along the leaning antenna's arm."""
        en = np.column_stack(self._frame.project(track.lon_deg, track.lat_deg))
        height_m, known = track.height_m, self._known
        if known is not None:
            yaw = np.interp(track.t_s, known.t_s, np.unwrap(np.radians(90.0 - known.attitude_deg()[2])))
            leans = self._leans_at(track.t_s)
            off = (self._attitudes(yaw, leans) - self._attitudes(yaw, np.full_like(leans, np.nan))) @ self._lever_m
            en, height_m = en - off[:, :2], height_m - off[:, 2]
        lon, lat = self._frame.to_lon_lat(en[:, 0], en[:, 1])
        corrected = replace(track, lon_deg=np.asarray(lon), lat_deg=np.asarray(lat), height_m=height_m)
        try:
            lever = (float(self._lever_m[0]), float(self._lever_m[1]), float(self._lever_m[2]))
            sway = float(SWAY_RAD if known is None else RESIDUAL_SWAY_RAD)
            found = trajectory_from_gnss(corrected, self._frame, lever, self._fixes, sway_rad=sway, facing=self._facing)
        except (FurrowmapError, np.linalg.LinAlgError):
            self._stand(track.t_s[-1])
            return
        path = self._known = replace(found.trajectory, max_gap_s=MAX_BRIDGED_S)
        way_m = float(np.hypot(*(en - en[-1]).T).max())
        if self._facing is None and (known is None or way_m < SURE_WAY_M or path.sigma[-1, 5] > SURE_HEADING_DEG):
            return
        self._path = path
        moving = np.flatnonzero(path.motion)
        if len(moving):
            at = int(moving[-1])
            self._facing = float(path.t_s[at]), float(path.attitude_deg()[2][at])
        self._add_heights(track.t_s, en, height_m)

    def _stand(self, now_s: float) -> None:
        """Positions that show no heading leave the pose as it was: the vehicle stands."""
        known = self._known
        if known is None:
            return
        last = slice(-1, None)
        columns = {
            name: np.concatenate([column[last], column[last]])
            for name, column in vars(known).items()
            if isinstance(column, np.ndarray) and name != "turn_rad"
        }
        columns["t_s"] = np.array([known.t_s[-1], max(now_s, known.t_s[-1] + 0.01)])
        columns["speed_mps"] = np.zeros(2)
        columns["motion"] = np.zeros(2, np.int8)
        self._path = replace(known, **columns, max_gap_s=np.inf)

    def _add_heights(self, t_s: FloatArray, en_m: FloatArray, height_m: FloatArray) -> None:
        """The slope of the ground from the heights of the last minute."""
        old = self._heights
        new = t_s > (old[-1, 0] if len(old) else -np.inf)
        rows = np.concatenate([old, np.column_stack([t_s, en_m, height_m])[new]])
        self._heights = rows = rows[rows[:, 0] > t_s[-1] - SLOPE_S]
        # Neighbours in time share their error: one position in a second counts.
        weight = 1.0 / (SLOPE_HEIGHT_SIGMA_M**2 * max(1.0, len(rows) / max(1.0, rows[-1, 0] - rows[0, 0])))
        design = np.column_stack([np.ones(len(rows)), rows[:, 1:3] - rows[-1, 1:3]])
        normal = weight * design.T @ design + np.diag([1e-6, SLOPE_SIGMA**-2, SLOPE_SIGMA**-2])
        covariance = np.linalg.inv(normal)
        self._slope = (covariance @ (weight * design.T @ (rows[:, 3] - rows[-1, 3])))[1:]
        self._slope_sigma = np.sqrt(np.diag(covariance)[1:])


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


@numba.njit(cache=True, nogil=True)
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
