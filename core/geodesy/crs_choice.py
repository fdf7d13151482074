"""Choice of a projected CRS for a site."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from importlib.resources import files
from typing import Final, TypeAlias

from pyproj import CRS
from pyproj.database import CRSInfo, query_utm_crs_info

from furrowmap.core.geodesy.local_time import zone_at
from furrowmap.core.geodesy.longitudes import principal_deg
from furrowmap.core.geodesy.projection import AREA_MARGIN_DEG, MAX_SCALE_ERROR, scale_of
from furrowmap.core.runtime.languages.texts import Text, figure_text

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
    6679: Text("western Hokkaido, such as Otaru, Hakodate, Date"),
    6680: Text("central Hokkaido, such as Sapporo, Asahikawa, Tomakomai, Wakkanai"),
    6681: Text("eastern Hokkaido, such as Obihiro, Kitami, Kushiro, Nemuro"),
    6682: "Ogasawara",
    6683: "Okinawa's main islands",
    6684: "Miyako and Yaeyama",
    6685: "Daito",
    6686: "Okinotorishima",
    6687: "Minamitorishima",
}
"""EPSG codes of JGD2011 plane rectangular zones I to XIX with their prefectures (MLIT public notice no. 9 of 2002)."""
_ETRS89: Final = range(25828, 25838)
"""ETRS89 / UTM zones 28N to 37N, where a country of Europe has no map of its own on that datum (EUREF, INSPIRE)."""
_OF_COUNTRIES: Final[Mapping[str, tuple[Sequence[int], ...]]] = {
    "AR": (range(5343, 5350),),  # IGN: POSGAR 2007, seven belts
    "AU": (range(7846, 7860),),  # ICSM: GDA2020 / MGA
    "BE": ((3812,),),  # NGI: Belgian Lambert 2008
    "BG": ((7801,),),  # AGCC: BGS2005 / CCS2005
    "BR": ((*range(31972, 31986), 6210, 6211),),  # IBGE, resolution 1 of 2005: SIRGAS 2000 / UTM
    "CA": ((*range(2955, 2963), *range(3154, 3161), 3761),),  # NRCan: NAD83(CSRS) / UTM
    "CN": (range(4534, 4555),),  # Ministry of Natural Resources: CGCS2000, zones of 3 degrees
    "CO": ((9377,),),  # IGAC, resolution 471 of 2020: Origen-Nacional
    "DE": ((25832, 25833),),  # AdV: UTM zones 32 and 33
    "DK": ((25832,), (25833,)),  # Climate Data Agency: zone 32 for all but Bornholm
    "EE": ((3301,),),  # Land Board: L-EST97
    "ES": ((25829, 25830, 25831), (4082, 4083)),  # Royal decree 1071/2007: ETRS89, on the Canaries REGCAN95
    "FI": ((3067,),),  # NLS, JHS 197: TM35FIN
    "FR": ((2154,),),  # Decree 2000-1276: Lambert-93
    "HR": ((3765,),),  # Geodetic Administration: HTRS96 / TM
    "IE": ((2157,),),  # Tailte Éireann: Irish Transverse Mercator
    "IS": ((8088,),),  # Natural Science Institute: Lambert 2016
    "IT": ((7791, 7792, 7793),),  # Decree of 10 November 2011: RDN2008
    "KR": ((5185, 5186, 5187, 5188),),  # NGII: belts of 2010
    "LT": ((3346,),),  # LKS-94
    "LV": ((3059,),),  # LKS-92
    "MX": (range(6366, 6372),),  # INEGI: ITRF2008
    "NO": (range(25832, 25837),),  # Kartverket: zone 32 up to the west coast
    "NZ": ((2193,), (2133, 2134, 2135)),  # LINZ: NZTM2000
    "PL": ((2180,),),  # Regulation of 15 October 2012: PL-1992
    "PT": ((3763,), (5014, 5015, 5016)),  # DGT: PT-TM06, on the islands PTRA08
    "SE": ((3006,),),  # Lantmäteriet: SWEREF 99 TM
    "SI": ((3794,),),  # D96/TM
    "TR": (range(5253, 5260),),  # Regulation on large-scale maps: TUREF, zones of 3 degrees
    "TW": ((3826, 3825),),  # NLSC: TWD97 / TM2
    "US": ((*range(6328, 6349), 6634, 6635),),  # NGS: NAD83(2011), on Hawaii NAD83(PA11)
    "UY": ((5382, 5383),),  # IGM: SIRGAS-ROU98
}
"""EPSG codes of a country's maps, the preferred ones first, on datums of satellite positions; with who chose them."""
_ON_ETRS89: Final = (
    "AD AL AT BA BE BG CH CY CZ DE DK EE ES FI FR GB GG GI GR HR HU IE IM IT JE LI LT LU LV MC ME MK MT NL NO PL PT RO "
    "RS SE SI SJ SK SM VA"
)
"""Codes of countries on ETRS89."""
_OLDER: Final = {
    "AT": 31287, "CH": 2056, "CZ": 5514, "GB": 27700, "GR": 2100, "HU": 23700, "LI": 2056, "LU": 2169, "NL": 28992,
    "RO": 3844, "SK": 5514,
}  # fmt: skip
"""National maps on datums in which no satellite service gives positions."""
_NEAR_ZONE_DEG: Final = 0.1
_NEAR_UTM_DEG: Final = 0.5
"""Distance from a zone border (10 and about 50 km) within which the neighbouring zone is an alternative."""


_Box: TypeAlias = tuple[float, float, float, float]
"""West, south, east, north in degrees."""


@dataclass(frozen=True)
class CrsChoice:
    """A projected CRS proposed for a place, such as "EPSG:6677", why, and other codes, each with its conditions."""

    code: str
    name: str
    reason: Text
    alternatives: tuple[Text, ...] = ()


def choose_crs(lon_deg: float, lat_deg: float) -> CrsChoice | None:
    """The CRS for a site: that of the country's maps, else the UTM zone on WGS 84; None near the poles.

    A map that a run would refuse there, for its scale error, is left out.
    """
    lon_deg = principal_deg(lon_deg)
    return _plane_rectangular(lon_deg, lat_deg) or _national(lon_deg, lat_deg) or choose_utm(lon_deg, lat_deg)


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
        reason=Text(
            "{place} lies in its area of use ({area})",
            place=_place(lon_deg, lat_deg),
            area=_ZONES_OF_JAPAN[best],
        ),
        alternatives=tuple(
            Text("{code} for {area}", code=f"EPSG:{code}", area=_ZONES_OF_JAPAN[code]) for code in others
        ),
    )


def _national(lon_deg: float, lat_deg: float) -> CrsChoice | None:
    """The map of the country, by the boundaries of time zones; None where it has none of its own that suits."""
    country = _countries().get(zone_at(lon_deg, lat_deg).key)
    if country is None:
        return None
    own = _OF_COUNTRIES.get(country.code, ())
    families = own
    if country.code in _ON_ETRS89:
        families += (_ETRS89,)
    suitable = sorted(
        (family, outside_deg, code)
        for family, codes in enumerate(families)
        for code in codes
        if (outside_deg := _outside_area_deg(code, lon_deg, lat_deg)) <= AREA_MARGIN_DEG
        and abs(scale_of(CRS.from_epsg(code), lon_deg, lat_deg) - 1.0) <= MAX_SCALE_ERROR
    )
    if not suitable:
        return None
    place = _place(lon_deg, lat_deg)
    family, _, best = suitable[0]
    others = [
        _neighbour(f"EPSG:{code}")
        for number, outside_deg, code in suitable[1:]
        if number == family and outside_deg <= _NEAR_UTM_DEG
    ]
    if older := _OLDER.get(country.code):
        name = CRS.from_epsg(older).name
        others.append(
            Text("{code} ({name}) for the products, with `furrowmap export --dst-crs`", code=f"EPSG:{older}", name=name)
        )
    return CrsChoice(
        code=f"EPSG:{best}",
        name=CRS.from_epsg(best).name,
        reason=Text("{place} lies in {country}, whose maps use it", place=place, country=country.name)
        if family < len(own)
        else Text("{place} lies in this zone", place=place),
        alternatives=tuple(others),
    )


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


def _neighbour(code: str) -> Text:
    return Text("{code}, the neighbouring zone, whose border is near", code=code)


def choose_utm(lon_deg: float, lat_deg: float) -> CrsChoice | None:
    """The UTM zone on WGS 84, with the neighbouring one as an alternative if its border is near."""
    lon_deg = principal_deg(lon_deg)
    own = _utm_zone(lon_deg, lat_deg)
    if own is None:
        return None
    beside = (_utm_zone(lon_deg + shift, lat_deg) for shift in (-_NEAR_UTM_DEG, _NEAR_UTM_DEG))
    return CrsChoice(
        code=f"{own.auth_name}:{own.code}",
        name=own.name,
        reason=Text("{place} lies in this zone", place=_place(lon_deg, lat_deg)),
        alternatives=tuple(
            _neighbour(f"{zone.auth_name}:{zone.code}") for zone in beside if zone is not None and zone.code != own.code
        ),
    )


def _utm_zone(lon_deg: float, lat_deg: float) -> CRSInfo | None:
    """The zone on WGS 84 whose area of use contains the site."""
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
    """Distance of the site from the box, which may cross the antimeridian; 0 inside."""
    west, south, east, north = box
    width = (east - west) % 360.0 or 360.0
    beside = 0.0 if (lon_deg - west) % 360.0 <= width else min((west - lon_deg) % 360.0, (lon_deg - east) % 360.0)
    return math.hypot(beside, max(south - lat_deg, 0.0, lat_deg - north))


def _place(lon_deg: float, lat_deg: float) -> Text:
    return figure_text(f"{abs(lat_deg):.4f}°{'NS'[lat_deg < 0]} {abs(lon_deg):.4f}°{'EW'[lon_deg < 0]}")
