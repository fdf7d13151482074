"""Frames: images whose camera and pose are known."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from furrowmap.core.images.frame_poses import FramePoses, frame_poses
from furrowmap.core.runtime.errors import Notice
from furrowmap.core.values.camera import Camera
from furrowmap.core.values.clock import iso_utc
from furrowmap.core.values.images import ImageFile, Images
from furrowmap.core.values.trajectory import Trajectory


@dataclass(frozen=True)
class Frames:
    """Images of one camera in the order of time, each with a pose.

    Attributes:
        paths: of the files, or the images themselves.
        camera: that took them.
        poses: of its optical frame in the map frame.
    """

    paths: tuple[ImageFile, ...]
    camera: Camera
    poses: FramePoses

    def __post_init__(self) -> None:
        if len(self.paths) != len(self.poses) or not bool(self.poses.known.all()):
            raise ValueError("Frames needs a pose for each image")

    def __len__(self) -> int:
        return len(self.paths)

    def selected(self, which: NDArray[np.bool_] | Sequence[int]) -> Frames:
        """Some of the frames, by a mask (n,) or their increasing indices."""
        index = np.arange(len(self))[np.asarray(which)]
        poses = replace(
            self.poses,
            t_s=self.poses.t_s[index],
            xyz_m=self.poses.xyz_m[index],
            rotation=self.poses.rotation[index],
        )
        return Frames(tuple(self.paths[k] for k in index), self.camera, poses)


def frames_along(
    images: Images, camera: Camera, trajectory: Trajectory, scale: float, notices: list[Notice]
) -> Frames | None:
    """The images that were taken at times of a trajectory; None without any.

    Args:
        images: with times by the trajectory's clock.
        camera: that took them.
        trajectory: of the vehicle frame.
        scale: metres of the map for a metre on the ground.
        notices: how many have no pose is added.
    """
    poses = frame_poses(trajectory, camera, images.t_s, scale)
    known = poses.known
    if not known.all():
        first = int(np.argmin(known))
        begin_s, end_s = trajectory.span_s
        notices.append(
            Notice(
                "images-without-pose",
                known=int((~known).sum()),
                images=len(images),
                paths=images.paths[first].name,
                t_s=iso_utc(float(images.t_s[first])),
                begin_s=iso_utc(begin_s),
                end_s=iso_utc(end_s),
            )
        )
    if not known.any():
        return None
    kept = replace(poses, t_s=poses.t_s[known], xyz_m=poses.xyz_m[known], rotation=poses.rotation[known])
    return Frames(tuple(path for path, has in zip(images.paths, known, strict=True) if has), camera, kept)
