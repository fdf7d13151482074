"""Covariances of the poses: marginal ones of what is slow and what is quick, added up, and those of a few knots."""

from dataclasses import dataclass

import numpy as np
import scipy.linalg

from furrowmap.core.adjustment.banded import NormalEquations
from furrowmap.core.adjustment.coarse import CoarseKnots
from furrowmap.core.adjustment.knots import POSE, State
from furrowmap.core.runtime import arrays
from furrowmap.core.runtime.arrays import FloatArray, IntArray
from furrowmap.core.runtime.kernels import kernel


@dataclass(frozen=True)
class Considered:
    """A parameter that is not estimated, but whose uncertainty counts.

    Schmidt 1966, Application of state-space methods to navigation problems.

    Attributes:
        mode: (count · size,) movement of the coarse knots by one standard deviation of it.
        right: (count · size,) right-hand side by which absolute observations resist that movement.
    """

    mode: FloatArray
    right: FloatArray


def slow_covariance(slow: FloatArray, considered: Considered) -> FloatArray:
    """(n, n) a covariance of n = count · size unknowns of coarse knots, with a considered parameter."""
    left = considered.mode - slow @ considered.right
    out: FloatArray = slow + np.outer(left, left)
    return out


def quick_variances(held: NormalEquations, size: int) -> FloatArray:
    """(n, 6) variances of the poses with fixed references."""
    out: FloatArray = arrays.copied(held.solve().sigma().reshape(-1, size)[:, :POSE])
    np.square(out, out=out)
    return out


def pose_sigmas(
    state: State, coarse: CoarseKnots, centre_m: FloatArray, slow: FloatArray, quick: FloatArray
) -> FloatArray:
    """Standard deviations (n, 6) of easting, northing, height (m), roll, pitch, heading (degrees) at the knots."""
    variance: FloatArray = arrays.zeros(quick.shape)
    _variances(
        state.layout.size, np.ascontiguousarray(state.xyz_m), np.ascontiguousarray(state.rotation), coarse.before,
        coarse.share, centre_m, np.ascontiguousarray(slow), quick, variance,
    )  # fmt: skip
    out: FloatArray = np.maximum(variance, 0.0, out=variance)
    np.sqrt(out, out=out)
    np.degrees(out[:, 3:], out=out[:, 3:])
    return out


@kernel()
def _variances(size, xyz_m, rotation, before, share, centre_m, slow, quick, out):  # type: ignore[no-untyped-def]
    n = len(xyz_m)
    count = len(centre_m)
    design = np.zeros((6, 12))
    moved = np.empty(12)
    block = np.empty((12, 12))
    covariance = np.empty((6, 6))
    for j in range(n):
        for e in range(2):
            c = min(before[j] + e, count - 1)
            w = share[j] if e else 1.0 - share[j]
            dx = xyz_m[j, 0] - centre_m[c, 0]
            dy = xyz_m[j, 1] - centre_m[c, 1]
            dz = xyz_m[j, 2] - centre_m[c, 2]
            o = 6 * e
            for a in range(6):
                design[a, o + a] = w
            design[0, o + 4] = w * dz
            design[0, o + 5] = -w * dy
            design[1, o + 3] = -w * dz
            design[1, o + 5] = w * dx
            design[2, o + 3] = w * dy
            design[2, o + 4] = -w * dx
            for f in range(2):
                d = min(before[j] + f, count - 1)
                for a in range(6):
                    for b in range(6):
                        block[o + a, 6 * f + b] = slow[c * size + a, d * size + b]
        for a in range(6):  # in loops: numba's products of matrices compile for two seconds
            moved[:] = 0.0
            for c in range(12):
                for d in range(12):
                    moved[d] += design[a, c] * block[c, d]
            for b in range(6):
                covariance[a, b] = quick[j, a] if a == b else 0.0
                for d in range(12):
                    covariance[a, b] += moved[d] * design[b, d]
        for a in range(3):
            out[j, a] = covariance[a, a]
        for axis in range(2):
            out[j, 3 + axis] = 0.0
            for a in range(3):
                for b in range(3):
                    out[j, 3 + axis] += rotation[j, a, axis] * covariance[3 + a, 3 + b] * rotation[j, b, axis]
        out[j, 5] = covariance[5, 5]


def marginal_covariance(equations: NormalEquations, size: int, nodes: IntArray, columns: int) -> FloatArray:
    """(m · columns, m · columns) covariance of the first states of some knots.

    Eliminating the knots between two nodes (Schur complement) leaves equations that link each node with the next, so
    that they are banded as those of the knots are.

    Args:
        equations: of all knots, each linked with the next at most.
        nodes: (m,) increasing numbers of knots, the first and the last one among them.

    Raises:
        LinAlgError: if the observations do not determine the states.
    """
    m = len(nodes)
    reduced = NormalEquations(m * size, 2 * size)
    diagonal = np.zeros((m, size, size))
    for number, node in enumerate(nodes.tolist()):
        for column in range(size):
            diagonal[number, column:, column] = equations.band[: size - column, node * size + column]
        diagonal[number] += np.tril(diagonal[number], -1).T
    beside = np.zeros((m - 1, size, size))
    for number, (first, last) in enumerate(zip(nodes[:-1].tolist(), nodes[1:].tolist(), strict=True)):
        if last == first + 1:
            beside[number] = _beside(equations, size, first)
            continue
        to_first = _beside(equations, size, first)
        to_last = _beside(equations, size, last - 1).T
        inner = slice((first + 1) * size, last * size)
        right = np.zeros((inner.stop - inner.start, 2 * size), order="F")
        right[:size, :size] = to_first
        right[-size:, size:] = to_last
        factor, fault = scipy.linalg.lapack.dpbtrf(arrays.copied(equations.band[:, inner]), lower=1, overwrite_ab=1)
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


def _beside(equations: NormalEquations, size: int, knot: int) -> FloatArray:
    """(size, size) block of the next knot's rows and a knot's columns."""
    out = np.empty((size, size))
    for column in range(size):
        out[:, column] = equations.band[size - column : 2 * size - column, knot * size + column]
    return out
