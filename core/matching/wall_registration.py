"""Registration of all upright returns to walls: of short windows, or of the whole session."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from furrowmap.core.estimation.coarse import CoarseKnots
from furrowmap.core.estimation.registration import Patches, Registration, SliceSums, stored
from furrowmap.core.matching.placing import Placing
from furrowmap.core.matching.portions import Portion, blocks, in_threads, windows
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

LEAST_UPRIGHT: Final = 2_000
"""With fewer upright returns in a whole recording there is no wall."""
WALL_WINDOW_THIN: Final = 3
"""Windows are matched with every third upright return."""
COLUMN_REACH_M: Final = 8.0
"""Columns are laid out this closely, which is less than a tile."""


@dataclass(frozen=True)
class WallRegistration:
    """Upright returns registered to walls.

    Attributes:
        observation: what they add to the equations.
        scatter: of the residuals.
    """

    observation: Registration
    scatter: Scatter

    def registered(self) -> WallRegistration:
        """Without its patches, which are many and not needed once the equations are solved."""
        return replace(self, observation=replace(self.observation, references=()))


def register_wall_windows(placing: Placing, correlated: float, coarse: CoarseKnots | None) -> WallRegistration:
    """Each window against its own walls.

    Args:
        placing: of the iterate.
        correlated: how many returns share an error.
        coarse: coarse knots, with which the walls move; None for fixed walls.
    """

    def work(share: Sequence[Portion]) -> _Part:
        sums, scatter = SliceSums.empty(len(placing.knots)), Scatter()

        def found() -> Iterator[Patches]:
            nonlocal scatter
            for c, part in share:
                placed = placing.upright(c, part)
                walls = lines(add_upright(columns_over(placed.xyz_m), placed.xyz_m, placed.half))
                patches, more = register_walls(placed, walls, placing.poses(c, coarse), correlated, 0.5, sums)
                scatter = scatter.plus(more)
                if len(patches.place):
                    yield patches

        references = [[patches] for patches in stored(found())]
        return sums, scatter, references

    upright = placing.returns.upright
    portions = (
        windows(upright.t_s, placing.knots, WALL_WINDOW_THIN, placing.unused) if len(upright) >= LEAST_UPRIGHT else []
    )
    return _together(placing, in_threads(work, portions), coarse)


def register_wall_session(
    placing: Placing, correlated: float, coarse: CoarseKnots | None, thin: int
) -> WallRegistration:
    """Every `thin`-th return against the walls of the whole session; arguments as :func:`register_wall_windows`."""
    upright = placing.returns.upright
    portions = blocks(upright.t_s, placing.knots, thin, placing.unused) if len(upright) >= LEAST_UPRIGHT else []
    if not portions:
        return _together(placing, [], coarse)
    walls = _session_walls(placing, portions)

    def work(share: Sequence[Portion]) -> _Part:
        sums, scatter = SliceSums.empty(len(placing.knots)), Scatter()

        def found() -> Iterator[Patches]:
            nonlocal scatter
            for c, part in share:
                placed = placing.upright(c, part)
                patches, more = register_walls(placed, walls, placing.poses(c, coarse), correlated, 1.0, sums)
                scatter = scatter.plus(more)
                yield patches

        references = [stored(found())]
        return sums, scatter, references

    return _together(placing, in_threads(work, portions), coarse)


_Part = tuple[SliceSums, Scatter, list[list[Patches]]]


def _together(placing: Placing, parts: Sequence[_Part], coarse: CoarseKnots | None) -> WallRegistration:
    sums, scatter, references = SliceSums.empty(len(placing.knots)), Scatter(), []
    for more_sums, more_scatter, more in parts:
        sums.take(more_sums)
        scatter = scatter.plus(more_scatter)
        references += more
    return WallRegistration(Registration(sums, coarse is not None, references, WALL_PATCH_M), scatter)


def _session_walls(placing: Placing, portions: Sequence[Portion]) -> Lines:
    """Walls of a whole session."""
    path = placing.state.xyz_m[::20, :2]
    ring = np.arange(-MAX_WALL_RANGE_M, MAX_WALL_RANGE_M + COLUMN_REACH_M, COLUMN_REACH_M)
    aside = np.stack(np.meshgrid(ring, ring), axis=-1).reshape(-1, 2)
    passed = np.unique(np.round(path / COLUMN_REACH_M), axis=0) * COLUMN_REACH_M
    columns = columns_over((passed[:, None] + aside).reshape(-1, 2))
    for chain, part in portions:
        placed = placing.upright(chain, part)
        columns = add_upright(columns, placed.xyz_m, placed.half)
    return lines(columns)
