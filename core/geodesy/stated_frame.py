"""Coordinates that go on in the frame and epoch in which they were recorded: "itrf2020@2026.4"."""

from __future__ import annotations

import re
from dataclasses import dataclass
from functools import cache
from typing import Final

from pyproj import CRS
from pyproj.crs import ProjectedCRS
from pyproj.database import CRSInfo, query_crs_info
from pyproj.enums import PJType

from furrowmap.core.values.errors import InputError

FIRST_EPOCH: Final = 1984.0
LAST_EPOCH: Final = 2100.0
"""Outside these years there were, and will be, no positions by satellite in any frame known here."""


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
        """The projection of a map's CRS, on this frame; its name says frame and epoch in every format."""
        conversion = flat.coordinate_operation
        assert conversion is not None
        # As a plain CRS: a ProjectedCRS of pyproj has no way to two dimensions.
        return CRS(ProjectedCRS(conversion, f"{self.name} / {conversion.name}", geodetic_crs=self.frame))


def stated_frame(text: str) -> StatedFrame | None:
    """The frame and epoch in a session's `crs.coordinates`; None where it is not of the form `frame@epoch`.

    Raises:
        InputError: if PROJ knows no such frame, or the epoch is out of range.
    """
    found = re.fullmatch(r"\s*(.+?)\s*@\s*(-?\d+(?:\.\d+)?)\s*", text)
    if found is None:
        return None
    info = _frames().get(found[1].casefold())
    if info is None:
        raise InputError(
            f"The session's key `crs.coordinates` names the frame {found[1]!r}, which PROJ does not know.",
            "The products could not say what their coordinates are.",
            'Write a frame as EPSG names it, and the epoch: "ITRF2020@2026.4", "ITRF2014@2024.0", "JGD2011@2011.4".',
            code="frame-unknown",
        )
    epoch = float(found[2])
    if not FIRST_EPOCH <= epoch <= LAST_EPOCH:
        raise InputError(
            f"The session's key `crs.coordinates` names the epoch {found[2]}.",
            f"An epoch is a year with its fraction between {FIRST_EPOCH:g} and {LAST_EPOCH:g}.",
            "Write the epoch of the coordinates, such as 2026.4 for the end of May 2026.",
            code="epoch-out-of-range",
        )
    return StatedFrame(CRS.from_authority(info.auth_name, info.code), epoch)


@cache
def _frames() -> dict[str, CRSInfo]:
    """The geographic CRS that EPSG names, by their names in lower case."""
    found = query_crs_info(auth_name="EPSG", pj_types=PJType.GEOGRAPHIC_2D_CRS)
    return {info.name.casefold(): info for info in found if not info.deprecated}
