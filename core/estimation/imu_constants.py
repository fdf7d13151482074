"""What is constant between an IMU and the positions: the offset of their clocks, and the antenna's place.

A clock that is ahead by δ sees the antenna of the positions' time t at t + δ: along its velocity, whichever way the
vehicle moves. A lever arm that is off moves the positions along with the vehicle's axes, an error of the positions lies
in one direction for a while. All states of the adjustment are eliminated (Schur complement): what they can explain, the
constants do not show.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from furrowmap.core.estimation.banded import Solution
from furrowmap.core.estimation.knots import KNOT_STEP_S, Knots, State
from furrowmap.core.estimation.positions import AntennaPositions
from furrowmap.core.runtime.arrays import FloatArray

LEVER_SIGMA_M: Final = 0.03
"""Of a lever arm that was measured."""
ROUNDING: Final = np.array([1e-8, 1e-6, 1e-6, 1e-6])
"""Shares of the information on clock and lever arm, all states held, that are left by rounding alone."""
IMU_CLOCK_FLOOR_S: Final = 0.0003
"""No offset is known better: a vehicle's frame bends, a receiver's filter lags."""
CERTAIN_SIGMAS: Final = 5.0
MIN_IMU_CLOCK_S: Final = 0.002
MIN_LEVER_M: Final = 0.03
"""Smaller errors are none that matter."""
CAUSE_CLEAR_RATIO: Final = 1.5
"""One of the two is the cause if its gain is so many times that of the other."""
SHOWN_S: Final = 0.05
"""Standard deviation of an offset that the motion does not show."""


@dataclass(frozen=True)
class ImuConstants:
    """What the residuals of the positions show beyond what the session states.

    Attributes:
        clock_s: time by which the IMU's clock is ahead of the positions', with a lever arm that may be off by
            LEVER_SIGMA_M.
        clock_sigma_s: its standard deviation; inf where nothing determines it.
        clock_gain: by how much the sum of squared normalised residuals falls with another clock alone.
        lever_m: (3,) what is to be added to the antenna's place, forward, left, up, with clocks as they are.
        lever_sigma_m: (3,) standard deviations.
        lever_gain: as `clock_gain`.
    """

    clock_s: float = 0.0
    clock_sigma_s: float = np.inf
    clock_gain: float = 0.0
    lever_m: tuple[float, ...] = (0.0, 0.0, 0.0)
    lever_sigma_m: tuple[float, ...] = (np.inf, np.inf, np.inf)
    lever_gain: float = 0.0

    @property
    def clock_shown(self) -> bool:
        """Whether the motion shows the offset of the clocks at all."""
        return self.clock_sigma_s < SHOWN_S

    @property
    def clock_off(self) -> bool:
        """Whether the clocks are certainly off, and explain the residuals better than a lever arm does."""
        matters = abs(self.clock_s) > max(MIN_IMU_CLOCK_S, CERTAIN_SIGMAS * self.clock_sigma_s)
        return matters and self.clock_gain > CAUSE_CLEAR_RATIO * self.lever_gain

    @property
    def lever_off(self) -> bool:
        """Whether the antenna is certainly elsewhere, which explains the residuals better than clocks do."""
        matters = float(np.linalg.norm(self.lever_m)) > MIN_LEVER_M and self.lever_gain > 2.0 * CERTAIN_SIGMAS**2
        return matters and self.lever_gain > CAUSE_CLEAR_RATIO * self.clock_gain


def imu_constants(
    antenna: AntennaPositions, knots: Knots, state: State, solution: Solution, variance_factor: float
) -> tuple[ImuConstants, FloatArray]:
    """The constants by the residuals of the positions.

    Args:
        antenna: positions, with robust weights.
        state: at which the equations are linearised.
        solution: of the equations of all observations.
        variance_factor: squared residuals over their expected ones, by which standard deviations grow.

    Returns:
        The constants, and (n, size) by how much the states move if the IMU's clock is ahead by a second.
    """
    k, design, residual, sigma = antenna.linearised(knots, state)
    size = state.layout.size
    link = np.zeros((4, len(knots), size))
    if not len(k):
        return ImuConstants(), link[0]
    place = state.xyz_m + state.rotation @ antenna.lever_m
    own = np.concatenate([((place[k + 1] - place[k]) / KNOT_STEP_S)[:, :, None], state.rotation[k]], axis=2)
    weighted = own / sigma[:, :, None] ** 2
    for row, by_knots in zip(link, np.einsum("mas,maq->qms", design, weighted), strict=True):
        np.add.at(row, k, by_knots[:, :size])
        np.add.at(row, k + 1, by_knots[:, size:])
    flat = link.reshape(4, -1)
    solved = np.array([solution.by(row) for row in flat])
    alone = np.einsum("maq,mar->qr", own, weighted)
    normal = alone - flat @ solved.T
    pull = np.einsum("maq,ma->q", weighted, residual) - flat @ solution.values
    # Rounding may leave less than nothing where the motion shows nothing, as an antenna's height on level ground.
    normal = 0.5 * (normal + normal.T) + np.diag(ROUNDING * np.diag(alone))
    if np.linalg.eigvalsh(normal)[0] <= 0.0:
        return ImuConstants(), -solved[0].reshape(len(knots), size)
    spread = float(np.sqrt(max(1.0, variance_factor)))
    lever_covariance = np.linalg.inv(normal[1:, 1:])
    lever = lever_covariance @ pull[1:]
    together = np.linalg.inv(normal + np.diag([0.0, *(3 * [LEVER_SIGMA_M**-2])]))
    return (
        ImuConstants(
            clock_s=float(together[0] @ pull),
            clock_sigma_s=float(np.hypot(spread * np.sqrt(together[0, 0]), IMU_CLOCK_FLOOR_S)),
            clock_gain=float(pull[0] ** 2 / normal[0, 0]) / spread**2,
            lever_m=tuple(lever.tolist()),
            lever_sigma_m=tuple((spread * np.sqrt(np.diag(lever_covariance))).tolist()),
            lever_gain=float(pull[1:] @ lever) / spread**2,
        ),
        -solved[0].reshape(len(knots), size),
    )
