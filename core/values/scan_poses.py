"""Pose of the vehicle at each scan: the rows of a run's trajectory layer."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from furrowmap.core.values.rotation import quaternion_to_attitude
from furrowmap.core.values.trajectory import Trajectory

FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class ScanPoses:
    """Pose of the vehicle frame at the middle of each scan that has one, in the order of time.

    Scans without a pose are not included: all positions and attitudes are finite.

    Attributes:
        scan: (n,) int64 index of the scan in its recording, strictly increasing.
        t_s: (n,) UTC of the pose.
        xyz_m: (n, 3) easting, northing, height in the map frame.
        quaternion: (n, 4) (w, x, y, z), vehicle to map.
        speed_mps: (n,) along the vehicle's x axis, negative in reverse; nan where unknown.
        motion: (n,) int8, values of :class:`~furrowmap.core.values.trajectory.Motion`.
        fix: (n,) int8, values of :class:`~furrowmap.core.values.gnss.Fix`; −1 for poses from a file.
        sigma: (n, 6) in the order of :data:`~furrowmap.core.values.trajectory.SIGMAS`; nan where unknown.
        heading_from: (n,) source of the heading, as in :class:`~furrowmap.core.values.trajectory.Trajectory`.
        position_from: (n,) source of easting and northing.
        height_from: (n,) source of the height.
        level_from: (n,) source of roll and pitch.
        points: (n,) int64 number of points of the scan in the cloud; 0 if it was not placed.
    """

    scan: NDArray[np.int64]
    t_s: FloatArray
    xyz_m: FloatArray
    quaternion: FloatArray
    speed_mps: FloatArray
    motion: NDArray[np.int8]
    fix: NDArray[np.int8]
    sigma: FloatArray
    heading_from: NDArray[np.str_]
    position_from: NDArray[np.str_]
    height_from: NDArray[np.str_]
    level_from: NDArray[np.str_]
    points: NDArray[np.int64]

    def __post_init__(self) -> None:
        n = len(self.scan)
        widths = {"xyz_m": (n, 3), "quaternion": (n, 4), "sigma": (n, 6)}
        for name in self.__dataclass_fields__:
            shape = getattr(self, name).shape
            if shape != widths.get(name, (n,)):
                raise ValueError(f"ScanPoses.{name} has shape {shape}, not {widths.get(name, (n,))}")
        for name in ("t_s", "xyz_m", "quaternion"):
            if not bool(np.all(np.isfinite(getattr(self, name)))):
                raise ValueError(f"ScanPoses.{name} is not finite: scans without a pose must not be included")
        if n > 1 and not bool(np.all(np.diff(self.scan) > 0)):
            raise ValueError("ScanPoses.scan does not increase")

    @classmethod
    def at_knots(cls, trajectory: Trajectory) -> ScanPoses:
        """The poses of a trajectory's knots as scans without points, for a recording without scans."""
        return cls(
            scan=np.arange(len(trajectory)),
            t_s=trajectory.t_s,
            xyz_m=trajectory.xyz_m,
            quaternion=trajectory.quaternion,
            speed_mps=trajectory.speed_mps,
            motion=trajectory.motion,
            fix=trajectory.fix,
            sigma=trajectory.sigma,
            heading_from=trajectory.heading_from,
            position_from=trajectory.position_from,
            height_from=trajectory.height_from,
            level_from=trajectory.level_from,
            points=np.zeros(len(trajectory), np.int64),
        )

    def __len__(self) -> int:
        return len(self.scan)

    def attitude_deg(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """(roll_deg, pitch_deg, heading_deg), each (n,), in the conventions of files."""
        if not len(self):
            return np.zeros(0), np.zeros(0), np.zeros(0)
        return quaternion_to_attitude(self.quaternion)
