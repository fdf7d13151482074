"""Grids of square cells anchored to a CRS, and surfaces on them."""

import math
from dataclasses import dataclass
from typing import Final, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from furrowmap.core.runtime.arrays import Float32Array, FloatArray
from furrowmap.core.runtime.errors import InputError

FINEST_CELL_M: Final = 0.001
MAX_GRID_CELLS: Final = 2**31
"""More cells mean wrong units or a stray point."""


@dataclass(frozen=True)
class Grid:
    """Square cells whose edges are multiples of their size from the CRS origin, so that grids of one size align.

    Arrays on it are north-up: row 0 is the northernmost, column 0 the westernmost. Raises InputError if the cells are
    finer than a millimetre or more than `MAX_GRID_CELLS`.

    Attributes:
        west: western edge in cells from the CRS origin.
        north: northern edge likewise.
        shape: rows and columns, each at least 1.
    """

    cell_m: float
    west: int
    north: int
    shape: tuple[int, int]

    def __post_init__(self) -> None:
        if not (math.isfinite(self.cell_m) and self.cell_m >= FINEST_CELL_M):
            raise InputError("bad-cell-size", cell_m=self.cell_m)
        rows, columns = self.shape
        if rows < 1 or columns < 1 or rows * columns > MAX_GRID_CELLS:
            raise InputError("grid-too-large", columns=columns, rows=rows, cell_m=self.cell_m)

    @classmethod
    def of_bounds(cls, cell_m: float, bounds_m: tuple[float, float, float, float]) -> Self:
        """The smallest grid over west, south, east, north, included. Raises InputError if they or it are invalid."""
        west, south, east, north = bounds_m
        if not all(map(math.isfinite, bounds_m)) or east < west or north < south:
            raise InputError("bad-bounds", west=west, south=south, east=east, north=north)
        if not (math.isfinite(cell_m) and cell_m >= FINEST_CELL_M):
            return cls(cell_m, 0, 0, (1, 1))  # raises
        left = math.floor(west / cell_m)
        bottom = math.floor(south / cell_m)
        right = math.floor(east / cell_m) + 1
        top = math.floor(north / cell_m) + 1
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
        west = self.west * self.cell_m
        south = (self.north - self.rows) * self.cell_m
        return west, south, (self.west + self.columns) * self.cell_m, self.north * self.cell_m

    @property
    def transform(self) -> tuple[float, float, float, float, float, float]:
        """Affine (a, b, c, d, e, f) from column and row to easting and northing, as rasterio's `Affine` takes it."""
        return self.cell_m, 0.0, self.west * self.cell_m, 0.0, -self.cell_m, self.north * self.cell_m

    def cells_of(self, e_m: ArrayLike, n_m: ArrayLike) -> tuple[NDArray[np.intp], NDArray[np.bool_]]:
        """Flat index ``row * columns + column`` (n,) of the cells of points, -1 outside; and (n,) whether inside.

        A point on an edge belongs to the cell east or north of it.
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

    def positions_m(self) -> FloatArray:
        """Easting and northing (rows * columns, 2) of the cells' centres, row by row from the north."""
        easting, northing = np.meshgrid(*self.centres_m())
        return np.column_stack([easting.ravel(), northing.ravel()])

    def coarser(self, factor: int) -> Self:
        """The smallest grid of cells `factor` times as large that covers this one."""
        west = self.west // factor
        north = -(-self.north // factor)
        south = (self.north - self.rows) // factor
        east = -(-(self.west + self.columns) // factor)
        return type(self)(self.cell_m * factor, west, north, (north - south, east - west))

    def window_in(self, other: "Grid") -> tuple[slice, slice]:
        """Rows and columns of this grid within `other`. Raises ValueError if that does not cover it cell by cell."""
        row = other.north - self.north
        column = self.west - other.west
        fits = 0 <= row <= other.rows - self.rows and 0 <= column <= other.columns - self.columns
        if self.cell_m != other.cell_m or not fits:
            raise ValueError(f"{self} does not lie in {other}.")
        return slice(row, row + self.rows), slice(column, column + self.columns)


@dataclass(frozen=True)
class Surface:
    """Heights of cells with their uncertainty; arrays have the shape of the grid, north up.

    Attributes:
        height_m: float32 in the height system of the map; nan where empty.
        count: uint32 number of returns.
        spread_m: float32 standard deviation of the returns in the cell, relief included; nan with fewer than two.
        standard_error_m: float32 of `height_m`, assuming independent errors of returns; nan likewise. Errors common to
            all returns of a cell, such as those of the trajectory, are not included.
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
