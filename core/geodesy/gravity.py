"""Normal gravity and the rotation of the earth at a site."""

from __future__ import annotations

from typing import Final

import numpy as np

from furrowmap.core.runtime.arrays import FloatArray
from furrowmap.core.values.earth import SEMI_MAJOR_M

EARTH_RATE_RADPS: Final = 7.292115e-5
_GRS80_ECCENTRICITY_2: Final = 0.00669438002290
_EQUATOR_MPS2: Final = 9.7803267715
_SOMIGLIANA: Final = 0.001931851353
_GRS80_FLATTENING: Final = 1.0 / 298.257222101
_GRS80_M: Final = 0.00344978600308
"""Constants of GRS80 (Moritz 2000, Journal of Geodesy 74, 128-133)."""


def normal_gravity_mps2(lat_deg: float, height_m: float) -> float:
    """Normal gravity of GRS80 at an ellipsoidal height, to second order (Heiskanen and Moritz 1967, eq. 2-123)."""
    sine2 = np.sin(np.radians(lat_deg)) ** 2
    surface = _EQUATOR_MPS2 * (1.0 + _SOMIGLIANA * sine2) / np.sqrt(1.0 - _GRS80_ECCENTRICITY_2 * sine2)
    share = height_m / SEMI_MAJOR_M
    factor = 1.0 + _GRS80_FLATTENING + _GRS80_M - 2.0 * _GRS80_FLATTENING * sine2
    return float(surface * (1.0 - 2.0 * factor * share + 3.0 * share**2))


def earth_rate_radps(lat_deg: float, convergence_deg: float) -> FloatArray:
    """(3,) rotation of the earth in axes easting, northing, up of a map."""
    lat, convergence = np.radians(lat_deg), np.radians(convergence_deg)
    north = EARTH_RATE_RADPS * np.cos(lat)
    # Grid north lies clockwise of true north by the convergence: the vector's grid azimuth is minus that.
    return np.array([-north * np.sin(convergence), north * np.cos(convergence), EARTH_RATE_RADPS * np.sin(lat)])


def radius_m(lat_deg: float) -> float:
    """Gaussian mean radius of curvature of the ellipsoid."""
    sine2 = np.sin(np.radians(lat_deg)) ** 2
    return float(SEMI_MAJOR_M * np.sqrt(1.0 - _GRS80_ECCENTRICITY_2) / (1.0 - _GRS80_ECCENTRICITY_2 * sine2))
