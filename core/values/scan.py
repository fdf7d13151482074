"""One revolution of a spinning LiDAR, in the sensor's own frame."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum

import numpy as np
from numpy.typing import NDArray


class Clock(StrEnum):
    """Which clock a time came from."""

    SENSOR_GPS = "sensor-gps"
    """The sensor's own clock, disciplined by a GNSS receiver (PPS and GPRMC)."""
    SENSOR = "sensor"
    """The sensor's own clock where nothing confirms a receiver, but its stamps fit the hour of UTC."""
    RECORDER = "recorder"
    """The recording computer's clock."""
    GNSS = "gnss"
    """The GNSS receiver's sentences."""
    STATED = "stated"
    """A file or its reader's options say so."""


@dataclass(frozen=True)
class Scan:
    """The returns of one revolution, cut at azimuth 0 or at a pause, in the order in which they were measured.

    All arrays have the length n of the number of returns; slots without a return are left out.

    Attributes:
        number: counts the scans of a recording from 0, cut ones included.
        t_s: (n,) float64, UTC of each return's own firing (POSIX seconds), as the sensor's clock had it.
        xyz_m: (n, 3) float32 in the lidar frame.
        intensity: (n,) uint8 or uint16.
        laser: (n,) uint8, index of the laser in the order of elevation, lowest first.
        column: (n,) uint16, firing within the scan, counted from its first firing.
        return_number: (n,) uint8, 1 for the first or only return of a firing.
        returns: (n,) uint8, number of returns of that firing.
        whole: False where a recording's start, end or a pause cut the revolution short.
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

    def __post_init__(self) -> None:
        n = len(self.t_s)
        for name in ("xyz_m", "intensity", "laser", "column", "return_number", "returns"):
            if len(getattr(self, name)) != n:
                raise ValueError(f"Scan.{name} has {len(getattr(self, name))} entries where t_s has {n}")
        if self.xyz_m.shape != (n, 3):
            raise ValueError(f"Scan.xyz_m has shape {self.xyz_m.shape}, not ({n}, 3)")

    def __len__(self) -> int:
        return len(self.t_s)
