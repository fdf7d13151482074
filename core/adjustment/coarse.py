"""Coarse knots: the slow part of the solution.

Corrections of the poses are twists (translation and rotation) at coarse knots in time, linear in between, so that a
rigid motion of everything is one of them exactly. The equations are those of all knots, projected (Galerkin).
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from furrowmap.core.adjustment.banded import NormalEquations
from furrowmap.core.adjustment.knots import KNOT_STEP_S, Chain, Knots, State
from furrowmap.core.runtime import arrays
from furrowmap.core.runtime.arrays import FloatArray, IntArray
from furrowmap.core.runtime.kernels import kernel


class CoarseGrid(NamedTuple):
    """The coarse knots of a chain: the first one's index, and the knots between two, 0 where no patches are wanted."""

    first: int
    every: int
    patch_m: float


@dataclass(frozen=True)
class CoarseKnots:
    """The coarse knots of all chains: the one before each knot (n,), and the share (n,) of the interval to the next."""

    grids: tuple[CoarseGrid, ...]
    count: int
    before: IntArray
    share: FloatArray

    @classmethod
    def over(cls, knots: Knots, every: int, patch_m: float) -> "CoarseKnots":
        """A coarse knot at every `every`-th knot of each chain."""
        grids = []
        before = []
        share = []
        first = 0
        for chain in knots.chains:
            local = np.arange(chain.count)
            # The last knot never opens an interval: the coarse knot at its far end would move no knot.
            interval = np.minimum(local // every, _intervals(chain, every) - 1)
            grids.append(CoarseGrid(first, every, patch_m))
            before.append(first + interval)
            share.append(local / every - interval)
            first += _intervals(chain, every) + 1
        return cls(tuple(grids), first, np.concatenate(before), np.concatenate(share))

    def touched(self, chosen: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """(count,) the coarse knots before and after one of the knots chosen (n,)."""
        out = np.zeros(self.count, np.bool_)
        out[self.before[chosen]] = out[self.before[chosen] + 1] = True
        return out

    def times_s(self, knots: Knots) -> FloatArray:
        """(count,) time of each coarse knot."""
        chains = zip(knots.chains, self.grids, strict=True)
        steps = [(c.begin_s, g.every * KNOT_STEP_S * np.arange(_intervals(c, g.every) + 1)) for c, g in chains]
        return np.concatenate([begin_s + since_s for begin_s, since_s in steps])

    def centres(self, knots: Knots, state: State) -> FloatArray:
        """(count, 3) where the vehicle is at each coarse knot; a twist turns about that point."""
        out = []
        times_s = self.times_s(knots)
        for chain, grid in zip(knots.chains, self.grids, strict=True):
            part = slice(chain.first, chain.first + chain.count)
            t = times_s[grid.first : grid.first + _intervals(chain, grid.every) + 1]
            out.append(np.column_stack([np.interp(t, knots.t_s[part], state.xyz_m[part, k]) for k in range(3)]))
        return np.concatenate(out)


def _intervals(chain: Chain, every: int) -> int:
    """Intervals between the coarse knots of a chain."""
    return -(-(chain.count - 1) // every)


def coarse_equations(
    fine: NormalEquations, coarse: CoarseKnots, centre_m: FloatArray, state: State, reach: int
) -> NormalEquations:
    """Normal equations of the coarse knots from those of all knots (Galerkin's projection).

    Args:
        fine: of all knots, the returns' part against the surface of both halves.
        reach: how many coarse knots apart two may be that a patch links.
    """
    size = state.layout.size
    equations = NormalEquations(coarse.count * size, min(reach + 2, coarse.count) * size)
    _project(
        size, fine.band, fine.right, coarse.before, coarse.share, np.ascontiguousarray(state.xyz_m), centre_m,
        equations.band, equations.right,
    )  # fmt: skip
    return equations


def fine_step(coarse: CoarseKnots, centre_m: FloatArray, state: State, step: FloatArray) -> FloatArray:
    """The step (n, size) at all knots that a step (count · size,) at the coarse ones makes."""
    twist = step.reshape(coarse.count, -1)

    def interpolated(part: slice) -> list[FloatArray]:
        before = coarse.before[part]
        share = coarse.share[part]
        out = np.zeros((len(before), twist.shape[1]))
        for knot, weight in ((before, 1.0 - share), (np.minimum(before + 1, coarse.count - 1), share)):
            moved = twist[knot]
            moved[:, :3] += np.cross(moved[:, 3:6], state.xyz_m[part] - centre_m[knot])
            out += weight[:, None] * moved
        return [out]

    return arrays.in_parts(interpolated, len(state.xyz_m))[0]


def coarse_right(coarse: CoarseKnots, centre_m: FloatArray, state: State, right: FloatArray) -> FloatArray:
    """A right-hand side (count · size,) of the coarse knots from one (n, size): :func:`fine_step` transposed."""
    out = np.zeros((coarse.count, right.shape[1]))
    for some in arrays.parts(len(right)):
        before = coarse.before[some]
        share = coarse.share[some]
        for knot, weight in ((before, 1.0 - share), (np.minimum(before + 1, coarse.count - 1), share)):
            pull = right[some].copy()
            pull[:, 3:6] += np.cross(state.xyz_m[some] - centre_m[knot], right[some, :3])
            np.add.at(out, knot, weight[:, None] * pull)
    return out.ravel()


@kernel()
def _project(size, band, right, before, share, xyz_m, centre_m, coarse_band, coarse_right):  # type: ignore[no-untyped-def]
    """Pᵀ (fine) P, where P's rows of a knot hold hat(s) · [I, [centre − x]ₓ; I; I] at two coarse knots."""
    width = band.shape[0]
    n = len(before)
    reach = width // size
    count = len(centre_m)
    weights = np.empty((n, 2))
    arm = np.empty((n, 2, 3))
    for j in range(n):
        weights[j, 0] = 1.0 - share[j]
        weights[j, 1] = share[j]
        for e in range(2):
            c = min(before[j] + e, count - 1)
            w = weights[j, e]
            for a in range(3):
                arm[j, e, a] = xyz_m[j, a] - centre_m[c, a]
            if w == 0.0:
                continue
            at = coarse_right[c * size : (c + 1) * size]
            fine = right[j * size : (j + 1) * size]
            for a in range(size):
                at[a] += w * fine[a]
            dx, dy, dz = arm[j, e]
            at[3] += w * (dy * fine[2] - dz * fine[1])
            at[4] += w * (dz * fine[0] - dx * fine[2])
            at[5] += w * (dx * fine[1] - dy * fine[0])
    block = np.empty((size, size))
    left = np.empty((size, size))
    product = np.empty((size, size))
    for j in range(n):
        for step in range(reach):
            i = j + step
            if i >= n:
                break
            nonzero = False
            for a in range(size):
                for b in range(size):
                    row = i * size + a
                    column = j * size + b
                    if row >= column:
                        block[a, b] = band[row - column, column]
                    else:
                        block[a, b] = band[column - row, row]
                    nonzero = nonzero or block[a, b] != 0.0
            if not nonzero:
                continue
            for e in range(2):
                if weights[i, e] == 0.0:
                    continue
                dx, dy, dz = arm[i, e]
                for b in range(size):
                    for a in range(size):
                        left[a, b] = block[a, b]
                    left[3, b] += dy * block[2, b] - dz * block[1, b]
                    left[4, b] += dz * block[0, b] - dx * block[2, b]
                    left[5, b] += dx * block[1, b] - dy * block[0, b]
                for f in range(2):
                    w = weights[i, e] * weights[j, f]
                    if w == 0.0:
                        continue
                    dx, dy, dz = arm[j, f]
                    for a in range(size):
                        for b in range(size):
                            product[a, b] = w * left[a, b]
                        product[a, 3] += w * (dy * left[a, 2] - dz * left[a, 1])
                        product[a, 4] += w * (dz * left[a, 0] - dx * left[a, 2])
                        product[a, 5] += w * (dx * left[a, 1] - dy * left[a, 0])
                    _add_block(size, coarse_band, before[i] + e, before[j] + f, product, step > 0)


@kernel()
def _add_block(size, band, i, j, block, both):  # type: ignore[no-untyped-def]
    """Add a block at (i, j) to the lower band, and its transpose at (j, i) too if it stands for `both`."""
    for a in range(size):
        for b in range(size):
            row = i * size + a
            column = j * size + b
            if row >= column:
                band[row - column, column] += block[a, b]
            if both and column >= row:
                band[column - row, row] += block[a, b]
