"""The CRS proposed for a place, against what surveyors there use."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pyproj import CRS, Proj

from furrowmap.core.geodesy.crs_choice import choose_crs

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
    assert any(f"EPSG:{6668 + zone}" in text for text in (choice.code, *choice.alternatives))


def test_europe__the_utm_zone_the_neighbour_and_the_local_datum() -> None:
    choice = choose_crs(0.2, 50.0)
    assert choice is not None
    assert (choice.code, choice.name) == ("EPSG:32631", "WGS 84 / UTM zone 31N")
    assert [text.split(",")[0] for text in choice.alternatives] == ["EPSG:25831", "EPSG:32630"]
    assert "50.0000°N 0.2000°E" in choice.reason


@pytest.mark.parametrize(
    ("lon_deg", "lat_deg", "code"),
    [
        (15.6, 78.2, "EPSG:32633"),
        (-77.25, 39.19, "EPSG:32618"),
        (149.1, -35.3, "EPSG:32755"),
    ],
    ids=["Svalbard", "Maryland", "Canberra"],
)
def test_elsewhere__the_utm_zone(lon_deg: float, lat_deg: float, code: str) -> None:
    choice = choose_crs(lon_deg, lat_deg)
    assert choice is not None
    assert choice.code == code


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
    choice = choose_crs(lon_deg, 20.0)
    assert choice is not None
    named = [choice.code, *(text.split(",")[0] for text in choice.alternatives)]
    assert [code for code in named if code.startswith("EPSG:32")] == codes


@pytest.mark.parametrize(
    ("lon_deg", "lat_deg", "place"),
    [(149.1, -35.3, "35.3000°S 149.1000°E"), (-77.25, 39.19, "39.1900°N 77.2500°W"), (9.5, 0.0, "0.0000°N 9.5000°E")],
)
def test_reason__names_the_place(lon_deg: float, lat_deg: float, place: str) -> None:
    choice = choose_crs(lon_deg, lat_deg)
    assert choice is not None
    assert choice.reason.startswith(f"{place} lies in")


@pytest.mark.parametrize(("outside_deg", "named"), [(0.08, True), (0.12, False)])
def test_zone_of_japan__is_an_alternative_within_a_tenth_of_a_degree(outside_deg: float, *, named: bool) -> None:
    """Of the box that PROJ has for zone IX, from its western side, in zone VIII."""
    area = CRS.from_epsg(6677).area_of_use
    assert area is not None
    choice = choose_crs(area.west - outside_deg, 36.5)
    assert choice is not None
    assert any("EPSG:6677" in text for text in choice.alternatives) == named
