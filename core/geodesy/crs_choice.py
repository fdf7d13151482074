"""Choice of a projected CRS for a site."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cache
from typing import Final, TypeAlias

from pyproj import CRS
from pyproj.database import CRSInfo, query_utm_crs_info

_ZONES_OF_JAPAN: Final = {
    6669: "Nagasaki and the western islands of Kagoshima",
    6670: "Fukuoka, Saga, Kumamoto, Oita, Miyazaki, Kagoshima",
    6671: "Yamaguchi, Shimane, Hiroshima",
    6672: "Kagawa, Ehime, Tokushima, Kochi",
    6673: "Hyogo, Tottori, Okayama",
    6674: "Kyoto, Osaka, Fukui, Shiga, Mie, Nara, Wakayama",
    6675: "Ishikawa, Toyama, Gifu, Aichi",
    6676: "Niigata, Nagano, Yamanashi, Shizuoka",
    6677: "Tokyo, Fukushima, Tochigi, Ibaraki, Saitama, Chiba, Gunma, Kanagawa",
    6678: "Aomori, Akita, Yamagata, Iwate, Miyagi",
    6679: "western Hokkaido, such as Otaru, Hakodate, Date",
    6680: "central Hokkaido, such as Sapporo, Asahikawa, Tomakomai, Wakkanai",
    6681: "eastern Hokkaido, such as Obihiro, Kitami, Kushiro, Nemuro",
    6682: "Ogasawara",
    6683: "Okinawa's main islands",
    6684: "Miyako and Yaeyama",
    6685: "Daito",
    6686: "Okinotorishima",
    6687: "Minamitorishima",
}
"""EPSG codes of JGD2011 plane rectangular zones I to XIX with their prefectures (MLIT public notice no. 9 of 2002)."""
_NEAR_ZONE_DEG: Final = 0.1
_NEAR_UTM_DEG: Final = 0.5
"""Distance from a zone border (10 and about 50 km) within which the neighbouring zone is an alternative."""
_LOCAL_DATUMS: Final = ("ETRS89", "NAD83(2011)", "GDA2020", "NZGD2000", "SIRGAS 2000")
"""Current national datums with UTM zones of their own."""

_Box: TypeAlias = tuple[float, float, float, float]
"""West, south, east, north in degrees."""


@dataclass(frozen=True)
class CrsChoice:
    """A projected CRS proposed for a place.

    Attributes:
        code: such as "EPSG:6677".
        reason: for the choice, without a full stop.
        alternatives: other codes, each with its conditions.
    """

    code: str
    name: str
    reason: str
    alternatives: tuple[str, ...] = ()


def choose_crs(lon_deg: float, lat_deg: float) -> CrsChoice | None:
    """The CRS for a site: the plane rectangular zone in Japan, else the UTM zone on WGS 84; None near the poles."""
    return _plane_rectangular(lon_deg, lat_deg) or _utm(lon_deg, lat_deg)


def _plane_rectangular(lon_deg: float, lat_deg: float) -> CrsChoice | None:
    """The zone of Japan by bounding boxes, the most central first where they overlap; None outside all of them."""
    zones = sorted(
        (_eccentricity(area.bounds, lon_deg, lat_deg), code)
        for code in _ZONES_OF_JAPAN
        if (area := CRS.from_epsg(code).area_of_use) is not None
        and _outside_deg(area.bounds, lon_deg, lat_deg) <= _NEAR_ZONE_DEG
    )
    if not zones or zones[0][0] > 1.0:
        return None
    best, *others = (code for _, code in zones)
    return CrsChoice(
        code=f"EPSG:{best}",
        name=CRS.from_epsg(best).name,
        reason=f"{_place(lon_deg, lat_deg)} lies in its area of use ({_ZONES_OF_JAPAN[best]})",
        alternatives=tuple(f"EPSG:{code} for {_ZONES_OF_JAPAN[code]}" for code in others),
    )


def _utm(lon_deg: float, lat_deg: float) -> CrsChoice | None:
    """The UTM zone on WGS 84, with the neighbouring one if near and the zone on the national datum as alternatives."""
    zones = _utm_zones(lon_deg, lat_deg)
    own = _on_wgs84(zones)
    if own is None:
        return None
    local = tuple(
        f"{zone.auth_name}:{zone.code}, the zone on {datum}, the datum of maps there"
        for zone in zones
        if (datum := zone.name.partition(" / ")[0]) in _LOCAL_DATUMS and "(N-E)" not in zone.name
    )
    beside = (_on_wgs84(_utm_zones(lon_deg + shift, lat_deg)) for shift in (-_NEAR_UTM_DEG, _NEAR_UTM_DEG))
    neighbours = tuple(
        f"{zone.auth_name}:{zone.code}, the neighbouring zone, whose border is near"
        for zone in beside
        if zone is not None and zone.code != own.code
    )
    return CrsChoice(
        code=f"{own.auth_name}:{own.code}",
        name=own.name,
        reason=f"{_place(lon_deg, lat_deg)} lies in this zone",
        alternatives=tuple(dict.fromkeys(local + neighbours)),
    )


def _utm_zones(lon_deg: float, lat_deg: float) -> list[CRSInfo]:
    """The zones on all datums whose area of use contains the site."""
    lon_deg = (lon_deg + 180.0) % 360.0 - 180.0
    return [
        zone
        for zone in _all_utm_zones()
        if (area := zone.area_of_use) is not None and _outside_deg(area.bounds, lon_deg, lat_deg) == 0.0
    ]


@cache
def _all_utm_zones() -> tuple[CRSInfo, ...]:
    return tuple(query_utm_crs_info())


def _on_wgs84(zones: list[CRSInfo]) -> CRSInfo | None:
    return next((zone for zone in zones if zone.name.startswith("WGS 84 / UTM zone")), None)


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
