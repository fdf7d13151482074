"""Correlation and noise of residuals, against sequences whose correlation is known."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from furrowmap.core.trajectory.inertial_checks import Whiteness

FloatArray = NDArray[np.float64]


def runs(*lengths: int, count: int, size: float = 0.01) -> FloatArray:
    """Of one sign each, in turn: from one to the next they are correlated by 1 − 2 · runs / values."""
    signs = np.repeat(np.resize([1.0, -1.0], count), np.resize(lengths, count))[:count]
    return size * signs


def of(*axes: FloatArray, assumed_m: float = 0.01) -> Whiteness:
    residual = np.column_stack(axes * 3 if len(axes) == 1 else axes)
    return Whiteness.of_residuals(residual, np.full(residual.shape, assumed_m))


@pytest.mark.parametrize(("lengths", "correlation"), [((3,), 1 / 3), ((2, 3), 0.2), ((4,), 0.5), ((10,), 0.8)])
def test_noise__with_the_same_information_follows_from_the_correlation(
    lengths: tuple[int, ...], correlation: float
) -> None:
    found = of(runs(*lengths, count=1001))
    assert found.correlation == pytest.approx(3 * (correlation,), abs=2e-3)
    times = np.sqrt((1.0 + correlation) / (1.0 - correlation))
    assert found.noise_m == pytest.approx(3 * (0.01 * times,), rel=0.01)
    assert found.assumed_m == (0.01, 0.01, 0.01)


def test_noise__of_a_process_of_first_order_is_that_of_its_means() -> None:
    """Means over long spans scatter as those of white noise of that size do."""
    random, r = np.random.default_rng(5), 0.7
    values = np.zeros((40_000, 3))
    for k in range(1, len(values)):
        values[k] = r * values[k - 1] + random.normal(0.0, 0.01, 3)
    found = Whiteness.of_residuals(values, np.full(values.shape, 0.01))
    means = values.reshape(200, 200, 3).mean(axis=1)
    assert found.noise_m == pytest.approx(np.sqrt(200.0) * means.std(axis=0), rel=0.2)


def test_alternating_residuals__are_no_noise_and_constant_ones_have_a_bound() -> None:
    found = of(runs(1, count=500), np.full(500, 0.01), runs(3, count=500))
    assert found.correlation == pytest.approx((-0.99, 0.99, 1 / 3), abs=0.01)
    assert found.noise_m == pytest.approx((0.01, 0.01 * np.sqrt(199.0), 0.01 * np.sqrt(2.0)), rel=0.01)


@pytest.mark.parametrize(("pairs", "shows"), [(78, False), (84, True)])
def test_correlation__shows_beyond_three_standard_deviations(pairs: int, shows: bool) -> None:
    """A third of 1 is three of 1/√81."""
    found = of(runs(3, count=pairs + 1))
    assert found.correlation == (pytest.approx(3 * (1 / 3,), abs=1e-4) if shows else (0.0, 0.0, 0.0))


@pytest.mark.parametrize(("pairs", "known"), [(19, False), (20, True)])
def test_few_residuals__tell_nothing(pairs: int, known: bool) -> None:
    found = of(runs(10, count=pairs + 1))
    assert bool(np.isfinite(found.correlation).all()) is known
    assert bool(np.isfinite(found.noise_m).all()) is known


def test_residuals_that_take_no_part__part_their_neighbours() -> None:
    values = runs(3, count=400)
    values[1::2] = np.nan
    assert np.isnan(of(values).correlation).all()
    # In pairs with gaps between them, each is alike and the next is not.
    pairs = np.resize([0.01, 0.01, np.nan, -0.01, -0.01, np.nan], 600)
    assert of(pairs).correlation == pytest.approx((0.99, 0.99, 0.99))
    one_axis = of(runs(1, count=600), runs(1, count=600), pairs)
    assert one_axis.correlation == pytest.approx((-0.99, -0.99, 0.99))
