"""Names of a CRS for users, and the distance of its datum from that of GNSS positions."""

import warnings
from functools import lru_cache
from typing import Any, Final

import numpy as np
from pyproj import CRS, Geod
from pyproj.aoi import AreaOfInterest
from pyproj.transformer import TransformerGroup

SATELLITES: Final = "EPSG:4326"
"""WGS 84: modern datums agree with it within a metre or two, and PROJ treats most of them as equal."""
LARGEST_DATUM_SHIFT_M: Final = 5.0
"""Largest distance of a modern datum from WGS 84."""


def name_of(crs: CRS) -> str:
    """The code, such as ``EPSG:6677``, or the CRS's name if it has none."""
    authority = crs.to_authority()
    return ":".join(authority) if authority else crs.name


def full_name_of(crs: CRS) -> str:
    """Code and name, such as ``EPSG:6677 (JGD2011 / Japan Plane Rectangular CS IX)``; without a code only the name."""
    code = name_of(crs)
    return crs.name if code == crs.name else f"{code} ({crs.name})"


@lru_cache(maxsize=16)
def datum_shift_m(base: CRS, lon_deg: float, lat_deg: float) -> float | None:
    """Distance in metres between equal coordinates in a geographic CRS and in WGS 84; None if PROJ cannot transform."""
    area: Any = AreaOfInterest(lon_deg, lat_deg, lon_deg, lat_deg)  # pyproj's types have two of that name
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)  # about missing grids, which change the result by a few metres
        group = TransformerGroup(SATELLITES, base.to_2d(), always_xy=True, area_of_interest=area, allow_ballpark=False)
    for transformer in group.transformers:
        moved: Any = transformer.transform(lon_deg, lat_deg)
        if np.isfinite(moved).all():
            return float(Geod(ellps="WGS84").inv(lon_deg, lat_deg, *moved)[2])
    return None
