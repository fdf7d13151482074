"""Positions of a GNSS receiver."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum
from typing import Self

import numpy as np
from numpy.typing import NDArray


class Fix(IntEnum):
    """Quality of a position in all formats; codes up to 8 are those of NMEA 0183's GGA.

    It is the method of positioning, not the source of its corrections (:attr:`GnssTrack.service`): FIXED and FLOAT are
    carrier-phase solutions with fixed or float ambiguities, by RTK or PPP-RTK (CLAS); PPP is precise point positioning
    with float ambiguities (MADOCA-PPP); DGPS uses code corrections (SLAS, SBAS).
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
        """Name in files and reports."""
        return self.name.lower()


@dataclass(frozen=True)
class GnssTrack:
    """Positions of one antenna in the order of time; values that the receiver does not state are nan.

    All arrays have the length n of the number of epochs.

    Attributes:
        t_s: (n,) UTC, strictly increasing.
        lon_deg, lat_deg: (n,) in the datum of the receiver's corrections.
        height_m: (n,) above the ellipsoid.
        fix: (n,) int8, values of :class:`Fix`.
        sigma_e_m, sigma_n_m, sigma_h_m: (n,) standard deviations stated by the receiver.
        speed_mps: (n,) over ground.
        course_deg: (n,) over ground, clockwise from true north.
        heading_deg: (n,) of the vehicle from two antennas, clockwise from true north.
        satellites: (n,) int16, number of satellites used; −1 if unknown.
        hdop: (n,) horizontal dilution of precision.
        age_s: (n,) age of the corrections.
        source: the name of the file or topic, for messages.
        service: correction service, if the file shows it: "rtk", "clas", "madoca", "ppp", "ppp-rtk", "sbas"; "" if
            unknown.
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
        """A track from some of the columns; the others are unknown (nan, −1, fix NONE)."""
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
