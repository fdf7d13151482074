"""From longitude and latitude to the session's map frame."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pyproj import CRS, Proj, Transformer
from pyproj.exceptions import CRSError

from furrowmap.core.geodesy.height_system import ABOVE_ELLIPSOID, HeightSystem, height_system
from furrowmap.core.geodesy.parameter_file import BETWEEN_EPOCHS, ParameterFile, read_parameters
from furrowmap.core.geodesy.stated_frame import StatedFrame, stated_frame
from furrowmap.core.values.crs_name import name_of
from furrowmap.core.values.errors import InputError, RefusedError
from furrowmap.core.values.session import AS_RECORDED, CURRENT_EPOCH, ELLIPSOIDAL, Crs

FloatArray = NDArray[np.float64]

SCALE_OFF = 1e-3
"""More than this a map must not stretch the ground: a metre in a kilometre, two and a half times what UTM does."""
AREA_MARGIN_DEG = 0.5
"""How far outside a CRS's stated area of use a site may lie: fields at a zone's border stay in one zone."""


@dataclass(frozen=True)
class MapFrame:
    """The session's projected CRS, with easting before northing whatever the authority's axis order is.

    Longitudes and latitudes here are those of the CRS's own geographic base, so that the way to the map is the map
    projection alone. What has to be done to recorded positions before is told by the other attributes and done by
    :func:`furrowmap.core.geodesy.coordinates.brought`.

    Attributes:
        crs: the horizontal projected CRS.
        parameters: lead recorded positions back to the map's epoch; None where they are taken as they are.
        stated: the frame and epoch in which coordinates are said to be, on which `crs` then stands.
        heights: what the map's heights are counted from.
        named: the CRS that the session names where `crs` is its projection on a stated frame.
        unused: heights that the session's CRS names, and that it does not ask for under `heights`.
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
        """With the heights, where they are above a geoid."""
        return self.heights.with_heights(self.crs)

    @property
    def words(self) -> str:
        """What the metadata of products say beside the CRS; empty where positions are taken as they are."""
        said = []
        if self.parameters is not None:
            said.append(
                f"Recorded longitudes and latitudes are brought to the map's epoch with {self.parameters.name}."
            )
        if self.heights.vertical is not None:
            said.append(f"Heights are above {self.heights.name} ({self.heights.source}).")
        if self.stated is not None:
            said.append(f"Coordinates are those of {self.stated.name}.")
        return " ".join(said)

    @property
    def wkt(self) -> str:
        """WKT 2 of the whole, with the coordinates' epoch where the session states one (ISO 19162, 15.3)."""
        text = self.whole_crs.to_wkt()
        return f"COORDINATEMETADATA[{text},EPOCH[{self.stated.epoch:.10g}]]" if self.stated is not None else text

    @property
    def name(self) -> str:
        """Such as ``EPSG:6677``, or the CRS's own name where it has no code."""
        return name_of(self.crs)

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
        area = (self.named or self.crs).area_of_use
        if area is None or not len(lon_deg):
            return
        lon, lat = middle_deg(lon_deg, lat_deg)
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
        scale = self.scale(*middle_deg(lon_deg, lat_deg))
        if abs(scale - 1.0) > SCALE_OFF:
            raise RefusedError(
                f"{self.name} stretches the ground at the recording's place by a factor of {scale:.4f}.",
                "Scans are placed in true metres, so the cloud would not fit its own track, and areas would be wrong.",
                "Set `[crs] map` to a projected CRS of the place (UTM or a national one): see `furrowmap init`.",
                code="crs-scale",
            )


def middle_deg(lon_deg: FloatArray, lat_deg: FloatArray) -> tuple[float, float]:
    """(longitude, latitude) in the middle of places (n,), which may lie on both sides of the 180th meridian."""
    known = lon_deg[np.isfinite(lon_deg)]
    first = float(known[0]) if len(known) else 0.0
    east = float(np.median((known - first + 180.0) % 360.0)) - 180.0 if len(known) else float("nan")
    return (first + east + 180.0) % 360.0 - 180.0, float(np.nanmedian(lat_deg))


def map_frame(crs: Crs, parameters_file: Path | None = None, geoid_grid: Path | None = None) -> MapFrame:
    """The map frame that a session asks for.

    Args:
        crs: the session's table.
        parameters_file: the file that `crs.parameters` names.
        geoid_grid: the file that `crs.geoid_grid` names.

    Raises:
        InputError: if the CRS, the heights or the coordinates are unknown, the CRS is not projected or not in metres,
            or a file that belongs to them is missing or of another kind.
        RefusedError: if they cannot be had without a guess.
    """
    flat, vertical = _projected(crs)
    unused = vertical if crs.heights == ELLIPSOIDAL else None
    parameters = _parameters(crs, flat, parameters_file)
    stated = stated_frame(crs.coordinates)
    if stated is None and crs.coordinates not in (AS_RECORDED, CURRENT_EPOCH):
        raise InputError(
            f"The session's key `crs.coordinates` is {crs.coordinates!r}.",
            "What the recorded coordinates are is not known, so nothing was done.",
            f'Write "{AS_RECORDED}", "{CURRENT_EPOCH}" with a parameter file, or a frame and epoch: "itrf2020@2026.4".',
            code="crs-coordinates",
        )
    base = (stated.frame if stated is not None else flat.geodetic_crs) or flat
    heights = height_system(crs.heights, base, geoid_grid)
    if stated is not None:
        return MapFrame(stated.map_crs(flat), None, stated, heights, flat, unused)
    return MapFrame(flat, parameters, None, heights, None, unused)


def _projected(crs: Crs) -> tuple[CRS, CRS | None]:
    """The horizontal CRS of the map, and the vertical one that is named with it."""
    try:
        whole = CRS.from_user_input(crs.map)
    except CRSError as error:
        raise InputError(
            f"The session's key `crs.map`: {crs.map!r} is no CRS that PROJ knows ({error}).",
            "Without the map's CRS nothing can be placed.",
            'Write an EPSG code such as "EPSG:6677", or a WKT text.',
            code="crs-unknown",
        ) from None
    flat, *vertical = whole.sub_crs_list if whole.is_compound else [whole.to_2d()]
    units = {axis.unit_name for axis in flat.axis_info}
    if not flat.is_projected or units != {"metre"}:
        raise InputError(
            f"The session's key `crs.map`: {crs.map} ({whole.name}) is in {' and '.join(sorted(units))}, not projected "
            "in metres.",
            "Heights, distances and areas need a map frame in metres.",
            "Choose a projected CRS of the place; `furrowmap init` proposes one.",
            code="crs-not-projected",
        )
    return flat, vertical[0] if vertical else None


def _parameters(crs: Crs, flat: CRS, file: Path | None) -> ParameterFile | None:
    """The file that leads from the current epoch to the map's; None where coordinates are taken as they are."""
    if crs.coordinates != CURRENT_EPOCH:
        return None
    base = flat.geodetic_crs
    if base is None or not base.name.startswith(("JGD2011", "JGD2024")):
        raise RefusedError(
            f"{crs.map} ({flat.name}) is a map whose epoch no parameter file known here leads to.",
            "Parameters between epochs are read for Japan, to the epoch of JGD2011 and JGD2024.",
            'Choose a CRS on JGD2011, or go on in the frame of the receiver: `coordinates = "itrf2020@2026.4"`.',
            code="epoch-map",
        )
    if file is None:
        raise RefusedError(
            f'The session\'s key `crs.coordinates` is "{CURRENT_EPOCH}", and no key `crs.parameters` names a file.',
            "Since the map's epoch the ground has moved by decimetres, and how far only the file tells.",
            "Download the file of the recording's fiscal year from the Geospatial Information Authority of Japan, and "
            'write `parameters = "SemiDyna2026.par"` under [crs]; or state frame and epoch: "itrf2020@2026.4".',
            code="parameters-missing",
        )
    found = read_parameters(file)
    if found.format not in BETWEEN_EPOCHS:
        raise InputError(
            f"{found.name} holds parameters of the kind {found.format}, which lead from one datum to another.",
            "They are not those of the ground's steady movement since the map's epoch.",
            "Name the SemiDyna file of the fiscal year in which the recording was made, or the POS2JGD file of its "
            "quarter.",
            code="parameters-kind",
        )
    return found
