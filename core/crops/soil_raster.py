"""Heights of the soil from a raster: the surface or terrain model of another survey."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray
from pyproj import CRS
from scipy.ndimage import map_coordinates, uniform_filter

from furrowmap.core.geodesy.crs_change import CrsChange, crs_change
from furrowmap.core.readers.geotiff import expect_heights, open_geotiff
from furrowmap.core.runtime.errors import InputError

FloatArray = NDArray[np.float64]

_KNOWN_SHARE: Final = 0.25
"""Share of the cells in a square that have heights, from which on their mean is that of the square."""


@dataclass(frozen=True)
class SoilRaster:
    """An open raster of heights.

    Attributes:
        dataset: of rasterio; its first band is heights.
        change: from the map to the CRS of the raster; None where they agree.
        unit_m: unit of the heights.
    """

    path: Path
    dataset: Any
    change: CrsChange | None
    unit_m: float

    def heights_m(self, xy_m: FloatArray, side_m: float) -> FloatArray:
        """Mean heights (n,) of the squares of a side around positions (n, 2) on the map; nan where it has none."""
        if not len(xy_m):
            return np.zeros(0)
        x, y = xy_m.T if self.change is None else self.change.points(xy_m).T
        a, b, c, d, e, f = (~self.dataset.transform)[:6]
        column, row = a * x + b * y + c - 0.5, d * x + e * y + f - 0.5
        size = max(1, 2 * int(0.5 * side_m / float(np.mean(self.dataset.res))) + 1)
        left, top = int(np.floor(column.min())) - size, int(np.floor(row.min())) - size
        right, bottom = int(np.ceil(column.max())) + size + 1, int(np.ceil(row.max())) + size + 1
        window = ((max(top, 0), min(bottom, self.dataset.height)), (max(left, 0), min(right, self.dataset.width)))
        if window[0][0] >= window[0][1] or window[1][0] >= window[1][1]:
            return np.full(len(x), np.nan)
        cells = np.ma.filled(self.dataset.read(1, window=window, masked=True).astype(np.float64), np.nan)
        known = np.isfinite(cells)
        if not known.any():
            return np.full(len(x), np.nan)
        base = float(np.median(cells[known]))
        at = np.array([row - window[0][0], column - window[1][0]])
        share, total = (
            map_coordinates(uniform_filter(values, size, mode="constant"), at, order=1, mode="constant")
            for values in (known.astype(np.float64), np.where(known, cells - base, 0.0))
        )
        enough = share >= _KNOWN_SHARE
        out = np.full(len(x), np.nan)
        out[enough] = (base + total[enough] / share[enough]) * self.unit_m
        return out


@contextmanager
def open_soil_raster(path: Path, target: CRS, box_m: tuple[float, float, float, float]) -> Iterator[SoilRaster]:
    """The heights of a GeoTIFF for positions on a map.

    Args:
        path: GeoTIFF whose first band is heights.
        target: projected CRS of the map.
        box_m: west, south, east, north of the site on the map.

    Raises:
        InputError: if it is no such raster.
        RefusedError: if PROJ has no exact transformation to its CRS.
    """
    with open_geotiff(path, _no_soil) as raster:
        expect_heights(raster, path, _no_soil)
        whole = CRS.from_wkt(raster.crs.to_wkt())
        flat, height = whole.sub_crs_list[:2] if whole.is_compound else (whole, None)
        own = target.sub_crs_list[0].to_2d() if target.is_compound else target.to_2d()
        change = None if own.equals(flat.to_2d(), ignore_axis_order=True) else crs_change(own, flat, box_m)
        unit_m = float(height.axis_info[0].unit_conversion_factor) if height is not None else 1.0
        yield SoilRaster(path, raster, change, unit_m)


def _no_soil(path: Path, why: str) -> InputError:
    return InputError("soil-unusable", path=path, why=why)
