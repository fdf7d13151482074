"""Ground worked so far, as cells of a grid that grows: worked, worked again, missed."""

from collections import deque
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import distance_transform_edt

from furrowmap.core.runtime.arrays import FloatArray
from furrowmap.core.runtime.kernels import kernel

CELL_SIDE_M: Final = 0.1
TILE_CELLS: Final = 64
NOT_WORKED, WORKED, OVERLAP, MISSED = range(4)
"""States of a cell."""
REWORKED_M: Final = 1.5
"""A cell that the tool passes after so long a way was worked twice; less is jitter of the line."""

Tile = tuple[int, int]
"""Column and row of a tile, counted from the map's origin."""


class WorkedCells:
    """Takes the tool's line as it moves; gives the cells and what changed. Gaps below `width_m` were missed."""

    def __init__(self, width_m: float) -> None:
        self._reach = 0.5 * width_m / CELL_SIDE_M
        self._state: dict[Tile, NDArray[np.uint8]] = {}
        self._way_m: dict[Tile, NDArray[np.float32]] = {}
        self._doubtful: deque[Tile] = deque()
        self._touched: set[Tile] = set()
        self.count = np.zeros(4, np.int64)

    def area_m2(self, state: int) -> float:
        """Area in a state, in the map's plane; overlaps are worked as well."""
        cells = self.count[WORKED] + self.count[OVERLAP] if state == WORKED else self.count[state]
        return float(cells) * CELL_SIDE_M**2

    def tiles(self) -> dict[Tile, NDArray[np.uint8]]:
        """The states (64, 64) of all tiles, rows to the north."""
        return self._state

    def add_line(self, before: FloatArray, after: FloatArray, way_m: float) -> set[Tile]:
        """Work the ground between two places (2, 2) of the ends of the tool's line; the tiles that changed."""
        corners = np.array([before[0], before[1], after[1], after[0]]) / CELL_SIDE_M
        low = np.floor(corners.min(axis=0) / TILE_CELLS).astype(int)
        high = np.floor(corners.max(axis=0) / TILE_CELLS).astype(int)
        changed = set()
        for row in range(low[1], high[1] + 1):
            for column in range(low[0], high[0] + 1):
                tile = column, row
                if tile not in self._state:
                    self._state[tile] = np.zeros((TILE_CELLS, TILE_CELLS), np.uint8)
                if tile not in self._way_m:
                    self._way_m[tile] = np.full((TILE_CELLS, TILE_CELLS), -np.inf, np.float32)
                local = corners - np.array(tile) * TILE_CELLS
                if _sweep(self._state[tile], self._way_m[tile], local, way_m, self.count):
                    changed.add(tile)
        self._way_m = {tile: way for tile, way in self._way_m.items() if way.max() >= way_m - REWORKED_M}
        self._touched |= changed
        return changed

    def end_pass(self) -> None:
        """The tool was lifted: what lies between this pass and others may have been missed."""
        reach = 1 + int(self._reach // TILE_CELLS)
        near = range(-reach, reach + 1)
        self._doubtful.extend(
            {(x + i, y + j) for x, y in self._touched for i in near for j in near} - {*self._doubtful}
        )
        self._touched.clear()

    def look_for_misses(self) -> set[Tile]:
        """Look at one tile that may have missed ground; gives it if it changed."""
        if not self._doubtful:
            return set()
        tile = self._doubtful.popleft()
        reach = 1 + int(2.0 * self._reach // TILE_CELLS)
        around = [
            [self._state.get((tile[0] + i, tile[1] + j)) for i in range(-reach, reach + 1)]
            for j in range(-reach, reach + 1)
        ]
        empty = np.zeros((TILE_CELLS, TILE_CELLS), np.uint8)
        whole = np.block([[empty if one is None else one for one in row] for row in around])
        taken = (whole == WORKED) | (whole == OVERLAP)
        if not taken.any():
            return set()
        # A closing: all that a circle as wide as the tool cannot reach without touching worked ground.
        grown = distance_transform_edt(~taken) <= self._reach
        closed = distance_transform_edt(grown) > self._reach
        inner = slice(reach * TILE_CELLS, (reach + 1) * TILE_CELLS)
        missed = (closed & ~taken)[inner, inner]
        state = self._state.get(tile)
        if state is None:
            if not missed.any():
                return set()
            state = self._state[tile] = empty
        was = state == MISSED
        if (was == missed).all():
            return set()
        state[was] = NOT_WORKED
        state[missed] = MISSED
        self.count[MISSED] += int(missed.sum()) - int(was.sum())
        return {tile}


@kernel()
def _sweep(state, way, corners, now_m, count):  # type: ignore[no-untyped-def]
    """Work the cells whose centre lies in a convex quadrangle (4, 2), in cells of the tile."""
    changed = False
    rows, columns = state.shape
    south = max(0, int(np.floor(corners[:, 1].min())))
    north = min(rows - 1, int(np.floor(corners[:, 1].max())))
    west = max(0, int(np.floor(corners[:, 0].min())))
    east = min(columns - 1, int(np.floor(corners[:, 0].max())))
    for r in range(south, north + 1):
        for c in range(west, east + 1):
            left = right = 0
            for k in range(4):
                j = (k + 1) % 4
                turn = (corners[j, 0] - corners[k, 0]) * (r + 0.5 - corners[k, 1]) - (corners[j, 1] - corners[k, 1]) * (
                    c + 0.5 - corners[k, 0]
                )
                left += turn > 0.0
                right += turn < 0.0
            if left and right:
                continue
            old = state[r, c]
            if old == WORKED and now_m - way[r, c] > REWORKED_M:
                new = OVERLAP
            elif old in (OVERLAP, WORKED):
                new = int(old)
            else:
                new = WORKED
            way[r, c] = now_m
            if new != old:
                state[r, c] = new
                count[old] -= 1
                count[new] += 1
                changed = True
    return changed
