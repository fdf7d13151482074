"""Height systems: ellipsoidal, or above a geoid model."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
from pyproj import CRS, Transformer
from pyproj.crs import CompoundCRS
from pyproj.database import query_crs_info
from pyproj.enums import PJType
from pyproj.exceptions import CRSError, ProjError
from pyproj.transformer import TransformerGroup

from furrowmap.core.runtime.arrays import FloatArray
from furrowmap.core.runtime.errors import InputError, RefusedError
from furrowmap.core.values.session import ELLIPSOIDAL

GEOIDS_OF_JAPAN: Final = {"GSIGEO2011": "JGD2011", "JPGEO2024": "JGD2024"}
"""Geoid models of Japan, and the realisation whose ellipsoidal heights each applies to."""
VERTICAL_CRS: Final = {"EGM84": "EPSG:5798", "EGM96": "EPSG:5773", "EGM2008": "EPSG:3855"}
"""Global geoid models and their vertical CRS."""
_JGD2011: Final = 6695
"""EPSG code of JGD2011 (vertical), the heights of GSIGEO2011."""
_JGD2024_NAME: Final = "JGD2024 (vertical) height"
_JGD2024: Final = (
    f'VERTCRS["{_JGD2024_NAME}",VDATUM["Japanese Geodetic Datum 2024 (vertical)"],CS[vertical,1],'
    'AXIS["gravity-related height (H)",up],LENGTHUNIT["metre",1]]'
)
"""For PROJ databases before EPSG 12.055 (April 2026)."""

GeoidHeight = Callable[[FloatArray, FloatArray], FloatArray]


@dataclass(frozen=True)
class HeightSystem:
    """The height system of a map.

    Attributes:
        name: "ellipsoidal", or the geoid as the session names it.
        vertical: CRS of the heights; None for ellipsoidal ones.
        geoid_m: geoid heights (n,) at longitudes and latitudes (n,); nan outside the model.
    """

    name: str
    vertical: CRS | None
    source: str
    geoid_m: GeoidHeight

    def with_heights(self, flat: CRS) -> CRS:
        """The compound of a horizontal CRS and these heights; unchanged for ellipsoidal heights."""
        if self.vertical is None:
            return flat
        whole = CompoundCRS(f"{flat.name} + {self.vertical.name}", [flat, self.vertical])
        known = whole.to_epsg(min_confidence=100)
        return CRS.from_epsg(known) if known is not None else whole


ABOVE_ELLIPSOID: Final = HeightSystem(ELLIPSOIDAL, None, "the ellipsoid", lambda lon, _: np.zeros(len(lon)))


def height_system(name: str, base: CRS, grid: Path | None = None) -> HeightSystem:
    """The height system that a session requests.

    Args:
        name: "ellipsoidal", a key of `GEOIDS_OF_JAPAN` or `VERTICAL_CRS`, or any vertical CRS that PROJ reads.
        grid: geoid grid that PROJ reads (GeoTIFF, GTX), for other models than those of Japan and of PROJ.

    Raises:
        InputError: if there is no such model, or the grid is none.
        RefusedError: if PROJ lacks the grid, or has no transformation.
    """
    if name == ELLIPSOIDAL:
        return ABOVE_ELLIPSOID
    if name.upper() in GEOIDS_OF_JAPAN:
        return _japan(name.upper())
    try:
        vertical = CRS.from_user_input(VERTICAL_CRS.get(name.upper(), name))
    except CRSError:
        vertical = None
    if vertical is None or not vertical.is_vertical or vertical.is_compound:
        raise InputError(
            "heights-unknown",
            name=name,
            ellipsoidal=ELLIPSOIDAL,
            japan=", ".join(GEOIDS_OF_JAPAN),
            vertical=", ".join(VERTICAL_CRS),
        )
    if grid is None and vertical == CRS.from_epsg(_JGD2011):
        return _japan("GSIGEO2011")
    geoid_m, source = _from_grid(grid) if grid is not None else _from_proj(name, vertical, base)
    return HeightSystem(name, vertical, source, geoid_m)


def _japan(name: str) -> HeightSystem:
    """GSI models; JPGEO2024 refers to Tokyo Bay everywhere, Hrefconv2024 is the difference on some islands."""
    import japan_geoid

    if name == "GSIGEO2011":
        model, vertical = japan_geoid.load_embedded_gsigeo2011(), CRS.from_epsg(_JGD2011)
        source = "GSIGEO2011 of the Geospatial Information Authority of Japan"
    else:
        known = query_crs_info(auth_name="EPSG", pj_types=PJType.VERTICAL_CRS)
        code = next((info.code for info in known if info.name == _JGD2024_NAME and not info.deprecated), None)
        vertical = CRS.from_wkt(_JGD2024) if code is None else CRS.from_authority("EPSG", code)
        model = japan_geoid.load_embedded_jpgeo2024_hrefconv2024()
        source = "JPGEO2024 with Hrefconv2024 of the Geospatial Information Authority of Japan"
    return HeightSystem(name, vertical, source, lambda lon, lat: np.asarray(model.get_heights(lon, lat), np.float64))


def _from_grid(grid: Path) -> tuple[GeoidHeight, str]:
    """A grid of geoid heights, interpolated bilinearly by PROJ."""
    place = grid.resolve().as_posix()
    if any(sign in place for sign in ',"'):
        raise InputError("geoid-unreadable", grid=grid)
    try:
        shift = Transformer.from_pipeline(
            "+proj=pipeline +step +proj=unitconvert +xy_in=deg +xy_out=rad "
            f'+step +proj=vgridshift +grids="{place}" +multiplier=1 +step +proj=unitconvert +xy_in=rad +xy_out=deg'
        )
    except ProjError as error:
        raise InputError("geoid-unreadable.from-grid", grid=grid, error=error) from None
    return _geoid_heights(shift, 1.0), f"the grid {grid.name}"


def _from_proj(name: str, vertical: CRS, base: CRS) -> tuple[GeoidHeight, str]:
    """PROJ's transformation from ellipsoidal heights, never a ballpark one."""
    whole = CompoundCRS(f"{base.name} + {vertical.name}", [base.to_2d(), vertical])
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)  # of missing grids, of which more is said below
        group = TransformerGroup(base.to_3d(), whole, always_xy=True, allow_ballpark=False)
    if group.transformers:
        best = group.transformers[0]
        return _geoid_heights(best, -1.0), best.description
    needed = [grid.short_name for operation in group.unavailable_operations for grid in operation.grids]
    if needed:
        raise RefusedError("geoid-grid-missing", name=name, needed=needed[0])
    raise RefusedError("geoid-unknown", base=base.name, vertical=vertical.name)


def _geoid_heights(change: Transformer, sign: float) -> GeoidHeight:
    """Geoid heights as the transformation of points on the ellipsoid."""

    def geoid_m(lon_deg: FloatArray, lat_deg: FloatArray) -> FloatArray:
        moved: Any = change.transform(lon_deg, lat_deg, np.zeros(len(lon_deg)))
        height = sign * np.asarray(moved[2], np.float64)
        return np.where(np.isfinite(height), height, np.nan)

    return geoid_m
