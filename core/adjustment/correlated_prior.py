"""Least squares with a prior whose errors go together so closely that their covariance has no usable inverse.

Poses may be known to decimetres against the map and to a tenth of a millimetre against each other. The inverse of such
a covariance loses the former to rounding. Unknowns ``x = root z`` with ``root rootᵀ`` the covariance are of variance 1
before, and keep both.
"""

from typing import Final

import numpy as np
import scipy.linalg

from furrowmap.core.runtime.arrays import FloatArray

MIN_VARIANCE_SHARE: Final = 1e-15
"""Variances that are smaller in relation to the largest one are rounding errors of the covariance."""


def root_of(spread: FloatArray, covariance: FloatArray) -> FloatArray:
    """(u, u) root of the joint covariance of independent unknowns and of correlated ones behind them."""
    fixed = len(spread)
    scale = np.sqrt(np.diag(covariance))
    variance, axes = np.linalg.eigh(covariance / scale[:, None] / scale)
    variance = np.maximum(variance, MIN_VARIANCE_SHARE * variance[-1])
    out = np.zeros((fixed + len(covariance),) * 2)
    out[np.arange(fixed), np.arange(fixed)] = spread
    out[fixed:, fixed:] = scale[:, None] * axes * np.sqrt(variance)
    return out


def solved(normal: FloatArray, right: FloatArray, root: FloatArray, at: FloatArray) -> tuple[FloatArray, FloatArray]:
    """The step (v,) of the unknowns in units of the root, and the Cholesky factor (v, v) of its equations.

    Args:
        normal: (u, u) normal matrix of the observations.
        right: (u,) right side: what the observations want beyond `root @ at`.
        root: (u, v) of the covariance before, times its transpose; see :func:`root_of`.
        at: (v,) unknowns in units of the root, at which the observations are linearised.

    Raises:
        LinAlgError: if the equations are singular.
    """
    whole = root.T @ normal @ root
    whole = 0.5 * (whole + whole.T)
    whole[np.diag_indices(len(whole))] += 1.0
    factor = np.asarray(np.linalg.cholesky(whole), np.float64)
    return scipy.linalg.cho_solve((factor, True), root.T @ right - at), factor


def covariance_after(factor: FloatArray, root: FloatArray) -> tuple[FloatArray, FloatArray]:
    """The covariance (u, u) of `root @ z` by the factor of :func:`solved`, and the variances (v,) of z, 1 before."""
    inverse = scipy.linalg.solve_triangular(factor, np.eye(len(factor)), lower=True)
    half = inverse @ root.T
    return half.T @ half, (inverse**2).sum(axis=0)
