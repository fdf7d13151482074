"""Ground of a run, sampled while points are placed and applied when they are written.

Points pass once. Every cell of half a metre keeps a uniform random sample of its heights (Vitter 1985, Random sampling
with a reservoir, ACM Transactions on Mathematical Software 11, 37-57, algorithm R). A low quantile of it is the ground
of the cell unless the morphological filter rejects it; points are then classified by their height above that ground.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from furrowmap.core.runtime.arrays import FloatArray
from furrowmap.core.runtime.kernels import count_until, kernel
from furrowmap.core.surfaces.gaps import filled
from furrowmap.core.surfaces.ground_filter import Smrf, ground_cells
from furrowmap.core.surfaces.statistic import sort_in_place
from furrowmap.core.values.scan import PointClass

_GROUND_CLASS: Final = np.uint8(PointClass.GROUND)
_NOISE_CLASS: Final = np.uint8(PointClass.NOISE)
_VEHICLE_CLASS: Final = np.uint8(PointClass.VEHICLE)
_IMPLEMENT_CLASS: Final = np.uint8(PointClass.IMPLEMENT)
GROUND_CELL_M: Final = 0.5
TILE_CELLS: Final = 64
GROUND_TILE_M: Final = TILE_CELLS * GROUND_CELL_M
CELL_SAMPLES: Final = 16
_SAMPLE_STEP_M: Final = 0.002
_RELIEF_STEPS: Final = 32_000
"""Samples are steps of 2 mm from the median height of the first scan of the tile: a range of ±64 m."""
MIN_GROUND_RETURNS: Final = 3
"""A cell with fewer returns has no ground."""
GROUND_QUANTILE: Final = 0.2
"""Quantile of the samples of a cell that is its ground, before the filter."""
GROUND_SPREAD_M: Final = 0.10
"""The ground of a cell is the mean of its samples within this distance of the quantile."""
NEAR_GROUND_M: Final = 0.15
"""Points within this distance of the ground are ground, such as clods, ridges and short stubble."""
SLOPE_SHARE: Final = 0.35
"""Added to that, times the slope, as the ground of a cell is a mean."""
BELOW_M: Final = 0.25
"""Points farther below, with the same allowance for slope, are noise; between are furrows that cells do not resolve."""
_FAR_TILES: Final = 5
"""Points are sampled up to this many tiles from the middle of a scan."""
_BEYOND_CELLS: Final = 4.0
"""Cells without ground are filled from ground up to this distance."""
_BLOCK_TILES: Final = 8
"""Tiles a side that are filtered together, with a margin of one."""
_KEY: Final = 1 << 30


class GroundSampler:
    """Samples heights from the points of scans.

    Memory grows with the area and not with time: 150 bytes per square metre of tiles with points.
    """

    def __init__(self) -> None:
        self._slots: dict[tuple[int, int], int] = {}
        self._samples = np.zeros((16, TILE_CELLS, TILE_CELLS, CELL_SAMPLES), np.int16)
        self._counts = np.zeros((16, TILE_CELLS, TILE_CELLS), np.int32)
        self._base_m = np.zeros(16)

    def add(self, xyz_m: FloatArray, kept: NDArray[np.bool_]) -> None:
        """Add the points (n, 3) of a scan of which `kept` (n,) may be ground: finite, and neither machine nor noise."""
        xyz_m = np.ascontiguousarray(xyz_m)
        middle_m = _middle(xyz_m, kept)
        if np.isnan(middle_m[0]):
            return
        corner = np.floor(middle_m[:2] / GROUND_TILE_M).astype(np.int64) - _FAR_TILES
        window = np.full((2 * _FAR_TILES + 1,) * 2, -1, np.int64)
        _mark(xyz_m, kept, corner, window)
        for column, row in np.argwhere(window == 0).tolist():
            window[column, row] = self._slot((int(corner[0]) + column, int(corner[1]) + row), float(middle_m[2]))
        _draw(xyz_m, kept, corner, window, self._base_m, self._samples, self._counts)

    def ground(self) -> "LocalGround":
        """The ground from all points so far."""
        blocks: dict[tuple[int, int], list[tuple[int, int]]] = {}
        for key in self._slots:
            blocks.setdefault((key[0] // _BLOCK_TILES, key[1] // _BLOCK_TILES), []).append(key)
        found = {key: height for keys in blocks.values() for key, height in self._block(keys)}
        keys = sorted(found)
        heights = np.stack([found[key] for key in keys]) if keys else np.zeros((0, TILE_CELLS + 2, TILE_CELLS + 2))
        numbers = [(column + _KEY << 32) + row + _KEY for column, row in keys]  # as in the kernel below
        return LocalGround(np.array(numbers, np.int64), heights.astype(np.float32))

    def _slot(self, key: tuple[int, int], height_m: float) -> int:
        """Index of the samples of a tile, created for heights around `height_m`."""
        if key in self._slots:
            return self._slots[key]
        slot = self._slots[key] = len(self._slots)
        if slot == len(self._base_m):
            self._samples, self._counts, self._base_m = (
                np.concatenate([held, np.zeros_like(held)]) for held in (self._samples, self._counts, self._base_m)
            )
        self._base_m[slot] = height_m
        return slot

    def _block(self, keys: Sequence[tuple[int, int]]) -> Iterator[tuple[tuple[int, int], FloatArray]]:
        """The ground of neighbouring tiles, each with a margin of one cell."""
        low = np.min(keys, axis=0) - 1
        high = np.max(keys, axis=0) + 2
        lowest, mean = (np.full((high - low) * TILE_CELLS, np.nan) for _ in range(2))
        for key, slot in self._slots.items():
            if np.all(low <= key) and np.all(key < high):
                at = tuple(slice(n, n + TILE_CELLS) for n in ((np.array(key) - low) * TILE_CELLS).tolist())
                lowest[at], mean[at] = _low_heights(self._samples[slot], self._counts[slot])
                lowest[at] += self._base_m[slot]
                mean[at] += self._base_m[slot]
        ground = ground_cells(lowest, Smrf(cell_m=GROUND_CELL_M))
        height = filled(np.where(ground, mean, np.nan), _BEYOND_CELLS)
        for key in keys:
            column, row = ((np.array(key) - low) * TILE_CELLS).tolist()
            yield key, height[column - 1 : column + TILE_CELLS + 1, row - 1 : row + TILE_CELLS + 1]


@dataclass(frozen=True)
class LocalGround:
    """Ground heights in cells of half a metre, by tiles of 32 m.

    Attributes:
        tiles: (m,) int64 keys of the tiles, increasing.
        height_m: (m, 66, 66) float32 at cell centres, eastward and northward, with a margin of one cell; nan where no
            ground is near.
    """

    tiles: NDArray[np.int64]
    height_m: NDArray[np.float32]

    def classify(
        self,
        x: NDArray[np.int32],
        y: NDArray[np.int32],
        z: NDArray[np.int32],
        step_m: float,
        classes: NDArray[np.uint8],
    ) -> None:
        """Set the final classes of points: near the ground GROUND, below it NOISE; VEHICLE and IMPLEMENT stay.

        Args:
            x, y, z: (n,) easting, northing, height in steps of `step_m` from the origin that the points had before.
            classes: (n,) uint8, changed in place.
        """
        if len(self.tiles):
            _set_classes(x, y, z, step_m, self.tiles, self.height_m, classes)


@kernel()
def _middle(xyz_m, kept):  # type: ignore[no-untyped-def]
    """Median (3,) of about a hundred of the kept points (n, 3); nan without any."""
    count = seen = taken = 0
    for i in range(len(kept)):
        count += kept[i]
    every = 1 + count // 100
    some = np.empty((3, 1 + count // every))
    for i in range(len(kept)):
        if kept[i]:
            if seen % every == 0:
                for a in range(3):
                    some[a, taken] = xyz_m[i, a]
                taken += 1
            seen += 1
    out = np.full(3, np.nan)
    if taken:
        for a in range(3):
            sort_in_place(some[a, :taken])
            out[a] = 0.5 * (some[a, (taken - 1) // 2] + some[a, taken // 2])
    return out


@kernel()
def _mark(xyz_m, kept, corner, window):  # type: ignore[no-untyped-def]
    """Set the tiles of a window that hold points to 0."""
    for i in range(len(xyz_m)):
        if not kept[i]:
            continue
        a = int(np.floor(xyz_m[i, 0] / GROUND_TILE_M)) - corner[0]
        b = int(np.floor(xyz_m[i, 1] / GROUND_TILE_M)) - corner[1]
        if 0 <= a < window.shape[0] and 0 <= b < window.shape[1]:
            window[a, b] = 0


@kernel()
def _draw(xyz_m, kept, corner, window, base_m, samples, counts):  # type: ignore[no-untyped-def]
    """Reservoir sampling of heights by cell."""
    for i in range(len(xyz_m)):
        if not kept[i]:
            continue
        u = xyz_m[i, 0] / GROUND_CELL_M
        v = xyz_m[i, 1] / GROUND_CELL_M
        column = int(np.floor(u)) - corner[0] * TILE_CELLS
        row = int(np.floor(v)) - corner[1] * TILE_CELLS
        a = column // TILE_CELLS
        b = row // TILE_CELLS
        if not (0 <= a < window.shape[0] and 0 <= b < window.shape[1]):
            continue
        slot = window[a, b]
        steps = np.rint((xyz_m[i, 2] - base_m[slot]) / _SAMPLE_STEP_M)
        if not abs(steps) < _RELIEF_STEPS:
            continue
        column = column % TILE_CELLS
        row = row % TILE_CELLS
        place = np.int64(counts[slot, column, row])
        counts[slot, column, row] = place + 1
        if place >= CELL_SAMPLES:
            # SplitMix64 (Steele, Lea, Flood 2014) of the cell and its count: reproducible.
            mixed = np.uint64((column * TILE_CELLS + row) * 2654435761 + place) * np.uint64(0x9E3779B97F4A7C15)
            mixed = (mixed ^ (mixed >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
            mixed = (mixed ^ (mixed >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
            place = np.int64(((mixed >> np.uint64(32)) * np.uint64(place + 1)) >> np.uint64(32))
        if place < CELL_SAMPLES:
            samples[slot, column, row, place] = np.int16(steps)


@kernel()
def _low_heights(samples, counts):  # type: ignore[no-untyped-def]
    """Quantile GROUND_QUANTILE of the samples of each cell, and the mean of those near it."""
    low = np.full(counts.shape, np.nan)
    mean = np.full(counts.shape, np.nan)
    near = GROUND_SPREAD_M / _SAMPLE_STEP_M
    held = np.empty(CELL_SAMPLES)
    for i in range(counts.shape[0]):
        for j in range(counts.shape[1]):
            n = min(counts[i, j], CELL_SAMPLES)
            if n < MIN_GROUND_RETURNS:
                continue
            for k in range(n):
                held[k] = samples[i, j, k]
            sort_in_place(held[:n])
            lowest = held[int(GROUND_QUANTILE * (n - 1) + 0.5)]
            total = 0.0
            number = 0
            for k in range(n):
                if abs(held[k] - lowest) <= near:
                    total += held[k]
                    number += 1
            low[i, j] = lowest * _SAMPLE_STEP_M
            mean[i, j] = total / number * _SAMPLE_STEP_M
    return low, mean


@kernel()
def _set_classes(x, y, z, step_m, tiles, height_m, classes):  # type: ignore[no-untyped-def]
    """Kernel of :meth:`LocalGround.classify`: bilinear ground height at each point."""
    last_key = np.int64(-1)
    tile = np.int64(-1)
    for i in range(len(x)):
        if classes[i] == _VEHICLE_CLASS or classes[i] == _IMPLEMENT_CLASS:
            continue
        u = x[i] * (step_m / GROUND_CELL_M)
        v = y[i] * (step_m / GROUND_CELL_M)
        column = int(np.floor(u))
        row = int(np.floor(v))
        key = np.int64((column // TILE_CELLS + _KEY) << 32) + row // TILE_CELLS + _KEY
        if key != last_key:
            last_key = key
            tile = count_until(tiles, key) - 1
            if tile >= 0 and tiles[tile] != key:
                tile = np.int64(-1)
        if tile < 0:
            continue
        u = u - 0.5 - (column // TILE_CELLS) * TILE_CELLS
        v = v - 0.5 - (row // TILE_CELLS) * TILE_CELLS
        a = int(np.floor(u))
        b = int(np.floor(v))
        p = u - a
        q = v - b
        h00 = height_m[tile, a + 1, b + 1]
        h01 = height_m[tile, a + 1, b + 2]
        h10 = height_m[tile, a + 2, b + 1]
        h11 = height_m[tile, a + 2, b + 2]
        ground = (1.0 - p) * ((1.0 - q) * h00 + q * h01) + p * ((1.0 - q) * h10 + q * h11)
        slope = (abs(h10 + h11 - h00 - h01) + abs(h01 + h11 - h00 - h10)) * (0.5 / GROUND_CELL_M)
        if np.isnan(ground):
            ground = height_m[tile, int(u + 0.5) + 1, int(v + 0.5) + 1]
            slope = 0.0
        above = z[i] * step_m - ground
        more = SLOPE_SHARE * slope
        if abs(above) <= NEAR_GROUND_M + more:
            classes[i] = _GROUND_CLASS
        elif above < -BELOW_M - more:
            classes[i] = _NOISE_CLASS
