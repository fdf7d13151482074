"""Voxels of the vehicle frame occupied by vehicle and implement, learned from scans.

The body of the vehicle appears at constant ranges in every scan. The implement is static in a frame that moves up and
down with it, and occupies all voxels between its working and its lifted position.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import binary_dilation

from furrowmap.core.implement.near_scans import NearScan, median_image
from furrowmap.core.implement.seen_implement import Plane, SeenImplement
from furrowmap.core.implement.views import CUT_M, CUT_PER_M, ground_plane, views_of
from furrowmap.core.pointclouds.placed_scans import unclassified
from furrowmap.core.runtime.kernels import kernel
from furrowmap.core.values.rotation import Mounting
from furrowmap.core.values.scan import PointClass, Scan

NEIGHBOUR_FIRINGS: Final = 2
"""Neighbours are up to this many firings earlier or later, of the same or an adjacent laser."""
NEIGHBOUR_RANGE_M: Final = 0.3
NEIGHBOUR_RANGE_SHARE: Final = 0.02
"""A neighbour supports a return if their ranges differ by less than NEIGHBOUR_RANGE_M plus this share of the range."""
MAX_ISOLATED_SHARE: Final = 1.0 / 3.0
"""With a larger share without neighbours the scan is not a range image: its lasers or firings are unknown."""


def isolated(scan: Scan) -> NDArray[np.bool_]:
    """Which returns (n,) of a scan have no neighbour at a similar range in the range image.

    Outlier removal after Rusu et al. (2008, Robotics and Autonomous Systems 56, 927-941) with neighbours by direction,
    whatever the point spacing. None where the scan is not a range image, as in bags without lasers and times.
    """
    lasers = 1 + int(scan.laser.max(initial=0))
    columns = 1 + int(scan.column.max(initial=0))
    alone: NDArray[np.bool_] = _alone(
        np.ascontiguousarray(scan.xyz_m, np.float32),
        np.ascontiguousarray(scan.laser, np.uint8),
        np.ascontiguousarray(scan.column, np.uint16),
        np.zeros((lasers, columns), np.float32),
    )
    return alone if np.count_nonzero(alone) <= MAX_ISOLATED_SHARE * len(scan) else np.zeros(len(scan), bool)


@kernel()
def _alone(xyz_m, laser, column, image):  # type: ignore[no-untyped-def]
    """Kernel of :func:`isolated`; `image` comes empty."""
    n = len(xyz_m)
    lasers, columns = image.shape
    distance = np.empty(n, np.float32)
    out = np.empty(n, np.bool_)
    for i in range(n):
        x = xyz_m[i, 0]
        y = xyz_m[i, 1]
        z = xyz_m[i, 2]
        distance[i] = np.sqrt(x * x + y * y + z * z)
        image[laser[i], column[i]] = distance[i]
    for i in range(n):
        row = int(laser[i])
        middle = int(column[i])
        own = distance[i]
        near = np.float32(NEIGHBOUR_RANGE_M) + np.float32(NEIGHBOUR_RANGE_SHARE) * own
        first = max(middle - NEIGHBOUR_FIRINGS, 0)
        last = min(middle + NEIGHBOUR_FIRINGS, columns - 1)
        alone = True
        for k in range(first, last + 1):
            if k != middle and abs(image[row, k] - own) < near:
                alone = False
                break
        if alone:
            for other in (row - 1, row + 1):
                if 0 <= other < lasers:
                    for k in range(first, last + 1):
                        if abs(image[other, k] - own) < near:
                            alone = False
                            break
        out[i] = alone
    return out


def classifier(*machines: "MachineVoxels | None") -> Callable[[Scan], NDArray[np.uint8]]:
    """A function from a scan to the classes (n,) uint8 of its points.

    They are VEHICLE, IMPLEMENT, NOISE, else OTHER. `machines` is None for one that is not known.
    """

    def classify(scan: Scan) -> NDArray[np.uint8]:
        classes = unclassified(scan)
        for machine in machines:
            if machine is not None:
                machine.classify(scan, classes)
        np.putmask(classes, isolated(scan) & (classes == _OTHER), PointClass.NOISE)
        return classes

    return classify


VOXEL_M: Final = 0.1
_LOW_M: Final = np.array([-9.0, -4.5, -0.35])
"""Origin of the voxels: behind, to the right, below the ground."""
_SHAPE: Final = (130, 90, 45)
"""Up to 4 m forward of the origin; more where an implement reaches farther."""
_OTHER: Final = np.uint8(PointClass.OTHER)
_STILL_M: Final = 0.03
"""Range tolerance of static pixels: three times the noise of a scanner."""
VEHICLE_SHARE: Final = 0.4
"""Least share of moving scans with static points in a voxel of the vehicle."""
IMPLEMENT_SHARE: Final = 0.15
"""Least share for the implement in its own frame: lower, as reversible ploughs show each side half the time and trailed
tools swing."""
MIN_MACHINE_SCANS: Final = 20
AIRBORNE: Final[Plane] = (-2.0, 0.0, 0.0)
"""Below an aircraft: it is looked for above this plane, and no ground is seen there in flight."""
_STANDS_ROW: Final = round((0.45 - _LOW_M[2]) / VOXEL_M)
"""What reaches below this stands on the ground or works in it: wheels, a levelling board."""


@dataclass(frozen=True)
class MachineVoxels:
    """Voxels of vehicle and implement.

    `classes` (130 or more, 90, 45) uint8 are VEHICLE, IMPLEMENT or OTHER, of voxels of 0.1 m: forward from 9 m behind
    the origin, to the left from 4.5 m to its right, up from 0.35 m below the ground.
    """

    mounting: Mounting
    ground: Plane
    classes: NDArray[np.uint8]

    @cached_property
    def _to_voxels(self) -> NDArray[np.float64]:
        """(3, 4) from lidar coordinates to voxels: the mounting, with heights above the ground plane."""
        level, slope_x, slope_y = self.ground
        upright = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [-slope_x, -slope_y, 1.0]])
        turned = upright @ self.mounting.rotation
        shifted = upright @ np.asarray(self.mounting.xyz_m) - (0.0, 0.0, level) - _LOW_M
        return np.column_stack([turned, shifted]) / VOXEL_M

    def classify(self, scan: Scan, classes: NDArray[np.uint8]) -> None:
        """Set the class (n,) of the points in voxels of the machine to VEHICLE or IMPLEMENT."""
        _look_up(np.ascontiguousarray(scan.xyz_m, np.float32), self._to_voxels, self.classes, classes)


def learn_machine(
    scans: Sequence[NearScan],
    moving: NDArray[np.bool_],
    mounting: Mounting,
    implements: Sequence[SeenImplement],
    ground: Plane | None = None,
) -> MachineVoxels | None:
    """Learn the vehicle and its implements; None with few moving scans, or without ground where the mounting has it.

    `moving` (scans,) says whether the vehicle moved; `ground` is by default the plane of the scans.
    """
    numbers = np.flatnonzero(moving).tolist()
    if len(numbers) < MIN_MACHINE_SCANS:
        return None
    if ground is None:
        ground = implements[0].region.ground if implements else ground_plane(scans)
    if ground is None:
        return None
    lasers = 1 + max(int(scan.laser.max(initial=0)) for scan in scans)
    usual = median_image(np.stack([scans[number].image(lasers) for number in numbers]))
    front_m = max((implement.region.box_m[1] for implement in implements), default=0.0)
    shape = (max(_SHAPE[0], math.ceil((front_m - _LOW_M[0]) / VOXEL_M)), *_SHAPE[1:])
    still = _Counts(ground, shape)
    for number in numbers:
        scan = scans[number]
        there = np.abs(scan.range_m - usual[scan.laser, scan.column]) < _STILL_M
        still.add(scan.xyz_m[there])
    vehicle = still.often(VEHICLE_SHARE)
    classes = np.full(shape, PointClass.OTHER, np.uint8)
    for implement in implements:
        tool = _tool(scans, implement, shape)
        classes[_with_foot(tool)] = PointClass.IMPLEMENT
        vehicle &= ~tool
    classes[_with_foot(vehicle)] = PointClass.VEHICLE
    return MachineVoxels(mounting, ground, classes)


class _Counts:
    """Number of scans with points in each voxel."""

    def __init__(self, ground: Plane, shape: tuple[int, ...]) -> None:
        self._ground = np.array(ground)
        self._last = np.zeros(shape, np.int32)
        self._count = np.zeros(shape, np.int32)
        self._scans = 0

    def add(self, xyz_m: NDArray[np.float32], lowered_m: float = 0.0) -> None:
        """Count the points of a scan, lowered by `lowered_m`."""
        self._scans += 1
        _count(xyz_m, self._ground, lowered_m, self._scans, self._last, self._count)

    def often(self, share: float) -> NDArray[np.bool_]:
        """Voxels occupied in this share of the scans."""
        often: NDArray[np.bool_] = self._count >= max(share * self._scans, 1.0)
        return often


def _tool(scans: Sequence[NearScan], implement: SeenImplement, shape: tuple[int, ...]) -> NDArray[np.bool_]:
    """The voxels of the implement between its positions."""
    region = implement.region
    template = implement.template
    levels = implement.levels
    views = views_of(scans, region.ground, region.box_m)
    heights = views.heights(template, region.still_m)
    counts = _Counts((0.0, 0.0, 0.0), shape)
    for number in np.flatnonzero(heights.sure).tolist():
        height_m = float(heights.height_m[number])
        # A view's heights are above the ground already.
        xyz = views.views[number].xyz_m[views.likely(number, height_m, template, region.still_m)]
        counts.add(xyz, height_m)
    low, high = (round(m / VOXEL_M) for m in (min(levels.low_m, implement.working_m), levels.high_m))
    own = counts.often(IMPLEMENT_SHARE)
    swept = np.zeros(shape, bool)
    for rows in range(low, high + 1):
        swept |= _raise(own, rows)
    return swept


def _raise(voxels: NDArray[np.bool_], rows: int) -> NDArray[np.bool_]:
    """The voxels shifted up."""
    out = np.zeros_like(voxels)
    height = voxels.shape[2]
    out[..., max(rows, 0) : height + min(rows, 0)] = voxels[..., max(-rows, 0) : height - max(rows, 0)]
    return out


def _with_foot(voxels: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """The voxels dilated by one, and extended down through the ground where they reach near it."""
    grown: NDArray[np.bool_] = binary_dilation(voxels, np.ones((3, 3, 3), bool))
    lowest = np.argmax(grown, axis=2)
    stands = grown.any(axis=2) & (lowest <= _STANDS_ROW)
    grown |= stands[..., None] & (np.arange(voxels.shape[2]) < lowest[..., None])
    return grown


@kernel()
def _count(xyz_m, ground, lowered_m, number, last, count):  # type: ignore[no-untyped-def]
    """Count each voxel with points clear of the ground once per scan."""
    for i in range(len(xyz_m)):
        x = xyz_m[i, 0]
        y = xyz_m[i, 1]
        above = xyz_m[i, 2] - ground[0] - ground[1] * x - ground[2] * y
        if above < CUT_M + CUT_PER_M * np.sqrt(x * x + y * y):
            continue
        a = int(np.floor((x - _LOW_M[0]) / VOXEL_M))
        b = int(np.floor((y - _LOW_M[1]) / VOXEL_M))
        c = int(np.floor((above - lowered_m - _LOW_M[2]) / VOXEL_M))
        if 0 <= a < count.shape[0] and 0 <= b < count.shape[1] and 0 <= c < count.shape[2] and last[a, b, c] != number:
            last[a, b, c] = number
            count[a, b, c] += 1


@kernel()
def _look_up(xyz_m, to_voxels, voxels, classes):  # type: ignore[no-untyped-def]
    """Kernel of :meth:`MachineVoxels.classify`, of points in the lidar frame."""
    a0 = to_voxels[0, 0]
    a1 = to_voxels[0, 1]
    a2 = to_voxels[0, 2]
    a3 = to_voxels[0, 3]
    b0 = to_voxels[1, 0]
    b1 = to_voxels[1, 1]
    b2 = to_voxels[1, 2]
    b3 = to_voxels[1, 3]
    c0 = to_voxels[2, 0]
    c1 = to_voxels[2, 1]
    c2 = to_voxels[2, 2]
    c3 = to_voxels[2, 3]
    long, wide, high = voxels.shape
    for i in range(len(xyz_m)):
        x = xyz_m[i, 0]
        y = xyz_m[i, 1]
        z = xyz_m[i, 2]
        a = a0 * x + a1 * y + a2 * z + a3
        if not 0.0 <= a < long:
            continue
        b = b0 * x + b1 * y + b2 * z + b3
        c = c0 * x + c1 * y + c2 * z + c3
        if 0.0 <= b < wide and 0.0 <= c < high:
            voxel = voxels[int(a), int(b), int(c)]
            if voxel != _OTHER:
                classes[i] = voxel
