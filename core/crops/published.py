"""Crop height and volume of a parcel as published: Christiansen et al. (2017), each step a function.

M. P. Christiansen, M. S. Laursen, R. N. Jørgensen, S. Skovsen, R. Gislum (2017), Designing and testing a UAV mapping
system for agricultural field surveying, Sensors 17, 2703, sections 3.4 and 3.5. Defaults are the paper's parameters.
The paper does not state the neighbours and the multiple of its outlier removal, which was that of the Point Cloud
Library: defaults are those of the library's tutorial.
"""

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
import shapely
from numpy.typing import NDArray
from scipy.spatial import cKDTree
from shapely.geometry.base import BaseGeometry

from furrowmap.core.runtime.arrays import BoolArray, FloatArray
from furrowmap.core.runtime.kernels import kernel
from furrowmap.core.surfaces.grid import Grid

PCL_NEIGHBOURS: Final = 50
PCL_SIGMAS: Final = 1.0
PAPER_VOXEL_M: Final = (0.04, 0.04, 0.001)
MIN_NEIGHBOURS: Final = 6
"""Of the eight around a pixel, for it to be filled."""
GRADIENT_M: Final = 0.1
"""Between a pixel and the mean of the region that it joins."""


@dataclass(frozen=True)
class PublishedCrop:
    """Crop of a parcel as published.

    Attributes:
        heights_m: (rows, columns) crop height above the soil plane; nan where there is none.
        region: (rows, columns) pixels of the region grown, within the net parcel.
        plane: height of the soil at easting 0 and northing 0 of the grid's south-west corner, and slopes to the east
            and to the north.
        mean_height_m: mean over the region; nan if it is empty.
        volume_m3: sum over the region times the area of a pixel.
    """

    grid: Grid
    heights_m: FloatArray
    region: BoolArray
    plane: tuple[float, float, float]
    mean_height_m: float
    volume_m3: float


def christiansen2017(xyz_m: FloatArray, net: BaseGeometry, crop: BaseGeometry, around: BaseGeometry) -> PublishedCrop:
    """Crop height and volume of one parcel from points (n, 3) by the published steps with their defaults.

    The crop stands within `crop`; the other points in `around` are soil.
    """
    inside = points_in_polygon(xyz_m, around)
    kept = inside[~statistical_outliers(inside)]
    grid = Grid.of_bounds(PAPER_VOXEL_M[0], shapely.bounds(around).tolist())
    seen = highest_voxels(voxels(kept), grid)
    easting, northing = np.meshgrid(*grid.centres_m())
    sown = shapely.contains_xy(crop.buffer(math.sqrt(0.5) * grid.cell_m), easting, northing)  # also in part
    soil = np.asarray(shapely.contains_xy(around, easting, northing) & ~sown)
    plane = soil_plane(seen, grid, soil)  # "using measurements": pixels that were filled are none
    heights = fill_pixels(seen) - plane_heights(plane, grid)
    region = grown_region(np.where(shapely.contains_xy(net, easting, northing), heights, np.nan))
    of_region = heights[region]
    return PublishedCrop(
        grid,
        heights,
        region,
        plane,
        float(of_region.mean()) if len(of_region) else math.nan,
        float(of_region.sum()) * grid.cell_area_m2,
    )


def points_in_polygon(xyz_m: FloatArray, polygon: BaseGeometry) -> FloatArray:
    """The points (m, 3) of (n, 3) whose easting and northing lie in a polygon; none on its outline (section 3.4.1)."""
    west, south, east, north = shapely.bounds(polygon)
    x = xyz_m[:, 0]
    y = xyz_m[:, 1]
    near = np.flatnonzero((x >= west) & (x <= east) & (y >= south) & (y <= north))
    shapely.prepare(polygon)
    out: FloatArray = xyz_m[near[shapely.contains_xy(polygon, x[near], y[near])]]
    return out


def statistical_outliers(xyz_m: FloatArray, neighbours: int = PCL_NEIGHBOURS, sigmas: float = PCL_SIGMAS) -> BoolArray:
    """Which of points (n, 3) are statistical outliers (section 3.4.2).

    A point is one if the mean distance to its nearest `neighbours` other points exceeds the mean of these means by more
    than `sigmas` of their standard deviations. Open3D's `remove_statistical_outlier` counts the point itself, so that
    its `nb_neighbors` is one more. With no more than `neighbours` points there are none.
    """
    if len(xyz_m) <= neighbours:
        return np.zeros(len(xyz_m), np.bool_)
    tree = cKDTree(xyz_m - xyz_m[0])
    distance: FloatArray = np.asarray(tree.query(tree.data, neighbours + 1, workers=-1)[0])
    mean = distance[:, 1:].mean(axis=1)
    out: BoolArray = mean > mean.mean() + sigmas * mean.std(ddof=1)
    return out


def voxels(xyz_m: FloatArray, size_m: tuple[float, float, float] = PAPER_VOXEL_M) -> NDArray[np.int64]:
    """The voxels (m, 3) that hold points (n, 3), each once (section 3.4.3).

    Voxels are counted from the origin of the coordinates; a point on a face belongs to the voxel east, north, above.
    """
    index = np.floor(xyz_m / np.asarray(size_m)).astype(np.int64)
    out: NDArray[np.int64] = np.unique(index, axis=0)
    return out


def highest_voxels(occupied: NDArray[np.int64], grid: Grid, height_m: float = PAPER_VOXEL_M[2]) -> FloatArray:
    """Height of the middle of the highest of voxels (m, 3) in each pixel as wide; nan without one (section 3.5.1)."""
    pixels = np.full(grid.shape, -np.inf)
    column = occupied[:, 0] - grid.west
    row = grid.north - 1 - occupied[:, 1]
    inside = (column >= 0) & (column < grid.columns) & (row >= 0) & (row < grid.rows)
    np.maximum.at(pixels, (row[inside], column[inside]), (occupied[inside, 2] + 0.5) * height_m)
    return np.where(np.isinf(pixels), np.nan, pixels)


def fill_pixels(pixels: FloatArray) -> FloatArray:
    """Pixels (rows, columns) with the missing ones (nan) filled from their neighbours (section 3.5.2).

    A missing pixel becomes the mean of those of its eight neighbours that have a value, if `MIN_NEIGHBOURS` have one.
    All pixels of a pass are filled from the values before it; passes end when nothing changes.
    """
    out = np.array(pixels, np.float64)
    _fill(out, MIN_NEIGHBOURS)
    return out


@kernel()
def _fill(pixels, fewest):  # type: ignore[no-untyped-def]
    """Fill pixels in passes; a pass has those of whose neighbours enough became known in the one before."""
    rows, columns = pixels.shape
    side = columns + 2
    around = np.array([-side - 1, -side, -side + 1, -1, 1, side - 1, side, side + 1])
    # a margin of one pixel, missing and never filled, spares the look at the edges
    value = np.full((rows + 2) * side, np.nan)
    known = np.full((rows + 2) * side, -9, np.int32)
    for row in range(rows):
        value[(row + 1) * side + 1 : (row + 2) * side - 1] = pixels[row]
    ready = np.empty(rows * columns, np.int64)
    after = np.empty(rows * columns, np.int64)
    means = np.empty(rows * columns)
    count = 0
    for row in range(rows):
        for column in range(columns):
            k = (row + 1) * side + column + 1
            if np.isnan(value[k]):
                known[k] = 0
                for step in around:
                    known[k] += not np.isnan(value[k + step])
                if known[k] >= fewest:
                    ready[count] = k
                    count += 1
    while count:
        for n in range(count):
            total = 0.0
            for step in around:
                if not np.isnan(value[ready[n] + step]):
                    total += value[ready[n] + step]
            means[n] = total / known[ready[n]]
        for n in range(count):
            value[ready[n]] = means[n]
            pixels[ready[n] // side - 1, ready[n] % side - 1] = means[n]
        more = 0
        for n in range(count):
            for step in around:
                k = ready[n] + step
                if known[k] < 0 or not np.isnan(value[k]):  # in the margin, or known from the start or by now
                    continue
                known[k] += 1
                if known[k] == fewest:
                    after[more] = k
                    more += 1
        ready, after, count = after, ready, more


def soil_plane(pixels: FloatArray, grid: Grid, soil: BoolArray) -> tuple[float, float, float]:
    """The plane by least squares through pixels (rows, columns) of soil (section 3.5.3, equation 2).

    Returns the height at the grid's south-west corner and the slopes to the east and to the north; nan with fewer than
    three pixels or pixels on one line.
    """
    known = soil & np.isfinite(pixels)
    row, column = np.nonzero(known)
    design = np.column_stack([np.ones(len(row)), (column + 0.5) * grid.cell_m, (grid.rows - row - 0.5) * grid.cell_m])
    if len(row) < 3 or np.linalg.matrix_rank(design) < design.shape[1]:
        return math.nan, math.nan, math.nan
    constant, east, north = np.linalg.lstsq(design, pixels[known])[0].tolist()
    return constant, east, north


def plane_heights(plane: tuple[float, float, float], grid: Grid) -> FloatArray:
    """Heights (rows, columns) of a plane of :func:`soil_plane` in the middle of the pixels."""
    x = (np.arange(grid.columns) + 0.5) * grid.cell_m
    y = (grid.rows - np.arange(grid.rows) - 0.5) * grid.cell_m
    out: FloatArray = plane[0] + plane[1] * x[None, :] + plane[2] * y[:, None]
    return out


def grown_region(heights_m: FloatArray) -> BoolArray:
    """The pixels (rows, columns) of the crop, grown from the highest one (section 3.5.4).

    A neighbour (of eight) joins if it differs from the mean of the region as it is then by at most `GRADIENT_M`.
    Pixels are taken in the order in which they were reached; those that did not join are tried again, as the mean
    moves, until none joins. Heights are nan where there are none.
    """
    region = np.zeros(heights_m.shape, np.bool_)
    if np.isfinite(heights_m).any():
        _grow(np.ascontiguousarray(heights_m, np.float64), GRADIENT_M, int(np.nanargmax(heights_m)), region)
    return region


@kernel()
def _grow(heights, gradient, seed, region):  # type: ignore[no-untyped-def]
    rows, columns = heights.shape
    queue = np.empty(rows * columns, np.int64)
    region[seed // columns, seed % columns] = True
    queue[0] = seed
    total = heights[seed // columns, seed % columns]
    count = 1
    joined = True
    while joined:
        joined = False
        done = 0
        while done < count:
            row = queue[done] // columns
            column = queue[done] % columns
            done += 1
            for i in range(max(row - 1, 0), min(row + 2, rows)):
                for j in range(max(column - 1, 0), min(column + 2, columns)):
                    height = heights[i, j]
                    if not region[i, j] and not np.isnan(height) and abs(height - total / count) <= gradient:
                        region[i, j] = True
                        queue[count] = i * columns + j
                        count += 1
                        total += height
                        joined = True
