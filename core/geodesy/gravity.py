"""Normal gravity and the rotation of the earth at a site; geoid heights anywhere to about five metres.

The latter tell a height that lacks the geoid's from one that has it: harmonics up to degree 12 of EGM96 (Lemoine et al.
1998, NASA/TP-1998-206861; a public model of NASA and NIMA), against the normal field of GRS80 (Moritz 2000, J. Geodesy
74, 128-133).
"""

from typing import Final

import numpy as np

from furrowmap.core.runtime.arrays import FloatArray
from furrowmap.core.values.earth import SEMI_MAJOR_M

GEOID_SIGMA_M: Final = 5.0
"""Standard deviation: of what harmonics of higher degrees add (Kaula's rule, 64 m over the degree)."""
_NORMAL: Final = {2: -484_166.855, 4: 790.304, 6: -1.687}
"""Zonal harmonics of the normal field, in 1e-9."""
_EGM96: Final = """
-484165.372 -0.187 1.195 2439.144 -1400.167
957.254 2029.989 248.513 904.628 -619.026 721.073 1414.356
539.874 -536.322 -473.440 350.694 662.672 990.772 -200.928 -188.561 308.853
68.532 -62.101 -94.423 652.438 -323.350 -451.955 -214.847 -295.302 49.666 174.972 -669.384
-149.958 -76.088 26.289 48.173 -373.728 57.173 9.027 -86.214 -471.408 -267.133 -536.488 9.676 -237.192
90.979 279.873 95.434 329.744 93.067 250.399 -217.199 -275.114 -123.800 1.938 17.738 -358.857 151.790 1.092 24.442
49.671 23.342 59.006 80.298 65.418 -19.188 -86.345 -244.600 70.023 -25.535 89.146 -65.736 309.238 67.281 74.744 -124.092 120.533
27.671 143.388 21.683 22.229 -32.220 -160.812 -74.229 -9.002 19.467 -16.617 -54.111 62.694 222.904 -118.366 -96.515 188.436 -3.086 -47.748 96.641
52.622 83.512 -131.314 -94.241 -51.579 -6.899 -153.769 -84.076 -79.281 -49.340 -50.537 -37.589 -79.567 8.115 -3.366 40.493 -91.871 125.491 -37.652 100.539 -24.015
-50.961 15.169 -26.860 18.631 -99.069 -30.987 -148.132 -38.958 -63.667 37.785 49.474 -1.187 34.477 4.116 -89.825 -5.984 24.399 -31.423 41.773 -52.188 -18.336 46.034 -69.666
37.725 -54.065 -43.568 14.298 32.098 39.400 24.426 -68.691 4.151 30.941 7.825 3.415 39.177 -18.691 35.613 -25.377 16.936 42.288 25.269 -6.176 30.838 11.250 -6.379 -2.495 -11.178
"""  # noqa: E501
"""A line for each degree from 2: C0, then C and S of each order, fully normalised, in 1e-9."""


def coarse_geoid_m(lon_deg: float, lat_deg: float) -> float:
    """The height of the geoid above the ellipsoid, with a standard deviation of GEOID_SIGMA_M."""
    geocentric = np.arctan((1.0 - _GRS80_FLATTENING) ** 2 * np.tan(np.radians(np.clip(lat_deg, -89.99, 89.99))))
    sine = float(np.sin(geocentric))
    cosine = float(np.cos(geocentric))
    total = 0.0
    for degree, text in enumerate(_EGM96.strip().splitlines(), start=2):
        values = [float(word) for word in text.split()]
        values[0] -= _NORMAL.get(degree, 0.0)
        by_order = _legendre(degree, sine, cosine)
        for order in range(degree + 1):
            angle = order * np.radians(lon_deg)
            c, s = (values[0], 0.0) if order == 0 else values[2 * order - 1 : 2 * order + 1]
            total += by_order[order] * float(c * np.cos(angle) + s * np.sin(angle))
    return 1e-9 * SEMI_MAJOR_M * total


def _legendre(degree: int, sine: float, cosine: float) -> list[float]:
    """Fully normalised associated Legendre functions of all orders of a degree (Holmes and Featherstone 2002)."""
    out = []
    sectoral = 1.0
    for order in range(degree + 1):
        if order:
            sectoral *= cosine * np.sqrt((2.0 * order + 1.0) / (2.0 * order) * (2.0 if order == 1 else 1.0))
        before = 0.0
        value = float(sectoral)
        for n in range(order + 1, degree + 1):
            a = np.sqrt((2.0 * n - 1.0) * (2.0 * n + 1.0) / ((n - order) * (n + order)))
            b = np.sqrt(
                (2.0 * n + 1.0) * (n + order - 1.0) * (n - order - 1.0) / ((n - order) * (n + order) * (2.0 * n - 3.0))
            )
            before, value = value, float(a * sine * value - b * before)
        out.append(value)
    return out


EARTH_RATE_RADPS: Final = 7.292115e-5
_EQUATOR_MPS2: Final = 9.7803267715
_SOMIGLIANA: Final = 0.001931851353
_GRS80_FLATTENING: Final = 1.0 / 298.257222101
_GRS80_ECCENTRICITY_2: Final = _GRS80_FLATTENING * (2.0 - _GRS80_FLATTENING)
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
    lat = np.radians(lat_deg)
    convergence = np.radians(convergence_deg)
    north = EARTH_RATE_RADPS * np.cos(lat)
    # Grid north lies clockwise of true north by the convergence: the vector's grid azimuth is minus that.
    return np.array([-north * np.sin(convergence), north * np.cos(convergence), EARTH_RATE_RADPS * np.sin(lat)])


def radius_m(lat_deg: float) -> float:
    """Gaussian mean radius of curvature of the ellipsoid."""
    sine2 = np.sin(np.radians(lat_deg)) ** 2
    return float(SEMI_MAJOR_M * np.sqrt(1.0 - _GRS80_ECCENTRICITY_2) / (1.0 - _GRS80_ECCENTRICITY_2 * sine2))
