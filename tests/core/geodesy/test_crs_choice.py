"""The CRS proposed for a place, against what surveyors there use."""

from __future__ import annotations

import math
import re
from importlib.resources import files

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pyproj import CRS, Proj

from furrowmap.core.geodesy.crs_choice import choose_crs
from furrowmap.core.geodesy.projection import map_frame
from furrowmap.core.values.session import Crs

# Towns and the zone of Japan's plane rectangular system that the law gives them (public notice no. 9 of 2002).
IN_JAPAN = [
    ("Nagasaki", 129.88, 32.75, 1),
    ("Kumamoto", 130.71, 32.80, 2),
    ("Hiroshima", 132.46, 34.40, 3),
    ("Kochi", 133.53, 33.56, 4),
    ("Tottori", 134.24, 35.50, 5),
    ("Kyoto", 135.76, 35.02, 6),
    ("Nagoya", 136.91, 35.18, 7),
    ("Niigata", 139.02, 37.90, 8),
    ("Otawara", 140.02, 36.87, 9),
    ("Sendai", 140.87, 38.27, 10),
    ("Hakodate", 140.73, 41.77, 11),
    ("Asahikawa", 142.36, 43.77, 12),
    ("Obihiro", 143.20, 42.92, 13),
    ("Naha", 127.68, 26.21, 15),
    ("Ishigaki", 124.16, 24.34, 16),
]
# Towns that only the border of a prefecture tells from the zone beside theirs.
NEAR_A_BORDER = [("Maebashi", 139.06, 36.39, 9), ("Hamamatsu", 137.73, 34.71, 8), ("Muroran", 140.97, 42.32, 12)]


@pytest.mark.parametrize(("town", "lon_deg", "lat_deg", "zone"), IN_JAPAN, ids=[row[0] for row in IN_JAPAN])
def test_japan__its_plane_rectangular_zone(town: str, lon_deg: float, lat_deg: float, zone: int) -> None:
    choice = choose_crs(lon_deg, lat_deg)
    assert choice is not None
    assert choice.code == f"EPSG:{6668 + zone}"


@pytest.mark.parametrize(("town", "lon_deg", "lat_deg", "zone"), NEAR_A_BORDER, ids=[row[0] for row in NEAR_A_BORDER])
def test_japan__near_a_border_the_right_zone_is_at_least_named(
    town: str, lon_deg: float, lat_deg: float, zone: int
) -> None:
    choice = choose_crs(lon_deg, lat_deg)
    assert choice is not None
    assert any(f"EPSG:{6668 + zone}" in str(text) for text in (choice.code, *choice.alternatives))


# Places and the CRS of the official maps there, as the mapping agencies state them: Kartverket "EUREF89 UTM", SDFI
# "UTM/ETRS89", AdV "Amtliche Landesvermessung", IGN-F decree 2000-1276, NGI "Lambert 2008", OSi "ITM", LINZ, ICSM,
# IBGE, NGS, NRCan, INEGI, IGN Argentina, GUGiK, Lantmäteriet, NLS Finland, DGT, IGN-E royal decree 1071/2007.
NATIONAL = [
    ("Slagelse", 11.39, 55.33, 25832),
    ("Copenhagen", 12.57, 55.68, 25832),
    ("Bornholm", 14.90, 55.10, 25833),
    ("Bergen", 5.32, 60.39, 25832),
    ("Svalbard", 15.60, 78.20, 25833),
    ("Kiel", 10.13, 54.30, 25832),
    ("Berlin", 13.40, 52.50, 25833),
    ("Chartres", 1.50, 48.45, 2154),
    ("Gembloux", 4.70, 50.56, 3812),
    ("Cork", -8.50, 51.90, 2157),
    ("Bologna", 11.30, 44.50, 7791),
    ("Valladolid", -4.72, 41.65, 25830),
    ("Tenerife", -16.50, 28.30, 4083),
    ("Coimbra", -8.40, 40.20, 3763),
    ("Warsaw", 21.00, 52.20, 2180),
    ("Uppsala", 17.60, 59.86, 3006),
    ("Turku", 22.30, 60.45, 3067),
    ("Konya", 32.50, 37.87, 5255),
    ("Harbin", 126.60, 45.80, 4551),
    ("Suwon", 127.00, 37.30, 5186),
    ("Perth", 115.90, -31.95, 7850),
    ("Canberra", 149.10, -35.30, 7855),
    ("Hamilton", 175.30, -37.80, 2193),
    ("Ames", -93.60, 42.03, 6344),
    ("Hilo", -155.10, 19.70, 6635),
    ("Regina", -104.60, 50.45, 2957),
    ("Culiacan", -107.40, 24.80, 6368),
    ("Piracicaba", -47.65, -22.70, 31983),
    ("Pergamino", -60.57, -33.89, 5347),
]
# Where the national map is on a datum without satellite positions: UTM on ETRS89, and that map for the products.
OLDER = [
    ("Wageningen", 5.66, 51.97, 25831, 28992),
    ("Lincoln", -0.54, 53.20, 25830, 27700),
    ("Vienna", 16.40, 48.20, 25833, 31287),
    ("Zurich", 8.50, 47.40, 25832, 2056),
    ("Vaduz", 9.52, 47.14, 25832, 2056),
    ("Luxembourg", 6.13, 49.61, 25832, 2169),
    ("Prague", 14.42, 50.09, 25833, 5514),
    ("Zvolen", 19.13, 48.57, 25834, 5514),
    ("Budapest", 19.04, 47.50, 25834, 23700),
    ("Athens", 23.73, 37.98, 25834, 2100),
    ("Bucharest", 26.10, 44.43, 25835, 3844),
]


@pytest.mark.parametrize(("town", "lon_deg", "lat_deg", "code"), NATIONAL, ids=[row[0] for row in NATIONAL])
def test_country__the_map_of_its_agency(town: str, lon_deg: float, lat_deg: float, code: int) -> None:
    choice = choose_crs(lon_deg, lat_deg)
    assert choice is not None
    assert choice.code == f"EPSG:{code}"
    frame = map_frame(Crs(map=choice.code))  # refuses maps on old datums
    assert np.isfinite(frame.project(np.array([lon_deg]), np.array([lat_deg]))).all()  # refuses places outside


@pytest.mark.parametrize(("town", "lon_deg", "lat_deg", "code", "older"), OLDER, ids=[row[0] for row in OLDER])
def test_country_with_an_older_datum__utm_and_its_map_for_the_products(
    town: str, lon_deg: float, lat_deg: float, code: int, older: int
) -> None:
    choice = choose_crs(lon_deg, lat_deg)
    assert choice is not None
    assert choice.code == f"EPSG:{code}"
    assert str(choice.alternatives[-1]).startswith(f"EPSG:{older} ")


def test_denmark__no_variants_of_the_zone_for_germany() -> None:
    choice = choose_crs(11.39, 55.33)
    assert choice is not None
    assert (choice.name, choice.alternatives) == ("ETRS89 / UTM zone 32N", ())
    assert str(choice.reason) == "55.3300°N 11.3900°E lies in Denmark, whose maps use it"


@pytest.mark.parametrize(
    ("lon_deg", "lat_deg", "code"),
    [(3.06, 50.6, 25831), (2.9, 42.7, 25831), (178.0, -38.66, 2135)],
    ids=["Lille", "Perpignan", "Gisborne"],
)
def test_country__where_its_map_distorts_too_much_the_utm_zone(lon_deg: float, lat_deg: float, code: int) -> None:
    choice = choose_crs(lon_deg, lat_deg)
    assert choice is not None
    assert choice.code == f"EPSG:{code}"


@pytest.mark.parametrize(
    ("lon_deg", "lat_deg", "code"),
    [(75.8, 30.9, 32643), (36.1, -0.3, 32737), (0.2, 50.0, 32631)],
    ids=["Ludhiana", "Nakuru", "English Channel"],
)
def test_elsewhere__the_utm_zone_on_wgs84(lon_deg: float, lat_deg: float, code: int) -> None:
    choice = choose_crs(lon_deg, lat_deg)
    assert choice is not None
    assert choice.code == f"EPSG:{code}"


def test_capital_of_each_time_zone__a_map_that_a_run_accepts() -> None:
    """418 places with coordinates from the time zone database; Antarctica has places beyond UTM."""
    table = (files("tzdata") / "zoneinfo" / "zone.tab").read_text("utf-8")
    rows = [line.split("\t") for line in table.splitlines() if not line.startswith("#")]
    for country, place, *_ in rows:
        lat_deg, lon_deg = (
            math.copysign(float(number[1 : 3 + wide]) + float(number[3 + wide : 5 + wide]) / 60, float(number))
            for wide, number in enumerate(re.findall(r"[+-]\d+", place))
        )
        choice = choose_crs(lon_deg, lat_deg)
        if country == "AQ" and choice is None:
            continue
        assert choice is not None, place
        e_m, n_m = map_frame(Crs(map=choice.code)).project(np.array([lon_deg]), np.array([lat_deg]))
        assert np.isfinite([e_m, n_m]).all(), place


def test_poles__no_choice() -> None:
    assert choose_crs(20.0, 86.0) is None


@given(st.floats(-180, 179.999), st.floats(-79.9, 83.9))
def test_anywhere__a_metric_crs_that_distorts_by_less_than_a_thousandth(lon_deg: float, lat_deg: float) -> None:
    choice = choose_crs(lon_deg, lat_deg)
    assert choice is not None
    crs = CRS.from_user_input(choice.code)
    assert crs.axis_info[0].unit_name == "metre"
    assert abs(Proj(crs).get_factors(lon_deg, lat_deg).meridional_scale - 1) < 1e-3


@pytest.mark.parametrize(
    ("lon_deg", "codes"),
    [
        (0.45, ["EPSG:32631", "EPSG:32630"]),
        (0.55, ["EPSG:32631"]),
        (5.45, ["EPSG:32631"]),
        (5.55, ["EPSG:32631", "EPSG:32632"]),
        (179.8, ["EPSG:32660", "EPSG:32601"]),
        (-179.8, ["EPSG:32601", "EPSG:32660"]),
    ],
)
def test_neighbouring_zone__is_named_within_half_a_degree_of_its_border(lon_deg: float, codes: list[str]) -> None:
    choice = choose_crs(lon_deg, 20.0)  # the Sahara and the Pacific
    assert choice is not None
    named = [choice.code, *(str(text).split(",")[0] for text in choice.alternatives)]
    assert named == codes


@pytest.mark.parametrize(
    ("lon_deg", "lat_deg", "place"),
    [(149.1, -35.3, "35.3000°S 149.1000°E"), (-77.25, 39.19, "39.1900°N 77.2500°W"), (9.5, 0.0, "0.0000°N 9.5000°E")],
)
def test_reason__names_the_place(lon_deg: float, lat_deg: float, place: str) -> None:
    choice = choose_crs(lon_deg, lat_deg)
    assert choice is not None
    assert str(choice.reason).startswith(f"{place} lies in")


@pytest.mark.parametrize(("outside_deg", "named"), [(0.08, True), (0.12, False)])
def test_zone_of_japan__is_an_alternative_within_a_tenth_of_a_degree(outside_deg: float, *, named: bool) -> None:
    """Of the box that PROJ has for zone IX, from its western side, in zone VIII."""
    area = CRS.from_epsg(6677).area_of_use
    assert area is not None
    choice = choose_crs(area.west - outside_deg, 36.5)
    assert choice is not None
    assert any("EPSG:6677" in str(text) for text in choice.alternatives) == named
