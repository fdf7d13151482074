"""What walls say in one step of matching, in short windows or over the whole session."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Final

import numpy as np
from numpy.typing import NDArray

from furrowmap.core.estimation.knots import Knots, State
from furrowmap.core.matching.agreement import CoarseGrid, Patches, Sums
from furrowmap.core.matching.coarse import CoarseKnots
from furrowmap.core.matching.walls import (
    FAR_M,
    Columns,
    Lines,
    Scatter,
    add_upright,
    agree_upright,
    columns_over,
    lines,
    wall_grid,
)

FloatArray = NDArray[np.float64]

LEAST_UPRIGHT: Final = 2_000
"""With fewer returns of what stands in a whole recording there is no wall."""
AROUND_M: Final = 8.0
"""Columns are laid out this closely, which is less than a tile."""


@dataclass(frozen=True)
class PlacedUpright:
    """Returns of what stands in a part of a chain, placed.

    Attributes:
        t_s: (n,) times, increasing.
        xyz_m: (n, 3) against the local origin.
        half: (n,) 0 or 1.
    """

    t_s: FloatArray
    xyz_m: FloatArray
    half: NDArray[np.uint8]


@dataclass(frozen=True)
class WallSums:
    """What walls say in a step.

    Attributes:
        sums: of all their returns.
        patches: by window, or all together.
        scatter: of the residuals.
    """

    sums: Sums
    patches: list[list[Patches]] = field(default_factory=list)
    scatter: Scatter = field(default_factory=Scatter)

    def plus(self, other: WallSums) -> WallSums:
        """Both together."""
        return WallSums(self.sums.plus(other.sums), self.patches + other.patches, self.scatter.plus(other.scatter))


def wall_windows(
    windows: Sequence[tuple[int, slice]],
    place: Callable[[int, slice], PlacedUpright],
    knots: Knots,
    state: State,
    correlated: float,
    share: float,
    coarse: CoarseKnots | None,
) -> WallSums:
    """Walls of short windows, each of which has its own."""
    sums, scatter = Sums.of(len(knots)), Scatter()
    patches: list[list[Patches]] = []
    for chain, part in windows:
        placed = place(chain, part)
        columns = add_upright(columns_over(placed.xyz_m), placed.xyz_m, placed.half)
        found, more = _agree(chain, placed, lines(columns), knots, state, correlated, share, sums, coarse)
        scatter = scatter.plus(more)
        if len(found.place):
            patches.append([found])
    return WallSums(sums, patches, scatter)


def wall_columns(
    blocks: Sequence[tuple[int, slice]], place: Callable[[int, slice], PlacedUpright], state: State
) -> Lines:
    """Walls of a whole session."""
    path = state.xyz_m[::20, :2]
    ring = np.arange(-FAR_M, FAR_M + AROUND_M, AROUND_M)
    aside = np.stack(np.meshgrid(ring, ring), axis=-1).reshape(-1, 2)
    passed = np.unique(np.round(path / AROUND_M), axis=0) * AROUND_M
    columns: Columns = columns_over((passed[:, None] + aside).reshape(-1, 2))
    for chain, part in blocks:
        placed = place(chain, part)
        columns = add_upright(columns, placed.xyz_m, placed.half)
    return lines(columns)


def wall_session(
    walls: Lines,
    blocks: Sequence[tuple[int, slice]],
    place: Callable[[int, slice], PlacedUpright],
    knots: Knots,
    state: State,
    correlated: float,
    coarse: CoarseKnots | None,
) -> WallSums:
    """Part of a session's returns against its walls."""
    sums, scatter = Sums.of(len(knots)), Scatter()
    patches = []
    for chain, part in blocks:
        found, more = _agree(chain, place(chain, part), walls, knots, state, correlated, 1.0, sums, coarse)
        scatter = scatter.plus(more)
        patches.append(found)
    return WallSums(sums, [patches], scatter)


def _agree(
    chain: int,
    placed: PlacedUpright,
    walls: Lines,
    knots: Knots,
    state: State,
    correlated: float,
    share: float,
    sums: Sums,
    coarse: CoarseKnots | None,
) -> tuple[Patches, Scatter]:
    return agree_upright(
        knots.chains[chain],
        placed.t_s,
        placed.xyz_m,
        placed.half,
        walls,
        np.ascontiguousarray(state.xyz_m),
        correlated,
        share,
        sums,
        wall_grid(coarse.grids[chain]) if coarse is not None else CoarseGrid(0, 0, 1.0),
    )
