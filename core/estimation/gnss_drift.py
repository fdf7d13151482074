"""The slowly varying error of GNSS positions as a Gauss-Markov process."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from furrowmap.core.estimation.banded import NormalEquations
from furrowmap.core.estimation.knots import STEP_S, Knots
from furrowmap.core.estimation.observation import Observation
from furrowmap.core.estimation.states import GNSS_DRIFT, State
from furrowmap.core.values.positions import DRIFT_CORRELATION_S, Positions


@dataclass(frozen=True)
class GnssDrift(Observation):
    """First-order Gauss-Markov process of each axis, which begins anew with each run of equal quality.

    Attributes:
        positions: whose qualities and standard deviations of the drift apply.
    """

    positions: Positions

    def add(self, equations: NormalEquations, knots: Knots, state: State) -> None:
        """The process from knot to knot, and its variance at the start of each run."""
        p, size, drift = self.positions, state.layout.size, state[GNSS_DRIFT]
        nearest = np.clip(np.searchsorted(p.t_s, knots.t_s), 0, len(p.t_s) - 1)
        spread, run = p.drift_m[nearest], p.run[nearest]
        linked = knots.linked
        same = linked[run[linked] == run[linked + 1]]
        starts = np.setdiff1d(np.arange(len(knots)), same + 1)
        kept = np.exp(-STEP_S / DRIFT_CORRELATION_S)
        row = np.zeros(size + 1)
        row[0], row[size] = -kept, 1.0
        design = np.broadcast_to(row, (len(same), len(row)))
        for axis in range(3):
            column, value = state.layout.column(GNSS_DRIFT) + axis, drift[:, axis]
            equations.add(starts * size + column, np.ones((len(starts), 1)), -value[starts], spread[starts, axis])
            sigma = spread[same, axis] * np.sqrt(1.0 - kept**2)
            equations.add(same * size + column, design, kept * value[same] - value[same + 1], sigma)
