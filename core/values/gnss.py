"""Positions of a GNSS receiver, as recorded and in the map frame."""

from dataclasses import dataclass, replace
from enum import IntEnum
from typing import Any, Final, Self

import numpy as np
from numpy.typing import NDArray

from furrowmap.core.runtime.arrays import FloatArray, check_columns

DRIFT_CORRELATION_S: Final = 60.0
"""Time over which the slowly varying error of GNSS changes (one to two minutes for PPP-RTK and RTK)."""

CREEP_M_RTS: Final = 0.05
"""Way of positions whose antenna stands, per square root of a second, whatever is stated: errors of 0.5 m for 150 s."""


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


ASSUMED_SIGMA_M: Final = {
    Fix.FIXED: 0.015,
    Fix.FLOAT: 0.30,
    Fix.PPP: 0.15,
    Fix.DGPS: 0.60,
    Fix.PPS: 0.60,
    Fix.SINGLE: 2.0,
    Fix.ESTIMATED: 2.0,
    Fix.MANUAL: 2.0,
    Fix.SIMULATED: 0.015,
}
"""Horizontal standard deviation of a position whose receiver states none, by its quality."""


def assumed_sigma_m(fix: NDArray[np.int8]) -> FloatArray:
    """(n,) horizontal standard deviations by :data:`ASSUMED_SIGMA_M` of qualities (n,)."""
    return np.array([ASSUMED_SIGMA_M.get(Fix(each), ASSUMED_SIGMA_M[Fix.SINGLE]) for each in fix.tolist()], np.float64)


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
        age_s: (n,) age of the corrections.
        source: the name of the file or topic, for messages.
        service: correction service, if the file shows it: "rtk", "clas", "madoca", "ppp", "ppp-rtk", "sbas"; "" if
            unknown.
        separation_off_m: by how much the stated geoid separations are off those of a model, where that is too much.
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
    separation_off_m: float = 0.0

    def __post_init__(self) -> None:
        check_columns(self)

    def __len__(self) -> int:
        return len(self.t_s)

    @classmethod
    def columns(cls) -> tuple[str, ...]:
        """Names of the array attributes."""
        return tuple(name for name in cls.__dataclass_fields__ if name not in ("source", "service", "separation_off_m"))

    @classmethod
    def build(
        cls, t_s: NDArray[np.float64], *, source: str = "", service: str = "", **columns: NDArray[np.generic]
    ) -> Self:
        """A track from some of the columns; the others are unknown (nan, −1, fix NONE)."""
        n = len(t_s)
        unknown = {name: np.full(n, np.nan) for name in cls.columns()} | {
            "fix": np.zeros(n),
            "satellites": np.full(n, -1),
        }
        stated = columns | {"t_s": t_s}
        whole: dict[str, Any] = {name: np.asarray(stated.get(name, values)) for name, values in unknown.items()}
        for name, kind in {"t_s": np.float64, "fix": np.int8, "satellites": np.int16}.items():
            whole[name] = whole[name].astype(kind)
        return cls(source=source, service=service, **whole)

    def __getitem__(self, index: slice | NDArray[np.bool_] | NDArray[np.intp]) -> Self:
        """The track of some of its epochs."""
        columns: dict[str, Any] = {name: getattr(self, name)[index] for name in self.columns()}
        return replace(self, **columns)


@dataclass(frozen=True)
class Positions:
    """The antenna's positions that are used, and how good they are.

    Attributes:
        t_s: (m,) UTC, increasing.
        xyz_m: (m, 3) easting, northing, height.
        white_m: (m, 3) noise from position to position.
        drift_m: (m, 3) standard deviation of the slowly varying error.
        run: (m,) counts the runs of equal quality, in which the slowly varying error is continuous.
        fix: (m,) int8 quality.
        yaw_rad: (m,) yaw that two antennas showed; nan elsewhere.
    """

    t_s: FloatArray
    xyz_m: FloatArray
    white_m: FloatArray
    drift_m: FloatArray
    run: NDArray[np.intp]
    fix: NDArray[np.int8]
    yaw_rad: FloatArray
