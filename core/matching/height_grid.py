"""The ground as matching knows it: a height grid in tiles, old soil and new, in two independent halves.

Each return adds its height to the four nodes round it with bilinear weights. Where the implement has passed, soil
seen before belongs to another layer than soil seen after, and what was seen in between to none. The returns of
either half of the scans are matched to the other half's surface, so that no return meets its own noise.
"""

from collections.abc import Callable, Sequence
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from furrowmap.core.runtime import arrays
from furrowmap.core.runtime.arrays import FloatArray
from furrowmap.core.runtime.kernels import kernel, kernel_part
from furrowmap.core.values.extents import bounds

TILE_BITS: Final = 5
TILE_NODES: Final = 1 << TILE_BITS
"""Nodes along a side of a tile."""
MIN_KNOWN_RETURNS: Final = 0.5
"""Returns about a place from which its height is known."""
SHEETS: Final = 4
"""Surfaces in a tile: 2 · layer + half; layer 0 is soil before the implement's first pass, 1 after its last."""


class Tiles(NamedTuple):
    """Square tiles of a grid, of which only those in use take memory.

    Attributes:
        west: column of the first tile, counted in tiles from the local origin.
        south: row of the first tile.
        number: (rows, columns) int32 number of each tile, −1 where there is none.
        cell_m: distance of the nodes.
    """

    west: int
    south: int
    number: NDArray[np.int32]
    cell_m: float

    @property
    def used(self) -> int:
        """How many tiles there are."""
        return int(self.number.max(initial=-1)) + 1


class HeightGrid(NamedTuple):
    """Heights above the local origin.

    Attributes:
        height_m: (tiles, 4, 32, 32) float32 mean heights; see :data:`SHEETS`.
        weight: (tiles, 4, 32, 32) float32 number of returns in them.
    """

    tiles: Tiles
    height_m: NDArray[np.float32]
    weight: NDArray[np.float32]


class Corners(NamedTuple):
    """Values at the four nodes round a cell: in the south-west, south-east, north-west and north-east."""

    sw: float
    se: float
    nw: float
    ne: float


class TilePassage(NamedTuple):
    """When the implement's line passed each cell.

    Attributes:
        first_s: (tiles, 32, 32) float64 of the first time; +inf where it never passed.
        last_s: (tiles, 32, 32) float64 of the last one; −inf where it never passed.
    """

    tiles: Tiles
    first_s: FloatArray
    last_s: FloatArray


def tiles_over(en_m: FloatArray, cell_m: float) -> Tiles:
    """Tiles that hold the points (n, 2) and the nodes round them."""
    points = np.ascontiguousarray(en_m)
    return _tiles(*bounds(points), cell_m, lambda *grid: _touch(points, *grid))


def tiles_around(path_m: FloatArray, aside_m: FloatArray, cell_m: float) -> Tiles:
    """Tiles that hold the points (m, 2) about each of those of a path (n, 2), and the nodes round them."""
    path, aside = np.ascontiguousarray(path_m), np.ascontiguousarray(aside_m)
    low, high = np.array(bounds(path)) + np.array(bounds(aside))
    return _tiles(low, high, cell_m, lambda *grid: _touch_around(path, aside, *grid))


def _tiles(low_m: FloatArray, high_m: FloatArray, cell_m: float, touch: Callable[..., None]) -> Tiles:
    """Tiles between two corners, of those that `touch` marks."""
    side = TILE_NODES * cell_m
    low = np.floor(low_m / side).astype(np.int64) - 1
    high = np.floor(high_m / side).astype(np.int64) + 1
    used = np.zeros((high[1] - low[1] + 1, high[0] - low[0] + 1), np.bool_)
    touch(cell_m, int(low[0]), int(low[1]), used)
    number = np.where(used, np.cumsum(used).reshape(used.shape) - 1, -1).astype(np.int32)
    return Tiles(int(low[0]), int(low[1]), number, cell_m)


def passage_of(
    t_s: FloatArray, tool_en_m: FloatArray, left_en: FloatArray, half_width_m: float, cell_m: float
) -> TilePassage:
    """When a line of `half_width_m` to either side passed over the ground.

    Args:
        t_s: (n,) times, closely enough that the line skips no cell.
        tool_en_m: (n, 2) middle of the line.
        left_en: (n, 2) unit vectors to its left.
        half_width_m: half the width of the ground that changes.
    """
    reach_m = half_width_m + cell_m
    steps = int(np.ceil(reach_m / (TILE_NODES * cell_m)))
    across = reach_m * np.linspace(-1.0, 1.0, 2 * steps + 1)
    tiles = tiles_over(np.concatenate([tool_en_m + offset * left_en for offset in across]), cell_m)
    first = arrays.full((tiles.used, TILE_NODES, TILE_NODES), np.inf)
    last = arrays.full((tiles.used, TILE_NODES, TILE_NODES), -np.inf)
    _sweep(
        np.ascontiguousarray(t_s), np.ascontiguousarray(tool_en_m), np.ascontiguousarray(left_en), half_width_m, cell_m,
        tiles.west, tiles.south, tiles.number, first, last,
    )  # fmt: skip
    return TilePassage(tiles, first, last)


def layers(t_s: FloatArray, en_m: FloatArray, passage: TilePassage | None, guard_s: float) -> NDArray[np.int8]:
    """(n,) layer of each return: 0 old soil, 1 new, −1 soil that the implement changed again afterwards.

    Args:
        t_s: (n,).
        en_m: (n, 2) or (n, 3) where the returns lie.
        passage: None where no implement works.
        guard_s: returns this near to a passage belong to no layer.
    """
    out = np.zeros(len(t_s), np.int8)
    if passage is not None:
        _layers(t_s, en_m, guard_s, passage, out)
    return out


def empty_surface(tiles: Tiles) -> HeightGrid:
    """A surface that nothing has been added to."""
    height = arrays.zeros((tiles.used, SHEETS, TILE_NODES, TILE_NODES), np.float32)
    weight = arrays.zeros((tiles.used, SHEETS, TILE_NODES, TILE_NODES), np.float32)
    return HeightGrid(tiles, height, weight)


def add_returns(
    surface: HeightGrid,
    xyz_m: FloatArray,
    layer: NDArray[np.int8],
    half: NDArray[np.uint8],
    return_weight: NDArray[np.uint8],
) -> None:
    """Add returns to a surface; those without a tile are left out.

    Args:
        surface: gets the returns.
        xyz_m: (n, 3) against the local origin.
        layer: (n,) see :func:`layers`.
        half: (n,) 0 or 1.
        return_weight: (n,) weight, 255 for a whole return.
    """
    _add(surface, xyz_m, layer, half, return_weight)


def joined(parts: Sequence[HeightGrid]) -> HeightGrid:
    """One surface of the returns of several on the same tiles."""
    whole = parts[0]
    for part in parts[1:]:
        for tile in range(whole.tiles.used):
            weight = whole.weight[tile]
            height = whole.height_m[tile]
            weight += part.weight[tile]
            share = np.divide(part.weight[tile], weight, out=np.zeros_like(weight), where=weight > 0)
            height += share * (part.height_m[tile] - height)
    return whole


def heights(surface: HeightGrid, en_m: FloatArray, layer: NDArray[np.int8]) -> FloatArray:
    """(n,) heights of a surface, of both halves together; nan where it is not known.

    Args:
        surface: whose heights are sought.
        en_m: (n, 2) or (n, 3) where.
        layer: (n,) see :func:`layers`.
    """
    out = np.full(len(en_m), np.nan)
    _heights(surface, en_m, layer, out)
    return out


# Inlined by numba, as to pass tuples of arrays on would take longer than the parts.
@kernel_part(inline="always")
def cell_at(u, s):  # type: ignore[no-untyped-def]
    """Column and row of the node south-west of a place in steps of the nodes, and the place against that node."""
    x = int(np.floor(u))
    y = int(np.floor(s))
    return x, y, u - x, s - y


@kernel_part(inline="always")
def node_at(tiles, x, y):  # type: ignore[no-untyped-def]
    """Tile of the node in column `x`, row `y`, −1 where there is none; its row and column in the tile."""
    row = (y >> TILE_BITS) - tiles.south
    column = (x >> TILE_BITS) - tiles.west
    rows, columns = tiles.number.shape
    tile = -1
    if 0 <= row < rows and 0 <= column < columns:
        tile = tiles.number[row, column]
    return tile, y & TILE_NODES - 1, x & TILE_NODES - 1


@kernel_part(inline="always")
def nodes_round(tiles, x, y):  # type: ignore[no-untyped-def]
    """The four nodes round a cell, in the order of :class:`Corners`, and whether all are there."""
    sw = node_at(tiles, x, y)
    se = node_at(tiles, x + 1, y)
    nw = node_at(tiles, x, y + 1)
    ne = node_at(tiles, x + 1, y + 1)
    return (sw, se, nw, ne), min(min(sw[0], se[0]), min(nw[0], ne[0])) >= 0


@kernel_part(inline="always")
def corners(values, nodes, sheet):  # type: ignore[no-untyped-def]
    """Values (tiles, 4, 32, 32) of one sheet at four nodes."""
    sw, se, nw, ne = nodes
    return Corners(
        np.float64(values[sw[0], sheet, sw[1], sw[2]]),
        np.float64(values[se[0], sheet, se[1], se[2]]),
        np.float64(values[nw[0], sheet, nw[1], nw[2]]),
        np.float64(values[ne[0], sheet, ne[1], ne[2]]),
    )


@kernel_part(inline="always")
def corners_from_ne(values, nodes, sheet):  # type: ignore[no-untyped-def]
    """The same, loaded from the last node on: LLVM fuses that product with a sum whose factors were loaded earlier."""
    sw, se, nw, ne = nodes
    north_east = np.float64(values[ne[0], sheet, ne[1], ne[2]])
    return Corners(
        np.float64(values[sw[0], sheet, sw[1], sw[2]]),
        np.float64(values[se[0], sheet, se[1], se[2]]),
        np.float64(values[nw[0], sheet, nw[1], nw[2]]),
        north_east,
    )


@kernel_part(inline="always")
def least(values):  # type: ignore[no-untyped-def]
    """The least of the values at four nodes."""
    return min(min(values.sw, values.se), min(values.nw, values.ne))


@kernel()
def _touch(en_m, cell_m, west, south, used):  # type: ignore[no-untyped-def]
    """Mark the tiles of the four nodes round each point."""
    for i in range(len(en_m)):
        x = int(np.floor(en_m[i, 0] / cell_m))
        y = int(np.floor(en_m[i, 1] / cell_m))
        for a in range(2):
            for b in range(2):
                used[((y + b) >> TILE_BITS) - south, ((x + a) >> TILE_BITS) - west] = True


@kernel()
def _touch_around(path_m, aside_m, cell_m, west, south, used):  # type: ignore[no-untyped-def]
    """Mark the tiles of the four nodes round each point about each place of a path."""
    for i in range(len(path_m)):
        for k in range(len(aside_m)):
            x = int(np.floor((path_m[i, 0] + aside_m[k, 0]) / cell_m))
            y = int(np.floor((path_m[i, 1] + aside_m[k, 1]) / cell_m))
            for a in range(2):
                for b in range(2):
                    used[((y + b) >> TILE_BITS) - south, ((x + a) >> TILE_BITS) - west] = True


@kernel()
def _sweep(t_s, en_m, left, half_m, cell_m, west, south, number, first, last):  # type: ignore[no-untyped-def]
    steps = int(np.ceil(half_m / (0.4 * cell_m)))
    for i in range(len(t_s)):
        for k in range(-steps, steps + 1):
            share = half_m * k / steps
            x = int(np.floor((en_m[i, 0] + share * left[i, 0]) / cell_m))
            y = int(np.floor((en_m[i, 1] + share * left[i, 1]) / cell_m))
            tile = number[(y >> TILE_BITS) - south, (x >> TILE_BITS) - west]
            if tile < 0:
                continue
            a = y & TILE_NODES - 1
            b = x & TILE_NODES - 1
            first[tile, a, b] = min(first[tile, a, b], t_s[i])
            last[tile, a, b] = max(last[tile, a, b], t_s[i])


@kernel_part()
def _layers(t_s, en_m, guard_s, passage, out):  # type: ignore[no-untyped-def]
    tiles = passage.tiles
    for i in range(len(t_s)):
        x = int(np.floor(en_m[i, 0] / tiles.cell_m))
        y = int(np.floor(en_m[i, 1] / tiles.cell_m))
        tile, p, q = node_at(tiles, x, y)
        if tile < 0 or t_s[i] < passage.first_s[tile, p, q] - guard_s:
            out[i] = 0
        elif t_s[i] > passage.last_s[tile, p, q] + guard_s:
            out[i] = 1
        else:
            out[i] = -1


@kernel_part()
def _add(surface, xyz_m, layer, half, return_weight):  # type: ignore[no-untyped-def]
    cell_m = surface.tiles.cell_m
    weight = surface.weight
    height = surface.height_m
    for i in range(len(xyz_m)):
        if layer[i] < 0 or return_weight[i] == 0:
            continue
        whole = return_weight[i] / 255.0
        x, y, u, s = cell_at(xyz_m[i, 0] / cell_m, xyz_m[i, 1] / cell_m)
        sheet = 2 * layer[i] + half[i]
        for a in range(2):
            for b in range(2):
                tile, p, q = node_at(surface.tiles, x + a, y + b)
                share = whole * (u if a else 1.0 - u) * (s if b else 1.0 - s)
                if tile < 0 or share <= 0.0:
                    continue
                weight[tile, sheet, p, q] += share
                height[tile, sheet, p, q] += (
                    share / weight[tile, sheet, p, q] * (xyz_m[i, 2] - height[tile, sheet, p, q])
                )


@kernel_part()
def _heights(surface, en_m, layer, out):  # type: ignore[no-untyped-def]
    cell_m = surface.tiles.cell_m
    for i in range(len(en_m)):
        if layer[i] < 0:
            continue
        x, y, u, s = cell_at(en_m[i, 0] / cell_m, en_m[i, 1] / cell_m)
        whole = total = 0.0
        for a in range(2):
            for b in range(2):
                tile, p, q = node_at(surface.tiles, x + a, y + b)
                if tile < 0:
                    continue
                share = (u if a else 1.0 - u) * (s if b else 1.0 - s)
                for half in range(2):
                    weight = share * surface.weight[tile, 2 * layer[i] + half, p, q]
                    whole += weight
                    total += weight * surface.height_m[tile, 2 * layer[i] + half, p, q]
        if whole >= MIN_KNOWN_RETURNS:
            out[i] = total / whole
