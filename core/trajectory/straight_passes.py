"""The strips of a flight: the parts of a trajectory that lead straight on, without the turns between them."""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy.ndimage import uniform_filter1d

from furrowmap.core.runtime.arrays import FloatArray
from furrowmap.core.runtime.kernels import kernel
from furrowmap.core.values.trajectory import Trajectory

STRIP_STEP_S: Final = 0.1
SMOOTH_S: Final = 1.5
"""The course is that of the mean velocity of so long: gusts push an aircraft aside for shorter."""
MAX_COURSE_OFF_RAD: Final = math.radians(15.0)
"""The course stays this near to the middle of its range all along a strip."""
MIN_SPEED_SHARE: Final = 0.3
"""Below this share of the median speed an aircraft hovers or turns about."""
MIN_STRIP_S: Final = 3.0
MIN_STRIP_M: Final = 5.0
"""Shorter parts are of a turn."""
MIN_ARC_SHARE: Final = 0.5
"""Neighbours of an arc above this share of its turn rate join the arc."""
MAX_STRIP_PAUSE_S: Final = 3.0
"""Parts of one direction that follow each other within this time are one strip: a gust parted them."""


@dataclass(frozen=True)
class Strip:
    """One straight pass of a flight.

    Attributes:
        heading_deg: direction of flight, clockwise from grid north, 0 to 360.
        length_m: from its first to its last place.
        speed_mps: its length by its duration.
    """

    number: int
    begin_s: float
    end_s: float
    heading_deg: float
    length_m: float
    speed_mps: float


def find_strips(trajectory: Trajectory) -> tuple[Strip, ...]:
    """The strips of a flight in the order of time; gaps of the trajectory part them."""
    ends_s = trajectory.gaps_s
    begins = np.concatenate([[trajectory.span_s[0]], ends_s[:, 1]])
    ends = np.concatenate([ends_s[:, 0], [trajectory.span_s[1]]])
    paths = [
        _FlightPath.sample(trajectory, a, b)
        for a, b in zip(begins.tolist(), ends.tolist(), strict=True)
        if b - a > MIN_STRIP_S
    ]
    if not paths:
        return ()
    speed = np.concatenate([path.speed_mps for path in paths])
    slow = MIN_SPEED_SHARE * float(np.median(speed[speed > MIN_SPEED_SHARE * speed.max()]))
    found = sorted((strip for path in paths for strip in path.strips(slow)), key=lambda strip: strip[0])
    strips = []
    for number, (begin_s, end_s, along_m) in enumerate(found, 1):
        length = float(np.hypot(*along_m))
        heading = math.degrees(math.atan2(along_m[0], along_m[1])) % 360.0
        strips.append(Strip(number, begin_s, end_s, heading, length, length / (end_s - begin_s)))
    return tuple(strips)


@dataclass(frozen=True)
class _FlightPath:
    """Horizontal places (n, 2), unwrapped course (n,) and speed (n,) at times STRIP_STEP_S apart."""

    t_s: FloatArray
    xy_m: FloatArray
    course: FloatArray
    speed_mps: FloatArray

    @classmethod
    def sample(cls, trajectory: Trajectory, begin_s: float, end_s: float) -> "_FlightPath":
        t = np.arange(begin_s, end_s, STRIP_STEP_S)
        xy = np.column_stack([np.interp(t, trajectory.t_s, trajectory.xyz_m[:, k]) for k in range(2)])
        velocity = uniform_filter1d(
            np.gradient(xy, STRIP_STEP_S, axis=0), round(SMOOTH_S / STRIP_STEP_S), axis=0, mode="nearest"
        )
        course = np.unwrap(np.arctan2(velocity[:, 0], velocity[:, 1]))
        return cls(t, xy, course, np.hypot(velocity[:, 0], velocity[:, 1]))

    def strips(self, slow_mps: float) -> Iterator[tuple[float, float, FloatArray]]:
        """Begin, end and way (2,) of each strip."""
        parts: list[tuple[int, int]] = []
        edges = np.flatnonzero(np.diff((self.speed_mps > slow_mps).astype(np.int8), prepend=0, append=0))
        for first, behind in edges.reshape(-1, 2).tolist():
            parts += self._straight(first, behind)
        for first, behind in self._joined(sorted(parts)):
            way = self.xy_m[behind - 1] - self.xy_m[first]
            if float(np.hypot(*way)) >= MIN_STRIP_M:
                yield float(self.t_s[first]), float(self.t_s[behind - 1]), way

    def _straight(self, first: int, behind: int) -> list[tuple[int, int]]:
        """The longest part of nearly one course, then those before and behind it; without the arcs of wide turns."""
        found: list[tuple[int, int]] = []
        open_parts = [(first, behind)]
        while open_parts:
            low, high = open_parts.pop()
            if (high - low) * STRIP_STEP_S < MIN_STRIP_S:
                continue
            begin, length = longest_within(self.course[low:high], 2.0 * MAX_COURSE_OFF_RAD)
            if length * STRIP_STEP_S < MIN_STRIP_S:
                continue
            part = (low + begin, low + begin + length)
            found.append(part)
            open_parts += [(low, part[0]), (part[1], high)]
        # Steady change of the course, radians a step.
        rates = {(a, b): float(np.polyfit(np.arange(b - a), self.course[a:b], 1)[0]) for a, b in found}
        arcs = {part for part, rate in rates.items() if abs(rate) * (part[1] - part[0]) > MAX_COURSE_OFF_RAD}
        # What is left over beside an arc and turns as it does is the rest of the same turn.
        rests = {
            part
            for part in found
            for arc in arcs
            if (part[0] == arc[1] or part[1] == arc[0]) and rates[part] / rates[arc] > MIN_ARC_SHARE
        }
        return [part for part in found if part not in arcs | rests]

    def _joined(self, parts: list[tuple[int, int]]) -> list[tuple[int, int]]:
        joined: list[tuple[int, int]] = []
        for part in parts:
            if joined and (part[0] - joined[-1][1]) * STRIP_STEP_S < MAX_STRIP_PAUSE_S:
                course = [float(np.median(self.course[a:b])) for a, b in (joined[-1], part)]
                if abs(course[1] - course[0]) < MAX_COURSE_OFF_RAD:
                    joined[-1] = (joined[-1][0], part[1])
                    continue
            joined.append(part)
        return joined


@kernel()
def longest_within(values, reach):  # type: ignore[no-untyped-def]
    """First index and length of the longest run whose values differ by at most `reach`."""
    n = len(values)
    # candidates for the run's greatest and least value
    highs = np.empty(n, np.int64)
    lows = np.empty(n, np.int64)
    high_from = high_to = low_from = low_to = 0
    best_first = best = first = 0
    for i in range(n):
        while high_to > high_from and values[highs[high_to - 1]] <= values[i]:
            high_to -= 1
        highs[high_to] = i
        high_to += 1
        while low_to > low_from and values[lows[low_to - 1]] >= values[i]:
            low_to -= 1
        lows[low_to] = i
        low_to += 1
        while values[highs[high_from]] - values[lows[low_from]] > reach:
            first += 1
            high_from += highs[high_from] < first
            low_from += lows[low_from] < first
        if i + 1 - first > best:
            best_first = first
            best = i + 1 - first
    return best_first, best
