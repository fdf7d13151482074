"""Scans placed in the map frame one after another, and what is counted on the way."""

from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np
from numpy.typing import NDArray

from furrowmap.core.readers.areas.area import Area
from furrowmap.core.runtime.arrays import FloatArray
from furrowmap.core.runtime.errors import InputError
from furrowmap.core.runtime.kernels import count_until, kernel
from furrowmap.core.values.clock import iso_utc
from furrowmap.core.values.rotation import Mounting, quaternion_to_matrix
from furrowmap.core.values.scan import PointClass, Scan
from furrowmap.core.values.trajectory import Motion, ScanPoses, Trajectory


@dataclass(frozen=True)
class Placer:
    """Places points of the lidar frame in the map frame.

    Attributes:
        origin_m: local origin (easting, northing, height) that is taken off the coordinates given out.
        carrier: trajectory of the frame that the mounting refers to, where that is not the vehicle: a moving mount.
        scale: metres of the map for a metre on the ground, by which eastings and northings of ranges are stretched.
    """

    trajectory: Trajectory
    mounting: Mounting
    origin_m: tuple[float, float, float]
    carrier: Trajectory | None = None
    scale: float = 1.0

    @cached_property
    def _knots(self) -> tuple[FloatArray, ...]:
        """Mounting and trajectory as the kernel takes them, positions against the local origin."""
        t = self.trajectory if self.carrier is None else self.carrier
        return (
            np.ascontiguousarray(self.mounting.rotation),
            np.asarray(self.mounting.xyz_m, np.float64),
            np.ascontiguousarray(t.t_s),
            np.ascontiguousarray(t.xyz_m - np.asarray(self.origin_m)),
            np.ascontiguousarray(quaternion_to_matrix(t.quaternion) * [[self.scale], [self.scale], [1.0]]),
            np.ascontiguousarray(t.turn_rad),
        )

    def place(self, scan: Scan) -> tuple[FloatArray, NDArray[np.bool_]]:
        """Map coordinates (n, 3) of a scan's points less `origin_m`, nan without a pose, and (n,) which have one."""
        if len(self.trajectory) < 2:
            return np.full((len(scan), 3), np.nan), np.zeros(len(scan), bool)
        coordinates, known = place_points(
            np.ascontiguousarray(scan.t_s, np.float64),
            np.ascontiguousarray(scan.xyz_m, np.float32),
            *self._knots,
            self.trajectory.max_gap_s,
        )
        return coordinates, known

    def covers(self, t_s: FloatArray) -> bool:
        """Whether times (n,) lie among knots with no gap between, so that each has a pose."""
        knot_s = (self.trajectory if self.carrier is None else self.carrier).t_s
        begin, end = np.searchsorted(knot_s, (t_s.min(), t_s.max()))
        return bool(begin > 0 and end < len(knot_s)) and bool(
            np.diff(knot_s[begin - 1 : end + 1]).max() <= self.trajectory.max_gap_s
        )


@kernel()
def place_points(  # type: ignore[no-untyped-def]
    t_s, xyz_m, mount, lever_m, knot_s, knot_m, knot_rotation, turn_rad, max_gap_s
):
    """Kernel of :meth:`Placer.place`: ``p = X(t) + R(t) (M p_lidar + lever)``.

    Between knots X is straight and ``R(t) = R_k exp(s·ω)``: Rodrigues' formula about the turn ω to the next knot. The
    rows of R that give easting and northing may be multiplied by a scale.
    """
    n = len(t_s)
    m = len(knot_s)
    out = np.empty((n, 3))
    known = np.zeros(n, np.bool_)
    k = 0
    for i in range(n):
        t = t_s[i]
        if not (knot_s[0] <= t <= knot_s[m - 1]):
            out[i] = np.nan
            continue
        if not (knot_s[k] <= t <= knot_s[k + 1]):
            k = min(max(count_until(knot_s, t) - 1, 0), m - 2)
        step = knot_s[k + 1] - knot_s[k]
        share = (t - knot_s[k]) / step
        if step > max_gap_s and 0.0 < share < 1.0:
            out[i] = np.nan
            continue
        px = xyz_m[i, 0]
        py = xyz_m[i, 1]
        pz = xyz_m[i, 2]
        vx = mount[0, 0] * px + mount[0, 1] * py + mount[0, 2] * pz + lever_m[0]
        vy = mount[1, 0] * px + mount[1, 1] * py + mount[1, 2] * pz + lever_m[1]
        vz = mount[2, 0] * px + mount[2, 1] * py + mount[2, 2] * pz + lever_m[2]
        wx = share * turn_rad[k, 0]
        wy = share * turn_rad[k, 1]
        wz = share * turn_rad[k, 2]
        square = wx * wx + wy * wy + wz * wz
        if square > 1e-4:
            angle = np.sqrt(square)
            a = np.sin(angle) / angle
            b = (1.0 - np.cos(angle)) / square
        else:  # Taylor series of the same, good to 1e-15 here
            a = 1.0 - square * (1.0 / 6.0) * (1.0 - square * (1.0 / 20.0))
            b = 0.5 - square * (1.0 / 24.0) * (1.0 - square * (1.0 / 30.0))
        cx = wy * vz - wz * vy
        cy = wz * vx - wx * vz
        cz = wx * vy - wy * vx
        vx += a * cx + b * (wy * cz - wz * cy)
        vy += a * cy + b * (wz * cx - wx * cz)
        vz += a * cz + b * (wx * cy - wy * cx)
        for j in range(3):
            out[i, j] = (
                knot_m[k, j]
                + share * (knot_m[k + 1, j] - knot_m[k, j])
                + knot_rotation[k, j, 0] * vx
                + knot_rotation[k, j, 1] * vy
                + knot_rotation[k, j, 2] * vz
            )
        known[i] = True
    return out, known


DISORDER_S: Final = 0.5
"""Scans may begin this much before the one before them ends: packets come out of order, files do not."""


POINTS_AT_ONCE: Final = 100_000
"""Successive scans go to the sink together, from so many points on: they share what Python takes for each call."""
TOGETHER_S: Final = 2.0
"""Scans that begin so much later than the first of them do not: the vehicle is elsewhere."""
PLACED_AHEAD: Final = 4
"""So many times as many points wait for a sink."""


@dataclass(frozen=True)
class PlacedScan:
    """The points of a scan that have a pose, or of several successive scans of one scanner.

    Attributes:
        scan: with the number of the first one.
        xyz_m: (n, 3) float64 easting, northing, height less the placer's local origin.
        classification: (n,) uint8, :class:`~furrowmap.core.values.scan.PointClass` as far as the scan alone
            shows it: the machine, noise, and all else "other".
        number: (n,) of each point's scan, or one for all.
    """

    scan: Scan
    xyz_m: NDArray[np.float64]
    classification: NDArray[np.uint8]
    number: NDArray[np.uint32] | int

    @cached_property
    def kept(self) -> NDArray[np.bool_]:
        """(n,) which points may lie on the land: neither of the machine nor noise."""
        kept: NDArray[np.bool_] = self.classification == PointClass.OTHER
        return kept


@dataclass(frozen=True, kw_only=True)
class Placement:
    """Counts of a recording's scans and points, and the poses of its scans.

    Attributes:
        scans: in the recording, cut ones included.
        scans_whole: of them, whole revolutions.
        scans_without_pose: of them, those without a pose at any of their points.
        scans_standing: of them, those left out because the vehicle stood.
        points: in the cloud.
        points_without_pose: at times without a pose.
        points_outside: of them, before the trajectory begins or after it ends.
        points_standing: left out because the vehicle stood.
        points_elsewhere: left out because they lie outside the ground to map.
        first_s: time of the first return; nan without any.
        last_s: time of the last return.
        poses: of the first scanner's scans.
        scans_of: scans of each scanner.
        points_of: points in the cloud of each scanner.
    """

    scans: int = 0
    scans_whole: int = 0
    scans_without_pose: int = 0
    scans_standing: int = 0
    points_read: int = 0
    points: int = 0
    points_without_pose: int = 0
    points_outside: int = 0
    points_standing: int = 0
    points_elsewhere: int = 0
    first_s: float
    last_s: float
    poses: ScanPoses
    scans_of: tuple[int, ...] = ()
    points_of: tuple[int, ...] = ()

    @classmethod
    def without_scans(cls, trajectory: Trajectory) -> "Placement":
        """No scans, and the poses of a trajectory's knots."""
        first_s, last_s = trajectory.span_s
        return cls(first_s=first_s, last_s=last_s, poses=ScanPoses.at_knots(trajectory))


def unclassified(scan: Scan) -> NDArray[np.uint8]:
    """Class OTHER (n,) for all points of a scan."""
    return np.full(len(scan), PointClass.OTHER, np.uint8)


def place_scans(
    scans: Iterable[Scan],
    placer: Placer,
    *,
    standing: bool,
    sink: Callable[[PlacedScan], None],
    classify: Callable[[Scan], NDArray[np.uint8]] = unclassified,
    within: Area | None = None,
    further: Sequence[Placer] = (),
) -> Placement:
    """Place every scan and hand all to `sink`, in order; only the poses of the first scanner's scans are kept.

    Args:
        scans: in time order, of one scanner or several.
        placer: of the first scanner.
        standing: whether scans of a standing vehicle go to `sink`.
        sink: takes the points of the scans that have any, of several at once.
        classify: gives the classes of a scan's points.
        within: points elsewhere do not go to `sink`; None for all.
        further: what places the scans of further scanners, with the same trajectory.

    Raises:
        InputError: if time runs back from one scan to the next.
    """
    trajectory = placer.trajectory
    counts = Counter[str]()
    placers = (placer, *further)
    scans_of = [0] * len(placers)
    points_of = [0] * len(placers)
    first_s = last_s = float("nan")
    placed: list[tuple[int, float, int]] = []
    waiting = _Waiting(sink, placers)
    for scan in scans:
        counts.update(scans=1, scans_whole=int(scan.whole), points_read=len(scan))
        scans_of[scan.scanner] += 1
        if not len(scan):
            continue
        scan_s = float(scan.t_s[0])
        if scan_s < last_s - DISORDER_S:
            raise InputError("scans-not-in-order", number=scan.number, time=iso_utc(scan_s), end_before=iso_utc(last_s))
        first_s = first_s if np.isfinite(first_s) else scan_s
        last_s = float(scan.t_s[-1])
        classification = classify(scan)
        if not placers[scan.scanner].covers(scan.t_s):
            known = _points_with_pose(scan, placers[scan.scanner], counts)
            scan = scan[known]
            classification = classification[known]
        if not len(scan):
            continue
        # Where a gap lies in the middle of a scan's time, the time of its middle point, which has a pose.
        middle_s = 0.5 * float(scan.t_s[0] + scan.t_s[-1])
        before, share, has_pose = trajectory.interval(middle_s)
        if not has_pose[0]:
            middle_s = float(scan.t_s[len(scan) // 2])
            before, share, _ = trajectory.interval(middle_s)
        if not standing and trajectory.motion[before[0] + int(share[0] > 0.5)] == Motion.STANDING:
            counts.update(scans_standing=1, points_standing=len(scan))
            if not scan.scanner:
                placed.append((scan.number, middle_s, 0))
            continue
        if within is not None:
            inside = within.contains(placers[scan.scanner].place(scan)[0] + placer.origin_m)
            counts["points_elsewhere"] += len(scan) - int(np.count_nonzero(inside))
            scan = scan[inside]
            classification = classification[inside]
        counts["points"] += len(scan)
        points_of[scan.scanner] += len(scan)
        if not scan.scanner:
            placed.append((scan.number, middle_s, len(scan)))
        if len(scan):
            waiting.add(scan, classification)
    waiting.hand_on()
    return Placement(
        **counts,
        first_s=first_s,
        last_s=last_s,
        poses=_poses(trajectory, placed),
        scans_of=tuple(scans_of),
        points_of=tuple(points_of),
    )


def _points_with_pose(scan: Scan, placer: Placer, counts: Counter[str]) -> NDArray[np.bool_]:
    """Which points (n,) of a scan have a pose; the others are counted."""
    known = placer.place(scan)[1]
    begin_s, end_s = placer.trajectory.span_s
    with_pose = int(np.count_nonzero(known))
    outside = int(np.count_nonzero((scan.t_s < begin_s) | (scan.t_s > end_s)))
    counts.update(
        scans_without_pose=int(not with_pose), points_without_pose=len(scan) - with_pose, points_outside=outside
    )
    return known


class _Waiting:
    """Scans on their way to a sink, which gets those of one scanner placed together, POINTS_AT_ONCE at least."""

    def __init__(self, sink: Callable[[PlacedScan], None], placers: Sequence[Placer]) -> None:
        self._sink = sink
        self._placers = placers
        self._scans = list[Scan]()
        self._classes = list[NDArray[np.uint8]]()
        self._points = 0

    def add(self, scan: Scan, classification: NDArray[np.uint8]) -> None:
        """Take a scan, all points of which have a pose, with their classes (n,)."""
        if self._scans:
            first = self._scans[0]
            if first.scanner != scan.scanner or scan.t_s[0] - first.t_s[0] > TOGETHER_S:
                self.hand_on()
        self._scans.append(scan)
        self._classes.append(classification)
        self._points += len(scan)
        if self._points >= POINTS_AT_ONCE:
            self.hand_on()

    def hand_on(self) -> None:
        """Pass on what waits."""
        if self._scans:
            scan = Scan.joined(self._scans)
            xyz, _ = self._placers[scan.scanner].place(scan)
            numbers = np.array([one.number for one in self._scans], np.uint32)
            number = np.repeat(numbers, [len(one) for one in self._scans]) if len(numbers) > 1 else scan.number
            self._sink(PlacedScan(scan, xyz, np.concatenate(self._classes), number))
            self._scans = []
            self._classes = []
            self._points = 0


def _poses(trajectory: Trajectory, placed: Sequence[tuple[int, float, int]]) -> ScanPoses:
    """Poses of scans, each given with its number, time and points in the cloud."""
    t = np.array([t_s for _, t_s, _ in placed], np.float64)
    k, share, _ = trajectory.interval(t) if len(t) else (np.zeros(0, np.intp), np.zeros(0), None)
    nearest = k + (share > 0.5)
    poses = trajectory.at(t)
    return ScanPoses(
        scan=np.array([number for number, _, _ in placed], np.int64),
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
        points=np.array([points for _, _, points in placed], np.int64),
    )
