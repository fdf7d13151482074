"""Whether a map's datum is one in which satellites give positions; older ones lie up to hundreds of metres beside."""

from __future__ import annotations

import warnings
from functools import lru_cache
from typing import Any, Final

import numpy as np
from pyproj import CRS, Geod
from pyproj.aoi import AreaOfInterest
from pyproj.transformer import TransformerGroup

from furrowmap.core.values.errors import Notice, RefusedError

SATELLITES: Final = "EPSG:4326"
"""WGS 84: datums of today lie within a metre or two of it, and PROJ takes most of them for the same."""
APART_M: Final = 5.0
"""Datums that lie farther from it are none of today's."""
JGD2000_UNTIL_S: Final = 1_319_122_800.0
"""21 October 2011 in Japan: since then survey results, and the corrections that networks send, are of JGD2011."""


@lru_cache(maxsize=16)
def apart_m(base: CRS, lon_deg: float, lat_deg: float) -> float | None:
    """How far coordinates in a geographic CRS lie from a place's in WGS 84; None where PROJ cannot say."""
    area: Any = AreaOfInterest(lon_deg, lat_deg, lon_deg, lat_deg)  # pyproj's types have two of that name
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)  # of grids that are missing: a few metres more or less
        group = TransformerGroup(SATELLITES, base.to_2d(), always_xy=True, area_of_interest=area, allow_ballpark=False)
    for way in group.transformers:
        moved: Any = way.transform(lon_deg, lat_deg)
        if np.isfinite(moved).all():
            return float(Geod(ellps="WGS84").inv(lon_deg, lat_deg, *moved)[2])
    return None


def expect_datum_of_today(crs: CRS, name: str, lon_deg: float, lat_deg: float, time_s: float) -> list[Notice]:
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
