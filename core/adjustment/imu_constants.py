"""What is constant of an IMU against the positions: offset and rate of its clock, the antenna's place, a scale.

A clock that is ahead by δ sees the antenna of the positions' time t at t + δ: along its velocity, whichever way the
vehicle moves. One that runs fast is ahead by ever more, and shows slower turns. A lever arm that is off moves the
positions along with the vehicle's axes, an error of the positions lies in one direction for a while. All states of the
adjustment are eliminated (Schur complement): what they can explain, the constants do not show.
"""

from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy.spatial.transform import Rotation
from scipy.special import expit

from furrowmap.core.adjustment.banded import BandedSolution
from furrowmap.core.adjustment.knots import KNOT_STEP_S, POSE, ROTATION, Knots, State
from furrowmap.core.adjustment.position_observations import AntennaPositions
from furrowmap.core.adjustment.preintegration import RATE_BIAS, InertialLinks, predicted
from furrowmap.core.runtime import arrays
from furrowmap.core.runtime.arrays import FloatArray, IntArray

LEVER_SIGMA_M: Final = 0.03
"""Of a lever arm that was measured."""
ROUNDING: Final = np.array([1e-8, 1e-6, 1e-6, 1e-6, 1e-8, 1e-8])
"""Shares of the information on each constant, all states held, that are left by rounding alone."""
IMU_CLOCK_FLOOR_S: Final = 0.0003
"""No offset is known better: a vehicle's frame bends, a receiver's filter lags."""
CERTAIN_SIGMAS: Final = 3.5
"""A constant that seems off by so much is as likely right: few are off, and by much more."""
MIN_IMU_CLOCK_S: Final = 0.002
MIN_LEVER_M: Final = 0.03
MIN_CLOCK_RATE: Final = 5e-5
MIN_GYRO_SCALE: Final = 1e-3
"""Smaller errors are none that matter."""
MAX_SHARE: Final = 0.3
"""More is another unit."""
CAUSE_CLEAR_RATIO: Final = 1.5
"""A constant is the cause if its gain is so many times those of all others together."""
SETTLED_SIGMAS: Final = 0.2
"""Standard deviations of a constant within which it is found."""
SHOWN_S: Final = 0.05
"""Standard deviation of an offset that the motion does not show."""


@dataclass(frozen=True)
class Constant:
    """What the residuals show of a constant.

    Attributes:
        value: (k,) by how much it is off.
        sigma: (k,) standard deviations; inf where nothing determines it.
        gain: by how much the sum of squared normalised residuals falls with it alone.
    """

    value: tuple[float, ...]
    sigma: tuple[float, ...]
    gain: float = 0.0

    def certain(self, least: float) -> bool:
        """Whether it is off by CERTAIN_SIGMAS, and by more than a size that matters."""
        enough = self.gain > CERTAIN_SIGMAS**2 * (1.0 if len(self.value) == 1 else 2.0)
        return enough and float(np.linalg.norm(self.value)) > least


NOT_SHOWN: Final = Constant((0.0,), (np.inf,))


@dataclass(frozen=True)
class ImuConstants:
    """What the residuals show beyond what the session states.

    Attributes:
        clock: seconds by which the IMU's clock is ahead of the positions', with a lever arm that may be off by
            LEVER_SIGMA_M.
        lever: what is to be added to the antenna's place, forward, left, up, with clocks as they are.
        clock_rate: seconds by which the IMU's clock gains in a second.
        gyro_scale: share by which angular rates are too large.
    """

    clock: Constant = NOT_SHOWN
    lever: Constant = Constant((0.0, 0.0, 0.0), (np.inf, np.inf, np.inf))
    clock_rate: Constant = NOT_SHOWN
    gyro_scale: Constant = NOT_SHOWN

    @property
    def clock_shown(self) -> bool:
        """Whether the motion shows the offset of the clocks at all."""
        return self.clock.sigma[0] < SHOWN_S

    @property
    def clock_off(self) -> bool:
        """Whether the clocks are certainly off, and explain the residuals better than a lever arm does."""
        matters = abs(self.clock.value[0]) > max(MIN_IMU_CLOCK_S, CERTAIN_SIGMAS * self.clock.sigma[0])
        return matters and self.clock.gain > CAUSE_CLEAR_RATIO * self.lever.gain

    def clock_left_s(self, used_s: float) -> float:
        """Standard deviation of the offset if `used_s` of it is used: there may be one, or none at all."""
        (left,) = self.clock.value
        (sigma,) = self.clock.sigma
        if not self.clock_shown:
            return sigma if used_s else 0.0
        likely = expit(0.5 * (((used_s + left) / sigma) ** 2 - CERTAIN_SIGMAS**2))
        return float(np.sqrt(likely * (sigma**2 + left**2) + (1.0 - likely) * used_s**2))

    @property
    def lever_off(self) -> bool:
        """Whether the antenna is certainly elsewhere, which explains the residuals better than clocks do."""
        return self.lever.certain(MIN_LEVER_M) and self.lever.gain > CAUSE_CLEAR_RATIO * self.clock.gain

    def shares_off(self, rate_used: float, scale_used: float) -> tuple[float, float]:
        """What is to be taken off the rate of the clock and the scale of the gyroscopes, beyond what was before.

        One is certainly off if it explains the residuals better than all others; one in use is settled.
        """
        gains = self.clock.gain + self.lever.gain + self.clock_rate.gain + self.gyro_scale.gain
        shares = []
        for one, used, least in (
            (self.clock_rate, rate_used, MIN_CLOCK_RATE),
            (self.gyro_scale, scale_used, MIN_GYRO_SCALE),
        ):
            share = one.value[0]
            clear = one.certain(least) and one.gain > CAUSE_CLEAR_RATIO * (gains - one.gain)
            off = abs(share) < MAX_SHARE if clear else used and abs(share) > SETTLED_SIGMAS * one.sigma[0]
            shares.append(share if off else 0.0)
        return shares[0], shares[1]


def imu_constants(
    antenna: AntennaPositions,
    links: InertialLinks,
    knots: Knots,
    state: State,
    solution: BandedSolution,
    variance_factor: float,
) -> tuple[ImuConstants, FloatArray]:
    """The constants by the residuals.

    Args:
        antenna: positions, with robust weights.
        links: the IMU's measurements.
        state: at which the equations are linearised.
        solution: of the equations of all observations.
        variance_factor: squared residuals over their expected ones, by which standard deviations grow.

    Returns:
        The constants, and (n, size) by how much the states, at times of the positions' clock, move if the IMU's clock
        is ahead by a second.
    """
    k, design, residual, sigma = antenna.linearised(knots, state)
    size = state.layout.size
    link = np.zeros((6, len(knots), size))
    if not len(k):
        return ImuConstants(), link[0]
    place = state.xyz_m + state.rotation @ antenna.lever_m
    velocity = ((place[k + 1] - place[k]) / KNOT_STEP_S)[:, :, None]
    since_s = (knots.t_s[k] - 0.5 * (knots.t_s[k[0]] + knots.t_s[k[-1]]))[:, None, None]
    own = np.concatenate([velocity, state.rotation[k], since_s * velocity, 0.0 * velocity], axis=2)
    weighted = own / sigma[:, :, None] ** 2
    for row, by_knots in zip(link, np.einsum("mas,maq->qms", design, weighted), strict=True):
        np.add.at(row, k, by_knots[:, :size])
        np.add.at(row, k + 1, by_knots[:, size:])
    alone = np.einsum("maq,mar->qr", own, weighted)
    pull = np.einsum("maq,ma->q", weighted, residual)

    for part in arrays.parts(len(knots.linked), arrays.ROWS_AT_ONCE // 2):
        _add_turns(links, knots, state, knots.linked[part], (link[4:], alone[4:, 4:], pull[4:]))
    flat = link.reshape(len(link), -1)
    by_clock = -solution.by(flat[0]).reshape(len(knots), size)
    by_clock[:, :POSE] += _pose_rates(knots, state)
    normal = alone - np.array([flat @ solution.by(row) for row in flat])
    pull -= flat @ solution.values
    # Rounding may leave less than nothing where the motion shows nothing, as an antenna's height on level ground.
    normal = 0.5 * (normal + normal.T) + np.diag(ROUNDING * np.diag(alone))
    if np.linalg.eigvalsh(normal[:4, :4])[0] <= 0.0 or np.diag(normal).min() <= 0.0:
        return ImuConstants(), by_clock
    spread = float(np.sqrt(max(1.0, variance_factor)))

    def constant(chosen: slice) -> Constant:
        covariance = np.linalg.inv(normal[chosen, chosen])
        value, sigma = covariance @ pull[chosen], spread * np.sqrt(np.diag(covariance))
        return Constant(tuple(value.tolist()), tuple(sigma.tolist()), float(pull[chosen] @ value) / spread**2)

    together = np.linalg.inv(normal[:4, :4] + np.diag([0.0, *(3 * [LEVER_SIGMA_M**-2])]))
    clock_sigma_s = float(np.hypot(spread * np.sqrt(together[0, 0]), IMU_CLOCK_FLOOR_S))
    clock = Constant((float(together[0] @ pull[:4]),), (clock_sigma_s,), constant(slice(0, 1)).gain)
    constants = ImuConstants(clock, constant(slice(1, 4)), constant(slice(4, 5)), constant(slice(5, 6)))
    return constants, by_clock


def _pose_rates(knots: Knots, state: State) -> FloatArray:
    """(n, 6) velocities and angular rates at the knots, in the map's axes."""
    out = arrays.zeros((len(knots), POSE))
    for part in arrays.parts(len(knots.linked)):
        k = knots.linked[part]
        turn = Rotation.from_matrix(state.rotation[k + 1] @ state.rotation[k].transpose(0, 2, 1)).as_rotvec()
        out[k] = np.column_stack([state.xyz_m[k + 1] - state.xyz_m[k], turn]) / KNOT_STEP_S
    last = np.array([chain.first + chain.count - 1 for chain in knots.chains])
    out[last] = out[last - 1]
    return out


def _add_turns(
    links: InertialLinks, knots: Knots, state: State, linked: IntArray, sums: tuple[FloatArray, FloatArray, FloatArray]
) -> None:
    """Add what turns from knots (k,) to the next show of constants that make them all too large by the same share.

    Args:
        sums: (q, n, size) products with the states, (q, q) squares, and (q,) products with the residuals.
    """
    link, alone, pull = sums
    computed = predicted(links, knots, state, linked)
    column = state.layout.column(RATE_BIAS)
    turn = Rotation.from_matrix(computed.steps.turn).as_rotvec()
    off = Rotation.from_matrix(state.rotation[linked + 1] @ computed.rotation.transpose(0, 2, 1)).as_rotvec()
    turned = np.einsum("kij,kj->ki", state.rotation[linked], turn)
    weight = 1.0 / (links.noise.rate**2 * KNOT_STEP_S)
    link[:, linked, ROTATION:POSE] -= weight * turned
    link[:, linked + 1, ROTATION:POSE] += weight * turned
    link[:, linked, column : column + 3] += weight * KNOT_STEP_S * turn
    alone += weight * np.sum(turned**2)
    pull -= weight * np.sum(turned * off)
