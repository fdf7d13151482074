"""Observations of GNSS: positions of an antenna, their slowly varying error, and headings, also of other devices."""

from dataclasses import dataclass, replace
from typing import Final, Self

import numpy as np
from numpy.typing import NDArray

from furrowmap.core.adjustment.banded import NormalEquations, huber_weight
from furrowmap.core.adjustment.knots import (
    GNSS_DRIFT,
    KNOT_STEP_S,
    POSITION_COLUMN,
    ROTATION,
    Knots,
    Observation,
    State,
)
from furrowmap.core.runtime import arrays
from furrowmap.core.runtime.arrays import FloatArray, IntArray
from furrowmap.core.values.gnss import DRIFT_CORRELATION_S, Positions
from furrowmap.core.values.trajectory import Trajectory

ANTENNA_HEADING_CORRELATION_S: Final = 10.0
ANTENNA_HEADING_SIGMA_RAD: Final = np.radians(0.5)
"""Of a two-antenna heading, whose error lasts for ANTENNA_HEADING_CORRELATION_S."""
STANDS_WITHIN_M: Final = 1.0
"""An antenna that moves by less shows no heading: it sways, or the vehicle turns about its axle."""
LASTING_TIMES: Final = 1.5
"""Standard deviation at the begin of a run, over that of the next position, from which on an error lasts."""
MAX_HEADING_GAP_S: Final = 1.0
"""Recorded headings further apart are not interpolated."""


@dataclass(frozen=True)
class AntennaPositions(Observation):
    """Position = origin + rotation · lever arm + GNSS drift, with white noise; weights are robust (Huber).

    Attributes:
        positions: (m,) of the antenna; those outside all chains take no part.
        origin_m: (3,) local origin.
        weight: (m,) robust weights.
    """

    positions: Positions
    origin_m: FloatArray
    lever_m: FloatArray
    weight: FloatArray

    @classmethod
    def unweighted(cls, positions: Positions, origin_m: FloatArray, lever_m: FloatArray) -> "AntennaPositions":
        """All of them with their whole weight."""
        return cls(positions, origin_m, lever_m, np.ones(len(positions.t_s)))

    def add(self, equations: NormalEquations, knots: Knots, state: State) -> None:
        """Three equations for each position."""
        size = state.layout.size
        for part in arrays.parts(len(self.positions.t_s), arrays.ROWS_AT_ONCE // 4):
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
        k = k[inside]
        share = share[inside, None]
        size = state.layout.size
        drift = state.layout.column(GNSS_DRIFT)
        arm, residual = self._residuals(k, share, self.positions.xyz_m[part][inside], state)
        sigma = self.positions.white_m[part][inside] / np.sqrt(self.weight[part][inside, None])
        design = np.zeros((len(k), 3, 2 * size))
        for first, weight in ((0, 1.0 - share[:, 0]), (size, share[:, 0])):
            for axis in range(3):
                one = (axis + 1) % 3
                two = (axis + 2) % 3
                design[:, axis, first + POSITION_COLUMN + axis] = weight
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

    def errors_m(self, knots: Knots, state: State) -> FloatArray:
        """(m, 3) errors of the positions at the poses, slow ones included; nan outside all chains."""
        return self.residuals_m(knots, replace(state, added=np.zeros_like(state.added)))

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


@dataclass(frozen=True)
class GnssDrift(Observation):
    """First-order Gauss-Markov process of each axis, anew with each run of equal quality; a larger begin of one lasts.

    Attributes:
        correlation_s: time over which it changes.
    """

    positions: Positions
    correlation_s: float = DRIFT_CORRELATION_S

    def add(self, equations: NormalEquations, knots: Knots, state: State) -> None:
        """The process from knot to knot, and its variance at the start of each run."""
        p = self.positions
        size = state.layout.size
        drift = state[GNSS_DRIFT]
        nearest = np.clip(np.searchsorted(p.t_s, knots.t_s), 0, len(p.t_s) - 1)
        linked = knots.linked
        on = linked[p.run[nearest[linked]] == p.run[nearest[linked + 1]]]
        begins = np.ones(len(knots), np.bool_)
        begins[on + 1] = False
        starts = np.flatnonzero(begins)
        run = np.cumsum(begins) - 1
        kept = np.exp(-KNOT_STEP_S / self.correlation_s)
        for axis in range(3):
            column = state.layout.column(GNSS_DRIFT) + axis
            value = drift[:, axis]
            spread = p.drift_m[:, axis]
            first = spread[nearest[starts]]
            equations.add(starts * size + column, np.ones((len(starts), 1)), -value[starts], first)
            lasts = first > LASTING_TIMES * spread[np.minimum(nearest[starts] + 1, len(spread) - 1)]
            for part in arrays.parts(len(on)):
                same = on[part]
                share = np.where(lasts[run[same]], 1.0, kept)
                design = np.zeros((len(same), size + 1))
                design[:, 0] = -share
                design[:, size] = 1.0
                sigma = spread[nearest[same]] * np.sqrt(1.0 - kept**2)
                equations.add(same * size + column, design, share * value[same] - value[same + 1], sigma)


@dataclass(frozen=True)
class AntennaHeadings(Observation):
    """Yaw of the knot before each position that has one; its error's correlation is in the standard deviation."""

    positions: Positions

    def add(self, equations: NormalEquations, knots: Knots, state: State) -> None:
        """One equation for each heading."""
        t_s = self.positions.t_s[np.isfinite(self.positions.yaw_rad)]
        step_s = float(np.median(np.diff(t_s))) if len(t_s) > 1 else 1.0
        sigma = ANTENNA_HEADING_SIGMA_RAD * np.sqrt(max(1.0, ANTENNA_HEADING_CORRELATION_S / step_s))
        _add_yaws(equations, knots, state, (self.positions.t_s, self.positions.yaw_rad), float(sigma))


@dataclass(frozen=True)
class RecordedHeadings(Observation):
    """Direction of an axis of the vehicle over ground, in the knot before each time that has one.

    Attributes:
        t_s: (m,) UTC, increasing.
        yaw_rad: (m,) of the axis; nan where unknown.
        lasting_s: time over which the error is the same: infinite for that of a magnetometer.
        axis_rad: direction of the axis in the vehicle frame, from the nose to the left.
    """

    t_s: FloatArray
    yaw_rad: FloatArray
    sigma_rad: float
    lasting_s: float = np.inf
    axis_rad: float = 0.0

    def at(self, t_s: FloatArray) -> FloatArray:
        """Yaw of the nose of a level vehicle at times (n,); nan outside and in gaps of more than a second."""
        if len(self.t_s) < 2:
            return np.full(len(t_s), np.nan)
        after = np.clip(np.searchsorted(self.t_s, t_s), 1, len(self.t_s) - 1)
        known = (t_s >= self.t_s[0]) & (t_s <= self.t_s[-1])
        known &= self.t_s[after] - self.t_s[after - 1] <= MAX_HEADING_GAP_S
        return np.where(known, np.interp(t_s, self.t_s, np.unwrap(self.yaw_rad)) - self.axis_rad, np.nan)

    def add(self, equations: NormalEquations, knots: Knots, state: State) -> None:
        """One equation for each heading."""
        t_s = self.t_s[np.isfinite(self.yaw_rad)]
        step_s = float(np.median(np.diff(t_s))) if len(t_s) > 1 else 1.0
        alike = min(max(1.0, self.lasting_s / step_s), max(1.0, float(len(t_s))))
        sigma = self.sigma_rad * float(np.sqrt(alike))
        _add_yaws(equations, knots, state, (self.t_s, self.yaw_rad), sigma, self.axis_rad)


def headings_at_stands(start: Trajectory, knots: Knots, positions: Positions) -> tuple[RecordedHeadings, ...]:
    """The headings of a first guess for chains of scans during which the antenna hardly moves.

    What the vehicle drove before such a chain, and that it stood since, tells its heading; nothing in the chain does,
    and relief of the ground seen before only where poses are near the truth.

    Args:
        knots: at which poses are estimated; of one chain alone the whole drive tells the headings.
    """
    out: list[RecordedHeadings] = []
    for chain in knots.chains if len(knots.chains) > 1 else ():
        inside = (positions.t_s >= chain.begin_s) & (positions.t_s <= chain.end_s)
        en_m = positions.xyz_m[inside, :2]
        middle_s = np.array([0.5 * (chain.begin_s + chain.end_s)])
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
    axis_rad: float = 0.0,
) -> None:
    """One equation for each yaw (m,) at a time (m,) that is known and inside the chains.

    The axis is interpolated between the knots; its error there is that at the knot before. Of a tilted vehicle, the
    direction of an axis that is not level depends on roll and pitch as well.
    """
    t_s, yaw_rad = yaws
    axis = np.array([np.cos(axis_rad), np.sin(axis_rad), 0.0])
    k, share, inside = knots.at(t_s)
    shown = inside & np.isfinite(yaw_rad)
    k = k[shown]
    share = share[shown, None]
    after = np.minimum(k + 1, len(state.rotation) - 1)
    x, y, z = ((1.0 - share) * (state.rotation[k] @ axis) + share * (state.rotation[after] @ axis)).T
    off = yaw_rad[shown] - np.arctan2(y, x)
    off = (off + np.pi) % (2 * np.pi) - np.pi
    level = x * x + y * y
    design = np.column_stack([-x * z / level, -y * z / level, np.ones(len(k))])
    first = k * state.layout.size + ROTATION
    for chosen in without_repeats(k):
        equations.add(first[chosen], design[chosen], off[chosen], np.full(len(chosen), sigma_rad))
