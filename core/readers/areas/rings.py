"""Which polygon points lie in, for many points and polygons."""

import math
from collections.abc import Sequence
from typing import Final, NamedTuple, Protocol

import numpy as np
import shapely
from numpy.typing import NDArray

from furrowmap.core.runtime.arrays import FloatArray, IntArray
from furrowmap.core.runtime.kernels import kernel

_RING_CELL_M: Final = 0.5
_MAX_RING_CELLS: Final = 1_000_000


class PixelGrid(Protocol):
    """A grid of square pixels."""

    def centres_m(self) -> tuple[FloatArray, FloatArray]:
        """Easting (columns,) and northing (rows,) of their middles, evenly spaced."""


class Rings(NamedTuple):
    """Polygons for kernels; coordinates from an origin.

    Attributes:
        x, y: (n,) corners of all polygons, the first of each ring repeated at its end, nan between two rings.
        first: (k + 1,) first corner of each polygon, and n.
        boxes: (k, 4) west, south, east, north.
        starts: (rows * columns + 1,) first entry of each cell of a grid in `near`.
        near: polygons that touch the cells.
        grid: west, south, side, rows, columns of the grid.
    """

    x: FloatArray
    y: FloatArray
    first: IntArray
    boxes: FloatArray
    starts: IntArray
    near: NDArray[np.int32]
    grid: tuple[float, float, float, int, int]


def rings_of(shapes: Sequence[shapely.Polygon], origin_m: tuple[float, float]) -> Rings:
    """Polygons, with their holes, as rings."""
    rings = [_corners(shape) - origin_m for shape in shapes]
    first = np.concatenate([[0], np.cumsum([len(ring) for ring in rings])]).astype(np.int64)
    boxes = np.array([[*np.nanmin(ring, axis=0), *np.nanmax(ring, axis=0)] for ring in rings])
    west, south = boxes[:, :2].min(axis=0)
    east, north = boxes[:, 2:].max(axis=0)
    side = max(_RING_CELL_M, math.sqrt((east - west) * (north - south) / _MAX_RING_CELLS))
    columns = int((east - west) / side) + 1
    rows = int((north - south) / side) + 1
    low = ((boxes[:, :2] - (west, south)) / side).astype(np.int64)
    high = ((boxes[:, 2:] - (west, south)) / side).astype(np.int64)
    starts, near = _near_cells(low, high, rows, columns)
    corners = np.concatenate(rings)
    return Rings(
        np.ascontiguousarray(corners[:, 0]),
        np.ascontiguousarray(corners[:, 1]),
        first,
        boxes,
        starts,
        near,
        (float(west), float(south), float(side), rows, columns),
    )


def _corners(shape: shapely.Polygon) -> FloatArray:
    """The rings (n, 2) of a polygon one after another, with a row of nan between two: no edge crosses that."""
    rings = [shapely.get_coordinates(ring) for ring in (shape.exterior, *shape.interiors)]
    gap = np.full((1, 2), np.nan)
    return np.concatenate([part for ring in rings for part in (gap, ring)][1:])


@kernel()
def _near_cells(low, high, rows, columns):  # type: ignore[no-untyped-def]
    """Starts and entries of the cells, from the first and last column and row of each polygon."""
    starts = np.zeros(rows * columns + 1, np.int64)
    for k in range(len(low)):
        for i in range(low[k, 1], high[k, 1] + 1):
            for j in range(low[k, 0], high[k, 0] + 1):
                starts[i * columns + j + 1] += 1
    for cell in range(rows * columns):
        starts[cell + 1] += starts[cell]
    near = np.empty(starts[-1], np.int32)
    # filled from the last polygon on, backwards from the end of each cell: each end moves to its start
    for k in range(len(low) - 1, -1, -1):
        for i in range(low[k, 1], high[k, 1] + 1):
            for j in range(low[k, 0], high[k, 0] + 1):
                cell = i * columns + j
                starts[cell + 1] -= 1
                near[starts[cell + 1]] = k
    for cell in range(rows * columns):
        starts[cell] = starts[cell + 1]
    starts[-1] = len(near)
    return starts, near


@kernel()
def _rings_at(xs, ys, first, boxes, starts, near, grid, x_m, y_m, among, out):  # type: ignore[no-untyped-def]
    """The first polygon that each point lies in; -1 for none. Arrays one by one: passing them together costs more."""
    west, south, side, rows, columns = grid
    for n in range(len(x_m)):
        out[n] = -1
        if len(among) and not among[n]:
            continue
        x = x_m[n]
        y = y_m[n]
        i = math.floor((y - south) / side)
        j = math.floor((x - west) / side)
        if i < 0 or j < 0 or i >= rows or j >= columns:
            continue
        cell = i * columns + j
        for place in range(starts[cell], starts[cell + 1]):
            k = near[place]
            if x < boxes[k, 0] or y < boxes[k, 1] or x > boxes[k, 2] or y > boxes[k, 3]:
                continue
            inside = False
            for c in range(first[k], first[k + 1] - 1):
                y0 = ys[c]
                y1 = ys[c + 1]
                if (y0 > y) != (y1 > y) and x < xs[c] + (y - y0) / (y1 - y0) * (xs[c + 1] - xs[c]):
                    inside = not inside
            if inside:
                out[n] = k
                break


def ring_at(rings: Rings, x_m: FloatArray, y_m: FloatArray, among: NDArray[np.bool_] | None = None) -> IntArray:
    """Number (n,) of the first polygon that each point (n,), from the rings' origin, lies in; -1 for none.

    Only the points marked in `among` (n,) are looked at, if it is given; the others have -1.
    """
    out = np.empty(len(x_m), np.int64)
    looked_at = np.zeros(0, np.bool_) if among is None else among
    _rings_at(*rings, np.ascontiguousarray(x_m), np.ascontiguousarray(y_m), looked_at, out)
    return out


def pixels_in(shape: shapely.Polygon, grid: PixelGrid) -> NDArray[np.bool_]:
    """The pixels (rows, columns) of a grid whose middle lies in a polygon, and in none of its holes."""
    easting, northing = grid.centres_m()
    corners = _corners(shape) - (easting[0], northing[0])
    inside = np.zeros((len(northing), len(easting)), np.bool_)
    x = np.ascontiguousarray(corners[:, 0])
    y = np.ascontiguousarray(corners[:, 1])
    _pixels_in(x, y, easting - easting[0], northing - northing[0], inside)
    return inside


@kernel()
def _pixels_in(xs, ys, x_m, y_m, inside):  # type: ignore[no-untyped-def]
    """Row by row: an edge that the row crosses turns the pixels to the west of it inside out."""
    step = x_m[1] - x_m[0] if len(x_m) > 1 else 1.0
    for i in range(len(y_m)):
        y = y_m[i]
        for c in range(len(xs) - 1):
            y0 = ys[c]
            y1 = ys[c + 1]
            if (y0 > y) != (y1 > y):
                crossing = xs[c] + (y - y0) / (y1 - y0) * (xs[c + 1] - xs[c])
                for j in range(min(len(x_m), max(0, math.ceil(crossing / step)))):
                    inside[i, j] = not inside[i, j]
