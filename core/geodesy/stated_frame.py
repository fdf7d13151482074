"""Coordinates kept in a stated frame and epoch: "itrf2020@2026.4"."""

from __future__ import annotations

import re
from dataclasses import dataclass
from functools import cache
from typing import Final

from pyproj import CRS
from pyproj.crs import ProjectedCRS
from pyproj.database import CRSInfo, query_crs_info
from pyproj.enums import PJType

from furrowmap.core.runtime.errors import InputError

FIRST_EPOCH: Final = 1984.0
LAST_EPOCH: Final = 2100.0
"""Years outside which no satellite positions exist."""


@dataclass(frozen=True)
class StatedFrame:
    """A terrestrial frame and the epoch of coordinates in it.

    Attributes:
        frame: geographic CRS of the frame.
        epoch: decimal year.
    """

    frame: CRS
    epoch: float

    @property
    def name(self) -> str:
        """Such as "ITRF2020 @ 2026.4"."""
        return f"{self.frame.name} @ {self.epoch:.10g}"

    def map_crs(self, flat: CRS) -> CRS:
        """The projection of a map CRS on this frame, with frame and epoch in its name."""
        conversion = flat.coordinate_operation
        assert conversion is not None
        # As a plain CRS: a ProjectedCRS of pyproj has no way to two dimensions.
        return CRS(ProjectedCRS(conversion, f"{self.name} / {conversion.name}", geodetic_crs=self.frame))


def stated_frame(text: str) -> StatedFrame | None:
    """The frame and epoch in a session's `crs.coordinates`; None where it has another form than `frame@epoch`.

    Raises:
        InputError: if PROJ knows no such frame, or the epoch is out of range.
    """
    found = re.fullmatch(r"\s*(.+?)\s*@\s*(-?\d+(?:\.\d+)?)\s*", text)
    if found is None:
        return None
    info = _frames().get(found[1].casefold())
    if info is None:
        raise InputError("frame-unknown", found=found[1])
    epoch = float(found[2])
    if not FIRST_EPOCH <= epoch <= LAST_EPOCH:
        raise InputError(
            "epoch-out-of-range.stated-frame", found=found[2], first_epoch=FIRST_EPOCH, last_epoch=LAST_EPOCH
        )
    return StatedFrame(CRS.from_authority(info.auth_name, info.code), epoch)


@cache
def _frames() -> dict[str, CRSInfo]:
    """The geographic CRS that EPSG names, by their names in lower case."""
    found = query_crs_info(auth_name="EPSG", pj_types=PJType.GEOGRAPHIC_2D_CRS)
    return {info.name.casefold(): info for info in found if not info.deprecated}
