"""The map frame: easting first, and refusals where figures would lie."""

from __future__ import annotations

import numpy as np
import pytest
from pyproj import Transformer

from furrowmap.core.trajectory.projection import map_frame
from furrowmap.core.values.errors import FurrowmapError, InputError, RefusedError
from furrowmap.core.values.session import Crs


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
        (Crs(map="EPSG:6677", heights="JGD2011 (vertical)"), RefusedError, "crs.heights"),
        (Crs(map="EPSG:6677", coordinates="current-epoch"), RefusedError, "crs.coordinates"),
    ],
)
def test_what_cannot_be_a_map_frame_is_said(crs: Crs, kind: type[FurrowmapError], word: str) -> None:
    with pytest.raises(kind, match=word):
        map_frame(crs)


def test_a_place_outside_the_area_is_refused_with_both() -> None:
    with pytest.raises(RefusedError, match=r"52\.3758.*EPSG:6677"):
        map_frame(Crs(map="EPSG:6677")).project(np.array([20.9356]), np.array([52.3758]))


def test_a_map_that_stretches_the_ground_is_refused() -> None:
    lon, lat = np.array([140.02]), np.array([36.87])
    with pytest.raises(RefusedError, match=r"factor of 1\.2"):
        map_frame(Crs(map="EPSG:3857")).project(lon, lat)
    assert abs(map_frame(Crs(map="EPSG:32654")).scale(140.02, 36.87) - 0.9996) < 2e-4
    e, _ = map_frame(Crs(map="EPSG:32654")).project(lon, lat)
    assert np.isfinite(e[0])


def test_a_compound_crs_serves_by_its_horizontal_part() -> None:
    assert map_frame(Crs(map="EPSG:6677+6695")).name == "EPSG:6677"
