"""Frames: images whose camera and pose are known."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from furrowmap.core.runtime.arrays import FloatArray
from furrowmap.core.runtime.errors import Notice
from furrowmap.core.values.camera import Camera
from furrowmap.core.values.clock import iso_utc
from furrowmap.core.values.images import ImageFile, Images
from furrowmap.core.values.trajectory import Trajectory


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

    def selected(self, index: NDArray[np.intp] | NDArray[np.bool_]) -> "FramePoses":
        """Some of the poses, by a mask (n,) or their indices."""
        return FramePoses(self.t_s[index], self.xyz_m[index], self.rotation[index], self.scale)

    def in_frame(self, k: int, xyz_m: FloatArray) -> FloatArray:
        """Map coordinates (m, 3) in the optical frame of an image."""
        offset = (xyz_m - self.xyz_m[k]) / [self.scale, self.scale, 1.0]
        out: FloatArray = offset @ self.rotation[k]
        return out


def frame_poses(trajectory: Trajectory, camera: Camera, t_s: FloatArray, scale: float = 1.0) -> FramePoses:
    """Poses of the optical frame, by its mounting and the delay of its shutter, for images at stated times (n,) UTC."""
    exposed_s = t_s + camera.shutter_delay_s
    vehicle = trajectory.at(exposed_s)
    known = np.isfinite(vehicle.quaternion[:, 0])
    xyz = np.full((len(t_s), 3), np.nan)
    rotation = np.full((len(t_s), 3, 3), np.nan)
    if known.any():
        turn = Rotation.from_quat(vehicle.quaternion[known], scalar_first=True).as_matrix()
        lever = np.array([scale, scale, 1.0]) * (turn @ np.asarray(camera.xyz_m))
        xyz[known] = vehicle.xyz_m[known] + lever
        rotation[known] = turn @ camera.mounting.rotation
    return FramePoses(exposed_s, xyz, rotation, scale)


@dataclass(frozen=True)
class Frames:
    """Images of one camera in the order of time, each with a pose of the optical frame in the map frame."""

    paths: tuple[ImageFile, ...]
    camera: Camera
    poses: FramePoses

    def __post_init__(self) -> None:
        if len(self.paths) != len(self.poses) or not bool(self.poses.known.all()):
            raise ValueError("Frames needs a pose for each image")

    def __len__(self) -> int:
        return len(self.paths)

    def selected(self, which: NDArray[np.bool_] | Sequence[int]) -> "Frames":
        """Some of the frames, by a mask (n,) or their increasing indices."""
        index = np.arange(len(self))[np.asarray(which)]
        return Frames(tuple(self.paths[k] for k in index), self.camera, self.poses.selected(index))


def frames_along(
    images: Images, camera: Camera, trajectory: Trajectory, scale: float
) -> tuple[Frames | None, list[Notice]]:
    """The images that were taken at times of a trajectory; None without any, a notice for those without a pose."""
    poses = frame_poses(trajectory, camera, images.t_s, scale)
    known = poses.known
    notices = []
    if not known.all():
        first = int(np.argmin(known))
        begin_s, end_s = trajectory.span_s
        notices.append(
            Notice(
                "images-without-pose",
                known=int((~known).sum()),
                images=len(images),
                paths=images.paths[first].name,
                image_time=iso_utc(float(images.t_s[first])),
                begin=iso_utc(begin_s),
                end=iso_utc(end_s),
            )
        )
    if not known.any():
        return None, notices
    return Frames(tuple(images.paths[k] for k in np.flatnonzero(known)), camera, poses.selected(known)), notices
