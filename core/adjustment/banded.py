"""Least squares: banded normal equations, their solution, damping and variances, and Huber's robust weights."""

from contextlib import suppress
from copy import copy
from dataclasses import dataclass
from typing import Final

import numpy as np
import scipy.linalg
from numpy.typing import NDArray

from furrowmap.core.runtime import arrays
from furrowmap.core.runtime.arrays import FloatArray
from furrowmap.core.runtime.kernels import kernel

DAMPINGS: Final = (1e-9, 1e-8, 1e-7, 1e-6, 1e-5, 1e-4, 1e-3, 1e-2)
"""Shares of the diagonal, or of MIN_DIAGONAL (per square metre or radian) where that is more."""
MIN_DIAGONAL: Final = 1.0
HUBER_SIGMAS: Final = 3.0
"""Standard deviations from which on residuals of positions lose weight."""


class NormalEquations:
    """Normal equations ``N x = r`` of observations that each touch a few consecutive unknowns.

    Attributes:
        band: (width, n) lower form of N, as `scipy.linalg.solveh_banded` has it: ``band[i − j, j] = N[i, j]``. A column
            lies together in memory (Fortran's order), as LAPACK wants it.
        right: (n,) right-hand side.
        squares: sum of the squared residuals, each over its standard deviation.
        redundancy: number of observations beyond that of unknowns.
        log_sigmas: sum of the logarithms of the standard deviations.
    """

    def __init__(self, unknowns: int, width: int) -> None:
        self.band = arrays.zeros((width, unknowns), order="F")
        self.right = arrays.zeros(unknowns)
        self.squares = 0.0
        self.redundancy = -unknowns
        self.log_sigmas = 0.0

    def add(self, first: NDArray[np.intp], design: FloatArray, residual: FloatArray, sigma: FloatArray) -> None:
        """Add observations.

        Args:
            first: (m,) index of the first unknown that each touches; no index twice.
            design: (m, p) derivatives by the p consecutive unknowns from `first` on; p at most the band's width.
            residual: (m,) observed minus computed.
            sigma: (m,) standard deviations.
        """
        for part in arrays.parts(len(first)):
            scaled = np.ascontiguousarray(design[part] / sigma[part, None])
            right = np.ascontiguousarray(residual[part] / sigma[part])
            _add(self.band.T, self.right, np.ascontiguousarray(first[part], np.int64), scaled, right)
            self.squares += float(right @ right)
            self.redundancy += len(right)
            self.log_sigmas += float(np.log(sigma[part]).sum())

    def copied(self) -> "NormalEquations":
        """The same equations, to which others can be added."""
        out = copy(self)
        out.band = arrays.copied(self.band)
        out.right = self.right.copy()
        return out

    def dense(self) -> FloatArray:
        """(n, n) the whole of N."""
        out: FloatArray = _dense(self.band.T)
        return out

    def solve(self) -> "BandedSolution":
        """The solution, which also knows how well it is known. Raises LinAlgError if N is not positive definite."""
        # LAPACK itself, since SciPy's functions look for numbers that are not finite in copies of the whole.
        factor, fault = scipy.linalg.lapack.dpbtrf(arrays.copied(self.band), lower=1, overwrite_ab=1)
        if fault:
            raise np.linalg.LinAlgError(f"the normal matrix is not positive definite in row {fault}")
        solution = BandedSolution(_back(factor, self.right), factor)
        if not np.isfinite(solution.values).all():
            raise np.linalg.LinAlgError("the solution of the normal equations is not finite")
        return solution

    def solve_damped(self, dampable: NDArray[np.bool_]) -> "BandedSolution":
        """The solution with the least damping that makes N positive definite (Levenberg 1944); N keeps it.

        Args:
            dampable: (n,) unknowns that are damped first; the others only where that is not enough.

        Raises:
            LinAlgError: if no damping makes N positive definite.
        """
        with suppress(np.linalg.LinAlgError):
            return self.solve()
        diagonal = self.band[0].copy()
        # An unknown without any equation has no diagonal to take a share of.
        most = np.maximum(diagonal, MIN_DIAGONAL)
        for damped in (dampable * most, most):
            for damping in DAMPINGS:
                self.band[0] = diagonal + damping * damped
                with suppress(np.linalg.LinAlgError):
                    return self.solve()
        raise np.linalg.LinAlgError("the normal equations have no solution")


@dataclass(frozen=True)
class BandedSolution:
    """The solution of normal equations, and their banded Cholesky factor (width, n), lower form."""

    values: FloatArray
    factor: FloatArray

    @property
    def log_determinant(self) -> float:
        """Logarithm of the determinant of N."""
        return 2.0 * float(np.log(self.factor[0]).sum())

    def by(self, right: FloatArray) -> FloatArray:
        """(n,) the unknowns of the same normal matrix with another right-hand side, or (n, m) those with several."""
        return _back(self.factor, right)

    def inverse(self) -> FloatArray:
        """(n, n) the whole of N⁻¹."""
        half: FloatArray
        half, fault = scipy.linalg.lapack.dpotri(_dense(self.factor.T).T, lower=1, overwrite_c=1)
        assert not fault
        _mirror(half.T)
        return half

    def sigma(self) -> FloatArray:
        """(n,) standard deviations of the unknowns."""
        variance: FloatArray = arrays.zeros(len(self.values))
        _inverse_diagonal(np.ascontiguousarray(self.factor.T), variance)
        return np.sqrt(variance, out=variance)


def _back(factor: FloatArray, right: FloatArray) -> FloatArray:
    """(n,) the unknowns by the banded Cholesky factor."""
    solved: FloatArray
    solved, fault = scipy.linalg.lapack.dpbtrs(factor, arrays.copied(right), lower=1, overwrite_b=1)
    assert not fault
    return solved


@kernel()
def _add(columns, right, first, scaled, residual):  # type: ignore[no-untyped-def]
    touched = np.empty(scaled.shape[1], np.int64)
    for k in range(len(first)):
        begin = first[k]
        count = 0
        for j in range(scaled.shape[1]):
            if scaled[k, j] != 0.0:
                touched[count] = j
                count += 1
        for a in range(count):
            j = touched[a]
            right[begin + j] += scaled[k, j] * residual[k]
            for b in range(a, count):
                columns[begin + j, touched[b] - j] += scaled[k, touched[b]] * scaled[k, j]


@kernel()
def _dense(columns):  # type: ignore[no-untyped-def]
    """The symmetric matrix of the columns (n, width) of its lower band."""
    n, width = columns.shape
    out = np.zeros((n, n))
    for j in range(n):
        for offset in range(min(width, n - j)):
            out[j, j + offset] = out[j + offset, j] = columns[j, offset]
    return out


@kernel()
def _mirror(matrix):  # type: ignore[no-untyped-def]
    """Copy the upper triangle of a matrix to its lower one."""
    for i in range(len(matrix)):
        for j in range(i):
            matrix[i, j] = matrix[j, i]


@kernel()
def _inverse_diagonal(factor, out):  # type: ignore[no-untyped-def]
    """Set ``out`` to the diagonal of ``(L Lᵀ)⁻¹`` where ``factor[j, i − j] = L[i, j]``.

    Only the entries of the inverse inside the band are computed, from the last column to the first (Takahashi, Fagan
    and Chin 1973; equations 4 and 5 of Erisman and Tinney 1975, Comm. ACM 18). Of these the last `width` rows and
    columns are kept, row i in place i % width, so that the inner loop is over consecutive numbers.
    """
    n, width = factor.shape
    inverse = np.zeros((width, width))
    total = np.empty(width)
    for j in range(n - 1, -1, -1):
        reach = min(width - 1, n - 1 - j)
        at = j % width
        total[:] = 0.0
        for k in range(1, reach + 1):
            row = inverse[(j + k) % width]
            for place in range(width):
                total[place] -= factor[j, k] * row[place]
        own = 1.0 / factor[j, 0]
        for i in range(reach, 0, -1):
            place = (j + i) % width
            inverse[at, place] = inverse[place, at] = total[place] / factor[j, 0]
        for k in range(1, reach + 1):
            own -= factor[j, k] * inverse[at, (j + k) % width]
        inverse[at, at] = out[j] = own / factor[j, 0]


def huber_weight(normalised: FloatArray) -> FloatArray:
    """Weights (n,) of residuals (n,) in standard deviations, none of them negative; 1 for nan."""
    known = np.nan_to_num(normalised)
    return HUBER_SIGMAS / np.maximum(known, HUBER_SIGMAS)
