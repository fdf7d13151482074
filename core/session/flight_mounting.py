"""What the recordings of a flight show about its mounting: the ground below the scanner, and gravity in the IMU."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from furrowmap.core.readers.reader import GivesInertial, GivesScans, ReadOptions
from furrowmap.core.runtime.arrays import FloatArray
from furrowmap.core.session.examination import Examined
from furrowmap.core.values.rotation import Mounting

_LOWEST_FLIGHT_M: Final = 4.5
"""Scanners of ground vehicles are lower than this."""
_EVERY: Final = 10
_MOST_SCANS: Final = 150
"""Of so many scans, ten apart, the ground is used: two minutes of a scanner that turns ten times a second."""
_FEWEST_SCANS: Final = 10
_NEAREST_M: Final = 1.0
"""Returns nearer than this are the vehicle's own."""
_FIT_ROUNDS: Final = 4
_NEAR_PLANE_M: Final = 0.5
_MOMENT_S: Final = 0.1
"""Specific forces are averaged over twice this around the time of a scan."""
LOOKS: Final = ("forward", "left", "backward", "right")


@dataclass(frozen=True)
class FlownMounting:
    """How a flight's sensors were turned, by the ground in the scans and by gravity in the IMU.

    Attributes:
        height_m: median height of the scanner above the ground.
        lidar_up, imu_up: (3,) mean upward direction in the axes of the scanner and of the IMU, at the scans used.
    """

    height_m: float
    lidar_up: FloatArray
    imu_up: FloatArray

    @property
    def imu_rpy_deg(self) -> tuple[float, float, float]:
        """Quarter turns that put the axis of the IMU that is nearest to the upright upright, without a yaw."""
        axis = int(np.argmax(np.abs(self.imu_up)))
        up = np.where(np.arange(3) == axis, np.sign(self.imu_up), 0.0)
        roll, pitch, _ = levelling_rpy_deg(up, np.array([0.0, 0.0, 1.0]), 0.0)
        return _whole_turn(float(round(roll))), float(round(pitch)), 0.0

    @property
    def looking_axis(self) -> str:
        """The axis of the scanner that lies nearer to the horizontal: z, about which it turns, or x."""
        return "z" if abs(self.lidar_up[2]) < math.sqrt(0.5) else "x"

    def lidar_rpy_deg(self, look: str) -> tuple[float, float, float]:
        """Roll, pitch, yaw of the scanner if :attr:`looking_axis` points to one of :data:`LOOKS`."""
        vehicle_up = Mounting((0.0, 0.0, 0.0), self.imu_rpy_deg).rotation @ self.imu_up
        axis = np.array([0.0, 0.0, 1.0] if self.looking_axis == "z" else [1.0, 0.0, 0.0])
        wanted_deg = 90.0 * LOOKS.index(look)
        yaw_deg = 0.0
        for _ in range(3):  # the mean tilt of the vehicle, by which roll and pitch depend on the yaw, is small
            rpy_deg = levelling_rpy_deg(self.lidar_up, vehicle_up, yaw_deg)
            x, y, _ = Mounting((0.0, 0.0, 0.0), rpy_deg).rotation @ axis
            yaw_deg = (yaw_deg + wanted_deg - math.degrees(math.atan2(y, x)) + 180.0) % 360.0 - 180.0
        roll, pitch, yaw = levelling_rpy_deg(self.lidar_up, vehicle_up, yaw_deg)
        return _whole_turn(round(roll, 1)), round(pitch, 1), _whole_turn(round(yaw, 1))


def levelling_rpy_deg(up: FloatArray, vehicle_up: FloatArray, yaw_deg: float) -> tuple[float, float, float]:
    """Roll and pitch that, with a yaw, turn an upward direction (3,) of a sensor to that of the vehicle (3,)."""
    a, b, c = up / np.linalg.norm(up)
    e, n, h = vehicle_up / np.linalg.norm(vehicle_up)
    cos = math.cos(math.radians(yaw_deg))
    sin = math.sin(math.radians(yaw_deg))
    # as roll and pitch have to turn it
    x = cos * e + sin * n
    y = cos * n - sin * e
    across = math.hypot(b, c)
    roll = (math.acos(min(max(y / across, -1.0), 1.0)) if across > 0.0 else 0.0) - math.atan2(c, b)
    pitch = math.atan2(x, h) - math.atan2(a, b * math.sin(roll) + c * math.cos(roll))
    roll_deg, pitch_deg = ((math.degrees(angle) + 180.0) % 360.0 - 180.0 for angle in (roll, pitch))
    return roll_deg, pitch_deg, yaw_deg


def _whole_turn(angle_deg: float) -> float:
    """180 for -180, 0 for -0."""
    return 180.0 if angle_deg == -180.0 else angle_deg + 0.0


def flight_of(lidar: Sequence[Examined], inertial: Sequence[Examined]) -> FlownMounting | None:
    """The flight that a scanner and an IMU recorded; None where the scanner was as low as on the ground."""
    if not (lidar and inertial):
        return None
    measured = type(inertial[0].reader)([one.path for one in inertial], ReadOptions(near_s=inertial[0].first_s))
    scanned = type(lidar[0].reader)([lidar[0].path], ReadOptions(near_s=lidar[0].first_s))
    if not (isinstance(measured, GivesInertial) and isinstance(scanned, GivesScans)):
        return None
    imu = measured.inertial()
    heights = list[float]()
    lidar_ups = list[FloatArray]()
    imu_ups = list[FloatArray]()
    for scan in scanned.scans():
        if scan.number % _EVERY or not scan.whole:
            continue
        t_s = float(scan.t_s.mean())
        near = slice(*np.searchsorted(imu.t_s, [t_s - _MOMENT_S, t_s + _MOMENT_S]))
        ground = _ground_below(scan.xyz_m.astype(np.float64))
        if ground is not None and near.stop > near.start:
            heights.append(ground[0])
            lidar_ups.append(ground[1])
            imu_ups.append(imu.force_mps2[near].mean(axis=0))
        if len(heights) == _MOST_SCANS:
            break
    height_m = np.array(heights)
    if len(heights) < _FEWEST_SCANS or np.median(height_m) < _LOWEST_FLIGHT_M:
        return None
    flown = height_m > 0.5 * np.median(height_m)  # not while taking off
    lidar_up = np.array(lidar_ups)[flown].mean(axis=0)
    imu_up = np.array(imu_ups)[flown].mean(axis=0)
    return FlownMounting(
        float(np.median(height_m[flown])), lidar_up / np.linalg.norm(lidar_up), imu_up / np.linalg.norm(imu_up)
    )


def _ground_below(xyz_m: FloatArray) -> tuple[float, FloatArray] | None:
    """Height of the scanner above the plane of a scan's returns (n, 3), and the plane's upward normal (3,)."""
    xyz_m = xyz_m[np.linalg.norm(xyz_m, axis=1) > _NEAREST_M]
    kept = xyz_m
    for round_ in range(_FIT_ROUNDS):
        if len(kept) < 100:
            return None
        middle = kept.mean(axis=0)
        normal = np.linalg.eigh(np.cov((kept - middle).T))[1][:, 0]
        reach_m = _NEAR_PLANE_M * 2.0 ** (_FIT_ROUNDS - 1 - round_)
        kept = xyz_m[np.abs((xyz_m - middle) @ normal) < reach_m]
    up = normal if normal @ middle < 0.0 else -normal
    return float(-(up @ middle)), up
