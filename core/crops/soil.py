"""Height of the soil under a parcel, with its standard deviation: from the bare soil around it, or from a raster."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Final, Literal, Protocol

import numpy as np
import shapely
from numba import njit
from numpy.typing import NDArray
from scipy.linalg import cho_factor, cho_solve

from furrowmap.core.crops.soil_cells import SoilCells, without_crop
from furrowmap.core.values.parcel import Parcel, SoilMethod

FloatArray = NDArray[np.float64]
Trend = Literal["plane", "constant"]

NODE_M: Final = 0.5
"""Distance of the nodes of a patch."""
MOST_CELLS: Final = 240
"""Nearest cells of soil that one parcel's surface is made from."""
WORST_CONDITION: Final = 1e6
"""Condition number of the places of cells from which on they lie in a row."""
FEWEST_CELLS: Final = 6
RANGES_M: Final = (1.0, 1.7, 3.0, 5.0, 8.0, 14.0)
"""Correlation lengths of the soil's relief that are tried."""
RATIOS: Final = (0.3, 1.0, 3.0, 10.0, 30.0)
"""Standard deviations of the relief, over those of a cell, that are tried."""
TRIED: Final = 12
"""Parcels whose surroundings the relief is estimated from."""
TRIED_CELLS: Final = 100
"""Cells of each of them."""


@dataclass(frozen=True)
class SoilPatch:
    """The soil under one parcel.

    Attributes:
        west_m: easting of the first node.
        south_m: northing of the first node.
        height_m: (rows, columns) float64 heights of nodes at a distance of NODE_M, row 0 in the south.
        sigma_m: standard deviation of the mean height under the net parcel.
    """

    west_m: float
    south_m: float
    height_m: FloatArray
    sigma_m: float

    def at(self, xy_m: FloatArray) -> FloatArray:
        """Heights (n,) at positions (n, 2), bilinear."""
        out = np.empty(len(xy_m))
        x, y = (np.ascontiguousarray(xy_m[:, k], np.float64) for k in range(2))
        _bilinear(np.ascontiguousarray(self.height_m), self.west_m, self.south_m, x, y, out)
        return out


@njit(cache=True, nogil=True)
def _bilinear(height, west, south, x_m, y_m, out):  # type: ignore[no-untyped-def]
    rows, columns = height.shape
    for k in range(len(x_m)):
        x = min(max((x_m[k] - west) / NODE_M, 0.0), columns - 1.001)
        y = min(max((y_m[k] - south) / NODE_M, 0.0), rows - 1.001)
        i, j = int(y), int(x)
        v, u = y - i, x - j
        low = (1.0 - u) * height[i, j] + u * height[i, j + 1]
        high = (1.0 - u) * height[i + 1, j] + u * height[i + 1, j + 1]
        out[k] = (1.0 - v) * low + v * high


class Soil(Protocol):
    """What knows the height of the soil."""

    def under(self, parcel: Parcel) -> SoilPatch | None:
        """The soil under the net parcel; None where it is not known."""


@dataclass(frozen=True)
class Relief:
    """How the soil's height varies about a plane: covariance relief² · (1 + d / r) · exp(−d / r) at distance d.

    Attributes:
        relief_m: standard deviation.
        range_m: r.
        cell_m: standard deviation of a cell by itself: its roughness, and noise.
    """

    relief_m: float
    range_m: float
    cell_m: float

    def covariance(self, distance_m: FloatArray) -> FloatArray:
        """Covariance (n, m) of heights at these distances."""
        d = distance_m / self.range_m
        out: FloatArray = self.relief_m**2 * (1.0 + d) * np.exp(-d)
        return out

    def between(self, one_m: FloatArray, other_m: FloatArray) -> FloatArray:
        """Covariance (n, m) of heights at positions (n, 2) and (m, 2)."""
        out = np.empty((len(one_m), len(other_m)))
        if one_m is other_m:
            _covariances(np.ascontiguousarray(one_m), self.relief_m, self.range_m, out)
            return out
        _covariance(np.ascontiguousarray(one_m), np.ascontiguousarray(other_m), self.relief_m, self.range_m, out)
        return out


@njit(cache=True, nogil=True)
def _covariance(one, other, relief, reach, out):  # type: ignore[no-untyped-def]
    for i in range(len(one)):
        for j in range(len(other)):
            x, y = one[i, 0] - other[j, 0], one[i, 1] - other[j, 1]
            d = math.sqrt(x * x + y * y) / reach
            out[i, j] = relief * relief * (1.0 + d) * math.exp(-d)


@njit(cache=True, nogil=True)
def _covariances(one, relief, reach, out):  # type: ignore[no-untyped-def]
    """The same within one set."""
    for i in range(len(one)):
        out[i, i] = relief * relief
        for j in range(i):
            x, y = one[i, 0] - one[j, 0], one[i, 1] - one[j, 1]
            d = math.sqrt(x * x + y * y) / reach
            out[i, j] = out[j, i] = relief * relief * (1.0 + d) * math.exp(-d)


def relief_of(surroundings: list[SoilCells], trend: Trend = "plane") -> Relief:
    """The relief of the soil about a trend by restricted maximum likelihood, from the cells around some parcels."""
    groups = [cells for cells in surroundings if len(cells) > FEWEST_CELLS and _shows(cells, trend)]
    best, found = -math.inf, Relief(0.0, RANGES_M[0], 0.01)
    for range_m in RANGES_M:
        for ratio in RATIOS:
            likelihood, cell = _likelihood(groups, Relief(ratio, range_m, 1.0), trend)
            if likelihood > best:
                best, found = likelihood, Relief(ratio * cell, range_m, cell)
    return found


def _likelihood(groups: list[SoilCells], relief: Relief, trend: Trend) -> tuple[float, float]:
    """Restricted log-likelihood of a relief but for its scale, and the scale."""
    logs, squares, freedom = 0.0, 0.0, 0
    for cells in groups:
        design = _design(cells.xy_m, cells.xy_m.mean(axis=0), trend)
        matrix = relief.between(cells.xy_m, cells.xy_m) + np.eye(len(cells))
        factor = cho_factor(matrix, lower=True)
        weighted = cho_solve(factor, design)
        normal = design.T @ weighted
        height = cells.height_m - cells.height_m.mean()
        plane = np.linalg.solve(normal, weighted.T @ height)
        off = height - design @ plane
        squares += float(off @ cho_solve(factor, off))
        logs += 2.0 * float(np.log(np.diag(factor[0])).sum()) + float(np.linalg.slogdet(normal)[1])
        freedom += len(cells) - design.shape[1]
    if freedom <= 0 or squares <= 0.0:
        return -math.inf, 0.01
    scale = squares / freedom
    return -0.5 * (logs + freedom * math.log(scale)), math.sqrt(scale)


def _design(xy_m: FloatArray, middle_m: FloatArray, trend: Trend) -> FloatArray:
    level = np.ones((len(xy_m), 1))
    return level if trend == "constant" else np.column_stack([level, xy_m - middle_m])


def _shows(cells: SoilCells, trend: Trend) -> bool:
    """Whether cells show a trend: those in a row do not show a plane."""
    return bool(np.linalg.cond(_design(cells.xy_m, cells.xy_m.mean(axis=0), trend)) <= WORST_CONDITION)


def nodes_of(parcel: Parcel) -> tuple[float, float, FloatArray, tuple[int, int]]:
    """West and south of the nodes of a parcel's patch, the nodes (rows * columns, 2), rows and columns."""
    west, south, east, north = (float(v) for v in parcel.net.bounds)
    columns = max(2, math.ceil((east - west) / NODE_M) + 1)
    rows = max(2, math.ceil((north - south) / NODE_M) + 1)
    x, y = np.meshgrid(west + NODE_M * np.arange(columns), south + NODE_M * np.arange(rows))
    return west, south, np.column_stack([x.ravel(), y.ravel()]), (rows, columns)


def interpolated(parcel: Parcel, cells: SoilCells, relief: Relief, trend: Trend = "plane") -> SoilPatch | None:
    """The soil under a parcel by universal kriging of the cells around it.

    See N. Cressie (1993), Statistics for Spatial Data, section 3.4; the standard deviation is that of the mean over the
    net parcel (block kriging).

    Args:
        cells: around it, without crop.
        relief: of the soil; one of 0 m makes the trend by least squares.
        trend: that the relief departs from.
    """
    if len(cells) < FEWEST_CELLS or not _shows(cells, trend):
        return None
    west, south, nodes, shape = nodes_of(parcel)
    middle = cells.xy_m.mean(axis=0)
    inside = shapely.contains_xy(parcel.net.buffer(0.5 * NODE_M), nodes[:, 0], nodes[:, 1])
    design, at_nodes = _design(cells.xy_m, middle, trend), _design(nodes, middle, trend)
    base = float(cells.height_m.mean())
    height = cells.height_m - base
    factor = covariance_factor(cells, relief)
    near, under = relief.between(nodes, cells.xy_m), nodes[inside]
    mean_near, mean_design = near[inside].mean(axis=0), at_nodes[inside].mean(axis=0)
    # one solution for all: of the design, of the heights, of the covariance with the mean below the parcel
    solved = cho_solve(factor, np.column_stack([design, height, mean_near]), overwrite_b=True, check_finite=False)
    weighted, seen = solved[:, :-2], solved[:, -1]
    covariance = np.linalg.inv(design.T @ weighted)
    plane = covariance @ (weighted.T @ height)
    heights = base + at_nodes @ plane + near @ (solved[:, -2] - weighted @ plane)
    lacking = mean_design - design.T @ seen
    variance = float(relief.between(under, under).mean() - mean_near @ seen + lacking @ covariance @ lacking)
    return SoilPatch(west, south, heights.reshape(shape), math.sqrt(max(variance, 0.0)))


def least_squares(
    cells: SoilCells, relief: Relief, design: FloatArray
) -> tuple[FloatArray, FloatArray, tuple[FloatArray, bool]]:
    """Parameters of a trend through cells by generalised least squares.

    Args:
        cells: n cells.
        relief: of what departs from the trend.
        design: (n, k) of the trend.

    Returns:
        (k,) parameters, (k, k) their covariance, and the Cholesky factor of the covariance of the cells' heights.
    """
    factor = covariance_factor(cells, relief)
    covariance: FloatArray = np.linalg.inv(design.T @ cho_solve(factor, design)).astype(np.float64)
    return covariance @ (design.T @ cho_solve(factor, cells.height_m)), covariance, factor


def covariance_factor(cells: SoilCells, relief: Relief) -> tuple[FloatArray, bool]:
    """The Cholesky factor of the covariance of the heights of cells, as SciPy's `cho_solve` takes it."""
    matrix = relief.between(cells.xy_m, cells.xy_m)
    matrix[np.diag_indices(len(cells))] += relief.cell_m**2 + cells.sigma_m**2
    # a symmetric matrix is its own transpose: LAPACK factors it in place, without a copy in its order
    factor, lower = cho_factor(matrix.T, lower=True, overwrite_a=True, check_finite=False)
    return factor, bool(lower)


@dataclass(frozen=True)
class SoilAround:
    """Soil from the bare cells around each parcel.

    Attributes:
        near: cells around each parcel by its id, with crop that stands on them.
        relief: of the site.
        method: "surface" interpolates with the relief; "plane" fits a plane by least squares.
        trend: that the relief departs from.
    """

    near: Mapping[str, SoilCells]
    relief: Relief
    method: SoilMethod
    trend: Trend = "plane"

    def under(self, parcel: Parcel) -> SoilPatch | None:
        """See :class:`Soil`."""
        if parcel.id not in self.near:
            return None
        cells = nearest(without_crop(self.near[parcel.id]), parcel)
        patch = interpolated(parcel, cells, self.relief, self.trend)
        if patch is None or self.method == "surface":
            return patch
        flat = Relief(0.0, self.relief.range_m, math.hypot(self.relief.cell_m, self.relief.relief_m))
        plane = interpolated(parcel, cells, flat)
        # a plane does not know how far the soil departs from it: that is what the relief says
        return (
            None
            if plane is None
            else SoilPatch(plane.west_m, plane.south_m, plane.height_m, math.hypot(plane.sigma_m, patch.sigma_m))
        )


def soil_around(near: Mapping[str, SoilCells], method: SoilMethod = "surface", trend: Trend = "plane") -> SoilAround:
    """The soil from the cells around each parcel, whose relief departs from a trend."""
    around = SoilAround(near, Relief(0.0, RANGES_M[0], 0.01), method, trend)
    return replace(around, relief=relief_of([fewer(cells, TRIED_CELLS) for cells in _some_of(near)], trend))


def _some_of(near: Mapping[str, SoilCells]) -> list[SoilCells]:
    """The cells, without crop, around some of the parcels, spread over the site."""
    names = list(near)
    found = [without_crop(near[name]) for name in names[:: max(1, len(names) // (2 * TRIED))]]
    full = [cells for cells in found if len(cells) > FEWEST_CELLS]
    return full[:: max(1, len(full) // TRIED)][:TRIED]


def nearest(cells: SoilCells, parcel: Parcel) -> SoilCells:
    """The cells nearest to a net parcel, at most `MOST_CELLS`."""
    if len(cells) <= MOST_CELLS:
        return cells
    away = np.asarray(shapely.distance(parcel.net, shapely.points(cells.xy_m)))
    return cells.at(np.sort(np.argpartition(away, MOST_CELLS)[:MOST_CELLS]))


def fewer(cells: SoilCells, most: int) -> SoilCells:
    """At most so many of the cells, evenly chosen."""
    if len(cells) <= most:
        return cells
    chosen = np.zeros(len(cells), np.bool_)
    chosen[np.linspace(0, len(cells) - 1, most).round().astype(np.intp)] = True
    return cells.at(chosen)
