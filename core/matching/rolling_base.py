"""The ground seen before, in a square of tiles that follows the vehicle: bounded memory, however long the drive."""

from __future__ import annotations

from typing import Final

import numba
import numpy as np
from numpy.typing import NDArray

from furrowmap.core.matching.surface import TILE, TILE_BITS, Surface, Tiles, add_returns

FloatArray = NDArray[np.float64]

SQUARE: Final = 7
"""Tiles to a side of the square."""
MOST_WEIGHT: Final = 20.0
"""Returns that a node remembers at most: new ones keep counting, and the ground follows."""


class RollingBase:
    """Heights of the soil as it is now, around the vehicle.

    Attributes:
        surface: only the layer of old soil is in use; soil that the implement passes over is emptied.

    Args:
        en_m: (2,) or (3,) where the vehicle is.
        cell_m: distance of the nodes.
    """

    def __init__(self, en_m: FloatArray, cell_m: float) -> None:
        west, south = _corner(en_m, cell_m)
        number = np.arange(SQUARE**2, dtype=np.int32).reshape(SQUARE, SQUARE)
        shape = (SQUARE**2, 4, TILE, TILE)
        tiles = Tiles(west, south, number, cell_m)
        self.surface = Surface(tiles, np.zeros(shape, np.float32), np.zeros(shape, np.float32))

    def copy(self) -> Surface:
        """A surface to which more can be added."""
        return Surface(self.surface.tiles, self.surface.height_m.copy(), self.surface.weight.copy())

    def add(
        self, xyz_m: FloatArray, chosen: NDArray[np.bool_], half: NDArray[np.uint8], trust: NDArray[np.uint8]
    ) -> None:
        """Add the chosen ones of returns (n, 3)."""
        add_returns(self.surface, xyz_m, np.where(chosen, 0, -1).astype(np.int8), half, trust)
        np.minimum(self.surface.weight, MOST_WEIGHT, out=self.surface.weight)

    def forget(self, middle_en_m: FloatArray, left_en: FloatArray, half_width_m: float) -> None:
        """Empty the nodes that a line passes; arguments as in :func:`~furrowmap.core.matching.surface.passage_of`."""
        tiles = self.surface.tiles
        _forget(
            middle_en_m, left_en, half_width_m, tiles.cell_m, tiles.west, tiles.south, tiles.number, self.surface.weight
        )

    def follow(self, en_m: FloatArray) -> None:
        """Bring a place to the middle tile: tiles that are left behind become new, empty ones ahead."""
        old, weight = self.surface.tiles, self.surface.weight
        west, south = _corner(en_m, old.cell_m)
        if (west, south) == (old.west, old.south):
            return
        number = np.full_like(old.number, -1)
        for row in range(SQUARE):
            for column in range(SQUARE):
                r, c = row + south - old.south, column + west - old.west
                if 0 <= r < SQUARE and 0 <= c < SQUARE:
                    number[row, column] = old.number[r, c]
        free = np.setdiff1d(np.arange(SQUARE**2), number)
        number[number < 0] = free
        weight[free] = 0.0
        self.surface.height_m[free] = 0.0
        self.surface = Surface(Tiles(west, south, number, old.cell_m), self.surface.height_m, weight)


def _corner(en_m: FloatArray, cell_m: float) -> tuple[int, int]:
    """West and south of the square of tiles round a place."""
    west, south = np.floor(en_m[:2] / (TILE * cell_m)).astype(int) - SQUARE // 2
    return int(west), int(south)


@numba.njit(cache=True, nogil=True)
def _forget(en_m, left, half_m, cell_m, west, south, number, weight):  # type: ignore[no-untyped-def]
    rows, columns = number.shape
    steps = int(np.ceil(half_m / (0.4 * cell_m)))
    for i in range(len(en_m)):
        for k in range(-steps, steps + 1):
            share = half_m * k / steps
            x = int(np.round((en_m[i, 0] + share * left[i, 0]) / cell_m))
            y = int(np.round((en_m[i, 1] + share * left[i, 1]) / cell_m))
            row, column = (y >> TILE_BITS) - south, (x >> TILE_BITS) - west
            if 0 <= row < rows and 0 <= column < columns:
                weight[number[row, column], :, y & TILE - 1, x & TILE - 1] = 0.0
