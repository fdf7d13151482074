"""Headings of the vehicle: of a baseline between two GNSS antennas, or of another device."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from furrowmap.core.estimation.banded import NormalEquations
from furrowmap.core.estimation.knots import Knots
from furrowmap.core.estimation.observation import Observation
from furrowmap.core.estimation.positions import without_repeats
from furrowmap.core.estimation.states import ROTATION, State
from furrowmap.core.values.positions import Positions

FloatArray = NDArray[np.float64]

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
        t_s = self.positions.t_s[np.isfinite(self.positions.yaw_rad)]
        step_s = float(np.median(np.diff(t_s))) if len(t_s) > 1 else 1.0
        sigma = HEADING_SIGMA * np.sqrt(max(1.0, HEADING_CORRELATION_S / step_s))
        _add_yaws(equations, knots, state, (self.positions.t_s, self.positions.yaw_rad), float(sigma))


@dataclass(frozen=True)
class RecordedHeadings(Observation):
    """Yaw of the knot before each heading of another device, whose error stays the same, as a magnetometer's does.

    Attributes:
        t_s: (m,) UTC, increasing.
        yaw_rad: (m,) of the vehicle's x axis; nan where unknown.
        sigma_rad: standard deviation of all together.
    """

    t_s: FloatArray
    yaw_rad: FloatArray
    sigma_rad: float

    def add(self, equations: NormalEquations, knots: Knots, state: State) -> None:
        """One equation for each heading."""
        count = max(1, int(np.isfinite(self.yaw_rad).sum()))
        _add_yaws(equations, knots, state, (self.t_s, self.yaw_rad), self.sigma_rad * float(np.sqrt(count)))


def _add_yaws(
    equations: NormalEquations, knots: Knots, state: State, yaws: tuple[FloatArray, FloatArray], sigma_rad: float
) -> None:
    """One equation for each yaw (m,) at a time (m,) that is known and inside the chains."""
    t_s, yaw_rad = yaws
    k, _, inside = knots.at(t_s)
    shown = inside & np.isfinite(yaw_rad)
    k = k[shown]
    off = yaw_rad[shown] - np.arctan2(state.rotation[k, 1, 0], state.rotation[k, 0, 0])
    off = (off + np.pi) % (2 * np.pi) - np.pi
    first = k * state.layout.size + ROTATION + 2
    for chosen in without_repeats(k):
        equations.add(first[chosen], np.ones((len(chosen), 1)), off[chosen], np.full(len(chosen), sigma_rad))
