"""Walls and posts of two dates against a field that was moved by a known amount."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from furrowmap.core.coregistration.pair_tie import PLACE_TERMS, GroundPair, tie_pair
from furrowmap.core.coregistration.upright import Upright, find_uprights, join_uprights, tie_uprights

FloatArray = NDArray[np.float64]
MIDDLE_M = np.array([20.0, 20.0])
SIGMA = np.array([0.03, 0.03, 0.005])
NOISE_M = 0.01


def wall(rng: np.random.Generator, begin: tuple[float, float], end: tuple[float, float]) -> FloatArray:
    """Points of one face, 300 on a metre."""
    n = int(300 * np.hypot(end[0] - begin[0], end[1] - begin[1]))
    return np.column_stack([np.add(begin, np.outer(rng.random(n), np.subtract(end, begin))), 1.8 * rng.random(n)])


def post(rng: np.random.Generator, east: float, north: float) -> FloatArray:
    """What is seen of a post of 8 cm radius from inside the field."""
    towards = np.arctan2(20.0 - north, 20.0 - east) + np.radians(70.0) * rng.uniform(-1, 1, 300)
    return np.column_stack([east + 0.08 * np.cos(towards), north + 0.08 * np.sin(towards), 1.5 * rng.random(300)])


def hedge(rng: np.random.Generator) -> FloatArray:
    """Leaves anywhere in a strip, others each day."""
    return rng.uniform((30.0, 5.0, 0.0), (32.0, 25.0, 2.0), (20_000, 3))


def seen(things: list[FloatArray], move: FloatArray, rng: np.random.Generator) -> Upright:
    """What a scan finds, of a date that is off by the inverse of `move`, on gently sloping ground."""
    ground = np.column_stack([rng.uniform(0.0, 40.0, (20_000, 2)), np.zeros(20_000)])
    xyz = np.concatenate([ground, *things])
    xyz += NOISE_M * rng.standard_normal(xyz.shape)
    xyz[:, 2] += 0.03 * xyz[:, 0]
    east, north = (xyz[:, :2] - MIDDLE_M - move[:2]).T
    turn = move[2]
    xyz[:, :2] = MIDDLE_M + np.column_stack([east + turn * north, north - turn * east])
    return find_uprights(xyz, np.arange(len(xyz)) < 20_000)


@settings(max_examples=5, deadline=None)
@given(
    east=st.floats(-0.05, 0.05),
    north=st.floats(-0.05, 0.05),
    turn=st.floats(-3e-3, 3e-3),
    seed=st.integers(0, 1000),
)
def test_upright_tie__finds_the_move_whatever_was_parked_elsewhere(
    east: float, north: float, turn: float, seed: int
) -> None:
    rng, move = np.random.default_rng(seed), np.array([east, north, turn])
    fixed = [wall(rng, (2.0, 6.0), (3.0, 30.0)), post(rng, 12.0, 2.0), post(rng, 25.0, 3.0), post(rng, 38.0, 34.0)]
    parked = [wall(rng, (36.0, 10.0), (37.0, 14.0)), wall(rng, (36.06, 9.93), (37.06, 13.93))]
    one = seen([*fixed, hedge(rng), parked[0]], np.zeros(3), rng)
    other = seen([*fixed, hedge(rng), parked[1]], move, rng)
    tie = tie_uprights(one, other, MIDDLE_M, SIGMA)
    assert tie is not None
    sigma = np.sqrt(np.diag(np.linalg.inv(tie.information)))
    assert np.abs(tie.place - move).max() < 0.012
    assert (np.abs(tie.place - move) < 3.0 * sigma).all()
    assert (sigma < [0.008, 0.015, 1e-3]).all()
    moved = np.linalg.norm(tie.moved_m - (36.5, 12.0), axis=1)
    assert len(moved) >= 4
    assert np.count_nonzero(moved > 4.0) <= 1
    assert len(tie.used_m) > 40


def test_upright__of_hedges_and_bare_ground_is_nothing() -> None:
    rng = np.random.default_rng(1)
    assert np.count_nonzero(seen([hedge(rng)], np.zeros(3), rng).sigma_m) <= 2
    assert not len(seen([], np.zeros(3), rng))
    assert not len(find_uprights(np.zeros((0, 3)), np.zeros(0, bool)))
    assert tie_uprights(join_uprights([]), join_uprights([]), MIDDLE_M, SIGMA) is None
    far = [seen([post(rng, east, 3.0)], np.zeros(3), rng) for east in (5.0, 30.0)]
    assert tie_uprights(far[0], far[1], MIDDLE_M, SIGMA) is None


def test_pair_tie__of_smooth_ground_has_its_place_from_walls_unless_the_relief_contradicts() -> None:
    rng, move = np.random.default_rng(2), np.array([0.03, -0.02, 1e-3])
    fixed = [wall(rng, (2.0, 6.0), (3.0, 30.0)), wall(rng, (5.0, 38.0), (25.0, 37.0))]
    things = tie_uprights(seen(fixed, np.zeros(3), rng), seen(fixed, move, rng), MIDDLE_M, SIGMA)
    assert things is not None
    smooth = (0.003 * rng.standard_normal((2, 240, 240))).astype(np.float32)
    tie = tie_pair([GroundPair(14.0, 26.0, 0.05, smooth[0], smooth[1])], MIDDLE_M, SIGMA, things)
    assert tie is not None
    assert tie.move[PLACE_TERMS] == pytest.approx(move, abs=6e-3)
    assert np.sqrt(np.diag(np.linalg.inv(tie.information))[PLACE_TERMS]).max() < 0.008
    clods = 0.01 * np.repeat(np.repeat(rng.standard_normal((60, 60)), 4, 0), 4, 1).astype(np.float32)
    relief = tie_pair([GroundPair(14.0, 26.0, 0.05, clods + smooth[0], clods + smooth[1])], MIDDLE_M, SIGMA, things)
    assert relief is not None
    assert relief.upright is not None
    assert relief.move[:2] == pytest.approx([0.0, 0.0], abs=2e-3)
    assert not len(relief.upright.used_m)
    assert len(relief.upright.moved_m)
