"""Search for a large offset between the clocks of scanner and positions: seconds, leap seconds, whole hours.

Where the vehicle turns or changes its speed, relief that several scans show is in one place only if the scans are
placed by the motion of their own time. The trajectory of another time has another speed or rate of turn, and blurs the
ground within a second. So offsets are tried one by one on short windows of scans. The measure is the correlation of the
heights of even and odd scans at the same place, as for the yaw ambiguity; upright returns are compared by the share
that both halves have in one place. Two offsets are compared in those windows in which their motions differ.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numba
import numpy as np
from numpy.typing import NDArray

from furrowmap.core.adjustment.yaw_ambiguity import CELL_M, NEAR_M, STANDING_CELL_M, relief_of_scans
from furrowmap.core.matching.placing import Sensor
from furrowmap.core.matching.returns import GroundReturns
from furrowmap.core.matching.walls import UprightReturns
from furrowmap.core.runtime.arrays import FloatArray
from furrowmap.core.values.clock import HOUR_S
from furrowmap.core.values.trajectory import Trajectory

WINDOWS: Final = 64
WINDOW_S: Final = 1.0
LEAST_RETURNS: Final = 200
MOST_RETURNS: Final = 2_000
"""Returns of a window: fewer show nothing, more show the same."""
GLANCE: Final = 4
"""One return in so many, with which offsets are looked at first."""
WORTH: Final = 0.0
"""Standard deviations by which an offset must seem better then, to be looked at closely."""
MOST_S: Final = 30.0
STEP_S: Final = 0.3
"""Offsets tried: up to MOST_S in steps that the relief of a second still tells apart, and then whole half hours."""
MOST_HALF_HOURS: Final = 28
FINE_S: Final = 0.05
"""Steps in which the best of them is refined."""
LEAST_WAY_M: Final = 0.3
"""A motion that is shorter within a window blurs nothing: rings of the scanner's own pattern coincide."""
REACH_M: Final = 3.0
"""Distance at which a difference of headings counts as one of places."""
LEAST_WINDOWS: Final = 8
CERTAIN: Final = 4.5
SUSPECT: Final = 2.5
"""Standard deviations of the mean over windows by which the best offset must be better than the stated one; from
SUSPECT on it is tried where results contradict each other."""
UNIQUE: Final = 2.0
"""The same, against the next best that is more than APART_S from it."""
APART_S: Final = 1.0
GRID: Final = 256
"""Cells along a side of the grid on which returns are counted; places further apart share a cell."""


@dataclass(frozen=True)
class Candidate:
    """An offset with which the scans agree better.

    Attributes:
        clock_s: time by which the scanner's clock is ahead of the positions'.
        certain: whether it is certainly and uniquely better than the stated one.
    """

    clock_s: float
    certain: bool


def searched_clock_offset(returns: GroundReturns, sensor: Sensor, start: Trajectory) -> Candidate | None:
    """The offset of the clocks, if it is off by more than a turn or stop hides.

    Args:
        returns: of the ground, and upright ones.
        sensor: as it is mounted.
        start: first guess of the trajectory, by the clock of the positions.

    Returns:
        None where the stated clocks are as good as any other.
    """
    found = [_Trial.of(source, sensor, start).best() for source in (returns, returns.upright)]
    return next((one for one in found if one is not None and one.certain), found[0] or found[1])


def motion_certainty(returns: GroundReturns, sensor: Sensor, stated: Trajectory, other: Trajectory) -> float:
    """Standard deviations by which scans agree better if placed by the second of two first guesses."""
    now = np.zeros(1)
    shown = []
    for start in (stated, other):
        trial = _Trial.of(returns, sensor, start)
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
    def of(cls, source: GroundReturns | UprightReturns, sensor: Sensor, start: Trajectory) -> _Trial:
        yaw = np.radians(90.0 - start.attitude_deg()[2])
        motion = np.stack([start.t_s, start.xyz_m[:, 0], start.xyz_m[:, 1], np.cos(yaw), np.sin(yaw)])
        ground = isinstance(source, GroundReturns)
        windows = []
        begins = np.linspace(source.t_s[0], source.t_s[-1] - WINDOW_S, WINDOWS) if len(source.t_s) else ()
        for begin_s in begins:
            first, last = np.searchsorted(source.t_s, (begin_s, begin_s + WINDOW_S)).tolist()
            part = slice(first, last, max(1, (last - first) // (2 * MOST_RETURNS)))
            place = sensor.corrected(source, part).astype(np.float64)
            near = np.hypot(place[:, 0], place[:, 1]) < NEAR_M if ground else np.ones(len(place), np.bool_)
            if near.sum() < LEAST_RETURNS:
                continue
            half = np.array(source.half[part], np.int64)[near]
            height = relief_of_scans(place[near], half) if ground else np.zeros(0)
            windows.append((np.array(source.t_s[part])[near], place[near, :2].copy(), height, half))
        return cls(motion, start.gaps_s, tuple(windows), CELL_M if ground else STANDING_CELL_M)

    def best(self) -> Candidate | None:
        """The offset at which halves agree better than at zero."""
        if len(self.windows) < LEAST_WINDOWS:
            return None
        steps = round(MOST_S / STEP_S)
        near = STEP_S * np.arange(-steps, steps + 1)
        far = 0.5 * HOUR_S * np.setdiff1d(np.arange(-MOST_HALF_HOURS, MOST_HALF_HOURS + 1), [0])
        offsets = np.concatenate([[0.0], np.setdiff1d(near, [0.0]), far])
        ways = self.ways(offsets)
        possible = np.hypot(ways[:, :, 0], ways[:, :, 1]) > LEAST_WAY_M
        compared = possible & possible[:, :1] & self._differ(ways, ways[:, :1])
        worth = np.append(0, np.flatnonzero(self._better(offsets, compared, GLANCE) > WORTH))
        better = self._better(offsets[worth], compared[:, worth], 1)
        best = worth[int(np.argmax(better))]
        if better.max() < SUSPECT:
            return None
        certain = bool(better.max() > CERTAIN) and self._unique(offsets, ways, best, worth[better > 0.0])
        # A motion of later is that of the positions at the scans' true time.
        return Candidate(-self._refined(float(offsets[best])), certain)

    def _better(self, offsets: FloatArray, compared: NDArray[np.bool_], every: int) -> FloatArray:
        """(k,) by how much offsets are better than the first one, where they are compared with it; see `_certainty`."""
        compared = compared.copy()
        compared[:, 0] = compared.any(axis=1)
        agreement = self.agreement(offsets, compared, every)
        return _certainty(agreement - agreement[:, :1])

    def _unique(self, offsets: FloatArray, ways: FloatArray, best: np.intp, others: NDArray[np.intp]) -> bool:
        """Whether the best offset is better than each of the others that are not next to it."""
        for other in others[np.abs(offsets[others] - offsets[best]) > APART_S]:
            pair = [other, best]
            compared = np.isfinite(ways[:, pair, 0]).all(axis=1) & self._differ(ways[:, other], ways[:, best])
            if self._better(offsets[pair], np.repeat(compared[:, None], 2, axis=1), 1)[1] < UNIQUE:
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
        """Whether two motions would place a return at REACH_M in different cells."""
        apart = one - other
        out: NDArray[np.bool_] = np.hypot(np.hypot(apart[..., 0], apart[..., 1]), REACH_M * apart[..., 2]) > self.cell_m
        return out

    def agreement(self, offsets: FloatArray, wanted: NDArray[np.bool_], every: int = 1) -> FloatArray:
        """(windows, offsets) agreement of halves where it is wanted, by every so manyth return; nan elsewhere."""
        out = np.full(wanted.shape, np.nan)
        count, total = np.zeros((2, GRID, GRID), np.int64), np.zeros((2, GRID, GRID))
        for row, window in enumerate(self.windows):
            t_s, place, height, half = (values[::every] for values in window)
            these = np.flatnonzero(wanted[row])
            out[row, these] = agreement_at(
                t_s, place, height, half, self.motion, offsets[these], 1.0 / self.cell_m, count, total
            )
        return out

    def _refined(self, offset_s: float) -> float:
        """The offset near a coarse one at which halves agree best, by the parabola through three."""
        steps = round(STEP_S / FINE_S) + 2
        offsets: FloatArray = offset_s + FINE_S * np.arange(-steps, steps + 1, dtype=np.float64)
        known = np.asarray(np.isfinite(self.ways(offsets)[:, :, 0]).all(axis=1))
        mean = np.nanmean(self.agreement(offsets, np.tile(known[:, None], len(offsets))), axis=0)
        best = int(np.clip(np.argmax(mean), 1, len(mean) - 2))
        left, middle, right = mean[best - 1 : best + 2]
        curve = left - 2.0 * middle + right
        return float(offsets[best] + (0.5 * FINE_S * (left - right) / curve if curve < 0.0 else 0.0))


def _certainty(better: FloatArray) -> FloatArray:
    """(k,) mean over windows of (n, k) differences, in standard deviations; −inf where too few windows differ."""
    known = np.isfinite(better)
    count = np.maximum(known.sum(axis=0), 1)
    mean = np.where(known, better, 0.0).sum(axis=0) / count
    scatter = np.where(known, (better - mean) ** 2, 0.0).sum(axis=0) / np.maximum(count - 1, 1)
    return np.where(count >= LEAST_WINDOWS, mean / np.sqrt(scatter / count + 1e-12), -np.inf)


@numba.njit(cache=True, nogil=True)
def agreement_at(t_s, place_m, height_m, half, motion, offsets, per_m, count, total):  # type: ignore[no-untyped-def]
    """(k,) agreement of both halves of returns, placed by the motion `offsets` (k,) after their own time.

    With heights (n,) it is their correlation over places that both halves have; without, the share of the returns at
    such places. `count` and `total` (2, GRID, GRID) are zero, and are left so.
    """
    n = len(t_s)
    knot_s = motion[0]
    last = len(knot_s) - 2
    mask = count.shape[1] - 1
    touched = np.empty((n, 2), np.int64)
    out = np.empty(len(offsets))
    for number in range(len(offsets)):
        used = 0
        k = min(max(np.searchsorted(knot_s, t_s[0] + offsets[number], side="right") - 1, 0), last)
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
            if count[0, a, b] == 0 and count[1, a, b] == 0:
                touched[used, 0], touched[used, 1] = a, b
                used += 1
            count[half[i], a, b] += 1
            if len(height_m):
                total[half[i], a, b] += height_m[i]
        product = squares = together = 0.0
        for i in range(used):
            a, b = touched[i]
            both = min(count[0, a, b], count[1, a, b])
            if both > 0:
                one, other = total[0, a, b] / count[0, a, b], total[1, a, b] / count[1, a, b]
                product += both * one * other
                squares += 0.5 * both * (one * one + other * other)
                together += 2.0 * both
            for layer in range(2):
                count[layer, a, b] = 0
                total[layer, a, b] = 0.0
        out[number] = (product / squares if squares > 0.0 else 0.0) if len(height_m) else together / n
    return out
