"""Choice of a projected CRS for a site."""

import math
from dataclasses import dataclass
from functools import cache
from importlib.resources import files
from typing import Any, Final, TypeAlias

from pyproj import CRS
from pyproj.database import CRSInfo, query_utm_crs_info

from furrowmap.core.geodesy.local_time import zone_at
from furrowmap.core.geodesy.projection import AREA_MARGIN_DEG, MAX_SCALE_ERROR, scale_of
from furrowmap.core.runtime.tables import own_table

_ETRS89: Final = range(25828, 25838)
"""ETRS89 / UTM zones 28N to 37N, where a country of Europe has no map of its own on that datum (EUREF, INSPIRE)."""
_ON_ETRS89: Final = (
    "AD AL AT BA BE BG CH CY CZ DE DK EE ES FI FR GB GG GI GR HR HU IE IM IT JE LI LT LU LV MC ME MK MT NL NO PL PT RO "
    "RS SE SI SJ SK SM VA"
)
"""Codes of countries on ETRS89."""
_NEAR_ZONE_DEG: Final = 0.1
_NEAR_UTM_DEG: Final = 0.5
"""Distance from a zone border (10 and about 50 km) within which the neighbouring zone is an alternative."""

_NEIGHBOUR: Final = ", the neighbouring zone, whose border is near"

_Box: TypeAlias = tuple[float, float, float, float]
"""West, south, east, north in degrees."""


@dataclass(frozen=True)
class CrsChoice:
    """A projected CRS proposed for a place, such as "EPSG:6677", why, and other codes, each with its conditions."""

    code: str
    name: str
    reason: str
    alternatives: tuple[str, ...] = ()


def choose_crs(lon_deg: float, lat_deg: float) -> CrsChoice | None:
    """The CRS for a site: that of the country's maps, else the UTM zone on WGS 84; None near the poles.

    A map that a run would refuse there, for its scale error, is left out.
    """
    return _plane_rectangular(lon_deg, lat_deg) or _national(lon_deg, lat_deg) or choose_utm(lon_deg, lat_deg)


def _plane_rectangular(lon_deg: float, lat_deg: float) -> CrsChoice | None:
    """The zone of Japan by bounding boxes, the most central first where they overlap; None outside all of them."""
    japan = _maps("japan")
    zones = sorted(
        (_eccentricity(area.bounds, lon_deg, lat_deg), code)
        for code in map(int, japan)
        if (area := CRS.from_epsg(code).area_of_use) is not None
        and _outside_deg(area.bounds, lon_deg, lat_deg) <= _NEAR_ZONE_DEG
    )
    if not zones or zones[0][0] > 1.0:
        return None
    best, *others = (code for _, code in zones)
    return CrsChoice(
        code=f"EPSG:{best}",
        name=CRS.from_epsg(best).name,
        reason=f"{_place(lon_deg, lat_deg)} lies in its area of use ({japan[str(best)]})",
        alternatives=tuple(f"EPSG:{code} for {japan[str(code)]}" for code in others),
    )


def _national(lon_deg: float, lat_deg: float) -> CrsChoice | None:
    """The map of the country, by the boundaries of time zones; None where it has none of its own that suits."""
    country = _countries().get(zone_at(lon_deg, lat_deg).key)
    if country is None:
        return None
    own = [_codes(family) for family in _maps("countries").get(country.code, ())]
    families = [*own, _ETRS89] if country.code in _ON_ETRS89 else own
    suitable = sorted(
        (family, outside_deg, code)
        for family, codes in enumerate(families)
        for code in codes
        if (outside_deg := _outside_area_deg(code, lon_deg, lat_deg)) <= AREA_MARGIN_DEG
        and abs(scale_of(CRS.from_epsg(code), lon_deg, lat_deg) - 1.0) <= MAX_SCALE_ERROR
    )
    if not suitable:
        return None
    family, _, best = suitable[0]
    others = [
        f"EPSG:{code}{_NEIGHBOUR}"
        for number, outside_deg, code in suitable[1:]
        if number == family and outside_deg <= _NEAR_UTM_DEG
    ]
    if older := _maps("older").get(country.code):
        name = CRS.from_epsg(older).name
        others.append(f"EPSG:{older} ({name}) for the products, with `furrowmap export --dst-crs`")
    return CrsChoice(
        code=f"EPSG:{best}",
        name=CRS.from_epsg(best).name,
        reason=_place(lon_deg, lat_deg)
        + (f" lies in {country.name}, whose maps use it" if family < len(own) else " lies in this zone"),
        alternatives=tuple(others),
    )


def _maps(part: str) -> dict[str, Any]:
    """A table of `national_maps.toml`."""
    return own_table("geodesy", "national_maps")[part]  # type: ignore[no-any-return]


def _codes(family: str) -> list[int]:
    """EPSG codes written as "2955-2962 3761"."""
    spans = (part.partition("-") for part in family.split())
    return [code for first, _, last in spans for code in range(int(first), int(last or first) + 1)]


@dataclass(frozen=True)
class _Country:
    """A country by its code of ISO 3166, such as "DK", and its English name."""

    code: str
    name: str


@cache
def _countries() -> dict[str, _Country]:
    """The country of each time zone, by the tables of the time zone database."""
    folder = files("tzdata") / "zoneinfo"
    names, zones = (
        [line.split("\t") for line in (folder / table).read_text("utf-8").splitlines() if not line.startswith("#")]
        for table in ("iso3166.tab", "zone.tab")
    )
    name_of = dict(names)
    return {zone: _Country(code, name_of[code]) for code, _, zone, *_ in zones}


def _outside_area_deg(code: int, lon_deg: float, lat_deg: float) -> float:
    """Distance of the site from the area of use of a CRS; 0 inside."""
    area = CRS.from_epsg(code).area_of_use
    return math.inf if area is None else _outside_deg(area.bounds, lon_deg, lat_deg)


def choose_utm(lon_deg: float, lat_deg: float) -> CrsChoice | None:
    """The UTM zone on WGS 84, with the neighbouring one as an alternative if its border is near."""
    own = _utm_zone(lon_deg, lat_deg)
    if own is None:
        return None
    beside = (_utm_zone(lon_deg + shift, lat_deg) for shift in (-_NEAR_UTM_DEG, _NEAR_UTM_DEG))
    return CrsChoice(
        code=f"{own.auth_name}:{own.code}",
        name=own.name,
        reason=f"{_place(lon_deg, lat_deg)} lies in this zone",
        alternatives=tuple(
            f"{zone.auth_name}:{zone.code}{_NEIGHBOUR}" for zone in beside if zone is not None and zone.code != own.code
        ),
    )


def _utm_zone(lon_deg: float, lat_deg: float) -> CRSInfo | None:
    """The zone on WGS 84 whose area of use contains the site."""
    lon_deg = (lon_deg + 180.0) % 360.0 - 180.0
    return next(
        (
            zone
            for zone in _utm_zones()
            if (area := zone.area_of_use) is not None and _outside_deg(area.bounds, lon_deg, lat_deg) == 0.0
        ),
        None,
    )


@cache
def _utm_zones() -> tuple[CRSInfo, ...]:
    return tuple(zone for zone in query_utm_crs_info("WGS 84") if zone.name.startswith("WGS 84 / UTM zone"))


def _eccentricity(box: _Box, lon_deg: float, lat_deg: float) -> float:
    """0 in the middle of the box, 1 on its edge."""
    west, south, east, north = box
    return max(abs(2 * lon_deg - west - east) / (east - west), abs(2 * lat_deg - south - north) / (north - south))


def _outside_deg(box: _Box, lon_deg: float, lat_deg: float) -> float:
    """Distance of the site from the box; 0 inside."""
    west, south, east, north = box
    return math.hypot(max(west - lon_deg, 0.0, lon_deg - east), max(south - lat_deg, 0.0, lat_deg - north))


def _place(lon_deg: float, lat_deg: float) -> str:
    return f"{abs(lat_deg):.4f}°{'S' if lat_deg < 0 else 'N'} {abs(lon_deg):.4f}°{'W' if lon_deg < 0 else 'E'}"
