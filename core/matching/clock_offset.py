"""Offset between the clocks of scanner and positions: a search for large ones, an estimate of small ones.

Where the vehicle turns or changes its speed, relief that several scans show is in one place only if the scans are
placed by the motion of their own time. The trajectory of another time has another speed or rate of turn, and blurs the
ground within a second. So offsets are tried one by one on short windows of scans. The measure is the correlation of the
heights of even and odd scans at the same place, as for the yaw ambiguity; upright returns are compared by the share
that both halves have in one place. Two offsets are compared in those windows in which their motions differ.

After the adjustment, poses that come late lie behind the antenna's positions by velocity times delay, whichever way the
vehicle drives; a lever arm that is off moves them along with the vehicle's axes; errors of positions lie in one
direction for a while. Ground seen in several directions of travel separates the three.
"""

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from furrowmap.core.adjustment.banded import BandedSolution
from furrowmap.core.adjustment.coarse import CoarseKnots, coarse_right
from furrowmap.core.adjustment.knots import KNOT_STEP_S, Knots, State
from furrowmap.core.adjustment.position_observations import AntennaPositions
from furrowmap.core.matching.placing import Sensor
from furrowmap.core.matching.returns import GroundReturns
from furrowmap.core.matching.walls import UprightReturns
from furrowmap.core.matching.yaw_ambiguity import (
    COUNT_GRID,
    HALVES_CELL_M,
    MAX_HALVES_RANGE_M,
    UPRIGHT_CELL_M,
    relief_of_scans,
    sum_of_halves,
    take_into_cell,
)
from furrowmap.core.runtime.arrays import FloatArray
from furrowmap.core.runtime.kernels import count_until, kernel
from furrowmap.core.values.clock import HOUR_S
from furrowmap.core.values.trajectory import Trajectory

CLOCK_WINDOWS: Final = 64
CLOCK_WINDOW_S: Final = 1.0
MIN_CLOCK_WINDOW_RETURNS: Final = 200
MAX_CLOCK_WINDOW_RETURNS: Final = 2_000
"""Returns of a window: fewer show nothing, more show the same."""
FIRST_LOOK_THIN: Final = 4
"""One return in so many, with which offsets are looked at first."""
MIN_FIRST_LOOK_SIGMAS: Final = 0.0
"""Standard deviations by which an offset must seem better then, to be looked at closely."""
MAX_CLOCK_OFFSET_S: Final = 30.0
CLOCK_STEP_S: Final = 0.3
"""Offsets tried: up to MAX_CLOCK_OFFSET_S in steps that the relief of a second still tells apart, then half hours."""
MAX_HALF_HOURS: Final = 28
CLOCK_FINE_STEP_S: Final = 0.05
"""Steps in which the best of them is refined."""
MIN_WINDOW_WAY_M: Final = 0.3
"""A motion that is shorter within a window blurs nothing: rings of the scanner's own pattern coincide."""
CLOCK_REACH_M: Final = 3.0
"""Distance at which a difference of headings counts as one of places."""
MIN_CLOCK_WINDOWS: Final = 8
CLOCK_CERTAIN_SIGMAS: Final = 4.5
CLOCK_SUSPECT_SIGMAS: Final = 2.5
"""Standard deviations of the mean over windows by which the best offset must be better than the stated one; from
CLOCK_SUSPECT_SIGMAS on it is tried where results contradict each other."""
CLOCK_UNIQUE_SIGMAS: Final = 2.0
"""The same, against the next best that is more than CLOCK_APART_S from it."""
CLOCK_APART_S: Final = 1.0
CLOCK_FLOOR_S: Final = 0.003
LEVER_FLOOR_M: Final = 0.01
"""No offset and no lever arm is known better."""
MIN_OFFSET_GAIN: Final = 50.0
"""Fall of the sum of squared normalised residuals from which an offset or a lever arm is off: seven sigmas."""
CAUSE_CLEAR_RATIO: Final = 1.5
"""One of the two is the cause if its gain is so many times that of the other."""
MIN_CLOCK_S: Final = 0.01
MIN_LEVER_M: Final = 0.03
"""Smaller errors are none that matter."""


@dataclass(frozen=True)
class ClockCandidate:
    """An offset with which the scans agree better.

    Attributes:
        clock_s: time by which the scanner's clock is ahead of the positions'.
        certain: whether it is certainly and uniquely better than the stated one.
    """

    clock_s: float
    certain: bool


def search_clock_offset(returns: GroundReturns, sensor: Sensor, start: Trajectory) -> ClockCandidate | None:
    """The offset of the clocks, if it is off by more than a turn or stop hides.

    Args:
        returns: of the ground, and upright ones.
        sensor: as it is mounted.
        start: first guess of the trajectory, by the clock of the positions.

    Returns:
        None where the stated clocks are as good as any other.
    """
    found = [_Trial.from_returns(source, sensor, start).best() for source in (returns, returns.upright)]
    return next((one for one in found if one is not None and one.certain), found[0] or found[1])


def motion_certainty(returns: GroundReturns, sensor: Sensor, stated: Trajectory, other: Trajectory) -> float:
    """Standard deviations by which scans agree better if placed by the second of two first guesses."""
    now = np.zeros(1)
    shown = []
    for start in (stated, other):
        trial = _Trial.from_returns(returns, sensor, start)
        known = np.isfinite(trial.ways(now)[:, :, 0])
        shown.append(trial.agreement(now, known))
    return float(_certainty(shown[1] - shown[0])[0]) if shown[0].size else -np.inf


@dataclass(frozen=True)
class _Trial:
    """Windows of scans, and how well halves agree in them if placed by the motion of another time.

    Attributes:
        motion: times, easting, northing, cosine and sine of the yaw at the trajectory's knots, (5, n).
        gaps_s: (m, 2) of the trajectory.
        windows: times (n,), places (n, 2), heights or none (n,), halves (n,) of the returns of each.
        cell_m: in which halves are compared.
    """

    motion: FloatArray
    gaps_s: FloatArray
    windows: tuple[tuple[FloatArray, FloatArray, FloatArray, NDArray[np.int64]], ...]
    cell_m: float

    @classmethod
    def from_returns(cls, source: GroundReturns | UprightReturns, sensor: Sensor, start: Trajectory) -> "_Trial":
        yaw = np.radians(90.0 - start.attitude_deg()[2])
        motion = np.stack([start.t_s, start.xyz_m[:, 0], start.xyz_m[:, 1], np.cos(yaw), np.sin(yaw)])
        ground = isinstance(source, GroundReturns)
        windows = []
        begins = np.linspace(source.t_s[0], source.t_s[-1] - CLOCK_WINDOW_S, CLOCK_WINDOWS) if len(source.t_s) else ()
        for begin_s in begins:
            first, last = np.searchsorted(source.t_s, (begin_s, begin_s + CLOCK_WINDOW_S)).tolist()
            part = slice(first, last, max(1, (last - first) // (2 * MAX_CLOCK_WINDOW_RETURNS)))
            place = sensor.corrected(source, part).astype(np.float64)
            near = np.hypot(place[:, 0], place[:, 1]) < MAX_HALVES_RANGE_M if ground else np.ones(len(place), np.bool_)
            if near.sum() < MIN_CLOCK_WINDOW_RETURNS:
                continue
            half = np.array(source.half[part], np.int64)[near]
            height = relief_of_scans(place[near], half) if ground else np.zeros(0)
            windows.append((np.array(source.t_s[part])[near], place[near, :2].copy(), height, half))
        return cls(motion, start.gaps_s, tuple(windows), HALVES_CELL_M if ground else UPRIGHT_CELL_M)

    def best(self) -> ClockCandidate | None:
        """The offset at which halves agree better than at zero."""
        if len(self.windows) < MIN_CLOCK_WINDOWS:
            return None
        steps = round(MAX_CLOCK_OFFSET_S / CLOCK_STEP_S)
        near = CLOCK_STEP_S * np.arange(-steps, steps + 1)
        far = 0.5 * HOUR_S * np.setdiff1d(np.arange(-MAX_HALF_HOURS, MAX_HALF_HOURS + 1), [0])
        offsets = np.concatenate([[0.0], np.setdiff1d(near, [0.0]), far])
        ways = self.ways(offsets)
        possible = np.hypot(ways[:, :, 0], ways[:, :, 1]) > MIN_WINDOW_WAY_M
        compared = possible & possible[:, :1] & self._differ(ways, ways[:, :1])
        worth = np.append(0, np.flatnonzero(self._better(offsets, compared, FIRST_LOOK_THIN) > MIN_FIRST_LOOK_SIGMAS))
        better = self._better(offsets[worth], compared[:, worth], 1)
        best = worth[int(np.argmax(better))]
        if better.max() < CLOCK_SUSPECT_SIGMAS:
            return None
        certain = bool(better.max() > CLOCK_CERTAIN_SIGMAS) and self._unique(offsets, ways, best, worth[better > 0.0])
        # A motion of later is that of the positions at the scans' true time.
        return ClockCandidate(-self._refined(float(offsets[best])), certain)

    def _better(self, offsets: FloatArray, compared: NDArray[np.bool_], every: int) -> FloatArray:
        """(k,) by how much offsets are better than the first one, where they are compared with it; see `_certainty`."""
        compared = compared.copy()
        compared[:, 0] = compared.any(axis=1)
        agreement = self.agreement(offsets, compared, every)
        return _certainty(agreement - agreement[:, :1])

    def _unique(self, offsets: FloatArray, ways: FloatArray, best: np.intp, others: NDArray[np.intp]) -> bool:
        """Whether the best offset is better than each of the others that are not next to it."""
        for other in others[np.abs(offsets[others] - offsets[best]) > CLOCK_APART_S]:
            pair = [other, best]
            compared = np.isfinite(ways[:, pair, 0]).all(axis=1) & self._differ(ways[:, other], ways[:, best])
            if self._better(offsets[pair], np.repeat(compared[:, None], 2, axis=1), 1)[1] < CLOCK_UNIQUE_SIGMAS:
                return False
        return True

    def ways(self, offsets: FloatArray) -> FloatArray:
        """(windows, offsets, 3) movement forward and to the left, and turn, within each; nan where they are unknown."""
        t_s, e, n, cos, sin = self.motion
        yaw = np.unwrap(np.arctan2(sin, cos))
        ends = np.array([(t[0], t[-1]) for t, *_ in self.windows])[:, None] + offsets[None, :, None]
        known = (ends[..., 0] >= t_s[0]) & (ends[..., 1] < t_s[-1])
        for begin_s, end_s in self.gaps_s:
            known &= (ends[..., 1] <= begin_s) | (ends[..., 0] >= end_s)
        de, dn, turn = (np.diff(np.interp(ends, t_s, v))[..., 0] for v in (e, n, yaw))
        course = np.interp(ends[..., 0], t_s, yaw)
        way = np.stack([np.cos(course) * de + np.sin(course) * dn, np.cos(course) * dn - np.sin(course) * de, turn], -1)
        return np.where(known[..., None], way, np.nan)

    def _differ(self, one: FloatArray, other: FloatArray) -> NDArray[np.bool_]:
        """Whether two motions would place a return at CLOCK_REACH_M in different cells."""
        apart = one - other
        out: NDArray[np.bool_] = (
            np.hypot(np.hypot(apart[..., 0], apart[..., 1]), CLOCK_REACH_M * apart[..., 2]) > self.cell_m
        )
        return out

    def agreement(self, offsets: FloatArray, wanted: NDArray[np.bool_], every: int = 1) -> FloatArray:
        """(windows, offsets) agreement of halves where it is wanted, by every so manyth return; nan elsewhere."""
        out = np.full(wanted.shape, np.nan)
        count = np.zeros((2, COUNT_GRID, COUNT_GRID), np.int64)
        total = np.zeros((2, COUNT_GRID, COUNT_GRID))
        for row, window in enumerate(self.windows):
            t_s, place, height, half = (np.ascontiguousarray(values[::every]) for values in window)
            these = np.flatnonzero(wanted[row])
            out[row, these] = agreement_at(
                t_s, place, height, half, self.motion, offsets[these], 1.0 / self.cell_m, count, total
            )
        return out

    def _refined(self, offset_s: float) -> float:
        """The offset near a coarse one at which halves agree best, by the parabola through three."""
        steps = round(CLOCK_STEP_S / CLOCK_FINE_STEP_S) + 2
        offsets: FloatArray = offset_s + CLOCK_FINE_STEP_S * np.arange(-steps, steps + 1, dtype=np.float64)
        known = np.asarray(np.isfinite(self.ways(offsets)[:, :, 0]).all(axis=1))
        mean = np.nanmean(self.agreement(offsets, np.tile(known[:, None], len(offsets))), axis=0)
        best = int(np.clip(np.argmax(mean), 1, len(mean) - 2))
        left, middle, right = mean[best - 1 : best + 2]
        curve = left - 2.0 * middle + right
        return float(offsets[best] + (0.5 * CLOCK_FINE_STEP_S * (left - right) / curve if curve < 0.0 else 0.0))


def _certainty(better: FloatArray) -> FloatArray:
    """(k,) mean over windows of (n, k) differences, in standard deviations; −inf where too few windows differ."""
    known = np.isfinite(better)
    count = np.maximum(known.sum(axis=0), 1)
    mean = np.where(known, better, 0.0).sum(axis=0) / count
    scatter = np.where(known, (better - mean) ** 2, 0.0).sum(axis=0) / np.maximum(count - 1, 1)
    return np.where(count >= MIN_CLOCK_WINDOWS, mean / np.sqrt(scatter / count + 1e-12), -np.inf)


@kernel()
def agreement_at(t_s, place_m, height_m, half, motion, offsets, per_m, count, total):  # type: ignore[no-untyped-def]
    """(k,) agreement of both halves of returns, placed by the motion `offsets` (k,) after their own time.

    With heights (n,) it is their correlation over places that both halves have; without, the share of the returns at
    such places. `count` and `total` (2, COUNT_GRID, COUNT_GRID) are zero, and are left so.
    """
    n = len(t_s)
    knot_s = motion[0]
    last = len(knot_s) - 2
    mask = count.shape[1] - 1
    touched = np.empty((n, 2), np.int64)
    out = np.empty(len(offsets))
    for number in range(len(offsets)):
        used = 0
        k = min(max(count_until(knot_s, t_s[0] + offsets[number]) - 1, 0), last)
        for i in range(n):
            t = t_s[i] + offsets[number]
            while k < last and knot_s[k + 1] <= t:
                k += 1
            share = (t - knot_s[k]) / (knot_s[k + 1] - knot_s[k])
            e = motion[1, k] + share * (motion[1, k + 1] - motion[1, k])
            north = motion[2, k] + share * (motion[2, k + 1] - motion[2, k])
            cos = motion[3, k] + share * (motion[3, k + 1] - motion[3, k])
            sin = motion[4, k] + share * (motion[4, k + 1] - motion[4, k])
            a = int(np.floor((e + cos * place_m[i, 0] - sin * place_m[i, 1]) * per_m)) & mask
            b = int(np.floor((north + sin * place_m[i, 0] + cos * place_m[i, 1]) * per_m)) & mask
            height = height_m[i] if len(height_m) else 0.0
            used = take_into_cell(a, b, half[i], height, touched, used, count, total)
        product, squares, both = sum_of_halves(touched, used, count, total)
        out[number] = (product / squares if squares > 0.0 else 0.0) if len(height_m) else 2.0 * both / n
    return out


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
        matters = abs(self.clock_s) > MIN_CLOCK_S or np.hypot(*self.lever_m) > MIN_LEVER_M
        return bool(matters and max(self.clock_gain, self.lever_gain) > MIN_OFFSET_GAIN)

    @property
    def clock_off(self) -> bool:
        """Whether that is the clocks, which explain the residuals better than a lever arm does."""
        return self.off and self.clock_gain > CAUSE_CLEAR_RATIO * self.lever_gain

    @property
    def lever_off(self) -> bool:
        """Whether that is the lever arm, which explains the residuals better than the clocks do."""
        return self.off and self.lever_gain > CAUSE_CLEAR_RATIO * self.clock_gain


def antenna_constants(
    knots: Knots,
    state: State,
    antenna: AntennaPositions,
    coarse: CoarseKnots,
    centre_m: FloatArray,
    solution: BandedSolution,
) -> AntennaConstants:
    """The constants by the residuals of the positions, all other unknowns eliminated (Schur complement).

    Without that, drift and trajectory take most of an offset.

    Args:
        antenna: positions, with robust weights.
        centre_m: see :meth:`~furrowmap.core.adjustment.coarse.CoarseKnots.centres`.
        solution: of the equations of the coarse knots with free references.
    """
    k, design, residual, sigma = antenna.linearised(knots, state)
    if not len(k):
        return AntennaConstants()
    place = state.xyz_m + state.rotation @ antenna.lever_m
    size = state.layout.size
    velocity = (place[k + 1] - place[k]) / KNOT_STEP_S
    own = np.concatenate([velocity[:, :, None], state.rotation[k][:, :, :2]], axis=2)
    weighted = own / sigma[:, :, None] ** 2
    by_knots = np.einsum("mas,maq->qms", design, weighted)
    links = []
    solved = []
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
    sigmas = np.hypot(np.sqrt(np.diag(lever_covariance)), LEVER_FLOOR_M)
    return AntennaConstants(
        clock_s=float(pull[0] / normal[0, 0]),
        clock_sigma_s=float(np.hypot(1.0 / np.sqrt(normal[0, 0]), CLOCK_FLOOR_S)),
        clock_gain=float(pull[0] ** 2 / normal[0, 0]),
        lever_m=(float(lever[0]), float(lever[1])),
        lever_sigma_m=(float(sigmas[0]), float(sigmas[1])),
        lever_gain=float(pull[1:] @ lever),
    )
