"""Normal gravity and earth rotation, against published values."""

from __future__ import annotations

import numpy as np
import pytest

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
