"""`crop_height.tif`: height of the crop above the soil in the pixels of all parcels."""

from pathlib import Path
from typing import Final, Self

import numpy as np
from pyproj import CRS

from furrowmap.core.crops.canopy_height import CROP_PIXEL_M, Canopy
from furrowmap.core.runtime.record_spool import RecordSpool, square_keys, square_of
from furrowmap.core.surfaces.grid import Grid
from furrowmap.exporters.files.provenance import Origin
from furrowmap.exporters.rasters.cog import Band, cog_output

CROP_BANDS: Final = (Band("crop height"),)
_SIDE: Final = 1024
"""Pixels along a tile."""
_PIXEL: Final = np.dtype([("place", "<u4"), ("height_m", "<f4")])


class CropHeights:
    """Collects the pixels of parcels in a temporary file and writes the raster: a context manager."""

    def __init__(self, folder: Path) -> None:
        self._spool = RecordSpool(_PIXEL, folder)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._spool.close()

    def add(self, canopy: Canopy) -> None:
        """Add the pixels of a parcel."""
        row, column = np.nonzero(canopy.net & np.isfinite(canopy.top_m))
        if not len(row):
            return
        east = canopy.grid.west + column
        south = row - canopy.grid.north
        pixels = np.empty(len(row), _PIXEL)
        pixels["place"] = (south % _SIDE) * _SIDE + east % _SIDE
        pixels["height_m"] = canopy.top_m[row, column]
        self._spool.add(pixels, square_keys(east // _SIDE, south // _SIDE))

    def write(self, path: Path, crs: CRS, origin: Origin) -> bool:
        """Write the raster; False, and no file, without a pixel."""
        tiles = [(key, *square_of(key)) for key in self._spool.counts]
        if not tiles:
            return False
        west = min(t[1] for t in tiles)
        north = min(t[2] for t in tiles)
        columns = max(t[1] for t in tiles) + 1 - west
        rows = max(t[2] for t in tiles) + 1 - north
        whole = Grid(CROP_PIXEL_M, west * _SIDE, -north * _SIDE, (rows * _SIDE, columns * _SIDE))
        with cog_output(path, whole, crs, CROP_BANDS, origin) as put:
            for key, column, row in tiles:
                heights = np.full(_SIDE * _SIDE, np.nan, np.float32)
                pixels = self._spool.read([key])
                heights[pixels["place"]] = pixels["height_m"]
                tile = Grid(CROP_PIXEL_M, column * _SIDE, -row * _SIDE, (_SIDE, _SIDE))
                put(tile, (heights.reshape(_SIDE, _SIDE),))
        return True
