"""Longitudes across the antimeridian, against the same places elsewhere on the parallel."""

import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st
from pyproj import Geod

from furrowmap.core.geodesy.crs_choice import choose_crs
from furrowmap.core.geodesy.longitudes import (
    cut_at_antimeridian,
    middle_deg,
    principal_deg,
    signed_deg,
    unwrapped_deg,
    west_east_deg,
)

WGS84 = Geod(ellps="WGS84")
NEAR = st.lists(st.floats(-0.4, 0.4), min_size=1, max_size=30)


def turned(lon_deg: np.ndarray) -> np.ndarray:
    """Longitudes as receivers write them, from -180 to below 180."""
    return np.array([principal_deg(float(lon)) for lon in lon_deg])


@given(NEAR, st.floats(-180.0, 180.0))
def test_statistics__are_those_of_the_same_places_elsewhere(offsets: list[float], middle: float) -> None:
    near = np.array(offsets)
    lon = turned(middle + near)
    there, _ = middle_deg(lon, lon)
    assert abs(principal_deg(there - middle - float(np.median(near)))) < 1e-9
    west, east = west_east_deg(lon)
    assert -180.0 <= west <= 180.0
    assert -180.0 <= east <= 180.0
    assert abs(principal_deg(west - middle - near.min())) < 1e-9
    assert abs(principal_deg(east - middle - near.max())) < 1e-9
    assert np.ptp(unwrapped_deg(lon)) == pytest.approx(np.ptp(near), abs=1e-9)


def test_places_within_180_degrees_are_unchanged_to_the_last_bit() -> None:
    lon = np.random.default_rng(1).uniform(100.0, 179.9, 1000)
    assert (unwrapped_deg(lon) == lon).all()
    assert middle_deg(lon, lon) == (float(np.median(lon)), float(np.median(lon)))
    assert west_east_deg(lon) == (lon.min(), lon.max())


def test_middle__of_a_log_that_begins_at_zero() -> None:
    lon = np.array([0.0, 179.9, -179.9, -179.8, 179.8, np.nan])
    middle, _ = middle_deg(lon, np.zeros(6))
    assert abs(middle) == pytest.approx(179.9, abs=0.11)


def test_crs__of_a_place_has_one_answer_on_either_name_of_its_longitude() -> None:
    for lat in (-16.8, 51.9, 66.0):
        assert choose_crs(180.0005, lat) == choose_crs(-179.9995, lat)
        assert choose_crs(-180.0005, lat) == choose_crs(179.9995, lat)


@pytest.mark.parametrize("beyond", [True, False])
def test_cut__shapes_of_rfc_7946_with_the_same_area(beyond: bool) -> None:
    ring = np.array([(179.9995, -16.8), (180.0005, -16.8), (180.0005, -16.7995), (179.9995, -16.7995)])
    whole = abs(WGS84.geometry_area_perimeter(shapely.Polygon(ring))[0])
    given_ring = ring if beyond else np.column_stack([turned(ring[:, 0]), ring[:, 1]])
    line = shapely.LineString([*map(tuple, given_ring[:2])])
    elsewhere = shapely.box(12.0, 48.0, 12.1, 48.1)
    shapes = np.array([shapely.Polygon(given_ring), line, None, elsewhere, shapely.Point(180.25, 1.0, 7.0)], object)
    field, way, nothing, same, point = cut_at_antimeridian(shapes)
    assert field.geom_type == "MultiPolygon"
    assert {part.bounds[0::2] for part in field.geoms} == {(179.9995, 180.0), (-180.0, -179.9995)}
    area = sum(abs(WGS84.geometry_area_perimeter(part)[0]) for part in field.geoms)
    assert area == pytest.approx(whole, rel=1e-6)
    assert way.geom_type == "MultiLineString"
    assert (nothing, same) == (None, elsewhere)
    assert (point.x, point.z) == (-179.75, 7.0)


@given(st.floats(-180.0, 180.0), st.sampled_from([-360.0, 0.0, 360.0]))
def test_signed_deg__is_the_same_place(lon_deg: float, turn_deg: float) -> None:
    there = lon_deg + turn_deg
    found = float(signed_deg(np.array([there]))[0])
    if abs(there) > 360.0:
        assert found == there
    else:
        assert abs(found) <= 180.0
        assert abs(np.remainder(found - lon_deg + 180.0, 360.0) - 180.0) < 1e-9
    assert np.isnan(signed_deg(np.array([np.nan]))).all()
