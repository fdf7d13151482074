"""Banded least squares against the dense solution."""

from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from furrowmap.core.adjustment.banded import NormalEquations


@settings(max_examples=30)
@given(st.integers(3, 40), st.integers(1, 3), st.integers(0, 2**32 - 1))
def test_solution_and_sigmas_are_those_of_the_dense_normal_equations(n: int, width: int, seed: int) -> None:
    rng = np.random.default_rng(seed)
    equations = NormalEquations(n, width)
    dense_rows, dense_right = [], []
    for p in (1, width):
        first = np.arange(n - p + 1)
        design = rng.normal(size=(len(first), p))
        design[:, 0] += np.sign(design[:, 0])
        residual, sigma = rng.normal(size=len(first)), rng.uniform(0.5, 2.0, len(first))
        equations.add(first, design, residual, sigma)
        for f, row, r, s in zip(first, design, residual, sigma, strict=True):
            whole = np.zeros(n)
            whole[f : f + p] = row / s
            dense_rows.append(whole)
            dense_right.append(r / s)
    matrix, right = np.array(dense_rows), np.array(dense_right)
    normal = matrix.T @ matrix

    solution = equations.solve()

    np.testing.assert_allclose(solution.values, np.linalg.solve(normal, matrix.T @ right), atol=1e-9)
    np.testing.assert_allclose(solution.sigma(), np.sqrt(np.diag(np.linalg.inv(normal))), rtol=1e-9)
