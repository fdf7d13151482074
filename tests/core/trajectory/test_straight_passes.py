"""Strips of flights whose lines and turns are known."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from furrowmap.core.trajectory.straight_passes import find_strips, longest_within
from furrowmap.core.values.trajectory import Trajectory, trajectory_from_attitude

FloatArray = NDArray[np.float64]
STEP_S = 0.05


def flown(legs: list[tuple[float, float, float]], gust_m: float = 0.0) -> Trajectory:
    """A path of legs: seconds, turning rate (deg/s, clockwise), speed; it begins northwards. The nose points east."""
    rate, speed = (np.concatenate([np.full(round(leg[0] / STEP_S), leg[k]) for leg in legs]) for k in (1, 2))
    course = np.radians(np.cumsum(rate) * STEP_S)
    xy = np.cumsum(np.column_stack([np.sin(course), np.cos(course)]) * speed[:, None] * STEP_S, axis=0)
    t = np.arange(len(xy)) * STEP_S
    xy = xy + gust_m * np.column_stack([np.sin(2.1 * t), np.cos(1.7 * t)])
    xyz = np.column_stack([xy, np.full(len(t), 50.0)])
    return trajectory_from_attitude(1e9 + t, xyz, 0.0, 0.0, 90.0, max_gap_s=1.0)


@pytest.mark.parametrize(
    ("speed_mps", "turn_dps", "line_s", "gust_m"),
    [(2.0, 60.0, 20.0, 0.2), (8.0, 30.0, 6.0, 0.2), (60.0, 3.0, 90.0, 1.0), (25.0, 6.0, 30.0, 0.5)],
)
def test_lines__between_half_turns_are_the_strips(
    speed_mps: float, turn_dps: float, line_s: float, gust_m: float
) -> None:
    turn_s = 180.0 / turn_dps
    legs = [(line_s, 0.0, speed_mps), (turn_s, turn_dps, speed_mps)] * 3 + [(line_s, 0.0, speed_mps)]
    strips = find_strips(flown(legs, gust_m))
    assert [strip.number for strip in strips] == [1, 2, 3, 4]
    # A line ends where its course is 15° off, which takes as long as a turn by 15°, and 1.5 s of smoothing.
    slack_s = 30.0 / turn_dps + 2.0
    for k, strip in enumerate(strips):
        begin_s = 1e9 + k * (line_s + turn_s)
        assert strip.begin_s == pytest.approx(begin_s, abs=slack_s)
        assert strip.end_s == pytest.approx(begin_s + line_s, abs=slack_s)
        assert np.cos(np.radians(strip.heading_deg - 180.0 * k)) > np.cos(np.radians(10.0))
        assert strip.speed_mps == pytest.approx(speed_mps, rel=0.1)
        assert strip.length_m == pytest.approx(strip.speed_mps * (strip.end_s - strip.begin_s))


def test_circles_and_hovering__have_no_strips() -> None:
    assert find_strips(flown([(120.0, 6.0, 10.0)])) == ()
    strips = find_strips(flown([(20.0, 0.0, 5.0), (20.0, 0.0, 0.02), (20.0, 0.0, 5.0)]))
    assert [round(strip.begin_s - 1e9) for strip in strips] == [0, 40]


@pytest.mark.parametrize(
    ("lasts_s", "speed_mps", "strips"), [(2.8, 9.0, 0), (3.3, 9.0, 1), (8.0, 0.6, 0), (8.0, 0.66, 1), (9.0, 2.0, 1)]
)
def test_strip__has_three_seconds_and_five_metres(lasts_s: float, speed_mps: float, strips: int) -> None:
    found = find_strips(flown([(lasts_s, 0.0, speed_mps)]))
    assert len(found) == strips
    for strip in found:
        assert strip.begin_s - 1e9 == pytest.approx(0.0, abs=1e-6)
        assert strip.end_s - 1e9 == pytest.approx(lasts_s, abs=0.16)
        assert strip.length_m == pytest.approx(speed_mps * (strip.end_s - strip.begin_s), rel=0.02)


@pytest.mark.parametrize(("share", "parted"), [(0.27, True), (0.33, False)])
def test_hovering__is_below_three_tenths_of_the_median_speed(share: float, parted: bool) -> None:
    legs = [(20.0, 0.0, 5.0), (15.0, 0.0, share * 5.0), (20.0, 0.0, 5.0)]
    assert len(find_strips(flown(legs))) == 1 + parted


@pytest.mark.parametrize(
    ("pause_s", "turn_dps", "parted"), [(3.2, 0.0, False), (4.0, 0.0, True), (2.5, 4.0, False), (2.5, 8.0, True)]
)
def test_pause__of_less_than_three_seconds_and_fifteen_degrees_joins(
    pause_s: float, turn_dps: float, parted: bool
) -> None:
    """The mean speed over 1.5 s is below three tenths for 0.6 s less than the pause, in which the course may turn."""
    legs = [(20.0, 0.0, 5.0), (pause_s, turn_dps, 0.0), (20.0, 0.0, 5.0)]
    assert len(find_strips(flown(legs))) == 1 + parted


def test_gap__parts_a_line() -> None:
    whole = flown([(60.0, 0.0, 5.0)])
    kept = np.abs(whole.t_s - 1e9 - 30.0) > 5.0
    t, xyz = whole.t_s[kept], whole.xyz_m[kept]
    parted = find_strips(trajectory_from_attitude(t, xyz, 0.0, 0.0, 0.0, max_gap_s=1.0))
    assert [(round(s.begin_s - 1e9), round(s.end_s - 1e9)) for s in parted] == [(0, 25), (35, 60)]


def test_longest_run__is_that_of_trying_all() -> None:
    random = np.random.default_rng(3)
    for _ in range(50):
        values = np.cumsum(random.normal(0.0, 1.0, 40))
        first, length = longest_within(values, 3.0)
        assert np.ptp(values[first : first + length]) <= 3.0
        longest = max(b - a for a in range(40) for b in range(a + 1, 41) if np.ptp(values[a:b]) <= 3.0)
        assert length == longest
