"""Heights of cells at several times against the same equations written out, with a height for each cell."""

from __future__ import annotations

import numpy as np

from furrowmap.core.strips.cell_heights import GroupHeights, adjust_cells
from furrowmap.core.strips.strips import strip_returns
from furrowmap.core.values.scan import Scan
from furrowmap.core.values.trajectory import trajectory_from_attitude

CELLS, WINDOWS, PARAMETERS = 60, 9, 4


def test_eliminated_cells__give_what_a_height_for_each_cell_gives() -> None:
    random = np.random.default_rng(7)
    cell, window = (index.ravel() for index in np.nonzero(random.random((CELLS, WINDOWS)) < 0.6))
    assert len(np.unique(cell)) == CELLS
    shuffled = random.permutation(len(cell))
    cell, window = cell[shuffled], window[shuffled]
    design = random.normal(size=(len(cell), PARAMETERS))
    true = np.array([0.02, -0.01, 0.03, 0.0])
    height = random.normal(size=CELLS)[cell] + design @ true + random.normal(0.0, 1e-3, len(cell))
    # Small enough that no residual is weighted down.
    weight = random.uniform(0.5, 2.0, len(cell)) / 0.01**2
    spread = np.concatenate([np.full(PARAMETERS, 0.1), np.full(WINDOWS, 0.002)])
    off, covariance, _ = adjust_cells(GroupHeights(cell, window, height, weight, design), spread)

    whole = np.hstack([design, np.eye(WINDOWS)[window], np.eye(CELLS)[cell]])
    prior = np.concatenate([1.0 / spread**2, np.zeros(CELLS)])
    normal = whole.T @ (weight[:, None] * whole) + np.diag(prior)
    known = PARAMETERS + WINDOWS
    np.testing.assert_allclose(off, np.linalg.solve(normal, whole.T @ (weight * height))[:known], atol=1e-12)
    np.testing.assert_allclose(covariance, np.linalg.inv(normal)[:known, :known], rtol=1e-8, atol=1e-14)


def test_poses_of_returns__are_those_of_the_trajectory() -> None:
    t = np.array([0.0, 0.1, 0.2, 0.3, 1.4, 1.5])
    xyz = np.cumsum(np.random.default_rng(1).normal(size=(6, 3)), axis=0)
    angles = 40.0 * np.sin(t), 20.0 * np.cos(3.0 * t), 170.0 + 30.0 * t
    trajectory = trajectory_from_attitude(t, xyz, *angles, max_gap_s=0.5)
    times = np.linspace(-0.2, 1.7, 3_001)
    far = np.full((len(times), 3), (0.0, 3.0, -4.0), np.float32)
    one = np.ones(len(times), np.uint8)
    scan = Scan(0, times, far, one, one, one.astype(np.uint16), one, one)
    returns = strip_returns([scan], trajectory)
    poses = trajectory.at(returns.t_s)
    np.testing.assert_allclose(returns.origin_m + returns.local_m, poses.xyz_m, atol=2e-6)
    np.testing.assert_allclose(np.abs(np.sum(returns.rotation * poses.quaternion, axis=1)), 1.0, atol=2e-7)
    assert len(returns) == np.count_nonzero(np.isfinite(trajectory.at(times).xyz_m[:, 0]))
