"""Square cells anchored to a CRS, and the surface that lies over them."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from furrowmap.core.values.errors import InputError

Float32Array = NDArray[np.float32]
FloatArray = NDArray[np.float64]

FINEST_CELL_M: Final = 0.001
MOST_CELLS: Final = 2**31
"""A grid of more cells is a mistake of units or a stray point, and no raster that a GIS would draw."""


@dataclass(frozen=True)
class Grid:
    """Square cells whose edges are whole multiples of their size from the CRS's 0, 0: two grids of one size overlay.

    Arrays over it are north-up: row 0 is the northernmost, column 0 the westernmost.

    Attributes:
        cell_m: length of a cell's sides.
        west: of the grid's western edge, in cells east of the CRS's 0.
        north: of the grid's northern edge, in cells north of the CRS's 0.
        shape: rows and columns, each at least 1.

    Raises:
        InputError: if the cells are finer than a millimetre or more than `MOST_CELLS`.
    """

    cell_m: float
    west: int
    north: int
    shape: tuple[int, int]

    def __post_init__(self) -> None:
        if not (math.isfinite(self.cell_m) and self.cell_m >= FINEST_CELL_M):
            raise InputError(
                f"A cell of {self.cell_m:g} m.",
                "A surface needs square cells of at least a millimetre.",
                "Give the cell size in metres, such as 0.05.",
                code="bad-cell-size",
            )
        rows, columns = self.shape
        if rows < 1 or columns < 1 or rows * columns > MOST_CELLS:
            raise InputError(
                f"A grid of {columns:,} x {rows:,} cells of {self.cell_m:g} m.",
                "No raster of that size is written; a stray point far away, or degrees taken for metres, make one.",
                "Choose larger cells, give a box (--bbox), or leave the stray points out.",
                code="grid-too-large",
            )

    @classmethod
    def of_bounds(cls, cell_m: float, bounds_m: tuple[float, float, float, float]) -> Self:
        """The least grid that covers west, south, east, north; a point on the eastern or northern bound is in it.

        Raises:
            InputError: if the bounds are not finite, or give no fair grid.
        """
        west, south, east, north = bounds_m
        if not all(map(math.isfinite, bounds_m)) or east < west or north < south:
            raise InputError(
                f"Bounds {west:g}, {south:g}, {east:g}, {north:g}.",
                "They enclose nothing: west to east and south to north must be finite and in that order.",
                "Give west, south, east, north in metres of the map's CRS.",
                code="bad-bounds",
            )
        if not (math.isfinite(cell_m) and cell_m >= FINEST_CELL_M):
            return cls(cell_m, 0, 0, (1, 1))  # says what is wrong with it
        left, bottom = math.floor(west / cell_m), math.floor(south / cell_m)
        right, top = math.floor(east / cell_m) + 1, math.floor(north / cell_m) + 1
        return cls(cell_m, left, top, (top - bottom, right - left))

    @property
    def rows(self) -> int:
        """From north to south."""
        return self.shape[0]

    @property
    def columns(self) -> int:
        """From west to east."""
        return self.shape[1]

    @property
    def cell_area_m2(self) -> float:
        """Of one cell."""
        return self.cell_m * self.cell_m

    @property
    def bounds_m(self) -> tuple[float, float, float, float]:
        """West, south, east and north edge."""
        west, south = self.west * self.cell_m, (self.north - self.rows) * self.cell_m
        return west, south, (self.west + self.columns) * self.cell_m, self.north * self.cell_m

    @property
    def transform(self) -> tuple[float, float, float, float, float, float]:
        """Affine (a, b, c, d, e, f) from column and row to easting and northing, as rasterio's `Affine` takes it."""
        return self.cell_m, 0.0, self.west * self.cell_m, 0.0, -self.cell_m, self.north * self.cell_m

    def cells_of(self, e_m: ArrayLike, n_m: ArrayLike) -> tuple[NDArray[np.intp], NDArray[np.bool_]]:
        """Flat index ``row * columns + column`` (n,) of the cells in which points lie, and (n,) whether in the grid.

        A point on an edge belongs to the cell east or north of it. The index of a point outside is -1.
        """
        column = np.floor(np.asarray(e_m, np.float64) / self.cell_m) - self.west
        row = self.north - 1.0 - np.floor(np.asarray(n_m, np.float64) / self.cell_m)
        inside = (column >= 0) & (column < self.columns) & (row >= 0) & (row < self.rows)
        flat = np.where(inside, row * self.columns + column, -1.0)
        return flat.astype(np.intp), inside

    def centres_m(self) -> tuple[FloatArray, FloatArray]:
        """Easting (columns,) and northing (rows,) of the cells' centres, north first."""
        easting = (self.west + 0.5 + np.arange(self.columns)) * self.cell_m
        northing = (self.north - 0.5 - np.arange(self.rows)) * self.cell_m
        return easting.astype(np.float64), northing.astype(np.float64)

    def coarser(self, factor: int) -> Self:
        """The least grid over this one with cells `factor` times as large, anchored as all are."""
        west, north = self.west // factor, -(-self.north // factor)
        south, east = (self.north - self.rows) // factor, -(-(self.west + self.columns) // factor)
        return type(self)(self.cell_m * factor, west, north, (north - south, east - west))

    def window_in(self, other: Grid) -> tuple[slice, slice]:
        """Rows and columns of `other`, which has the same cells and covers this grid, that this grid takes.

        Raises:
            ValueError: if it does not, or has other cells.
        """
        row, column = other.north - self.north, self.west - other.west
        fits = 0 <= row <= other.rows - self.rows and 0 <= column <= other.columns - self.columns
        if self.cell_m != other.cell_m or not fits:
            raise ValueError(f"{self} does not lie in {other}.")
        return slice(row, row + self.rows), slice(column, column + self.columns)


@dataclass(frozen=True)
class Surface:
    """One height a cell, and how well it is known.

    Attributes:
        grid: where; the arrays below have its shape, north up.
        height_m: float32, above what the map's heights are above; nan where there is none.
        count: uint32 returns that made it; 0 where there is none.
        spread_m: float32 standard deviation of the returns' heights in the cell, relief within it included; nan where
            fewer than two returns tell it.
        standard_error_m: float32 of `height_m`, from spread and count as if the returns' errors were independent; nan
            likewise. What all returns of a cell have in common, such as an error of the trajectory, is not in it.
    """

    grid: Grid
    height_m: Float32Array
    count: NDArray[np.uint32]
    spread_m: Float32Array
    standard_error_m: Float32Array

    def __post_init__(self) -> None:
        bands = [self.height_m, self.count, self.spread_m, self.standard_error_m]
        if any(band.shape != self.grid.shape for band in bands):
            raise ValueError(f"Bands of other shapes than {self.grid.shape}.")

    @property
    def seen(self) -> NDArray[np.bool_]:
        """Where there is a measured height."""
        return self.count > 0
