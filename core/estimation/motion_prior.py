"""Prior of the motion: constant velocity and rate of turn between knots, with white accelerations."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Final

import numpy as np

from furrowmap.core.estimation.banded import NormalEquations
from furrowmap.core.estimation.knots import STEP_S, Knots, turns
from furrowmap.core.estimation.observation import Observation
from furrowmap.core.estimation.states import POSITION, ROTATION, State
from furrowmap.core.runtime import scratch

ACCELERATION: Final = 0.5
"""Of a tractor over ground, in m/s per square root of a second; heaving is a little less."""
HEAVE: Final = 0.4
SWAY: Final = np.radians(12.0)
"""Of roll and pitch, in rad/s per square root of a second: a quarter of a degree at 1 to 3 Hz has 15°/s^1.5."""
TURNING: Final = np.radians(20.0)
MEASURED: Final = 10.0
"""By how much the prior of turns is wider where gyroscopes measure them: otherwise it would take their scale for too
large, since less turning is likelier."""


@dataclass(frozen=True)
class MotionPrior(Observation):
    """Velocities and rates of turn change from one pair of knots to the next as slowly as a heavy machine's on soil.

    Attributes:
        acceleration: (3,) of easting, northing, height, in m/s per √s.
        turning: (3,) of the rotation vector in map axes, in rad/s per √s.
    """

    acceleration: tuple[float, float, float] = (ACCELERATION, ACCELERATION, HEAVE)
    turning: tuple[float, float, float] = (SWAY, SWAY, TURNING)
    linked: ClassVar[int] = 3

    @classmethod
    def with_measured_turns(cls) -> MotionPrior:
        """The prior beside gyroscopes."""
        return cls(turning=(MEASURED * SWAY, MEASURED * SWAY, MEASURED * TURNING))

    def add(self, equations: NormalEquations, knots: Knots, state: State) -> None:
        """Six equations for each three knots."""
        every, size = knots.inner, state.layout.size
        row = np.zeros(2 * size + 1)
        row[0], row[size], row[2 * size] = 1.0, -2.0, 1.0
        for part in scratch.parts(len(every)):
            inner = every[part]
            design = np.broadcast_to(row, (len(inner), len(row)))
            change = state.xyz_m[inner + 1] - 2.0 * state.xyz_m[inner] + state.xyz_m[inner - 1]
            around = slice(int(inner[0]) - 1, int(inner[-1]) + 2)
            rotation = state.rotation[around]
            turn = np.einsum("kij,kj->ki", rotation, turns(np.ascontiguousarray(rotation)))
            turned = turn[inner - around.start] - turn[inner - 1 - around.start]
            for first, values, spread in ((POSITION, change, self.acceleration), (ROTATION, turned, self.turning)):
                for axis in range(3):
                    sigma = np.full(len(inner), spread[axis] * STEP_S**1.5)
                    equations.add((inner - 1) * size + first + axis, design, -values[:, axis], sigma)
