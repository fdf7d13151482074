"""Headings of a baseline between two GNSS antennas along the vehicle."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from furrowmap.core.estimation.banded import NormalEquations
from furrowmap.core.estimation.knots import Knots
from furrowmap.core.estimation.observation import Observation
from furrowmap.core.estimation.positions import without_repeats
from furrowmap.core.estimation.states import ROTATION, State
from furrowmap.core.values.positions import Positions

HEADING_CORRELATION_S: Final = 10.0
HEADING_SIGMA: Final = np.radians(0.5)
"""Of a two-antenna heading, whose error lasts for HEADING_CORRELATION_S."""


@dataclass(frozen=True)
class AntennaHeadings(Observation):
    """Yaw of the knot before each position that has one; its error's correlation is in the standard deviation.

    Attributes:
        positions: whose finite `yaw_rad` are the headings.
    """

    positions: Positions

    def add(self, equations: NormalEquations, knots: Knots, state: State) -> None:
        """One equation for each heading."""
        k, _, inside = knots.at(self.positions.t_s)
        shown = inside & np.isfinite(self.positions.yaw_rad)
        k, t_s = k[shown], self.positions.t_s[shown]
        off = self.positions.yaw_rad[shown] - np.arctan2(state.rotation[k, 1, 0], state.rotation[k, 0, 0])
        off = (off + np.pi) % (2 * np.pi) - np.pi
        step_s = float(np.median(np.diff(t_s))) if len(t_s) > 1 else 1.0
        sigma = HEADING_SIGMA * np.sqrt(max(1.0, HEADING_CORRELATION_S / step_s))
        first = k * state.layout.size + ROTATION + 2
        for chosen in without_repeats(k):
            equations.add(first[chosen], np.ones((len(chosen), 1)), off[chosen], np.full(len(chosen), sigma))
