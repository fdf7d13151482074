"""Point records as arrays, and the meaning of their GPS times, from the header and the first points."""

import datetime as dt
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from furrowmap.core.readers.las.header import LasHeader
from furrowmap.core.runtime.arrays import FloatArray
from furrowmap.core.runtime.errors import Notice
from furrowmap.core.values.clock import DAY_S, GPS_EPOCH_S, LAS_STANDARD_OFFSET_S, WEEK_S, las_time_to_utc

TIME_SAMPLE: Final = 1024
"""Number of points at the start of a file from which the meaning of its times is derived."""
_FIRST_STANDARD: Final = -LAS_STANDARD_OFFSET_S
_LAST_UTC: Final = dt.datetime(2100, 1, 1, tzinfo=dt.UTC).timestamp()
_LAST_STANDARD: Final = _LAST_UTC - GPS_EPOCH_S - LAS_STANDARD_OFFSET_S
_EARLIEST_UTC: Final = dt.datetime(1993, 1, 1, tzinfo=dt.UTC).timestamp()
"""Before airborne laser scanning with GPS. (A time of 0 as adjusted standard time is in September 2011.)"""


class TimeKind(StrEnum):
    """Meaning of the field `gps_time`."""

    NONE = "none"
    WEEK = "seconds of a GPS week"
    STANDARD = "adjusted standard GPS time"
    UNKNOWN = "neither week nor standard time"

    def checked(self, las_time: NDArray[np.float64]) -> FloatArray:
        """The times (n,), nan where they are not valid for their kind."""
        good = _is_week(las_time) if self is TimeKind.WEEK else _is_standard(las_time)
        return np.asarray(las_time if good.all() else np.where(good, las_time, np.nan), np.float64)

    def utc(self, checked: FloatArray) -> FloatArray | None:
        """UTC of checked times (n,), nan where they are; None for seconds of a week that the file does not state."""
        if self is not TimeKind.STANDARD:
            return None
        ends = np.array([np.fmin.reduce(checked), np.fmax.reduce(checked)]) if len(checked) else np.zeros(1)
        shift = las_time_to_utc(ends) - ends
        # No leap second in between: no need to look up each time.
        return checked + shift[0] if shift[0] == shift[-1] else las_time_to_utc(checked)


def _is_week(las_time: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Which times may be seconds of a week; a flight over its end may continue for a day."""
    return np.asarray((las_time >= 0.0) & (las_time <= WEEK_S * 8.0 / 7.0))


def _is_standard(las_time: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Which times may be adjusted standard GPS time of 1980 to 2100."""
    return np.asarray((las_time >= _FIRST_STANDARD) & (las_time <= _LAST_STANDARD))


def clock_of(path: Path, header: LasHeader, sample: FloatArray) -> tuple[TimeKind, tuple[Notice, ...]]:
    """The meaning of the file's times, from its header and a sample (n,) of them.

    If all times are 0, the header decides. If the sample is not valid for the kind in the header but for the other one,
    the other one is used, with a notice.
    """
    if not header.has_time:
        return TimeKind.NONE, ()
    declared = TimeKind.STANDARD if header.is_standard_time else TimeKind.WEEK
    known = sample[np.isfinite(sample) & (sample != 0.0)]
    if not len(known):
        return declared, ()
    first = float(known.min())
    last = float(known.max())
    week = float(np.mean(_is_week(known)))
    standard = float(np.mean(_is_standard(known) & ~_is_week(known)))
    latest_s = dt.datetime.now(dt.UTC).timestamp() + 366 * DAY_S
    if declared is TimeKind.WEEK and standard > 0.5 and _EARLIEST_UTC <= las_time_to_utc(np.median(known)) <= latest_s:
        return TimeKind.STANDARD, (Notice("gps-time-type", path=path.name, week_s=WEEK_S, first=first, last=last),)
    of_2011 = header.created is not None and header.created.year in (2011, 2012)  # times of that week, perhaps
    if declared is TimeKind.STANDARD and week > 0.5 and not of_2011:
        return TimeKind.WEEK, (Notice("gps-time-type.wrong-type", path=path.name, first=first, last=last),)
    if week + standard < 0.5:
        return TimeKind.UNKNOWN, (Notice("gps-time-impossible", path=path.name, first=first, last=last),)
    if declared is TimeKind.WEEK and standard > 0.5:
        return TimeKind.UNKNOWN, (
            Notice("gps-time-impossible.no-week-seconds", path=path.name, first=first, last=last),
        )
    return declared, ()


_WITHHELD: Final = (0x80, 0x04)
"""Bit of withheld points: in the classification of formats 0 to 5, in the flags of later ones."""


@dataclass(frozen=True)
class CloudBatch:
    """Some points of a cloud, in the order of the file; all arrays have length n.

    Attributes:
        xyz_m: (n, 3) float64 x, y and z in the CRS and the units of the file (metres if the CRS is in metres).
        classification: uint8, see LAS 1.4 tables 10 and 17.
        returns: uint8 number of returns of the pulse.
        withheld: bool, points marked as deleted.
        gps_time: float64 as in the file, nan where it is invalid; None if the points have no time.
        t_s: float64 UTC, nan where the time is invalid; None if the points have no time, or seconds of an unknown
            week.
        rgb: (n, 3) uint16 red, green, blue; None without colour.
    """

    xyz_m: FloatArray
    classification: NDArray[np.uint8]
    intensity: NDArray[np.uint16]
    return_number: NDArray[np.uint8]
    returns: NDArray[np.uint8]
    point_source_id: NDArray[np.uint16]
    withheld: NDArray[np.bool_]
    gps_time: FloatArray | None
    t_s: FloatArray | None
    rgb: NDArray[np.uint16] | None

    def __len__(self) -> int:
        return len(self.xyz_m)

    def where(self, keep: NDArray[np.bool_]) -> "CloudBatch":
        """The points where `keep` (n,) is True; this batch itself if all are."""
        if keep.all():
            return self
        kept: dict[str, Any] = {n: None if values is None else values[keep] for n, values in vars(self).items()}
        return CloudBatch(**kept)


def layout(header: LasHeader) -> np.dtype[np.void]:
    """Structure of a point record; extra bytes at its end are skipped."""
    import laspy  # with its client for HTTP 0.1 s, and few sessions name a LAS file

    fields: Any = laspy.point.format.PointFormat(header.point_format).dtype().fields
    return np.dtype(
        {
            "names": list(fields),
            "formats": [kind for kind, _ in fields.values()],
            "offsets": [offset for _, offset in fields.values()],
            "itemsize": header.record_bytes,
        }
    )


def unpack(records: NDArray[np.void], header: LasHeader, clock: TimeKind) -> CloudBatch:
    """Records (n,) of :func:`layout` as arrays."""
    xyz_m = np.empty((len(records), 3))
    for axis, name in enumerate("XYZ"):
        np.multiply(records[name], header.scale[axis], out=xyz_m[:, axis])
        xyz_m[:, axis] += header.shift[axis]
    bits: NDArray[np.uint8] = records["bit_fields"]
    old = header.point_format < 6
    flags: NDArray[np.uint8] = records["raw_classification" if old else "classification_flags"]
    names = records.dtype.names or ()
    gps_time = clock.checked(records["gps_time"]) if "gps_time" in names else None
    colours = [records[name] for name in ("red", "green", "blue")] if "red" in names else None
    return CloudBatch(
        xyz_m=xyz_m,
        classification=flags & np.uint8(0x1F) if old else records["classification"].copy(),
        intensity=records["intensity"].copy(),
        return_number=bits & np.uint8(0x07 if old else 0x0F),
        returns=(bits >> np.uint8(3)) & np.uint8(0x07) if old else bits >> np.uint8(4),
        point_source_id=records["point_source_id"].copy(),
        withheld=(flags & _WITHHELD[not old]) != 0,
        gps_time=gps_time,
        t_s=clock.utc(gps_time) if gps_time is not None else None,
        rgb=np.stack(colours, axis=1) if colours is not None else None,
    )
