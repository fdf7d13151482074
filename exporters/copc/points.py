"""Points as they are handed over, and as LAS 1.4 records."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Final

import numba
import numpy as np
from numpy.typing import NDArray

from furrowmap.core.values.clock import utc_to_las_time
from furrowmap.core.values.errors import FurrowmapError

Whole = NDArray[np.integer[Any]] | int
"""One number for each point of a batch, or one for all of them."""
Records = NDArray[np.void]
"""(n,) structured array in the layout of the file's point records."""

STEPS: Final = np.iinfo(np.int32)
RETURNS: Final = 15
"""The most returns a pulse can have in point formats 6 and up."""


@dataclass(frozen=True)
class PointBatch:
    """Points on their way into a file, in any order; all arrays have length n.

    Attributes:
        xyz_m: (n, 3) float64 easting, northing, height less the writer's `origin_m`.
        t_s: (n,) UTC.
        intensity: 0 to 65,535.
        return_number: 1 to 15.
        returns: number of returns of the pulse, 1 to 15.
        classification: 0 to 255, after LAS 1.4 table 17.
        point_source_id: 0 to 65,535.
        rgb: (n, 3) red, green, blue, each 0 to 65,535; only where the writer was told to expect colour.
        extra: values of the writer's extra dimensions by name.
    """

    xyz_m: NDArray[np.float64]
    t_s: NDArray[np.float64]
    intensity: Whole = 0
    return_number: Whole = 1
    returns: Whole = 1
    classification: Whole = 1
    point_source_id: Whole = 0
    rgb: NDArray[np.integer[Any]] | None = None
    extra: Mapping[str, Whole | NDArray[np.floating[Any]]] = field(default_factory=dict)

    def __len__(self) -> int:
        return len(self.t_s)


@dataclass(frozen=True)
class Extent:
    """What a file's header says about its points.

    Attributes:
        points: their number.
        low: (3,) int64 least X, Y and Z in steps of the coordinates' scale.
        high: (3,) int64 greatest ones.
        by_return: (15,) int64 points with return number 1, 2, ….
        first_time: earliest adjusted standard GPS time.
        last_time: latest one.
    """

    points: int
    low: NDArray[np.int64]
    high: NDArray[np.int64]
    by_return: NDArray[np.int64]
    first_time: float
    last_time: float

    @classmethod
    def of_nothing(cls) -> Extent:
        """The extent that any other one joined to it replaces."""
        far = np.full(3, np.iinfo(np.int64).max)
        return cls(0, far, -far, np.zeros(RETURNS, np.int64), float("inf"), float("-inf"))

    def joined(self, other: Extent) -> Extent:
        """The extent of the points of both."""
        return Extent(
            self.points + other.points,
            np.minimum(self.low, other.low),
            np.maximum(self.high, other.high),
            self.by_return + other.by_return,
            min(self.first_time, other.first_time),
            max(self.last_time, other.last_time),
        )


def to_records(batch: PointBatch, layout: np.dtype[np.void], scale_m: float) -> tuple[Records, Extent]:
    """The records of a batch of at least one point, and their extent.

    Args:
        batch: the points.
        layout: of a record, as laspy's point formats have it, extra dimensions last.
        scale_m: length of a step of the coordinates.

    Raises:
        FurrowmapError: if a coordinate or time is no number, or a coordinate too far away for a record.
        ValueError: if arrays disagree in length, a value does not fit its field, or dimensions are missing.
    """
    n = len(batch)
    if batch.xyz_m.shape != (n, 3):
        raise ValueError(f"PointBatch.xyz_m has shape {batch.xyz_m.shape}, not ({n}, 3)")
    steps = np.empty((n, 3), np.int32)
    low, high = np.empty(3, np.int64), np.empty(3, np.int64)
    bad = quantise(np.ascontiguousarray(batch.xyz_m, np.float64), 1.0 / scale_m, steps, low, high)
    if bad >= 0:
        raise _beyond(batch.xyz_m[bad], scale_m)
    time, first, last = _las_time(batch.t_s)

    records = np.zeros(n, layout)
    records["X"], records["Y"], records["Z"] = steps[:, 0], steps[:, 1], steps[:, 2]
    records["gps_time"] = time
    for name in ("intensity", "classification", "point_source_id"):
        records[name] = _fitting(name, getattr(batch, name), layout[name], n)
    number = _fitting("return_number", batch.return_number, layout["bit_fields"], n)
    returns = _fitting("returns", batch.returns, layout["bit_fields"], n)
    for name, values in (("return_number", number), ("returns", returns)):
        if values.min() < 1 or values.max() > RETURNS:
            raise ValueError(f"PointBatch.{name} goes from {values.min()} to {values.max()}, beyond 1 to {RETURNS}")
    records["bit_fields"] = number | (returns << 4)
    _fill_rest(records, batch)
    by_return = np.bincount(np.broadcast_to(number, n), minlength=RETURNS + 1)[1:]
    return records, Extent(n, low, high, by_return, first, last)


def copy_records(source: Records, target: Records) -> None:
    """Copy records as the bytes they are: numpy would copy field by field."""
    target.view(np.uint8)[:] = source.view(np.uint8)


def _fill_rest(records: Records, batch: PointBatch) -> None:
    """Colour and extra dimensions, where the layout has them."""
    names = records.dtype.names or ()
    if ("red" in names) != (batch.rgb is not None):
        raise ValueError("PointBatch.rgb is there in a file without colour, or missing in one with it")
    if batch.rgb is not None:
        for i, name in enumerate(("red", "green", "blue")):
            records[name] = _fitting("rgb", batch.rgb[:, i], records.dtype[name], len(batch))
    extra = names[names.index("blue" if "red" in names else "gps_time") + 1 :]
    if set(extra) != set(batch.extra):
        raise ValueError(f"the file has the extra dimensions {sorted(extra)}, the batch {sorted(batch.extra)}")
    for name in extra:
        records[name] = _fitting(name, batch.extra[name], records.dtype[name], len(batch))


def _fitting(name: str, values: Any, dtype: np.dtype[Any], n: int) -> NDArray[Any]:
    """`values` as `dtype`, (n,) or a scalar, after making sure that none is changed by it beyond rounding."""
    array = np.asarray(values)
    if array.shape not in ((), (n,)):
        raise ValueError(f"PointBatch.{name} has shape {array.shape}, not ({n},)")
    if dtype.kind in "iu" and not np.can_cast(array.dtype, dtype):
        limits = np.iinfo(dtype)
        if array.dtype.kind not in "iu" or array.min() < limits.min or array.max() > limits.max:
            raise ValueError(f"PointBatch.{name} holds what is no {dtype.name}")
    return array.astype(dtype, copy=False)


def _las_time(t_s: NDArray[np.float64]) -> tuple[NDArray[np.float64], float, float]:
    """Adjusted standard GPS time of UTC, with the earliest and the latest."""
    first, last = float(t_s.min()), float(t_s.max())
    if not (np.isfinite(first) and np.isfinite(last)):
        raise FurrowmapError(
            f"The time of point {int(np.argmin(np.isfinite(t_s)))} of a scan is no number.",
            "A point cloud without true times cannot be matched with the trajectory, so none was written.",
            "This is a fault in furrowmap or in a reader of it; please report it with the recording's kind.",
            code="cloud-not-finite",
        )
    first_las, last_las = utc_to_las_time([first, last])
    # Without a leap second in between, each point need not be looked up.
    time = t_s + (first_las - first) if first_las - first == last_las - last else utc_to_las_time(t_s)
    return time, float(time.min()), float(time.max())


def _beyond(xyz_m: NDArray[np.float64], scale_m: float) -> FurrowmapError:
    where = ", ".join(f"{v:.10g}" for v in xyz_m)
    if np.isfinite(xyz_m).all():
        return FurrowmapError(
            f"A point lies {where} m (east, north, up) from the cloud's origin: beyond "
            f"{STEPS.max * scale_m / 1000:,.0f} km.",
            "A LAS file holds coordinates as 32-bit numbers of steps, so the point has no place in it.",
            "Check the trajectory and `[crs] map` of the session: no recording reaches that far.",
            code="cloud-out-of-range",
        )
    return FurrowmapError(
        f"A point has the coordinates {where} m, which are no numbers.",
        "A point without a place has no place in a cloud either, so none was written.",
        "This is a fault in furrowmap or in a reader of it; please report it with the recording's kind.",
        code="cloud-not-finite",
    )


@numba.njit("int64(float64[:, ::1], float64, int32[:, ::1], int64[::1], int64[::1])", cache=True, nogil=True)
def quantise(xyz_m, steps_per_m, steps, low, high):  # type: ignore[no-untyped-def]
    """Round coordinates to whole steps and note the least and greatest; the first point that has none, or −1."""
    low[:] = 2**31 - 1
    high[:] = -(2**31)
    for i in range(len(xyz_m)):
        for j in range(3):
            value = np.rint(xyz_m[i, j] * steps_per_m)
            if not (-2147483648.0 <= value <= 2147483647.0):  # nan fails it as well
                return i
            step = np.int64(value)
            steps[i, j] = step
            low[j] = min(low[j], step)
            high[j] = max(high[j], step)
    return -1
