"""Mounting of a sensor on the vehicle."""

from __future__ import annotations

import warnings
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from furrowmap.core.values.rotation import mounting_rotation


@dataclass(frozen=True)
class Mounting:
    """The extrinsic parameters of a sensor: lidar frame → vehicle frame.

    Attributes:
        xyz_m: the sensor's origin in the vehicle frame.
        rpy_deg: roll, pitch, yaw; ``R = Rz(yaw)·Ry(pitch)·Rx(roll)`` rotates lidar to vehicle coordinates.
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
    def from_rotation(cls, xyz_m: tuple[float, float, float], rotation: NDArray[np.float64]) -> Mounting:
        """The mounting with this rotation matrix (3, 3), lidar to vehicle coordinates."""
        with warnings.catch_warnings():  # of the angles of a pitch of 90°, which are not unique, any serve
            warnings.simplefilter("ignore", UserWarning)
            yaw, pitch, roll = Rotation.from_matrix(rotation).as_euler("ZYX", degrees=True).tolist()
        return cls(xyz_m, (roll, pitch, yaw))
