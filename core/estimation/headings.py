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
from furrowmap.core.values.trajectory import Trajectory

FloatArray = NDArray[np.float64]

HEADING_CORRELATION_S: Final = 10.0
HEADING_SIGMA: Final = np.radians(0.5)
"""Of a two-antenna heading, whose error lasts for HEADING_CORRELATION_S."""
STANDS_WITHIN_M: Final = 1.0
"""An antenna that moves by less shows no heading: it sways, or the vehicle turns about its axle."""
NOSE: Final = np.array([1.0, 0.0, 0.0])


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
    """Direction of an axis of the vehicle over ground, in the knot before each time that has one.

    Attributes:
        t_s: (m,) UTC, increasing.
        yaw_rad: (m,) of the axis; nan where unknown.
        sigma_rad: standard deviation of the error.
        lasting_s: time over which the error is the same: infinite for that of a magnetometer.
        axis: (3,) in the vehicle frame.
    """

    t_s: FloatArray
    yaw_rad: FloatArray
    sigma_rad: float
    lasting_s: float = np.inf
    axis: tuple[float, float, float] = (1.0, 0.0, 0.0)

    def add(self, equations: NormalEquations, knots: Knots, state: State) -> None:
        """One equation for each heading."""
        t_s = self.t_s[np.isfinite(self.yaw_rad)]
        step_s = float(np.median(np.diff(t_s))) if len(t_s) > 1 else 1.0
        alike = min(max(1.0, self.lasting_s / step_s), max(1.0, float(len(t_s))))
        yaws = (self.t_s, self.yaw_rad)
        _add_yaws(equations, knots, state, yaws, self.sigma_rad * float(np.sqrt(alike)), np.array(self.axis))


def headings_at_stands(start: Trajectory, knots: Knots, positions: Positions) -> tuple[RecordedHeadings, ...]:
    """The headings of a first guess for chains of scans during which the antenna hardly moves.

    What the vehicle drove before such a chain, and that it stood since, tells its heading; nothing in the chain does,
    and relief of the ground seen before only where poses are near the truth.

    Args:
        start: first guess of the trajectory.
        knots: at which poses are estimated; of one chain alone the whole drive tells the headings.
        positions: of the antenna.
    """
    out: list[RecordedHeadings] = []
    for chain in knots.chains if len(knots.chains) > 1 else ():
        inside = (positions.t_s >= chain.begin_s) & (positions.t_s <= chain.end_s)
        en_m, middle_s = positions.xyz_m[inside, :2], np.array([0.5 * (chain.begin_s + chain.end_s)])
        sigma_deg = float(np.interp(middle_s[0], start.t_s, start.sigma[:, 5]))
        _, _, heading_deg = start.at(middle_s).attitude_deg()
        if len(en_m) and np.hypot(*np.ptp(en_m, axis=0)) < STANDS_WITHIN_M and np.isfinite(sigma_deg + heading_deg[0]):
            out.append(RecordedHeadings(middle_s, np.radians(90.0 - heading_deg), float(np.radians(sigma_deg))))
    return tuple(out)


def _add_yaws(
    equations: NormalEquations,
    knots: Knots,
    state: State,
    yaws: tuple[FloatArray, FloatArray],
    sigma_rad: float,
    axis: FloatArray = NOSE,
) -> None:
    """One equation for each yaw (m,) at a time (m,) that is known and inside the chains.

    The axis is interpolated between the knots; its error there is that at the knot before. Of a tilted vehicle, the
    direction of an axis that is not level depends on roll and pitch as well.
    """
    t_s, yaw_rad = yaws
    k, share, inside = knots.at(t_s)
    shown = inside & np.isfinite(yaw_rad)
    k, share = k[shown], share[shown, None]
    after = np.minimum(k + 1, len(state.rotation) - 1)
    x, y, z = ((1.0 - share) * (state.rotation[k] @ axis) + share * (state.rotation[after] @ axis)).T
    off = yaw_rad[shown] - np.arctan2(y, x)
    off = (off + np.pi) % (2 * np.pi) - np.pi
    level = x * x + y * y
    design = np.column_stack([-x * z / level, -y * z / level, np.ones(len(k))])
    first = k * state.layout.size + ROTATION
    for chosen in without_repeats(k):
        equations.add(first[chosen], design[chosen], off[chosen], np.full(len(chosen), sigma_rad))
