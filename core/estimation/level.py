"""A vehicle on a field is roughly level."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from furrowmap.core.estimation.banded import NormalEquations
from furrowmap.core.estimation.knots import STEP_S, Knots
from furrowmap.core.estimation.observation import Observation
from furrowmap.core.estimation.states import ROTATION, State
from furrowmap.core.runtime import scratch

LEVEL_SIGMA: Final = np.radians(3.0)
LEVEL_CORRELATION_S: Final = 20.0
"""Slope of a field, and how long a vehicle stays on the same slope: determines what nothing else does, the roll of a
straight drive."""


@dataclass(frozen=True)
class Level(Observation):
    """The vehicle's x and y axes have little height."""

    def add(self, equations: NormalEquations, knots: Knots, state: State) -> None:
        """Two equations for each knot."""
        for part in scratch.parts(len(knots)):
            first = np.arange(part.start, part.stop) * state.layout.size + ROTATION
            sigma = np.full(len(first), LEVEL_SIGMA * np.sqrt(LEVEL_CORRELATION_S / STEP_S))
            for axis in range(2):
                along = state.rotation[part, :, axis]
                equations.add(first, np.column_stack([along[:, 1], -along[:, 0]]), -along[:, 2], sigma)
