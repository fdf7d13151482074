"""Names of a CRS for users, and the distance of its datum from that of GNSS positions."""

import math
import re
import warnings
from collections.abc import Iterator
from functools import lru_cache
from typing import Any, Final

import numpy as np
from pyproj import CRS, Geod
from pyproj.aoi import AreaOfInterest
from pyproj.exceptions import CRSError
from pyproj.transformer import TransformerGroup

SATELLITES: Final = "EPSG:4326"
"""WGS 84: modern datums agree with it within a metre or two, and PROJ treats most of them as equal."""
LARGEST_DATUM_SHIFT_M: Final = 5.0
"""Largest distance of a modern datum from WGS 84."""


_INITIAL: Final = re.compile(r"\binit\s*=\s*(?!(?:epsg|esri|iau_2015|iau|ignf|ogc|crs):)", re.IGNORECASE)
_OPERATION: Final = "PROJ-based operation method"


def crs_of_file(text: str) -> CRS:
    """The CRS that a file states: a code, WKT, or any other form that PROJ reads.

    Raises:
        CRSError: if it is none, or names a file, which PROJ would open: `+nadgrids=/home/…` or its like in WKT. A name
            without a folder, such as `+nadgrids=ca_que_na83sc.tif`, is a grid of PROJ's own.
    """
    if _INITIAL.search(text):
        raise CRSError(f"it refers to a file: {text[:200]}")
    crs = CRS.from_user_input(text)
    named = next((name for name in _file_names(crs.to_json_dict()) if "/" in name or "\\" in name), None)
    if named is not None:
        raise CRSError(f"it refers to the file {named[:200]}")
    return crs


def _file_names(part: Any) -> Iterator[str]:
    """Parameters of a CRS (PROJJSON) that are texts, and operations in the language of PROJ."""
    if isinstance(part, list):
        for one in part:
            yield from _file_names(one)
    elif isinstance(part, dict):
        for key, value in part.items():
            named = key == "value" or (key == "name" and str(value).startswith(_OPERATION))
            if isinstance(value, str) and named:
                yield value
            yield from _file_names(value)


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
    """Metres between equal coordinates in this and WGS 84; where PROJ knows none, None if modern, else infinite."""
    area: Any = AreaOfInterest(lon_deg, lat_deg, lon_deg, lat_deg)  # pyproj's types have two of that name
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)  # about missing grids, which change the result by a few metres
        group = TransformerGroup(SATELLITES, base.to_2d(), always_xy=True, area_of_interest=area, allow_ballpark=False)
    for transformer in group.transformers:
        moved: Any = transformer.transform(lon_deg, lat_deg)
        if np.isfinite(moved).all():
            return float(Geod(ellps="WGS84").inv(lon_deg, lat_deg, *moved)[2])
    known = base.ellipsoid
    return None if known is None or abs(known.semi_major_metre - Geod(ellps="WGS84").a) < 1.0 else math.inf
