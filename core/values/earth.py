"""Geodetic and Cartesian coordinates on the WGS 84 ellipsoid, and local directions."""

from typing import Final

import numpy as np
from numpy.typing import ArrayLike

from furrowmap.core.runtime.arrays import FloatArray

SEMI_MAJOR_M: Final = 6_378_137.0
FLATTENING: Final = 1.0 / 298.257223563
_E2: Final = FLATTENING * (2.0 - FLATTENING)


def earth_centred_m(lon_deg: ArrayLike, lat_deg: ArrayLike, height_m: ArrayLike) -> FloatArray:
    """Earth-centred, earth-fixed coordinates (n, 3) of geodetic ones (n,), the height above the ellipsoid."""
    lon = np.radians(lon_deg)
    lat = np.radians(lat_deg)
    height = np.asarray(height_m, np.float64)
    normal = SEMI_MAJOR_M / np.sqrt(1.0 - _E2 * np.sin(lat) ** 2)
    return np.column_stack(
        [
            (normal + height) * np.cos(lat) * np.cos(lon),
            (normal + height) * np.cos(lat) * np.sin(lon),
            (normal * (1.0 - _E2) + height) * np.sin(lat),
        ]
    )


def east_north_up(lon_deg: ArrayLike, lat_deg: ArrayLike) -> FloatArray:
    """Matrices (n, 3, 3) that rotate earth-centred vectors to east, north and up (along the ellipsoid's normal)."""
    lon = np.atleast_1d(np.radians(lon_deg))
    lat = np.atleast_1d(np.radians(lat_deg))
    zero = np.zeros_like(lon)
    east = np.column_stack([-np.sin(lon), np.cos(lon), zero])
    north = np.column_stack([-np.sin(lat) * np.cos(lon), -np.sin(lat) * np.sin(lon), np.cos(lat)])
    up = np.column_stack([np.cos(lat) * np.cos(lon), np.cos(lat) * np.sin(lon), np.sin(lat)])
    return np.stack([east, north, up], axis=1)


def variances_enu(covariance_xyz: FloatArray, lon_deg: ArrayLike, lat_deg: ArrayLike) -> FloatArray:
    """Variances (n, 3) east, north and up from earth-centred covariances (n, 3, 3), in the same unit."""
    turn = east_north_up(lon_deg, lat_deg)
    variances: FloatArray = np.einsum("nij,njk,nik->ni", turn, covariance_xyz, turn)
    return variances


def geodetic(xyz_m: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Longitude, latitude (degrees), ellipsoidal height (n,) of earth-centred coordinates (n, 3); nan far away."""
    from pyproj import Transformer

    near = np.all(np.abs(xyz_m) < 1e8, axis=1)
    x, y, z = np.where(np.expand_dims(near, 1), xyz_m, np.nan).T
    found = Transformer.from_crs("EPSG:4978", "EPSG:4979", always_xy=True).transform(x, y, z)
    known = np.isfinite(found).all(axis=0)
    lon, lat, height = (np.where(known, values, np.nan) for values in found)
    return lon, lat, height
