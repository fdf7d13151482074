"""From longitude and latitude to the session's map frame."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pyproj import CRS, Proj, Transformer
from pyproj.exceptions import CRSError

from furrowmap.core.values.errors import InputError, RefusedError
from furrowmap.core.values.session import Crs

FloatArray = NDArray[np.float64]

SCALE_OFF = 1e-3
"""More than this a map must not stretch the ground: a metre in a kilometre, two and a half times what UTM does."""
AREA_MARGIN_DEG = 0.5
"""How far outside a CRS's stated area of use a site may lie: fields at a zone's border stay in one zone."""


@dataclass(frozen=True)
class MapFrame:
    """The session's projected CRS, with easting before northing whatever the authority's axis order is.

    Coordinates are taken 'as recorded': longitudes and latitudes are those of the CRS's own geographic base, so that
    the way to the map is the map projection alone and no datum is changed.

    Attributes:
        crs: the horizontal projected CRS.
    """

    crs: CRS

    @cached_property
    def _transformer(self) -> Transformer:
        base = self.crs.geodetic_crs
        assert base is not None
        return Transformer.from_crs(base.to_2d(), self.crs, always_xy=True)

    @property
    def name(self) -> str:
        """Such as ``EPSG:6677``, or the CRS's own name where it has no code."""
        authority = self.crs.to_authority()
        return ":".join(authority) if authority else self.crs.name

    def project(self, lon_deg: FloatArray, lat_deg: FloatArray) -> tuple[FloatArray, FloatArray]:
        """(easting, northing) in metres, each (n,), of longitudes and latitudes (n,) in degrees.

        Raises:
            RefusedError: if the place lies outside the area for which the CRS is meant, or is stretched by it.
        """
        self._refuse_outside(lon_deg, lat_deg)
        self._refuse_stretched(lon_deg, lat_deg)
        e, n = self._transformer.transform(lon_deg, lat_deg)
        return np.asarray(e, np.float64), np.asarray(n, np.float64)

    def to_lon_lat(self, e_m: FloatArray, n_m: FloatArray) -> tuple[FloatArray, FloatArray]:
        """(longitude, latitude) in degrees, each (n,), of map coordinates: inverse of :meth:`project`."""
        lon, lat = self._transformer.transform(e_m, n_m, direction="INVERSE")
        return np.asarray(lon, np.float64), np.asarray(lat, np.float64)

    def convergence_deg(self, lon_deg: FloatArray, lat_deg: FloatArray) -> FloatArray:
        """Meridian convergence (n,): true heading − grid heading."""
        factors: Any = Proj(self.crs).get_factors(lon_deg, lat_deg)
        return np.asarray(factors.meridian_convergence, np.float64)

    def _refuse_outside(self, lon_deg: FloatArray, lat_deg: FloatArray) -> None:
        area = self.crs.area_of_use
        if area is None or not len(lon_deg):
            return
        lon, lat = float(np.nanmedian(lon_deg)), float(np.nanmedian(lat_deg))
        east = (lon - area.west) % 360.0
        width = (area.east - area.west) % 360.0 or 360.0
        inside_lon = east <= width + AREA_MARGIN_DEG or east >= 360.0 - AREA_MARGIN_DEG
        if not (inside_lon and area.south - AREA_MARGIN_DEG <= lat <= area.north + AREA_MARGIN_DEG):
            raise RefusedError(
                f"The recording lies at {lat:.4f}, {lon:.4f} (latitude, longitude); {self.name} is made for "
                f"{area.south:g} to {area.north:g}, {area.west:g} to {area.east:g}.",
                "Outside its area a projection distorts lengths and areas beyond what the figures would say.",
                "Set `[crs] map` to a projected CRS of the place; `furrowmap init` proposes one.",
                code="crs-outside-area",
            )

    def scale(self, lon_deg: float, lat_deg: float) -> float:
        """Map distance over distance on the ellipsoid at a place: the mean of those along meridian and parallel."""
        factors: Any = Proj(self.crs).get_factors(lon_deg, lat_deg)
        return 0.5 * float(factors.meridional_scale + factors.parallel_scale)

    def _refuse_stretched(self, lon_deg: FloatArray, lat_deg: FloatArray) -> None:
        if not len(lon_deg):
            return
        scale = self.scale(float(np.nanmedian(lon_deg)), float(np.nanmedian(lat_deg)))
        if abs(scale - 1.0) > SCALE_OFF:
            raise RefusedError(
                f"{self.name} stretches the ground at the recording's place by a factor of {scale:.4f}.",
                "Scans are placed in true metres, so the cloud would not fit its own track, and areas would be wrong.",
                "Set `[crs] map` to a projected CRS of the place (UTM or a national one): see `furrowmap init`.",
                code="crs-scale",
            )


def map_frame(crs: Crs) -> MapFrame:
    """The map frame that a session asks for.

    Raises:
        InputError: if the CRS is unknown, not projected, or not in metres.
        RefusedError: if heights or coordinates are asked for that this version cannot vouch for.
    """
    try:
        whole = CRS.from_user_input(crs.map)
    except CRSError as error:
        raise InputError(
            f"The session's key `crs.map`: {crs.map!r} is no CRS that PROJ knows ({error}).",
            "Without the map's CRS nothing can be placed.",
            'Write an EPSG code such as "EPSG:6677", or a WKT text.',
            code="crs-unknown",
        ) from None
    flat = whole.sub_crs_list[0] if whole.is_compound else whole.to_2d()
    units = {axis.unit_name for axis in flat.axis_info}
    if not flat.is_projected or units != {"metre"}:
        raise InputError(
            f"The session's key `crs.map`: {crs.map} ({whole.name}) is in {' and '.join(sorted(units))}, not projected "
            "in metres.",
            "Heights, distances and areas need a map frame in metres.",
            "Choose a projected CRS of the place; `furrowmap init` proposes one.",
            code="crs-not-projected",
        )
    for key, value, known in (
        ("heights", crs.heights, "ellipsoidal"),
        ("coordinates", crs.coordinates, "as-recorded"),
    ):
        if value != known:
            raise RefusedError(
                f'The session\'s key `crs.{key}` is {value!r}; this version vouches for "{known}" only.',
                "A change of datum, epoch or height system that is not checked can be off by decimetres.",
                f'Write `{key} = "{known}"` and transform the products with a tool that has the grids.',
                code=f"crs-{key}",
            )
    return MapFrame(flat)
