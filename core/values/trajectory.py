"""Position and attitude of the vehicle as a function of time, and at each scan."""

from dataclasses import dataclass, replace
from enum import IntEnum
from functools import cached_property
from typing import Any, Final

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial.transform import Rotation

from furrowmap.core.runtime import arrays
from furrowmap.core.runtime.arrays import FloatArray, check_columns
from furrowmap.core.values.rotation import attitude_to_quaternion, quaternion_to_attitude


class Motion(IntEnum):
    """Direction of driving; the sign is that of the speed."""

    REVERSE = -1
    STANDING = 0
    FORWARD = 1

    @property
    def label(self) -> str:
        """Name in files and reports."""
        return self.name.lower()


SIGMA_NAMES: Final = ("e_m", "n_m", "h_m", "roll_deg", "pitch_deg", "heading_deg")
"""The columns of :attr:`Trajectory.sigma`."""
SOURCE_NAMES: Final = ("heading_from", "position_from", "height_from", "level_from")
"""Names of the attributes with the source of each unknown."""


@dataclass(frozen=True)
class Poses:
    """Poses of the vehicle frame in the map frame at given times; nan where there is none.

    Its origin is (n, 3) easting, northing, height; quaternions (n, 4) (w, x, y, z) lead from vehicle to map.
    """

    xyz_m: FloatArray
    quaternion: FloatArray

    def attitude_deg(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """(roll_deg, pitch_deg, heading_deg), each (n,), in the conventions of files; nan where there is no pose."""
        known: NDArray[np.bool_] = np.isfinite(self.quaternion[:, 0])
        out = np.full((3, len(known)), np.nan)
        if known.any():
            out[:, known] = quaternion_to_attitude(self.quaternion[known])
        return out[0], out[1], out[2]


@dataclass(frozen=True)
class Trajectory:
    """Poses of the vehicle frame at knots in time, interpolated between them except across gaps.

    Attributes:
        t_s: (n,) UTC, strictly increasing.
        xyz_m: (n, 3) easting, northing, height of the vehicle frame's origin.
        quaternion: (n, 4) (w, x, y, z) unit quaternions, vehicle to map; neighbours are on the same hemisphere.
        speed_mps: (n,) along the vehicle's x axis, negative in reverse; nan where unknown.
        motion: (n,) int8, values of :class:`Motion`.
        fix: (n,) int8, GNSS quality behind the knot (GGA codes), −1 for poses from a file.
        sigma: (n, 6) standard deviations in the order of :data:`SIGMA_NAMES`; nan where unknown.
        heading_from: (n,) source of the heading ('gnss', 'antennas', 'relief', 'walls', 'standing', 'imu', 'attitude',
            'file').
        position_from: (n,) source of easting and northing ('gnss', 'relief', 'walls', 'carried', 'file').
        height_from: (n,) source of the height ('gnss', 'ground', 'carried', 'file').
        level_from: (n,) source of roll and pitch ('ground', 'imu', 'attitude', 'assumed', 'file').
        max_gap_s: longest time between knots that is interpolated.
    """

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
    max_gap_s: float

    def __post_init__(self) -> None:
        check_columns(self, xyz_m=3, quaternion=4, sigma=6)
        if len(self) and not bool(np.allclose(np.linalg.norm(self.quaternion, axis=1), 1.0, atol=1e-6)):
            raise ValueError("Trajectory.quaternion must hold unit quaternions")

    def __len__(self) -> int:
        return len(self.t_s)

    @property
    def span_s(self) -> tuple[float, float]:
        """UTC of the first and of the last knot; nan without knots."""
        return (float(self.t_s[0]), float(self.t_s[-1])) if len(self) else (float("nan"), float("nan"))

    @property
    def gaps_s(self) -> FloatArray:
        """(m, 2) UTC of the knots before and after each gap."""
        before = np.flatnonzero(np.diff(self.t_s) > self.max_gap_s)
        return np.column_stack([self.t_s[before], self.t_s[before + 1]])

    @cached_property
    def turn_rad(self) -> FloatArray:
        """(n − 1, 3) rotation vector from each knot to the next, in the frame of the earlier one."""

        def turns(part: slice) -> list[FloatArray]:
            rotation = Rotation.from_quat(self.quaternion[part.start : part.stop + 1], scalar_first=True)
            return [(rotation[:-1].inv() * rotation[1:]).as_rotvec()]

        return arrays.in_parts(turns, len(self) - 1)[0] if len(self) > 1 else np.zeros((0, 3))

    def without_accuracy(self) -> "Trajectory":
        """The same poses with unknown standard deviations."""
        return replace(self, sigma=np.full(self.sigma.shape, np.nan))

    def interval(self, t_s: ArrayLike) -> tuple[NDArray[np.intp], FloatArray, NDArray[np.bool_]]:
        """For each time the knot before, the share (0 to 1) of the interval to the next, whether there is a pose."""
        t = np.atleast_1d(np.asarray(t_s, np.float64))
        if len(self) < 2:
            return np.zeros(t.shape, np.intp), np.zeros(t.shape), np.zeros(t.shape, bool)
        k = np.clip(np.searchsorted(self.t_s, t, side="right") - 1, 0, len(self) - 2)
        step = self.t_s[k + 1] - self.t_s[k]
        share = (t - self.t_s[k]) / step
        inside = (share >= 0) & (share <= 1) & ((step <= self.max_gap_s) | (share == 0) | (share == 1))
        return k, share, inside

    def at(self, t_s: ArrayLike) -> Poses:
        """Poses at times (n,), interpolated linearly for positions and spherically (slerp) for attitudes.

        Outside the time span of the knots and inside gaps the pose is nan.
        """
        k, share, known = self.interval(t_s)
        xyz = np.full((len(k), 3), np.nan)
        quaternion = np.full((len(k), 4), np.nan)
        if known.any():
            k = k[known]
            share = share[known]
            xyz[known] = self.xyz_m[k] + share[:, None] * (self.xyz_m[k + 1] - self.xyz_m[k])
            start = Rotation.from_quat(self.quaternion[k], scalar_first=True)
            quaternion[known] = (start * Rotation.from_rotvec(share[:, None] * self.turn_rad[k])).as_quat(
                scalar_first=True
            )
        return Poses(xyz, quaternion)

    def attitude_deg(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """(roll_deg, pitch_deg, heading_deg) of the knots, each (n,)."""
        return quaternion_to_attitude(self.quaternion)


def source_columns(n: int, *words: str | NDArray[np.str_]) -> dict[str, Any]:
    """The attributes :data:`SOURCE_NAMES` of n knots, each from one word or (n,) of them."""
    return {name: np.full(n, word) for name, word in zip(SOURCE_NAMES, words, strict=True)}


def trajectory_from_attitude(
    t_s: FloatArray,
    xyz_m: FloatArray,
    roll_deg: ArrayLike,
    pitch_deg: ArrayLike,
    heading_deg: ArrayLike,
    *,
    max_gap_s: float,
    speed_mps: FloatArray | None = None,
    motion: NDArray[np.int8] | None = None,
) -> Trajectory:
    """A trajectory from attitude in the conventions of files, without fix and sigma; its sources are "file".

    Places (n, 3) are of the vehicle frame's origin in the map frame; an angle is (n,) or a number, a heading clockwise
    from grid north.
    """
    n = len(t_s)
    roll, pitch, heading = (
        np.broadcast_to(np.asarray(a, np.float64), (n,)) for a in (roll_deg, pitch_deg, heading_deg)
    )
    quaternion = attitude_to_quaternion(roll, pitch, heading) if n else np.zeros((0, 4))
    return Trajectory(
        t_s=np.asarray(t_s, np.float64),
        xyz_m=np.asarray(xyz_m, np.float64),
        quaternion=same_hemisphere(quaternion),
        speed_mps=np.full(n, np.nan) if speed_mps is None else speed_mps,
        motion=np.zeros(n, np.int8) if motion is None else motion.astype(np.int8),
        fix=np.full(n, -1, np.int8),
        sigma=np.full((n, 6), np.nan),
        **source_columns(n, "file", "file", "file", "file"),
        max_gap_s=max_gap_s,
    )


def same_hemisphere(quaternion: FloatArray) -> FloatArray:
    """Quaternions (n, 4) with signs chosen so that neighbours differ by less than half a turn of the 4-sphere."""
    if len(quaternion) < 2:
        return quaternion
    flips = np.cumsum(np.einsum("ij,ij->i", quaternion[1:], quaternion[:-1]) < 0) % 2
    out: FloatArray = arrays.copied(quaternion)
    out[1:][flips == 1] *= -1.0
    return out


@dataclass(frozen=True)
class ScanPoses:
    """Pose of the vehicle frame at the middle of each scan that has one, in the order of time.

    Scans without a pose are not included: all positions and attitudes are finite. `scan` (n,) is the index of the scan
    in its recording, `points` (n,) the number of its points in the cloud. The others are as in :class:`Trajectory`.
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
        check_columns(self, "scan", xyz_m=3, quaternion=4, sigma=6)
        for name in ("t_s", "xyz_m", "quaternion"):
            if not bool(np.all(np.isfinite(getattr(self, name)))):
                raise ValueError(f"ScanPoses.{name} is not finite: scans without a pose must not be included")

    @classmethod
    def at_knots(cls, trajectory: Trajectory) -> "ScanPoses":
        """The poses of a trajectory's knots as scans without points, for a recording without scans."""
        columns = {name: column for name, column in vars(trajectory).items() if name in cls.__dataclass_fields__}
        n = len(trajectory)
        return cls(scan=np.arange(n), points=np.zeros(n, np.int64), **columns)

    def __len__(self) -> int:
        return len(self.scan)

    def attitude_deg(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """(roll_deg, pitch_deg, heading_deg), each (n,), in the conventions of files."""
        if not len(self):
            return np.zeros(0), np.zeros(0), np.zeros(0)
        return quaternion_to_attitude(self.quaternion)
