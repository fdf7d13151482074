"""Positions of a GNSS antenna off the vehicle's origin, with their slowly varying error."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Self

import numpy as np
from numpy.typing import NDArray

from furrowmap.core.estimation.banded import NormalEquations
from furrowmap.core.estimation.knots import Knots
from furrowmap.core.estimation.observation import Observation
from furrowmap.core.estimation.robust import huber_weight
from furrowmap.core.estimation.states import GNSS_DRIFT, POSITION, ROTATION, State
from furrowmap.core.runtime import scratch
from furrowmap.core.values.positions import Positions

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]


@dataclass(frozen=True)
class AntennaPositions(Observation):
    """Position = origin + rotation · lever arm + GNSS drift, with white noise; weights are robust (Huber).

    Attributes:
        positions: (m,) of the antenna; those outside all chains take no part.
        origin_m: (3,) local origin.
        lever_m: (3,) the antenna in the vehicle frame.
        weight: (m,) robust weights.
    """

    positions: Positions
    origin_m: FloatArray
    lever_m: FloatArray
    weight: FloatArray

    @classmethod
    def of(cls, positions: Positions, origin_m: FloatArray, lever_m: FloatArray) -> AntennaPositions:
        """All of them with their whole weight."""
        return cls(positions, origin_m, lever_m, np.ones(len(positions.t_s)))

    def add(self, equations: NormalEquations, knots: Knots, state: State) -> None:
        """Three equations for each position."""
        size = state.layout.size
        for part in scratch.parts(len(self.positions.t_s), scratch.PART // 4):
            k, design, residual, sigma = self.linearised(knots, state, part)
            for chosen in without_repeats(k):
                for axis in range(3):
                    equations.add(k[chosen] * size, design[chosen, axis], residual[chosen, axis], sigma[chosen, axis])

    def linearised(
        self, knots: Knots, state: State, part: slice = slice(None)
    ) -> tuple[IntArray, FloatArray, FloatArray, FloatArray]:
        """The equations of the positions inside chains, or of some of them.

        Returns:
            (k,) the knot before each; (k, 3, 2 · size) derivatives by its states and those of the next; (k, 3)
            residuals; (k, 3) standard deviations by the robust weights.
        """
        k, share, inside = knots.at(self.positions.t_s[part])
        k, share = k[inside], share[inside, None]
        size, drift = state.layout.size, state.layout.column(GNSS_DRIFT)
        arm, residual = self._residuals(k, share, self.positions.xyz_m[part][inside], state)
        sigma = self.positions.white_m[part][inside] / np.sqrt(self.weight[part][inside, None])
        design = np.zeros((len(k), 3, 2 * size))
        for first, weight in ((0, 1.0 - share[:, 0]), (size, share[:, 0])):
            for axis in range(3):
                one, two = (axis + 1) % 3, (axis + 2) % 3
                design[:, axis, first + POSITION + axis] = weight
                design[:, axis, first + ROTATION + one] = weight * arm[:, two]
                design[:, axis, first + ROTATION + two] = -weight * arm[:, one]
                design[:, axis, first + drift + axis] = weight
        return k, design, residual, sigma

    def reweighted(self, knots: Knots, state: State) -> Self:
        """Huber's weights of the horizontal residuals."""
        return replace(self, weight=huber_weight(self.normalised(knots, state)))

    def normalised(self, knots: Knots, state: State) -> FloatArray:
        """(m,) horizontal residuals in standard deviations; nan outside all chains."""
        out: FloatArray = np.hypot(*(self.residuals_m(knots, state) / self.positions.white_m)[:, :2].T)
        return out

    def residuals_m(self, knots: Knots, state: State) -> FloatArray:
        """(m, 3) residuals; nan outside all chains."""
        k, share, inside = knots.at(self.positions.t_s)
        out = np.full((len(inside), 3), np.nan)
        _, out[inside] = self._residuals(k[inside], share[inside, None], self.positions.xyz_m[inside], state)
        return out

    def _residuals(
        self, k: IntArray, share: FloatArray, observed_m: FloatArray, state: State
    ) -> tuple[FloatArray, FloatArray]:
        """The lever arms in map axes, and the residuals of the positions observed, (k, 3) each."""

        def between(values: FloatArray) -> FloatArray:
            return values[k] + share * (values[k + 1] - values[k])

        before, after = (state.rotation[knot] @ self.lever_m for knot in (k, k + 1))
        arm = before + share * (after - before)
        antenna = between(state.xyz_m) + arm
        return arm, observed_m - self.origin_m - antenna - between(state[GNSS_DRIFT])


def without_repeats(k: IntArray) -> list[NDArray[np.intp]]:
    """Indices of `k`, which does not decrease, in groups without equal values."""
    if not len(k):
        return []
    begins = np.flatnonzero(np.diff(k, prepend=k[:1] - 1) != 0)
    rank = np.arange(len(k)) - np.repeat(begins, np.diff(np.append(begins, len(k))))
    return [np.flatnonzero(rank == r) for r in range(int(rank.max()) + 1)]
