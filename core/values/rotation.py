"""Conventions of rotations, angles and directions, and the mounting of a sensor.

A rotation is a unit quaternion (w, x, y, z) that rotates vehicle (or lidar) coordinates to map (or vehicle)
coordinates. Euler angles are used only in files and mountings.
"""

import math
import warnings
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial.transform import Rotation

from furrowmap.core.runtime.arrays import FloatArray

_WORDS: Final = ("north", "north-east", "east", "south-east", "south", "south-west", "west", "north-west")


def wrap_deg(angle_deg: ArrayLike) -> FloatArray:
    """Angles wrapped to [-180°, 180°)."""
    return (np.asarray(angle_deg, np.float64) + 180.0) % 360.0 - 180.0


def unwrap_deg(angle_deg: ArrayLike) -> FloatArray:
    """A sequence of angles (n,) without jumps across ±180°, so that it can be interpolated or averaged."""
    return np.degrees(np.unwrap(np.radians(np.asarray(angle_deg, np.float64))))


def heading_deg(angle_deg: ArrayLike) -> FloatArray:
    """Angles wrapped to [0°, 360°)."""
    out = np.asarray(angle_deg, np.float64) % 360.0
    return np.where(out >= 360.0, 0.0, out)


def mounting_rotation(roll_deg: float, pitch_deg: float, yaw_deg: float) -> FloatArray:
    """Rotation matrix (3, 3) from sensor to vehicle coordinates, ``Rz(yaw)·Ry(pitch)·Rx(roll)``."""
    matrix: FloatArray = Rotation.from_euler("ZYX", [yaw_deg, pitch_deg, roll_deg], degrees=True).as_matrix()
    return matrix


def attitude_to_quaternion(roll_deg: ArrayLike, pitch_deg: ArrayLike, heading_deg: ArrayLike) -> FloatArray:
    """Quaternions (n, 4) (w, x, y, z), vehicle to map, of attitudes in the conventions of files.

    Args:
        roll_deg: (n,) positive right side down.
        pitch_deg: (n,) positive nose up, which is a negative rotation about the vehicle's y axis.
        heading_deg: (n,) clockwise from grid north; yaw about the map's up axis is 90° − heading.
    """
    roll, pitch, heading = np.broadcast_arrays(
        *(np.atleast_1d(np.asarray(a, np.float64)) for a in (roll_deg, pitch_deg, heading_deg))
    )
    euler = np.column_stack([90.0 - heading, -pitch, roll])
    quaternion: FloatArray = Rotation.from_euler("ZYX", euler, degrees=True).as_quat(scalar_first=True)
    return quaternion


def quaternion_to_attitude(quaternion: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Inverse of :func:`attitude_to_quaternion`: (roll_deg, pitch_deg, heading_deg), each (n,), of (n, 4)."""
    euler: Any = Rotation.from_quat(np.atleast_2d(quaternion), scalar_first=True).as_euler("ZYX", degrees=True)
    return euler[:, 2], -euler[:, 1], heading_deg(90.0 - euler[:, 0])


def quaternion_to_matrix(quaternion: FloatArray) -> FloatArray:
    """Rotation matrices (n, 3, 3) of quaternions (n, 4)."""
    matrix: FloatArray = Rotation.from_quat(np.atleast_2d(quaternion), scalar_first=True).as_matrix()
    return matrix


def compass_direction(east: float, north: float) -> str:
    """The compass direction of a vector, to an eighth of a turn."""
    return _WORDS[round(math.degrees(math.atan2(east, north)) / 45.0) % 8]


@dataclass(frozen=True)
class Mounting:
    """The extrinsic parameters of a sensor: lidar frame → vehicle frame, in which `xyz_m` is the sensor's origin.

    Of roll, pitch, yaw, ``R = Rz(yaw)·Ry(pitch)·Rx(roll)`` rotates lidar to vehicle coordinates.
    """

    xyz_m: tuple[float, float, float] = (0.0, 0.0, 0.0)
    rpy_deg: tuple[float, float, float] = (0.0, 0.0, 0.0)

    def __post_init__(self) -> None:
        if not bool(np.all(np.isfinite([*self.xyz_m, *self.rpy_deg]))):
            raise ValueError(f"a mounting needs finite numbers: {self}")

    @property
    def rotation(self) -> NDArray[np.float64]:
        """Rotation matrix (3, 3), lidar to vehicle coordinates."""
        return mounting_rotation(*self.rpy_deg)

    @classmethod
    def from_rotation(cls, xyz_m: tuple[float, float, float], rotation: NDArray[np.float64]) -> "Mounting":
        """The mounting with this rotation matrix (3, 3), lidar to vehicle coordinates."""
        with warnings.catch_warnings():  # of the angles of a pitch of 90°, which are not unique, any serve
            warnings.simplefilter("ignore", UserWarning)
            yaw, pitch, roll = Rotation.from_matrix(rotation).as_euler("ZYX", degrees=True).tolist()
        return cls(xyz_m, (roll, pitch, yaw))
