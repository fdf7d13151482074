"""The ground of a run: learned from the points as they are placed, and looked up for each when they are written.

The points of a run pass once. In every cell of half a metre a few of their heights are kept, drawn so that each had the
same chance (Vitter 1985, Random sampling with a reservoir, ACM Transactions on Mathematical Software 11, 37-57,
algorithm R). The low ones among them are what the cell shows of the ground, unless it lies under something that stands:
that the morphological filter finds out. Its ground is then compared with each point.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numba
import numpy as np
from numpy.typing import NDArray

from furrowmap.core.surfaces.gaps import filled
from furrowmap.core.surfaces.smrf import Smrf, ground_cells
from furrowmap.core.values.point_classes import PointClass

FloatArray = NDArray[np.float64]

_GROUND, _NOISE = np.uint8(PointClass.GROUND), np.uint8(PointClass.NOISE)
_VEHICLE, _IMPLEMENT = np.uint8(PointClass.VEHICLE), np.uint8(PointClass.IMPLEMENT)
CELL_M: Final = 0.5
TILE_CELLS: Final = 64
TILE_M: Final = TILE_CELLS * CELL_M
SAMPLES: Final = 16
_STEP_M: Final = 0.002
_RELIEF_STEPS: Final = 32_000
"""Samples are kept in steps of 2 mm from the middle height of the tile's first scan: 64 m up and down."""
FEWEST: Final = 3
"""A cell with fewer returns shows no ground."""
LOW_SHARE: Final = 0.2
"""The height below which this share of a cell's samples lies is its ground, before the filter."""
NEAR_M: Final = 0.10
"""The ground of a cell is the mean of its samples up to this height above and below that."""
NEAR_GROUND_M: Final = 0.15
"""Points up to so far above and below the ground are of it: clods, ridges and short stubble are."""
SLOPE_SHARE: Final = 0.35
"""And farther by this share of the height by which the ground rises over a metre: the ground of a cell is its mean."""
BELOW_M: Final = 0.25
"""Points farther below it, and by the same share, are noise; between are furrows that the cells are too coarse for."""
_FAR_TILES: Final = 5
"""The ground is learned up to so many tiles from the middle of a scan."""
_BEYOND_CELLS: Final = 4.0
"""Cells without ground of their own have one from around up to this distance."""
_BLOCK: Final = 8
"""Tiles filtered together, to each side; with one more round them."""
_KEY: Final = 1 << 30


class GroundSampler:
    """Takes the points of scan after scan and keeps what tells the ground.

    Memory grows with the land and not with time: 150 bytes for each square metre of tiles in which there are points.
    """

    def __init__(self) -> None:
        self._slots: dict[tuple[int, int], int] = {}
        self._samples = np.zeros((16, TILE_CELLS, TILE_CELLS, SAMPLES), np.int16)
        self._counts = np.zeros((16, TILE_CELLS, TILE_CELLS), np.int32)
        self._base_m = np.zeros(16)

    def add(self, xyz_m: FloatArray, kept: NDArray[np.bool_]) -> None:
        """Take note of the points of a scan.

        Args:
            xyz_m: (n, 3).
            kept: (n,) which of them may be land: they are finite, and neither the machine's nor stray returns.
        """
        xyz_m = np.ascontiguousarray(xyz_m)
        middle_m = _middle(xyz_m, kept)
        if np.isnan(middle_m[0]):
            return
        corner = np.floor(middle_m[:2] / TILE_M).astype(np.int64) - _FAR_TILES
        window = np.full((2 * _FAR_TILES + 1,) * 2, -1, np.int64)
        _mark(xyz_m, kept, corner, window)
        for column, row in np.argwhere(window == 0).tolist():
            window[column, row] = self._slot((int(corner[0]) + column, int(corner[1]) + row), float(middle_m[2]))
        _draw(xyz_m, kept, corner, window, self._base_m, self._samples, self._counts)

    def ground(self) -> LocalGround:
        """The ground of all points so far."""
        blocks: dict[tuple[int, int], list[tuple[int, int]]] = {}
        for key in self._slots:
            blocks.setdefault((key[0] // _BLOCK, key[1] // _BLOCK), []).append(key)
        found = {key: height for keys in blocks.values() for key, height in self._block(keys)}
        keys = sorted(found)
        heights = np.stack([found[key] for key in keys]) if keys else np.zeros((0, TILE_CELLS + 2, TILE_CELLS + 2))
        return LocalGround(np.array([_number(*key) for key in keys], np.int64), heights.astype(np.float32))

    def _slot(self, key: tuple[int, int], height_m: float) -> int:
        """Where the samples of a tile are; a new one is made, for heights round `height_m`."""
        if key in self._slots:
            return self._slots[key]
        slot = self._slots[key] = len(self._slots)
        if slot == len(self._base_m):
            self._samples, self._counts, self._base_m = (
                _doubled(held) for held in (self._samples, self._counts, self._base_m)
            )
        self._base_m[slot] = height_m
        return slot

    def _block(self, keys: Sequence[tuple[int, int]]) -> Iterator[tuple[tuple[int, int], FloatArray]]:
        """The ground of some tiles near each other, each with the cells next to it."""
        low, high = np.min(keys, axis=0) - 1, np.max(keys, axis=0) + 2
        lowest, mean = (np.full((high - low) * TILE_CELLS, np.nan) for _ in range(2))
        for key, slot in self._slots.items():
            if np.all(low <= key) and np.all(key < high):
                at = tuple(slice(n, n + TILE_CELLS) for n in ((np.array(key) - low) * TILE_CELLS).tolist())
                lowest[at], mean[at] = _low_heights(self._samples[slot], self._counts[slot])
                lowest[at] += self._base_m[slot]
                mean[at] += self._base_m[slot]
        ground = ground_cells(lowest, Smrf(cell_m=CELL_M))
        height = filled(np.where(ground, mean, np.nan), _BEYOND_CELLS)
        for key in keys:
            column, row = ((np.array(key) - low) * TILE_CELLS).tolist()
            yield key, height[column - 1 : column + TILE_CELLS + 1, row - 1 : row + TILE_CELLS + 1]


@dataclass(frozen=True)
class LocalGround:
    """The height of the ground in cells of half a metre, tile by tile of 32 m.

    Attributes:
        tiles: (m,) int64 numbers of the tiles, rising.
        height_m: (m, 66, 66) float32 at the cells' middles, eastward and northward, one cell more on each side; nan
            where no ground is near.
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
        """Give points their final classes.

        Those near the ground become GROUND, those below it NOISE; OTHER and NOISE stay what they are elsewhere, VEHICLE
        and IMPLEMENT everywhere.

        Args:
            x: (n,) easting in steps from the origin that the points had before.
            y: (n,) northing.
            z: (n,) height.
            step_m: length of a step.
            classes: (n,) uint8, changed in place.
        """
        if len(self.tiles):
            _settle(x, y, z, step_m, self.tiles, self.height_m, classes)


def _number(column: int, row: int) -> int:
    """One number for a tile; in a kernel, too."""
    return (column + _KEY << 32) + row + _KEY


def _doubled(held: NDArray[Any]) -> NDArray[Any]:
    """The array with as many zeros after it, which take no memory before they are used."""
    more = np.zeros((2 * len(held), *held.shape[1:]), held.dtype)
    more[: len(held)] = held
    return more


@numba.njit(cache=True, nogil=True)
def _middle(xyz_m, kept):  # type: ignore[no-untyped-def]
    """The median (3,) of about a hundred of the points kept; nan if there are none."""
    every = 1 + np.count_nonzero(kept) // 100
    some = np.empty((1 + len(kept) // every, 3))
    seen = taken = 0
    for i in range(len(kept)):
        if kept[i]:
            if seen % every == 0:
                some[taken] = xyz_m[i]
                taken += 1
            seen += 1
    out = np.full(3, np.nan)
    if taken > 0:
        for a in range(3):
            out[a] = np.median(some[:taken, a])
    return out


@numba.njit(cache=True, nogil=True)
def _mark(xyz_m, kept, corner, window):  # type: ignore[no-untyped-def]
    """Put 0 for the tiles of a window in which there are points."""
    for i in range(len(xyz_m)):
        if not kept[i]:
            continue
        a = int(np.floor(xyz_m[i, 0] / TILE_M)) - corner[0]
        b = int(np.floor(xyz_m[i, 1] / TILE_M)) - corner[1]
        if 0 <= a < window.shape[0] and 0 <= b < window.shape[1]:
            window[a, b] = 0


@numba.njit(cache=True, nogil=True)
def _draw(xyz_m, kept, corner, window, base_m, samples, counts):  # type: ignore[no-untyped-def]
    """Keep each height with the chance that its cell's number of returns leaves it."""
    for i in range(len(xyz_m)):
        if not kept[i]:
            continue
        u, v = xyz_m[i, 0] / CELL_M, xyz_m[i, 1] / CELL_M
        column = int(np.floor(u)) - corner[0] * TILE_CELLS
        row = int(np.floor(v)) - corner[1] * TILE_CELLS
        a, b = column // TILE_CELLS, row // TILE_CELLS
        if not (0 <= a < window.shape[0] and 0 <= b < window.shape[1]):
            continue
        slot = window[a, b]
        steps = np.rint((xyz_m[i, 2] - base_m[slot]) / _STEP_M)
        if not abs(steps) < _RELIEF_STEPS:
            continue
        column, row = column % TILE_CELLS, row % TILE_CELLS
        place = np.int64(counts[slot, column, row])
        counts[slot, column, row] = place + 1
        if place >= SAMPLES:
            # SplitMix64 (Steele, Lea, Flood 2014) of the cell and its count: the same run draws the same.
            mixed = np.uint64((column * TILE_CELLS + row) * 2654435761 + place) * np.uint64(0x9E3779B97F4A7C15)
            mixed = (mixed ^ (mixed >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
            mixed = (mixed ^ (mixed >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
            place = np.int64(((mixed >> np.uint64(32)) * np.uint64(place + 1)) >> np.uint64(32))
        if place < SAMPLES:
            samples[slot, column, row, place] = np.int16(steps)


@numba.njit(cache=True, nogil=True)
def _low_heights(samples, counts):  # type: ignore[no-untyped-def]
    """Of each cell of a tile the height below which LOW_SHARE of its samples lie, and the mean of those near it."""
    low = np.full(counts.shape, np.nan)
    mean = np.full(counts.shape, np.nan)
    near = NEAR_M / _STEP_M
    for i in range(counts.shape[0]):
        for j in range(counts.shape[1]):
            n = min(counts[i, j], SAMPLES)
            if n < FEWEST:
                continue
            held = np.sort(samples[i, j, :n])
            lowest = held[int(LOW_SHARE * (n - 1) + 0.5)]
            total, number = 0.0, 0
            for value in held:
                if abs(float(value) - float(lowest)) <= near:
                    total += value
                    number += 1
            low[i, j] = lowest * _STEP_M
            mean[i, j] = total / number * _STEP_M
    return low, mean


@numba.njit(cache=True, nogil=True)
def _settle(x, y, z, step_m, tiles, height_m, classes):  # type: ignore[no-untyped-def]
    """Kernel of :meth:`LocalGround.classify`: the ground between four middles of cells, against each point."""
    last_key, tile = np.int64(-1), np.int64(-1)
    for i in range(len(x)):
        if classes[i] == _VEHICLE or classes[i] == _IMPLEMENT:
            continue
        u, v = x[i] * (step_m / CELL_M), y[i] * (step_m / CELL_M)
        column, row = int(np.floor(u)), int(np.floor(v))
        key = np.int64((column // TILE_CELLS + _KEY) << 32) + row // TILE_CELLS + _KEY
        if key != last_key:
            last_key = key
            tile = np.int64(np.searchsorted(tiles, key))
            if tile == len(tiles) or tiles[tile] != key:
                tile = np.int64(-1)
        if tile < 0:
            continue
        u, v = u - 0.5 - (column // TILE_CELLS) * TILE_CELLS, v - 0.5 - (row // TILE_CELLS) * TILE_CELLS
        a, b = int(np.floor(u)), int(np.floor(v))
        p, q = u - a, v - b
        h00, h01 = height_m[tile, a + 1, b + 1], height_m[tile, a + 1, b + 2]
        h10, h11 = height_m[tile, a + 2, b + 1], height_m[tile, a + 2, b + 2]
        ground = (1.0 - p) * ((1.0 - q) * h00 + q * h01) + p * ((1.0 - q) * h10 + q * h11)
        slope = (abs(h10 + h11 - h00 - h01) + abs(h01 + h11 - h00 - h10)) * (0.5 / CELL_M)
        if np.isnan(ground):
            ground, slope = height_m[tile, int(u + 0.5) + 1, int(v + 0.5) + 1], 0.0
        above = z[i] * step_m - ground
        more = SLOPE_SHARE * slope
        if abs(above) <= NEAR_GROUND_M + more:
            classes[i] = _GROUND
        elif above < -BELOW_M - more:
            classes[i] = _NOISE
