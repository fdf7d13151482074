"""Least squares of heights of cells at several times; the height of each cell itself is eliminated."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numba
import numpy as np
from numpy.typing import NDArray

from furrowmap.core.estimation.banded import huber_weight
from furrowmap.core.runtime.arrays import FloatArray

ROBUST_ROUNDS: Final = 3


@dataclass(frozen=True)
class GroupHeights:
    """Heights of g groups: the returns of one cell in one window of time.

    Attributes:
        cell: (g,) number of the cell, 0 to c − 1, each with a group.
        window: (g,) number of the window; no two groups of a cell share one.
        height_m: (g,) mean height.
        weight: (g,) its inverse variance.
        design: (g, p) derivatives by the parameters.
    """

    cell: NDArray[np.int64]
    window: NDArray[np.int64]
    height_m: FloatArray
    weight: FloatArray
    design: FloatArray


def adjusted(groups: GroupHeights, spread: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Parameters and heights of windows that bring the groups of each cell to one height.

    Args:
        groups: the heights.
        spread: (p + w,) standard deviations of the p parameters and of the w windows' heights before.

    Returns:
        What parameters and windows put into the heights (p + w,), its covariance, and the mean heights of the cells
        as measured (c,).
    """
    g = groups
    parameters = g.design.shape[1]
    order = np.argsort(g.cell, kind="stable")
    begin = np.concatenate([[0], np.cumsum(np.bincount(g.cell))])
    cell, window, height, independent = g.cell[order], g.window[order], g.height_m[order], g.weight[order]
    design = np.ascontiguousarray(g.design[order])
    robust = np.ones(len(order))
    for _ in range(ROBUST_ROUNDS):
        weight = independent * robust
        normal, right, middle, means = _normal_equations(begin, window, height, design, weight, len(spread))
        normal[parameters:, :parameters] = normal[:parameters, parameters:].T
        normal[np.diag_indices_from(normal)] += 1.0 / spread**2
        off = np.linalg.solve(normal, right)
        shift = off[parameters:][window]
        windows = np.bincount(cell, weight * shift) / np.bincount(cell, weight)
        residual = height - design @ off[:parameters] - shift - (middle - means @ off[:parameters] - windows)[cell]
        robust = huber_weight(np.abs(residual) * np.sqrt(independent))
    return off, np.asarray(np.linalg.inv(normal), np.float64), middle


@numba.njit(cache=True, nogil=True)
def _normal_equations(begin, window, height, design, weight, unknowns):  # type: ignore[no-untyped-def]
    """Normal matrix without its lower left, right side, mean heights of the cells, mean derivatives (c, p)."""
    p, cells = design.shape[1], len(begin) - 1
    normal, right = np.zeros((unknowns, unknowns)), np.zeros(unknowns)
    middle, means = np.zeros(cells), np.zeros((cells, p))
    for c in range(cells):
        total = 0.0
        mean = means[c]
        for g in range(begin[c], begin[c + 1]):
            total += weight[g]
            middle[c] += weight[g] * height[g]
            for j in range(p):
                mean[j] += weight[g] * design[g, j]
        middle[c] /= total
        for j in range(p):
            mean[j] /= total
        for g in range(begin[c], begin[c + 1]):
            w, u = weight[g], p + window[g]
            off = w * (height[g] - middle[c])
            right[u] += off
            normal[u, u] += w
            for h in range(begin[c], begin[c + 1]):
                normal[u, p + window[h]] -= w * weight[h] / total
            for j in range(p):
                apart = design[g, j] - mean[j]
                right[j] += off * design[g, j]
                normal[j, u] += w * apart
                for k in range(j + 1):
                    normal[j, k] += w * apart * (design[g, k] - mean[k])
    for j in range(p):
        for k in range(j):
            normal[k, j] = normal[j, k]
    return normal, right, middle, means
