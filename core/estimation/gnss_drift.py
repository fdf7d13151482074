"""The slowly varying error of GNSS positions as a Gauss-Markov process."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from furrowmap.core.estimation.banded import NormalEquations
from furrowmap.core.estimation.knots import STEP_S, Knots
from furrowmap.core.estimation.observation import Observation
from furrowmap.core.estimation.states import GNSS_DRIFT, State
from furrowmap.core.runtime import scratch
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
        linked = knots.linked
        on = linked[p.run[nearest[linked]] == p.run[nearest[linked + 1]]]
        begins = np.ones(len(knots), np.bool_)
        begins[on + 1] = False
        starts = np.flatnonzero(begins)
        kept = np.exp(-STEP_S / DRIFT_CORRELATION_S)
        row = np.zeros(size + 1)
        row[0], row[size] = -kept, 1.0
        for axis in range(3):
            column, value, spread = state.layout.column(GNSS_DRIFT) + axis, drift[:, axis], p.drift_m[:, axis]
            begin = np.ones((len(starts), 1))
            equations.add(starts * size + column, begin, -value[starts], spread[nearest[starts]])
            for part in scratch.parts(len(on)):
                same = on[part]
                design = np.broadcast_to(row, (len(same), len(row)))
                sigma = spread[nearest[same]] * np.sqrt(1.0 - kept**2)
                equations.add(same * size + column, design, kept * value[same] - value[same + 1], sigma)
