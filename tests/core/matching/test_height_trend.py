"""A rate at which heights creep, of Gauss-Markov errors that ground seen again shows."""

from __future__ import annotations

import numpy as np
import pytest

from furrowmap.core.matching.height_trend import HeightTrend, height_trend

T_S = np.arange(0.0, 60.0, 2.0)
SIGMA_M = 0.04
CORRELATION_S = 60.0
SEEN_M = 0.005
"""Heights of the ground by the way of the scans, but for one constant."""


def found(rate_mps: float, seed: int) -> HeightTrend:
    n = len(T_S)
    law_m2 = SIGMA_M**2 * np.exp(-np.abs(T_S[:, None] - T_S) / CORRELATION_S)
    rng = np.random.default_rng(seed)
    error_m = np.linalg.cholesky(law_m2) @ rng.normal(size=n) + rate_mps * T_S
    law = np.zeros((3 * n, 3 * n))
    for axis in range(3):
        law[axis::3, axis::3] = np.linalg.inv(law_m2)
    # Scans show all but the mean.
    centred = np.eye(n) - 1.0 / n
    normal = np.zeros((3 * n, 3 * n))
    right = np.zeros(3 * n)
    normal[2::3, 2::3] = centred / SEEN_M**2
    right[2::3] = centred @ (error_m + rng.normal(0.0, SEEN_M, n)) / SEEN_M**2
    return height_trend((normal, right), (law, np.zeros(3 * n)), T_S)


@pytest.mark.parametrize("seed", range(20))
def test_errors_as_large_as_stated__do_not_creep(seed: int) -> None:
    assert not found(0.0, seed).shown


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("rate_mps", [0.0067, -0.0067, 0.0133])
def test_heights_that_creep_by_40_cm_a_minute__are_shown_with_their_rate(rate_mps: float, seed: int) -> None:
    trend = found(rate_mps, seed)
    assert trend.shown
    assert trend.rate_mps == pytest.approx(rate_mps, abs=0.0025)
