"""Working depths against heights whose depth is known."""

from __future__ import annotations

import numpy as np
import pytest

from furrowmap.core.coverage.field_work import pass_depths
from furrowmap.core.coverage.sweep import PassTimes

PASSES = [PassTimes(0.0, 20.0, 0.1, 0.1), PassTimes(30.0, 50.0, 0.1, 0.1), PassTimes(60.0, 80.0, 0.1, 0.1)]
T_S = np.arange(0.0, 90.0, 0.1)
SOIL_M = 0.02 * np.sin(T_S)


def heights(spread_m: float) -> np.ndarray:
    """The tool 3 cm lower than usual in the second pass, 2 cm higher in the third, lifted between."""
    rng = np.random.default_rng(1)
    height = np.full(len(T_S), 0.45)
    for when, below_m in zip(PASSES, (0.0, 0.03, -0.02), strict=True):
        inside = (when.begin_s + 0.5 < T_S) & (when.end_s - 0.5 > T_S)
        height[inside] = SOIL_M[inside] - below_m
    return height + rng.normal(0.0, spread_m, len(T_S))


def test_pass_depths__are_around_the_stated_one() -> None:
    depths = pass_depths(PASSES, T_S, heights(0.004), SOIL_M, 0.12)
    assert [d.depth_m for d in depths] == pytest.approx([0.12, 0.15, 0.10], abs=0.002)
    assert [d.spread_m for d in depths] == pytest.approx([0.004] * 3, abs=0.001)


def test_pass_depths__without_a_stated_depth_have_a_spread_only() -> None:
    depths = pass_depths(PASSES, T_S, heights(0.004), SOIL_M, None)
    assert all(np.isnan(d.depth_m) and 0.003 < d.spread_m < 0.005 for d in depths)


def test_pass_depths__of_a_pass_that_was_not_seen_are_unknown() -> None:
    height = heights(0.004)
    height[(T_S > 29.0) & (T_S < 51.0)] = np.nan
    depths = pass_depths(PASSES, T_S, height, SOIL_M, 0.12)
    assert np.isnan([depths[1].depth_m, depths[1].spread_m]).all()
    assert [depths[0].depth_m, depths[2].depth_m] == pytest.approx([0.13, 0.11], abs=0.002)


@pytest.mark.parametrize(("begin_s", "end_s", "seen"), [(1.05, 18.95, 1), (0.95, 18.95, 0), (1.05, 19.05, 0)])
def test_pass_depths__leave_out_a_second_at_both_ends(begin_s: float, end_s: float, seen: int) -> None:
    """Five heights in the pass, of which one may be too near to an end."""
    at = np.array([begin_s, 5.0, 9.0, 13.0, end_s])
    (depth,) = pass_depths(PASSES[:1], at, np.full(5, -0.1), np.zeros(5), 0.12)
    assert np.isfinite(depth.depth_m) == seen


@pytest.mark.parametrize("spread_m", [0.0, 0.03])
def test_pass_depths__are_no_better_than_two_centimetres_and_their_spread(spread_m: float) -> None:
    """Heights of two values, half of them each, deviate from their median by half of their distance."""
    at = np.linspace(2.0, 18.0, 100)
    height = spread_m * np.where(np.arange(100) % 2, 1.0, -1.0)
    (depth,) = pass_depths(PASSES[:1], at, height, np.zeros(100), 0.12)
    assert depth.depth_m == pytest.approx(0.12)
    assert depth.spread_m == pytest.approx(1.4826 * spread_m)
    assert depth.sigma_m == pytest.approx(np.hypot(0.02, 1.4826 * spread_m))
