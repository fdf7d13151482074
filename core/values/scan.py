"""One revolution of a spinning LiDAR in the sensor's frame, range offsets of its lasers, and classes of its points."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from enum import IntEnum, StrEnum
from typing import Any, Final, Self

import numpy as np
from numpy.typing import NDArray

from furrowmap.core.runtime.arrays import FloatArray
from furrowmap.core.runtime.kernels import kernel
from furrowmap.core.runtime.languages.texts import Text
from furrowmap.core.values.clock import DAY_S, HOUR_S, WEEK_S

_OFFSETS: Final = (
    (18.0, 1, Text("leap seconds: GPS time taken for UTC")),
    (HOUR_S, 14, Text("a local time taken for UTC")),
    (HOUR_S / 4, 56, Text("a local time taken for UTC")),
    (DAY_S, 7, Text("a wrong date")),
    (1024 * WEEK_S, 2, Text("a GPS week rollover")),
)
"""Step, largest multiple and cause of common clock offsets, most likely first."""
_NAMED_S: Final = 0.6
"""Tolerance of a common offset: clocks without a receiver are up to half a second off."""
_ENOUGH: Final = 0.5
"""Share of the shorter recording that must overlap after an offset for it to be proposed."""


@dataclass(frozen=True)
class ClockReading:
    """The readings of one clock in a file; `note` is its source, and its difference from other clocks."""

    clock: Clock
    first_s: float
    last_s: float
    note: str = ""


def likely_offset(first: ClockReading, second: ClockReading) -> tuple[float, Text] | None:
    """The likely offset of the first clock relative to the second, and its cause, if the recordings do not overlap.

    Returns:
        The most likely cause with which at least half of the shorter recording overlaps, with the multiple that gives
        the largest overlap; None if there is none.
    """
    shorter_s = min(first.last_s - first.first_s, second.last_s - second.first_s)
    for step_s, largest, cause in _OFFSETS:
        # Offsets outside this range give no overlap.
        low_s = first.first_s - second.last_s
        high_s = first.last_s - second.first_s
        numbers = range(max(-largest, math.ceil(low_s / step_s)), min(largest, math.floor(high_s / step_s)) + 1)
        meeting = [n * step_s for n in numbers if n != 0]
        best_s = max(meeting, key=lambda offset_s: (overlap_s(first, second, offset_s), -abs(offset_s)), default=None)
        if best_s is not None and overlap_s(first, second, best_s) >= _ENOUGH * shorter_s:
            return best_s, cause
    return None


def named_offset(offset_s: float) -> Text | None:
    """The common cause of a clock offset, such as leap seconds; None where there is none."""
    for step_s, largest, cause in _OFFSETS:
        number = round(offset_s / step_s)
        if 0 < abs(number) <= largest and abs(offset_s - number * step_s) < _NAMED_S:
            return cause
    return None


def overlap_s(first: ClockReading, second: ClockReading, offset_s: float = 0.0) -> float:
    """Duration of the overlap if the first clock is ahead by `offset_s`; negative: duration of the gap."""
    return min(first.last_s - offset_s, second.last_s) - max(first.first_s - offset_s, second.first_s)


MAX_LASERS: Final = 256
"""Lasers that a uint8 numbers."""


class Clock(StrEnum):
    """The clock that a time comes from."""

    SENSOR_GPS = "sensor-gps"
    """The sensor's own clock, disciplined by a GNSS receiver (PPS and GPRMC)."""
    SENSOR = "sensor"
    """The sensor's own clock without evidence of a receiver, but with stamps that fit the hour of UTC."""
    RECORDER = "recorder"
    """The recording computer's clock."""
    GNSS = "gnss"
    """The GNSS receiver's sentences."""
    STATED = "stated"
    """A trajectory file, or the session."""


_RING_RETURNS: Final = 20
"""Returns of a laser that show whether it keeps its elevation."""
_RING_DEG: Final = 2.0
"""Spread of elevations of a ring, at most: origins beside the centre spread those of near returns by a degree."""

_FALLING_SHARE: Final = 0.75
"""Of the steps from a laser to the next; ranges near the scanner and damage disturb some."""

ARRAYS: Final = ("t_s", "xyz_m", "intensity", "laser", "column", "return_number", "returns")
"""Names of the arrays of a scan."""


@dataclass(frozen=True)
class Scan:
    """The returns of one revolution, cut at an azimuth of the scanner or at a pause, in the order of measurement.

    All arrays have the length n, the number of returns; firings without a return are not included.

    Attributes:
        number: index of the scan in the recording, from 0, incomplete scans included.
        t_s: (n,) float64, UTC of each return's firing (POSIX seconds) by the clock of the recording.
        xyz_m: (n, 3) float32 in the lidar frame.
        intensity: (n,) uint8 or uint16.
        laser: (n,) uint8, index of the laser in the order of elevation, lowest first.
        column: (n,) uint16, column of the range image, from 0: adjacent columns of adjacent lasers are adjacent
            directions. The index of the firing in the scan, shifted by the azimuth of lasers that look aside.
        return_number: (n,) uint8, 1 for the first or only return of a firing.
        returns: (n,) uint8, number of returns of that firing.
        whole: False if the start or end of the recording or a pause cut the revolution short.
        lasers: number of lasers of the scanner; 0 if it is not known.
        scanner: number of the scanner among those of a session, 0 for the first.
    """

    number: int
    t_s: NDArray[np.float64]
    xyz_m: NDArray[np.float32]
    intensity: NDArray[np.uint8] | NDArray[np.uint16]
    laser: NDArray[np.uint8]
    column: NDArray[np.uint16]
    return_number: NDArray[np.uint8]
    returns: NDArray[np.uint8]
    whole: bool = True
    lasers: int = 0
    scanner: int = 0

    def __post_init__(self) -> None:
        n = len(self.t_s)
        for name in ARRAYS:
            if len(getattr(self, name)) != n:
                raise ValueError(f"Scan.{name} has {len(getattr(self, name))} entries where t_s has {n}")
        if self.xyz_m.shape != (n, 3):
            raise ValueError(f"Scan.xyz_m has shape {self.xyz_m.shape}, not ({n}, 3)")

    def __len__(self) -> int:
        return len(self.t_s)

    def __getitem__(self, part: slice | NDArray[np.bool_]) -> Self:
        """Some of the returns under the same number: views of a slice, copies where a mask (n,) is true."""
        parts: dict[str, Any] = {name: getattr(self, name)[part] for name in ARRAYS}
        return replace(self, **parts)

    @classmethod
    def joined(cls, parts: Sequence[Self]) -> Self:
        """The returns of several parts, one after the other, under the number of the first."""
        if len(parts) == 1:
            return parts[0]
        arrays: dict[str, Any] = {name: np.concatenate([getattr(p, name) for p in parts]) for name in ARRAYS}
        return replace(parts[0], **arrays)


def _ring_elevations(scan: Scan) -> tuple[FloatArray, FloatArray]:
    """Median elevation of each laser (k,) with enough returns, and how far half of them spread (k,), in degrees."""
    elevation = np.degrees(np.arctan2(scan.xyz_m[:, 2], np.hypot(scan.xyz_m[:, 0], scan.xyz_m[:, 1])))
    order = np.argsort(scan.laser, kind="stable")
    each = np.split(elevation[order], np.flatnonzero(np.diff(scan.laser[order])) + 1)
    quartiles = [np.percentile(of_one, (25, 50, 75)) for of_one in each if len(of_one) >= _RING_RETURNS]
    low, middle, high = np.array(quartiles, np.float64).reshape(-1, 3).T
    return middle, high - low


def has_rings(scan: Scan) -> bool:
    """Whether lasers keep their elevation while they turn, so that scans are range images; not in a rosette."""
    _, spread = _ring_elevations(scan)
    return not len(spread) or float(np.median(spread)) < _RING_DEG


def counts_from_top(scan: Scan) -> bool:
    """Whether the lasers of a scan are numbered from the highest one."""
    elevation, _ = _ring_elevations(scan)
    return len(elevation) > 2 and has_rings(scan) and float(np.mean(np.diff(elevation) < 0.0)) > _FALLING_SHARE


class PointClass(IntEnum):
    """Class of a point of a run's cloud."""

    OTHER = 1
    """Neither ground nor machine: straw, dust, plants, people, walls."""
    GROUND = 2
    NOISE = 7
    """Isolated in the air, or below the ground."""
    VEHICLE = 64
    IMPLEMENT = 65


@dataclass(frozen=True)
class LaserRanges:
    """By how much ranges of each laser (256,) are too long, with sigmas; 0 and nan where the ground shows nothing."""

    offset_m: FloatArray
    sigma_m: FloatArray

    def corrected(self, scan: Scan) -> Scan:
        """The scan as it is without these errors."""
        return replace(scan, xyz_m=shortened(scan.xyz_m, scan.laser, np.zeros(3), self.offset_m))


def shortened(
    xyz_m: NDArray[np.float32], laser: NDArray[np.uint8], sensor_m: FloatArray, offset_m: FloatArray
) -> NDArray[np.float32]:
    """Returns (n, 3) of a sensor at `sensor_m`, nearer to it by their lasers' constants."""
    # A read-only array is another type to numba: the kernel would be compiled a second time.
    points = np.require(xyz_m, np.float32, ["C", "W"])
    lasers = np.require(laser, np.uint8, ["C", "W"])
    out: NDArray[np.float32] = _shortened(points, lasers, sensor_m, offset_m)
    return out


@kernel()
def _shortened(xyz_m, laser, sensor_m, offset_m):  # type: ignore[no-untyped-def]
    out = np.empty(xyz_m.shape, np.float32)
    for i in range(len(xyz_m)):
        x = xyz_m[i, 0] - sensor_m[0]
        y = xyz_m[i, 1] - sensor_m[1]
        z = xyz_m[i, 2] - sensor_m[2]
        share = offset_m[laser[i]] / max(np.sqrt(x * x + y * y + z * z), 0.1)
        out[i, 0] = xyz_m[i, 0] - share * x
        out[i, 1] = xyz_m[i, 1] - share * y
        out[i, 2] = xyz_m[i, 2] - share * z
    return out
