"""Where the camera was when it took each image."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from furrowmap.core.values.camera import Camera
from furrowmap.core.values.trajectory import Trajectory

FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class FramePoses:
    """Poses of the optical frame in the map frame; nan where there is none.

    Attributes:
        t_s: (n,) UTC of the middle of each exposure.
        xyz_m: (n, 3) float64 projection centre: easting, northing, height.
        rotation: (n, 3, 3) float64 optical frame to map.
        scale: metres of the map for a metre on the ground, horizontally.
    """

    t_s: FloatArray
    xyz_m: FloatArray
    rotation: FloatArray
    scale: float = 1.0

    def __len__(self) -> int:
        return len(self.t_s)

    @property
    def known(self) -> NDArray[np.bool_]:
        """(n,) which have a pose."""
        known: NDArray[np.bool_] = np.isfinite(self.xyz_m[:, 0])
        return known

    def in_frame(self, k: int, xyz_m: FloatArray) -> FloatArray:
        """Map coordinates (m, 3) in the optical frame of an image."""
        offset = (xyz_m - self.xyz_m[k]) / [self.scale, self.scale, 1.0]
        out: FloatArray = offset @ self.rotation[k]
        return out


def frame_poses(trajectory: Trajectory, camera: Camera, t_s: FloatArray, scale: float = 1.0) -> FramePoses:
    """Poses of the optical frame for images.

    Args:
        trajectory: of the vehicle frame.
        camera: its mounting, and the delay of its shutter.
        t_s: (n,) UTC stated for the images.
        scale: metres of the map for a metre on the ground.
    """
    exposed_s = t_s + camera.shutter_delay_s
    vehicle = trajectory.at(exposed_s)
    known = np.isfinite(vehicle.quaternion[:, 0])
    xyz, rotation = np.full((len(t_s), 3), np.nan), np.full((len(t_s), 3, 3), np.nan)
    if known.any():
        turn = Rotation.from_quat(vehicle.quaternion[known], scalar_first=True).as_matrix()
        lever = np.array([scale, scale, 1.0]) * (turn @ np.asarray(camera.xyz_m))
        xyz[known], rotation[known] = vehicle.xyz_m[known] + lever, turn @ camera.mounting.rotation
    return FramePoses(exposed_s, xyz, rotation, scale)
