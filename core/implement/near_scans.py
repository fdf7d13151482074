"""Points near the vehicle in scans spread over a recording."""

from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from furrowmap.core.runtime.kernels import kernel
from furrowmap.core.values.rotation import Mounting
from furrowmap.core.values.scan import Scan

IMAGE_COLUMNS: Final = 720
"""Columns of half a degree in order of azimuth from 0."""


@kernel(inline="always")
def column_of(x, y):  # type: ignore[no-untyped-def]
    """Column of a point by its coordinates in the lidar frame; azimuth grows from x to −y.

    The arc tangent is that of Abramowitz and Stegun (1964), 4.4.49, good to 1e-5 rad.
    """
    a = abs(x)
    b = abs(y)
    if a + b == 0.0:
        return 0
    t = min(a, b) / max(a, b)
    s = t * t
    angle = t * (0.9998660 + s * (-0.3302995 + s * (0.1801410 + s * (-0.0851330 + s * 0.0208351))))
    if b > a:
        angle = 0.5 * np.pi - angle
    if x < 0.0:
        angle = np.pi - angle
    if y > 0.0:
        angle = 2.0 * np.pi - angle
    return min(int(angle * (IMAGE_COLUMNS / (2.0 * np.pi))), IMAGE_COLUMNS - 1)


MAX_IMAGE_ROWS: Final = 40
"""Of scanners with more lasers, every second, third, … is used: an implement is seen well enough by fewer."""


def with_fewer_lasers(scan: Scan) -> Scan:
    """A scan whose lasers are the rows of a range image, from 0."""
    step = 1 + (scan.lasers - 1) // MAX_IMAGE_ROWS
    if step <= 1:
        return scan
    kept = scan[scan.laser % step == 0]
    return replace(kept, laser=kept.laser // np.uint8(step))


def median_image(images: NDArray[np.float32]) -> NDArray[np.float32]:
    """Median range of each pixel of range images (n, lasers, columns); nan where less than half have a return."""
    out: NDArray[np.float32] = np.full(images.shape[1:], np.nan, np.float32)
    seen = np.isfinite(images).sum(axis=0) * 2 > len(images)
    if seen.any():
        out[seen] = np.nanmedian(images[:, seen], axis=0)
    return out


MAX_NEAR_SCANS: Final = 320
MAX_NEAR_POINTS: Final = 16_384
_NEAR_M: Final = np.array([[-9.0, 4.0], [-4.5, 4.5], [-4.0, 4.0]])
"""Where an implement may be: range along x, y and z of the vehicle frame."""
FRONT_M: Final = 4.0
"""What is kept forward of the rear axle, unless an implement reaches farther."""


@dataclass(frozen=True)
class NearScan:
    """The points of one scan near the vehicle.

    Attributes:
        index: of the complete scan in the recording.
        begin_s: UTC of its first return.
        end_s: of its last one.
        clockwise: whether azimuth increases within the scan.
        xyz_m: (n, 3) float32 in the vehicle frame.
        range_m: (n,) float32 from the sensor.
        laser: (n,) uint8.
        column: (n,) int32 of the range image.
    """

    index: int
    begin_s: float
    end_s: float
    clockwise: bool
    first_column: int
    xyz_m: NDArray[np.float32]
    range_m: NDArray[np.float32]
    laser: NDArray[np.uint8]
    column: NDArray[np.int32]

    def image(self, lasers: int) -> NDArray[np.float32]:
        """(lasers, COLUMNS) range image; nan without near points."""
        image: NDArray[np.float32] = np.full((lasers, IMAGE_COLUMNS), np.nan, np.float32)
        image[self.laser, self.column] = self.range_m
        return image


class NearScans:
    """Keeps at most :data:`MAX_NEAR_SCANS` scans, evenly spread over a recording of unknown length.

    They are kept in pairs of successive complete scans, to separate noise from motion. When full, every other pair is
    dropped and the stride doubles. Points are kept as far forward as `front_m`.
    """

    def __init__(self, mounting: Mounting, front_m: float = FRONT_M) -> None:
        self._near_m = _NEAR_M.copy()
        self._near_m[0, 1] = front_m
        self._rotation = np.ascontiguousarray(mounting.rotation)
        self._lever_m = np.asarray(mounting.xyz_m, np.float64)
        self._stride = 2
        self._count = 0
        self.scans: list[NearScan] = []

    def add(self, scan: Scan) -> None:
        """Add a scan; in a long recording most are skipped at no cost."""
        if not scan.whole or not len(scan):
            return
        if len(self.scans) == MAX_NEAR_SCANS:
            self._stride *= 2
            self.scans = [kept for kept in self.scans if kept.index % self._stride < 2]
        if self._count % self._stride < 2:
            self.scans.append(self._near(scan))
        self._count += 1

    def _near(self, scan: Scan) -> NearScan:
        scan = with_fewer_lasers(scan)
        xyz, distance, laser, column, rising = _near_points(
            np.ascontiguousarray(scan.xyz_m, np.float32),
            np.ascontiguousarray(scan.laser, np.uint8),
            self._rotation,
            self._lever_m,
            self._near_m,
        )
        if len(xyz) > MAX_NEAR_POINTS:
            kept = np.linspace(0, len(xyz) - 1, MAX_NEAR_POINTS).astype(np.intp)
            xyz = xyz[kept]
            distance = distance[kept]
            laser = laser[kept]
            column = column[kept]
        span_s = (float(scan.t_s[0]), float(scan.t_s[-1]))
        first = int(column_of(scan.xyz_m[0, 0], scan.xyz_m[0, 1]))
        return NearScan(self._count, *span_s, rising >= 0, first, xyz, distance, laser, column)


@kernel()
def _near_points(xyz_m, laser, rotation, lever_m, near_m):  # type: ignore[no-untyped-def]
    """Points within `near_m`: vehicle coordinates, range, laser, column; and the total change of column."""
    n = len(xyz_m)
    xyz = np.empty((n, 3), np.float32)
    distance = np.empty(n, np.float32)
    lasers = np.empty(n, np.uint8)
    columns = np.empty(n, np.int32)
    count = 0
    rising = 0
    last = -1
    for i in range(n):
        x = xyz_m[i, 0]
        y = xyz_m[i, 1]
        z = xyz_m[i, 2]
        column = column_of(x, y)
        if last >= 0 and abs(column - last) < IMAGE_COLUMNS // 2:
            rising += column - last
        last = column
        inside = True
        for k in range(3):
            v = rotation[k, 0] * x + rotation[k, 1] * y + rotation[k, 2] * z + lever_m[k]
            xyz[count, k] = v
            inside &= near_m[k, 0] < v < near_m[k, 1]
        if inside:
            distance[count] = np.sqrt(x * x + y * y + z * z)
            lasers[count] = laser[i]
            columns[count] = column
            count += 1
    return xyz[:count].copy(), distance[:count].copy(), lasers[:count].copy(), columns[:count].copy(), rising
