"""Terrain products: slope, hillshade, random roughness, and the depressions in which water stands."""

from __future__ import annotations

import heapq
import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np
from numpy.typing import NDArray

from furrowmap.core.runtime.arrays import Float32Array, FloatArray
from furrowmap.core.runtime.kernels import kernel
from furrowmap.core.surfaces.grid import Grid, Surface

if TYPE_CHECKING:
    from shapely.geometry import MultiPolygon, Polygon

MIN_WATER_DEPTH_M: Final = 0.02
MIN_WATER_AREA_M2: Final = 0.1


@dataclass(frozen=True)
class Depressions:
    """The n depressions of a surface, filled to their spill level.

    Attributes:
        depth_m: (rows, columns) float32 water depth; 0 where dry, nan without a height.
        label: (rows, columns) int32 number of the depression from 1, 0 outside.
        level_m: (n,) spill level; below, greatest depth, water surface and volume of each.
        deepest_m: (n, 2) easting and northing of the deepest cell.
    """

    grid: Grid
    depth_m: NDArray[np.float32]
    label: NDArray[np.int32]
    level_m: NDArray[np.float64]
    greatest_depth_m: NDArray[np.float64]
    area_m2: NDArray[np.float64]
    volume_m3: NDArray[np.float64]
    deepest_m: NDArray[np.float64]

    def __len__(self) -> int:
        return len(self.level_m)

    def polygons(self) -> list[Polygon | MultiPolygon]:
        """Outline of each along cell edges; several polygons where cells touch only at corners."""
        import shapely
        from rasterio.features import shapes
        from rasterio.transform import Affine

        parts: list[list[Polygon]] = [[] for _ in range(len(self))]
        for shape, number in shapes(self.label, self.label > 0, transform=Affine(*self.grid.transform)):
            parts[int(number) - 1].append(shapely.Polygon(shape["coordinates"][0], shape["coordinates"][1:]))
        return [part[0] if len(part) == 1 else shapely.MultiPolygon(part) for part in parts]


def find_depressions(
    height_m: NDArray[np.floating],
    grid: Grid,
    least_depth_m: float = MIN_WATER_DEPTH_M,
    least_area_m2: float = MIN_WATER_AREA_M2,
) -> Depressions:
    """The depressions of a surface (nan in gaps); water leaves it at its edges and next to cells without a height."""
    height = np.ascontiguousarray(height_m, np.float64)
    known = np.isfinite(height)
    level = flooded(height)
    depth = np.where(known, level - height, np.nan)
    label, count = _labels(level, depth > 0.0)
    flat = label.ravel()
    water = np.where(depth > 0.0, depth, 0.0).ravel()
    area = np.bincount(flat, np.ones(flat.size), count + 1) * grid.cell_area_m2
    deepest = np.zeros(count + 1)
    np.maximum.at(deepest, flat, water)
    kept = (deepest >= least_depth_m) & (area >= least_area_m2)
    kept[0] = False
    label = np.where(kept, np.cumsum(kept), 0).astype(np.int32)[label]
    flat = label.ravel()
    found = int(np.count_nonzero(kept))
    water = np.where(flat > 0, water, 0.0)
    order = np.lexsort((-water, flat))
    first = order[np.searchsorted(flat[order], np.arange(1, found + 1))]
    easting, northing = grid.centres_m()
    row, column = np.divmod(first, grid.columns)
    volume = np.bincount(flat, water, found + 1)[1:] * grid.cell_area_m2
    return Depressions(
        grid,
        np.where(known, water.reshape(height.shape), np.nan).astype(np.float32),
        label,
        level.ravel()[first],
        deepest[kept],
        area[kept].astype(np.float64),
        volume.astype(np.float64),
        np.column_stack([easting[column], northing[row]]),
    )


def flooded(height_m: NDArray[np.float64]) -> NDArray[np.float64]:
    """Heights (rows, columns) with every depression filled to its spill level; water drains at edges and next to nan.

    Algorithm 2 of R. Barnes, C. Lehman and D. Mulla (2014), Priority-flood: an optimal depression-filling and
    watershed-labeling algorithm for digital elevation models, Computers and Geosciences 62, 117-127, with eight
    neighbours.
    """
    out = np.array(height_m, np.float64)
    _flood(out)
    return out


@kernel()
def _flood(height):  # type: ignore[no-untyped-def]
    """Kernel of :func:`flooded`, in place."""
    rows, columns = height.shape
    done = np.isnan(height)
    # Numba takes the types of the queues from their first entries.
    open_ = [(np.inf, np.int64(0))]
    open_.pop()
    pit = np.empty(rows * columns, np.int64)
    for i in range(rows):
        for j in range(columns):
            if np.isnan(height[i, j]):
                continue
            edge = i == 0 or j == 0 or i == rows - 1 or j == columns - 1
            for a in range(max(i - 1, 0), min(i + 2, rows)):
                for b in range(max(j - 1, 0), min(j + 2, columns)):
                    edge |= np.isnan(height[a, b])
            if edge:
                done[i, j] = True
                open_.append((height[i, j], np.int64(i * columns + j)))
    heapq.heapify(open_)
    while len(open_) > 0:
        level, start = heapq.heappop(open_)
        pit[0] = start
        waiting = 1
        while waiting > 0:
            waiting -= 1
            i = pit[waiting] // columns
            j = pit[waiting] % columns
            for a in range(max(i - 1, 0), min(i + 2, rows)):
                for b in range(max(j - 1, 0), min(j + 2, columns)):
                    if done[a, b]:
                        continue
                    done[a, b] = True
                    if height[a, b] <= level:
                        height[a, b] = level
                        pit[waiting] = a * columns + b
                        waiting += 1
                    else:
                        heapq.heappush(open_, (height[a, b], np.int64(a * columns + b)))


@kernel()
def _labels(level, wet):  # type: ignore[no-untyped-def]
    """Labels of connected water of one level, 0 where dry; and their number."""
    rows, columns = level.shape
    label = np.zeros((rows, columns), np.int32)
    stack = np.empty(rows * columns, np.int64)
    count = 0
    for start in range(rows * columns):
        i = start // columns
        j = start % columns
        if not wet[i, j] or label[i, j] != 0:
            continue
        count += 1
        label[i, j] = count
        stack[0] = start
        waiting = 1
        while waiting > 0:
            waiting -= 1
            i = stack[waiting] // columns
            j = stack[waiting] % columns
            for a in range(max(i - 1, 0), min(i + 2, rows)):
                for b in range(max(j - 1, 0), min(j + 2, columns)):
                    if wet[a, b] and label[a, b] == 0 and level[a, b] == level[i, j]:
                        label[a, b] = count
                        stack[waiting] = a * columns + b
                        waiting += 1
    return label, count


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
    azimuth = math.radians(azimuth_deg)
    altitude = math.radians(altitude_deg)
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
    plot = plot[kept]
    e = e[kept]
    n = n[kept]
    z = z[kept]
    u = n
    v = e
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
