"""Surfaces of a run: the ground after and before the work, the change, and the soil moved by each pass."""

import math
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final, Self

import numpy as np
from numpy.typing import NDArray

from furrowmap.core.coverage.field_work import FieldWork
from furrowmap.core.coverage.strip_outlines import Coverage, coverage
from furrowmap.core.coverage.sweep import sweeps
from furrowmap.core.coverage.tool_edges import ToolEdges
from furrowmap.core.pointclouds.placed_scans import PlacedScan
from furrowmap.core.pointclouds.spooled_clouds import SpooledClouds
from furrowmap.core.runtime import arrays
from furrowmap.core.runtime.arrays import FloatArray
from furrowmap.core.runtime.background import in_turn
from furrowmap.core.runtime.kernels import kernel
from furrowmap.core.runtime.record_spool import Square
from furrowmap.core.runtime.settings import threads
from furrowmap.core.surfaces.grid import Grid, Surface
from furrowmap.core.surfaces.mean_change import ChangeSums, MeanChange
from furrowmap.core.surfaces.passage import LineTrack, Passages
from furrowmap.core.surfaces.spool import PointSpool, TilePoints
from furrowmap.core.surfaces.statistic import MEDIAN, Statistic, cell_surface
from furrowmap.core.surfaces.visits import block_differences
from furrowmap.core.values.session import Implement
from furrowmap.core.values.time_span import Interval
from furrowmap.core.values.trajectory import Trajectory

FIELD_CELL_M: Final = 0.05
MAX_REACH_M: Final = 15.0
"""Farther returns are too sparse and more than a centimetre too high, every twentieth by more than five."""
BESIDE_M: Final = 0.5
"""Width beside the line of the tool in which soil may be thrown."""
SETTLE_S: Final = 0.2
"""Time around a passage in which soil is still moving."""
CLEAR_M: Final = 0.3
"""Returns higher above worked ground are dust or the machine."""
BLOCK: Final = 8
"""Cells a side of the blocks whose low quantile is the soil."""
MAX_SOIL_POINTS: Final = 100_000
"""Returns of a tile used for that, a hundred a block."""
LOWER: Final = Statistic.parse("p10")
TILES_AHEAD: Final = 4


@dataclass(frozen=True)
class FieldTile:
    """The surfaces of one tile; all of its grid.

    Attributes:
        after: the ground at the end, from returns after the last passage of the tool, or all where it did not pass.
        before: the ground before its first passage likewise.
        change_m: float32 after less before, where seen both times around a passage; nan elsewhere.
        change_error_m: float32 standard error of it.
        number: int32 last pass; 0 where none.
        swaths_m: float32 by blocks of cells, height of a swath less the one before without a passage between; nan
            elsewhere.
        coverage: by the strips of a flight; None without strips.
        across: changes across the tool's line (:meth:`~furrowmap.core.coverage.tool_edges.ToolEdges.changes`); None
            where they are not asked for, or the tool did not pass.
    """

    grid: Grid
    after: Surface
    before: Surface
    change_m: NDArray[np.float32]
    change_error_m: NDArray[np.float32]
    number: NDArray[np.int32]
    swaths_m: NDArray[np.float32]
    coverage: Coverage | None = None
    across: FloatArray | None = None


class FieldPoints:
    """Collects the ground points of a run as far as `reach_m` and computes surfaces: a context manager."""

    def __init__(self, folder: Path, cell_m: float = FIELD_CELL_M, reach_m: float = MAX_REACH_M) -> None:
        self._folder = folder
        self._cell_m = cell_m
        self._reach_m = reach_m
        self._spool: PointSpool | None = None
        self._origin_m = (0.0, 0.0, 0.0)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: Any) -> None:
        if self._spool is not None:
            self._spool.__exit__(*error)

    def begin(self, origin_m: tuple[float, float, float]) -> None:
        """Set the offset of the coordinates, before the first scan."""
        self._spool = PointSpool(self._cell_m, base_m=origin_m[2], folder=self._folder)
        self._origin_m = origin_m

    def add(self, placed: PlacedScan) -> None:
        """Add the points of some scans that may be land and are near enough."""
        assert self._spool is not None
        near = within(np.ascontiguousarray(placed.scan.xyz_m, np.float32), placed.kept, self._reach_m)
        self._spool.add(placed.xyz_m, placed.scan.t_s, near, self._origin_m)

    @property
    def grid(self) -> Grid | None:
        """The grid that covers all tiles; None without points."""
        return self._spool.grid if self._spool is not None else None

    @property
    def spooled(self) -> SpooledClouds:
        """The points as those of a cloud without classes."""
        assert self._spool is not None
        return SpooledClouds(self._spool, self._spool, count=0, ground_count=0, span_s=None, notices=())

    @property
    def tile_count(self) -> int:
        """How many tiles there are."""
        return len(self._spool.tiles) if self._spool is not None else 0

    def tiles(
        self,
        passages: Passages,
        statistic: Statistic = MEDIAN,
        strips: Sequence[Interval] = (),
        edges: ToolEdges | None = None,
    ) -> Iterator[FieldTile]:
        """The surfaces, tile by tile, computed in half of the threads: beside them the cloud is compressed.

        A tile of millions of points takes 17 bytes for each of them. `passages` are of the tool's line; `strips` of a
        flight are counted; `edges` sum up what changes across the line.
        """
        spool = self._spool
        if spool is None:
            return

        def made(key: Square) -> FieldTile:
            return field_tile(spool.tile(key), passages, statistic, strips, edges)

        with ThreadPoolExecutor(max(1, threads() // 2)) as pool:
            for number, tile in enumerate(in_turn(pool, made, spool.tiles, TILES_AHEAD), start=1):
                yield tile
                if number % TILES_AHEAD == 0:
                    arrays.release()  # what is free between arrays of so different lengths grows otherwise


def tool_passages(trajectory: Trajectory, work: FieldWork, implement: Implement | None) -> Passages:
    """The passages of the tool's line over the ground that it worked; none where they are not known."""
    if implement is None or work.ground is None:
        return Passages([])
    return Passages(
        LineTrack(number, sweep.t_s, sweep.middle_m[:, :2], sweep.half_m)
        for number, when in enumerate(work.passes, start=1)
        for sweep in sweeps(trajectory, when, implement)
    )


def field_tile(
    points: TilePoints,
    passages: Passages,
    statistic: Statistic,
    strips: Sequence[Interval] = (),
    edges: ToolEdges | None = None,
) -> FieldTile:
    """The surfaces of a tile."""
    grid = points.grid
    covered = coverage(points, strips) if strips else None
    near = passages.over(grid, BESIDE_M)
    if not near.passed.any():
        surface = points.surface(statistic)
        nothing = np.full(grid.shape, np.nan, np.float32)
        return FieldTile(grid, surface, surface, nothing, nothing, near.number, block_differences(points), covered)
    low = _low(points, near.passed)
    tool = passages.over(grid)
    limits_s = [
        (passage_s - points.begin_s).ravel().astype(np.float32)
        for passage_s in (tool.first_s, tool.last_s, near.first_s, near.last_s)
    ]
    after, before, both = before_and_after(points.cell, points.t_s, low, *limits_s, np.float32(SETTLE_S))
    later = points.surface(statistic, after)
    swaths = block_differences(points, after)
    earlier = points.surface(statistic, before)
    compared = both.reshape(grid.shape)
    change = np.where(compared, later.height_m - earlier.height_m, np.float32(np.nan))
    error = np.where(compared, np.hypot(later.standard_error_m, earlier.standard_error_m), np.float32(np.nan))
    across = edges.changes(points, low) if edges is not None else None
    return FieldTile(grid, later, earlier, change, error, tool.number, swaths, covered, across)


def _low(points: TilePoints, where: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Which points (n,) are not high above the soil, within `where`; elsewhere all."""
    grid = points.grid
    rows = grid.rows // BLOCK
    columns = grid.columns // BLOCK
    blocks = Grid(grid.cell_m * BLOCK, 0, 0, (rows, columns))
    row, column = np.divmod(np.arange(grid.rows * grid.columns), grid.columns)
    block = (row // BLOCK * columns + column // BLOCK).astype(np.uint16)
    some = slice(None, None, max(1, len(points.cell) // MAX_SOIL_POINTS))
    heights = np.ascontiguousarray(points.height_m[some])
    low = cell_surface(blocks, block[points.cell[some]], heights, 0.0, LOWER).height_m
    around = np.lib.stride_tricks.sliding_window_view(np.pad(low, 1, constant_values=np.nan), (3, 3))
    known = np.isfinite(around).any(axis=(2, 3))
    soil = np.full(low.shape, np.nan, np.float32)
    soil[known] = np.nanmedian(around[known].reshape(-1, 9), axis=1)
    limit = np.where(where.ravel(), soil.ravel()[block] + np.float32(CLEAR_M), np.float32(np.inf))
    kept: NDArray[np.bool_] = points.height_m <= limit[points.cell]
    return kept


@dataclass(frozen=True)
class SoilMoved:
    """What the work changed.

    Attributes:
        passes: by number, the ground that each pass worked last.
        beside_m2, beside_m: ground compared beside the passes, and its mean change: a measure of the error, and in the
            standard deviations.
    """

    worked: MeanChange
    passes: dict[int, MeanChange]
    beside_m2: float
    beside_m: float


class SoilSums(ChangeSums):
    """Sums up the change over tiles, by pass."""

    def add_tile(self, tile: FieldTile) -> None:
        """Take a tile into account."""
        before = tile.before
        spread_m = np.hypot(tile.after.spread_m, tile.before.spread_m)
        self.add(tile.number, tile.change_m, tile.change_error_m, spread_m, before.height_m, before.count)

    def moved(self, cell_m2: float) -> SoilMoved | None:
        """What was moved; None where nothing was worked."""
        if not self.sums[1:, 0].any():
            return None
        _, count, total = self.sums[0, :3].tolist()
        beside_m = total / count if count else math.nan

        def changed(*numbers: int) -> MeanChange:
            found = self.mean(cell_m2, numbers)
            return replace(found, sigma_m=math.hypot(found.sigma_m, beside_m if count else 0.0))

        numbers = range(1, len(self.sums))
        return SoilMoved(changed(*numbers), {k: changed(k) for k in numbers}, count * cell_m2, beside_m)


@kernel()
def within(xyz_m, kept, reach_m):  # type: ignore[no-untyped-def]
    """Which of the kept points (n,) lie within reach of the sensor, in whose frame they are."""
    near = np.empty(len(xyz_m), np.bool_)
    for i in range(len(xyz_m)):
        x = xyz_m[i, 0]
        y = xyz_m[i, 1]
        z = xyz_m[i, 2]
        near[i] = kept[i] and x * x + y * y + z * z < reach_m * reach_m
    return near


@kernel()
def before_and_after(cell, t_s, low, tool_first_s, tool_last_s, near_first_s, near_last_s, settle_s):  # type: ignore[no-untyped-def]
    """Which of the points `low` are after and which before the work; and which cells have both (cells,).

    Soil may land beside the tool, so returns after it passed beside a cell are preferred; without any, those after it
    passed over the cell, or all where it did not. Likewise before.
    """
    cells = len(tool_first_s)
    later = np.zeros(cells, np.bool_)
    earlier = np.zeros(cells, np.bool_)
    for i in range(len(cell)):
        k = cell[i]
        later[k] |= low[i] and t_s[i] > near_last_s[k] + settle_s
        earlier[k] |= low[i] and t_s[i] < near_first_s[k] - settle_s
    from_s = np.empty(cells, np.float32)
    until_s = np.empty(cells, np.float32)
    for k in range(cells):
        from_s[k] = near_last_s[k] if later[k] else tool_last_s[k]
        until_s[k] = near_first_s[k] if earlier[k] else tool_first_s[k]
    after = np.empty(len(cell), np.bool_)
    before = np.empty(len(cell), np.bool_)
    seen_after = np.zeros(cells, np.bool_)
    seen_before = np.zeros(cells, np.bool_)
    for i in range(len(cell)):
        k = cell[i]
        after[i] = low[i] and t_s[i] > from_s[k] + settle_s
        before[i] = low[i] and t_s[i] < until_s[k] - settle_s
        seen_after[k] |= after[i] and np.isfinite(from_s[k])
        seen_before[k] |= before[i] and np.isfinite(until_s[k])
    return after, before, seen_after & seen_before
