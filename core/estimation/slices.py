"""Sums of equations by the slices of time between knots, which kernels over many returns add up."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numba
import numpy as np
from numpy.typing import NDArray

from furrowmap.core.estimation.banded import NormalEquations
from furrowmap.core.estimation.knots import Knots
from furrowmap.core.runtime import scratch

FloatArray = NDArray[np.float64]

UPPER: Final = 21
"""Entries of a symmetric 6 × 6 matrix."""


@dataclass(frozen=True)
class SliceSums:
    """Normal equations of the poses of the slices between knots.

    A slice's unknowns are position and rotation vector (map axes) of the pose half-way between its two knots.

    Attributes:
        normal: (n, 21) upper triangles of the normal matrices, row by row.
        right: (n, 6) right-hand sides against a fixed reference.
        right_free: (n, 6) the same against a reference that moves with the poses.
        count: (n,) returns that took part.
    """

    normal: FloatArray
    right: FloatArray
    right_free: FloatArray
    count: NDArray[np.int64]

    @classmethod
    def of(cls, knots: int) -> SliceSums:
        """No returns yet, for a number of knots."""
        return cls(
            scratch.zeros((knots, UPPER)),
            scratch.zeros((knots, 6)),
            scratch.zeros((knots, 6)),
            scratch.zeros(knots, np.int64),
        )

    def take(self, other: SliceSums) -> None:
        """Add the other's sums to these."""
        for own, more in (
            (self.normal, other.normal), (self.right, other.right), (self.right_free, other.right_free)
        ):  # fmt: skip
            own += more
        self.count[:] += other.count

    def add_to(self, equations: NormalEquations, knots: Knots, *, free: bool) -> None:
        """Add the slices to the equations of all knots: a slice's pose is the mean of those of its two knots.

        Args:
            equations: of all knots; changed.
            knots: of the slices.
            free: whether the reference moves with the poses.
        """
        right = np.ascontiguousarray(self.right_free if free else self.right)
        size = len(equations.right) // len(knots)
        _add_slices(size, equations.band, equations.right, knots.linked, self.normal, right)


@numba.njit(cache=True, nogil=True)
def _add_slices(size, band, right, linked, normal, slice_right):  # type: ignore[no-untyped-def]
    for k in linked:
        first = k * size
        entry = 0
        for a in range(6):
            half = 0.5 * slice_right[k, a]
            right[first + a] += half
            right[first + size + a] += half
            for b in range(a, 6):
                quarter = 0.25 * normal[k, entry]
                entry += 1
                band[b - a, first + a] += quarter
                band[b - a, first + size + a] += quarter
                band[size + a - b, first + b] += quarter
                if a != b:
                    band[size + b - a, first + a] += quarter


@numba.njit(cache=True, nogil=True)
def plane_row(row, nx, ny, nz, x, y, z):  # type: ignore[no-untyped-def]
    """Set `row` (6,) to (n, p × n): derivatives of a distance along n of a point at p from the pose's place."""
    row[0], row[1], row[2] = nx, ny, nz
    row[3], row[4], row[5] = y * nz - z * ny, z * nx - x * nz, x * ny - y * nx


@numba.njit(cache=True, nogil=True)
def add_to_slice(normal, right, right_free, k, row, weight, residual, residual_free):  # type: ignore[no-untyped-def]
    """Add one equation to the sums of slice `k`."""
    entry = 0
    for a in range(6):
        weighted = weight * row[a]
        right[k, a] -= weighted * residual
        right_free[k, a] -= weighted * residual_free
        for b in range(a, 6):
            normal[k, entry] += weighted * row[b]
            entry += 1
