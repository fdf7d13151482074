"""Points that are too far from all others to be of anything."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial import cKDTree

from furrowmap.core.surfaces.tiles import tiles

TILE_M: Final = 32.0


def radius_outliers(xyz_m: ArrayLike, radius_m: float = 0.5, fewest: int = 3) -> NDArray[np.bool_]:
    """Which points have fewer than `fewest` other points within `radius_m`.

    Args:
        xyz_m: (n, 3); points with a coordinate that is no number are outliers.
        radius_m: of the sphere round each point.
        fewest: other points in it.

    Returns:
        (n,) bool.
    """
    distance_m = _neighbour_distances(np.asarray(xyz_m, np.float64), fewest, radius_m)
    # A point with fewer neighbours in reach has none at this place of the list: infinitely far.
    out: NDArray[np.bool_] = ~(distance_m[:, -1] <= radius_m)
    return out


def statistical_outliers(
    xyz_m: ArrayLike, neighbours: int = 8, multiplier: float = 2.0, reach_m: float = 5.0
) -> NDArray[np.bool_]:
    """Which points are farther from their nearest neighbours than is usual.

    R. B. Rusu, Z. C. Marton, N. Blodow, M. Dolha, M. Beetz (2008), Towards 3D point cloud based object maps for
    household environments, Robotics and Autonomous Systems 56, 927-941: the mean distance to the nearest neighbours is
    more than its mean over all points and `multiplier` times its standard deviation.

    Args:
        xyz_m: (n, 3); points with a coordinate that is no number are outliers.
        neighbours: their number.
        multiplier: of the standard deviation.
        reach_m: points that have fewer neighbours up to here are outliers, and do not count for what is usual.

    Returns:
        (n,) bool.
    """
    mean_m: NDArray[np.float64] = _neighbour_distances(np.asarray(xyz_m, np.float64), neighbours, reach_m).mean(axis=1)
    near = np.isfinite(mean_m)
    if not near.any():
        return ~near
    limit_m = mean_m[near].mean() + multiplier * mean_m[near].std()
    out: NDArray[np.bool_] = ~(mean_m <= float(limit_m))
    return out


def _neighbour_distances(xyz_m: NDArray[np.float64], neighbours: int, reach_m: float) -> NDArray[np.float64]:
    """Distances (n, neighbours) to the nearest other points; infinite beyond the reach or without a place."""
    if neighbours < 1 or not 0.0 < reach_m <= TILE_M:
        raise ValueError(f"{neighbours} neighbours within {reach_m} m (at most {TILE_M} m)")
    known = np.flatnonzero(np.isfinite(xyz_m).all(axis=1))
    out = np.full((len(xyz_m), neighbours), np.inf)
    finite = xyz_m[known]
    for tile in tiles(finite, TILE_M, reach_m):
        part = finite[tile.members]
        own = part[: len(tile.own)]
        middle = own[0]
        tree = cKDTree(part - middle)
        ranks = np.arange(2, neighbours + 2)  # the nearest of all is the point itself
        distance, _ = tree.query(own - middle, ranks, distance_upper_bound=np.nextafter(reach_m, np.inf))
        out[known[tile.own]] = distance
    return out
