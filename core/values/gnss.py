"""A GNSS receiver's positions as it stated them."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum
from typing import Self

import numpy as np
from numpy.typing import NDArray


class Fix(IntEnum):
    """Quality of a position, whichever format stated it; up to 8 the codes are those of NMEA 0183's GGA.

    The scale tells how a position came about, not from whom its corrections are (:attr:`GnssTrack.service`): FIXED and
    FLOAT are carrier phase with ambiguities fixed or not, by RTK as by PPP-RTK (CLAS); PPP is precise point positioning
    whose ambiguities are not fixed (MADOCA-PPP); DGPS is code corrected (SLAS, SBAS).
    """

    NONE = 0
    SINGLE = 1
    DGPS = 2
    PPS = 3
    FIXED = 4
    FLOAT = 5
    ESTIMATED = 6
    MANUAL = 7
    SIMULATED = 8
    PPP = 9

    @property
    def label(self) -> str:
        """The word that files and reports use."""
        return self.name.lower()


@dataclass(frozen=True)
class GnssTrack:
    """Positions of one antenna in the order of time; what a receiver did not state is nan.

    All arrays have the length n of the number of epochs.

    Attributes:
        t_s: (n,) UTC, strictly increasing.
        lon_deg, lat_deg: (n,) in the receiver's own datum.
        height_m: (n,) above the ellipsoid.
        fix: (n,) int8, values of :class:`Fix`.
        sigma_e_m, sigma_n_m, sigma_h_m: (n,) standard deviations the receiver stated.
        speed_mps: (n,) over ground.
        course_deg: (n,) over ground, clockwise from true north.
        heading_deg: (n,) of the vehicle from two antennas, clockwise from true north.
        satellites: (n,) int16 used, −1 unknown.
        hdop: (n,).
        age_s: (n,) of the corrections.
        source: the name of the file or topic, for messages.
        service: whose corrections these are, as far as the file says it: "rtk", "clas", "madoca", "ppp", "ppp-rtk",
            "sbas"; "" unknown.
    """

    t_s: NDArray[np.float64]
    lon_deg: NDArray[np.float64]
    lat_deg: NDArray[np.float64]
    height_m: NDArray[np.float64]
    fix: NDArray[np.int8]
    sigma_e_m: NDArray[np.float64]
    sigma_n_m: NDArray[np.float64]
    sigma_h_m: NDArray[np.float64]
    speed_mps: NDArray[np.float64]
    course_deg: NDArray[np.float64]
    heading_deg: NDArray[np.float64]
    satellites: NDArray[np.int16]
    hdop: NDArray[np.float64]
    age_s: NDArray[np.float64]
    source: str = ""
    service: str = ""

    def __post_init__(self) -> None:
        n = len(self.t_s)
        for name in self.columns():
            values = getattr(self, name)
            if values.shape != (n,):
                raise ValueError(f"GnssTrack.{name} has shape {values.shape}, not ({n},)")
        if n > 1 and not bool(np.all(np.diff(self.t_s) > 0)):
            raise ValueError("GnssTrack.t_s does not increase")

    def __len__(self) -> int:
        return len(self.t_s)

    @classmethod
    def columns(cls) -> tuple[str, ...]:
        """Names of the array attributes."""
        return tuple(name for name in cls.__dataclass_fields__ if name not in ("source", "service"))

    @classmethod
    def build(
        cls, t_s: NDArray[np.float64], *, source: str = "", service: str = "", **columns: NDArray[np.generic]
    ) -> Self:
        """A track from the columns at hand; the others are filled with 'unknown' (nan, −1, fix NONE)."""
        n = len(t_s)
        unknown: dict[str, NDArray[np.generic]] = {
            "fix": np.zeros(n, np.int8),
            "satellites": np.full(n, -1, np.int16),
        }
        whole = {
            name: np.asarray(columns.get(name, unknown.get(name, np.full(n, np.nan))))
            for name in cls.columns()
            if name != "t_s"
        }
        whole["fix"] = whole["fix"].astype(np.int8)
        whole["satellites"] = whole["satellites"].astype(np.int16)
        return cls(t_s=np.asarray(t_s, np.float64), source=source, service=service, **whole)

    def __getitem__(self, index: slice | NDArray[np.bool_] | NDArray[np.intp]) -> Self:
        """The track of some of its epochs."""
        columns = {name: getattr(self, name)[index] for name in self.columns()}
        return type(self)(**columns, source=self.source, service=self.service)
