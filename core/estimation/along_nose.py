"""A vehicle on wheels or tracks moves along its nose: what aids an IMU where accelerations show no heading."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from furrowmap.core.estimation.banded import NormalEquations
from furrowmap.core.estimation.knots import STEP_S, Knots
from furrowmap.core.estimation.observation import Observation
from furrowmap.core.estimation.states import State
from furrowmap.core.estimation.wheels import AxleSteps
from furrowmap.core.runtime import scratch

SIDEWAYS: Final = 0.1
"""Sideways way as a share of the way: slip on a slope, and the yaw of an IMU mounted by hand."""
AXLE_M: Final = 0.3
"""How far the vehicle's origin may be before or behind the point that does not move sideways in turns."""
LASTING_S: Final = 10.0
"""Time over which either stays the same."""
FLOOR_M: Final = 0.001


@dataclass(frozen=True)
class AlongNose(Observation):
    """Weak observation of no sideways movement from each knot to the next."""

    def add(self, equations: NormalEquations, knots: Knots, state: State) -> None:
        """One equation for each two knots."""
        linked, lasting = knots.linked, np.sqrt(LASTING_S / STEP_S)
        for part in scratch.parts(len(linked)):
            steps = AxleSteps.of(linked[part], state)
            before, after = state.rotation[linked[part]], state.rotation[linked[part] + 1]
            turn = np.einsum("ki,ki->k", after[:, :, 0] - before[:, :, 0], before[:, :, 1])
            sigma = np.hypot(lasting * np.hypot(SIDEWAYS * steps.along_m, AXLE_M * turn), FLOOR_M)
            equations.add(linked[part] * state.layout.size, steps.design, -steps.sideways_m, sigma)
