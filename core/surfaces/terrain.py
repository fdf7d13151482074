"""Terrain products: slope, hillshade, random roughness."""

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from furrowmap.core.runtime.arrays import Float32Array, FloatArray
from furrowmap.core.surfaces.grid import Grid, Surface

PLOT_M: Final = 1.0
MIN_PLOT_SHARE: Final = 0.5
"""Of cells with a height in a plot."""


def gradient(height_m: NDArray[np.floating], cell_m: float) -> tuple[FloatArray, FloatArray]:
    """Slope eastward and northward of heights (rows, columns), north up; nan at edges and next to nan.

    B. K. P. Horn (1981), Hill shading and the reflectance map, Proceedings of the IEEE 69, 14-47, as in GDAL.
    """
    east, north = np.full((2, *height_m.shape), np.nan)
    if min(height_m.shape) < 3:
        return east, north
    z = height_m.astype(np.float64)
    middle = z[1:-1, 1:-1] * 0.0  # nan where the middle is
    columns = z[:-2] + 2.0 * z[1:-1] + z[2:]
    rows = z[:, :-2] + 2.0 * z[:, 1:-1] + z[:, 2:]
    every = columns[:, 1:-1] * 0.0 + rows[:-2] * 0.0 + rows[2:] * 0.0 + middle
    east[1:-1, 1:-1] = (columns[:, 2:] - columns[:, :-2]) / (8.0 * cell_m) + every
    north[1:-1, 1:-1] = (rows[:-2] - rows[2:]) / (8.0 * cell_m) + every
    return east, north


def slope_deg(height_m: NDArray[np.floating], cell_m: float) -> Float32Array:
    """Slope in degrees (rows, columns) from :func:`gradient`."""
    return np.degrees(np.arctan(np.hypot(*gradient(height_m, cell_m)))).astype(np.float32)


def hillshade(
    height_m: NDArray[np.floating], cell_m: float, azimuth_deg: float = 315.0, altitude_deg: float = 45.0
) -> NDArray[np.uint8]:
    """Hillshade of heights (rows, columns), north up, from 1 to 255 as `gdaldem hillshade`; 0 without a slope.

    The light comes from an azimuth clockwise from grid north, at an altitude above the horizon.
    """
    east, north = gradient(height_m, cell_m)
    azimuth, altitude = math.radians(azimuth_deg), math.radians(altitude_deg)
    towards = east * math.sin(azimuth) + north * math.cos(azimuth)
    light = (math.sin(altitude) - math.cos(altitude) * towards) / np.sqrt(1.0 + east * east + north * north)
    shade = 1.0 + 254.0 * np.maximum(light, 0.0)
    return np.where(np.isnan(shade), 0.0, np.floor(shade + 0.5)).astype(np.uint8)


def random_roughness(
    surface: Surface, plot_m: float = PLOT_M, tillage_heading_deg: float | None = None
) -> tuple[Grid, Float32Array]:
    """Random roughness: standard deviation of heights in plots after removing slope and tillage marks.

    The index of Allmaras, Burwell, Larson and Holt (1966, Total porosity and random roughness of the interrow zone as
    influenced by tillage, USDA Conservation Research Report 7) in the form of Currence and Lovely (1970, The analysis
    of soil surface roughness, Transactions of the ASAE 13, 710-714): heights instead of their logarithms, none
    excluded.
    Slope is the least-squares plane; tillage marks are the mean heights of strips one cell wide along the heading.

    Args:
        surface: of cells much smaller than a plot.
        plot_m: side of the plots.
        tillage_heading_deg: clockwise from grid north; None to remove the slope only.

    Returns:
        the grid of the plots, and (rows, columns) float32 metres; nan where less than half of a plot has heights.
    """
    grid = surface.grid
    west, south, east, north = grid.bounds_m
    inner = 0.5 * grid.cell_m
    plots = Grid.of_bounds(plot_m, (west + inner, south + inner, east - inner, north - inner))
    out = np.full(plots.shape[0] * plots.shape[1], np.nan, np.float32)
    row, column = np.nonzero(surface.seen & np.isfinite(surface.height_m))
    e, n = (centres[k] for centres, k in zip(grid.centres_m(), (column, row), strict=True))
    z = surface.height_m[row, column].astype(np.float64)
    plot, _ = plots.cells_of(e, n)
    count = np.bincount(plot, minlength=len(out))
    enough = count >= max(MIN_PLOT_SHARE * (plot_m / grid.cell_m) ** 2, 6.0)
    kept = enough[plot]
    plot, e, n, z = plot[kept], e[kept], n[kept], z[kept]
    u, v = n, e
    if tillage_heading_deg is not None:  # along it, and to its right
        heading = math.radians(tillage_heading_deg)
        u = e * math.sin(heading) + n * math.cos(heading)
        v = e * math.cos(heading) - n * math.sin(heading)
    rest = _without_plane(plot, u, v, z, len(out))
    free = count - 3.0
    if tillage_heading_deg is not None:
        strip = np.floor(v / grid.cell_m)
        _, mark = np.unique(np.stack([plot, strip]), axis=1, return_inverse=True)
        mark = mark.ravel()
        rest -= (np.bincount(mark, rest) / np.bincount(mark))[mark]
        # One degree of freedom per strip, which includes those of level and cross slope.
        first = np.unique(mark, return_index=True)[1]
        free = count - 1.0 - np.bincount(plot[first], minlength=len(out))
    square = np.bincount(plot, rest * rest, minlength=len(out))
    known = enough & (free > 0)
    out[known] = np.sqrt(square[known] / free[known])
    return plots, out.reshape(plots.shape)


def _without_plane(plot: NDArray[np.intp], u: FloatArray, v: FloatArray, z: FloatArray, plots: int) -> FloatArray:
    """Residuals (n,) of heights from the least-squares plane of their plot."""
    count = np.maximum(np.bincount(plot, minlength=plots), 1)
    u, v, z = (axis - (np.bincount(plot, axis, minlength=plots) / count)[plot] for axis in (u, v, z))
    uu, uv, vv, uz, vz = (np.bincount(plot, a * b, plots) for a, b in ((u, u), (u, v), (v, v), (u, z), (v, z)))
    scale = uu * vv - uv * uv
    with np.errstate(divide="ignore", invalid="ignore"):
        rise_u = np.where(scale > 0.0, (uz * vv - vz * uv) / scale, 0.0)
        rise_v = np.where(scale > 0.0, (vz * uu - uz * uv) / scale, 0.0)
    rest: FloatArray = z - rise_u[plot] * u - rise_v[plot] * v
    return rest
