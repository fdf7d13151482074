"""The smoothing spline, against another implementation and its own law."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.interpolate import make_smoothing_spline

from furrowmap.core.trajectory.smoothing import smooth_path, smoothed, white_noise


@settings(max_examples=30)
@given(seed=st.integers(0, 10**6), count=st.integers(5, 300), stiffness=st.floats(1e-8, 1e2))
def test_smoothed__is_the_minimiser_that_scipy_finds(seed: int, count: int, stiffness: float) -> None:
    rng = np.random.default_rng(seed)
    t = np.cumsum(rng.uniform(0.05, 1.0, count))
    values = np.column_stack([np.sin(t), np.cos(0.3 * t)]) + rng.normal(0, 0.1, (count, 2))
    expected = make_smoothing_spline(t, values, lam=stiffness)(t)
    assert smoothed(t, values, stiffness)[0] == pytest.approx(expected, abs=1e-7)


def test_smooth_path__goes_through_a_path_without_noise_and_is_curved_between() -> None:
    t = np.arange(0.0, 20.0, 1.0)
    circle = 5.0 * np.column_stack([np.cos(0.2 * t), np.sin(0.2 * t)])
    path = smooth_path(t, circle)
    assert path(t) == pytest.approx(circle, abs=2e-3)
    between = path(np.linspace(3.0, 16.0, 200))
    assert np.hypot(*between.T) == pytest.approx(5.0, abs=2e-3)  # chords would be off by 25 mm


def test_smooth_path__takes_most_of_the_noise_out() -> None:
    rng = np.random.default_rng(3)
    t = np.arange(0.0, 60.0, 0.1)
    truth = np.column_stack([1.2 * t, 0.02 * np.sin(1.2 * t)])
    noisy = truth + rng.normal(0, 0.02, truth.shape)
    assert np.std(smooth_path(t, noisy)(t) - truth) < 0.4 * 0.02


@pytest.mark.parametrize("sigma", [0.0, 0.004, 0.05])
def test_white_noise__is_what_was_added_to_a_turning_path(sigma: float) -> None:
    t = np.arange(0.0, 100.0, 0.1)
    circle = 3.0 * np.column_stack([np.cos(0.4 * t), np.sin(0.4 * t)])
    noisy = circle + np.random.default_rng(1).normal(0, sigma, circle.shape)
    assert white_noise(noisy) == pytest.approx(sigma, rel=0.1, abs=1e-5)


@pytest.mark.parametrize("count", [2, 3, 4])
def test_smooth_path__of_few_positions_keeps_them(count: int) -> None:
    t = np.arange(float(count))
    values = np.column_stack([t, t**2])
    assert smooth_path(t, values)(t) == pytest.approx(values)
