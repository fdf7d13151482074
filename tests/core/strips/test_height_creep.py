"""Heights that creep show between strips; slow errors as stated are not doubted."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from furrowmap.core.strips.height_creep import held_against_heights
from furrowmap.core.trajectory.pose_errors import PoseErrors
from furrowmap.core.values.trajectory import Trajectory, trajectory_from_attitude

SIGMA_M = 0.007
LASTS_S = 60.0


def known(t_s: np.ndarray) -> PoseErrors:
    alike = np.exp(-np.abs(t_s[:, None] - t_s) / LASTS_S)
    covariance = np.einsum("ij,ab->iajb", SIGMA_M**2 * alike, np.eye(6)).reshape(6 * len(t_s), -1)
    return PoseErrors(t_s, np.zeros((len(t_s), 6)), covariance)


def flight() -> Trajectory:
    t_s = np.arange(0.0, 111.0, 1.0)
    made = trajectory_from_attitude(t_s, np.zeros((len(t_s), 3)), 0.0, 0.0, 0.0, max_gap_s=2.0)
    return replace(made, sigma=np.full((len(t_s), 6), 0.005))


@pytest.mark.parametrize("height_m", [lambda t: 0.00083 * t, lambda t: -0.0067 * t, lambda t: 0.1 * np.sin(t / 10.0)])
def test_heights_that_creep__are_doubted_by_half_of_their_extent(height_m: object) -> None:
    before = known(flight().t_s)
    value = np.zeros((len(before.t_s), 6))
    value[:, 2] = height_m(before.t_s)  # type: ignore[operator]  # a callable by the parameters above
    doubted, notice = held_against_heights(flight(), before, replace(before, value=value))
    assert notice is not None
    assert notice.key == "contradiction.height-creep"
    assert doubted.sigma[:, 2] == pytest.approx(np.hypot(0.005, 0.5 * np.ptp(value[:, 2])), rel=1e-6)
    np.testing.assert_array_equal(doubted.sigma[:, [0, 1, 3, 4, 5]], flight().sigma[:, [0, 1, 3, 4, 5]])


@pytest.mark.parametrize("seed", range(20))
def test_errors_as_stated__are_not_doubted(seed: int) -> None:
    before = known(flight().t_s)
    drawn = np.random.default_rng(seed).multivariate_normal(
        np.zeros(len(before.covariance)), before.covariance, method="cholesky"
    )
    _, notice = held_against_heights(flight(), before, replace(before, value=drawn.reshape(-1, 6)))
    assert notice is None
