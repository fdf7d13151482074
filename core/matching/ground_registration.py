"""Registration of all returns to the ground: of short windows, or of the whole session."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from furrowmap.core.estimation.banded import NormalEquations
from furrowmap.core.estimation.coarse import CoarseKnots
from furrowmap.core.estimation.registration import Patches, Registration, free_patches, stored
from furrowmap.core.matching.ground import GroundSums, Relief, register_ground
from furrowmap.core.matching.placing import Placing
from furrowmap.core.matching.portions import Portion, blocks, in_threads, windows
from furrowmap.core.matching.returns import MAX_GROUND_RANGE_M
from furrowmap.core.matching.surface import HeightGrid, add_returns, empty_surface, joined, tiles_around, tiles_over

WINDOW_CELL_M: Final = 0.3
GROUND_WINDOW_THIN: Final = 4
"""Windows are matched with every fourth return."""
WINDOW_PATCH_M: Final = 1.0
SESSION_PATCH_M: Final = 2.0


@dataclass(frozen=True)
class GroundRegistration:
    """Returns registered to the ground.

    Attributes:
        observation: what they add to the equations.
        sums: over the returns.
    """

    observation: Registration
    sums: GroundSums


def register_windows(
    placing: Placing, relief: Relief, coarse: CoarseKnots | None, centre_m: np.ndarray, width: int
) -> GroundRegistration:
    """Each window against its own ground.

    Args:
        placing: of the iterate.
        relief: reliability of slopes.
        coarse: coarse knots, with which the ground moves; None for fixed ground.
        centre_m: (count, 3) places of the coarse knots.
        width: of the band of their equations.
    """
    size = placing.state.layout.size

    def work(share: Sequence[Portion]) -> tuple[GroundSums, NormalEquations]:
        sums, freed = GroundSums.of(len(placing.knots)), NormalEquations(len(centre_m) * size, max(width, 1))
        for c, part in share:
            placed = placing.ground(c, part)
            surface = empty_surface(tiles_over(placed.xyz_m, WINDOW_CELL_M))
            add_returns(surface, placed.xyz_m, placed.layer, placed.half, placed.weight)
            patches = register_ground(placed, surface, placing.poses(c, coarse), relief, 0.5, sums)
            if coarse is not None:
                free_patches(freed, [patches], WINDOW_PATCH_M, centre_m)
        return sums, freed

    found = in_threads(work, windows(placing.returns.t_s, placing.knots, GROUND_WINDOW_THIN, placing.unused))
    sums = _together([s for s, _ in found])
    return GroundRegistration(
        Registration(sums.slices, coarse is not None, eliminated=[freed for _, freed in found]), sums
    )


def register_session(
    placing: Placing, relief: Relief, coarse: CoarseKnots | None, cell_m: float, thin: int
) -> GroundRegistration:
    """Every `thin`-th return against the ground of the whole session; arguments as :func:`register_windows`."""
    portions = blocks(placing.returns.t_s, placing.knots, thin, placing.unused)
    surface = session_surface(placing, portions, cell_m)

    def work(share: Sequence[Portion]) -> tuple[GroundSums, list[Patches]]:
        sums = GroundSums.of(len(placing.knots))
        return sums, stored(
            register_ground(placing.ground(c, part), surface, placing.poses(c, coarse), relief, 1.0, sums)
            for c, part in share
        )

    found = in_threads(work, portions)
    sums = _together([s for s, _ in found])
    patches = [p for _, some in found for p in some]
    return GroundRegistration(Registration(sums.slices, coarse is not None, [patches], SESSION_PATCH_M), sums)


def session_surface(placing: Placing, portions: Sequence[Portion], cell_m: float) -> HeightGrid:
    """The ground of all portions."""
    path = placing.state.xyz_m[::20, :2]
    ring = np.arange(-MAX_GROUND_RANGE_M, MAX_GROUND_RANGE_M + 0.1, 2.0)
    aside = np.stack(np.meshgrid(ring, ring), axis=-1).reshape(-1, 2)
    tiles = tiles_around(path, aside[np.hypot(*aside.T) < MAX_GROUND_RANGE_M + 2.0], cell_m)

    def work(share: Sequence[Portion]) -> HeightGrid:
        surface = empty_surface(tiles)
        for c, part in share:
            placed = placing.ground(c, part)
            add_returns(surface, placed.xyz_m, placed.layer, placed.half, placed.weight)
        return surface

    return joined(in_threads(work, portions))


def _together(parts: Sequence[GroundSums]) -> GroundSums:
    whole = parts[0]
    for part in parts[1:]:
        whole.take(part)
    return whole
