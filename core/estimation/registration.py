"""Returns registered to reference surfaces: an observation whose reference is unknown as well."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from furrowmap.core.estimation.banded import NormalEquations
from furrowmap.core.estimation.knots import Knots
from furrowmap.core.estimation.observation import Observation
from furrowmap.core.estimation.patches import Patches, free_patches
from furrowmap.core.estimation.slices import SliceSums
from furrowmap.core.estimation.states import State


@dataclass(frozen=True)
class Registration(Observation):
    """Returns registered at a state, which is the one it is added at.

    Attributes:
        sums: equations of the poses.
        free: whether the references move with the poses; if so, what follows takes them out of the coarse equations.
        references: patches of each reference surface.
        patch_m: side of these patches.
        eliminated: equations of the coarse knots by references that are eliminated already.
    """

    sums: SliceSums
    free: bool
    references: Sequence[Sequence[Patches]] = ()
    patch_m: float = 1.0
    eliminated: Sequence[NormalEquations] = ()

    def add(self, equations: NormalEquations, knots: Knots, _state: State) -> None:
        """The sums of the slices."""
        self.sums.add_to(equations, knots, free=self.free)

    def eliminate_references(self, equations: NormalEquations, centre_m: NDArray[np.float64]) -> None:
        """Let the references move: take them out of the equations of the coarse knots at `centre_m` (count, 3)."""
        for part in self.eliminated:
            equations.band[: len(part.band)] += part.band
            equations.right += part.right
        for patches in self.references:
            free_patches(equations, list(patches), self.patch_m, centre_m)
