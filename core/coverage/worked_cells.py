"""Ground worked so far, as cells of a grid that grows: worked, worked again, missed, not seen.

All places of the tool's line are kept, by time: where it turns out later what the tool did, the ground is worked again
from them.
"""

from collections import deque
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import distance_transform_edt

from furrowmap.core.runtime.arrays import FloatArray
from furrowmap.core.runtime.kernels import kernel

CELL_SIDE_M: Final = 0.1
TILE_CELLS: Final = 64
NOT_WORKED, WORKED, OVERLAP, MISSED, NOT_SEEN = range(5)
"""States of a cell. What the tool did where it was not seen is unknown: it is neither worked nor missed."""
REWORKED_M: Final = 1.5
"""A cell that the tool passes after so long a way was worked twice; less is jitter of the line."""
FIRST_ROWS: Final = 1024
TILE_M: Final = CELL_SIDE_M * TILE_CELLS

Tile = tuple[int, int]
"""Column and row of a tile, counted from the map's origin."""


@dataclass(frozen=True)
class Swept:
    """Ground between places of the tool's line, n times.

    Attributes:
        t_s: (n,) UTC of the later place, increasing.
        corners_m: (n, 4, 2) easting and northing: right and left end before, left and right end after.
        way_m: (n,) driven forward until then.
        seen: (n,) whether the tool was seen to be down; else it is unknown what it did.
    """

    t_s: FloatArray
    corners_m: FloatArray
    way_m: FloatArray
    seen: NDArray[np.bool_]

    def __len__(self) -> int:
        return len(self.t_s)

    def __getitem__(self, rows: slice | NDArray[np.bool_]) -> "Swept":
        return Swept(self.t_s[rows], self.corners_m[rows], self.way_m[rows], self.seen[rows])

    @classmethod
    def none(cls) -> "Swept":
        """Nothing."""
        return cls(np.zeros(0), np.zeros((0, 4, 2)), np.zeros(0), np.zeros(0, np.bool_))

    @classmethod
    def joined(cls, parts: Iterable["Swept"]) -> "Swept":
        """Several, one after the other."""
        rows = list(parts)
        return cls(
            np.concatenate([part.t_s for part in rows]),
            np.concatenate([part.corners_m for part in rows]),
            np.concatenate([part.way_m for part in rows]),
            np.concatenate([part.seen for part in rows]),
        )

    def tiles(self) -> set[Tile]:
        """The tiles that it lies on."""
        low = np.floor(self.corners_m.min(axis=1, initial=np.inf) / TILE_M).astype(int)
        high = np.floor(self.corners_m.max(axis=1, initial=-np.inf) / TILE_M).astype(int)
        corners = np.unique(np.hstack([low, high]), axis=0).tolist()
        return {
            (x, y)
            for west, south, east, north in corners
            for x in range(west, east + 1)
            for y in range(south, north + 1)
        }


class WorkedCells:
    """Takes the tool's line as it moves; gives the cells and what changed. Gaps below `width_m` were missed."""

    def __init__(self, width_m: float) -> None:
        self._reach = 0.5 * width_m / CELL_SIDE_M
        self._state: dict[Tile, NDArray[np.uint8]] = {}
        self._way_m: dict[Tile, NDArray[np.float32]] = {}
        self._doubtful: deque[Tile] = deque()
        self._touched: set[Tile] = set()
        self._room = _room(FIRST_ROWS)
        self._rows = 0
        self._more_way_m = 0.0
        self.count = np.zeros(5, np.int64)

    @property
    def swept(self) -> Swept:
        """All ground between places of the tool's line, by time."""
        return self._room[: self._rows]

    def area_m2(self, state: int) -> float:
        """Area in a state, in the map's plane; overlaps are worked as well."""
        cells = self.count[WORKED] + self.count[OVERLAP] if state == WORKED else self.count[state]
        return float(cells) * CELL_SIDE_M**2

    def tiles(self) -> dict[Tile, NDArray[np.uint8]]:
        """The states (64, 64) of all tiles, rows to the north."""
        return self._state

    def add_line(
        self, before: FloatArray, after: FloatArray, way_m: float, t_s: float = 0.0, *, unseen: bool = False
    ) -> set[Tile]:
        """Work the ground between two places (2, 2) of the ends of the tool's line; the tiles that changed.

        Args:
            way_m: driven forward until then.
            t_s: UTC of the later place, not before that of the line before.
            unseen: whether it is unknown what the tool did; else it was seen to be down.
        """
        way_m += self._more_way_m
        corners = np.array([before[0], before[1], after[1], after[0]])
        if self._rows == len(self._room):
            self._room = Swept.joined([self._room, _room(self._rows)])
        self._room.t_s[self._rows] = t_s
        self._room.corners_m[self._rows] = corners
        self._room.way_m[self._rows] = way_m
        self._room.seen[self._rows] = not unseen
        self._rows += 1
        changed = set()
        row = self.swept[slice(self._rows - 1, self._rows)]
        for tile in row.tiles():
            if self._sweep(tile, row):
                changed.add(tile)
        self._way_m = {tile: way for tile, way in self._way_m.items() if way.max() >= way_m - REWORKED_M}
        self._touched |= changed
        return changed

    def replace(self, begin_s: float, end_s: float, found: Swept) -> set[Tile]:
        """Work the ground of a time again, after `begin_s` up to `end_s`; the tiles that may have changed.

        Args:
            found: of that time, with ways that count from any place.
        """
        swept = self.swept
        first = int(np.searchsorted(swept.t_s, begin_s, side="right"))
        behind = int(np.searchsorted(swept.t_s, end_s, side="right"))
        before = swept[slice(0, first)]
        after = swept[slice(behind, len(swept))]
        # The way of what was found goes on from what was before, and that of all later grows if it is longer.
        from_m = float(before.way_m[-1]) if len(before) else -np.inf
        until_m = float(after.way_m[0]) if len(after) else np.inf
        if len(found):
            way_m = found.way_m - found.way_m[0]
            if not np.isfinite(from_m):
                from_m = until_m - float(way_m[-1]) if np.isfinite(until_m) else 0.0
            more_m = max(0.0, from_m + float(way_m[-1]) - until_m)
            found = Swept(found.t_s, found.corners_m, way_m + from_m, found.seen)
            after = Swept(after.t_s, after.corners_m, after.way_m + more_m, after.seen)
            self._more_way_m += more_m
        changed = found.tiles() | swept[slice(first, behind)].tiles()
        self._room = Swept.joined([before, found, after, _room(FIRST_ROWS)])
        self._rows = len(before) + len(found) + len(after)
        self._work_again(changed)
        self._touched |= changed
        self.end_pass()
        return changed

    def _work_again(self, tiles: set[Tile]) -> None:
        """Make the cells of some tiles anew, from all places of the line."""
        swept = self.swept
        low_m = swept.corners_m.min(axis=1, initial=np.inf)
        high_m = swept.corners_m.max(axis=1, initial=-np.inf)
        for tile in tiles:
            state = self._state.get(tile)
            if state is not None:
                self.count -= np.bincount(state.ravel(), minlength=5)
                self.count[NOT_WORKED] += state.size
                state[:] = NOT_WORKED
            self._way_m.pop(tile, None)
            corner_m = TILE_M * np.array(tile)
            near = ((low_m < corner_m + TILE_M) & (high_m > corner_m)).all(axis=1)
            self._sweep(tile, swept[near])

    def _sweep(self, tile: Tile, swept: Swept) -> bool:
        """Work the cells of a tile; whether any changed."""
        if tile not in self._state:
            self._state[tile] = np.zeros((TILE_CELLS, TILE_CELLS), np.uint8)
        if tile not in self._way_m:
            self._way_m[tile] = np.full((TILE_CELLS, TILE_CELLS), -np.inf, np.float32)
        local = np.ascontiguousarray(swept.corners_m / CELL_SIDE_M - np.array(tile) * TILE_CELLS)
        way_m = np.ascontiguousarray(swept.way_m)
        seen = np.ascontiguousarray(swept.seen)
        return bool(_sweep(self._state[tile], self._way_m[tile], local, way_m, seen, self.count))

    def end_pass(self) -> None:
        """The tool was lifted: what lies between this pass and others may have been missed."""
        reach = 1 + int(self._reach // TILE_CELLS)
        near = range(-reach, reach + 1)
        self._doubtful.extend(
            {(x + i, y + j) for x, y in self._touched for i in near for j in near} - {*self._doubtful}
        )
        self._touched.clear()

    def finish(self) -> set[Tile]:
        """Look at all that may have missed ground; the tiles that changed."""
        self.end_pass()
        changed = set[Tile]()
        while self._doubtful:
            changed |= self.look_for_misses()
        return changed

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
        missed = (closed & ~taken & (whole != NOT_SEEN))[inner, inner]
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


def _room(rows: int) -> Swept:
    """Place for so many."""
    return Swept(np.zeros(rows), np.zeros((rows, 4, 2)), np.zeros(rows), np.zeros(rows, np.bool_))


@kernel()
def _sweep(state, way, strips, way_m, seen, count):  # type: ignore[no-untyped-def]
    """Work the cells whose centre lies in convex quadrangles (n, 4, 2), in cells of the tile."""
    changed = False
    rows, columns = state.shape
    for n in range(len(strips)):
        corners = strips[n]
        now_m = way_m[n]
        south = max(0, int(np.floor(corners[:, 1].min())))
        north = min(rows - 1, int(np.floor(corners[:, 1].max())))
        west = max(0, int(np.floor(corners[:, 0].min())))
        east = min(columns - 1, int(np.floor(corners[:, 0].max())))
        for r in range(south, north + 1):
            for c in range(west, east + 1):
                left = right = 0
                for k in range(4):
                    j = (k + 1) % 4
                    turn = (corners[j, 0] - corners[k, 0]) * (r + 0.5 - corners[k, 1]) - (
                        corners[j, 1] - corners[k, 1]
                    ) * (c + 0.5 - corners[k, 0])
                    left += turn > 0.0
                    right += turn < 0.0
                if left and right:
                    continue
                old = state[r, c]
                if not seen[n]:
                    new = int(old) if old in (WORKED, OVERLAP) else NOT_SEEN
                elif old == WORKED and now_m - way[r, c] > REWORKED_M:
                    new = OVERLAP
                elif old in (OVERLAP, WORKED):
                    new = int(old)
                else:
                    new = WORKED
                if seen[n]:
                    way[r, c] = now_m
                if new != old:
                    state[r, c] = new
                    count[old] -= 1
                    count[new] += 1
                    changed = True
    return changed
