"""Point records as arrays."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final

import laspy
import numpy as np
from numpy.typing import NDArray

from furrowmap.core.readers.las.gps_time import LasClock
from furrowmap.core.readers.las.header import LasHeader
from furrowmap.core.runtime.arrays import FloatArray

_WITHHELD: Final = (0x80, 0x04)
"""Bit of withheld points: in the classification of formats 0 to 5, in the flags of later ones."""


@dataclass(frozen=True)
class CloudBatch:
    """Some points of a cloud, in the order of the file; all arrays have length n.

    Attributes:
        xyz_m: (n, 3) float64 x, y and z in the CRS and the units of the file (metres if the CRS is in metres).
        classification: uint8, see LAS 1.4 tables 10 and 17.
        intensity: uint16.
        return_number: uint8, from 1.
        returns: uint8 number of returns of the pulse.
        point_source_id: uint16.
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

    def where(self, keep: NDArray[np.bool_]) -> CloudBatch:
        """The points where `keep` (n,) is True; this batch itself if all are."""
        if keep.all():
            return self
        kept: dict[str, Any] = {n: None if values is None else values[keep] for n, values in vars(self).items()}
        return CloudBatch(**kept)


def layout(header: LasHeader) -> np.dtype[np.void]:
    """Structure of a point record; extra bytes at its end are skipped."""
    fields: Any = laspy.point.format.PointFormat(header.point_format).dtype().fields
    return np.dtype(
        {
            "names": list(fields),
            "formats": [kind for kind, _ in fields.values()],
            "offsets": [offset for _, offset in fields.values()],
            "itemsize": header.record_bytes,
        }
    )


def unpack(records: NDArray[np.void], header: LasHeader, clock: LasClock) -> CloudBatch:
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
