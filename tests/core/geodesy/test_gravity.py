"""Normal gravity and earth rotation, against published values."""

from __future__ import annotations

import numpy as np
import pytest
from pyproj import Geod

from furrowmap.core.geodesy.gravity import EARTH_RATE_RADPS, earth_rate_radps, normal_gravity_mps2, radius_m


@pytest.mark.parametrize(
    ("lat_deg", "height_m", "gravity_mps2"),
    [
        (0.0, 0.0, 9.7803267715),  # Moritz 2000, table of GRS80
        (90.0, 0.0, 9.8321863685),
        (45.0, 0.0, 9.806199203),
        (45.0, 1000.0, 9.803114),  # free air: 0.3086 mGal a metre
    ],
)
def test_normal_gravity__is_that_of_grs80(lat_deg: float, height_m: float, gravity_mps2: float) -> None:
    assert normal_gravity_mps2(lat_deg, height_m) == pytest.approx(gravity_mps2, abs=2e-6)


def test_earth_rate__points_to_true_north_and_up() -> None:
    rate = earth_rate_radps(30.0, 2.0)
    assert np.linalg.norm(rate) == pytest.approx(EARTH_RATE_RADPS)
    assert rate[2] == pytest.approx(EARTH_RATE_RADPS / 2.0)
    # The true heading of grid north is the convergence, so true north lies to the left of it.
    assert np.degrees(np.arctan2(rate[0], rate[1])) == pytest.approx(-2.0)


def test_radius__is_the_gaussian_mean() -> None:
    assert radius_m(0.0) == pytest.approx(6_356_752.3, abs=1.0)
    assert radius_m(90.0) == pytest.approx(6_399_593.6, abs=1.0)


@pytest.mark.parametrize("lat_deg", [0.0, 30.0, 60.0, 90.0])
def test_normal_gravity__falls_with_height_as_bruns_says(lat_deg: float) -> None:
    """Its gradient at the ellipsoid is that of any level surface; the next term is nearly that of a sphere."""
    ellipsoid, sine2 = Geod(ellps="GRS80"), np.sin(np.radians(lat_deg)) ** 2
    across_m = ellipsoid.a / np.sqrt(1.0 - ellipsoid.es * sine2)
    along_m = across_m * (1.0 - ellipsoid.es) / (1.0 - ellipsoid.es * sine2)
    below, there, above = (normal_gravity_mps2(lat_deg, height_m) for height_m in (-1000.0, 0.0, 1000.0))
    gradient = -there * (1.0 / along_m + 1.0 / across_m) - 2.0 * 7.292115e-5**2
    assert (above - below) / 2000.0 == pytest.approx(gradient, rel=5e-5)
    assert above + below - 2.0 * there == pytest.approx(6.0 * there * (1000.0 / 6_371_000.0) ** 2, rel=0.01)


def test_earth_rate__turns_once_a_sidereal_day() -> None:
    assert 2.0 * np.pi / EARTH_RATE_RADPS == pytest.approx(86_164.1, abs=0.1)
