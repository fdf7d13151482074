"""The coarse geoid against published heights of EGM96 and GSIGEO2011."""

from __future__ import annotations

import pytest

from furrowmap.core.geodesy.gravity import GEOID_SIGMA_M, coarse_geoid_m


@pytest.mark.parametrize(
    ("lon_deg", "lat_deg", "geoid_m"),
    [
        (0.0, 0.0, 17.2),  # EGM96
        (78.8, 4.7, -106.5),  # its lowest, south of Sri Lanka
        (-0.1, 51.5, 45.8),
        (116.4, 39.9, -9.5),
        (139.75, 35.68, 36.7),
        (-105.0, 40.0, -17.0),
        (151.2, -33.9, 22.5),
    ],
)
def test_geoid__is_within_three_sigmas(lon_deg: float, lat_deg: float, geoid_m: float) -> None:
    assert abs(coarse_geoid_m(lon_deg, lat_deg) - geoid_m) < 3.0 * GEOID_SIGMA_M
