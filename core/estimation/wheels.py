"""Wheels: the rear axle does not move sideways."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from furrowmap.core.estimation.banded import NormalEquations
from furrowmap.core.estimation.knots import STEP_S, Knots
from furrowmap.core.estimation.observation import Observation
from furrowmap.core.estimation.states import POSE, ROTATION, State
from furrowmap.core.runtime import scratch

FloatArray = NDArray[np.float64]

SLIP: Final = 0.03
"""Sideways movement of the rear axle as a share of the path length (one standard deviation)."""
SLIP_FLOOR_M: Final = 0.0005
SLIP_EVERY_S: Final = 0.1
"""Slip is independent from one such interval to the next."""


@dataclass(frozen=True)
class Wheels(Observation):
    """No sideways movement from each knot to the next, but for slip."""

    def add(self, equations: NormalEquations, knots: Knots, state: State) -> None:
        """One equation for each two knots."""
        linked = knots.linked
        for part in scratch.parts(len(linked)):
            steps = AxleSteps.of(linked[part], state)
            equations.add(linked[part] * state.layout.size, steps.design, -steps.sideways_m, steps.sigma_m)


@dataclass(frozen=True)
class AxleSteps:
    """Movements of the rear axle from each knot to the next.

    Attributes:
        along_m: (k,) forward.
        sideways_m: (k,) to the left.
        sigma_m: (k,) of the slip.
        design: (k, layout.size + 6) derivatives of `sideways_m` by the unknowns from the first knot's position to the
            second one's rotation.
    """

    along_m: FloatArray
    sideways_m: FloatArray
    sigma_m: FloatArray
    design: FloatArray

    @classmethod
    def of(cls, linked: NDArray[np.int64], state: State) -> AxleSteps:
        """Those from the knots (k,) to the next."""
        size = state.layout.size
        step = state.xyz_m[linked + 1] - state.xyz_m[linked]
        forward, left = (0.5 * (state.rotation[linked, :, a] + state.rotation[linked + 1, :, a]) for a in range(2))
        length = np.linalg.norm(step, axis=1)
        design = np.zeros((len(linked), size + POSE))
        design[:, :ROTATION], design[:, size : size + ROTATION] = -left, left
        design[:, ROTATION:POSE] = design[:, size + ROTATION :] = 0.5 * np.cross(left, step)
        sigma = np.hypot(SLIP * length * np.sqrt(SLIP_EVERY_S / STEP_S), SLIP_FLOOR_M)
        return cls(np.einsum("ij,ij->i", step, forward), np.einsum("ij,ij->i", step, left), sigma, design)
