"""Crab angle: the direction of travel against the vehicle's x axis, which a mounting with a wrong yaw shows."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from furrowmap.core.estimation.banded import Solution
from furrowmap.core.estimation.coarse import CoarseKnots, coarse_right
from furrowmap.core.estimation.knots import POSE, Knots, State
from furrowmap.core.estimation.vehicle import AxleSteps
from furrowmap.core.runtime import arrays
from furrowmap.core.runtime.arrays import FloatArray


@dataclass(frozen=True)
class CrabAngle:
    """One unknown beside those of the knots: the angle by which the vehicle travels to the left of its x axis.

    Its equations are those of the wheels, whose movement to the left is then this share of the movement forward.

    Attributes:
        link: (knots, size) the normal matrix between it and the knots' unknowns.
        own: the normal matrix of its own.
        right: its right-hand side.
    """

    link: FloatArray
    own: float
    right: float

    @classmethod
    def of(cls, knots: Knots, state: State) -> CrabAngle:
        """At a state in which it is zero."""
        every, size, own, right = knots.linked, state.layout.size, 0.0, 0.0
        link = arrays.zeros((len(knots), size))
        for part in arrays.parts(len(every)):
            linked, steps = every[part], AxleSteps.from_knots(every[part], state)
            weighted = steps.along_m / steps.sigma_m**2
            np.add.at(link, linked, -weighted[:, None] * steps.design[:, :size])
            np.add.at(link[:, :POSE], linked + 1, -weighted[:, None] * steps.design[:, size:])
            own, right = own + float(weighted @ steps.along_m), right + float(weighted @ steps.sideways_m)
        return cls(link, own, right)


def crab_angle_rad(
    knots: Knots, state: State, coarse: CoarseKnots, centre_m: FloatArray, solution: Solution
) -> tuple[float, float]:
    """The crab angle and its standard deviation, by the solution of the coarse knots' equations.

    All other unknowns are eliminated (Schur complement): without that the wheels turn the poses part of the way.
    """
    crab = CrabAngle.of(knots, state)
    link = coarse_right(coarse, centre_m, state, crab.link)
    information = float(crab.own - link @ solution.by(link))
    if information <= 0.0:
        return 0.0, np.inf
    return float((crab.right - link @ solution.values) / information), float(1.0 / np.sqrt(information))
