"""Increments of an IMU, against closed forms and against themselves."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from furrowmap.core.adjustment.preintegration import exponential, increments

RATE = st.tuples(*[st.floats(-3.0, 3.0)] * 3)
FORCE = st.tuples(*[st.floats(-20.0, 20.0)] * 3)


@given(RATE)
def test_exponential__is_that_of_scipy(vector: tuple[float, float, float]) -> None:
    assert np.allclose(exponential(*vector), Rotation.from_rotvec(vector).as_matrix(), atol=1e-12)


@given(RATE, FORCE, st.floats(0.0, 0.4), st.floats(0.45, 0.9))
def test_constant_rate_and_force__have_a_closed_form(
    rate: tuple[float, float, float], force: tuple[float, float, float], begin_s: float, end_s: float
) -> None:
    t_s = np.linspace(0.0, 1.0, 201)
    found = increments(t_s, np.tile(rate, (201, 1)), np.tile(force, (201, 1)), np.array([begin_s]), np.array([end_s]))
    length_s = end_s - begin_s
    assert np.allclose(found.turn[0], Rotation.from_rotvec(np.multiply(rate, length_s)).as_matrix(), atol=1e-10)
    fine = (np.arange(4000) + 0.5) / 4000 * length_s
    pushed = Rotation.from_rotvec(np.outer(fine, rate)).apply(np.tile(force, (4000, 1))) * length_s / 4000
    assert np.allclose(found.velocity_mps[0], pushed.sum(axis=0), atol=2e-4)
    assert np.allclose(found.way_m[0], (pushed * (length_s - fine)[:, None]).sum(axis=0), atol=2e-4)


@given(st.integers(0, 1000), st.integers(1, 58))
def test_increments__follow_each_other(seed: int, middle: int) -> None:
    random = np.random.default_rng(seed)
    t_s = np.cumsum(random.uniform(0.002, 0.03, 60))
    rate, force = random.normal(0, 1, (60, 3)), random.normal(0, 10, (60, 3))
    both = increments(t_s, rate, force, t_s[[0, middle]], t_s[[middle, 59]])
    whole = increments(t_s, rate, force, t_s[:1], t_s[59:])
    rest_s = t_s[59] - t_s[middle]
    velocity = both.velocity_mps[0] + both.turn[0] @ both.velocity_mps[1]
    way = both.way_m[0] + both.velocity_mps[0] * rest_s + both.turn[0] @ both.way_m[1]
    assert np.allclose(both.turn[0] @ both.turn[1], whole.turn[0], atol=1e-12)
    assert np.allclose(velocity, whole.velocity_mps[0], atol=1e-10)
    assert np.allclose(way, whole.way_m[0], atol=1e-10)
