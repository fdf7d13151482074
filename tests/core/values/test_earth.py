"""Earth-centred coordinates and directions against PROJ's."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pyproj import Transformer

from furrowmap.core.values.earth import earth_centred_m, east_north_up, geodetic

TO_CARTESIAN = Transformer.from_crs("EPSG:4979", "EPSG:4978", always_xy=True)
places = st.tuples(st.floats(-180, 180), st.floats(-90, 90), st.floats(-500, 20_000))


@given(place=places)
def test_earth_centred__is_projs_and_comes_back(place: tuple[float, float, float]) -> None:
    found = earth_centred_m(*place)
    np.testing.assert_allclose(found[0], TO_CARTESIAN.transform(*place), atol=1e-6)
    lon, lat, height = geodetic(found)
    assert lat[0] == pytest.approx(place[1], abs=1e-10)
    assert height[0] == pytest.approx(place[2], abs=1e-5)
    if abs(place[1]) < 89.999:
        assert (lon[0] - place[0] + 180.0) % 360.0 - 180.0 == pytest.approx(0.0, abs=1e-9)


@given(place=places)
def test_east_north_up__is_a_rotation_towards_growing_longitude_latitude_and_height(
    place: tuple[float, float, float],
) -> None:
    lon, lat, height = place
    turn = east_north_up(lon, lat)[0]
    np.testing.assert_allclose(turn @ turn.T, np.eye(3), atol=1e-12)
    assert np.linalg.det(turn) == pytest.approx(1.0)
    up = turn @ (earth_centred_m(lon, lat, height + 1.0) - earth_centred_m(lon, lat, height))[0]
    np.testing.assert_allclose(up, [0.0, 0.0, 1.0], atol=1e-8)
    if abs(lat) < 89.0:
        south = turn @ (earth_centred_m(lon, lat + 1e-6, height) - earth_centred_m(lon, lat, height))[0]
        assert south[1] > 0.09
        assert abs(south[0]) < 1e-8


def test_geodetic__of_places_that_are_none_is_nan() -> None:
    lon, lat, height = geodetic(np.array([[np.nan, 0.0, 0.0], [1e30, 1e30, 1e30], [6378137.0, 0.0, 0.0]]))
    assert np.isnan(lon[:2]).all()
    assert np.isnan(height[:2]).all()
    assert (lon[2], lat[2], height[2]) == pytest.approx((0.0, 0.0, 0.0), abs=1e-6)
