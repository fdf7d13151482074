"""Covariances at some knots, against the inverse of the whole normal matrix."""

from __future__ import annotations

import numpy as np
import pytest

from furrowmap.core.adjustment.banded import NormalEquations
from furrowmap.core.adjustment.covariance import marginal_covariance

SIZE = 3
KNOTS = 30


def chained(seed: int) -> NormalEquations:
    """Knots that random observations tie to the next, and a few to zero."""
    random = np.random.default_rng(seed)
    equations = NormalEquations(KNOTS * SIZE, 2 * SIZE)
    for _ in range(4):
        first = np.arange(KNOTS - 1) * SIZE
        equations.add(first, random.normal(size=(KNOTS - 1, 2 * SIZE)), np.zeros(KNOTS - 1), np.ones(KNOTS - 1))
    held = np.arange(KNOTS * SIZE)
    equations.add(held, np.ones((len(held), 1)), np.zeros(len(held)), np.full(len(held), 3.0))
    return equations


@pytest.mark.parametrize("nodes", [[0, 1, 2, 11, 12, 25, 29], [0, 29], list(range(KNOTS))])
@pytest.mark.parametrize("columns", [2, SIZE])
def test_marginal_covariance__is_a_part_of_the_whole_inverse(nodes: list[int], columns: int) -> None:
    equations = chained(len(nodes))
    whole = np.linalg.inv(equations.dense())
    chosen = (np.array(nodes)[:, None] * SIZE + np.arange(columns)).ravel()
    found = marginal_covariance(equations, SIZE, np.array(nodes), columns)
    np.testing.assert_allclose(found, whole[np.ix_(chosen, chosen)], rtol=1e-9, atol=1e-12)


def test_marginal_covariance__of_knots_that_nothing_holds_is_an_error() -> None:
    equations = NormalEquations(KNOTS * SIZE, 2 * SIZE)
    with pytest.raises(np.linalg.LinAlgError):
        marginal_covariance(equations, SIZE, np.array([0, 10, KNOTS - 1]), SIZE)
