"""Registration of all returns to ground and walls: of short windows, or of the whole session."""

from collections.abc import Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from furrowmap.core.adjustment.banded import NormalEquations
from furrowmap.core.adjustment.coarse import CoarseKnots
from furrowmap.core.adjustment.registered_returns import Patches, PatchStore, Registration, SliceSums, free_patches
from furrowmap.core.matching.ground_registration import GroundSums, Relief, register_ground
from furrowmap.core.matching.height_grid import HeightGrid, add_returns, empty_surface, joined, tiles_around, tiles_over
from furrowmap.core.matching.placing import Placing
from furrowmap.core.matching.portions import THREADS, Portion, blocks, shares, windows
from furrowmap.core.matching.returns import MAX_GROUND_RANGE_M
from furrowmap.core.matching.walls import (
    MAX_WALL_RANGE_M,
    WALL_PATCH_M,
    Lines,
    Scatter,
    add_upright,
    columns_over,
    lines,
    register_walls,
)

WINDOW_CELL_M: Final = 0.3
WINDOW_PATCH_M: Final = 1.0
SESSION_PATCH_M: Final = 2.0
MIN_UPRIGHT_RETURNS: Final = 2_000
"""With fewer upright returns in a whole recording there is no wall."""
WALL_WINDOW_THIN: Final = 3
"""Windows are matched with every third upright return."""
COLUMN_REACH_M: Final = 8.0
"""Columns are laid out this closely, which is less than a tile."""
_WallPart = tuple[SliceSums, Scatter, list[list[Patches]]]


@dataclass(frozen=True)
class GroundRegistration:
    """Returns registered to the ground: what they add to the equations, and sums over the returns."""

    observation: Registration
    sums: GroundSums


def register_windows(
    placing: Placing, relief: Relief, coarse: CoarseKnots | None, centre_m: np.ndarray, width: int, thin: int
) -> GroundRegistration:
    """Every `thin`-th return of each window against the window's own ground.

    Args:
        relief: reliability of slopes.
        coarse: coarse knots, with which the ground moves; None for fixed ground.
        centre_m: (count, 3) places of the coarse knots.
        width: of the band of their equations.
    """
    size = placing.state.layout.size

    def work(share: Iterable[Portion]) -> tuple[GroundSums, NormalEquations]:
        sums, freed = GroundSums.empty(len(placing.knots)), NormalEquations(len(centre_m) * size, max(width, 1))
        for c, part in share:
            placed = placing.ground(c, part)
            surface = empty_surface(tiles_over(placed.xyz_m, WINDOW_CELL_M))
            add_returns(surface, placed.xyz_m, placed.layer, placed.half, placed.weight)
            patches = register_ground(placed, surface, placing.poses(c, coarse), relief, 0.5, sums)
            if coarse is not None:
                free_patches(freed, [patches], WINDOW_PATCH_M, centre_m)
        return sums, freed

    portions = windows(placing.returns.t_s, placing.knots, thin, placing.unused)
    with ThreadPoolExecutor(THREADS) as pool:
        found = list(pool.map(work, shares(portions)))
    sums = _sum_ground([s for s, _ in found])
    return GroundRegistration(
        Registration(sums.slices, coarse is not None, eliminated=[freed for _, freed in found]), sums
    )


def register_to_surface(
    placing: Placing, portions: Sequence[Portion], surface: HeightGrid, relief: Relief, coarse: CoarseKnots | None
) -> GroundRegistration:
    """Portions of the returns against a surface; arguments as :func:`register_windows`."""

    def work(share: Iterable[Portion]) -> tuple[GroundSums, list[Patches]]:
        sums = GroundSums.empty(len(placing.knots))
        patches = PatchStore()
        for c, part in share:
            placed = placing.ground(c, part)
            patches.add(register_ground(placed, surface, placing.poses(c, coarse), relief, 1.0, sums))
        return sums, patches.all()

    with ThreadPoolExecutor(THREADS) as pool:
        found = list(pool.map(work, shares(portions)))
    sums = _sum_ground([s for s, _ in found])
    patches = [p for _, some in found for p in some]
    return GroundRegistration(Registration(sums.slices, coarse is not None, [patches], SESSION_PATCH_M), sums)


def session_surface(placing: Placing, portions: Sequence[Portion], cell_m: float) -> HeightGrid:
    """The ground of all portions."""
    path = placing.state.xyz_m[::20, :2]
    ring = np.arange(-MAX_GROUND_RANGE_M, MAX_GROUND_RANGE_M + 0.1, 2.0)
    aside = np.stack(np.meshgrid(ring, ring), axis=-1).reshape(-1, 2)
    tiles = tiles_around(path, aside[np.hypot(*aside.T) < MAX_GROUND_RANGE_M + 2.0], cell_m)

    def work(share: Iterable[Portion]) -> HeightGrid:
        surface = empty_surface(tiles)
        for c, part in share:
            placed = placing.ground(c, part)
            add_returns(surface, placed.xyz_m, placed.layer, placed.half, placed.weight)
        return surface

    with ThreadPoolExecutor(THREADS) as pool:
        return joined(list(pool.map(work, shares(portions))))


@dataclass(frozen=True)
class WallRegistration:
    """Upright returns registered to walls.

    Attributes:
        observation: what they add to the equations.
        scatter: of the residuals.
    """

    observation: Registration
    scatter: Scatter

    def registered(self) -> "WallRegistration":
        """Without its patches, which are many and not needed once the equations are solved."""
        return replace(self, observation=replace(self.observation, references=()))


def register_wall_windows(placing: Placing, correlated: float, coarse: CoarseKnots | None) -> WallRegistration:
    """Each window against its own walls.

    Args:
        correlated: how many returns share an error.
        coarse: coarse knots, with which the walls move; None for fixed walls.
    """
    portions = windows(placing.returns.upright.t_s, placing.knots, WALL_WINDOW_THIN, placing.unused)
    return register_to_walls(placing, portions, None, correlated, coarse)


def register_wall_session(
    placing: Placing, correlated: float, coarse: CoarseKnots | None, thin: int
) -> WallRegistration:
    """Every `thin`-th return against the walls of the whole session; arguments as :func:`register_wall_windows`."""
    portions = blocks(placing.returns.upright.t_s, placing.knots, thin, placing.unused)
    if len(placing.returns.upright) < MIN_UPRIGHT_RETURNS:
        return register_to_walls(placing, [], None, correlated, coarse)
    return register_to_walls(placing, portions, session_walls(placing, portions), correlated, coarse)


def session_walls(placing: Placing, portions: Sequence[Portion]) -> Lines:
    """The walls of all portions of upright returns."""
    ring = np.arange(-MAX_WALL_RANGE_M, MAX_WALL_RANGE_M + COLUMN_REACH_M, COLUMN_REACH_M)
    aside = np.stack(np.meshgrid(ring, ring), axis=-1).reshape(-1, 2)
    passed = np.unique(np.round(placing.state.xyz_m[::20, :2] / COLUMN_REACH_M), axis=0) * COLUMN_REACH_M
    columns = columns_over((passed[:, None] + aside).reshape(-1, 2))
    for chain, part in portions:
        placed = placing.upright(chain, part)
        columns = add_upright(columns, placed.xyz_m, placed.half)
    return lines(columns)


def register_to_walls(
    placing: Placing, portions: Sequence[Portion], whole: Lines | None, correlated: float, coarse: CoarseKnots | None
) -> WallRegistration:
    """Upright returns against the walls of the whole session, or each portion against its own walls at half weight."""

    def work(share: Iterable[Portion]) -> tuple[SliceSums, Scatter, list[list[Patches]]]:
        sums, scatter = SliceSums.empty(len(placing.knots)), Scatter()
        store = PatchStore()
        for c, part in share:
            placed = placing.upright(c, part)
            walls = whole
            factor = 1.0
            if walls is None:
                walls = lines(add_upright(columns_over(placed.xyz_m), placed.xyz_m, placed.half))
                factor = 0.5
            patches, more = register_walls(placed, walls, placing.poses(c, coarse), correlated, factor, sums)
            scatter = scatter.plus(more)
            if whole is not None or len(patches.place):
                store.add(patches)
        patches_of_all = store.all()
        return sums, scatter, [patches_of_all] if whole is not None else [[one] for one in patches_of_all]

    sums, scatter, references = SliceSums.empty(len(placing.knots)), Scatter(), []
    if len(placing.returns.upright) >= MIN_UPRIGHT_RETURNS:
        with ThreadPoolExecutor(THREADS) as pool:
            parts = list(pool.map(work, shares(portions)))
        for more_sums, more_scatter, more in parts:
            sums.take(more_sums)
            scatter = scatter.plus(more_scatter)
            references += more
    return WallRegistration(Registration(sums, coarse is not None, references, WALL_PATCH_M), scatter)


def _sum_ground(parts: Sequence[GroundSums]) -> GroundSums:
    whole = parts[0]
    for part in parts[1:]:
        whole.take(part)
    return whole
