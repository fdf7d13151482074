"""The penetration of a canopy, against closed forms and against pulses drawn by chance."""

from __future__ import annotations

import math
from itertools import combinations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from furrowmap.core.crops.canopy_height import Penetration, estimate_penetration, l_moments_of
from furrowmap.core.crops.pixels import MAX_RANK, pixel_halves, pixel_returns
from furrowmap.core.surfaces.grid import Grid


def drawn(rng: np.random.Generator, shape: float, scale: float, noise: float, size: tuple[int, ...]) -> np.ndarray:
    """Heights of returns below a top at 0."""
    return -scale * rng.weibull(shape, size) + noise * rng.standard_normal(size)


@pytest.mark.parametrize("shape", [0.9, 1.0, 1.4, 2.2])
def test_penetration__without_noise_has_the_closed_form_of_the_weibull_law(shape: float) -> None:
    scale = 0.09
    mean = scale * math.gamma(1.0 + 1.0 / shape)
    least = [mean * n ** (-1.0 / shape) for n in range(1, MAX_RANK + 1)]  # of n depths
    _, second, third = l_moments_of(*(-value for value in least[:3]))
    found = estimate_penetration(float(second), float(third), noise_m=0.002)
    assert found.shape == pytest.approx(shape, abs=0.04)
    assert found.mean_depth_m == pytest.approx(mean, rel=0.02)
    assert found.top_above_highest_m()[1:] == pytest.approx(least, rel=0.05, abs=0.001)


@settings(max_examples=12, deadline=None)
@given(st.floats(1.0, 2.0), st.floats(0.06, 0.15), st.floats(0.003, 0.015), st.integers(0, 1000))
def test_penetration__of_pulses_with_noise_gives_their_mean_depth(
    shape: float, scale: float, noise: float, seed: int
) -> None:
    heights = drawn(np.random.default_rng(seed), shape, scale, noise, (60_000, 3))
    means = [heights[:, :k].max(axis=1).mean() for k in (1, 2, 3)]
    _, second, third = l_moments_of(*means)
    found = estimate_penetration(float(second), float(third), noise)
    true = scale * math.gamma(1.0 + 1.0 / shape)
    assert found.mean_depth_m == pytest.approx(true, rel=0.08)
    # the top from one return, from the higher of two, from the highest of three: the same
    tops = [mean + found.top_above_highest_m()[k] for k, mean in zip((1, 2, 3), means, strict=True)]
    assert tops == pytest.approx([0.0] * 3, abs=0.08 * true)


def test_penetration__spread_of_the_highest_is_that_of_pulses() -> None:
    heights = drawn(np.random.default_rng(5), 1.4, 0.09, 0.012, (40_000, 8))
    model = Penetration(1.4, 0.09, 0.012).spread_of_highest_m()
    for n in (1, 4, 8):
        assert model[n] == pytest.approx(heights[:, :n].max(axis=1).std(), rel=0.03)


def test_one_return__has_the_mean_and_the_variance_of_the_law_and_its_noise_anywhere_between() -> None:
    """Of a Weibull law in closed form, whatever the shape and the noise."""
    random = np.random.default_rng(11)
    for shape, noise in zip(random.uniform(0.8, 4.0, 150), random.uniform(0.02, 1.0, 150), strict=True):
        found = Penetration(shape, 0.1, 0.1 * noise)
        mean, square = (math.gamma(1.0 + k / shape) for k in (1, 2))
        assert found.mean_depth_m == pytest.approx(0.1 * mean)
        assert found.top_above_highest_m()[1] == pytest.approx(0.1 * mean, rel=0.002)
        assert found.spread_of_highest_m()[1] == pytest.approx(0.1 * math.sqrt(square - mean**2 + noise**2), rel=0.012)


def test_penetration__of_a_hard_surface_is_near_nothing() -> None:
    heights = 0.012 * np.random.default_rng(6).standard_normal((60_000, 3))
    _, second, third = l_moments_of(*(heights[:, :k].max(axis=1).mean() for k in (1, 2, 3)))
    assert estimate_penetration(float(second), float(third), 0.012).mean_depth_m < 0.015


def test_pixel_returns__are_means_over_all_choices() -> None:
    rng = np.random.default_rng(7)
    heights = rng.normal(size=11)
    grid = Grid.of_bounds(1.0, (0.0, 0.0, 1.9, 0.9))
    found = pixel_returns(np.full(11, 1.5), np.full(11, 0.5), heights, grid)
    for k in (1, 2, 3):
        expected = np.mean([max(chosen) for chosen in combinations(heights.tolist(), k)])
        assert found.means_m(found.count > 0)[0, k - 1] == pytest.approx(expected)
    expected = np.mean([max(chosen) for chosen in combinations(heights.tolist(), MAX_RANK)])
    assert found.highest_m[0, 1] == pytest.approx(expected)
    assert found.count.tolist() == [[0, 11]]
    assert np.isnan(found.highest_m[0, 0])


def test_pixel_returns__of_few_are_the_highest() -> None:
    grid = Grid.of_bounds(1.0, (0.0, 0.0, 0.9, 0.9))
    found = pixel_returns(np.array([0.5, 0.1]), np.array([0.5, 0.9]), np.array([3.0, 5.0]), grid)
    assert found.highest_m[0, 0] == 5.0
    assert len(found.means_m(found.count > 0)) == 0


def test_pixel_halves__are_the_returns_of_each_part() -> None:
    rng, grid = np.random.default_rng(8), Grid.of_bounds(0.04, (0.0, 0.0, 0.3, 0.2))
    column, row = rng.uniform(-1.0, 9.0, (2, 900))
    row[:300], column[:300] = 2.5, 3.5  # a pixel with many
    height, first = rng.random(900), rng.random(900) < 0.5
    parts = [np.ones(900, np.bool_), first, ~first]
    whole = pixel_returns(column, row, height, grid, first)
    for found, part in zip([whole, *pixel_halves(whole)], parts, strict=True):
        alone = pixel_returns(column[part], row[part], height[part], grid)
        assert (found.count == alone.count).all()
        assert found.highest_m == pytest.approx(alone.highest_m, nan_ok=True)
        all_pixels = np.ones(grid.shape, np.bool_)
        assert found.means_m(all_pixels) == pytest.approx(alone.means_m(all_pixels))
        assert found.count[2, 3] >= len(height[part]) * 0.3
