"""Moving or standing, forward or reverse, and how far: a vehicle's motion from positions alone."""

import math
from dataclasses import dataclass
from itertools import pairwise
from typing import Final

import numpy as np
from numpy.typing import NDArray

from furrowmap.core.runtime.arrays import FloatArray
from furrowmap.core.values.trajectory import Motion, Trajectory

IntArray = NDArray[np.intp]

STANDING_MPS: Final = 0.03
"""Nakagawa et al., section 2: below 3 cm/s of RTK positions a tractor stands."""
HYSTERESIS: Final = 1.6
"""A stand begins below the threshold divided by this and ends above the threshold times this."""
STAND_REACH_M: Final = 0.015
"""A stand lasts as long as positions stay this near to its own mean."""
MIN_STAND_S: Final = 0.4
HALF_WINDOW_S: Final = 0.5
"""Half the window of a velocity: over one epoch 3 cm/s is below the noise, over a second it is not."""
VELOCITY_SIGMA_MPS: Final = 0.01
"""The window grows until white noise in positions leaves velocities this good, so that 3 cm/s can be detected."""
MAX_HALF_WINDOW_S: Final = 5.0
CERTAIN_WAY_M: Final = 10.0
CERTAIN_SHARE: Final = 0.2
"""Nobody reverses this far at a stretch, or for nearly half of the way."""
MIN_PATH_STEP_M: Final = 0.1
MAX_GAP_S: Final = 1.0
GAP_ARC: Final = 0.4
"""A gap through which a vehicle drove without turning back ends this near to an arc's end, as a share of its length."""


def longest_gap_s(t_s: FloatArray) -> float:
    """Knots or positions further apart than this are not interpolated: a second, or two and a half usual steps."""
    return max(MAX_GAP_S, 2.5 * float(np.median(np.diff(t_s))))


@dataclass(frozen=True)
class Motions:
    """How the vehicle moved at each position.

    Attributes:
        motion: (n,) int8, values of :class:`Motion`.
        velocity_mps: (n, 2) of the antenna, east and north, over a window around each position.
        stretch: (n,) counts the stretches of equal motion without a gap inside.
        doubtful: stretches of motion whose direction rests on 'mostly forward' alone, as (first, last) index.
    """

    motion: NDArray[np.int8]
    velocity_mps: FloatArray
    stretch: IntArray
    doubtful: tuple[tuple[int, int], ...]


def find_motion(
    t_s: FloatArray, en_m: FloatArray, white_m: float, max_gap_s: float, run: IntArray | None = None
) -> Motions:
    """Tell moving from standing and forward from reverse.

    Standing is a low speed over a window, with hysteresis, refined to where positions leave the stand's own mean.
    Where the course turns round by more than a right angle while the vehicle (nearly) stands, the direction of motion
    changed, because a vehicle on wheels cannot turn on the spot. Which of the two directions is forward is decided by
    the longer way, separately for parts that no continuous motion connects.

    Args:
        en_m: (n, 2) easting and northing of the antenna.
        white_m: standard deviation of the noise from position to position.
        max_gap_s: a longer pause between positions is a gap.
        run: (n,) counts the runs of equal quality: positions step from one to the next, which is no movement.
    """
    segment: IntArray = np.cumsum(np.diff(t_s, prepend=t_s[:1]) > max_gap_s, dtype=np.intp)
    step_s = float(np.median(np.diff(t_s))) if len(t_s) > 1 else 1.0
    # A straight-line fit over N positions leaves a velocity of variance 12 σ_white² / (N³ step²).
    positions = (12.0 * (white_m / (VELOCITY_SIGMA_MPS * step_s)) ** 2) ** (1.0 / 3.0)
    half_s = float(np.clip(positions * step_s / 2.0, max(HALF_WINDOW_S, step_s), MAX_HALF_WINDOW_S))
    steady = segment
    if run is not None:
        steady = np.cumsum((np.diff(segment, prepend=0) != 0) | (np.diff(run, prepend=run[:1]) != 0))
    velocity = local_velocity(t_s, en_m, steady, half_s)
    speed = np.hypot(velocity[:, 0], velocity[:, 1])
    standing = _stands(t_s, en_m, speed, steady, white_m)
    moving_runs = _runs(np.where(standing, -1, segment), keep=~standing)
    legs = [leg for run in moving_runs for leg in _split_at_cusps(velocity, speed, run)]
    sign, doubtful = _directions(t_s, en_m, velocity, segment, legs)
    motion = np.zeros(len(t_s), np.int8)
    for (first, last), direction in zip(legs, sign, strict=True):
        motion[first : last + 1] = direction
    change = (np.diff(motion, prepend=motion[:1]) != 0) | (np.diff(segment, prepend=segment[:1]) != 0)
    return Motions(motion, velocity, np.cumsum(change), doubtful)


def local_velocity(t_s: FloatArray, en_m: FloatArray, segment: IntArray, half_s: float) -> FloatArray:
    """Velocities (n, 2) by straight-line fits to the positions within `half_s` of each and in its segment (n,)."""
    n = len(t_s)
    sums = np.zeros((n, 7))  # 1, t, t², e, n, t·e, t·n relative to the position in the middle
    step_s = float(np.median(np.diff(t_s))) if n > 1 else 1.0
    reach = min(n - 1, int(np.ceil(half_s / step_s)) + 1)
    for k in range(-reach, reach + 1):
        here = np.arange(max(0, -k), min(n, n - k))
        dt = t_s[here + k] - t_s[here]
        near = (np.abs(dt) <= half_s * 1.0001) & (segment[here + k] == segment[here])
        here = here[near]
        dt = dt[near]
        d = en_m[here + k] - en_m[here]
        one = np.ones(len(here))
        sums[here] += np.column_stack([one, dt, dt * dt, d[:, 0], d[:, 1], dt * d[:, 0], dt * d[:, 1]])
    count = sums[:, 0]
    st = sums[:, 1]
    stt = sums[:, 2]
    spread = count * stt - st * st
    safe = np.where(spread > 1e-9, spread, 1.0)
    slope = (count[:, None] * sums[:, 5:7] - st[:, None] * sums[:, 3:5]) / safe[:, None]
    return np.where((spread > 1e-9)[:, None], slope, 0.0)


def length_m(en_m: FloatArray) -> float:
    """Length of a path (n, 2) in steps of at least :data:`MIN_PATH_STEP_M` and on to its end: noise adds no way."""
    path = en_m.tolist()
    length = 0.0
    last = path[0]
    for position in path[1:]:
        step = math.dist(position, last)
        if step >= MIN_PATH_STEP_M:
            length = length + step
            last = position
    return length + math.dist(path[-1], last)


def _stands(
    t_s: FloatArray, en_m: FloatArray, speed_mps: FloatArray, segment: IntArray, white_m: float
) -> NDArray[np.bool_]:
    """Where the vehicle stands, (n,)."""
    slow = speed_mps < STANDING_MPS * HYSTERESIS
    sure = speed_mps < STANDING_MPS / HYSTERESIS
    standing = np.zeros(len(t_s), bool)

    def is_near(mean: FloatArray, at: int) -> bool:
        return bool(np.hypot(*(en_m[at] - mean)) <= max(STAND_REACH_M, 3.0 * white_m))

    for first, last in _runs(np.where(slow, segment, -1), keep=slow):
        if not sure[first : last + 1].any():
            continue
        mean = np.median(en_m[first : last + 1][sure[first : last + 1]], axis=0)
        # The window blurs the ends of a stand: positions show better where it began and ended.
        while first > 0 and segment[first - 1] == segment[first] and is_near(mean, first - 1):
            first -= 1
        while last + 1 < len(t_s) and segment[last + 1] == segment[last] and is_near(mean, last + 1):
            last += 1
        if t_s[last] - t_s[first] >= MIN_STAND_S:
            standing[first : last + 1] = True
    return standing


def _runs(label: IntArray, keep: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """(first, last) of the runs of equal labels where `keep`."""
    if not len(label):
        return []
    starts = np.flatnonzero(np.diff(label, prepend=label[0] - 1) != 0)
    ends = np.append(starts[1:], len(label)) - 1
    return [(int(a), int(b)) for a, b in zip(starts, ends, strict=True) if keep[a]]


def _split_at_cusps(velocity: FloatArray, speed: FloatArray, run: tuple[int, int]) -> list[tuple[int, int]]:
    """Cut a moving run at minima of the speed where the velocity turns by more than a right angle without a stand."""
    first, last = run
    fast = np.flatnonzero(speed[first : last + 1] > 2 * STANDING_MPS) + first
    back = np.flatnonzero(np.einsum("ij,ij->i", velocity[fast[:-1]], velocity[fast[1:]]) < 0)
    cuts = [int(a + np.argmin(speed[a : b + 1])) for a, b in zip(fast[back], fast[back + 1], strict=True)]
    edges = [first, *(c + 1 for c in cuts), last + 1]
    return [(a, b - 1) for a, b in pairwise(edges) if b > a]


def _directions(
    t_s: FloatArray, en_m: FloatArray, velocity: FloatArray, segment: IntArray, legs: list[tuple[int, int]]
) -> tuple[list[int], tuple[tuple[int, int], ...]]:
    """+1 or −1 for each leg of continuous motion, and the parts in which the longer path alone decides."""
    sign: list[int] = []
    groups: list[list[int]] = []
    for i, leg in enumerate(legs):
        link = _link(t_s, en_m, velocity, segment, legs[i - 1], leg) if i else 0
        if link == 0:
            sign.append(1)
            groups.append([i])
        else:
            sign.append(sign[-1] * link)
            groups[-1].append(i)
    doubtful = []
    for group in groups:
        way = [length_m(en_m[legs[i][0] : legs[i][1] + 1]) for i in group]
        forward = sum(w * sign[i] for w, i in zip(way, group, strict=True))
        if forward < 0:
            for i in group:
                sign[i] = -sign[i]
        if sum(way) < CERTAIN_WAY_M or abs(forward) < CERTAIN_SHARE * sum(way):
            doubtful.append((legs[group[0]][0], legs[group[-1]][1]))
    return sign, tuple(doubtful)


def _link(
    t_s: FloatArray,
    en_m: FloatArray,
    velocity: FloatArray,
    segment: IntArray,
    before: tuple[int, int],
    after: tuple[int, int],
) -> int:
    """+1 if a leg goes on in the direction of the one before, −1 if it turns back, 0 if that is unknown."""
    v_before = velocity[_away_from_end(en_m, before, -1)]
    v_after = velocity[_away_from_end(en_m, after, 0)]
    if segment[before[1]] == segment[after[0]]:
        return 1 if v_before @ v_after >= 0 else -1
    # Across a gap the vehicle may have shifted gears unseen, as in a turn: forward, back and forward again. It went on
    # where it was moving at both ends, and came out where an arc between the two courses at these speeds ends.
    ends = int(np.flatnonzero(segment == segment[before[1]])[-1]), int(np.flatnonzero(segment == segment[after[0]])[0])
    if ends != (before[1], after[0]):
        return 0
    way_m = 0.5 * (np.hypot(*velocity[before[1]]) + np.hypot(*velocity[after[0]])) * (t_s[after[0]] - t_s[before[1]])
    chord = en_m[after[0]] - en_m[before[1]]
    begins, ends_rad = (math.atan2(course[1], course[0]) for course in (velocity[before[1]], velocity[after[0]]))
    turn = (ends_rad - begins + math.pi) % math.tau - math.pi
    middle = begins + 0.5 * turn
    arc = float(np.sinc(0.5 * turn / math.pi)) * np.array([math.cos(middle), math.sin(middle)])
    off_m = np.hypot(*(chord - arc * way_m))
    return 1 if way_m > 0.2 and off_m < GAP_ARC * way_m else 0


def _away_from_end(en_m: FloatArray, leg: tuple[int, int], end: int) -> int:
    """Index nearest to a leg's end (0 or −1) a decimetre away from it: nearer, the velocity means little."""
    away = np.flatnonzero(np.hypot(*(en_m[leg[0] : leg[1] + 1] - en_m[leg[end]]).T) > 0.1)
    return leg[0] + int(away[end]) if len(away) else (leg[0] + leg[1]) // 2


def distance_and_standing(trajectory: Trajectory, begin_s: float, end_s: float) -> tuple[float, float]:
    """Distance driven (m) and time at a standstill (s) within a span, at the trajectory's own knots, without gaps."""
    inside = (trajectory.t_s > begin_s) & (trajectory.t_s < end_s)
    t_s = np.concatenate([[begin_s], trajectory.t_s[inside], [end_s]])
    before, share, known = trajectory.interval(t_s)
    t_s = t_s[known]
    nearest = (before + (share > 0.5))[known]
    if not len(t_s):
        return 0.0, 0.0
    en_m = trajectory.at(t_s).xyz_m[:, :2]
    standing = trajectory.motion[nearest] == Motion.STANDING
    step_s = np.diff(t_s)
    gap = step_s > trajectory.max_gap_s
    still = standing[1:] & standing[:-1]
    drives = np.split(en_m, np.flatnonzero(gap | still) + 1)
    return sum(length_m(drive) for drive in drives), float(step_s[still & ~gap].sum())
