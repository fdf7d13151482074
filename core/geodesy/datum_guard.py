"""Whether a map's datum is one in which satellites give positions; older ones lie up to hundreds of metres beside."""

from __future__ import annotations

from typing import Final

from pyproj import CRS

from furrowmap.core.values.datum import APART_M, apart_m
from furrowmap.core.values.errors import Notice, RefusedError

JGD2000_UNTIL_S: Final = 1_319_122_800.0
"""21 October 2011 in Japan: since then survey results, and the corrections that networks send, are of JGD2011."""


def check_datum(crs: CRS, name: str, lon_deg: float, lat_deg: float, time_s: float) -> list[Notice]:
    """What is to be said of a map's datum, for positions by satellites at a place and time.

    Raises:
        RefusedError: if it lies far beside the datums in which satellites give positions.
    """
    base = crs.geodetic_crs
    if base is None:
        return []
    apart = apart_m(base, round(lon_deg, 1), round(lat_deg, 1))
    if apart is not None and apart > APART_M:
        raise RefusedError(
            f"{name} stands on {base.name}, whose coordinates lie {apart:.0f} m beside those of satellites at "
            f"{lat_deg:.4f}, {lon_deg:.4f} (latitude, longitude).",
            "Recorded positions taken for its own would put everything that far from where it is.",
            "Set `[crs] map` to a CRS on a datum of today (`furrowmap init` proposes one) and let `furrowmap export "
            "--dst-crs` change the products; or state it, if your network corrects to that datum: "
            f'`coordinates = "{base.name}@2026.4"`.',
            code="crs-datum",
        )
    if base.name == "JGD2000" and time_s > JGD2000_UNTIL_S:
        text = (
            f"{name} stands on JGD2000, and positions recorded since October 2011 are of JGD2011: they are taken for "
            "the same, and where the earthquake of that year moved the ground they lie up to 5 m apart."
        )
        return [Notice("datum-superseded", text)]
    return []
