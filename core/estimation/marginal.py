"""Covariances of the states at a few of many knots, the knots between them eliminated."""

from __future__ import annotations

import numpy as np
import scipy.linalg
from numpy.typing import NDArray

from furrowmap.core.estimation.banded import NormalEquations
from furrowmap.core.runtime import scratch

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]


def marginal_covariance(equations: NormalEquations, size: int, nodes: IntArray, columns: int) -> FloatArray:
    """(m · columns, m · columns) covariance of the first states of some knots.

    Eliminating the knots between two nodes (Schur complement) leaves equations that link each node with the next, so
    that they are banded as those of the knots are.

    Args:
        equations: of all knots, each linked with the next at most.
        size: states of a knot.
        nodes: (m,) increasing numbers of knots, the first and the last one among them.
        columns: how many of each node's states.

    Raises:
        LinAlgError: if the observations do not determine the states.
    """
    m = len(nodes)
    reduced = NormalEquations(m * size, 2 * size)
    diagonal = np.array([_diagonal(equations, size, int(node)) for node in nodes])
    beside = np.zeros((m - 1, size, size))
    for number, (first, last) in enumerate(zip(nodes[:-1].tolist(), nodes[1:].tolist(), strict=True)):
        if last == first + 1:
            beside[number] = _beside(equations, size, first)
            continue
        to_first, to_last = _beside(equations, size, first), _beside(equations, size, last - 1).T
        inner = slice((first + 1) * size, last * size)
        right = np.zeros((inner.stop - inner.start, 2 * size), order="F")
        right[:size, :size], right[-size:, size:] = to_first, to_last
        factor, fault = scipy.linalg.lapack.dpbtrf(scratch.copied(equations.band[:, inner]), lower=1, overwrite_ab=1)
        if fault:
            raise np.linalg.LinAlgError(f"the normal matrix is not positive definite between knots {first} and {last}")
        solved, _ = scipy.linalg.lapack.dpbtrs(factor, right, lower=1, overwrite_b=1)
        diagonal[number] -= to_first.T @ solved[:size, :size]
        diagonal[number + 1] -= to_last.T @ solved[-size:, size:]
        beside[number] -= to_last.T @ solved[-size:, :size]
    for row in range(size):
        for column in range(size):
            if row >= column:
                reduced.band[row - column, column::size] = diagonal[:, row, column]
            reduced.band[size + row - column, column : (m - 1) * size : size] = beside[:, row, column]
    chosen = (np.arange(m)[:, None] * size + np.arange(columns)).ravel()
    units = np.zeros((m * size, len(chosen)), order="F")
    units[chosen, np.arange(len(chosen))] = 1.0
    out: FloatArray = reduced.solve().by(units)[chosen]
    return 0.5 * (out + out.T)


def _diagonal(equations: NormalEquations, size: int, knot: int) -> FloatArray:
    """(size, size) block of a knot."""
    out = np.zeros((size, size))
    for column in range(size):
        out[column:, column] = equations.band[: size - column, knot * size + column]
    return out + np.tril(out, -1).T


def _beside(equations: NormalEquations, size: int, knot: int) -> FloatArray:
    """(size, size) block of the next knot's rows and a knot's columns."""
    out = np.empty((size, size))
    for column in range(size):
        out[:, column] = equations.band[size - column : 2 * size - column, knot * size + column]
    return out
