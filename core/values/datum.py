"""How far a datum lies from those in which satellites give positions."""

from __future__ import annotations

import warnings
from functools import lru_cache
from typing import Any, Final

import numpy as np
from pyproj import CRS, Geod
from pyproj.aoi import AreaOfInterest
from pyproj.transformer import TransformerGroup

SATELLITES: Final = "EPSG:4326"
"""WGS 84: datums of today lie within a metre or two of it, and PROJ takes most of them for the same."""
APART_M: Final = 5.0
"""Datums that lie farther from it are none of today's."""


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
