"""Conventions of rotations and angles.

A rotation is a unit quaternion (w, x, y, z) that rotates vehicle (or lidar) coordinates to map (or vehicle)
coordinates. Euler angles are used only in files and mountings.
"""

from __future__ import annotations

from typing import Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial.transform import Rotation

FloatArray: TypeAlias = NDArray[np.float64]


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
