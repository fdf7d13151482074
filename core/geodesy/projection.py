"""The map frame of a session and its projection, also in a stated frame and epoch such as "itrf2020@2026.4"."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from functools import cache, cached_property
from pathlib import Path
from typing import Any, Final

import numpy as np
from pyproj import CRS, Proj, Transformer
from pyproj.crs import ProjectedCRS
from pyproj.database import CRSInfo, query_crs_info
from pyproj.enums import PJType
from pyproj.exceptions import CRSError

from furrowmap.core.geodesy.gravity import radius_m
from furrowmap.core.geodesy.height_system import ABOVE_ELLIPSOID, HeightSystem, height_system
from furrowmap.core.geodesy.parameter_file import BETWEEN_EPOCHS, ParameterFile, read_parameters
from furrowmap.core.runtime.arrays import FloatArray
from furrowmap.core.runtime.errors import InputError, RefusedError
from furrowmap.core.values.crs import name_of
from furrowmap.core.values.session import AS_RECORDED, CURRENT_EPOCH, ELLIPSOIDAL, Crs

FIRST_EPOCH: Final = 1984.0
LAST_EPOCH: Final = 2100.0
"""Years outside which no satellite positions exist."""


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
        """The projection of a map CRS on this frame, with frame and epoch in its name."""
        conversion = flat.coordinate_operation
        assert conversion is not None
        # As a plain CRS: a ProjectedCRS of pyproj has no way to two dimensions.
        return CRS(ProjectedCRS(conversion, f"{self.name} / {conversion.name}", geodetic_crs=self.frame))


def stated_frame(text: str) -> StatedFrame | None:
    """The frame and epoch in a session's `crs.coordinates`; None where it has another form than `frame@epoch`.

    Raises:
        InputError: if PROJ knows no such frame, or the epoch is out of range.
    """
    found = re.fullmatch(r"\s*(.+?)\s*@\s*(-?\d+(?:\.\d+)?)\s*", text)
    if found is None:
        return None
    info = _frames().get(found[1].casefold())
    if info is None:
        raise InputError("frame-unknown", found=found[1])
    epoch = float(found[2])
    if not FIRST_EPOCH <= epoch <= LAST_EPOCH:
        raise InputError(
            "epoch-out-of-range.stated-frame", found=found[2], first_epoch=FIRST_EPOCH, last_epoch=LAST_EPOCH
        )
    return StatedFrame(CRS.from_authority(info.auth_name, info.code), epoch)


@cache
def _frames() -> dict[str, CRSInfo]:
    """The geographic CRS that EPSG names, by their names in lower case."""
    found = query_crs_info(auth_name="EPSG", pj_types=PJType.GEOGRAPHIC_2D_CRS)
    return {info.name.casefold(): info for info in found if not info.deprecated}


MAX_SCALE_ERROR = 1e-3
"""Largest scale error of a map: a metre in a kilometre, two and a half times that of UTM."""
AREA_MARGIN_DEG = 1.2
"""Margin around the area of use of a CRS, so that fields at a zone border stay in one zone: the maps of Denmark and
Norway use UTM zone 32 from 4.9° to 12.7° east, its area of use is 6° to 12°."""


@dataclass(frozen=True)
class MapFrame:
    """The projected CRS of a session, easting first, with the transformations that lead to it.

    Longitudes and latitudes are in the geographic base of the CRS, so :meth:`project` is the map projection alone;
    :mod:`furrowmap.core.geodesy.coordinates` applies the steps before.

    Attributes:
        crs: the horizontal projected CRS.
        parameters: from the current epoch to that of the map; None where positions are used as recorded.
        stated: stated frame and epoch of the coordinates, then the base of `crs`.
        heights: height system of the map.
        named: the CRS that the session names where `crs` is its projection on a stated frame.
        unused: vertical part of the CRS of the session that `heights` does not request.
    """

    crs: CRS
    parameters: ParameterFile | None = None
    stated: StatedFrame | None = None
    heights: HeightSystem = ABOVE_ELLIPSOID
    named: CRS | None = None
    unused: CRS | None = None

    @cached_property
    def _transformer(self) -> Transformer:
        base = self.crs.geodetic_crs
        assert base is not None
        return Transformer.from_crs(base.to_2d(), self.crs, always_xy=True)

    @cached_property
    def whole_crs(self) -> CRS:
        """The compound with the heights above a geoid, if any."""
        return self.heights.with_heights(self.crs)

    @property
    def words(self) -> str:
        """Description for the metadata of products, besides the CRS; empty where positions are used as recorded."""
        said = []
        if self.parameters is not None:
            said.append(f"Recorded positions are transformed to the epoch of the map with {self.parameters.name}.")
        if self.heights.vertical is not None:
            said.append(f"Heights are above {self.heights.name} ({self.heights.source}).")
        if self.stated is not None:
            said.append(f"Coordinates are those of {self.stated.name}.")
        return " ".join(said)

    @property
    def wkt(self) -> str:
        """WKT 2 of the whole CRS, with the coordinate epoch where stated (ISO 19162, 15.3)."""
        text = self.whole_crs.to_wkt()
        return f"COORDINATEMETADATA[{text},EPOCH[{self.stated.epoch:.10g}]]" if self.stated is not None else text

    @property
    def name(self) -> str:
        """Code such as ``EPSG:6677``, or the name of a CRS without a code."""
        return name_of(self.crs)

    def project(self, lon_deg: FloatArray, lat_deg: FloatArray) -> tuple[FloatArray, FloatArray]:
        """(easting, northing) in metres, each (n,), of longitudes and latitudes (n,) in degrees.

        Raises:
            RefusedError: if the site lies outside the area of use of the CRS, or its scale error there is too large.
        """
        if len(lon_deg):
            lon, lat = middle_deg(lon_deg, lat_deg)
            area = (self.named or self.crs).area_of_use
            if area is not None:
                east = (lon - area.west) % 360.0
                width = (area.east - area.west) % 360.0 or 360.0
                inside = east <= width + AREA_MARGIN_DEG or east >= 360.0 - AREA_MARGIN_DEG
                if not (inside and area.south - AREA_MARGIN_DEG <= lat <= area.north + AREA_MARGIN_DEG):
                    raise RefusedError(
                        "crs-outside-area",
                        lat=lat,
                        lon=lon,
                        name=self.name,
                        south=area.south,
                        north=area.north,
                        west=area.west,
                        east=area.east,
                    )
            scale = self.scale(lon, lat)
            if abs(scale - 1.0) > MAX_SCALE_ERROR:
                raise RefusedError("crs-scale", name=self.name, scale=scale)
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

    def scale(self, lon_deg: float, lat_deg: float) -> float:
        """Scale at a site: map distance over ellipsoidal distance, mean of meridian and parallel."""
        return scale_of(self.crs, lon_deg, lat_deg)

    def ground_scale(self, lon_deg: float, lat_deg: float, height_m: float) -> float:
        """Map distance over distance on the ground at an ellipsoidal height."""
        radius = radius_m(lat_deg)
        return self.scale(lon_deg, lat_deg) * radius / (radius + height_m)


def scale_of(crs: CRS, lon_deg: float, lat_deg: float) -> float:
    """Scale of a projection at a place: map distance over ellipsoidal distance, mean of meridian and parallel."""
    factors: Any = Proj(crs).get_factors(lon_deg, lat_deg)
    return 0.5 * float(factors.meridional_scale + factors.parallel_scale)


def scale_at(crs: CRS, e_m: float, n_m: float) -> float:
    """Metres of the map per metre on the ellipsoid at a place of the map: 0.9996 to 1.001 in UTM; 1 where unknown."""
    flat = crs.to_2d()
    scale = scale_of(flat, *Proj(flat)(e_m, n_m, inverse=True))
    return scale if math.isfinite(scale) else 1.0


def middle_deg(lon_deg: FloatArray, lat_deg: FloatArray) -> tuple[float, float]:
    """(longitude, latitude) in the middle of positions (n,), also across the 180th meridian."""
    known = lon_deg[np.isfinite(lon_deg)]
    first = float(known[0]) if len(known) else 0.0
    east = float(np.median((known - first + 180.0) % 360.0)) - 180.0 if len(known) else float("nan")
    return (first + east + 180.0) % 360.0 - 180.0, float(np.nanmedian(lat_deg))


def map_frame(crs: Crs, parameters_file: Path | None = None, geoid_grid: Path | None = None) -> MapFrame:
    """The map frame of a session.

    Args:
        crs: the session's table.
        parameters_file: the file that `crs.parameters` names.
        geoid_grid: the file that `crs.geoid_grid` names.

    Raises:
        InputError: if the CRS, the heights or the coordinates are unknown, the CRS is not projected or not in metres,
            or a file is missing or of another kind.
        RefusedError: if there is no exact transformation.
    """
    try:
        whole = CRS.from_user_input(crs.map)
    except CRSError as error:
        raise InputError("crs-unknown.projected", map=crs.map, error=error) from None
    flat, *vertical = whole.sub_crs_list if whole.is_compound else [whole.to_2d()]
    units = {axis.unit_name for axis in flat.axis_info}
    if not flat.is_projected or units != {"metre"}:
        raise InputError(
            "crs-not-projected.projected", map=crs.map, whole=whole.name, units=" and ".join(sorted(units))
        )
    unused = vertical[0] if vertical and crs.heights == ELLIPSOIDAL else None
    parameters = None
    if crs.coordinates == CURRENT_EPOCH:
        base = flat.geodetic_crs
        if base is None or not base.name.startswith(("JGD2011", "JGD2024")):
            raise RefusedError("epoch-map", map=crs.map, flat=flat.name)
        if parameters_file is None:
            raise RefusedError("parameters-missing", current_epoch=CURRENT_EPOCH)
        parameters = read_parameters(parameters_file)
        if parameters.format not in BETWEEN_EPOCHS:
            raise InputError("parameters-kind", found=parameters.name, format=parameters.format)
    stated = stated_frame(crs.coordinates)
    if stated is None and crs.coordinates not in (AS_RECORDED, CURRENT_EPOCH):
        raise InputError(
            "crs-coordinates", coordinates=crs.coordinates, as_recorded=AS_RECORDED, current_epoch=CURRENT_EPOCH
        )
    base = (stated.frame if stated is not None else flat.geodetic_crs) or flat
    heights = height_system(crs.heights, base, geoid_grid)
    if stated is not None:
        return MapFrame(stated.map_crs(flat), None, stated, heights, flat, unused)
    return MapFrame(flat, parameters, None, heights, None, unused)
