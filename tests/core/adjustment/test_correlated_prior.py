"""A prior as the root of its covariance, against the normal equations with its inverse."""

from __future__ import annotations

import numpy as np
import pytest

from furrowmap.core.adjustment.correlated_prior import covariance_after, root_of, solved


def test_result__is_that_of_the_normal_equations() -> None:
    rng = np.random.default_rng(1)
    half, design, seen = rng.normal(size=(4, 4)), rng.normal(size=(9, 6)), rng.normal(size=9)
    covariance = half @ half.T
    root = root_of(np.array([2.0, 0.5]), covariance)
    prior = np.zeros((6, 6))
    prior[:2, :2], prior[2:, 2:] = np.diag([4.0, 0.25]), covariance
    np.testing.assert_allclose(root @ root.T, prior, atol=1e-12)
    whole = np.linalg.inv(design.T @ design + np.linalg.inv(prior))
    step, factor = solved(design.T @ design, design.T @ seen, root, np.zeros(6))
    after, left = covariance_after(factor, root)
    np.testing.assert_allclose(root @ step, whole @ design.T @ seen, atol=1e-10)
    np.testing.assert_allclose(after, whole, atol=1e-10)
    assert ((left > 0.0) & (left <= 1.0)).all()


def test_place_in_common__keeps_its_sigma_where_differences_are_a_million_times_as_exact() -> None:
    """Ten places, known to 0.3 m together and to 1 µm against each other; observations see differences alone."""
    covariance = np.full((10, 10), 0.09) + 1e-12 * np.eye(10)
    differences = np.eye(10)[1:] - np.eye(10)[:-1]
    root = root_of(np.zeros(0), covariance)
    _, factor = solved(1e14 * differences.T @ differences, np.zeros(10), root, np.zeros(10))
    after, _ = covariance_after(factor, root)
    assert np.sqrt(np.diag(after)) == pytest.approx(0.3, rel=5e-3)
