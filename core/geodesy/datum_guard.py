"""Check that the datum of a map agrees with that of satellite positions; older ones differ by up to 500 m."""

from __future__ import annotations

from typing import Final

from pyproj import CRS

from furrowmap.core.runtime.errors import Notice, RefusedError
from furrowmap.core.values.datum import LARGEST_DATUM_SHIFT_M, datum_shift_m

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
        raise RefusedError(
            f"{name} is based on {base.name}, whose coordinates differ by {apart:.0f} m from satellite positions at "
            f"{lat_deg:.4f}, {lon_deg:.4f} (latitude, longitude).",
            "Using recorded positions in it would shift everything by that distance.",
            "Set `[crs] map` to a CRS on a current datum (`furrowmap init` proposes one) and transform the products "
            "with `furrowmap export --dst-crs`; or state the datum, if your network corrects to it: "
            f'`coordinates = "{base.name}@2026.4"`.',
            code="crs-datum",
        )
    if base.name == "JGD2000" and time_s > JGD2000_UNTIL_S:
        text = (
            f"{name} is based on JGD2000, but positions recorded since October 2011 are in JGD2011. They are used as "
            "they are; where the earthquake of that year moved the ground, the two differ by up to 5 m."
        )
        return [Notice("datum-superseded", text)]
    return []
