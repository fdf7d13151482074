"""A cloud read through: what is in it, and where its header said something else."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from furrowmap.core.readers.las.cloud import CloudFile
from furrowmap.core.readers.las.gps_time import TimeKind
from furrowmap.core.readers.las.points import CloudBatch
from furrowmap.core.values.clock import las_time_to_utc
from furrowmap.core.values.errors import Notice

FloatArray = NDArray[np.float64]


@dataclass
class Survey:
    """What has been seen of a cloud's points.

    Attributes:
        cloud: the file.
        points: seen so far.
        low: (3,) least x, y, z.
        high: (3,) greatest.
        by_return: (16,) points by return number.
        by_class: (256,) points by class.
        withheld: points that the file calls deleted.
        first_time: earliest GPS time as it stands in the file; inf where there is none.
        last_time: latest.
        bad_times: points whose time is none.
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

    def see(self, batch: CloudBatch) -> None:
        """Count the points of a batch."""
        self.points += len(batch)
        self.low = np.minimum(self.low, batch.xyz_m.min(axis=0, initial=np.inf))
        self.high = np.maximum(self.high, batch.xyz_m.max(axis=0, initial=-np.inf))
        self.by_return += np.bincount(batch.return_number, minlength=16)
        self.by_class += np.bincount(batch.classification, minlength=256)
        self.withheld += int(np.count_nonzero(batch.withheld))
        if batch.gps_time is not None and len(batch):
            self.bad_times += int(np.count_nonzero(np.isnan(batch.gps_time)))
            self.first_time = float(np.fmin(self.first_time, np.fmin.reduce(batch.gps_time)))
            self.last_time = float(np.fmax(self.last_time, np.fmax.reduce(batch.gps_time)))

    def notices(self) -> tuple[Notice, ...]:
        """Where header and points differ, once all points have been seen."""
        return tuple(notice for notice in (self._box(), self._returns(), self._times()) if notice is not None)

    def _box(self) -> Notice | None:
        header = self.cloud.header
        if not self.points:
            return None
        off = np.maximum(np.abs(np.subtract(header.low, self.low)), np.abs(np.subtract(header.high, self.high)))
        # A step either way is rounding; so is what a double cannot tell of coordinates that far off.
        slack = 1.5 * np.array(header.scale) + 1e-12 * np.maximum(np.abs(self.low), np.abs(self.high))
        wrong = ~(off <= slack)
        if not wrong.any():
            return None
        said, true = (
            ", ".join(
                f"{axis} {low:.10g} to {high:.10g}"
                for axis, low, high, bad in zip("xyz", *box, wrong, strict=True)
                if bad
            )
            for box in ((header.low, header.high), (self.low, self.high))
        )
        text = (
            f"{self.cloud.path.name}: the header's box is not that of the points: it says {said}; they lie at {true}."
        )
        return Notice("header-box", text)

    def _returns(self) -> Notice | None:
        said = np.zeros(15, np.int64)
        stated = np.minimum(np.array(self.cloud.header.by_return, np.uint64), np.iinfo(np.int64).max).astype(np.int64)
        said[: len(stated)] = stated
        if not self.points or not said.any() or np.array_equal(said, self.by_return[1:]):
            return None
        told = [" + ".join(f"{n:,}" for n in np.trim_zeros(counts, "b")) for counts in (said, self.by_return[1:])]
        none = f" and {self.by_return[0]:,} have return number 0" if self.by_return[0] else ""
        text = (
            f"{self.cloud.path.name}: points by return number are {told[0]} in the header; counted are "
            f"{told[1] or 'none'}{none}."
        )
        return Notice("returns-differ", text)

    def _times(self) -> Notice | None:
        if not self.bad_times or self.cloud.clock.kind is TimeKind.UNKNOWN:  # told when the file was opened
            return None
        text = (
            f"{self.cloud.path.name}: {self.bad_times:,} of {self.points:,} points have a GPS time that is none "
            f"(no number, or no {self.cloud.clock.kind} at all); they are kept without time."
        )
        return Notice("gps-times-bad", text)

    @property
    def utc_s(self) -> tuple[float, float] | None:
        """Earliest and latest UTC; None where the file tells no date."""
        if self.cloud.clock.kind is not TimeKind.STANDARD or self.first_time > self.last_time:
            return None
        first, last = las_time_to_utc([self.first_time, self.last_time]).tolist()
        return first, last


def survey(cloud: CloudFile) -> Survey:
    """Read a cloud through.

    Raises:
        InputError: if its points turn out to be damaged.
    """
    found = Survey(cloud)
    for batch in cloud.batches():
        found.see(batch)
    return found
