"""Longer steps where Gauss-Newton steps are too short.

Aitken's extrapolation for vectors (Irons and Tuck 1969, A version of the Aitken accelerator for computer iteration).

A surface blurred by wrong poses shows too little of their error: steps follow each other in the same direction, each a
small share of the error. Two steps in succession show how small, and the next is lengthened accordingly. Poses are
wrong in one stretch of time and right in others, so each time has its own factor.
"""

from dataclasses import dataclass, field
from typing import Final

import numpy as np
from scipy.ndimage import uniform_filter1d

from furrowmap.core.adjustment.knots import KNOT_STEP_S, Knots
from furrowmap.core.runtime.arrays import FloatArray

COMPARED_OVER_S: Final = 3.0
"""Over so much time the steps are compared: that of a window."""
GROUND_ARM_M: Final = 5.0
"""How far away the ground is by which a turn is weighed against a shift."""
MAX_STEP_FACTOR: Final = 6.0
MAX_LENGTHENED_M: Final = 0.4
"""Largest factor, and how far steps are lengthened at most: longer ones leave the range in which the equations hold, a
cell of the surface or so, and may end at another minimum."""


@dataclass
class Relaxation:
    """How much longer steps are made, as learned from those before."""

    _moved_m: FloatArray = field(default_factory=lambda: np.zeros((0, 3)))
    _factor: FloatArray = field(default_factory=lambda: np.zeros(0))

    def lengthened(self, step: FloatArray, knots: Knots) -> FloatArray:
        """Lengthen the step (n, 9) at all knots in its place, by 1 at least; the first stays as found. Returns it."""
        moved = np.column_stack([step[:, :2], GROUND_ARM_M * step[:, 5]])
        factor = np.ones(len(step))
        if len(self._moved_m):
            change = moved - self._moved_m
            left = _around(-np.einsum("ij,ij->i", self._moved_m, change), knots)
            square = _around(np.einsum("ij,ij->i", change, change), knots)
            share = np.divide(left, square, out=np.zeros(len(step)), where=square > 0.0)
            within = MAX_LENGTHENED_M / np.maximum(np.linalg.norm(moved, axis=1), 1e-9)
            factor = np.clip(self._factor * share, 1.0, np.clip(within, 1.0, MAX_STEP_FACTOR))
        self._moved_m = moved
        self._factor = factor
        step *= factor[:, None]
        return step


def _around(values: FloatArray, knots: Knots) -> FloatArray:
    """Means (n,) over COMPARED_OVER_S about each knot, of its own chain."""
    out = np.empty_like(values)
    for chain in knots.chains:
        part = slice(chain.first, chain.first + chain.count)
        out[part] = uniform_filter1d(values[part], round(COMPARED_OVER_S / KNOT_STEP_S), mode="nearest")
    return out
