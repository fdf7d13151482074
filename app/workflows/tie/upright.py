"""What stands on a field on a date, from the cloud of a result."""

from __future__ import annotations

from itertools import islice, product
from pathlib import Path
from typing import Final

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from furrowmap.core.dates.upright import Upright, find_uprights, join_uprights
from furrowmap.core.readers.las.cloud import CloudFile, open_cloud
from furrowmap.core.values.point_classes import PointClass

TILE_M: Final = 30.0
MARGIN_M: Final = 1.0
MOST_TILES: Final = 64
SPACING_M: Final = 0.03
"""Point spacing that is sufficient."""
_NOT_STANDING: Final = (PointClass.NOISE, PointClass.VEHICLE, PointClass.IMPLEMENT)


def what_stands(cloud: Path, bounds_m: tuple[float, float, float, float]) -> Upright:
    """Walls and posts of a result, tile by tile, of some tiles where there are many; none without a cloud.

    Args:
        bounds_m: west, south, east, north of its surface.

    Raises:
        InputError: if the cloud is damaged.
    """
    if not cloud.is_file():
        return join_uprights([])
    file = open_cloud(cloud)
    west, south, east, north = bounds_m
    tiles = list(product(np.arange(west, east, TILE_M).tolist(), np.arange(south, north, TILE_M).tolist()))
    return join_uprights([_of_tile(file, *corner) for corner in islice(tiles, 0, None, -(-len(tiles) // MOST_TILES))])


def _of_tile(file: CloudFile, west: float, south: float) -> Upright:
    box = (west - MARGIN_M, south - MARGIN_M, west + TILE_M + MARGIN_M, south + TILE_M + MARGIN_M)
    xyz, ground = [np.zeros((0, 3))], [np.zeros(0, bool)]
    for batch in file.batches(box, SPACING_M):
        kept = ~np.isin(batch.classification, _NOT_STANDING) & ~batch.withheld
        xyz.append(batch.xyz_m[kept])
        ground.append(batch.classification[kept] == PointClass.GROUND)
    found = find_uprights(np.concatenate(xyz), np.concatenate(ground))
    within = (found.xy_m >= (west, south)) & (found.xy_m < (west + TILE_M, south + TILE_M))
    return found.at(np.flatnonzero(within.all(axis=1)))


def outside(touched: BaseGeometry, things: Upright) -> Upright:
    """Those that do not stand on ground that a tool touched."""
    return things.at(np.flatnonzero(~shapely.contains_xy(touched, things.xy_m[:, 0], things.xy_m[:, 1])))
