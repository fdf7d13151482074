"""Check that the datum of a map agrees with that of satellite positions; older ones differ by up to 500 m."""

from __future__ import annotations

from typing import Final

from pyproj import CRS

from furrowmap.core.runtime.errors import Notice, RefusedError
from furrowmap.core.values.crs import LARGEST_DATUM_SHIFT_M, datum_shift_m

JGD2000_UNTIL_S: Final = 1_319_122_800.0
"""21 October 2011 in Japan: since then survey results and network corrections are in JGD2011."""


def check_datum(crs: CRS, name: str, lon_deg: float, lat_deg: float, time_s: float) -> list[Notice]:
    """Notices about the datum of a map for satellite positions at a site and time.

    Raises:
        RefusedError: if it differs widely from the datums of satellite positioning.
    """
    base = crs.geodetic_crs
    if base is None:
        return []
    apart = datum_shift_m(base, round(lon_deg, 1), round(lat_deg, 1))
    if apart is not None and apart > LARGEST_DATUM_SHIFT_M:
        raise RefusedError("crs-datum", name=name, base=base.name, apart=apart, lat_deg=lat_deg, lon_deg=lon_deg)
    if base.name == "JGD2000" and time_s > JGD2000_UNTIL_S:
        return [Notice("datum-superseded", name=name)]
    return []
