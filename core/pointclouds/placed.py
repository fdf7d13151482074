"""Scans placed in the map frame one after another, and what is counted on the way."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from furrowmap.core.pointclouds.placing import Placer
from furrowmap.core.values.clock import iso_utc
from furrowmap.core.values.errors import InputError
from furrowmap.core.values.point_classes import PointClass
from furrowmap.core.values.scan import Scan
from furrowmap.core.values.scan_poses import ScanPoses
from furrowmap.core.values.trajectory import Motion, Trajectory

DISORDER_S: Final = 0.5
"""Scans may begin this much before the one before them ends: packets come out of order, files do not."""


@dataclass(frozen=True)
class PlacedScan:
    """The points of one scan that have a pose.

    Attributes:
        scan: the points as measured.
        xyz_m: (n, 3) float64 easting, northing, height less the placer's local origin.
        classification: (n,) uint8, :class:`~furrowmap.core.values.point_classes.PointClass` as far as the scan alone
            shows it: the machine, noise, and all else "other".
    """

    scan: Scan
    xyz_m: NDArray[np.float64]
    classification: NDArray[np.uint8]

    @property
    def kept(self) -> NDArray[np.bool_]:
        """(n,) which points may lie on the land: neither of the machine nor noise."""
        kept: NDArray[np.bool_] = self.classification == PointClass.OTHER
        return kept


@dataclass(frozen=True)
class Tally:
    """What became of a recording's scans and points.

    Attributes:
        scans: of the recording, cut ones included.
        scans_whole: of them, those that are whole revolutions.
        scans_without_pose: not a single point of which could be placed.
        scans_standing: left out because the vehicle stood.
        points_read: returns in the recording.
        points: in the cloud.
        points_without_pose: at times without a pose.
        points_outside: of them, before the trajectory begins or after it ends.
        points_standing: left out because the vehicle stood.
        first_s: time of the first return by the trajectory's clock; nan without any.
        last_s: time of the last one.
        poses: of the scans that have one.
    """

    scans: int
    scans_whole: int
    scans_without_pose: int
    scans_standing: int
    points_read: int
    points: int
    points_without_pose: int
    points_outside: int
    points_standing: int
    first_s: float
    last_s: float
    poses: ScanPoses

    @classmethod
    def without_scans(cls, trajectory: Trajectory) -> Tally:
        """No scans, and the poses of a trajectory's knots."""
        first_s, last_s = trajectory.span_s
        return cls(0, 0, 0, 0, 0, 0, 0, 0, 0, first_s, last_s, ScanPoses.at_knots(trajectory))


def unclassified(scan: Scan) -> NDArray[np.uint8]:
    """The classes (n,) of a scan's points where nothing is known of them."""
    return np.full(len(scan), PointClass.OTHER, np.uint8)


def place_scans(
    scans: Iterable[Scan],
    placer: Placer,
    *,
    standing: bool,
    sink: Callable[[PlacedScan], None],
    classify: Callable[[Scan], NDArray[np.uint8]] = unclassified,
) -> Tally:
    """Place every scan and hand it to `sink`, in order; nothing but the scans' poses is kept.

    Args:
        scans: in the order of time.
        placer: trajectory and mounting.
        standing: whether scans taken at a stand go to `sink`.
        sink: takes the points of each scan that has any.
        classify: gives the classes of a scan's points.

    Raises:
        InputError: if time runs back from one scan to the next.
    """
    number, t_mid, placed_points = [], [], []
    whole = without_pose = stood = read = points_lost = points_outside = points_stood = total = 0
    begin_s, end_s = placer.trajectory.span_s
    first_s = last_s = float("nan")
    for scan in scans:
        total += 1
        whole += scan.whole
        read += len(scan)
        if not len(scan):
            continue
        t_s = scan.t_s
        if t_s[0] < last_s - DISORDER_S:
            raise _runs_back(scan.number, float(t_s[0]), last_s)
        first_s = first_s if np.isfinite(first_s) else float(t_s[0])
        last_s = float(t_s[-1])
        xyz, known = placer.place(scan)
        classification = classify(scan)
        count = int(np.count_nonzero(known))
        points_lost += len(scan) - count
        if count < len(scan):
            points_outside += int(np.count_nonzero((t_s < begin_s) | (t_s > end_s)))
        if not count:
            without_pose += 1
            continue
        if count < len(scan):
            scan, xyz, classification = _part(scan, known), xyz[known], classification[known]
        middle_s = _middle_s(scan.t_s, placer.trajectory)
        number.append(scan.number)
        t_mid.append(middle_s)
        if not standing and _nearest_motion(placer.trajectory, middle_s) == Motion.STANDING:
            stood += 1
            points_stood += count
            placed_points.append(0)
            continue
        placed_points.append(count)
        sink(PlacedScan(scan, xyz, classification))
    return Tally(
        scans=total,
        scans_whole=whole,
        scans_without_pose=without_pose,
        scans_standing=stood,
        points_read=read,
        points=sum(placed_points),
        points_without_pose=points_lost,
        points_outside=points_outside,
        points_standing=points_stood,
        first_s=first_s,
        last_s=last_s,
        poses=_poses(placer.trajectory, number, t_mid, placed_points),
    )


def _runs_back(number: int, at_s: float, last_s: float) -> InputError:
    return InputError(
        f"Scan {number} is of {iso_utc(at_s)}, but the one before it ends at {iso_utc(last_s)}.",
        "Time runs back, so the files of the recording are not in its order, or one of them is there twice.",
        "Name them in `[recording] lidar` in the order of time; `furrowmap inspect` says when each begins.",
        code="scans-not-in-order",
    )


def _part(scan: Scan, kept: NDArray[np.bool_]) -> Scan:
    names = ("t_s", "xyz_m", "intensity", "laser", "column", "return_number", "returns")
    return replace(scan, **{name: getattr(scan, name)[kept] for name in names})


def _middle_s(t_s: NDArray[np.float64], trajectory: Trajectory) -> float:
    """The middle of a scan's time; where a gap lies there, the time of its middle point, which has a pose."""
    middle = 0.5 * float(t_s[0] + t_s[-1])
    return middle if bool(trajectory.interval(middle)[2][0]) else float(t_s[len(t_s) // 2])


def _nearest_motion(trajectory: Trajectory, t_s: float) -> int:
    k, share, _ = trajectory.interval(t_s)
    return int(trajectory.motion[k[0] + int(share[0] > 0.5)])


def _poses(trajectory: Trajectory, number: list[int], t_s: list[float], points: list[int]) -> ScanPoses:
    t = np.asarray(t_s, np.float64)
    k, share, _ = trajectory.interval(t) if len(t) else (np.zeros(0, np.intp), np.zeros(0), None)
    nearest = k + (share > 0.5)
    poses = trajectory.at(t)
    return ScanPoses(
        scan=np.asarray(number, np.int64),
        t_s=t,
        xyz_m=poses.xyz_m,
        quaternion=poses.quaternion,
        speed_mps=trajectory.speed_mps[nearest],
        motion=trajectory.motion[nearest],
        fix=trajectory.fix[nearest],
        sigma=trajectory.sigma[nearest],
        heading_from=trajectory.heading_from[nearest],
        position_from=trajectory.position_from[nearest],
        height_from=trajectory.height_from[nearest],
        level_from=trajectory.level_from[nearest],
        points=np.asarray(points, np.int64),
    )
