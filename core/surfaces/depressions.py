"""Depressions of a surface: extent, depth and volume of standing water."""

from __future__ import annotations

import heapq
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np
from numpy.typing import NDArray

from furrowmap.core.runtime.kernels import kernel
from furrowmap.core.surfaces.grid import Grid

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
    """The depressions of a surface; water leaves it at its edges and next to cells without a height.

    Args:
        height_m: (rows, columns), north up; nan where there is none.
    """
    height = np.ascontiguousarray(height_m, np.float64)
    known = np.isfinite(height)
    level = flooded(height)
    depth = np.where(known, level - height, np.nan)
    label, count = _labels(level, depth > 0.0)
    flat, water = label.ravel(), np.where(depth > 0.0, depth, 0.0).ravel()
    area = np.bincount(flat, np.ones(flat.size), count + 1) * grid.cell_area_m2
    deepest = np.zeros(count + 1)
    np.maximum.at(deepest, flat, water)
    kept = (deepest >= least_depth_m) & (area >= least_area_m2)
    kept[0] = False
    label = np.where(kept, np.cumsum(kept), 0).astype(np.int32)[label]
    flat, found = label.ravel(), int(np.count_nonzero(kept))
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
            i, j = pit[waiting] // columns, pit[waiting] % columns
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
        i, j = start // columns, start % columns
        if not wet[i, j] or label[i, j] != 0:
            continue
        count += 1
        label[i, j] = count
        stack[0] = start
        waiting = 1
        while waiting > 0:
            waiting -= 1
            i, j = stack[waiting] // columns, stack[waiting] % columns
            for a in range(max(i - 1, 0), min(i + 2, rows)):
                for b in range(max(j - 1, 0), min(j + 2, columns)):
                    if wet[a, b] and label[a, b] == 0 and level[a, b] == level[i, j]:
                        label[a, b] = count
                        stack[waiting] = a * columns + b
                        waiting += 1
    return label, count
