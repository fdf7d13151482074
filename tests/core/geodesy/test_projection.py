"""The map frame: easting first, and refusals where figures would lie."""

from __future__ import annotations

import numpy as np
import pytest
from pyproj import CRS, Geod, Proj, Transformer

from furrowmap.core.geodesy.longitudes import middle_deg
from furrowmap.core.geodesy.projection import map_frame, scale_at
from furrowmap.core.runtime.errors import FurrowmapError, InputError, RefusedError
from furrowmap.core.values.session import Crs

PLANE_RECTANGULAR = {
    1: (33.0, 129 + 30 / 60),
    2: (33.0, 131 + 0 / 60),
    3: (36.0, 132 + 10 / 60),
    4: (33.0, 133 + 30 / 60),
    5: (36.0, 134 + 20 / 60),
    6: (36.0, 136 + 0 / 60),
    7: (36.0, 137 + 10 / 60),
    8: (36.0, 138 + 30 / 60),
    9: (36.0, 139 + 50 / 60),
    10: (40.0, 140 + 50 / 60),
    11: (44.0, 140 + 15 / 60),
    12: (44.0, 142 + 15 / 60),
    13: (44.0, 144 + 15 / 60),
    14: (26.0, 142 + 0 / 60),
    15: (26.0, 127 + 30 / 60),
    16: (26.0, 124 + 0 / 60),
    17: (26.0, 131 + 0 / 60),
    18: (20.0, 136 + 0 / 60),
    19: (26.0, 154 + 0 / 60),
}
"""Latitude and longitude of the origins of zones I to XIX: Japan's ministry of land, public notice no. 9 of 2002."""
WGS84 = Geod(ellps="WGS84")


@pytest.mark.parametrize(
    ("code", "base", "lon", "lat"),
    [("EPSG:6677", "EPSG:6668", 140.02, 36.87), ("EPSG:32634", "EPSG:4326", 20.9356, 52.3758)],
)
def test_easting_comes_first_whatever_the_authority_says(code: str, base: str, lon: float, lat: float) -> None:
    frame = map_frame(Crs(map=code))
    e, n = frame.project(np.array([lon]), np.array([lat]))
    expected = Transformer.from_crs(base, code, always_xy=True).transform(lon, lat)
    np.testing.assert_allclose([e[0], n[0]], expected, atol=1e-6)
    east, north = frame.project(np.array([lon, lon + 1e-4, lon]), np.array([lat, lat, lat + 1e-4]))
    assert east[1] - east[0] > 5
    assert abs(north[1] - north[0]) < 0.1
    assert north[2] - north[0] > 10
    back = frame.to_lon_lat(e, n)
    np.testing.assert_allclose([back[0][0], back[1][0]], [lon, lat], atol=1e-10)


def test_convergence_takes_true_headings_to_grid_headings() -> None:
    """Against the direction in which the grid coordinates of a short way to the true north change."""
    frame = map_frame(Crs(map="EPSG:6677"))
    lon, lat = np.array([140.02]), np.array([36.87])
    e, n = frame.project(np.repeat(lon, 2), np.array([36.87, 36.8701]))
    grid_heading_of_true_north = np.degrees(np.arctan2(e[1] - e[0], n[1] - n[0]))
    np.testing.assert_allclose(frame.convergence_deg(lon, lat), -grid_heading_of_true_north, atol=1e-4)
    assert abs(frame.convergence_deg(lon, lat)[0] - 0.11) < 0.01  # the sample recordings' README


@pytest.mark.parametrize(
    ("crs", "kind", "word"),
    [
        (Crs(map="EPSG:4326"), InputError, "degree"),
        (Crs(map="EPSG:2229"), InputError, "foot"),
        (Crs(map="EPSG:99999"), InputError, "crs.map"),
        (Crs(map="EPSG:6677", heights="sea level"), InputError, "crs.heights"),
        (Crs(map="EPSG:32654", heights="EGM2008"), RefusedError, "us_nga_egm08_25.tif"),
        (Crs(map="EPSG:6677", coordinates="today"), InputError, "crs.coordinates"),
        (Crs(map="EPSG:6677", coordinates="current-epoch"), RefusedError, "crs.coordinates"),
    ],
)
def test_promise_17__what_cannot_be_a_map_frame_is_refused(crs: Crs, kind: type[FurrowmapError], word: str) -> None:
    with pytest.raises(kind, match=word):
        map_frame(crs)


def test_promise_17__a_place_outside_the_area_is_refused_with_both() -> None:
    with pytest.raises(RefusedError, match=r"52\.3758.*EPSG:6677"):
        map_frame(Crs(map="EPSG:6677")).project(np.array([20.9356]), np.array([52.3758]))


def test_a_map_that_stretches_the_ground_is_refused() -> None:
    lon, lat = np.array([140.02]), np.array([36.87])
    with pytest.raises(RefusedError, match=r"scale of 1\.2"):
        map_frame(Crs(map="EPSG:3857")).project(lon, lat)
    assert abs(map_frame(Crs(map="EPSG:32654")).scale(140.02, 36.87) - 0.9996) < 2e-4
    e, _ = map_frame(Crs(map="EPSG:32654")).project(lon, lat)
    assert np.isfinite(e[0])


def test_a_compound_crs_serves_by_its_horizontal_part() -> None:
    assert map_frame(Crs(map="EPSG:6677+6695")).name == "EPSG:6677"


@pytest.mark.parametrize("zone", range(1, 20))
def test_plane_rectangular_zones__are_those_of_the_public_notice(zone: int) -> None:
    """At a place in the zone: the notice's origin and scale in PROJ's transverse Mercator, easting before northing."""
    lat_0, lon_0 = PLANE_RECTANGULAR[zone]
    code = f"EPSG:{6668 + zone}"
    area = CRS(code).area_of_use
    lon = np.array([0.5 * (area.west + area.east)])
    lat = np.array([0.5 * (area.south + area.north)])
    frame = map_frame(Crs(map=code))
    notice = Proj(proj="tmerc", lat_0=lat_0, lon_0=lon_0, k=0.9999, ellps="GRS80")
    np.testing.assert_allclose(frame.project(lon, lat), notice(lon, lat), rtol=0, atol=1e-6)
    older = Transformer.from_crs("EPSG:4612", f"EPSG:{2442 + zone}", always_xy=True).transform(lon, lat)
    np.testing.assert_allclose(frame.project(lon, lat), older, rtol=0, atol=1e-6)


def test_a_track_across_the_antimeridian_has_one_middle_and_no_jump() -> None:
    lon, lat = np.array([179.9999, 180.0, -179.9999]), np.full(3, -17.0)
    east, south = middle_deg(lon, lat)
    assert (abs(east), south) == (180.0, -17.0)
    for code in ("EPSG:32760", "EPSG:32701"):
        e, n = map_frame(Crs(map=code)).project(lon, lat)
        _, _, step_m = WGS84.inv(179.9999, -17.0, 180.0, -17.0)
        np.testing.assert_allclose(np.hypot(np.diff(e), np.diff(n)), step_m, rtol=1e-3)
        assert 8.0e6 < n[0] < 1.0e7  # south of the equator northings count from 10,000 km


@pytest.mark.parametrize("lon", [143.9999, 144.0001])
def test_utm_zones_meet_at_their_border(lon: float) -> None:
    """A place a few metres from the border has coordinates in both zones, and both lead back to it."""
    for code in ("EPSG:32654", "EPSG:32655"):
        frame = map_frame(Crs(map=code))
        back = frame.to_lon_lat(*frame.project(np.array([lon]), np.array([43.0])))
        np.testing.assert_allclose([back[0][0], back[1][0]], [lon, 43.0], atol=1e-11)


@pytest.mark.parametrize("e_m", [500_000.0, 651_500.0, 790_000.0])
def test_scale_at__is_that_of_geodesic_lengths(e_m: float) -> None:
    utm = CRS.from_epsg(25832)
    back = Transformer.from_crs(utm, 4258, always_xy=True)
    (west, east), lat = back.transform([e_m - 50.0, e_m + 50.0], [6_133_880.0, 6_133_880.0])
    length = Geod(ellps="GRS80").inv(west, lat[0], east, lat[1])[2]
    assert scale_at(utm, e_m, 6_133_880.0) == pytest.approx(100.0 / length, rel=1e-7)
