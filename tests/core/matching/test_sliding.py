"""Knots that leave a window leave behind what they know: the solution of the whole chain."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from furrowmap.core.estimation.banded import NormalEquations
from furrowmap.core.estimation.knots import STEP_S, Chain, Knots, State
from furrowmap.core.matching.coarse import SIZE
from furrowmap.core.matching.sliding import (
    START_SIGMA,
    STILL_TURN,
    Alignment,
    Bordered,
    Prior,
    add_steering,
    marginalised,
    ways_m,
)

STEADY_S = 1e-5
"""For so short a time the local frame does not wander."""


def standing(count: int) -> State:
    return State(np.zeros((count, 3)), np.tile(np.eye(3), (count, 1, 1)), np.zeros((count, 3)))


def random_equations(random: np.random.Generator, knots: int) -> Bordered:
    """Of observations that each touch three knots in a row and the twist."""
    equations = Bordered(NormalEquations(knots * SIZE, 3 * SIZE), np.zeros((knots * SIZE, 6)), np.eye(6), np.zeros(6))
    for first in range(knots - 2):
        design = random.normal(size=(40, 3 * SIZE))
        twist = random.normal(size=(40, 6))
        observed = random.normal(size=40)
        part = slice(first * SIZE, (first + 3) * SIZE)
        for row, value in zip(design, observed, strict=True):
            equations.knots.add(np.array([first * SIZE]), row[None], np.array([value]), np.ones(1))
        equations.border[part] += design.T @ twist
        equations.corner[:] += twist.T @ twist
        equations.right[:] += twist.T @ observed
    return equations


@settings(max_examples=20, deadline=None)
@given(st.integers(0, 1000), st.integers(1, 5), st.integers(3, 6))
def test_a_marginalised_chain_has_the_whole_chain_s_solution(seed: int, leaving: int, staying: int) -> None:
    random = np.random.default_rng(seed)
    early, late = random_equations(random, leaving + 2), random_equations(random, staying)
    nothing = Bordered(NormalEquations(2 * SIZE, 3 * SIZE), np.zeros((2 * SIZE, 6)), np.zeros((6, 6)), np.zeros(6))
    whole, whole_right = np.zeros(((leaving + staying) * SIZE + 6,) * 2), np.zeros((leaving + staying) * SIZE + 6)
    for equations, first in ((early, 0), (late, leaving)):
        normal, right = equations.dense()
        index = np.append(np.arange(len(right) - 6) + first * SIZE, np.arange(-6, 0) + len(whole))
        whole[np.ix_(index, index)] += normal
        whole_right[index] += right
    expected = np.linalg.solve(whole, whole_right)

    prior = marginalised(early, nothing, standing(2), np.zeros(3), STEADY_S)
    late.add_prior(prior, standing(staying), np.zeros(6))
    step, twist, _ = late.solve(np.zeros((staying * SIZE, 0)), np.zeros((6, 0)))
    assert step == pytest.approx(expected[leaving * SIZE : -6], rel=1e-4, abs=1e-4)
    assert twist == pytest.approx(expected[-6:], rel=1e-4, abs=1e-4)


@settings(max_examples=20, deadline=None)
@given(st.integers(0, 1000))
def test_the_covariance_is_that_of_the_inverse(seed: int) -> None:
    random = np.random.default_rng(seed)
    equations = random_equations(random, 5)
    of_knots, of_twist = random.normal(size=(5 * SIZE, 6)), random.normal(size=(6, 6))
    normal, _ = equations.dense()
    design = np.vstack([of_knots, of_twist])
    _, _, covariance = equations.solve(of_knots, of_twist)
    assert covariance == pytest.approx(design.T @ np.linalg.inv(normal) @ design, rel=1e-6, abs=1e-9)


def test_a_prior_is_where_it_was_stated() -> None:
    """A step taken since is taken off the right-hand side: a second solution finds nothing more to do."""
    random = np.random.default_rng(4)
    prior = Prior.of_start(standing(4))
    assert prior.at(standing(4), START_SIGMA)[-6:] == pytest.approx(-1.0 / START_SIGMA)
    equations = random_equations(random, 4)
    normal, right = equations.dense()
    assert normal == pytest.approx(normal.T)
    step, twist, _ = equations.solve(np.zeros((4 * SIZE, 0)), np.zeros((6, 0)))
    assert normal @ np.append(step, twist) == pytest.approx(right)


@given(st.lists(st.floats(-0.5, 0.5), min_size=12, max_size=12))
def test_the_alignment_goes_there_and_back(values: list[float]) -> None:
    twist, place = np.array(values[:6]), np.array(values[6:9])
    alignment = Alignment(np.eye(3), np.zeros(3)).moved(twist, place)
    other = np.array(values[9:])
    assert alignment.to_local(alignment.to_map(other)) == pytest.approx(other)
    assert alignment.to_map(place) == pytest.approx(place + twist[:3])
    turned = alignment.to_map(place + other) - alignment.to_map(place)
    assert turned == pytest.approx(Rotation.from_rotvec(twist[3:]).apply(other))


def test_a_stand_keeps_its_heading_and_a_drive_may_turn() -> None:
    count = 30
    knots = Knots((Chain(0, count, 0.0),), STEP_S * np.arange(count))
    state = standing(count)
    moving = State(state.xyz_m + np.arange(count)[:, None] * [0.03, 0.0, 0.0], state.rotation, state.drift_m)
    held = []
    for each in (state, moving):
        equations = NormalEquations(count * SIZE, 3 * SIZE)
        add_steering(equations, knots, each, ways_m(each))
        held.append(equations.band[0, 5 + SIZE])
    assert held[0] == pytest.approx(2.0 / STILL_TURN**2)
    assert held[1] < 1e-6 * held[0]
