"""Bare soil around parcels as cells of median heights, and the soil under a parcel by kriging of these cells."""

import math
from dataclasses import dataclass
from typing import Final, Literal

import numpy as np
import shapely
from numpy.typing import NDArray
from scipy.linalg import cho_factor, cho_solve

from furrowmap.core.crops.pixels import pixel_returns
from furrowmap.core.runtime.arrays import FloatArray
from furrowmap.core.runtime.kernels import kernel
from furrowmap.core.surfaces.grid import Grid
from furrowmap.core.surfaces.statistic import sort_in_place
from furrowmap.core.values.parcel import Parcel

Trend = Literal["plane", "constant"]

SOIL_CELL_M: Final = 0.25
MIN_CELL_POINTS: Final = 3
MAX_SPREAD_M: Final = 0.06
"""Between the quartiles of a cell of bare soil: crop at its edge, or a mound, spreads more."""
OUTLIER_SIGMAS: Final = 3.0
"""Robust standard deviations from the others beyond which a value is an outlier."""
MIN_OUTLIER_M: Final = 0.03
"""Heights no farther than this from the plane of the soil are never outliers."""
SOIL_SHARE: Final = 0.4
"""Share of the cells near a parcel that are soil at least."""
MEDIAN_LOSS: Final = 1.2533
"""Standard deviation of a median over that of a mean, of normal values."""
NODE_M: Final = 0.5
"""Distance of the nodes of a patch."""
MAX_SOIL_CELLS: Final = 240
"""Nearest cells from which the soil under a parcel is interpolated."""
MAX_CONDITION: Final = 1e6
"""Condition number of the design matrix above which cells lie in a row."""
MIN_SOIL_CELLS: Final = 6
RANGES_M: Final = (1.0, 1.7, 3.0, 5.0, 8.0, 14.0)
"""Correlation lengths that are tried."""
RATIOS: Final = (0.3, 1.0, 3.0, 10.0, 30.0)
"""Standard deviations of the relief, over those of a cell, that are tried."""


@dataclass(frozen=True)
class SoilCells:
    """Cells of bare soil: mean places (n, 2), median heights (n,) and their standard deviations by the scatter."""

    xy_m: FloatArray
    height_m: FloatArray
    sigma_m: FloatArray

    def __len__(self) -> int:
        return len(self.height_m)

    def at(self, kept: NDArray[np.bool_] | NDArray[np.intp]) -> "SoilCells":
        """Some of the cells, by a mask (n,) or by their numbers."""
        return SoilCells(self.xy_m[kept], self.height_m[kept], self.sigma_m[kept])

    def thinned(self, most: int) -> "SoilCells":
        """At most so many of the cells, evenly chosen."""
        return self if len(self) <= most else self.at(np.linspace(0, len(self) - 1, most).round().astype(np.intp))

    def nearest(self, parcel: Parcel) -> "SoilCells":
        """The cells nearest to a net parcel, at most `MAX_SOIL_CELLS`."""
        if len(self) <= MAX_SOIL_CELLS:
            return self
        away = np.asarray(shapely.distance(parcel.net, shapely.points(self.xy_m)))
        return self.at(np.sort(np.argpartition(away, MAX_SOIL_CELLS)[:MAX_SOIL_CELLS]))


@dataclass(frozen=True)
class SoilPatch:
    """The soil under one parcel.

    Attributes:
        west_m, south_m: the first node.
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


@dataclass(frozen=True)
class PatchNodes:
    """The nodes of the patch of soil under a parcel: the first corner, places (n, 2), and which lie in its net part.

    Those within half their distance of the net parcel count as in it.
    """

    corner_m: tuple[float, float]
    shape: tuple[int, int]
    xy_m: FloatArray
    inside: NDArray[np.bool_]

    def patch(self, height_m: FloatArray, sigma_m: float) -> SoilPatch:
        """The soil with these heights (rows * columns,)."""
        return SoilPatch(*self.corner_m, height_m.reshape(self.shape), sigma_m)


@dataclass(frozen=True)
class HeightCovariance:
    """How heights vary about a trend: covariance relief² · (1 + d / r) · exp(−d / r) at distance d.

    Attributes:
        range_m: r.
        cell_m: standard deviation of a cell by itself: its roughness, and noise.
    """

    relief_m: float
    range_m: float
    cell_m: float

    def between(self, one_m: FloatArray, other_m: FloatArray) -> FloatArray:
        """Covariance (n, m) of heights at positions (n, 2) and (m, 2)."""
        out = np.empty((len(one_m), len(other_m)))
        one = np.ascontiguousarray(one_m)
        other = np.ascontiguousarray(other_m)
        _covariance(one, other, one_m is other_m, self.relief_m, self.range_m, out)
        return out

    def factor(self, cells: SoilCells) -> tuple[FloatArray, bool]:
        """The Cholesky factor of the covariance of the heights of cells, as SciPy's `cho_solve` takes it."""
        matrix = self.between(cells.xy_m, cells.xy_m)
        matrix[np.diag_indices(len(cells))] += self.cell_m**2 + cells.sigma_m**2
        # a symmetric matrix is its own transpose: LAPACK factors it in place, without a copy in its order
        factor, lower = cho_factor(matrix.T, lower=True, overwrite_a=True, check_finite=False)
        return factor, bool(lower)


def soil_cells(xyz_m: FloatArray) -> SoilCells:
    """The cells of points (n, 3) of bare soil that hold enough of them and are even."""
    if not len(xyz_m):
        return SoilCells(np.zeros((0, 2)), np.zeros(0), np.zeros(0))
    west, south = xyz_m[:, :2].min(axis=0).tolist()
    east, north = xyz_m[:, :2].max(axis=0).tolist()
    grid = Grid.of_bounds(SOIL_CELL_M, (west, south, east, north))
    out = np.empty((min(grid.rows * grid.columns, len(xyz_m)), 4))
    cell = np.floor(xyz_m[:, :2] / SOIL_CELL_M).astype(np.int64) - (grid.west, grid.north - grid.rows)
    count = _cells(np.ascontiguousarray(xyz_m), cell[:, 1] * grid.columns + cell[:, 0], grid.rows * grid.columns, out)
    return SoilCells(out[:count, :2].copy(), out[:count, 2].copy(), out[:count, 3].copy())


def without_crop(cells: SoilCells) -> SoilCells:
    """Cells near one parcel without those that lie above or below the others.

    A plane is fitted by least squares to the lower part of the cells, over which crop of parcels that the user does not
    name stands; then cells farther from it than three standard deviations (from the median of the distances) are left
    out, and the plane fitted to the others, until nothing changes.
    """
    if not len(cells):
        return cells
    kept = np.ones(len(cells), np.bool_)
    design = plane_design(cells.xy_m, cells.xy_m.mean(axis=0))
    for number in range(14):
        if kept.sum() <= design.shape[1]:
            break
        some = design[kept]
        # of cells in a row the plane of least slope
        plane = np.linalg.lstsq(some.T @ some, some.T @ cells.height_m[kept])[0]
        off = cells.height_m - design @ plane
        if number < 4:
            lowest = round(SOIL_SHARE * (len(off) - 1))
            now = off <= np.partition(off, lowest)[lowest]
        else:
            off = off - np.median(off[kept])
            limit = max(OUTLIER_SIGMAS * 1.4826 * float(np.median(np.abs(off[kept]))), MIN_OUTLIER_M)
            now = np.abs(off) <= limit
            if (now == kept).all():
                break
        kept = now
    return cells.at(kept)


def noise_in_pixels(xyz_m: FloatArray, pixel_m: float) -> FloatArray:
    """Standard deviations (k,) of the heights in each pixel of points (n, 3) of soil that holds three or more.

    They are from half the mean distance of two heights (the second L-moment), which for normal noise is the standard
    deviation over √π, without bias for any number of points.
    """
    if not len(xyz_m):
        return np.zeros(0)
    west, south = xyz_m[:, :2].min(axis=0).tolist()
    east, north = xyz_m[:, :2].max(axis=0).tolist()
    grid = Grid.of_bounds(pixel_m, (west, south, east, north))
    column = xyz_m[:, 0] / pixel_m - grid.west
    row = grid.north - xyz_m[:, 1] / pixel_m
    means = pixel_returns(column, row, xyz_m[:, 2], grid).means_m(np.ones(grid.shape, np.bool_))
    out: FloatArray = np.sqrt(np.pi) * (means[:, 1] - means[:, 0])
    return out


def plane_design(xy_m: FloatArray, middle_m: FloatArray) -> FloatArray:
    """Design matrix (n, 3) of a plane at positions (n, 2): its height in the middle, and its slopes east and north."""
    return np.column_stack([np.ones(len(xy_m)), xy_m - middle_m])


def patch_nodes(parcel: Parcel) -> PatchNodes:
    """The nodes of a parcel's patch."""
    west, south, east, north = (float(v) for v in parcel.net.bounds)
    columns = max(2, math.ceil((east - west) / NODE_M) + 1)
    rows = max(2, math.ceil((north - south) / NODE_M) + 1)
    x, y = (axis.ravel() for axis in np.meshgrid(west + NODE_M * np.arange(columns), south + NODE_M * np.arange(rows)))
    inside = shapely.contains_xy(parcel.net.buffer(0.5 * NODE_M), x, y)
    return PatchNodes((west, south), (rows, columns), np.column_stack([x, y]), inside)


def estimate_covariance(surroundings: list[SoilCells], trend: Trend = "plane") -> HeightCovariance:
    """How the soil departs from a trend by restricted maximum likelihood, from the cells around some parcels."""
    return likely_covariances(surroundings, trend)[0][1]


def likely_covariances(surroundings: list[SoilCells], trend: Trend = "plane") -> list[tuple[float, HeightCovariance]]:
    """Probabilities of covariances by their restricted likelihood, all alike before, the likeliest first.

    One place hardly tells a long bend from a tilt: covariances that are nearly as likely may differ in the error of a
    trend by a factor of five.
    """
    groups = [cells for cells in surroundings if len(cells) > MIN_SOIL_CELLS and _determines(cells, trend)]
    found = []
    for range_m in RANGES_M:
        for ratio in RATIOS:
            likelihood, cell = _likelihood(groups, HeightCovariance(ratio, range_m, 1.0), trend)
            if math.isfinite(likelihood):
                found.append((likelihood, HeightCovariance(ratio * cell, range_m, cell)))
    if not found:
        return [(1.0, HeightCovariance(0.0, RANGES_M[0], 0.01))]
    found.sort(key=lambda one: -one[0])
    share = [math.exp(likelihood - found[0][0]) for likelihood, _ in found]
    return [(one / sum(share), covariance) for one, (_, covariance) in zip(share, found, strict=True)]


def _likelihood(groups: list[SoilCells], covariance: HeightCovariance, trend: Trend) -> tuple[float, float]:
    """Restricted log-likelihood of a covariance but for its scale, and the scale."""
    logs = 0.0
    squares = 0.0
    freedom = 0
    for cells in groups:
        design = _design(cells.xy_m, cells.xy_m.mean(axis=0), trend)
        factor = cho_factor(covariance.between(cells.xy_m, cells.xy_m) + np.eye(len(cells)), lower=True)
        weighted = cho_solve(factor, design)
        normal = design.T @ weighted
        height = cells.height_m - cells.height_m.mean()
        off = height - design @ np.linalg.solve(normal, weighted.T @ height)
        squares += float(off @ cho_solve(factor, off))
        logs += 2.0 * float(np.log(np.diag(factor[0])).sum()) + float(np.linalg.slogdet(normal)[1])
        freedom += len(cells) - design.shape[1]
    if freedom <= 0 or squares <= 0.0:
        return -math.inf, 0.01
    scale = squares / freedom
    return -0.5 * (logs + freedom * math.log(scale)), math.sqrt(scale)


def _design(xy_m: FloatArray, middle_m: FloatArray, trend: Trend) -> FloatArray:
    return np.ones((len(xy_m), 1)) if trend == "constant" else plane_design(xy_m, middle_m)


def _determines(cells: SoilCells, trend: Trend) -> bool:
    """Whether cells determine a trend: those in a row determine no plane."""
    return bool(np.linalg.cond(_design(cells.xy_m, cells.xy_m.mean(axis=0), trend)) <= MAX_CONDITION)


def interpolate_soil(
    parcel: Parcel, cells: SoilCells, covariance: HeightCovariance, trend: Trend = "plane"
) -> SoilPatch | None:
    """The soil under a parcel by universal kriging of the cells around it; None where they determine no trend.

    See N. Cressie (1993), Statistics for Spatial Data, section 3.4; the standard deviation is that of the mean over the
    net parcel (block kriging). With a relief of 0 m the trend is by least squares.
    """
    if len(cells) < MIN_SOIL_CELLS or not _determines(cells, trend):
        return None
    nodes = patch_nodes(parcel)
    middle = cells.xy_m.mean(axis=0)
    design = _design(cells.xy_m, middle, trend)
    at_nodes = _design(nodes.xy_m, middle, trend)
    base = float(cells.height_m.mean())
    height = cells.height_m - base
    near = covariance.between(nodes.xy_m, cells.xy_m)
    under = nodes.xy_m[nodes.inside]
    mean_near = near[nodes.inside].mean(axis=0)
    mean_design = at_nodes[nodes.inside].mean(axis=0)
    # one solution for all: of the design, of the heights, of the covariance with the mean below the parcel
    columns = np.column_stack([design, height, mean_near])
    solved = cho_solve(covariance.factor(cells), columns, overwrite_b=True, check_finite=False)
    weighted = solved[:, :-2]
    seen = solved[:, -1]
    of_trend = np.linalg.inv(design.T @ weighted)
    plane = of_trend @ (weighted.T @ height)
    heights = base + at_nodes @ plane + near @ (solved[:, -2] - weighted @ plane)
    lacking = mean_design - design.T @ seen
    variance = float(covariance.between(under, under).mean() - mean_near @ seen + lacking @ of_trend @ lacking)
    return nodes.patch(heights, math.sqrt(max(variance, 0.0)))


def least_squares(
    cells: SoilCells, covariance: HeightCovariance, design: FloatArray
) -> tuple[FloatArray, FloatArray, tuple[FloatArray, bool]]:
    """Trend (n, k) through n cells by generalised least squares: parameters (k,), covariance, Cholesky factor.

    The covariance is (k, k), the factor that of the covariance of the cells' heights.
    """
    factor = covariance.factor(cells)
    of_trend: FloatArray = np.linalg.inv(design.T @ cho_solve(factor, design)).astype(np.float64)
    return of_trend @ (design.T @ cho_solve(factor, cells.height_m)), of_trend, factor


@kernel()
def _cells(points, cell, cells, out):  # type: ignore[no-untyped-def]
    """Mean place, median height and its standard deviation of the even cells that hold enough points; their number."""
    starts = np.zeros(cells + 1, np.int64)
    for k in range(len(cell)):
        starts[cell[k] + 1] += 1
    for c in range(cells):
        starts[c + 1] += starts[c]
    place = starts[:-1].copy()
    order = np.empty(len(cell), np.int64)
    for k in range(len(cell)):
        order[place[cell[k]]] = k
        place[cell[k]] += 1
    found = 0
    for c in range(cells):
        first = starts[c]
        n = starts[c + 1] - starts[c]
        if n < MIN_CELL_POINTS:
            continue
        heights = np.empty(n)
        x = 0.0
        y = 0.0
        base = points[order[first]]
        for k in range(n):
            point = points[order[first + k]]
            heights[k] = point[2]
            x += point[0] - base[0]
            y += point[1] - base[1]
        sort_in_place(heights)
        quartiles = np.empty(3)
        for q in range(3):
            at = 0.25 * (q + 1) * (n - 1)
            low = int(at)
            quartiles[q] = heights[low] + (at - low) * (heights[min(low + 1, n - 1)] - heights[low])
        spread = quartiles[2] - quartiles[0]
        if spread <= MAX_SPREAD_M:
            out[found, 0] = base[0] + x / n
            out[found, 1] = base[1] + y / n
            out[found, 2] = quartiles[1]
            out[found, 3] = MEDIAN_LOSS * max(spread / 1.349, 1e-3) / np.sqrt(n)
            found += 1
    return found


@kernel()
def _bilinear(height, west, south, x_m, y_m, out):  # type: ignore[no-untyped-def]
    rows, columns = height.shape
    for k in range(len(x_m)):
        x = min(max((x_m[k] - west) / NODE_M, 0.0), columns - 1.001)
        y = min(max((y_m[k] - south) / NODE_M, 0.0), rows - 1.001)
        i = int(y)
        j = int(x)
        v = y - i
        u = x - j
        low = (1.0 - u) * height[i, j] + u * height[i, j + 1]
        high = (1.0 - u) * height[i + 1, j] + u * height[i + 1, j + 1]
        out[k] = (1.0 - v) * low + v * high


@kernel()
def _covariance(one, other, is_same, relief, reach, out):  # type: ignore[no-untyped-def]
    """Covariances of heights at two sets of positions, or within one."""
    for i in range(len(one)):
        for j in range(i + 1 if is_same else len(other)):
            x = one[i, 0] - other[j, 0]
            y = one[i, 1] - other[j, 1]
            d = math.sqrt(x * x + y * y) / reach
            out[i, j] = relief * relief * (1.0 + d) * math.exp(-d)
            if is_same:
                out[j, i] = out[i, j]
