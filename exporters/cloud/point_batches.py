"""Batches of points, and packing them into records."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Final

import numba
import numpy as np
from numpy.typing import NDArray

from furrowmap.core.runtime.errors import FurrowmapError
from furrowmap.core.runtime.kernels import kernel_part
from furrowmap.core.values.clock import utc_to_las_time
from furrowmap.exporters.cloud.records import Records, field_type

Whole = NDArray[np.integer[Any]] | int
"""A number for each point of a batch, or one for all."""

STEPS: Final = np.iinfo(np.int32)
LEAST_STEP: Final = float(STEPS.min)
MOST_STEP: Final = float(STEPS.max)
RETURNS: Final = 15
"""The most returns a pulse can have in point formats 6 and up."""


@dataclass(frozen=True)
class PointBatch:
    """Points in any order; all arrays have length n.

    Attributes:
        xyz_m: (n, 3) float64 easting, northing, height relative to `origin_m` of the format.
        t_s: (n,) UTC; seconds of a GPS week for a format with `week_time`.
        intensity: 0 to 65,535.
        return_number: 1 to 15.
        returns: number of returns of the pulse, 1 to 15.
        classification: 0 to 255, after LAS 1.4 table 17.
        point_source_id: 0 to 65,535.
        rgb: (n, 3) red, green, blue, each 0 to 65,535; only for a format with `colour`.
        extra: values of the format's extra dimensions by name.
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

    def part(self, start: int, stop: int) -> "PointBatch":
        """The points from `start` up to but without `stop`."""
        own = {name: _sliced(value, start, stop) for name, value in vars(self).items() if name != "extra"}
        return PointBatch(**own, extra={name: _sliced(v, start, stop) for name, v in self.extra.items()})


def _sliced(values: Any, start: int, stop: int) -> Any:
    return values[start:stop] if isinstance(values, np.ndarray) and values.ndim else values


@dataclass(frozen=True)
class Extent:
    """Statistics of points in a file's header.

    Attributes:
        low: (3,) int64 least X, Y and Z in steps of the coordinates' scale.
        high: (3,) int64 greatest ones.
        by_return: (15,) int64 points with return number 1, 2, ….
        extra: least and greatest value of extra dimensions by name; without those that have no value but nan.
    """

    points: int
    low: NDArray[np.int64]
    high: NDArray[np.int64]
    by_return: NDArray[np.int64]
    first_time: float
    last_time: float
    extra: Mapping[str, tuple[float, float]] = field(default_factory=dict)

    @classmethod
    def at_origin(cls) -> "Extent":
        """The extent of a file without points."""
        return cls(0, np.zeros(3, np.int64), np.zeros(3, np.int64), np.zeros(RETURNS, np.int64), 0.0, 0.0)

    def joined(self, other: "Extent") -> "Extent":
        """The extent of the points of both."""
        ends = {name: (*self.extra.get(name, ()), *other.extra.get(name, ())) for name in {**self.extra, **other.extra}}
        return Extent(
            self.points + other.points,
            np.minimum(self.low, other.low),
            np.maximum(self.high, other.high),
            self.by_return + other.by_return,
            min(self.first_time, other.first_time),
            max(self.last_time, other.last_time),
            {name: (min(values), max(values)) for name, values in ends.items()},
        )


def pack(batch: PointBatch, into: Records, scale_m: float, *, week_time: bool = False) -> Extent:
    """Pack a batch of at least one point into records of :func:`~furrowmap.exporters.cloud.records.held_layout`.

    With `week_time` times are seconds of a GPS week, and are not converted.
    """
    n = len(batch)
    if batch.xyz_m.shape != (n, 3):
        raise ValueError(f"PointBatch.xyz_m has shape {batch.xyz_m.shape}, not ({n}, 3)")
    for name in ("intensity", "classification", "point_source_id"):
        into[name] = _fitting(name, getattr(batch, name), into.dtype[name], n)
    extra = _fill_optional(batch, into)
    by_return = np.zeros(RETURNS + 1, np.int64)
    shift_s = 0.0 if week_time or not n else float(utc_to_las_time(batch.t_s[0]) - batch.t_s[0])
    refused, low, high, ends_s = pack_points(
        np.require(batch.xyz_m, np.float64, ["C", "W"]),
        1.0 / scale_m,
        np.require(batch.t_s, np.float64, ["C", "W"]),
        shift_s,
        np.broadcast_to(_fitting("return_number", batch.return_number, np.dtype(np.uint8), n), n),
        np.broadcast_to(_fitting("returns", batch.returns, np.dtype(np.uint8), n), n),
        tuple(into[name] for name in ("X", "Y", "Z", "bit_fields", "gps_time")),
        by_return,
    )
    if refused >= 0:
        raise _refusal(batch, refused, scale_m)
    seconds = np.array(ends_s)
    if not week_time and (utc_to_las_time(seconds) - seconds != shift_s).any():  # a leap second in between
        into["gps_time"] = utc_to_las_time(batch.t_s)
        seconds = np.array([into["gps_time"].min(), into["gps_time"].max()])
    else:
        seconds += shift_s
    first, last = seconds.tolist()
    return Extent(n, np.array(low, np.int64), np.array(high, np.int64), by_return[1:], first, last, extra)


def _fill_optional(batch: PointBatch, into: Records) -> dict[str, tuple[float, float]]:
    """Fill colour and extra dimensions; the least and greatest values of the latter."""
    names = into.dtype.names or ()
    if ("red" in names) != (batch.rgb is not None):
        raise ValueError("PointBatch.rgb does not match the colour of the format")
    if batch.rgb is not None:
        for i, name in enumerate(("red", "green", "blue")):
            into[name] = _fitting("rgb", batch.rgb[:, i], into.dtype[name], len(batch))
    extra = names[names.index("blue" if "red" in names else "gps_time") + 1 :]
    if set(extra) != set(batch.extra):
        raise ValueError(f"the file has the extra dimensions {sorted(extra)}, the batch {sorted(batch.extra)}")
    ends = {}
    for name in extra:
        values = _fitting(name, batch.extra[name], into.dtype[name], len(batch))
        into[name] = values
        least = np.fmin.reduce(values, axis=None).item()
        greatest = np.fmax.reduce(values, axis=None).item()
        if least == least:  # false for nan alone
            ends[name] = least, greatest
    return ends


def _fitting(name: str, values: Any, dtype: np.dtype[Any], n: int) -> NDArray[Any]:
    """`values` as `dtype`, (n,) or a scalar; raises where a value would change beyond rounding."""
    array = np.asarray(values)
    if array.shape not in ((), (n,)):
        raise ValueError(f"PointBatch.{name} has shape {array.shape}, not ({n},)")
    if dtype.kind in "iu" and not np.can_cast(array.dtype, dtype):
        limits = np.iinfo(dtype)
        if array.dtype.kind not in "iu" or array.min() < limits.min or array.max() > limits.max:
            raise ValueError(f"PointBatch.{name} has values beyond {dtype.name}")
    return array.astype(dtype, copy=False)


def _refusal(batch: PointBatch, i: int, scale_m: float) -> Exception:
    """The error for point `i`."""
    where = ", ".join(f"{v:.10g}" for v in batch.xyz_m[i])
    if not np.isfinite(batch.xyz_m[i]).all() or not np.isfinite(batch.t_s[i]):
        return FurrowmapError("cloud-not-finite", where=where, t_s=batch.t_s[i])
    steps = np.rint(batch.xyz_m[i] / scale_m)
    if steps.min() < STEPS.min or steps.max() > STEPS.max:
        return FurrowmapError("cloud-out-of-range", where=where, farthest_km=STEPS.max * scale_m / 1000)
    return ValueError(f"PointBatch.return_number or .returns is beyond 1 to {RETURNS}")


@kernel_part(
    numba.types.Tuple([numba.int64, *(numba.types.UniTuple(numba.float64, length) for length in (3, 3, 2))])(
        numba.float64[:, ::1],
        numba.float64,
        numba.float64[::1],
        numba.float64,
        numba.types.Array(numba.uint8, 1, "A", readonly=True),
        numba.types.Array(numba.uint8, 1, "A", readonly=True),
        numba.types.Tuple([*map(field_type, (*(numba.int32,) * 3, numba.uint8, numba.float64))]),
        numba.int64[::1],
    )
)
def pack_points(xyz_m, steps_per_m, t_s, shift_s, return_number, returns, fields, by_return):  # type: ignore[no-untyped-def]
    """Fill the fields of coordinates, returns and times, later by a shift, and count points by return number.

    Returns the index of the first invalid point, or −1; the least and greatest steps, and the first and last of `t_s`.
    """
    x, y, z, bit_fields, time = fields
    west = south = bottom = first = np.inf
    east = north = top = last = -np.inf
    for i in range(len(t_s)):
        e = np.rint(xyz_m[i, 0] * steps_per_m)
        n = np.rint(xyz_m[i, 1] * steps_per_m)
        h = np.rint(xyz_m[i, 2] * steps_per_m)
        number = return_number[i]
        of = returns[i]
        # False for nan too.
        within = (
            (LEAST_STEP <= e <= MOST_STEP)
            and (LEAST_STEP <= n <= MOST_STEP)
            and (LEAST_STEP <= h <= MOST_STEP)
            and np.isfinite(t_s[i])
        )
        if not (within and 1 <= number <= 15 and 1 <= of <= 15):
            return i, (west, south, bottom), (east, north, top), (first, last)
        x[i] = np.int64(e)
        y[i] = np.int64(n)
        z[i] = np.int64(h)
        west = min(west, e)
        east = max(east, e)
        south = min(south, n)
        north = max(north, n)
        bottom = min(bottom, h)
        top = max(top, h)
        bit_fields[i] = number | of << 4
        by_return[np.uint64(number)] += 1
        time[i] = t_s[i] + shift_s
        first = min(first, t_s[i])
        last = max(last, t_s[i])
    return -1, (west, south, bottom), (east, north, top), (first, last)
