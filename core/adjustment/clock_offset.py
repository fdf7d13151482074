"""Offset of the scanner's clock from the positions', and error of the lever arm, from the adjusted trajectory.

Poses that come late lie behind the antenna's positions by velocity times delay, whichever way the vehicle drives; a
lever arm that is off moves them along with the vehicle's axes; errors of positions lie in one direction for a while.
Ground seen in several directions of travel separates the three.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from furrowmap.core.estimation.banded import NormalEquations
from furrowmap.core.estimation.coarse import CoarseKnots, coarse_right
from furrowmap.core.estimation.knots import KNOT_STEP_S, Knots, State
from furrowmap.core.estimation.positions import AntennaPositions
from furrowmap.core.runtime.arrays import FloatArray

FLOOR_S: Final = 0.003
FLOOR_M: Final = 0.01
"""No offset and no lever arm is known better."""
LEAST_GAIN: Final = 50.0
"""Fall of the sum of squared normalised residuals from which an offset or a lever arm is off: seven sigmas."""
CLEAR: Final = 1.5
"""One of the two is the cause if its gain is so many times that of the other."""
REPORTED_S: Final = 0.01
REPORTED_M: Final = 0.03
"""Smaller errors are none that matter."""


@dataclass(frozen=True)
class AntennaConstants:
    """What is constant between antenna and scanner, beyond what the session states.

    Attributes:
        clock_s: time by which the scanner's clock is ahead of the positions'.
        clock_sigma_s: its standard deviation; inf where the drive does not determine it.
        clock_gain: by how much the sum of squared normalised residuals falls with it.
        lever_m: what is to be added to the lever arm, forward and to the left.
        lever_sigma_m: standard deviations.
        lever_gain: as `clock_gain`.
    """

    clock_s: float = 0.0
    clock_sigma_s: float = np.inf
    clock_gain: float = 0.0
    lever_m: tuple[float, float] = (0.0, 0.0)
    lever_sigma_m: tuple[float, float] = (np.inf, np.inf)
    lever_gain: float = 0.0

    @property
    def off(self) -> bool:
        """Whether the clocks or the lever arm are off."""
        matters = abs(self.clock_s) > REPORTED_S or np.hypot(*self.lever_m) > REPORTED_M
        return bool(matters and max(self.clock_gain, self.lever_gain) > LEAST_GAIN)

    @property
    def clock_off(self) -> bool:
        """Whether that is the clocks, which explain the residuals better than a lever arm does."""
        return self.off and self.clock_gain > CLEAR * self.lever_gain

    @property
    def lever_off(self) -> bool:
        """Whether that is the lever arm, which explains the residuals better than the clocks do."""
        return self.off and self.lever_gain > CLEAR * self.clock_gain


def antenna_constants(
    knots: Knots,
    state: State,
    antenna: AntennaPositions,
    coarse: CoarseKnots,
    centre_m: FloatArray,
    free: NormalEquations,
) -> AntennaConstants:
    """The constants by the residuals of the positions, all other unknowns eliminated (Schur complement).

    Without that, drift and trajectory take most of an offset.

    Args:
        knots: times.
        state: the solution.
        antenna: positions, with robust weights.
        coarse: coarse knots.
        centre_m: see :meth:`~furrowmap.core.estimation.coarse.CoarseKnots.centres`.
        free: equations of the coarse knots with free references.
    """
    k, design, residual, sigma = antenna.linearised(knots, state)
    if not len(k):
        return AntennaConstants()
    place, size = state.xyz_m + state.rotation @ antenna.lever_m, state.layout.size
    velocity = (place[k + 1] - place[k]) / KNOT_STEP_S
    own = np.concatenate([velocity[:, :, None], state.rotation[k][:, :, :2]], axis=2)
    weighted = own / sigma[:, :, None] ** 2
    by_knots = np.einsum("mas,maq->qms", design, weighted)
    solution = free.solve()
    links, solved = [], []
    for rows in by_knots:
        link = np.zeros((len(knots), size))
        np.add.at(link, k, rows[:, :size])
        np.add.at(link, k + 1, rows[:, size:])
        links.append(coarse_right(coarse, centre_m, state, link))
        solved.append(solution.by(links[-1]))
    normal = np.einsum("maq,mar->qr", own, weighted) - np.array(links) @ np.array(solved).T
    pull = np.einsum("maq,ma->q", weighted, residual)
    if np.linalg.eigvalsh(normal)[0] <= 0.0:
        return AntennaConstants()
    lever_covariance = np.linalg.inv(normal[1:, 1:])
    lever = lever_covariance @ pull[1:]
    sigmas = np.hypot(np.sqrt(np.diag(lever_covariance)), FLOOR_M)
    return AntennaConstants(
        clock_s=float(pull[0] / normal[0, 0]),
        clock_sigma_s=float(np.hypot(1.0 / np.sqrt(normal[0, 0]), FLOOR_S)),
        clock_gain=float(pull[0] ** 2 / normal[0, 0]),
        lever_m=(float(lever[0]), float(lever[1])),
        lever_sigma_m=(float(sigmas[0]), float(sigmas[1])),
        lever_gain=float(pull[1:] @ lever),
    )
