"""Statistics over all points of a cloud, compared with its header."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from furrowmap.core.readers.las.cloud import CloudFile
from furrowmap.core.readers.las.gps_time import TimeKind
from furrowmap.core.readers.las.points import CloudBatch
from furrowmap.core.runtime.arrays import FloatArray
from furrowmap.core.runtime.errors import Notice
from furrowmap.core.values.clock import las_time_to_utc
from furrowmap.core.values.extents import bounds


@dataclass
class Survey:
    """Statistics over the points of a cloud.

    Attributes:
        points: number of points so far.
        low: (3,) minimum x, y, z.
        high: (3,) maximum x, y, z.
        by_return: (16,) number of points by return number.
        by_class: (256,) number of points by class.
        withheld: number of points marked as deleted.
        first_time: earliest GPS time as in the file; inf without times.
        last_time: latest; -inf without times.
        bad_times: number of points with an invalid time.
    """

    cloud: CloudFile
    points: int = 0
    low: FloatArray = field(default_factory=lambda: np.full(3, np.inf))
    high: FloatArray = field(default_factory=lambda: np.full(3, -np.inf))
    by_return: NDArray[np.int64] = field(default_factory=lambda: np.zeros(16, np.int64))
    by_class: NDArray[np.int64] = field(default_factory=lambda: np.zeros(256, np.int64))
    withheld: int = 0
    first_time: float = np.inf
    last_time: float = -np.inf
    bad_times: int = 0

    def add(self, batch: CloudBatch) -> None:
        """Add the points of a batch."""
        self.points += len(batch)
        if len(batch):
            low, high = bounds(batch.xyz_m)
            self.low, self.high = np.minimum(self.low, low), np.maximum(self.high, high)
        self.by_return += np.bincount(batch.return_number, minlength=16)
        self.by_class += np.bincount(batch.classification, minlength=256)
        self.withheld += int(np.count_nonzero(batch.withheld))
        if batch.gps_time is not None and len(batch):
            self.bad_times += int(np.count_nonzero(np.isnan(batch.gps_time)))
            self.first_time = float(np.fmin(self.first_time, np.fmin.reduce(batch.gps_time)))
            self.last_time = float(np.fmax(self.last_time, np.fmax.reduce(batch.gps_time)))

    def notices(self) -> tuple[Notice, ...]:
        """Lost points, and differences between header and points, once all points have been added."""
        cloud, header = self.cloud, self.cloud.header
        found = list(dict.fromkeys(cloud.lost))
        off = np.maximum(np.abs(np.subtract(header.low, self.low)), np.abs(np.subtract(header.high, self.high)))
        # One step of the scale is rounding, and so is the resolution of a double for large coordinates.
        slack = 1.5 * np.array(header.scale) + 1e-12 * np.maximum(np.abs(self.low), np.abs(self.high))
        wrong = ~(off <= slack)
        if self.points and wrong.any():
            in_header, in_points = (
                ", ".join(
                    f"{axis} {low:.10g} to {high:.10g}"
                    for axis, low, high, bad in zip("xyz", *box, wrong, strict=True)
                    if bad
                )
                for box in ((header.low, header.high), (self.low, self.high))
            )
            found.append(Notice("header-box", cloud=cloud.path.name, in_header=in_header, in_points=in_points))
        in_header_by_return = np.zeros(15, np.int64)
        stated = np.minimum(np.array(header.by_return, np.uint64), np.iinfo(np.int64).max).astype(np.int64)
        in_header_by_return[: len(stated)] = stated
        counts = in_header_by_return, self.by_return[1:]
        if self.points and stated.any() and not np.array_equal(*counts):
            listed = [" + ".join(f"{n:,}" for n in np.trim_zeros(numbers, "b")) for numbers in counts]
            found.append(
                Notice(
                    "returns-differ",
                    cloud=cloud.path.name,
                    listed=listed[0],
                    listed_2=listed[1] or "none",
                    by_return=self.by_return[0] or None,
                )
            )
        if self.bad_times and cloud.clock.kind is not TimeKind.UNKNOWN:  # that has a notice since the file was opened
            found.append(
                Notice(
                    "gps-times-bad",
                    cloud=cloud.path.name,
                    bad_times=self.bad_times,
                    points=self.points,
                    kind=cloud.clock.kind,
                )
            )
        return tuple(found)

    @property
    def utc_s(self) -> tuple[float, float] | None:
        """Earliest and latest UTC; None if the file has no date."""
        if self.cloud.clock.kind is not TimeKind.STANDARD or self.first_time > self.last_time:
            return None
        first, last = las_time_to_utc([self.first_time, self.last_time]).tolist()
        return first, last


def survey(cloud: CloudFile) -> Survey:
    """Statistics over all points of a cloud.

    Raises:
        InputError: if its points are damaged.
    """
    found = Survey(cloud)
    for batch in cloud.batches():
        found.add(batch)
    return found
